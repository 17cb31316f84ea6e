//! What pictures keep of their pixels besides colours: the pass that finds it out, and what becomes of its numbers.

use super::pixels::Pixels;
use crate::compose::paint::usable_trap;
use crate::expr::{Arena, Function, Inputs};
use crate::film::{Layer, Layers, Row};
use crate::graph::Look;
use crate::kernel::records::{Colour, Marched};
use crate::march::openness;
use crate::shade::{Seen, albedo, facing_normal, read_surface};

/// Ray, march, surface, colour and (where the scene darkens them) corners to the numbers of data layers, in their order.
pub(super) fn compose_data(arena: &Arena, look: &Look, layers: Layers, has_corners: bool) -> Function {
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let (surface, painted) = read_surface(&mut inputs, look);
    let Colour { colour } = Colour::read(&mut inputs);
    let corner = has_corners.then(|| Marched::read_as("corner_", &mut inputs));
    let mut function = inputs.function("data");
    let (hit, march, ray) = (seen.is_hit(), seen.march, seen.ray);
    let trap = usable_trap(surface.trap);
    for layer in layers.iter() {
        let value = match layer {
            Layer::Srgb | Layer::Radiance => continue,
            Layer::Cutout => colour,
            Layer::Alpha => arena.f(1.0),
            Layer::Depth => march.t,
            Layer::Position => ray.origin + ray.direction * march.t,
            Layer::Normal => facing_normal(surface.gradient, ray.direction),
            Layer::Albedo => albedo(look, &surface, painted),
            Layer::Occlusion => corner.map_or(arena.f(1.0), openness),
            Layer::Trap => trap,
            Layer::Iterations => march.iterations,
            Layer::Steps => march.steps,
            Layer::Confidence => {
                let zero = arena.f(0.0);
                zero.le(march.t_inside).and(zero.le(march.t_outside)).select(arena.f(1.0), zero)
            }
        };
        // Misses took steps, too.
        let is_of_ray = matches!(layer, Layer::Iterations | Layer::Steps);
        let shown = if is_of_ray { value } else { hit.select(value, value.lift(missed(layer))) };
        function.output(layer.name(), shown);
    }
    function
}

/// The numbers of a layer where nothing was hit.
fn missed(layer: Layer) -> f64 {
    match layer {
        Layer::Depth => Layer::NOWHERE,
        Layer::Occlusion => 1.0,
        _ => 0.0,
    }
}

/// The numbers that are kept of each pixel.
#[derive(Clone, Debug)]
pub(super) struct Kept {
    /// The layers.
    pub layers: Layers,
    /// The columns: all of them.
    pub columns: Vec<usize>,
    /// Whether a column is averaged.
    averaged: Vec<bool>,
    /// The numbers of a pixel without anything.
    missed: Vec<f32>,
}

/// Numbers of some pixels, those of a pixel after each other.
pub(super) type Numbers = Vec<(Row, Vec<f32>)>;

impl Kept {
    /// What is kept of these layers; `None` where there are none.
    pub fn new(layers: Layers) -> Option<Kept> {
        let each = |layer: Layer| layer.channels().iter().map(move |_| layer);
        let columns: Vec<Layer> = layers.iter().flat_map(each).collect();
        (!columns.is_empty()).then(|| Kept {
            layers,
            columns: (0..columns.len()).collect(),
            averaged: columns.iter().map(|layer| layer.is_averaged()).collect(),
            missed: columns.iter().map(|layer| missed(*layer) as f32).collect(),
        })
    }

    /// Numbers of a pixel.
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// Takes the numbers of pixels out of columns; without columns nothing was hit there.
    pub fn gather<N: Copy + Into<f64>>(&self, pixels: &Pixels, columns: Option<&[&[N]]>, numbers: &mut Numbers) {
        let mut first = 0;
        for &row in &pixels.rows {
            let places = first..first + row.len as usize;
            first = places.end;
            let numbers_of = |i: usize| match columns {
                Some(columns) => columns.iter().map(|column| column[i].into() as f32).collect(),
                None => self.missed.clone(),
            };
            numbers.push((row, places.flat_map(numbers_of).collect()));
        }
    }

    /// The numbers of a pixel from those of its first sample and the columns of the `count` others, which begin at `at`.
    pub fn joined<N: Copy + Into<f64>>(
        &self,
        first: &[f32],
        columns: Option<&[&[N]]>,
        (at, count): (usize, usize),
    ) -> impl Iterator<Item = f32> {
        first.iter().enumerate().map(move |(k, &first)| {
            if !self.averaged[k] {
                return first;
            }
            let others: f64 = match columns {
                Some(columns) => columns[k][at..at + count].iter().map(|&x| x.into()).sum(),
                None => f64::from(self.missed[k]) * count as f64,
            };
            ((f64::from(first) + others) / (count + 1) as f64) as f32
        })
    }
}
