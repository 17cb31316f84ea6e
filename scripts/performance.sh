#!/bin/sh
# Renews the tables of docs/lab/comparison.md: sh scripts/performance.sh DIR, from the repository's root, where DIR holds
# Mandelbulber's settings (a_bulb8.fract ...). Other options go on to performance.py.
set -eu
[ $# -ge 1 ] || { echo "usage: sh scripts/performance.sh DIR [options of performance.py]" >&2; exit 2; }
scenes=$1
shift
cargo build --release
exec python3 scripts/performance.py --scenes "$scenes" --write docs/lab/comparison.md "$@"
