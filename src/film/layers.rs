//! What is kept of a picture, row by row.

use serde::{Deserialize, Serialize};

use super::LightSum;
use crate::shade::Size;

/// What may be kept of each pixel.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layer {
    /// Red, green and blue as bytes of the film's colour space, developed. Every render has it.
    Srgb,
    /// Red, green and blue of the light itself: linear, `f32`, the average of the samples before white balance, exposure and curve.
    Radiance,
    /// The same of surfaces alone: samples without a hit count as black.
    Cutout,
    /// The share of the samples that hit a surface, from 0 to 1.
    Alpha,
    /// The distance from the camera along the ray, of the first sample; [`Layer::NOWHERE`] without a hit.
    Depth,
    /// The point that was hit, in world units, of the first sample.
    Position,
    /// The average of the unit normals, in world coordinates, towards the camera; samples without a hit count as 0.
    Normal,
    /// The average of the surfaces' own colours, linear; samples without a hit count as black.
    Albedo,
    /// The average of how open corners are: 1 in the open and where the scene darkens none, towards 0 in narrow places; samples
    /// without a hit count as 1.
    Occlusion,
    /// The least distances of the orbit from the traps, as far as the look reads them, of the first sample.
    Trap,
    /// Iterations of all orbits that the first sample's ray took.
    Iterations,
    /// Estimates that the first sample's ray took.
    Steps,
    /// 1 where the first sample's ray ended between a point that is known to be outside and one that is known to be inside, 0
    /// where the estimate alone says that there is a surface, or there is none.
    Confidence,
}

impl Layer {
    /// All of them.
    pub const ALL: [Layer; 13] = [
        Layer::Srgb,
        Layer::Radiance,
        Layer::Cutout,
        Layer::Alpha,
        Layer::Depth,
        Layer::Position,
        Layer::Normal,
        Layer::Albedo,
        Layer::Occlusion,
        Layer::Trap,
        Layer::Iterations,
        Layer::Steps,
        Layer::Confidence,
    ];
    /// Whether it stands beside a picture's colours, so that it can be asked for by name.
    pub fn is_besides(self) -> bool {
        !matches!(self, Layer::Srgb | Layer::Radiance | Layer::Cutout)
    }

    /// The depth of a pixel in which nothing was hit.
    pub const NOWHERE: f64 = 1e10;

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Layer::Srgb => "srgb",
            Layer::Radiance => "radiance",
            Layer::Cutout => "cutout",
            Layer::Alpha => "alpha",
            Layer::Depth => "depth",
            Layer::Position => "position",
            Layer::Normal => "normal",
            Layer::Albedo => "albedo",
            Layer::Occlusion => "occlusion",
            Layer::Trap => "trap",
            Layer::Iterations => "iterations",
            Layer::Steps => "steps",
            Layer::Confidence => "confidence",
        }
    }

    /// Names of what a pixel has, in order.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Layer::Srgb | Layer::Radiance | Layer::Cutout | Layer::Albedo => &["R", "G", "B"],
            Layer::Alpha => &["A"],
            Layer::Depth => &["Z"],
            Layer::Position | Layer::Normal => &["X", "Y", "Z"],
            Layer::Trap => &["X", "Y", "Z", "W"],
            Layer::Occlusion | Layer::Iterations | Layer::Steps | Layer::Confidence => &["Y"],
        }
    }

    /// Bytes of one channel of a pixel.
    pub fn bytes(self) -> usize {
        if self == Layer::Srgb { 1 } else { 4 }
    }

    /// Whether a kernel of its own finds it out, which a picture has only where it is asked for.
    pub fn is_data(self) -> bool {
        !matches!(self, Layer::Srgb | Layer::Radiance)
    }

    /// Whether a pixel has the average of its samples, and not what its first one found.
    pub fn is_averaged(self) -> bool {
        matches!(
            self,
            Layer::Srgb
                | Layer::Radiance
                | Layer::Cutout
                | Layer::Alpha
                | Layer::Normal
                | Layer::Albedo
                | Layer::Occlusion
        )
    }
}

/// A set of layers.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
#[serde(from = "Vec<Layer>", into = "Vec<Layer>")]
pub struct Layers(u16);

impl Layers {
    /// None of them.
    pub const NONE: Layers = Layers(0);
    /// Bytes alone.
    pub const SRGB: Layers = Layers::NONE.and(Layer::Srgb);

    /// The set with one more.
    #[must_use]
    pub const fn and(self, layer: Layer) -> Layers {
        Layers(self.0 | 1 << layer as u16)
    }

    /// All that are in either.
    #[must_use]
    pub fn or(self, other: Layers) -> Layers {
        Layers(self.0 | other.0)
    }

    /// Whether a layer is in it.
    pub fn has(self, layer: Layer) -> bool {
        self.0 & (1 << layer as u16) != 0
    }

    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Those that it has, in the order of [`Layer::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Layer> {
        Layer::ALL.into_iter().filter(move |layer| self.has(*layer))
    }

    /// Those of kernels of their own.
    #[must_use]
    pub fn data(self) -> Layers {
        self.iter().filter(|layer| layer.is_data()).collect()
    }

    /// Numbers of a pixel.
    pub fn channels(self) -> usize {
        self.iter().map(|layer| layer.channels().len()).sum()
    }
}

impl FromIterator<Layer> for Layers {
    fn from_iter<I: IntoIterator<Item = Layer>>(layers: I) -> Layers {
        layers.into_iter().fold(Layers::NONE, Layers::and)
    }
}

impl From<Vec<Layer>> for Layers {
    fn from(layers: Vec<Layer>) -> Layers {
        layers.into_iter().collect()
    }
}

impl From<Layers> for Vec<Layer> {
    fn from(layers: Layers) -> Vec<Layer> {
        layers.iter().collect()
    }
}

/// Some whole rows of a picture, from the left and the top.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Rows {
    /// [`Layer::Srgb`]: three bytes a pixel.
    pub srgb: Vec<u8>,
    /// [`Layer::Radiance`]: three numbers a pixel, and none where nobody wants them.
    pub radiance: Vec<f32>,
    /// The layers of [`Rows::data`].
    pub layers: Layers,
    /// The other layers that are wanted: all numbers of a pixel after each other, in the order of [`Layer::ALL`].
    pub data: Vec<f32>,
    /// The sum of each pixel's samples, where a part of a picture's samples was asked for; its colours are those of that part.
    pub sums: Vec<LightSum>,
}

impl Rows {
    /// The numbers of a layer that is not [`Layer::Srgb`], pixel by pixel; nothing of one that was not wanted.
    pub fn layer(&self, layer: Layer) -> Vec<f32> {
        if layer == Layer::Radiance {
            return self.radiance.clone();
        }
        let width = self.layers.channels();
        if !self.layers.has(layer) || width == 0 {
            return Vec::new();
        }
        let first: usize = self.layers.iter().take_while(|own| *own != layer).map(|layer| layer.channels().len()).sum();
        let count = layer.channels().len();
        self.data.chunks_exact(width).flat_map(|pixel| &pixel[first..first + count]).copied().collect()
    }
}

/// The light of a picture in memory.
#[derive(Clone, PartialEq, Debug)]
pub struct Radiance {
    /// Columns and rows.
    pub size: Size,
    /// Red, green and blue of each pixel, from the top left.
    pub rgb: Vec<f32>,
}

impl Radiance {
    /// No rows yet.
    pub fn new(size: Size) -> Radiance {
        Radiance { size, rgb: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::{Layer, Layers, Rows};

    #[test]
    fn layers_lie_beside_each_other_in_one_order() {
        let layers: Layers = [Layer::Normal, Layer::Alpha].into_iter().collect();
        let rows = Rows { layers, data: (0..8_u8).map(f32::from).collect(), ..Rows::default() };
        assert_eq!(rows.layer(Layer::Alpha), [0.0, 4.0]);
        assert_eq!(rows.layer(Layer::Normal), [1.0, 2.0, 3.0, 5.0, 6.0, 7.0]);
        assert!(rows.layer(Layer::Depth).is_empty());
        assert_eq!(serde_json::to_string(&layers).unwrap(), r#"["alpha","normal"]"#);
        assert_eq!(serde_json::from_str::<Layers>(r#"["normal","alpha"]"#).unwrap(), layers);
    }
}
