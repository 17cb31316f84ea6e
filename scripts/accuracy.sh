#!/bin/sh
# Draws the charts of docs/lab/accuracy.md again: sh scripts/accuracy.sh, from the repository's root.
set -eu
bulbfold=${BULBFOLD:-target/release/bulbfold}
[ -x "$bulbfold" ] || cargo build --release
for name in box_bulb mandelbulb mandelbulb_power2 mandelbulb_julia mandelbox mandelbox_negative menger quaternion_julia; do
    "$bulbfold" chart "$name" --backend cpu -o "docs/images/accuracy_$name.svg"
done
"$bulbfold" chart mandelbulb --backend cpu --kind step-size -o docs/images/accuracy_step_size.svg
"$bulbfold" chart mandelbulb --backend cpu --kind depth -o docs/images/accuracy_depth.svg
