// Operators whose WGSL spelling needs more than a built-in, for one type $T. Only those that a kernel
// uses are written into it. NaN and infinity come from bits, which no compiler folds into an error.

fn bf_inf_$T() -> $T {
    var bits = 0x7f800000u;
    return $T(bitcast<f32>(bits));
}

fn bf_nan_$T() -> $T {
    var bits = 0x7fc00000u;
    return $T(bitcast<f32>(bits));
}

/// `pow` of a negative base is undefined, and that of 0 on some drivers.
fn bf_pow_$T(x: $T, y: $T) -> $T {
    let positive = pow(select($T(1.0), x, x > $T(0.0)), y);
    let at_zero = select(select(bf_inf_$T(), $T(1.0), y == $T(0.0)), $T(0.0), y > $T(0.0));
    return select(select(bf_nan_$T(), at_zero, x == $T(0.0)), positive, x > $T(0.0));
}

/// `atan2` of the origin is undefined; here it is 0.
fn bf_atan2_$T(y: $T, x: $T) -> $T {
    let at_origin = (x == $T(0.0)) & (y == $T(0.0));
    return select(atan2(y, select(x, $T(1.0), at_origin)), $T(0.0), at_origin);
}

/// Through `atan2`: drivers may be off by 7e-5 in `asin`. Clamps to [-1, 1].
fn bf_asin_$T(x: $T) -> $T {
    let s = clamp(x, $T(-1.0), $T(1.0));
    return atan2(s, sqrt(($T(1.0) - s) * ($T(1.0) + s)));
}

/// Through `atan2`: drivers may be off by 7e-5 in `acos`. Clamps to [-1, 1].
fn bf_acos_$T(x: $T) -> $T {
    let c = clamp(x, $T(-1.0), $T(1.0));
    return bf_atan2_$T(sqrt(($T(1.0) - c) * ($T(1.0) + c)), c);
}

/// The remainder with the sign of `y`.
fn bf_mod_$T(x: $T, y: $T) -> $T {
    return x - y * floor(x / y);
}
