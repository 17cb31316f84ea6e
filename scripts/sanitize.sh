#!/usr/bin/env bash
# Runs the unsafe code under what can look into it: Miri for the allocator's counters, the lanes and the columns, AddressSanitizer
# for machine code and everything around it. Needs the nightly toolchain with `miri` and `rust-src`; some three minutes on two cores for the latter.
#
#     scripts/sanitize.sh miri       # Miri alone
#     scripts/sanitize.sh address    # AddressSanitizer alone
set -euo pipefail
cd "$(dirname "$0")/.."
what=${1:-all}
# What Miri runs: modules without files, machine code or other processes. Wide lanes run as the portable ones there.
miri_modules=(memory:: film:: math::real math::scalar expr::arena kernel::cpu::columns)

if [ "$what" = all ] || [ "$what" = miri ]; then
    MIRIFLAGS="-Zmiri-disable-isolation" CARGO_TARGET_DIR=target/miri \
        cargo +nightly miri test --no-default-features --lib -- "${miri_modules[@]}"
fi
if [ "$what" = all ] || [ "$what" = address ]; then
    # Without leaks: threads of rayon and mappings of kernels live as long as the program.
    ASAN_OPTIONS=detect_leaks=0 RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR=target/address \
        cargo +nightly test --release --no-default-features --lib --target "$(rustc -vV | sed -n 's/^host: //p')" -- \
        kernel:: math:: memory:: film:: files:: formula::script
fi
