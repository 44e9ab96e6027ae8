# SPDX-License-Identifier: MIT
#
# What the toolchain files share: a machine without an operating system, and code that is to be small.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
if(NOT CMAKE_BUILD_TYPE)
    set(CMAKE_BUILD_TYPE MinSizeRel)
endif()
set(CMAKE_C_FLAGS_INIT "${BITNEAT_MACHINE_FLAGS} -ffreestanding -ffunction-sections")
