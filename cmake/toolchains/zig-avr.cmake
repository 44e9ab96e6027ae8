# SPDX-License-Identifier: MIT
set(CMAKE_SYSTEM_PROCESSOR avr)
set(BITNEAT_ZIG_TARGET avr-freestanding)
set(BITNEAT_MACHINE_FLAGS "-mcpu=atmega328p -Wno-avr-rtlib-linking-quirks")
include(${CMAKE_CURRENT_LIST_DIR}/zig.cmake)
