//! What a view shows of the numbers that gradients are placed by: the cuts that let the whole of a gradient be seen.
//!
//! In come a graph and its plan by rules; a coarse march in f64 finds some two thousand points of surfaces. The answer is a function of graph and view.

use super::framing::{camera_of, coarse_hits};
use crate::compose::{ComposeResult, Composer, Plan, Purpose, compose_estimator, compose_tones};
use crate::graph::{MOST_LAYERS, Plane, Spread};
use crate::kernel::cpu::Cpu;
use crate::kernel::records::{Answer, Matter};
use crate::kernel::{Backend, Estimator, Kernel};
use crate::math::Precision;
use crate::shade::{Size, threshold};

/// Shares that a gradient is cut into.
const SHARES: usize = 16;
/// Points below which nothing is said.
const FEW: usize = 20;
/// Points across and down a plane.
const GRID: [u32; 2] = [64, 36];

/// Points with the directions that they are seen from, and radii of their pixels.
#[derive(Default)]
struct Points {
    points: Vec<[f64; 3]>,
    directions: Vec<[f64; 3]>,
    footprints: Vec<f64>,
}

/// The cuts of each layer that is used up evenly, in the order of [`Look::paints`](crate::graph::Look::paints); no cuts where too little is seen.
/// Nothing where there is no such layer.
pub fn tones(composer: &Composer, plan: &Plan, size: Size) -> ComposeResult<Vec<Vec<f64>>> {
    let paints: Vec<_> = composer.graph.scene.look.paints().collect();
    let is_even = |spread: &Spread| matches!(spread, Spread::Quantile(_));
    if !paints.iter().any(|paint| paint.shown_layers().iter().any(|layer| is_even(&layer.spread))) {
        return Ok(Vec::new());
    }
    let seen = match &composer.graph.scene.plane {
        Some(plane) => points_of_plane(composer, plan, plane)?,
        None => points_of_view(composer, plan, size)?,
    };
    let columns = numbers(composer, plan, &seen)?;
    let mut all = Vec::new();
    for (number, paint) in paints.iter().enumerate() {
        let own: Vec<usize> =
            (0..seen.points.len()).filter(|i| columns[Matter::COLUMNS.metallic][*i] == number as f64).collect();
        for (i, _) in paint.layers.iter().enumerate().filter(|(_, layer)| is_even(&layer.spread)) {
            let half = MOST_LAYERS / 2;
            let from = if i < half { Matter::COLUMNS.base + i } else { Matter::COLUMNS.emission + i - half };
            all.push(cuts(own.iter().map(|k| columns[from][*k]).collect()));
        }
    }
    Ok(all)
}

/// Numbers that cut a list into equal shares.
fn cuts(mut values: Vec<f64>) -> Vec<f64> {
    values.retain(|value| value.is_finite());
    if values.len() < FEW {
        return Vec::new();
    }
    values.sort_by(f64::total_cmp);
    (0..=SHARES).map(|k| values[k * (values.len() - 1) / SHARES]).collect()
}

/// The columns of [`compose_tones`].
fn numbers(composer: &Composer, plan: &Plan, seen: &Points) -> ComposeResult<Vec<Vec<f64>>> {
    let plan = plan.clone().in_precision(Precision::F64);
    let estimator = compose_tones(composer, &plan.choices)?;
    let mut columns = Estimator::columns(&seen.points, &seen.directions, &[1e-7], 0.0);
    if let Some(last) = columns.last_mut() {
        last.clone_from(&seen.footprints);
    }
    Ok(on_cpu(composer, &Kernel::Estimate(estimator), &columns))
}

fn on_cpu(composer: &Composer, kernel: &Kernel, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let cpu = Cpu::new(Precision::F64);
    let kernel = cpu.prepare(composer.arena, kernel).expect("the CPU takes every kernel");
    let columns = cpu.upload(columns).expect("the CPU holds every column");
    let result = cpu.run(&kernel, &[&columns]).expect("the CPU runs every kernel");
    cpu.download(&result).expect("the CPU holds every column")
}

/// Points a footprint in front of what a camera sees.
fn points_of_view(composer: &Composer, plan: &Plan, size: Size) -> ComposeResult<Points> {
    let camera = camera_of(composer, plan);
    let from = glam::DVec3::from(camera.position);
    let threshold = threshold(&camera, size);
    let mut seen = Points::default();
    for (t, p) in coarse_hits(composer, plan, &camera, size)?.into_iter().flatten() {
        let direction = (p - from).normalize_or_zero();
        let radius = threshold.radius(t);
        seen.points.push((p - direction * radius).to_array());
        seen.directions.push(direction.to_array());
        seen.footprints.push(radius);
    }
    Ok(seen)
}

/// Points of a plane that are not in the set.
fn points_of_plane(composer: &Composer, plan: &Plan, plane: &Plane) -> ComposeResult<Points> {
    let [columns, rows] = GRID;
    let step = plane.height / f64::from(rows);
    let [center, right, up] = [plane.center, plane.right, plane.up].map(glam::DVec3::from);
    let at = |x: u32, y: u32| {
        let across = |i: u32, count: u32| (f64::from(i) + 0.5 - f64::from(count) / 2.0) * step;
        (center + right * across(x, columns) + up * across(y, rows)).to_array()
    };
    let points: Vec<[f64; 3]> =
        (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect();
    let direction = (-right.cross(up)).to_array();
    let inside = compose_estimator(composer, &plan.choices, Purpose::Estimate)?.only(Answer::COLUMNS.inside);
    let columns = Estimator::columns(&points, &[direction], &[1e-7], 0.0);
    let inside = on_cpu(composer, &Kernel::Estimate(inside), &columns);
    let points: Vec<[f64; 3]> = points.into_iter().zip(&inside[0]).filter(|(_, i)| **i < 0.5).map(|(p, _)| p).collect();
    let count = points.len();
    Ok(Points { points, directions: vec![direction; count], footprints: vec![step; count] })
}
