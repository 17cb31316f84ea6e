//! A picture's file in the format of its name.

use std::io;
use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::develop::Develop;
use super::encoded::Developer;
use super::layers::{Layer, Layers, Rows};
use super::png::{PngFile, PngForm};
use super::recipe::Made;
use crate::files::Target;
use crate::graph::Film;
use crate::shade::Size;

/// The formats that pictures are written in.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Format {
    /// Bytes or 16-bit numbers, with coverage.
    Png,
    /// Light and data in 32-bit floating point.
    #[cfg(feature = "formats")]
    Exr,
    /// Bytes or 16-bit numbers, with coverage.
    #[cfg(feature = "formats")]
    Tiff,
    /// Bytes, with losses.
    #[cfg(feature = "formats")]
    Jpeg,
    /// Bytes, with coverage.
    #[cfg(feature = "formats")]
    WebP,
    /// Light, in four bytes a pixel.
    #[cfg(feature = "formats")]
    Hdr,
}

impl Format {
    /// All formats, by the endings of their names.
    pub const ENDINGS: &[(&str, Format)] = &[
        ("png", Format::Png),
        #[cfg(feature = "formats")]
        ("exr", Format::Exr),
        #[cfg(feature = "formats")]
        ("tif", Format::Tiff),
        #[cfg(feature = "formats")]
        ("tiff", Format::Tiff),
        #[cfg(feature = "formats")]
        ("jpg", Format::Jpeg),
        #[cfg(feature = "formats")]
        ("jpeg", Format::Jpeg),
        #[cfg(feature = "formats")]
        ("webp", Format::WebP),
        #[cfg(feature = "formats")]
        ("hdr", Format::Hdr),
    ];

    /// The format that the ending of a name asks for.
    pub fn of(path: &Path) -> Option<Format> {
        let ending = path.extension()?;
        Format::ENDINGS.iter().find(|(known, _)| ending.eq_ignore_ascii_case(known)).map(|(_, format)| *format)
    }

    /// Whether it holds light, and not what is shown of it.
    pub fn is_light(self) -> bool {
        #[cfg(feature = "formats")]
        return matches!(self, Format::Exr | Format::Hdr);
        #[cfg(not(feature = "formats"))]
        false
    }

    /// Whether it can say how much of a pixel is covered.
    pub fn has_alpha(self) -> bool {
        #[cfg(feature = "formats")]
        return !matches!(self, Format::Jpeg | Format::Hdr);
        #[cfg(not(feature = "formats"))]
        true
    }

    /// Whether it can have 16-bit numbers.
    pub fn is_deep(self) -> bool {
        #[cfg(feature = "formats")]
        return matches!(self, Format::Png | Format::Tiff);
        #[cfg(not(feature = "formats"))]
        true
    }

    /// Whether it can have layers besides colour.
    pub fn has_layers(self) -> bool {
        #[cfg(feature = "formats")]
        return self == Format::Exr;
        #[cfg(not(feature = "formats"))]
        false
    }
}

/// Bits of a developed number.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Depth {
    /// A byte.
    #[default]
    Eight,
    /// Two bytes.
    Sixteen,
}

impl Depth {
    /// The number that stands for 1.
    fn most(self) -> u16 {
        match self {
            Depth::Eight => 255,
            Depth::Sixteen => u16::MAX,
        }
    }
}

/// What a picture's file holds.
#[derive(Clone, PartialEq, Debug)]
pub struct Form {
    /// The format.
    pub format: Format,
    /// Columns and rows.
    pub size: Size,
    /// Bits of developed numbers.
    pub depth: Depth,
    /// Whether the background is left out, and coverage says where.
    pub transparent: bool,
    /// Pixels an inch, where printers are told.
    pub dpi: Option<f64>,
    /// Layers besides the colours, in formats that have them.
    pub layers: Layers,
    /// How light becomes a picture.
    pub film: Film,
    /// What the film takes for granted where it says nothing.
    pub kind: Develop,
    /// The key of the picture's job.
    pub key: Option<String>,
}

impl Form {
    /// The colours that are wanted: of all, or of surfaces alone.
    fn colours(&self) -> Layer {
        if self.transparent { Layer::Cutout } else { Layer::Radiance }
    }

    /// Whether the bytes that every render has are those of the file.
    fn is_plain(&self) -> bool {
        !self.format.is_light() && !self.transparent && self.depth == Depth::Eight && !self.film.dither
    }

    /// What is wanted of each pixel.
    pub fn wanted(&self) -> Layers {
        let colours = Layers::SRGB.and(self.colours());
        match (self.format.is_light(), self.transparent) {
            _ if self.is_plain() => Layers::SRGB,
            (true, true) => self.layers.and(Layer::Alpha).or(colours),
            (true, false) => self.layers.or(colours),
            (false, true) => colours.and(Layer::Alpha),
            (false, false) => colours,
        }
    }

    /// The layers of a file of light: colours first.
    fn layers(&self) -> impl Iterator<Item = Layer> {
        self.wanted().iter().filter(|layer| *layer != Layer::Srgb)
    }
}

/// A picture's file that takes rows from the top. Until [`PictureFile::finish`] none of it is seen under the target's name.
///
/// Memory: a band of rows for PNG, the whole picture for other formats.
pub struct PictureFile {
    form: Form,
    target: Target,
    /// Of numbers that are not the render's own bytes.
    developer: Option<Developer>,
    /// Rows so far.
    rows: u32,
    png: Option<PngFile>,
    samples: Vec<u16>,
    layers: Vec<(Layer, Vec<f32>)>,
}

impl PictureFile {
    /// A file at a target that has been looked at.
    pub fn new(target: &Target, form: Form) -> io::Result<PictureFile> {
        let develops = !form.is_plain() && !form.format.is_light();
        let develop = Develop::of(&form.film, form.kind);
        let developer = develops.then(|| Developer::new(develop, form.film.dither)).transpose()?;
        let png = (form.format == Format::Png).then(|| {
            let png = PngForm {
                size: form.size,
                alpha: form.transparent,
                is_deep: form.depth == Depth::Sixteen,
                dpi: form.dpi,
                encoding: form.film.encoding,
                key: form.key.clone(),
            };
            PngFile::at(target, png)
        });
        let layers = match form.format.is_light() {
            true => form.layers().map(|layer| (layer, Vec::new())).collect(),
            false => Vec::new(),
        };
        Ok(PictureFile { form, target: target.clone(), developer, rows: 0, png, samples: Vec::new(), layers })
    }

    /// Where it is written.
    pub fn target(&self) -> &Target {
        &self.target
    }

    /// What is wanted of each pixel.
    pub fn wanted(&self) -> Layers {
        self.form.wanted()
    }

    /// Takes the next rows.
    ///
    /// Errors: the file takes no more; [`PictureFile::finish`] has the cause.
    pub fn push(&mut self, rows: &Rows) -> io::Result<()> {
        let samples = match &self.developer {
            None if self.form.format.is_light() => Vec::new(),
            None => rows.srgb.iter().map(|&byte| u16::from(byte)).collect(),
            Some(developer) => self.developed(developer, rows)?,
        };
        for (layer, numbers) in &mut self.layers {
            numbers.extend(rows.layer(*layer));
        }
        let pixels = rows.srgb.len() / 3;
        self.rows += (pixels / self.form.size.width.max(1) as usize) as u32;
        let Some(png) = &mut self.png else {
            self.samples.extend(samples);
            return Ok(());
        };
        let bytes = match self.form.depth {
            Depth::Eight => samples.into_iter().map(|sample| sample as u8).collect(),
            Depth::Sixteen => samples.into_iter().flat_map(u16::to_be_bytes).collect(),
        };
        if png.push(bytes) { Ok(()) } else { Err(io::Error::other("the file takes no more rows")) }
    }

    /// Developed numbers, with coverage where that is wanted.
    fn developed(&self, developer: &Developer, rows: &Rows) -> io::Result<Vec<u16>> {
        let (most, place) = (self.form.depth.most(), (self.form.size.width, self.rows));
        let light = rows.layer(self.form.colours());
        if !self.form.transparent {
            return developer.develop(&light, most, place);
        }
        // Files hold the colour of what covers a part of a pixel as if it covered all of it.
        let alpha = rows.layer(Layer::Alpha);
        let whole =
            |(colour, &alpha): (&[f32], &f32)| [0, 1, 2].map(|k| if alpha > 0.0 { colour[k] / alpha } else { 0.0 });
        let light: Vec<f32> = light.chunks_exact(3).zip(&alpha).flat_map(whole).collect();
        let colours = developer.develop(&light, most, place)?;
        let covered = alpha.iter().map(|alpha| (alpha * f32::from(most) + 0.5) as u16);
        let pixel = |(colour, alpha): (&[u16], u16)| [colour[0], colour[1], colour[2], alpha];
        Ok(colours.chunks_exact(3).zip(covered).flat_map(pixel).collect())
    }

    /// Gives the file its name; `recipe` says how the picture was made. Returns the time that compressing and writing took.
    ///
    /// Errors: whatever the system or the format says, and too few rows; the target is then what it was.
    pub fn finish(mut self, recipe: Option<&str>) -> io::Result<Duration> {
        if let Some(mut png) = self.png.take() {
            if let Some(recipe) = recipe {
                png.tell(recipe);
            }
            return png.finish();
        }
        let made = Made { key: self.form.key.clone(), recipe: recipe.map(String::from) };
        self.finish_whole(&made)
    }

    #[cfg(feature = "formats")]
    fn finish_whole(self, made: &Made) -> io::Result<Duration> {
        use super::formats::{Whole, encode};
        use crate::graph::Encoding;
        if self.rows != self.form.size.height {
            return Err(io::Error::other("the picture has too few rows"));
        }
        let start = std::time::Instant::now();
        let bytes = encode(Whole {
            form: &self.form,
            samples: &self.samples,
            layers: &self.layers,
            comment: &super::recipe::words(made)?,
            profile: (self.form.film.encoding == Encoding::P3).then(super::icc::display_p3),
        })?;
        self.target.write(&bytes)?;
        Ok(start.elapsed())
    }

    #[cfg(not(feature = "formats"))]
    fn finish_whole(self, _: &Made) -> io::Result<Duration> {
        Err(io::Error::other("the file is closed"))
    }
}

/// One picture in several files.
pub struct Pictures(pub Vec<PictureFile>);

impl Pictures {
    /// What is wanted of each pixel.
    pub fn wanted(&self) -> Layers {
        self.0.iter().fold(Layers::SRGB, |all, file| all.or(file.wanted()))
    }

    /// Gives all files the next rows.
    ///
    /// Errors: one of them takes no more; [`Pictures::finish`] has the cause.
    pub fn push(&mut self, rows: &Rows) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|file| file.push(rows))
    }

    /// Gives all files their names, in order. Returns the time that it took.
    ///
    /// Errors: the first that fails, with its target.
    pub fn finish(self, recipe: Option<&str>) -> Result<Duration, Box<(Target, io::Error)>> {
        let mut took = Duration::ZERO;
        for file in self.0 {
            let target = file.target.clone();
            took += file.finish(recipe).map_err(|error| Box::new((target, error)))?;
        }
        Ok(took)
    }
}
