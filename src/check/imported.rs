//! What our formulas do at the points where an imported shader was run, for the comparison of the two.

use super::{Backends, Formula, Target};
use crate::exchange::import::evidence::{Ours, Points};
use crate::graph::Method;

/// Orbits and distances of a graph file's text, to be compared with a shader's: orbits at the near points after 1 to
/// `points.iterations` iterations, distances (world units, none inside) at the far ones.
///
/// Errors: why the text is no formula, or does not compose, in a line.
pub fn measure_for_import(text: &str, points: &Points) -> Result<Ours, String> {
    let formula = Formula::from_ron(text).map_err(|error| error.to_string())?;
    let (subject, backends) = (formula.subject(), Backends::cpu_only());
    let mut orbits = Vec::new();
    for iterations in 1..=points.iterations {
        let kernel = subject.orbit_kernel(iterations).map_err(|_| "the formula does not compose")?;
        let states = subject.orbits(&backends, Target::CPU_F64, &kernel, &points.near).map_err(|e| e.to_string())?;
        orbits.push(states.iter().map(|state| std::array::from_fn(|i| state.get(i).copied().unwrap_or(0.0))).collect());
    }
    let choices = subject.choices(Some(Method::Scalar)).or_else(|| subject.choices(None)).unwrap_or_default();
    let kernel = subject.estimator(&choices).map_err(|_| "the formula does not compose")?;
    let found = subject.estimates(&backends, Target::CPU_F64, &kernel, &points.far).map_err(|e| e.to_string())?;
    let distances = found.into_iter().map(|(distance, inside)| (!inside).then_some(distance)).collect();
    Ok(Ours { orbits, distances })
}
