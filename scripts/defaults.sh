#!/bin/sh
# Writes docs/lab/defaults.md: missed hits against brute force with every built-in fractal's default.
#   scripts/defaults.sh [RAYS]
set -eu
cd "$(dirname "$0")/.."
rays=${1:-1500}
bulbfold=${BULBFOLD:-target/release/bulbfold}
page=docs/lab/defaults.md
# Whatever the table says is kept; the exit code tells of broken budgets.
code=0
# Pictures of a plane march no rays.
files=$(grep -L '^    plane: ' formulas/fractals/*.ron)
# shellcheck disable=SC2086  # names without spaces
table=$("$bulbfold" truth $files --rays "$rays" --markdown) || code=$?
[ "$code" -le 1 ] || exit "$code"
cat > "$page.tmp" <<EOF
# Default estimates against brute force

Made by \`scripts/defaults.sh\`; change the fractals and not this page. For every built-in fractal, $rays random rays of
its own view at 320x240 were walked by brute force in f64 and marched with the fractal's default estimate
([checking.md](../checking.md) says how). Missed are hits that the march passed, of all hits, those thinner than half a pixel
included; early are stops in front of the truth; the depth error is the median in pixel footprints. Rays whose truth is
ambiguous are left out. The budget is 0.5 % missed, 5 % early and half a footprint.

$table
EOF
mv "$page.tmp" "$page"
exit "$code"
