#!/bin/sh
# The tests that take minutes, run before a release: sh scripts/long.sh [GRAPHS], from anywhere in the repository.
# GRAPHS is the number of random graphs whose bounds are attacked. docs/lab/long.md has the figures of the last run.
set -eu
cd "$(dirname "$0")/.."
graphs=${1:-300}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# Graphs that nobody tuned, for bounds.
python3 scripts/random_graphs.py "1..$graphs" -d "$folder" >/dev/null

long() {
    printf '\n== %s\n' "$1"
    cargo test --release --quiet --test it -- --ignored --exact --nocapture "$1"
}

# Every attack fails if it finds a counterexample.
long certified::no_member_is_in_a_million_proofs
BULBFOLD_GRAPHS=$folder long reach::a_million_members_are_within
long shortcuts::beams_and_boxes_change_no_hits_of_any

# The default of every fractal on more rays than `bulbfold test` takes.
printf '\n== defaults\n'
# shellcheck disable=SC2046  # names without spaces
cargo run --release --quiet -- truth $(grep -L '^    plane: ' formulas/fractals/*.ron) --rays 1500 --markdown
