//! Light and colour: what a picture's surfaces look like.

use super::fields::read_colours;
use super::paint::{Layer, Marks, Paint, Spread, read_paint};
use super::traps::{TRAPS, Trap, read_traps};
use crate::colour::palettes;
use crate::diag::Span;
use crate::formula::decode::{Fields, entries};
use crate::formula::value::{Value, ValueKind};
use crate::graph::read::Reader;
use crate::graph::{Node, NodeKind, NodeRef};

/// A part of the picture with a look of its own.
#[derive(Clone, PartialEq, Debug)]
pub struct Part {
    /// Its node: a field, or the map of an orbit.
    pub node: NodeRef,
    /// Place of its name in the file.
    pub span: Span,
    /// Its colours and what it is made of.
    pub paint: Paint,
}

/// Light and colour. Colours are linear RGB.
#[derive(Clone, PartialEq, Debug)]
pub struct Look {
    /// Direction towards the sun, in the camera's frame: right, up, back.
    pub sun_direction: [f64; 3],
    /// Colour times strength of the sun.
    pub sun: [f64; 3],
    /// Colour times strength of the sky.
    pub sky: [f64; 3],
    /// Whether the sun casts shadows.
    pub shadows: bool,
    /// Strength of ambient occlusion, 0 to 1.
    pub occlusion: f64,
    /// Greatest distance from which something darkens a corner, in world units; a share of the depth where absent.
    pub occlusion_radius: Option<f64>,
    /// Colours and matter of all that has none of its own.
    pub paint: Paint,
    /// What blends in the palette's colours behind its first, the first of them over the others.
    pub traps: [Option<Trap>; 4],
    /// Parts with colours of their own.
    pub parts: Vec<Part>,
    /// Background at the bottom and the top of the picture.
    pub background: [[f64; 3]; 2],
    /// Share of light lost per unit of distance; 0 is no fog.
    pub fog: f64,
}

impl Look {
    /// The paints of the picture: that of all that has none of its own, then those of its parts.
    pub fn paints(&self) -> impl Iterator<Item = &Paint> {
        std::iter::once(&self.paint).chain(self.parts.iter().map(|part| &part.paint))
    }

    /// The cuts of all layers that are used up evenly, in the order of [`Look::paints`].
    pub fn tones(&self) -> Vec<Vec<f64>> {
        let layers = self.paints().flat_map(|paint| &paint.layers);
        let cuts = |layer: &Layer| if let Spread::Quantile(cuts) = &layer.spread { Some(cuts.clone()) } else { None };
        layers.filter_map(cuts).collect()
    }

    /// The layers of all paints, in order.
    pub(in crate::graph) fn layers_mut(&mut self) -> impl Iterator<Item = &mut Layer> {
        let parts = self.parts.iter_mut().map(|part| &mut part.paint);
        std::iter::once(&mut self.paint).chain(parts).flat_map(|paint| &mut paint.layers)
    }

    /// The fields that are traps.
    pub fn trap_fields(&self) -> impl Iterator<Item = NodeRef> {
        self.traps.into_iter().filter_map(|trap| if let Some(Trap::Field(node)) = trap { Some(node) } else { None })
    }

    /// Whether surfaces say themselves what they are made of. Otherwise their traps mix the palette's colours, and that is all.
    pub fn is_painted(&self) -> bool {
        !self.parts.is_empty() || !self.paint.layers.is_empty() || self.paint.material.is_some()
    }

    /// Whether colours or matter depend on orbit traps.
    pub fn reads_traps(&self) -> bool {
        self.paints().any(|paint| paint.reads_traps(&self.traps))
    }

    /// What else of orbits colours and matter depend on.
    pub fn marks(&self) -> Marks {
        self.paints().fold(Marks::default(), |marks, paint| marks.with(paint))
    }

    /// The coordinates whose folds are followed.
    pub fn folds(&self) -> impl Iterator<Item = (usize, u8)> {
        let axis = |trap: &Option<Trap>| if let Some(Trap::LastFold(axis)) = trap { Some(*axis) } else { None };
        self.traps.iter().enumerate().filter_map(move |(i, trap)| Some((i, axis(trap)?)))
    }
}

impl Look {
    /// The look of a file that has none: a warm sun, a cool sky, and where surfaces have orbits, colours by how near these came to
    /// the origin, used up evenly by what the view shows.
    pub(super) fn of_none(has_orbits: bool) -> Look {
        let palette = palettes::named("patina").filter(|_| has_orbits);
        let layers = palette.map(|palette| Layer::new(palette.name.clone(), palette.gradient.clone()));
        Look {
            sun_direction: [-0.6, 0.8, 0.5],
            // Paler colours need less of it.
            sun: if has_orbits { [2.7, 2.3, 1.75] } else { [2.0, 1.75, 1.4] },
            sky: [0.40, 0.52, 0.74],
            occlusion: 0.9,
            background: [[0.045, 0.06, 0.075], [0.36, 0.43, 0.50]],
            paint: Paint { layers: layers.into_iter().collect(), ..Paint::default() },
            ..Look::default()
        }
    }
}

/// Whether all surfaces of a field, or of a map that is iterated, have orbits: shapes have none, but for those that cut.
pub(in crate::graph) fn has_orbits(nodes: &[Option<Node>], output: NodeRef) -> bool {
    // Nodes may be wired in circles before they are checked.
    let mut known = vec![None; nodes.len()];
    of_orbits(nodes, output, &mut known)
}

fn of_orbits(nodes: &[Option<Node>], of: NodeRef, known: &mut [Option<bool>]) -> bool {
    let Some(kind) = nodes.get(of.0).and_then(|node| node.as_ref()).map(|node| &node.kind) else { return false };
    if let Some(found) = known[of.0] {
        return found;
    }
    known[of.0] = Some(false);
    let mut are = |of: &NodeRef| of_orbits(nodes, *of, known);
    let found = match kind {
        NodeKind::Orbit { .. } => true,
        kind if kind.is_map() => true,
        NodeKind::Intersection(parts) => parts.iter().any(are),
        NodeKind::Difference { a, .. } => are(a),
        NodeKind::Transform { of, .. } | NodeKind::Tile { of, .. } | NodeKind::Warp { of, .. } => are(of),
        NodeKind::Union(parts) | NodeKind::SmoothUnion { of: parts, .. } => parts.iter().all(are),
        _ => false,
    };
    known[of.0] = Some(found);
    found
}

impl Default for Look {
    /// What a look leaves out.
    fn default() -> Self {
        Look {
            sun_direction: [-0.55, 0.75, 0.6],
            sun: [2.1, 1.9, 1.6],
            sky: [0.42, 0.55, 0.78],
            shadows: true,
            occlusion: 0.85,
            occlusion_radius: None,
            paint: Paint::default(),
            traps: TRAPS,
            parts: Vec::new(),
            background: [[0.035, 0.045, 0.065], [0.16, 0.21, 0.29]],
            fog: 0.0,
        }
    }
}

/// Reads `look: (...)`; what is not given is that of `base`.
pub(super) fn read_look(reader: &mut Reader, value: &Value, base: &Look) -> Option<Look> {
    let mut look = base.clone();
    let mut fields = Fields::new(value, "a look", reader.d)?;
    if let Some(v) = fields.optional_value("sun_direction") {
        look.sun_direction = reader.direction(v)?;
    }
    for (name, colour) in [("sun", &mut look.sun), ("sky", &mut look.sky)] {
        if let Some(v) = fields.optional_value(name) {
            *colour = reader.vector(v, 0.0, 100.0)?;
        }
    }
    look.shadows = fields.or("shadows", look.shadows, reader.d);
    if let Some(v) = fields.optional_value("occlusion") {
        look.occlusion = reader.number(v, 0.0, 1.0)?;
    }
    if let Some(v) = fields.optional_value("occlusion_radius") {
        look.occlusion_radius = Some(reader.number(v, 1e-9, 1e9)?);
    }
    if let Some(v) = fields.optional_value("fog") {
        look.fog = reader.number(v, 0.0, 100.0)?;
    }
    look.paint = read_paint(reader, &mut fields, &base.paint)?;
    if let Some(v) = fields.optional_value("traps") {
        look.traps = read_traps(reader, v)?;
    }
    if let Some(v) = fields.optional_value("parts") {
        for (name, value) in entries(v, "parts of the picture", reader.d) {
            let node = reader.wire(&Value::new(name.span, ValueKind::Str(name.text.clone())));
            let mut fields = Fields::new(value, "a part's look", reader.d)?;
            let paint = read_paint(reader, &mut fields, &look.paint);
            fields.finish(reader.d);
            look.parts.push(Part { node: node?, span: name.span, paint: paint? });
        }
    }
    if let Some(v) = fields.optional_value("background") {
        read_colours(reader, v, &mut look.background)?;
    }
    fields.finish(reader.d);
    Some(look)
}
