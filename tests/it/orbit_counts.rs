//! Vertices, edges and faces of the polyhedra and polychora, counted from the fold steps' own groups.
//!
//! Where a fold is smooth it is one element of its group: its derivative at a random point is that isometry, and the
//! transposed one puts what lies in the folded wedge to where it is in space. Over many points every image turns up.

use std::collections::HashSet;
use std::sync::Arc;

use bulbfold::check::{Backends, Random, Target};
use bulbfold::expr::{Arena, Differentiator, Function, Port, Type};
use bulbfold::formula::library::Library;
use bulbfold::formula::step::{ParamValue, StepInputs, script_value};
use bulbfold::kernel::Kernel;

/// The group's isometries found at random points, each as its rows.
fn isometries(fold: &str, group: u32, width: u8, points: usize) -> Vec<Vec<Vec<f64>>> {
    let library = Library::builtin();
    let step = library.step(fold).unwrap();
    let arena = Arc::new(Arena::default());
    let ty = Type::F.with_width(width);
    let mut function = Function::new("fold", vec![Port::new("z", ty)]);
    let z = function.input_exprs(&arena)[0];
    let mut params = rhai::Map::new();
    let value = script_value(&arena, &step.params[0].kind, &ParamValue::Number(f64::from(group)));
    params.insert("type".into(), value);
    let inputs = StepInputs { z, c: z.lift(0.0), dr: None, before: None };
    let traced = step.trace(&library.engine, &library.sources, &arena, inputs, &params);
    let folded = traced.unwrap_or_else(|error| panic!("{}", error.message)).z;
    for axis in 0..usize::from(width) {
        let mut unit = [0.0; 4];
        unit[axis] = 1.0;
        let seeds = [(z, arena.constant(ty, unit))];
        function.output(format!("j_{axis}"), Differentiator::new(&arena, &seeds).derivative(folded));
    }
    let mut random = Random::new(7);
    let columns: Vec<Vec<f64>> = (0..width).map(|_| (0..points).map(|_| random.range(-1.0, 1.0)).collect()).collect();
    let out = Backends::cpu_only().run(Target::CPU_F64, &arena, &Kernel::Map(function), &columns).unwrap();
    let n = usize::from(width);
    (0..points).map(|i| (0..n).map(|axis| (0..n).map(|k| out[n * axis + k][i]).collect()).collect()).collect()
}

/// Distinct images of a point.
fn images(group: &[Vec<Vec<f64>>], v: &[f64]) -> usize {
    let image = |columns: &Vec<Vec<f64>>| -> Vec<i64> {
        columns.iter().map(|column| (dot(column, v) * 1e6).round() as i64).collect()
    };
    let all: HashSet<Vec<i64>> = group.iter().map(image).collect();
    all.len()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn unit(v: Vec<f64>) -> Vec<f64> {
    let length = dot(&v, &v).sqrt();
    v.iter().map(|x| x / length).collect()
}

/// The sum of corners by weights, at length 1.
fn mixed(corners: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    let part = |k: usize| corners.iter().zip(weights).map(|(corner, w)| corner[k] * w).sum();
    unit((0..corners[0].len()).map(part).collect())
}

/// Vertices, edges and faces of a polyhedron. Corner and mirrors as in formulas/steps/polyhedron.rhai.
fn counts(group: &[Vec<Vec<f64>>], kind: u32, weights: [f64; 3]) -> [usize; 3] {
    let turn = (std::f64::consts::PI / f64::from(kind)).cos();
    let s = (0.75 - turn * turn).sqrt();
    let mirrors = [vec![1.0, 0.0, 0.0], vec![0.0, 1.0, 0.0], vec![-0.5, -turn, s]];
    let corners = [vec![0.0, 0.0, 1.0], unit(vec![s, 0.0, 0.5]), unit(vec![0.0, s, turn])];
    // Mirrors that meet in each corner, and how often a turn about it repeats.
    let meeting = [([0, 1], 2), ([1, 2], kind), ([2, 0], 3)];
    let vertex = mixed(&corners, &weights);
    let off = |mirror: usize| dot(&vertex, &mirrors[mirror]) > 1e-9;
    let edges = (0..3).filter(|mirror| off(*mirror)).map(|mirror| {
        let height = dot(&vertex, &mirrors[mirror]);
        let middle: Vec<f64> = vertex.iter().zip(&mirrors[mirror]).map(|(v, m)| v - height * m).collect();
        images(group, &middle)
    });
    let faces = meeting.iter().zip(&corners).map(|((pair, order), corner)| {
        let sides = order * pair.iter().filter(|mirror| off(**mirror)).count() as u32;
        if sides >= 3 { images(group, corner) } else { 0 }
    });
    [images(group, &vertex), edges.sum(), faces.sum()]
}

#[test]
fn vertices_edges_and_faces_of_all_polyhedra() {
    let known = [
        (3, [1.0, 0.0, 0.0], [6, 12, 8]),
        (3, [0.0, 1.0, 0.0], [4, 6, 4]),
        (3, [0.0, 0.0, 1.0], [4, 6, 4]),
        (4, [1.0, 0.0, 0.0], [12, 24, 14]),
        (4, [0.0, 1.0, 0.0], [6, 12, 8]),
        (4, [0.0, 0.0, 1.0], [8, 12, 6]),
        (4, [1.0, 1.0, 1.0], [48, 72, 26]),
        (5, [1.0, 0.0, 0.0], [30, 60, 32]),
        (5, [0.0, 1.0, 0.0], [12, 30, 20]),
        (5, [0.0, 0.0, 1.0], [20, 30, 12]),
        (5, [1.0, 1.0, 0.0], [60, 90, 32]),
        (5, [0.0, 1.0, 1.0], [60, 120, 62]),
        (5, [1.0, 1.0, 1.0], [120, 180, 62]),
    ];
    for kind in 3..=5 {
        let group = isometries("polyhedron_fold", kind, 3, 4000);
        for (_, weights, expected) in known.iter().filter(|(k, ..)| *k == kind) {
            assert_eq!(counts(&group, kind, *weights), *expected, "type {kind}, {weights:?}");
        }
        for bits in 1..8 {
            let weights = [0, 1, 2].map(|i| f64::from(bits >> i & 1));
            let [vertices, edges, faces] = counts(&group, kind, weights);
            assert_eq!(vertices + faces, edges + 2, "Euler, type {kind}, {weights:?}");
        }
    }
}

#[test]
fn vertices_of_the_regular_polychora_and_their_rectified_forms() {
    for (kind, expected) in [(3, [10, 5, 10, 5]), (4, [32, 16, 24, 8]), (5, [1200, 600, 720, 120])] {
        let group = isometries("polychoron_fold", kind, 4, if kind == 5 { 40_000 } else { 8_000 });
        let turn = (std::f64::consts::PI / f64::from(kind)).cos();
        let s = (2.0 / 3.0 - turn * turn).sqrt();
        let third = 1.0 / 3f64.sqrt();
        let corners = [
            vec![0.0, 0.0, 0.0, 1.0],
            unit(vec![s, 0.0, 0.0, turn]),
            unit(vec![0.0, 0.75f64.sqrt() * s, 0.5 * s, third]),
            unit(vec![0.0, 0.0, 2.0 * s, third]),
        ];
        let found = [0, 1, 2, 3].map(|i| images(&group, &corners[i]));
        assert_eq!(found, expected, "type {kind}");
    }
}
