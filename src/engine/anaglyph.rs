//! Anaglyphs: the pictures of both eyes, one after the other, and one picture of them.

use std::io;
use std::ops::Range;

use super::running::{Part, Piece};
use super::{Backends, Done, Error, Job, Observer, Sink, running};
use crate::film::{Layers, Rows};
use crate::graph::{Camera, Stereo, StereoLayout};

/// The jobs of the left and the right eye, where a job is an anaglyph.
pub(super) fn eyes(job: &Job) -> Option<[Job; 2]> {
    let camera = job.camera?;
    let stereo = camera.stereo.filter(|stereo| stereo.layout == StereoLayout::Anaglyph)?;
    let of = |layout| job.with_camera(Camera { stereo: Some(Stereo { layout, ..stereo }), ..camera });
    Some([of(StereoLayout::Left), of(StereoLayout::Right)])
}

/// Renders rows of both eyes' pictures: red is the left one's, green and blue are the right one's. Memory holds the rows of one.
pub(super) fn render(
    backends: &Backends,
    [left, right]: &[Job; 2],
    rows: Range<u32>,
    sink: &mut dyn Sink,
    observer: &mut dyn Observer,
) -> Result<Done, Error> {
    let piece = |rows| Piece { rows, samples: None };
    let mut kept = Kept { layers: sink.layers(), srgb: Vec::new(), radiance: Vec::new() };
    let first =
        running::render(backends, left, piece(rows.clone()), &mut kept, &mut Part { observer, from: 0.0, share: 0.5 })?;
    let mut both = Both { left: kept, begun: [0; 2], sink };
    let mut done =
        running::render(backends, right, piece(rows), &mut both, &mut Part { observer, from: 0.5, share: 0.5 })?;
    done.stats.add(&first.stats);
    done.stats.render += first.stats.render;
    Ok(done)
}

/// The left eye's picture.
struct Kept {
    layers: Layers,
    srgb: Vec<u8>,
    radiance: Vec<f32>,
}

impl Sink for Kept {
    fn layers(&self) -> Layers {
        self.layers
    }

    fn push(&mut self, mut rows: Rows) -> io::Result<()> {
        self.srgb.append(&mut rows.srgb);
        self.radiance.append(&mut rows.radiance);
        Ok(())
    }
}

/// Takes the right eye's rows and hands them on with the left eye's red.
struct Both<'a> {
    left: Kept,
    /// Numbers of the left eye's picture that were used, of colours and of radiance.
    begun: [usize; 2],
    sink: &'a mut dyn Sink,
}

impl Sink for Both<'_> {
    fn layers(&self) -> Layers {
        self.sink.layers()
    }

    fn begin(&mut self, backend: &str) {
        self.sink.begin(backend);
    }

    fn push(&mut self, mut rows: Rows) -> io::Result<()> {
        redden(&mut rows.srgb, &self.left.srgb[self.begun[0]..]);
        redden(&mut rows.radiance, &self.left.radiance[self.begun[1]..]);
        self.begun = [self.begun[0] + rows.srgb.len(), self.begun[1] + rows.radiance.len()];
        self.sink.push(rows)
    }
}

/// Gives pixels the red of others.
fn redden<T: Copy>(pixels: &mut [T], others: &[T]) {
    for (pixel, other) in pixels.chunks_exact_mut(3).zip(others.chunks_exact(3)) {
        pixel[0] = other[0];
    }
}
