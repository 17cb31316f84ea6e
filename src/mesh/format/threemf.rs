//! 3MF (3MF Consortium, core specification 1.3, materials and properties 1.2): XML in a ZIP archive.

use std::io::{self, Write};

use zip::ZipWriter;
use zip::write::{SimpleFileOptions, StreamWriter};

use super::{Encoder, File, Head, commit};
use crate::mesh::surface::{Triangle, Vertex};

const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;
const RELATIONS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;
/// Bits of a colour's part: triangles name colours of a list.
const BITS: u16 = 4;

pub(super) struct ThreeMf {
    zip: ZipWriter<StreamWriter<File>>,
    /// Each vertex's place in the list of colours.
    colours: Vec<u16>,
    has_triangles: bool,
}

impl ThreeMf {
    pub fn new(file: File, head: &Head) -> io::Result<ThreeMf> {
        let mut zip = ZipWriter::new_stream(file);
        let options = SimpleFileOptions::default().large_file(true).compression_level(Some(1));
        for (name, text) in [("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)] {
            zip.start_file(name, options)?;
            zip.write_all(text.as_bytes())?;
        }
        zip.start_file("3D/3dmodel.model", options)?;
        // The world's units are taken for centimetres, so that what is a few units wide can be held.
        let unit = if head.is_mm { "millimeter" } else { "centimeter" };
        write!(
            zip,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <model unit=\"{unit}\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" \
             xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\">\n\
             <metadata name=\"Application\">bulbfold</metadata>\n<resources>\n<m:colorgroup id=\"1\">\n"
        )?;
        for place in 0..1u16 << (3 * BITS) {
            let [r, g, b] = [2, 1, 0].map(|k| (place >> (k * BITS) & 15) * 17);
            writeln!(zip, "<m:color color=\"#{r:02X}{g:02X}{b:02X}\"/>")?;
        }
        writeln!(zip, "</m:colorgroup>\n<object id=\"2\" type=\"model\" pid=\"1\" pindex=\"0\">\n<mesh>\n<vertices>")?;
        Ok(ThreeMf { zip, colours: Vec::new(), has_triangles: false })
    }
}

impl Encoder for ThreeMf {
    fn vertices(&mut self, vertices: &[Vertex]) -> io::Result<()> {
        for vertex in vertices {
            let [x, y, z] = vertex.position;
            writeln!(self.zip, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>")?;
            let colour = vertex.colour.iter().fold(0, |place, part| (place << BITS) | ((u16::from(*part) + 8) / 17));
            self.colours.push(colour);
        }
        Ok(())
    }

    fn triangles(&mut self, triangles: &[Triangle]) -> io::Result<()> {
        if !self.has_triangles {
            self.has_triangles = true;
            writeln!(self.zip, "</vertices>\n<triangles>")?;
        }
        for [a, b, c] in triangles {
            let [p, q, r] = [a, b, c].map(|corner| self.colours[*corner as usize]);
            writeln!(
                self.zip,
                "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\" pid=\"1\" p1=\"{p}\" p2=\"{q}\" p3=\"{r}\"/>"
            )?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        writeln!(
            self.zip,
            "</triangles>\n</mesh>\n</object>\n</resources>\n<build>\n<item objectid=\"2\"/>\n</build>\n</model>"
        )?;
        commit(self.zip.finish()?.into_inner())
    }
}
