# SPDX-License-Identifier: MIT
set(CMAKE_SYSTEM_PROCESSOR riscv32)
set(BITNEAT_ZIG_TARGET riscv32-freestanding)
set(BITNEAT_MACHINE_FLAGS "-mcpu=generic_rv32+m+a+c")
include(${CMAKE_CURRENT_LIST_DIR}/zig.cmake)
