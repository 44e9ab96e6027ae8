#!/bin/sh
# SPDX-License-Identifier: MIT
#
# The whole way, twice, in demo/: a controller evolved here and now, and the committed champion.

set -eu
cd "$(dirname "$0")/.."
rm -rf demo
mkdir demo
cd demo

say() {
    printf '\n== %s\n' "$*"
}

run() {
    printf '$ %s\n' "$*"
    "$@"
}

deploy() {
    run bitneat codegen "$1" -o "$2.c" --name "$2"
    run "${CC:-cc}" -std=c99 -Os -Wall -Wextra -Wpedantic -Wconversion -Werror -c "$2.c" -o "$2.o"
    run bitneat verify "$1" --c "$2.c" --episodes "$3"
    run bitneat size "$1"
}

say "Evolve a walker (seed 1), half as long as the preset would: some minutes"
run bitneat evolve --env BipedalWalker-v3 --generations 152 --seed 1 -o run

say "Generate C for it, compile it, and compare it with the simulator's loop, bit for bit"
deploy run/champion.pkl walker 2

champion=../examples/champions/tiny.pkl
say "The same for the smallest committed champion"
deploy "$champion" champion 3

say "Look at both: the walk, the network at work, the C in the browser"
run bitneat report run -o evolved.html --compare "$champion"
run bitneat report "$champion" -o report.html

say "Done: demo/walker.c and demo/champion.c are the files that were verified; open demo/report.html in a browser"
