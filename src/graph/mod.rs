//! The graph: a fractal as nodes and wires, after its file was read and before anything is computed.
//!
//! In comes the value tree of a RON file or script ([`read()`]); out comes a [`ValidGraph`]: every name is known, every
//! parameter in its range, there is no cycle, maps and distance fields stand where they belong. Whatever takes a
//! `ValidGraph` need not fail for the user's mistakes any more (except errors inside a step's own script).

mod budget;
mod clip;
pub(crate) mod escape;
mod nodes;
mod objects;
mod overrides;
mod presets;
pub mod print;
mod read;
pub(crate) mod scene;
mod schedule;
pub mod script;
mod settings;
mod tests_of_formula;
mod validate;
mod widths;

pub use escape::Escape;
pub use objects::{Imports, MOST_OBJECTS, Wanted, wanted};
pub use overrides::{Override, patched, place_of};
pub use presets::{PRESET, Preset, expand_presets, preset_values};
pub use read::read;
pub use scene::motion;
pub use scene::{
    Aperture, Atmosphere, Blend, By, Camera, Cone, CubeLayout, Curve, Encoding, Environment, Film, Glow, Layer, Lens,
    Light, LightKind, Look, MOST_LAYERS, Marks, MaterialUse, Paint, Palette, Part, Plane, SUN_ANGLE, Scene, Space,
    Spread, Stereo, StereoLayout, TRAPS, Trap, wanted_picture,
};
pub use schedule::{IterationMap, MapTree, Schedule, resolve_schedule};
pub use settings::{
    CALIBRATED_ROWS, Constant, DeForm, Difference, DifferenceStep, EndShape, EstimateSettings, IterationLimit, Join,
    LEAST_STEP, LEAST_STEP_OF_PROOFS, Levels, MOST_STEPS, Method, NO_ESCAPE, OrbitSettings, Quality, StopAt,
};
pub use tests_of_formula::{FormulaTest, Symmetry, TestKind, TestPoint};
pub use validate::ValidGraph;

use std::sync::Arc;

use crate::diag::Span;
use crate::formula::step::{ParamValue, Step};

/// A node's number in its graph.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct NodeRef(pub usize);

/// A formula: nodes, the settings of its orbits, its tests; and its default scene.
#[derive(Clone)]
pub struct Graph {
    /// Name; the file's where it gives none.
    pub name: String,
    /// One line about it.
    pub summary: String,
    /// Heading that listings show it under.
    pub group: String,
    /// Who found it, where that is known.
    pub inventor: String,
    /// When, where that is known.
    pub year: Option<u32>,
    /// Where it was published, and what this version changes.
    pub source: String,
    /// Parameters and their values.
    pub params: Vec<FractalParam>,
    /// All nodes, named and inline.
    pub nodes: Vec<Node>,
    /// The node that is drawn.
    pub output: NodeRef,
    /// How orbits that say nothing else are iterated.
    pub orbit: OrbitSettings,
    /// Radius of a ball around the origin that holds everything; found automatically where absent.
    pub bounding_radius: Option<f64>,
    /// Whether that is meant to cut off what is beyond.
    pub cuts: bool,
    /// What pictures show of it by default.
    pub scene: Scene,
    /// Named sets of values that the file offers.
    pub presets: Vec<Preset>,
    /// The file's own tests.
    pub tests: Vec<FormulaTest>,
}

/// A parameter of a fractal.
#[derive(Clone, Debug)]
pub struct FractalParam {
    /// Name.
    pub name: String,
    /// Value in use.
    pub value: f64,
    /// The file's default.
    pub default: f64,
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
    /// Unit.
    pub unit: String,
    /// What it does.
    pub help: String,
}

/// A node with its name and place.
#[derive(Clone)]
pub struct Node {
    /// Name; inline nodes are named for their owner and position.
    pub name: String,
    /// Place in the file.
    pub span: Span,
    /// What it is.
    pub kind: NodeKind,
}

/// A parameter given to a step.
#[derive(Clone, PartialEq, Debug)]
pub enum ParamInput {
    /// Known now.
    Known(ParamValue),
    /// An expression of the iteration number `n`.
    OfIteration(String),
}

/// What a node is: a map of the orbit state (up to `Item`), or a distance field.
#[derive(Clone)]
pub enum NodeKind {
    /// One step with its parameters, in the step's order.
    Step {
        /// The step.
        step: Arc<Step>,
        /// Its parameters, in the order of the step.
        params: Vec<ParamInput>,
    },
    /// Maps one after the other, within one iteration.
    Sequence(Vec<NodeRef>),
    /// A map several times, within one iteration.
    Repeat {
        /// What it is made of.
        of: NodeRef,
        /// How often.
        times: u32,
    },
    /// `(1 - weight) a + weight b`; `a` is the identity where absent.
    Blend {
        /// First part.
        a: Option<NodeRef>,
        /// Second part.
        b: NodeRef,
        /// Share of the second part.
        weight: f64,
    },
    /// One of two maps by a condition; `otherwise` is the identity where absent.
    Choose {
        /// Condition for the first map.
        when: Condition,
        /// First map.
        then: NodeRef,
        /// Other map.
        otherwise: Option<NodeRef>,
    },
    /// A map in iterations `from <= n < to`, another in the others.
    Between {
        /// What it is made of.
        of: NodeRef,
        /// First iteration.
        from: u32,
        /// First iteration after it.
        to: u32,
        /// Other map.
        otherwise: Option<NodeRef>,
    },
    /// Alternating maps, each for some iterations.
    Alternate(Vec<(NodeRef, u32)>),
    /// A map whose iterations add another constant than the orbit's.
    Item {
        /// What it is made of.
        of: NodeRef,
        /// What its iterations add.
        constant: Constant,
    },
    /// The distance field of an iterated map.
    Orbit {
        /// What it is made of.
        of: NodeRef,
        /// How it is iterated.
        settings: Box<OrbitSettings>,
    },
    /// A shape with a known distance.
    Primitive(Primitive),
    /// A shape of a step file, with its parameters in the file's order.
    Shape {
        /// The step file.
        step: Arc<Step>,
        /// Its parameters, in the order of the file.
        params: Vec<ParamInput>,
    },
    /// The nearest of several fields.
    Union(Vec<NodeRef>),
    /// What all fields share.
    Intersection(Vec<NodeRef>),
    /// The first field without the second.
    Difference {
        /// First part.
        a: NodeRef,
        /// Second part.
        b: NodeRef,
    },
    /// A union whose seams are rounded with this radius.
    SmoothUnion {
        /// What it is made of.
        of: Vec<NodeRef>,
        /// Radius.
        radius: f64,
    },
    /// A field scaled, then rotated, then moved.
    Transform {
        /// What it is made of.
        of: NodeRef,
        /// Where it stands.
        placement: Placement,
    },
    /// A field seen through a map of space.
    Warp {
        /// The field.
        of: NodeRef,
        /// The map: what it sends into the field is in.
        by: NodeRef,
    },
    /// Copies of a field side by side.
    Tile {
        /// The field, within its cell around the origin.
        of: NodeRef,
        /// Where the copies stand.
        tiling: Tiling,
    },
}

/// Copies of a field side by side.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Tiling {
    /// Distance of the copies along each axis; 0 along axes without copies.
    pub period: [f64; 3],
    /// Whether every second copy is mirrored, so that neighbours meet at their walls.
    pub mirror: bool,
}

/// When a [`NodeKind::Choose`] takes its first map.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Condition {
    /// `n` is below this.
    IterationBelow(u32),
    /// `n` is a multiple of this.
    IterationEvery(u32),
    /// r is below this.
    RadiusBelow(f64),
    /// r is above this.
    RadiusAbove(f64),
    /// This coordinate (0 is x) is negative.
    Negative(u8),
    /// This coordinate is positive.
    Positive(u8),
}

/// Shapes with a known distance; lengths in world units, directions of length 1.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Primitive {
    /// Ball or sphere.
    Sphere {
        /// Centre.
        centre: [f64; 3],
        /// Radius.
        radius: f64,
        /// What it is inside.
        form: SphereForm,
    },
    /// Box with half its edge lengths.
    Box {
        /// Centre.
        centre: [f64; 3],
        /// Half the edge lengths.
        half_size: [f64; 3],
    },
    /// Torus around the z axis.
    Torus {
        /// Centre.
        centre: [f64; 3],
        /// Radius of the ring.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// The half space below `offset` along `normal`.
    Plane {
        /// Unit normal.
        normal: [f64; 3],
        /// Distance of the plane from the origin along the normal.
        offset: f64,
    },
    /// Cylinder along the z axis.
    Cylinder {
        /// Centre.
        centre: [f64; 3],
        /// Radius.
        radius: f64,
        /// Half its height.
        half_height: f64,
    },
}

/// What the distance of a sphere is inside it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SphereForm {
    /// Negative inside.
    Signed,
    /// 0 inside.
    Solid,
    /// Positive inside: only the surface is there.
    Shell,
}

/// Where a field stands: scaled, rotated about `axis` by `angle` (radians), then moved.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Placement {
    /// Moved by this, in world units; the fourth component moves what has four.
    pub translate: [f64; 4],
    /// Rotation axis of length 1.
    pub axis: [f64; 3],
    /// Rotation angle in radians.
    pub angle: f64,
    /// Scale factor, > 0.
    pub scale: f64,
}

impl NodeKind {
    /// True for maps of the orbit state, false for distance fields.
    pub fn is_map(&self) -> bool {
        matches!(
            self,
            NodeKind::Step { .. }
                | NodeKind::Sequence(_)
                | NodeKind::Repeat { .. }
                | NodeKind::Blend { .. }
                | NodeKind::Choose { .. }
                | NodeKind::Between { .. }
                | NodeKind::Alternate(_)
                | NodeKind::Item { .. }
        )
    }

    /// The nodes it is wired to.
    pub fn wires(&self) -> Vec<NodeRef> {
        match self {
            NodeKind::Step { .. } | NodeKind::Primitive(_) | NodeKind::Shape { .. } => Vec::new(),
            NodeKind::Sequence(of) | NodeKind::Union(of) | NodeKind::Intersection(of) => of.clone(),
            NodeKind::SmoothUnion { of, .. } => of.clone(),
            NodeKind::Repeat { of, .. }
            | NodeKind::Item { of, .. }
            | NodeKind::Transform { of, .. }
            | NodeKind::Tile { of, .. } => vec![*of],
            NodeKind::Warp { of, by } => vec![*of, *by],
            NodeKind::Orbit { of, settings } => {
                let shape = settings.shape.map(|shape| shape.field);
                let maps = settings.pre.iter().chain(&settings.post).copied();
                std::iter::once(*of).chain(maps).chain(shape).collect()
            }
            NodeKind::Blend { a, b, .. } => a.iter().copied().chain([*b]).collect(),
            NodeKind::Choose { then, otherwise, .. } => [*then].into_iter().chain(*otherwise).collect(),
            NodeKind::Between { of, otherwise, .. } => [*of].into_iter().chain(*otherwise).collect(),
            NodeKind::Alternate(parts) => parts.iter().map(|(of, _)| *of).collect(),
            NodeKind::Difference { a, b } => vec![*a, *b],
        }
    }

    /// The name of its kind in files; a step's own name.
    pub fn keyword(&self) -> &str {
        match self {
            NodeKind::Step { step, .. } | NodeKind::Shape { step, .. } => &step.name,
            NodeKind::Sequence(_) => "Sequence",
            NodeKind::Repeat { .. } => "Repeat",
            NodeKind::Blend { .. } => "Blend",
            NodeKind::Choose { .. } => "Choose",
            NodeKind::Between { .. } => "Between",
            NodeKind::Alternate(_) => "Alternate",
            NodeKind::Item { .. } => "Item",
            NodeKind::Orbit { .. } => "Orbit",
            NodeKind::Primitive(Primitive::Sphere { .. }) => "Sphere",
            NodeKind::Primitive(Primitive::Box { .. }) => "Box",
            NodeKind::Primitive(Primitive::Torus { .. }) => "Torus",
            NodeKind::Primitive(Primitive::Plane { .. }) => "Plane",
            NodeKind::Primitive(Primitive::Cylinder { .. }) => "Cylinder",
            NodeKind::Union(_) => "Union",
            NodeKind::Intersection(_) => "Intersection",
            NodeKind::Difference { .. } => "Difference",
            NodeKind::SmoothUnion { .. } => "SmoothUnion",
            NodeKind::Transform { .. } => "Transform",
            NodeKind::Warp { .. } => "Warp",
            NodeKind::Tile { .. } => "Tile",
        }
    }
}

impl Graph {
    /// The node of this number.
    pub fn node(&self, of: NodeRef) -> &Node {
        &self.nodes[of.0]
    }
}
