//! What is wanted of a picture: plain data.

use serde::{Deserialize, Serialize};

use super::{CameraChange, Error};
use crate::check::truth::Budget;
use crate::film::Layers;
use crate::graph::EstimateSettings;
use crate::math::Precision;
use crate::render::{MIRRORS, PathTracing, RenderSettings, Sampling};
use crate::shade::Size;

/// Most columns and rows of a picture.
pub const MOST_EDGE: u32 = 16384;
/// Most samples along each edge of a pixel.
pub const MOST_SAMPLES: u32 = 16;

/// Where kernels run.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum BackendChoice {
    /// A hardware GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// The embedded CPU back end.
    Cpu,
    /// Any GPU adapter, also one in software.
    Gpu,
}

/// What is wanted of a picture; the rest is chosen.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(default)]
pub struct Request {
    /// Columns and rows.
    pub size: Size,
    /// Samples along each edge of a pixel that gets all of them, from 1 to 16.
    pub samples: u32,
    /// Which pixels do.
    pub sampling: Sampling,
    /// What replaces parts of the fractal's camera.
    pub camera: CameraChange,
    /// Where it is computed.
    pub backend: BackendChoice,
    /// Precision; `None` takes single precision where the view's pixels are coarse enough for it, else double.
    pub precision: Option<Precision>,
    /// What is fixed of the distance estimate.
    pub estimate: EstimateSettings,
    /// Whether the rest of it is measured on the view, or chosen by rules.
    pub calibrate: bool,
    /// Errors that are allowed.
    pub budget: Budget,
    /// How much a calibration may compute, as a multiple of what is usual.
    pub effort: f64,
    /// Whether light is followed along paths, and how; otherwise it comes straight from lights and surroundings.
    pub path: Option<PathTracing>,
    /// Whether the noise of paths is filtered, by what their first surfaces are.
    pub denoise: bool,
    /// Mirrored rays that follow each other at most, from 0 to 16; paths of light have their own.
    pub mirrors: u32,
    /// What the picture is to tell of its pixels besides their colours.
    pub layers: Layers,
    /// Every ray is marched by itself, by steps no longer than an estimate, and every orbit runs to its end: what the
    /// short cuts are compared with.
    pub exact_rays: bool,
}

impl Default for Request {
    /// What `bulbfold render` makes without options.
    fn default() -> Request {
        Request {
            size: Size { width: 1280, height: 720 },
            samples: 2,
            sampling: Sampling::default(),
            camera: CameraChange::default(),
            backend: BackendChoice::default(),
            precision: None,
            estimate: EstimateSettings::default(),
            calibrate: true,
            budget: Budget::default(),
            effort: 1.0,
            path: None,
            denoise: false,
            mirrors: MIRRORS,
            layers: Layers::NONE,
            exact_rays: false,
        }
    }
}

impl Request {
    /// The precision that a picture begins with.
    ///
    /// Errors: [`Error::Request`] where a GPU is asked for double precision.
    pub fn first_precision(&self) -> Result<Precision, Error> {
        self.precision_or(Precision::F32)
    }

    /// The precision that is asked for, else this one where the back end has it.
    ///
    /// Errors: [`Error::Request`] where a GPU is asked for double precision.
    pub fn precision_or(&self, default: Precision) -> Result<Precision, Error> {
        match (self.backend, self.precision) {
            (BackendChoice::Gpu, Some(Precision::F64)) => {
                let help = "drop one of them: `--precision f64` runs on the CPU";
                Err(Error::request(
                    "GPUs compute in f32: `--backend gpu` and `--precision f64` exclude each other",
                    help,
                ))
            }
            (BackendChoice::Gpu, None) => Ok(Precision::F32),
            (_, given) => Ok(given.unwrap_or(default)),
        }
    }

    /// The settings of a render in a precision.
    pub fn settings(&self, precision: Precision) -> RenderSettings {
        RenderSettings {
            size: self.size,
            samples: self.samples,
            sampling: self.sampling,
            precision,
            estimate: self.estimate,
            plain: self.exact_rays,
            path: self.path,
            mirrors: self.mirrors,
            layers: self.layers.data(),
            ..RenderSettings::default()
        }
    }
}
