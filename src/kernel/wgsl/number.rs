//! Numbers and names in WGSL text.

use crate::expr::Type;

/// Names that generated code must not hide: built-in functions of the operator table and those of `shaders/`.
const TAKEN: &[&str] = &[
    "Call",
    "Estimate",
    "Running",
    "Uniforms",
    "abs",
    "acos",
    "asin",
    "atan2",
    "bitcast",
    "bool",
    "call",
    "clamp",
    "cos",
    "dot",
    "element",
    "estimate",
    "estimates",
    "exp",
    "f32",
    "floor",
    "fma",
    "i",
    "id",
    "inputs",
    "is_nan",
    "keep_running",
    "listed",
    "load",
    "log",
    "map",
    "march",
    "max",
    "min",
    "outputs",
    "pow",
    "read_state",
    "result",
    "running",
    "select",
    "sign",
    "sin",
    "sqrt",
    "start",
    "state",
    "store",
    "u32",
    "uniforms",
    "vec3",
    "vec4",
];

/// A legal WGSL name as close to `name` as possible.
pub(super) fn identifier(name: &str) -> String {
    let mut text: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !text.starts_with(|c: char| c.is_ascii_alphabetic()) {
        text.insert(0, 'v');
    }
    let is_word = |list: &[&str]| list.contains(&text.as_str());
    let is_ours = text.starts_with("bf_") || text.ends_with("_out");
    if is_ours || is_word(TAKEN) || is_word(naga::keywords::wgsl::RESERVED) {
        text.push('_');
    }
    text
}

/// `x` rounded to single precision: a literal that reads back as exactly that, or the helper for what has no literal.
/// Finite numbers beyond the range become its ends. Negative ones stand in parentheses.
pub(super) fn scalar(x: f64) -> String {
    if x.is_nan() {
        return "bf_nan_f32()".into();
    }
    if x.is_infinite() {
        return if x > 0.0 { "bf_inf_f32()".into() } else { "(-bf_inf_f32())".into() };
    }
    let rounded = (x as f32).clamp(f32::MIN, f32::MAX);
    match rounded.is_sign_negative() {
        true => format!("({rounded:?}f)"),
        false => format!("{rounded:?}f"),
    }
}

/// A constant of a type; components beyond its width are ignored.
pub(super) fn constant(ty: Type, components: [f64; 4]) -> String {
    let parts = &components[..usize::from(ty.width)];
    let text = |x: f64| match ty.is_bool {
        true => (x > 0.5).to_string(),
        false => scalar(x),
    };
    let bits = parts[0].to_bits();
    match ty.width {
        1 => text(parts[0]),
        _ if parts.iter().all(|x| x.to_bits() == bits) => format!("{}({})", ty.wgsl(), text(parts[0])),
        _ => format!("{}({})", ty.wgsl(), parts.iter().map(|&x| text(x)).collect::<Vec<_>>().join(", ")),
    }
}

/// The part of a helper's name that says its type.
pub(super) fn suffix(ty: Type) -> &'static str {
    match ty.width {
        1 => "f32",
        3 => "vec3",
        _ => "vec4",
    }
}

#[cfg(test)]
mod tests {
    use super::{identifier, scalar};

    #[test]
    fn literals_read_back_exactly() {
        for x in [0.1, -0.1, 1.0 / 3.0, 1e-30, 1e-38, 3.4e38, 1e10, 16_777_217.0, std::f64::consts::PI] {
            let text = scalar(x);
            let digits = text.trim_matches(|c| "(f)".contains(c));
            assert_eq!(digits.parse::<f32>().expect("a number"), x as f32, "{text}");
        }
    }

    #[test]
    fn numbers_without_a_literal_stay_legal() {
        assert_eq!(scalar(-0.0), "(-0.0f)");
        assert_eq!(scalar(1e300), "3.4028235e38f");
        assert_eq!(scalar(-1e300), "(-3.4028235e38f)");
        assert_eq!(scalar(f64::NEG_INFINITY), "(-bf_inf_f32())");
        assert_eq!(scalar(f64::NAN), "bf_nan_f32()");
    }

    #[test]
    fn names_avoid_words_of_the_language() {
        assert_eq!(identifier("z"), "z");
        assert_eq!(identifier("min"), "min_");
        assert_eq!(identifier("var"), "var_");
        assert_eq!(identifier("2 fold"), "v2_fold");
    }
}
