//! The film: how light becomes a picture.

use serde::{Deserialize, Serialize};

use crate::formula::decode::Fields;
use crate::formula::value::Value;
use crate::graph::read::Reader;

/// How light becomes a picture. Formats of floating-point numbers hold the light itself, before all of it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Film {
    /// Exposure in stops: each doubles the light. From -20 to 20.
    pub exposure: f64,
    /// Colour temperature of the light that is to look white, in kelvin, from [`Film::COLDEST`] to [`Film::HOTTEST`].
    pub white_balance: f64,
    /// What becomes of bright light; without it solids are filmic and planes as they are.
    pub curve: Option<Curve>,
    /// The colour space of the file.
    pub encoding: Encoding,
    /// Whether bytes are dithered, so that smooth gradients show no bands.
    pub dither: bool,
}

impl Film {
    /// The colour temperature that leaves colours as they are, in kelvin.
    pub const NEUTRAL: f64 = 6500.0;
    /// The least colour temperature, in kelvin.
    pub const COLDEST: f64 = 1667.0;
    /// The greatest colour temperature, in kelvin.
    pub const HOTTEST: f64 = 25000.0;
    /// Most stops of exposure, up and down.
    pub const MOST_STOPS: f64 = 20.0;
}

impl Default for Film {
    fn default() -> Film {
        Film { exposure: 0.0, white_balance: Film::NEUTRAL, curve: None, encoding: Encoding::Srgb, dither: false }
    }
}

/// What becomes of bright light.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Curve {
    /// Nothing: radiance from 0 to 1 is shown as it is, and what is brighter as 1. Drawings such as pictures of a plane.
    None,
    /// Each channel is compressed smoothly, as film does.
    Filmic,
    /// As `Filmic`, in a space of colours where bright light loses its hue on the way to white.
    Agx,
}

impl Curve {
    /// All, with the names that files use.
    pub const ALL: [(&str, Curve); 3] = [("none", Curve::None), ("filmic", Curve::Filmic), ("agx", Curve::Agx)];
}

/// The colour space of a picture's file.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// sRGB (IEC 61966-2-1), which every program takes for granted.
    #[default]
    Srgb,
    /// Display P3: the primaries of DCI-P3, the white and the curve of sRGB. Files say so.
    P3,
}

impl Encoding {
    /// All, with the names that files use.
    pub const ALL: [(&str, Encoding); 2] = [("srgb", Encoding::Srgb), ("p3", Encoding::P3)];
}

/// Reads `film: (exposure: 1, ...)`; what is not given keeps its default.
pub(super) fn read_film(reader: &mut Reader, value: &Value) -> Option<Film> {
    let mut film = Film::default();
    let mut fields = Fields::new(value, "a film", reader.d)?;
    if let Some(v) = fields.optional_value("exposure") {
        film.exposure = reader.number(v, -Film::MOST_STOPS, Film::MOST_STOPS)?;
    }
    if let Some(v) = fields.optional_value("white_balance") {
        film.white_balance = reader.number(v, Film::COLDEST, Film::HOTTEST)?;
    }
    if let Some(v) = fields.optional_value("curve") {
        film.curve = Some(reader.word(v, "curve", &Curve::ALL)?);
    }
    if let Some(v) = fields.optional_value("encoding") {
        film.encoding = reader.word(v, "colour space", &Encoding::ALL)?;
    }
    film.dither = fields.or("dither", film.dither, reader.d);
    fields.finish(reader.d);
    Some(film)
}
