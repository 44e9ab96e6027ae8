#!/bin/sh
# SPDX-License-Identifier: MIT
#
# Installs the Debian packages that the tests can use and that are missing, one line per action. Goes on where it may not:
# the tests then use the compilers of the ziglang package, or say which tool they lack. BITNEAT_NO_APT=1 turns it off.
# With the argument `long` also what only the long tests use.

set -u

# command that shows that a package is there : package
WANTED="
g++:g++
clang:clang
tcc:tcc
arm-none-eabi-gcc:gcc-arm-none-eabi
arm-none-eabi-objdump:binutils-arm-none-eabi
avr-gcc:gcc-avr
avr-objdump:binutils-avr
simavr:simavr
qemu-system-arm:qemu-system-arm
riscv64-unknown-elf-gcc:gcc-riscv64-unknown-elf
chromium:chromium
cppcheck:cppcheck
zsh:zsh
fish:fish
"
# file that shows that a package without a command is there : package
WANTED_FILES="
/usr/lib/avr/include/avr/pgmspace.h:avr-libc
/usr/include/simavr/sim_avr.h:libsimavr-dev
/usr/include/libelf.h:libelf-dev
"

if [ "${1:-}" = long ]; then
    WANTED="$WANTED frama-c:frama-c-base"
fi

# clang's sanitizers and libFuzzer are a package for each version of clang: its name, if clang is there and they are not.
clang_runtime() {
    command -v clang >/dev/null 2>&1 || return 0
    [ -e "$(clang -print-resource-dir)/lib/linux/libclang_rt.fuzzer-$(uname -m).a" ] ||
        echo "libclang-rt-$(clang -dumpversion | cut -d. -f1)-dev"
}

missing=""
for pair in $WANTED; do
    command -v "${pair%%:*}" >/dev/null 2>&1 || missing="$missing ${pair#*:}"
done
for pair in $WANTED_FILES; do
    [ -e "${pair%%:*}" ] || missing="$missing ${pair#*:}"
done
[ -z "$(clang_runtime)" ] || missing="$missing $(clang_runtime)"
[ -n "$missing" ] || exit 0

if [ -n "${BITNEAT_NO_APT:-}" ]; then
    echo "tools: not installing$missing (BITNEAT_NO_APT is set)"
    exit 0
fi
if ! command -v apt-get >/dev/null 2>&1; then
    echo "tools: no apt-get here, going on without$missing"
    exit 0
fi
if [ "$(id -u)" = 0 ]; then
    as_root="env"
elif command -v sudo >/dev/null 2>&1 && sudo -n true >/dev/null 2>&1; then
    as_root="sudo -n env"
else
    echo "tools: not root, going on without$missing (to have them: sudo apt-get install$missing)"
    exit 0
fi

apt() {
    $as_root DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=120 -o Acquire::Retries=2 \
        -o Acquire::http::Timeout=30 "$@" </dev/null >/dev/null 2>&1
}

echo "tools: reading the package lists"
apt update || echo "tools: could not read them, trying with those at hand"
install() {
    if apt install --yes --no-install-recommends "$1"; then
        echo "tools: installed $1"
    else
        echo "tools: could not install $1, going on without"
    fi
}
for package in $missing; do
    install "$package"
done
# Of a clang that was installed just now.
case " $missing " in
*" clang "*) [ -z "$(clang_runtime)" ] || install "$(clang_runtime)" ;;
esac
exit 0
