//! Pictures of paths of light whose noise is filtered.

use std::io;
use std::ops::Range;

use super::running::{Part, Piece};
use super::{Backends, Done, Error, Job, Observer, Request, Sink, running};
use crate::film::{GUIDES, Layers, Radiance, Rows, denoise};
use crate::graph::Lens;
use crate::render::{Developed, Role};

/// Share of the progress that the paths take.
const OF_PATHS: f64 = 0.9;
/// Rows that are handed on together where the sink wants no fewer.
const BAND: u32 = 256;

/// Whether a job's noise is filtered.
pub(super) fn is_asked(job: &Job) -> bool {
    job.request.denoise && job.request.path.is_some()
}

/// Renders all paths of a picture and what their first surfaces are, filters the light, and hands on the rows that are wanted. Memory holds
/// the whole picture.
pub(super) fn render(
    backends: &Backends,
    job: &Job,
    rows: Range<u32>,
    sink: &mut dyn Sink,
    observer: &mut dyn Observer,
) -> Result<Done, Error> {
    let size = job.size();
    let whole = || Piece { rows: job.rows(), samples: None };
    let mut light = Radiance::new(size);
    let noisy = job.with_request(job.formula.clone(), Request { denoise: false, ..job.request.clone() });
    let mut part = Part { observer, from: 0.0, share: OF_PATHS };
    let done = running::render(backends, &noisy, whole(), &mut light, &mut part)?;
    let straight = Request { denoise: false, path: None, layers: GUIDES, ..job.request.clone() };
    let mut guides = Guides(Vec::new());
    let mut part = Part { observer, from: OF_PATHS, share: 1.0 - OF_PATHS };
    let surfaces = job.with_request(job.formula.clone(), straight);
    running::render(backends, &surfaces, whole(), &mut guides, &mut part)?;
    denoise(size, &mut light.rgb, &guides.0, pixel_angle(job));
    push(&noisy, &light.rgb, rows, sink)?;
    Ok(done)
}

/// About the angle of a pixel's edge, in radians.
fn pixel_angle(job: &Job) -> f32 {
    let angle = job.camera.map_or(1.0, |camera| match camera.lens {
        Lens::Orthographic { height } => height / camera.distance().max(f64::MIN_POSITIVE),
        _ => camera.fov,
    });
    (angle / f64::from(job.size().height.max(1))) as f32
}

/// Hands on rows of a picture, developed.
fn push(job: &Job, light: &[f32], rows: Range<u32>, sink: &mut dyn Sink) -> Result<(), Error> {
    let composed = job.composed()?;
    let developed = Developed::new(&composed.arena, composed.pipeline.kernel(Role::Encode), job.precision)?;
    let (width, pixels) = (job.size().width as usize, light.as_chunks().0);
    let most = sink.most_rows().unwrap_or(BAND).clamp(1, BAND);
    for top in rows.clone().step_by(most as usize) {
        let end = (top + most).min(rows.end);
        let pixels = &pixels[top as usize * width..end as usize * width];
        let srgb = developed.bytes(pixels)?;
        sink.push(Rows { srgb, radiance: pixels.as_flattened().to_vec(), ..Rows::default() }).map_err(Error::Sink)?;
    }
    Ok(())
}

/// Keeps what the filter needs to know of surfaces.
struct Guides(Vec<f32>);

impl Sink for Guides {
    fn layers(&self) -> Layers {
        Layers::SRGB.or(GUIDES)
    }

    fn push(&mut self, mut rows: Rows) -> io::Result<()> {
        self.0.append(&mut rows.data);
        Ok(())
    }
}
