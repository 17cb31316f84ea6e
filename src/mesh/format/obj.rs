//! Wavefront OBJ, with colours behind coordinates as many programs read them.

use std::io::{self, Write};

use super::{Encoder, File, Head, commit};
use crate::mesh::surface::{Triangle, Vertex};

pub(super) struct Obj(File);

impl Obj {
    pub fn new(mut file: File, head: &Head) -> io::Result<Obj> {
        let unit = if head.is_mm { "# unit: mm\n" } else { "" };
        write!(file, "# by bulbfold\n{unit}o {}\n", head.name)?;
        Ok(Obj(file))
    }
}

impl Encoder for Obj {
    fn vertices(&mut self, vertices: &[Vertex]) -> io::Result<()> {
        vertices.iter().try_for_each(|vertex| {
            let ([x, y, z], [r, g, b]) = (vertex.position, vertex.colour.map(|part| f32::from(part) / 255.0));
            writeln!(self.0, "v {x} {y} {z} {r:.3} {g:.3} {b:.3}")?;
            let [x, y, z] = vertex.normal;
            writeln!(self.0, "vn {x:.4} {y:.4} {z:.4}")
        })
    }

    fn triangles(&mut self, triangles: &[Triangle]) -> io::Result<()> {
        triangles.iter().try_for_each(|triangle| {
            let [a, b, c] = triangle.map(|corner| u64::from(corner) + 1);
            writeln!(self.0, "f {a}//{a} {b}//{b} {c}//{c}")
        })
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        commit(self.0)
    }
}
