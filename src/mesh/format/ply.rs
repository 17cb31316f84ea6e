//! PLY, binary (G. Turk, 1994).

use std::io::{self, Write};

use super::{Encoder, File, Head, commit, write_floats};
use crate::mesh::surface::{Triangle, Vertex};

pub(super) struct Ply(File);

impl Ply {
    pub fn new(mut file: File, head: &Head) -> io::Result<Ply> {
        // Readers know signed numbers best.
        let number = if head.vertices <= i32::MAX as u64 { "int" } else { "uint" };
        let unit = if head.is_mm { "comment unit mm\n" } else { "" };
        write!(
            file,
            "ply\nformat binary_little_endian 1.0\ncomment {} by bulbfold\n{unit}element vertex {}\n\
             property float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\n\
             element face {}\nproperty list uchar {number} vertex_indices\nend_header\n",
            head.name, head.vertices, head.triangles
        )?;
        Ok(Ply(file))
    }
}

impl Encoder for Ply {
    fn vertices(&mut self, vertices: &[Vertex]) -> io::Result<()> {
        vertices.iter().try_for_each(|vertex| {
            write_floats(&mut self.0, &vertex.position)?;
            write_floats(&mut self.0, &vertex.normal)?;
            self.0.write_all(&vertex.colour)
        })
    }

    fn triangles(&mut self, triangles: &[Triangle]) -> io::Result<()> {
        triangles.iter().try_for_each(|triangle| {
            self.0.write_all(&[3])?;
            triangle.iter().try_for_each(|corner| self.0.write_all(&corner.to_le_bytes()))
        })
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        commit(self.0)
    }
}
