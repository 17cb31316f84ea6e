//! Tests of material files: worked examples on every back end, and what comes out at random places.

use std::sync::Arc;

use super::backends::{Backends, Target};
use crate::expr::{Arena, Function, Port};
use crate::formula::library::Library;
use crate::formula::material::{INPUTS, Material, MaterialExample, OUTPUTS};
use crate::formula::step::ParamValue;
use crate::kernel::Kernel;
use crate::math::random::Random;

/// Random places.
const PLACES: usize = 200;
/// Share of the places at which a back end may differ from f64: where a material has an edge, rounding decides.
const ON_EDGES: f64 = 0.02;
/// How far it may at the others.
const SLACK: f64 = 2e-3;

/// A material and where it is traced.
pub(super) struct MaterialCase<'a> {
    pub(super) library: &'a Library,
    pub(super) material: &'a Material,
    pub(super) backends: &'a Backends,
}

impl MaterialCase<'_> {
    /// The outputs of the material as columns, those that it leaves out with their defaults.
    fn run(
        &self,
        target: Target,
        params: &[(String, ParamValue)],
        columns: &[Vec<f64>],
    ) -> Result<Vec<Vec<f64>>, String> {
        let arena = Arc::new(Arena::default());
        let ports = INPUTS.iter().map(|(name, ty, _)| Port::new(*name, *ty)).collect();
        let mut function = Function::new("material", ports);
        let inputs = function.input_exprs(&arena);
        let Library { engine, sources, .. } = self.library;
        let params = self.material.script_params(&arena, params);
        let outputs = self.material.trace((engine, sources), &arena, &inputs, &params);
        let outputs = outputs.map_err(|error| error.rendered(sources))?;
        for (value, (name, ty, default, ..)) in outputs.into_iter().zip(OUTPUTS) {
            function.output(*name, value.unwrap_or_else(|| arena.f(*default).widen(ty.width)));
        }
        self.backends.run(target, &arena, &Kernel::Map(function), columns).map_err(|error| error.to_string())
    }

    /// One worked example on one back end.
    pub(super) fn example(&self, example: &MaterialExample, target: Target) -> Result<(), String> {
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for (i, (_, ty, _)) in INPUTS.iter().enumerate() {
            let given = example.at.iter().find(|(number, _)| *number == i);
            let numbers = given.map_or_else(|| vec![0.0; usize::from(ty.width)], |(_, numbers)| numbers.clone());
            columns.extend(numbers.into_iter().map(|x| vec![x]));
        }
        let found = self.run(target, &example.params, &columns)?;
        for (i, expected) in &example.expect {
            let from: usize = OUTPUTS[..*i].iter().map(|output| usize::from(output.1.width)).sum();
            let found: Vec<f64> = found[from..from + expected.len()].iter().map(|column| column[0]).collect();
            let tolerance = example.tolerance + target.step_slack();
            let near = |(e, f): (&f64, &f64)| (e - f).abs() <= tolerance * e.abs().max(1.0); // false for NaN
            if !expected.iter().zip(&found).all(near) {
                let name = OUTPUTS[*i].0;
                return Err(format!("{name}: expected {expected:?}, found {found:?} (tolerance {tolerance:.1e})"));
            }
        }
        Ok(())
    }

    /// At random places everything is a number, and every back end finds the same.
    pub(super) fn places(&self, target: Target) -> Result<(), String> {
        let columns = random_places();
        let exact = self.run(Target::CPU_F64, &[], &columns)?;
        if let Some(i) = exact.iter().position(|column| column.iter().any(|x| !x.is_finite())) {
            return Err(format!("column {i} of what it returns is not a number at some places"));
        }
        let found = self.run(target, &[], &columns)?;
        let differs = |k: usize| {
            let far =
                |(a, b): (&Vec<f64>, &Vec<f64>)| (a[k] - b[k]).abs() > SLACK * b[k].abs().max(1.0) || !a[k].is_finite();
            found.iter().zip(&exact).any(far)
        };
        let count = (0..PLACES).filter(|k| differs(*k)).count();
        match count as f64 <= ON_EDGES * PLACES as f64 {
            true => Ok(()),
            false => Err(format!("at {count} of {PLACES} random places it differs from f64 by more than {SLACK}")),
        }
    }
}

/// Places as orbits have them: unit vectors, traps above 0, counts.
fn random_places() -> Vec<Vec<f64>> {
    let mut random = Random::new(11);
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for (name, ty, _) in INPUTS {
        let places: Vec<[f64; 4]> = (0..PLACES)
            .map(|_| match *name {
                "normal" | "view" => {
                    let [x, y, z] = random.direction();
                    [x, y, z, 0.0]
                }
                "position" => [(); 4].map(|()| random.range(-2.0, 2.0)),
                "traps" => [(); 4].map(|()| random.range(0.0, 3.0)),
                "caught" | "iterations" => [(); 4].map(|()| random.range(1.0, 20.0).floor()),
                "smooth" => [random.range(1.0, 20.0); 4],
                "radius" => [random.range(1.0, 100.0); 4],
                "footprint" => [1e-3; 4],
                "part" => [0.0; 4],
                _ => [(); 4].map(|()| random.unit()),
            })
            .collect();
        columns.extend((0..usize::from(ty.width)).map(|k| places.iter().map(|place| place[k]).collect()));
    }
    columns
}
