# SPDX-License-Identifier: MIT
set(CMAKE_SYSTEM_PROCESSOR cortex-m0)
set(BITNEAT_ZIG_TARGET thumb-freestanding-eabi)
set(BITNEAT_MACHINE_FLAGS "-mcpu=cortex_m0")
include(${CMAKE_CURRENT_LIST_DIR}/zig.cmake)
