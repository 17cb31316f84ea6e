//! Joins the stages: kernels for a fractal and a view, run tile by tile on a back end, into a picture and its statistics.
//!
//! A picture is made in bands of rows, so that memory does not grow with its height, and a band in tiles, which run at the same
//! time where the back end can. A first pass takes one ray through the centre of every pixel; where neighbours differ, a
//! second one takes all samples (see [`Sampling`]). Every ray is marched alone, so how a picture is cut never shows in it.

mod beams;
mod checked;
mod clearance;
mod data;
mod developed;
mod framing;
mod further;
mod meter;
mod mirrored;
pub mod passes;
mod picture;
mod pipeline;
mod pixels;
mod plane;
mod refine;
mod renderer;
mod scout;
mod stats;
mod tones;
mod traced;

pub use beams::BeamTiles;
pub use checked::beams_hold;
pub use clearance::Clearance;
pub use developed::Developed;
pub use framing::{Iterations, Standpoint, automatic_camera, camera_of, standpoint, surface_at};
pub use passes::{Ends, Marches, Role};
pub use pipeline::{Pipeline, Shape, compose_pipeline, compose_planned};
pub use renderer::{Cut, Renderer};
pub use scout::{FoundView, Search, find_views};
pub use stats::Stats;
pub use tones::tones;

use serde::{Deserialize, Serialize};

use crate::film::Layers;
use crate::graph::EstimateSettings;
use crate::math::Precision;
use crate::shade::Size;

/// Which pixels get all their samples.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Sampling {
    /// Those whose centre differs from their neighbours'; the others are seen through their centre alone.
    #[default]
    Adaptive,
    /// All of them.
    Full,
}

/// Whether a picture has beams.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum BeamUse {
    /// None.
    Off,
    /// Where rays of the picture come to the same with and without them (see [`beams_hold`]).
    #[default]
    Tried,
    /// Wherever estimates hold all around their point, right or wrong.
    Untried,
}

/// How paths of light are traced.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(default)]
pub struct PathTracing {
    /// Paths through each pixel at most, from 1 to 65536.
    pub samples: u32,
    /// Surfaces that a path meets at most.
    pub bounces: u32,
    /// Standard deviation of a tile's pixels, as a share of their brightness, at which it is done; 0 takes all samples.
    pub noise: f64,
    /// Chooses the random numbers.
    pub seed: u32,
}

impl Default for PathTracing {
    fn default() -> PathTracing {
        PathTracing { samples: 64, bounces: 6, noise: 0.0, seed: 0 }
    }
}

/// What a picture needs besides its fractal.
#[derive(Clone, PartialEq, Debug)]
pub struct RenderSettings {
    /// Columns and rows.
    pub size: Size,
    /// What is asked of the estimate; the rest is chosen.
    pub estimate: EstimateSettings,
    /// Samples along each edge of a pixel that gets all of them.
    pub samples: u32,
    /// Which pixels do.
    pub sampling: Sampling,
    /// Hit threshold in pixel radii.
    pub detail: f64,
    /// The precision of the back end that it is rendered on.
    pub precision: Precision,
    /// Every ray is marched from the bounding sphere by steps no longer than an estimate, every orbit iterated until it escapes
    /// or `max_iterations` are done, shadow rays as sharply as primary ones: what everything else is compared with.
    pub plain: bool,
    /// A box around the set is looked for, which takes some milliseconds, and rays are cut to it (see [`Bounds`](crate::compose::Bounds));
    /// not where the picture is small or `plain`.
    pub boxed: bool,
    /// Whether beams find out for many pixels at once how far nothing is; not where `plain`.
    pub beams: BeamUse,
    /// What the picture can tell of its pixels besides their colours: layers of kernels of their own.
    pub layers: Layers,
    /// Orbits end at the footprint, where that can be trusted; not where `plain`.
    pub early_ends: bool,
    /// Whether light is followed along paths, and how; otherwise it comes straight from lights and surroundings.
    pub path: Option<PathTracing>,
    /// Mirrored rays that follow each other at most where light is not followed along paths; 0 shows the surroundings alone in mirrors.
    pub mirrors: u32,
}

/// Mirrored rays that follow each other at most where nothing is said of them.
pub const MIRRORS: u32 = 3;

impl Default for RenderSettings {
    fn default() -> Self {
        RenderSettings {
            size: Size { width: 1280, height: 720 },
            estimate: EstimateSettings::default(),
            samples: 1,
            sampling: Sampling::default(),
            detail: 1.0,
            precision: Precision::F32,
            plain: false,
            boxed: false,
            beams: BeamUse::default(),
            layers: Layers::NONE,
            early_ends: true,
            path: None,
            mirrors: MIRRORS,
        }
    }
}
