//! STL, binary (3D Systems, 1988): facets with their normals.

use std::io::{self, Write};

use super::{Encoder, Facet, File, Head, commit, write_floats};
use crate::mesh::surface::{Triangle, Vertex};

pub(super) struct Stl(File);

impl Stl {
    pub fn new(mut file: File, head: &Head) -> io::Result<Stl> {
        // Files that begin with "solid" are taken for text.
        let text = format!("bulbfold: {}", head.name);
        let mut title = [b' '; 80];
        title.iter_mut().zip(text.bytes()).for_each(|(to, from)| *to = from);
        file.write_all(&title)?;
        file.write_all(&(head.triangles as u32).to_le_bytes())?;
        Ok(Stl(file))
    }
}

impl Encoder for Stl {
    fn vertices(&mut self, _: &[Vertex]) -> io::Result<()> {
        Ok(())
    }

    fn triangles(&mut self, _: &[Triangle]) -> io::Result<()> {
        Ok(())
    }

    fn facets(&mut self, facets: &[Facet]) -> io::Result<()> {
        facets.iter().try_for_each(|facet| {
            let [a, b, c] = facet.map(|corner| glam::DVec3::from(corner.map(f64::from)));
            let normal = (b - a).cross(c - a).normalize_or_zero();
            write_floats(&mut self.0, &normal.to_array().map(|x| x as f32))?;
            facet.iter().try_for_each(|corner| write_floats(&mut self.0, corner))?;
            self.0.write_all(&[0, 0])
        })
    }

    fn takes_facets(&self) -> bool {
        true
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        commit(self.0)
    }
}
