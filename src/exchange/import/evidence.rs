//! Whether a shader's map is one of ours: both run at the same points, and the orbits are compared.
//!
//! The shader is run by a small interpreter (`glsl`), which keeps every vector that a variable held. Our orbit must
//! be among them, point by point and iteration by iteration, in its order; names of variables do not matter. Then the
//! shader's distances are compared with ours far from the set, so that a shader that cuts or joins the set is not taken for it.

use super::glsl::Machine;

/// Iterations that are compared.
const ITERATIONS: u32 = 3;

/// Iterations that must be the same, over all points.
const LEAST_MATCHES: usize = 10;

/// Orbits within this radius have not escaped by any bailout.
const CERTAINLY_ON: f64 = 1.9;

/// Orbits beyond this radius may have ended.
const MAY_HAVE_ENDED: f64 = 3.9;

/// Greatest factor by which a shader's distance may be larger than ours, and smaller: estimates of powers without their
/// logarithm are some twenty times too small far out.
const FACTORS: (f64, f64) = (8.0, 40.0);

/// What our side of the comparison computes of a graph file's text.
#[derive(Clone, PartialEq, Debug)]
pub struct Ours {
    /// For each iteration, from 1, the orbit's place for each of the near points.
    pub orbits: Vec<Vec<[f64; 3]>>,
    /// Distances at the far points; nothing inside.
    pub distances: Vec<Option<f64>>,
}

/// The points that are compared.
#[derive(Clone, PartialEq, Debug)]
pub struct Points {
    /// Starts of orbits.
    pub near: Vec<[f64; 3]>,
    /// Places of distances, around the set.
    pub far: Vec<[f64; 3]>,
    /// Iterations of the orbits.
    pub iterations: u32,
}

/// Computes [`Ours`] of a graph file's text; the error says why it does not load.
pub type Measure<'a> = &'a dyn Fn(&str, &Points) -> Result<Ours, String>;

/// What a shader does at the points.
pub struct Runs {
    near: Vec<Vec<[f64; 3]>>,
    far: Vec<f64>,
}

/// Points in no special place: on no axis, no plane of a fold and no sphere.
pub fn points() -> Points {
    let direction = |i: f64| {
        // Steps of the golden angle.
        let (z, turn) = (1.0 - 2.0 * ((0.6180339887 * i + 0.137) % 1.0), 2.399963 * i + 0.31);
        let rho = (1.0 - z * z).sqrt();
        [rho * turn.cos(), rho * turn.sin(), z]
    };
    let at = |i: usize, radius: f64| direction(i as f64).map(|part| part * radius);
    let near = (0..14).map(|i| at(i, 0.23 + 0.0871 * i as f64)).collect();
    let far = (0..12).map(|i| at(i + 20, 1.53 * 1.234_f64.powi(i as i32))).collect();
    Points { near, far, iterations: ITERATIONS }
}

/// Runs a shader's distance estimate at the points. The error says what of the code is not known.
pub fn run(machine: &mut Machine, points: &Points) -> Result<Runs, String> {
    let mut at = |point: &[f64; 3]| machine.run("DE", *point);
    let near: Result<_, String> = points.near.iter().map(|point| at(point).map(|(_, trace)| trace)).collect();
    let far: Result<_, String> = points.far.iter().map(|point| at(point).map(|(value, _)| value)).collect();
    Ok(Runs { near: near?, far: far? })
}

/// Whether a shader computes what ours does; the error says what is not the same.
pub fn compare(runs: &Runs, ours: &Ours, points: &Points) -> Result<usize, String> {
    let mut matches = 0;
    for (i, trace) in runs.near.iter().enumerate() {
        let mut from = 0;
        let mut size = length(points.near[i]);
        for (iteration, places) in ours.orbits.iter().enumerate() {
            let place = places[i];
            if size > MAY_HAVE_ENDED || !place.iter().all(|part| part.is_finite()) {
                break;
            }
            let slack = 1e-6 * (1.0 + length(place));
            let is_same = |found: &[f64; 3]| (0..3).all(|k| (found[k] - place[k]).abs() <= slack);
            match trace[from..].iter().position(is_same) {
                Some(at) => {
                    from += at + 1;
                    matches += 1;
                }
                None if size <= CERTAINLY_ON => {
                    return Err(format!("iteration {} takes {} elsewhere", iteration + 1, shown(points.near[i])));
                }
                None => break,
            }
            size = length(place);
        }
    }
    if matches < LEAST_MATCHES {
        return Err(format!("only {matches} places of the orbits are the same"));
    }
    let (mut judged, mut apart) = (0, 0);
    for (shader, ours) in runs.far.iter().zip(&ours.distances) {
        let Some(ours) = ours.filter(|ours| ours.is_finite() && *ours > 1e-3) else { continue };
        judged += 1;
        apart += usize::from(!(shader / ours < FACTORS.0 && shader / ours > 1.0 / FACTORS.1));
    }
    match judged > 2 && 4 * apart > judged {
        true => Err(format!("the orbits are the same, but not the distances: {apart} of {judged} are others")),
        false => Ok(matches),
    }
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|part| part * part).sum::<f64>().sqrt()
}

fn shown(p: [f64; 3]) -> String {
    let parts = p.map(|part| format!("{part:.4}"));
    format!("({})", parts.join(", "))
}
