//! `AgreesOnBackends`: the pixels of a small picture on which a back end and the reference see another depth.

use super::backends::{Backends, Target};
use super::subject::Subject;
use super::truth::{Scale, Truth, Truths};
use crate::render::{RenderSettings, compose_pipeline};
use crate::shade::{Size, rays};

/// The picture on which back ends are compared.
const SIZE: Size = Size { width: 64, height: 48 };
/// Pixels that differ whose truth is asked at most: more are no matter of single grazing rays.
const ASKED: usize = 64;
/// Pixels that a message names.
const NAMED: usize = 4;

/// A pixel on which two back ends differ: place, the reference's depth, the other's.
type Difference = ((u32, u32), Option<f64>, Option<f64>);

/// How far a back end agrees with the reference.
#[derive(Clone, Debug)]
pub struct Agreement {
    /// Pixels that count: all but those whose ray has no truth that a march could be held to.
    pub counted: usize,
    /// Those that differ among them.
    pub different: Vec<Difference>,
    /// Pixels that differ and were left out.
    pub ambiguous: usize,
}

impl Agreement {
    /// The share of the pixels that agree.
    pub fn share(&self) -> f64 {
        1.0 - self.different.len() as f64 / self.counted.max(1) as f64
    }

    /// The pixels that differ, the first of them with their depths.
    pub fn text(&self) -> String {
        let depth = |depth: Option<f64>| depth.map_or("no hit".to_string(), |t| format!("{t:.6}"));
        let shown = self.different.iter().take(NAMED).map(|((x, y), reference, found)| {
            format!("pixel ({x}, {y}): {} by the reference, {} here", depth(*reference), depth(*found))
        });
        let mut text = shown.collect::<Vec<_>>().join("; ");
        let more = self.different.len().saturating_sub(NAMED);
        if more > 0 {
            text += &format!("; and {more} more");
        }
        if self.ambiguous > 0 {
            text += &format!("; {} ambiguous ones are left out", self.ambiguous);
        }
        text
    }
}

/// Compares a back end with f64 on the CPU: both miss, or both hit within half a pixel.
pub fn agreement(subject: &Subject, backends: &Backends, target: Target) -> Result<Agreement, String> {
    let composer = subject.composer();
    let settings = RenderSettings { size: SIZE, ..RenderSettings::default() };
    let failed = |error: crate::diag::Diagnostic| error.rendered(&subject.library.sources);
    let pipeline = compose_pipeline(&composer, &settings).map_err(failed)?;
    let depths = |target| backends.depths(target, subject.arena, &pipeline, &settings).map_err(|e| e.to_string());
    let (reference, found) = (depths(Target::CPU_F64)?, depths(target)?);
    let agrees = |a: Option<f64>, b: Option<f64>| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= pipeline.pixel.radius(a),
        (None, None) => true,
        _ => false,
    };
    let place = |i: usize| (i as u32 % SIZE.width, i as u32 / SIZE.width);
    let pairs = reference.iter().zip(&found).enumerate();
    let mut different: Vec<Difference> =
        pairs.filter(|(_, (a, b))| !agrees(**a, **b)).map(|(i, (a, b))| (place(i), *a, *b)).collect();
    let mut ambiguous = 0;
    if !different.is_empty() && different.len() <= ASKED {
        let place = |(x, y): (u32, u32)| [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let places: Vec<[f64; 2]> = different.iter().map(|(pixel, ..)| place(*pixel)).collect();
        let rays = rays(&pipeline.camera, SIZE, &places);
        let scale = Scale::of_view(&pipeline.camera, SIZE, subject.plan.bounding_radius);
        let truths = Truths::find(&composer, &pipeline.plan.choices, &rays, scale, &mut |_| true).map_err(failed)?;
        let mut known = truths.depths.iter().map(|truth| *truth != Truth::Ambiguous);
        let before = different.len();
        different.retain(|_| known.next().unwrap_or(true));
        ambiguous = before - different.len();
    }
    Ok(Agreement { counted: reference.len() - ambiguous, different, ambiguous })
}
