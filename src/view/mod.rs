//! Pictures of what a march did, and of how right it was: one colour a pixel, with a legend.
//!
//! In come a [`Pipeline`](crate::render::Pipeline) and a [`View`]; [`ViewKernels`] march the centre of every pixel on any
//! back end, [`find_truths`] walks the same rays by brute force where errors are wanted, and [`Shown`] holds a value or a
//! class for each pixel, with the numbers that sum them up. [`Shown::image`] colours them and draws the legend below.
//!
//! Lengths are in footprints: a footprint is a pixel's diameter at the depth of the hit.

mod colour;
mod legend;
mod marched;
mod shown;

pub use colour::{Axis, diverging, viridis};
pub use marched::{PixelMarches, ViewKernels, find_truths};
pub use shown::{Class, Pixel, Shown, show};

/// What a picture shows instead of light and colour.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum View {
    /// Depth error against the truth, which is found by brute force.
    Error,
    /// How far behind the surface the step landed that crossed it.
    Overshoot,
    /// Iterations of all estimates of the pixel's ray.
    Iterations,
    /// Estimates of the pixel's ray.
    Steps,
    /// Which orbit or primitive, and which method and form, the estimate at the hit came from.
    Method,
    /// How sure the march is of its answer.
    Confidence,
}

impl View {
    /// All views, in the order of listings.
    pub const ALL: [View; 6] =
        [View::Error, View::Overshoot, View::Iterations, View::Steps, View::Method, View::Confidence];

    /// The name in flags.
    pub const fn name(self) -> &'static str {
        match self {
            View::Error => "error",
            View::Overshoot => "overshoot",
            View::Iterations => "iterations",
            View::Steps => "steps",
            View::Method => "method",
            View::Confidence => "confidence",
        }
    }

    /// What it shows, in a few words.
    pub const fn summary(self) -> &'static str {
        match self {
            View::Error => "depth error against brute force, which is slow: 640x360 unless --size says more",
            View::Overshoot => "how far behind the surface the step that crossed it landed",
            View::Iterations => "iterations of all estimates of a pixel's ray",
            View::Steps => "estimates of a pixel's ray",
            View::Method => "which orbit, method and form the estimate at the hit came from",
            View::Confidence => "what the march itself knows about its answer",
        }
    }
}
