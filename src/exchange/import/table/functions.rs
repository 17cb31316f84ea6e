//! Functions that rows call in their expressions: pieces that many of Mandelbulber's formulas have in common, as texts of steps,
//! and values that change from one iteration to the next, as expressions of the iteration's number `n`.
//!
//! The program carries such values along; here they are solved in closed form, so that any iteration can be computed alone.
//! All start with iteration 0 and change in every one.

use rhai::{Engine, Map};

use crate::exchange::import::value::{written, written_vector};

/// Makes the functions known to an engine.
pub fn register(engine: &mut Engine) {
    engine.register_fn("eased", eased);
    engine.register_fn("alternating", alternating);
    engine.register_fn("boxed", boxed);
    engine.register_fn("turned", turned);
    engine.register_fn("is", is);
    engine.register_fn("tglad", tglad);
    engine.register_fn("ball", ball);
    engine.register_fn("turn", turn);
    engine.register_fn("folded", folded);
    engine.register_fn("invert", invert);
    engine.register_fn("stretch", stretch);
    engine.register_fn("swap", swap);
    engine.register_fn("placed", placed);
    engine.register_fn("larger", |size: f64| size.max(1e-6));
    engine.register_fn("larger_of", f64::max);
    engine.register_fn("taper_by", taper_by);
    engine.register_fn("part", |rings: bool| if rings { "rings" } else { "solid" });
    engine.register_fn("is_zero", |v: Map| vector(&v) == [0.0; 3]);
}

/// The orders of three axes in the program's list.
const ORDERS: [&str; 6] = ["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"];

fn vector(map: &Map) -> [f64; 3] {
    ["x", "y", "z"].map(|part| map.get(part).and_then(|value| value.as_float().ok()).unwrap_or(0.0))
}

/// Whether a setting is a word of the program's list, by its name or by its place.
fn is(value: &str, word: &str, place: i64) -> bool {
    value == word || value.parse() == Ok(place)
}

/// A box fold by moduli with limits of its own, of all axes or of x and y alone.
fn tglad(limit: Map, with_z: bool) -> String {
    let limit = vector(&limit);
    if limit.iter().any(|part| *part < 0.0) {
        // |z + l| - |z - l| - z with a negative l: not a reflection any more.
        let limits = written_vector(&[limit[0], limit[1], if with_z { limit[2] } else { 0.0 }]);
        let slopes = if with_z { "(1.0, 1.0, 1.0)" } else { "(1.0, 1.0, -1.0)" };
        return format!("modulus_fold(plus: {limits}, minus: {limits}, slope: {slopes})");
    }
    match with_z {
        true => format!("cuboid_fold(limit: {})", written_vector(&limit)),
        false => format!("surf_fold(limit: {})", written_vector(&limit)),
    }
}

/// A sphere fold by squared radii, about an offset.
fn ball(least: f64, most: f64, offset: Map) -> String {
    let radii =
        format!("min_radius: {}, fixed_radius: {}", written(least.max(0.0).sqrt()), written(most.max(1e-12).sqrt()));
    match vector(&offset) {
        [0.0, 0.0, 0.0] => format!("sphere_fold({radii})"),
        offset => format!("offset_sphere_fold(offset: {}, {radii})", written_vector(&offset)),
    }
}

/// One of the three folds of x and y that the program's surfaces choose from: a box fold, a tent, a tent about an offset.
fn folded(kind: &str, limit: Map, tent: Map, wide: f64, offset: Map) -> String {
    if is(kind, "type2", 1) {
        return format!("surf_fold(kind_x: tent, kind_y: tent, limit: {})", written_vector(&vector(&tent)));
    }
    if is(kind, "type3", 2) {
        let [x, y, _] = vector(&offset);
        let there = written_vector(&[x, y, 0.0]);
        let back = written_vector(&[-x, -y, 0.0]);
        let limit = written_vector(&[wide, wide, 1.0]);
        let fold = format!("surf_fold(kind_x: tent, kind_y: tent, limit: {limit})");
        return format!("translate(offset: {there}), {fold}, translate(offset: {back})");
    }
    tglad(limit, false)
}

/// What the taper of a cylinder counts.
fn taper_by(side: bool, square: bool) -> &'static str {
    match (side, square) {
        (_, true) => "square",
        (true, false) => "side",
        _ => "height",
    }
}

/// Turns about x, y and z, in degrees.
fn turn(degrees: Map) -> String {
    let [x, y, z] = vector(&degrees).map(written);
    format!("rotate_euler(x: {x}, y: {y}, z: {z})")
}

/// An inversion by a squared radius about -offset, with something added behind it.
fn invert(radius_sq: f64, offset: Map, added: Map) -> String {
    let (offset, added) = (vector(&offset), vector(&added));
    let back: [f64; 3] = std::array::from_fn(|i| added[i] - offset[i]);
    let parts = (written_vector(&offset), written(radius_sq.max(1e-12).sqrt()), written_vector(&back));
    format!("translate(offset: {}), inversion(radius: {}), translate(offset: {})", parts.0, parts.1, parts.2)
}

/// Factors of the three axes.
fn stretch(factors: Map) -> String {
    format!("axis_scale(scale: {})", written_vector(&vector(&factors)))
}

fn order(word: &str) -> &str {
    let place = word.parse().ok().and_then(|place: usize| ORDERS.get(place).copied());
    place.unwrap_or(word)
}

/// The axes in another order.
fn swap(word: &str) -> String {
    match order(word) {
        word if word != ORDERS[0] && ORDERS.contains(&word) => format!("swap_axes(order: {word})"),
        _ => "translate()".into(),
    }
}

/// The constant with its axes in another order, then with factors, added in the middle of a map.
fn placed(word: &str, factors: Map) -> String {
    let (factors, word) = (vector(&factors), order(word));
    let word = if ORDERS.contains(&word) { word } else { ORDERS[0] };
    let row = |(axis, factor): (char, f64)| {
        written_vector(&['x', 'y', 'z'].map(|other| if other == axis { factor } else { 0.0 }))
            .replace('(', "[")
            .replace(')', "]")
    };
    let rows: Vec<String> = word.chars().zip(factors).map(row).collect();
    format!("add_constant(matrix: [{}])", rows.join(", "))
}

/// A power of `factor` by the number of the iteration, counted from `start`. Negative factors alternate in sign, which
/// a cosine does as well.
fn power(factor: f64, start: u32) -> String {
    let n = if start == 0 { "n".to_string() } else { format!("(n + {})", written(f64::from(start))) };
    match factor < 0.0 {
        true => format!("{} ** {n} * cos(3.141592653589793 * {n})", written(-factor)),
        false => format!("{} ** {n}", written(factor)),
    }
}

/// What changes from 0 towards `end` by the factor `rate` in each iteration.
fn geometric(end: f64, rate: f64) -> String {
    match end.is_finite() {
        true => format!("{} * (1.0 - {})", written(end), power(rate, 0)),
        false => "0.0".into(),
    }
}

/// What is added to a scale: s' = s - rate (|s| - end), from s = 0.
///
/// While s keeps its sign, for rates from -1 to 1, that is a geometric approach: to `end` where rate and end have the same sign,
/// else to -end.
fn eased(rate: f64, end: f64) -> String {
    match rate * end >= 0.0 {
        true => geometric(end, 1.0 - rate),
        false => geometric(-end, 1.0 + rate),
    }
}

/// The same where the program replaces it instead: s' = -rate (|s| - end). For rates from -1 to 1 it keeps the sign of rate end.
fn alternating(rate: f64, end: f64) -> String {
    let factor = if rate * end >= 0.0 { -rate } else { rate };
    geometric(rate * end / (1.0 - factor), factor)
}

/// A box's scale that changes: s' = (|s| - 1) rate + scale before each use, from s = scale, whose sign it keeps for small rates.
fn boxed(scale: f64, rate: f64) -> String {
    if rate == 0.0 {
        return written(scale);
    }
    let factor = if scale < 0.0 { -rate } else { rate };
    let end = (scale - rate) / (1.0 - factor);
    format!("{} + ({}) * {}", written(end), written(scale - end), power(factor, 1))
}

/// An angle that grows by `more` from iteration `from` to iteration `to` and stays there.
pub fn turned(angle: f64, more: f64, from: f64, to: f64) -> String {
    if more == 0.0 || from >= to {
        return written(angle);
    }
    format!(
        "{} + {} * clamp((n - {}) / {}, 0.0, 1.0)",
        written(angle),
        written(more),
        written(from),
        written(to - from)
    )
}

#[cfg(test)]
mod tests {
    use super::{alternating, boxed, eased, placed};

    /// The number of an expression in iteration `n`.
    fn at(text: &str, n: f64) -> f64 {
        let engine = rhai::Engine::new();
        let mut scope = rhai::Scope::new();
        scope.push("n", n);
        engine.eval_expression_with_scope::<f64>(&mut scope, text).unwrap()
    }

    #[test]
    fn closed_forms_are_what_repeating_gives() {
        let pairs = [(0.2, 1.6), (-0.3, 0.8), (0.4, -0.5), (-0.2, -0.7), (0.0, 1.0), (0.9, 1.0)];
        for (rate, end) in pairs {
            let (mut added, mut replaced): (f64, f64) = (0.0, 0.0);
            for n in 0..8 {
                assert!((at(&eased(rate, end), f64::from(n)) - added).abs() < 1e-12, "{rate} {end} {n}");
                assert!((at(&alternating(rate, end), f64::from(n)) - replaced).abs() < 1e-12, "{rate} {end} {n}");
                added -= rate * (added.abs() - end);
                replaced = -rate * (replaced.abs() - end);
            }
        }
        for (scale, rate) in [(-1.2, 0.0), (-1.5, -0.2), (2.0, 0.1), (2.0, -0.3), (-1.5, 0.2)] {
            let mut s: f64 = scale;
            for n in 0..8 {
                s = (s.abs() - 1.0) * rate + scale;
                assert!((at(&boxed(scale, rate), f64::from(n)) - s).abs() < 1e-12, "{scale} {rate} {n}");
            }
        }
    }

    #[test]
    fn constants_are_placed_by_words_and_numbers() {
        let ones: rhai::Map =
            [("x", 1.0), ("y", 2.0), ("z", 3.0)].map(|(name, value)| (name.into(), value.into())).into();
        let expected = "add_constant(matrix: [[0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 3.0]])";
        assert_eq!(placed("yxz", ones.clone()), expected);
        assert_eq!(placed("2", ones), expected);
    }
}
