# SPDX-License-Identifier: MIT
set(CMAKE_SYSTEM_PROCESSOR avr)
set(CMAKE_C_COMPILER avr-gcc)
set(BITNEAT_MACHINE_FLAGS "-mmcu=atmega328p")
include(${CMAKE_CURRENT_LIST_DIR}/freestanding.cmake)
