# SPDX-License-Identifier: MIT
#
# The cross compiler of the ziglang package; included by the zig-*.cmake files, which set BITNEAT_ZIG_TARGET and
# BITNEAT_MACHINE_FLAGS. zig is looked for as BITNEAT_ZIG, in the PATH, and in the ziglang package of the PATH's python3.
if(NOT BITNEAT_ZIG)
    find_program(BITNEAT_ZIG zig)
endif()
if(NOT BITNEAT_ZIG)
    execute_process(
        COMMAND python3 -c "import pathlib, ziglang; print(pathlib.Path(ziglang.__file__).with_name('zig'))"
        OUTPUT_VARIABLE BITNEAT_ZIG OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET
    )
endif()
if(NOT EXISTS "${BITNEAT_ZIG}")
    message(FATAL_ERROR "zig not found; pip install ziglang, or set BITNEAT_ZIG to the program")
endif()
set(BITNEAT_ZIG ${BITNEAT_ZIG} CACHE FILEPATH "the zig program" FORCE)
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES BITNEAT_ZIG)

set(CMAKE_C_COMPILER ${BITNEAT_ZIG} cc -target ${BITNEAT_ZIG_TARGET})
# zig's archiver is a sub-command, which CMAKE_AR cannot say.
set(CMAKE_AR ${BITNEAT_ZIG})
set(CMAKE_RANLIB ${BITNEAT_ZIG})
set(CMAKE_C_ARCHIVE_CREATE "<CMAKE_AR> ar qc <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_APPEND "<CMAKE_AR> ar q <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_FINISH "<CMAKE_RANLIB> ranlib <TARGET>")

include(${CMAKE_CURRENT_LIST_DIR}/freestanding.cmake)
