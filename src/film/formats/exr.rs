//! OpenEXR: light and data of pixels in 32-bit floating point, losslessly compressed (ZIP, 16 rows a block).

use std::io::{self, BufReader, Cursor, Read, Seek};

use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, Text};
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, LayerAttributes, WritableImage};

use super::super::layers::Layer;
use super::{MOST_COMMENT, Whole};

/// The attribute with the comment.
const ATTRIBUTE: &str = "bulbfold";

/// What channels of a layer are called before their own names. Programs know colour by `R`, `G`, `B` and `A`, depth by `Z`, points by
/// `P` and normals by `N`.
fn prefix(layer: Layer, is_cut_out: bool) -> String {
    match layer {
        Layer::Radiance | Layer::Cutout | Layer::Depth => String::new(),
        Layer::Alpha if is_cut_out => String::new(),
        Layer::Alpha => "coverage.".into(),
        Layer::Position => "P.".into(),
        Layer::Normal => "N.".into(),
        other => format!("{}.", other.name()),
    }
}

pub(super) fn encode(picture: &Whole) -> io::Result<Vec<u8>> {
    let mut channels = Vec::new();
    for (layer, numbers) in picture.layers {
        let names = layer.channels();
        for (k, name) in names.iter().enumerate() {
            let column: Vec<f32> = numbers.iter().skip(k).step_by(names.len()).copied().collect();
            let name = format!("{}{name}", prefix(*layer, picture.form.transparent));
            channels.push(AnyChannel::new(Text::from(name.as_str()), FlatSamples::F32(column)));
        }
    }
    let program = Text::from(concat!("Bulbfold ", env!("CARGO_PKG_VERSION")));
    let mut attributes = LayerAttributes { software_name: Some(program), ..LayerAttributes::default() };
    attributes.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(picture.comment)));
    if let Some(dpi) = picture.form.dpi {
        attributes.horizontal_density = Some(dpi as f32);
    }
    let size = (picture.form.size.width as usize, picture.form.size.height as usize);
    let channels = AnyChannels::sort(channels.into());
    let layer = exr::prelude::Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).map_err(io::Error::other)?;
    Ok(bytes.into_inner())
}

pub(in super::super) fn comment<R: Read + Seek>(file: &mut R) -> Result<String, String> {
    let head = BufReader::new(file.by_ref().take(MOST_COMMENT));
    let meta = MetaData::read_from_buffered(head, false).map_err(|error| format!("it is no whole EXR ({error})"))?;
    let own = meta.headers.iter().find_map(|header| header.own_attributes.other.get(&Text::from(ATTRIBUTE)));
    Ok(match own {
        Some(AttributeValue::Text(text)) => text.to_string(),
        _ => String::new(),
    })
}
