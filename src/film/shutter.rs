//! The average of several moments: a picture while the shutter is open.

use std::io;

use super::develop::Develop;
use super::encoded::Developer;
use super::file::Form;
use super::layers::{Layer, Layers, Rows};

/// Takes the rows of several pictures of one size, and gives those of their average. Light is averaged, and its average is
/// developed; layers that hold what a pixel's first sample found keep those of the first picture.
pub struct Shutter {
    wanted: Layers,
    developer: Developer,
    width: u32,
    /// The row of the picture that its first row is.
    top: u32,
    pictures: u32,
    /// Pixels of the picture that is open.
    pixels: usize,
    sum: Rows,
}

impl Shutter {
    /// A shutter for a picture's file, or for its rows from `top` on.
    ///
    /// Errors: the film cannot be compiled.
    pub fn new(form: &Form, top: u32) -> io::Result<Shutter> {
        let developer = Developer::new(Develop::of(&form.film, form.kind), form.film.dither)?;
        let wanted = form.wanted().and(Layer::Radiance);
        Ok(Shutter { wanted, developer, width: form.size.width, top, pictures: 0, pixels: 0, sum: Rows::default() })
    }

    /// What it wants of each pixel.
    pub fn wanted(&self) -> Layers {
        self.wanted
    }

    /// Begins the next picture.
    pub fn open(&mut self) {
        (self.pictures, self.pixels) = (self.pictures + 1, 0);
    }

    /// Takes the next rows of the picture that is open.
    pub fn push(&mut self, rows: Rows) {
        let pixels = rows.srgb.len() / 3;
        if self.pictures == 1 {
            self.sum.radiance.extend(rows.radiance);
            self.sum.data.extend(rows.data);
            self.sum.layers = rows.layers;
        } else {
            let first = 3 * self.pixels;
            self.sum.radiance[first..].iter_mut().zip(&rows.radiance).for_each(|(sum, x)| *sum += x);
            let width = self.sum.layers.channels();
            let averaged = self.averaged();
            let pixels = self.sum.data[width * self.pixels..].chunks_exact_mut(width.max(1));
            for (sum, pixel) in pixels.zip(rows.data.chunks_exact(width.max(1))) {
                let numbers = sum.iter_mut().zip(pixel).zip(&averaged).filter(|(_, averaged)| **averaged);
                numbers.for_each(|((sum, x), _)| *sum += x);
            }
        }
        self.pixels += pixels;
    }

    /// Whether each number of a pixel's layers is averaged.
    fn averaged(&self) -> Vec<bool> {
        let channels = |layer: Layer| vec![layer.is_averaged(); layer.channels().len()];
        self.sum.layers.iter().flat_map(channels).collect()
    }

    /// The rows of the average.
    ///
    /// Errors: the light cannot be developed.
    pub fn close(mut self) -> io::Result<Rows> {
        let share = 1.0 / self.pictures.max(1) as f32;
        self.sum.radiance.iter_mut().for_each(|x| *x *= share);
        let averaged = self.averaged();
        for pixel in self.sum.data.chunks_exact_mut(averaged.len().max(1)) {
            pixel.iter_mut().zip(&averaged).filter(|(_, averaged)| **averaged).for_each(|(x, _)| *x *= share);
        }
        let bytes = self.developer.develop(&self.sum.radiance, 255, (self.width, self.top))?;
        self.sum.srgb = bytes.into_iter().map(|byte| byte as u8).collect();
        Ok(self.sum)
    }
}
