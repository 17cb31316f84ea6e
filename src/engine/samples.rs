//! Parts of the samples of a picture of paths: sums that another machine adds up to the picture.

use std::ops::Range;

use super::running::{self, Piece};
use super::{Done, Engine, Error, Job, Observer, Sink, anaglyph};
use crate::film::{LightSum, Rows};
use crate::render::{Developed, Role};

impl Engine {
    /// Renders some of the samples of rows of a picture of paths; the rows have their [`Rows::sums`]. [`JoinedSamples`] makes the
    /// picture of all of them.
    ///
    /// Errors: those of [`Engine::render`], and [`Error::Request`] where the job has no such samples.
    pub fn render_samples(
        &self,
        job: &Job,
        (rows, samples): (Range<u32>, Range<u32>),
        sink: &mut dyn Sink,
        observer: &mut dyn Observer,
    ) -> Result<Done, Error> {
        let count = sample_count(job)?;
        if samples.is_empty() || samples.end > count {
            let text = format!("the samples {}..{} are not in a picture of {count}", samples.start, samples.end);
            return Err(Error::request(text, format!("samples go from 0 to {count}")));
        }
        running::render(self.backends(), job, Piece { rows, samples: Some(samples) }, sink, observer)
    }
}

/// The samples of each pixel of a picture whose samples can be taken apart.
///
/// Errors: [`Error::Request`] for all other pictures.
fn sample_count(job: &Job) -> Result<u32, Error> {
    let cannot = |why: &str, help: &str| Err(Error::request(format!("samples cannot be taken apart: {why}"), help));
    match job.request.path {
        None => cannot("the picture is not one of paths of light", "give --integrator path, or cut it by rows"),
        Some(path) if path.noise > 0.0 => {
            cannot("noise says how many there are", "give --paths alone, without --noise")
        }
        Some(_) if anaglyph::eyes(job).is_some() => cannot("the picture is for red and cyan glasses", "cut it by rows"),
        Some(path) => Ok(path.samples.max(1)),
    }
}

/// Makes rows of the sums of all of a picture's samples: the same bytes as those of a render that takes them all.
pub struct JoinedSamples {
    developed: Developed,
    count: u32,
}

impl JoinedSamples {
    /// Makes ready what a job needs.
    ///
    /// Errors: [`Error::Request`] for pictures whose samples cannot be taken apart, [`Error::Formula`], [`Error::Backend`].
    pub fn new(job: &Job) -> Result<JoinedSamples, Error> {
        let count = sample_count(job)?;
        let composed = job.composed()?;
        let kernel = composed.pipeline.kernel(Role::Encode);
        let developed = Developed::new(&composed.arena, kernel, job.precision)?;
        Ok(JoinedSamples { developed, count })
    }

    /// Samples of each pixel.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The rows of sums over all samples, with bytes and radiance.
    ///
    /// Errors: [`Error::Backend`].
    pub fn rows(&self, sums: &[LightSum]) -> Result<Rows, Error> {
        let light: Vec<[f32; 3]> = sums.iter().map(|sum| sum.mean(self.count)).collect();
        let srgb = self.developed.bytes(&light)?;
        Ok(Rows { srgb, radiance: light.into_flattened(), ..Rows::default() })
    }
}
