//! Rows of Mandelbulber's table against arithmetic that is written from the program's own formulas: one iteration at a point.

use super::imported;
use super::mandelbulber::settings;

type Point = [f64; 3];

/// The latitude and the azimuth times the power.
fn bulb([x, y, z]: Point, power: f64) -> Point {
    let r = (x * x + y * y + z * z).sqrt();
    let (latitude, azimuth) = (power * (z / r).asin(), power * y.atan2(x));
    [latitude.cos() * azimuth.cos(), latitude.cos() * azimuth.sin(), latitude.sin()].map(|part| part * r.powf(power))
}

/// Squares in a closed form, z downwards.
fn square([x, y, z]: Point) -> Point {
    let rho_sq = x * x + y * y;
    let shrink = 1.0 - z * z / rho_sq;
    [(x * x - y * y) * shrink, 2.0 * x * y * shrink, -2.0 * z * rho_sq.sqrt()]
}

fn folded(p: Point, limit: f64) -> Point {
    p.map(|x| {
        if x > limit {
            2.0 * limit - x
        } else if x < -limit {
            -2.0 * limit - x
        } else {
            x
        }
    })
}

fn shrunk(p: Point, least: f64, fixed: f64) -> Point {
    let r_sq: f64 = p.iter().map(|x| x * x).sum();
    let factor = if r_sq < least * least {
        (fixed / least).powi(2)
    } else if r_sq < fixed * fixed {
        fixed * fixed / r_sq
    } else {
        1.0
    };
    p.map(|x| x * factor)
}

fn sorted(p: Point) -> Point {
    let mut parts = p.map(f64::abs);
    parts.sort_by(|a, b| b.total_cmp(a));
    parts
}

fn times(p: Point, factor: f64) -> Point {
    p.map(|x| x * factor)
}

fn plus(p: Point, q: Point) -> Point {
    std::array::from_fn(|i| p[i] + q[i])
}

/// What a row is compared with.
type Map = fn(Point) -> Point;

/// Settings of the main section and of the formula, the map with the constant, and whether the sign of z is another one there,
/// which the next iteration undoes.
const ROWS: &[(&str, &str, Map, bool)] = &[
    ("formula_1 2;", "", |p| plus(bulb(p, 9.0), p), false),
    ("formula_1 2;", "power 5.5;", |p| plus(bulb(p, 5.5), p), false),
    ("formula_1 3;", "", |p| plus(square(p), p), false),
    ("formula_1 41;", "", |p| plus(square(p), p), false),
    ("formula_1 41;", "buffalo_pos_z true;", |p| plus(square(p), p).upwards(p), false),
    ("formula_1 5;", "", |p| plus(quaternion(p), p), false),
    ("formula_1 62;", "", |p| plus(quaternion(p), p), false),
    (
        "formula_1 21;",
        "",
        |[x, y, z]| plus([x * x - y * y - z * z, y * (2.0 * x - z), z * (2.0 * x + y)], [x, y, z]),
        false,
    ),
    ("formula_1 8;", "", |p| plus(times(shrunk(folded(p, 1.0), 0.5, 1.0), 2.0), p), false),
    (
        "formula_1 8;\njulia_mode true;\njulia_c 0.1 0.2 -0.3;",
        "mandelbox_scale -1.7;\nmandelbox_folding_min_radius 0.7;\nmandelbox_folding_fixed_radius 1.2;",
        |p| plus(times(shrunk(folded(p, 1.0), 0.7, 1.2), -1.7), [0.1, 0.2, -0.3]),
        false,
    ),
    ("formula_1 7;", "", menger, true),
    ("formula_1 1001;", "transf_addition_constant 0.5 -1 2;", |p| plus(p, [0.5, -1.0, 2.0]), false),
    ("formula_1 1003;", "transf_scale -1.25;", |p| times(p, -1.25), false),
    ("formula_1 1004;", "transf_scale3D_111 2 -1 0.5;", |[x, y, z]| [2.0 * x, -y, 0.5 * z], false),
    ("formula_1 1007;", "", |p| plus(p, p), false),
    ("formula_1 1020;", "mandelbox_folding_limit 0.6;\nmandelbox_folding_value 1.2;", |p| folded(p, 0.6), false),
    ("formula_1 1021;", "", |p| shrunk(p, 0.5, 1.0), false),
    (
        "formula_1 1023;",
        "transf_addition_constant -0.1 0.2 0.3;\ntransf_function_enabledy false;",
        |[x, y, z]| [(x - 0.1).abs(), y + 0.2, (z + 0.3).abs()],
        false,
    ),
];

/// The square with z upwards, where only z differs.
trait Upwards {
    fn upwards(self, p: Point) -> Point;
}

impl Upwards for Point {
    fn upwards(self, p: Point) -> Point {
        [self[0], self[1], 2.0 * p[2] - self[2]]
    }
}

fn quaternion([x, y, z]: Point) -> Point {
    [x * x - y * y - z * z, 2.0 * x * y, 2.0 * x * z]
}

fn menger(p: Point) -> Point {
    let [x, y, z] = times(sorted(p), 3.0);
    [x - 2.0, y - 2.0, if z > 1.0 { z - 2.0 } else { z }]
}

#[test]
fn rows_compute_the_programs_own_numbers() {
    let points: [Point; 4] = [[0.31, -0.42, 0.53], [-1.3, 0.2, 0.7], [0.05, 0.11, -0.12], [0.9, 0.8, -1.6]];
    for (main, slot, map, has_other_sign) in ROWS {
        let formula = imported("row.fract", &settings(main, &[slot]), &[]);
        for p in points {
            for (k, (found, expected)) in formula.orbit(p, 1).into_iter().zip(map(p)).enumerate() {
                let is_turned = k == 2 && *has_other_sign;
                let (found, expected) = if is_turned { (found.abs(), expected.abs()) } else { (found, expected) };
                assert!(
                    (found - expected).abs() < 1e-9 * (1.0 + expected.abs()),
                    "{main} {slot} {p:?} {k}: {found}, not {expected}"
                );
            }
        }
    }
}
