//! Mandelbulb3D's own formulas as steps.
//!
//! Numbers, order of the options and maps are those of the program's published source (formulas.pas): the sine bulb measures
//! the latitude from the plane and has a factor for z; the box is the Mandelbox with a fixed radius of 1.

use super::super::value::written;
use super::code::{FORMULA, HEADER, Record};

/// A formula of the hybrid.
#[derive(Clone, PartialEq, Debug)]
pub struct Formula {
    /// Its place, from 1.
    pub place: usize,
    /// What the program calls it.
    pub name: String,
    /// Iterations at a time; negative ones do not count.
    pub iterations: i32,
    /// The values of its options, as many as it says.
    pub options: Vec<f64>,
    number: i32,
}

/// Names of the program's own formulas by number.
const OWN: &[(i32, &str)] = &[
    (0, "Integer Power"),
    (1, "Real Power"),
    (2, "Quaternion"),
    (3, "Tricorn"),
    (4, "Amazing Box"),
    (5, "Bulbox"),
    (6, "Folding Int Pow"),
    (9, "Aexion C"),
];

/// Those that have counterparts.
pub const KNOWN: &str = "Integer Power, Real Power, Tricorn, Amazing Box, Folding Int Pow";

impl Formula {
    /// The formula at a place of the hybrid; nothing if none runs there.
    pub fn read(record: &Record, index: usize) -> Option<Formula> {
        let at = HEADER + 8 + index * FORMULA;
        let (iterations, number) = (record.whole(at), record.whole(at + 4));
        if iterations == 0 {
            return None;
        }
        let count = record.whole(at + 8).clamp(0, 16) as usize;
        let options = (0..count).map(|i| record.number(at + 60 + 8 * i)).collect();
        let own = OWN.iter().find(|(own, _)| *own == number).map(|(_, name)| (*name).to_string());
        let name = own.unwrap_or_else(|| record.text(at + 12, 32));
        Some(Formula { place: index + 1, name, iterations, options, number })
    }

    /// Steps of an iteration before the constant is added, the escape radius that the program starts with, and what is not the
    /// same; nothing if there is no counterpart.
    pub fn steps(&self) -> Option<(Vec<String>, Option<String>)> {
        let option = |i: usize, default: f64| self.options.get(i).copied().filter(|v| v.is_finite()).unwrap_or(default);
        let bulb = |power: f64| {
            let mut steps = vec![format!("bulb_power(power: {}, convention: asin)", written(power))];
            steps.extend(z_factor(option(1, -1.0)));
            steps
        };
        Some(match self.number {
            0 => (bulb(option(0, 8.0).round().clamp(2.0, 8.0)), None),
            1 => (bulb(option(0, 8.0)), None),
            3 => {
                let factor = option(1, 1.0);
                let mut steps = vec!["quaternion_square()".to_string()];
                steps.extend(z_factor(0.5 * option(0, -2.0)));
                (
                    steps,
                    (factor != 1.0).then(|| format!("the constant's z has the factor {factor} there, and none here")),
                )
            }
            4 => {
                let (scale, least, fold) = (option(0, 2.0), option(1, 0.5), option(2, 1.0));
                let ball =
                    format!("sphere_fold(min_radius: {}, fixed_radius: 1.0)", written(least.abs().clamp(1e-6, 1.0)));
                let box_fold = format!("box_fold(limit: {})", written(fold));
                (vec![box_fold, ball, format!("scale(scale: {})", written(scale))], None)
            }
            6 => {
                let mut steps = vec![format!("box_fold(limit: {})", written(option(2, 2.0)))];
                steps.extend(bulb(option(0, 2.0).round().clamp(2.0, 8.0)));
                (steps, None)
            }
            _ => return None,
        })
    }

    /// Name, iterations and options, as messages show them.
    pub fn shown(&self) -> String {
        let options: Vec<String> = self.options.iter().map(|value| format!("{value:?}")).collect();
        format!("{}. {} x {} ({})", self.place, self.name, self.iterations, options.join(", "))
    }
}

fn z_factor(factor: f64) -> Option<String> {
    let row = format!("[0.0, 0.0, {}]", written(factor));
    (factor != 1.0).then(|| format!("linear(matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], {row}])"))
}
