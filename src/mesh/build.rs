//! Makes a mesh of a body and writes it.

use super::blocks::Blocks;
use super::field::{Ball, Body, Field, Kernels, Look};
use super::format::{Encoder, Facet, Format, Head};
use super::hollow::Cavity;
use super::report::{Report, Tally};
use super::simplify::Mesh;
use super::surface::{Placing, Shell, Triangle, Vertex, too_many};
use super::{Grid, Point, Progress, Trouble};
use crate::files::Target;
use crate::kernel::{Backend, BackendError};

/// A mesh that is wanted.
#[derive(Clone, Debug)]
pub struct Order {
    /// What it is of.
    pub name: String,
    /// The points.
    pub grid: Grid,
    /// Distance of the fractal's members up to which points belong to the body, in cells; 0 takes the members alone.
    pub thickness: f64,
    /// Length that the mesh's longest edge is to have, in millimetres; `None` leaves lengths in units of the world.
    pub longest_mm: Option<f64>,
    /// Thickness of the wall of a body that is made hollow, in millimetres; only with `longest_mm`.
    pub wall_mm: Option<f64>,
    /// Share of the triangles that is to stay, above 0; 1 keeps all, and holds no mesh as a whole.
    pub share: f64,
    /// What it is written as.
    pub format: Format,
    /// Whether what printers ask is looked for.
    pub printability: bool,
}

/// A mesh that was made.
#[derive(Clone, PartialEq, Debug)]
pub struct Made {
    /// What is known of it.
    pub report: Report,
    /// Bytes that its signs and numbers took.
    pub held: u64,
    /// Whether there is a cavity in it.
    pub is_hollow: bool,
}

/// Makes a mesh and writes it.
///
/// Errors: the back end's, the file's; a body of which nothing is in the grid; more vertices or triangles than the format can count.
pub fn make<B: Backend>(
    order: &Order,
    (kernels, backend): (&Kernels, &B),
    target: &Target,
    progress: &mut Progress,
) -> Result<Made, Trouble> {
    let grid = order.grid;
    let body = Body::new(kernels, backend, grid.region, (order.thickness * grid.cell, grid.cell))?;
    let outer = Shell::new(Blocks::new(grid, &body, progress)?)?;
    if outer.triangles == 0 {
        return Err(nothing());
    }
    let placing = placing(order, &outer, &body)?;
    let cavity = order.wall_mm.map(|wall| Cavity::new(&grid, &body, wall / placing.scale, progress)).transpose()?;
    let inner = cavity.as_ref().map(|cavity| cavity.shell(progress)).transpose()?.flatten();
    let mut parts = vec![Part { shell: &outer, field: &body, first: 0, is_inner: false }];
    if let (Some(shell), Some(cavity)) = (&inner, &cavity) {
        let first =
            u32::try_from(outer.vertices() + shell.vertices()).map_err(|_| too_many())? - shell.vertices() as u32;
        parts.push(Part { shell, field: cavity, first, is_inner: true });
    }
    let (counts, tally) = written(order, &parts, &placing, target, progress)?;
    let shares = outer.blocks.shares;
    let solid = Hollowed { body: &body, cavity: inner.as_ref().and(cavity.as_ref()) };
    let report = tally.finish(&solid, (&grid, &placing), counts, (order.thickness, &shares))?;
    let held = parts.iter().map(|part| part.shell.bytes()).sum();
    Ok(Made { report, held, is_hollow: inner.is_some() })
}

/// Writes the parts of a mesh; gives the vertices and triangles that came out, and sums over them.
fn written(
    order: &Order,
    parts: &[Part],
    placing: &Placing,
    target: &Target,
    progress: &mut Progress,
) -> Result<((u64, u64), Tally), Trouble> {
    let with_looks = order.format.has_looks() || order.printability;
    let simple = match order.share < 1.0 {
        true => Some(simplified(order.share, parts, (placing, with_looks), progress)?),
        false => None,
    };
    let (vertices, triangles) = match &simple {
        Some(mesh) => (mesh.vertices.len() as u64, mesh.triangles.len() as u64),
        None => {
            let of = |count: fn(&Shell) -> u64| parts.iter().map(|part| count(part.shell)).sum();
            (of(Shell::vertices), of(|shell| shell.triangles))
        }
    };
    refuse(order.format, triangles)?;
    let head = Head { vertices, triangles, is_mm: order.longest_mm.is_some(), name: order.name.clone() };
    let mut encoder = order.format.encoder(target, &head)?;
    let mut tally = Tally::new(vertices, order.printability);
    match &simple {
        Some(mesh) => write_whole(mesh, placing, (&mut *encoder, &mut tally))?,
        None => write(parts, (placing, with_looks), (&mut *encoder, &mut tally), progress)?,
    }
    encoder.finish()?;
    Ok(((vertices, triangles), tally))
}

/// A mesh with a share of its triangles.
fn simplified(share: f64, parts: &[Part], looks: (&Placing, bool), progress: &mut Progress) -> Result<Mesh, Trouble> {
    let mut mesh = Mesh::default();
    write(parts, looks, (&mut mesh, &mut Tally::new(0, false)), progress)?;
    Ok(mesh.simplified(share))
}

/// Passes a mesh on that is held as a whole.
fn write_whole(
    mesh: &Mesh,
    placing: &Placing,
    (encoder, tally): (&mut dyn Encoder, &mut Tally),
) -> Result<(), Trouble> {
    let corner = |number: u32| mesh.vertices[number as usize].position;
    tally.vertices(0, &mesh.vertices, placing);
    tally.triangles(&mesh.triangles, corner);
    encoder.vertices(&mesh.vertices)?;
    if encoder.takes_facets() {
        let facets: Vec<Facet> = mesh.triangles.iter().map(|triangle| triangle.map(corner)).collect();
        encoder.facets(&facets)?;
    }
    Ok(encoder.triangles(&mesh.triangles)?)
}

/// A surface of a mesh.
pub(super) struct Part<'a> {
    pub shell: &'a Shell,
    pub field: &'a dyn Field,
    /// The number of its first vertex.
    pub first: u32,
    /// Whether the body is around it.
    pub is_inner: bool,
}

impl Part<'_> {
    /// The triangles of a layer, as the mesh numbers their corners.
    fn triangles(&self, z: u32) -> Vec<Triangle> {
        let mut triangles = self.shell.layer_triangles(z);
        for triangle in &mut triangles {
            triangle.iter_mut().for_each(|corner| *corner += self.first);
            if self.is_inner {
                triangle.swap(1, 2);
            }
        }
        triangles
    }
}

/// A body, or what a cavity leaves of it.
struct Hollowed<'a> {
    body: &'a dyn Field,
    cavity: Option<&'a Cavity>,
}

impl Field for Hollowed<'_> {
    fn inside(&self, points: &[Point]) -> Result<Vec<bool>, BackendError> {
        let inside = self.body.inside(points)?;
        match self.cavity {
            None => Ok(inside),
            Some(cavity) => {
                Ok(inside.into_iter().zip(cavity.inside(points)?).map(|(body, hole)| body && !hole).collect())
            }
        }
    }

    fn balls(&self, points: &[Point], radius: f64) -> Result<Vec<Ball>, BackendError> {
        self.body.balls(points, radius)
    }

    fn looks(&self, points: &[Point]) -> Result<Vec<Look>, BackendError> {
        self.body.looks(points)
    }
}

/// Refuses a mesh of too many triangles.
fn refuse(format: Format, triangles: u64) -> Result<(), Trouble> {
    match format.most() {
        Some((most, why)) if triangles > most => Err(Trouble::Refused {
            text: format!("{why}, and the mesh has {triangles}"),
            help: "write a .ply, or take a smaller --resolution".into(),
        }),
        _ => Ok(()),
    }
}

/// The refusal of a body of which nothing is in a grid.
pub(super) fn nothing() -> Trouble {
    Trouble::Refused {
        text: "no point of the grid is in the body, so there is no surface".into(),
        help: "take another --region or a larger --resolution, or thicken thin sets: `--thicken 1`".into(),
    }
}

/// Where the mesh is put: in the world's place, or around the origin and in millimetres.
fn placing(order: &Order, shell: &Shell, field: &dyn Field) -> Result<Placing, Trouble> {
    let Some(longest) = order.longest_mm else { return Ok(Placing { middle: [0.0; 3], scale: 1.0 }) };
    let [low, high] = shell.extent(field)?;
    let edge = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    Ok(Placing { middle: [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0), scale: longest / edge })
}

/// Passes a mesh on, layer by layer: first all vertices, then all triangles.
pub(super) fn write(
    parts: &[Part],
    looks: (&Placing, bool),
    (encoder, tally): (&mut dyn Encoder, &mut Tally),
    progress: &mut Progress,
) -> Result<(), Trouble> {
    for part in parts {
        write_vertices(part, looks, (encoder, tally), progress)?;
    }
    if encoder.takes_facets() {
        return Ok(());
    }
    for part in parts {
        for z in 0..part.shell.layers() {
            progress.advance(0)?;
            encoder.triangles(&part.triangles(z))?;
        }
    }
    Ok(())
}

/// Passes the vertices of a part on, and the facets where these are taken.
fn write_vertices(
    part: &Part,
    looks: (&Placing, bool),
    (encoder, tally): (&mut dyn Encoder, &mut Tally),
    progress: &mut Progress,
) -> Result<(), Trouble> {
    let shell = part.shell;
    // The vertices of the layer below and this one.
    let (mut first, mut window) = (part.first, Vec::<Vertex>::new());
    for z in 0..=shell.layers() {
        if z < shell.layers() {
            let next = shell.layer_vertices(z, part.field, looks, progress)?;
            tally.vertices(part.first + shell.first_vertex(z), &next, looks.0);
            encoder.vertices(&next)?;
            window.extend(next);
        }
        let Some(below) = z.checked_sub(1) else { continue };
        let triangles = part.triangles(below);
        let corner = |number: u32| window[(number - first) as usize].position;
        tally.triangles(&triangles, corner);
        if encoder.takes_facets() {
            let facets: Vec<Facet> = triangles.iter().map(|triangle: &Triangle| triangle.map(corner)).collect();
            encoder.facets(&facets)?;
        }
        let end = part.first + shell.first_vertex(z);
        window.drain(..(end - first) as usize);
        first = end;
    }
    Ok(())
}

/// Takes everything and keeps nothing.
pub(super) struct Nowhere;

impl Encoder for Nowhere {
    fn vertices(&mut self, _: &[Vertex]) -> std::io::Result<()> {
        Ok(())
    }

    fn triangles(&mut self, _: &[Triangle]) -> std::io::Result<()> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> std::io::Result<()> {
        Ok(())
    }
}
