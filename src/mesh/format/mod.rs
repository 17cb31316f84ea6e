//! Files of meshes, which take vertices and triangles as they come.

mod glb;
mod obj;
mod ply;
mod stl;
mod threemf;

use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::surface::{Triangle, Vertex};
use crate::files::{Output, Target};

/// Bytes that are written at once.
const BUFFER: usize = 1 << 20;

/// What a mesh is written as.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Format {
    /// Stanford polygons, binary: normals and colours.
    Ply,
    /// Wavefront, text: normals, and colours behind coordinates.
    Obj,
    /// Stereolithography, binary: triangles alone.
    Stl,
    /// glTF 2.0, binary: normals and colours.
    Glb,
    /// 3D Manufacturing Format: colours, and a unit.
    ThreeMf,
}

/// What a file has to know before its first vertex.
#[derive(Clone, Debug)]
pub struct Head {
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Whether lengths are millimetres; else they are the world's units.
    pub is_mm: bool,
    /// What the mesh is of.
    pub name: String,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 5] = [Format::Ply, Format::Obj, Format::Stl, Format::Glb, Format::ThreeMf];

    /// The ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            Format::Ply => "ply",
            Format::Obj => "obj",
            Format::Stl => "stl",
            Format::Glb => "glb",
            Format::ThreeMf => "3mf",
        }
    }

    /// The format of a file's name; `None` of other endings.
    pub fn of(path: &Path) -> Option<Format> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Format::ALL.into_iter().find(|format| format.ending() == ending)
    }

    /// Whether files hold normals or colours.
    pub fn has_looks(self) -> bool {
        self != Format::Stl
    }

    /// Bytes of a file, as far as they are known beforehand: exact but for texts.
    pub fn bytes(self, vertices: u64, triangles: u64) -> u64 {
        match self {
            Format::Ply => 400 + 27 * vertices + 13 * triangles,
            Format::Obj => 75 * vertices + 50 * triangles,
            Format::Stl => 84 + 50 * triangles,
            Format::Glb => 1200 + 32 * vertices + 12 * triangles,
            Format::ThreeMf => 12 * vertices + 14 * triangles,
        }
    }

    /// Bytes of memory that a writer takes for each vertex.
    pub fn memory(self) -> u64 {
        if self == Format::ThreeMf { 2 } else { 0 }
    }

    /// The most triangles of a file, and why.
    pub fn most(self) -> Option<(u64, &'static str)> {
        match self {
            Format::Stl => Some((u64::from(u32::MAX), "STL counts its triangles in 32 bits")),
            // Half as many vertices.
            Format::Glb => Some(((u64::from(u32::MAX) - 4096) / 28, "GLB files end at 4 GiB")),
            Format::ThreeMf => Some((1 << 31, "3MF counts its triangles in 31 bits")),
            Format::Ply | Format::Obj => None,
        }
    }

    /// Begins a file.
    pub(super) fn encoder(self, target: &Target, head: &Head) -> io::Result<Box<dyn Encoder>> {
        let file = || Ok::<_, io::Error>(BufWriter::with_capacity(BUFFER, Output::new(target)?));
        Ok(match self {
            Format::Ply => Box::new(ply::Ply::new(file()?, head)?),
            Format::Obj => Box::new(obj::Obj::new(file()?, head)?),
            Format::Stl => Box::new(stl::Stl::new(file()?, head)?),
            Format::Glb => Box::new(glb::Glb::new(file()?, head)?),
            Format::ThreeMf => Box::new(threemf::ThreeMf::new(file()?, head)?),
        })
    }
}

/// A file in the making.
type File = BufWriter<Output>;

/// Corners of a triangle in space.
pub(super) type Facet = [[f32; 3]; 3];

/// Writes a mesh: first all vertices, then all triangles; or, of formats that know no vertices, all facets.
pub(super) trait Encoder {
    /// Takes the next vertices.
    fn vertices(&mut self, vertices: &[Vertex]) -> io::Result<()>;
    /// Takes the next triangles.
    fn triangles(&mut self, triangles: &[Triangle]) -> io::Result<()>;
    /// Takes the next facets, while vertices come.
    fn facets(&mut self, _: &[Facet]) -> io::Result<()> {
        Ok(())
    }
    /// Whether it takes facets, and neither vertices nor triangles.
    fn takes_facets(&self) -> bool {
        false
    }
    /// Gives the file its name.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// Ends a file whose bytes are all there.
fn commit(file: File) -> io::Result<()> {
    file.into_inner().map_err(io::IntoInnerError::into_error)?.commit()
}

/// Writes numbers of single precision, the lowest byte first.
fn write_floats(file: &mut impl Write, numbers: &[f32]) -> io::Result<()> {
    numbers.iter().try_for_each(|number| file.write_all(&number.to_le_bytes()))
}
