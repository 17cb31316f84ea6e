//! Rows of a picture as bytes, for renders that are stopped and go on.

use super::layers::{Layers, Rows};

impl Rows {
    /// All of it as bytes, but sums of samples.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(12 + self.srgb.len() + 4 * (self.radiance.len() + self.data.len()));
        for length in [self.srgb.len(), self.radiance.len(), self.data.len()] {
            bytes.extend_from_slice(&(length as u32).to_le_bytes());
        }
        bytes.extend_from_slice(&self.srgb);
        self.radiance.iter().chain(&self.data).for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    /// Reads [`Rows::to_bytes`] of rows of these layers; nothing of bytes that are none.
    pub fn from_bytes(bytes: &[u8], layers: Layers) -> Option<Rows> {
        let (head, rest) = bytes.split_at_checked(12)?;
        let length = |i: usize| Some(u32::from_le_bytes(head[4 * i..4 * i + 4].try_into().ok()?) as usize);
        let (srgb, rest) = rest.split_at_checked(length(0)?)?;
        let (radiance, data) = rest.split_at_checked(length(1)?.checked_mul(4)?)?;
        let numbers = |bytes: &[u8]| {
            let number = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            bytes.chunks_exact(4).map(number).collect::<Vec<f32>>()
        };
        let is_whole = data.len() == length(2)?.checked_mul(4)? && srgb.len().is_multiple_of(3);
        let pixels = srgb.len() / 3;
        let layers = layers.data();
        let fits = data.len() == 4 * pixels * layers.channels() && [0, 12 * pixels].contains(&radiance.len());
        (is_whole && fits).then(|| Rows {
            srgb: srgb.to_vec(),
            radiance: numbers(radiance),
            layers,
            data: numbers(data),
            ..Rows::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::film::{Layer, Layers, Rows};

    #[test]
    fn rows_come_back_as_they_were() {
        let layers = Layers::NONE.and(Layer::Depth);
        let rows = Rows {
            srgb: vec![1, 2, 3, 4, 5, 6],
            radiance: vec![0.5; 6],
            layers,
            data: vec![7.0, f32::MAX],
            ..Rows::default()
        };
        let bytes = rows.to_bytes();
        assert_eq!(Rows::from_bytes(&bytes, layers), Some(rows));
        assert_eq!(Rows::from_bytes(&bytes, Layers::NONE), None);
        assert!((0..bytes.len()).all(|length| Rows::from_bytes(&bytes[..length], layers).is_none()));
    }
}
