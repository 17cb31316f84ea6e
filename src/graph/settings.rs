//! How orbits are iterated: the settings of a fractal file.

use serde::{Deserialize, Serialize};

use super::NodeRef;
use super::escape::Escape;
use crate::diag::Span;

/// Which constant is added after each iteration. Fixed ones have a fourth component, which is 0 if the state has three.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Constant {
    /// The point.
    Mandelbrot,
    /// A fixed one.
    Julia([f64; 4]),
    /// `(1 - amount)` times the point plus `amount` times a fixed one.
    Mix([f64; 4], f64),
    /// None.
    Off,
}

impl Constant {
    /// The fixed point in it, with a fourth component that is not 0 only where the state needs four.
    pub fn fixed(self) -> Option<[f64; 4]> {
        match self {
            Constant::Julia(point) | Constant::Mix(point, _) => Some(point),
            Constant::Mandelbrot | Constant::Off => None,
        }
    }

    /// How much of the point is in it: the "+1" of the running derivative.
    pub fn start_weight(self) -> f64 {
        match self {
            Constant::Mandelbrot => 1.0,
            Constant::Mix(_, amount) => 1.0 - amount,
            Constant::Julia(_) | Constant::Off => 0.0,
        }
    }
}

/// How a distance is estimated from an orbit.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Method {
    /// The steps' own rules composed.
    Scalar,
    /// The exact gradient of r, by differentiating the graph.
    Gradient,
    /// The largest singular value of the Jacobian: how much any direction is stretched.
    Jacobian,
    /// The root of the sum of the Jacobian's squares: from 1 to 1.74 times the largest singular value.
    Frobenius,
    /// The smaller of scalar and gradient.
    Combined,
    /// The length of J d: how much the ray's own direction is stretched.
    Directional,
    /// Finite differences along the three axes, at equal iteration count (Makin/Buddhi).
    Delta,
    /// One finite difference, along the ray.
    DeltaRay,
    /// G / 2 |grad G| with the potential G = ln r / power^n (Quilez, with the half).
    Potential,
    /// e^-G sinh G / 2 |grad G| (Christensen).
    Sinh,
    /// The node's own distance: primitives.
    Own,
    /// A proof: the segment of the ray around the point that holds nothing of the set.
    Certified,
    /// A proof: the ball around the point that holds nothing of the set.
    CertifiedBall,
}

impl Method {
    /// All methods, in the order of listings.
    pub const ALL: [Method; 13] = [
        Method::Scalar,
        Method::Gradient,
        Method::Jacobian,
        Method::Frobenius,
        Method::Combined,
        Method::Directional,
        Method::Delta,
        Method::DeltaRay,
        Method::Potential,
        Method::Sinh,
        Method::Own,
        Method::Certified,
        Method::CertifiedBall,
    ];

    /// True for methods that prove what they say.
    pub const fn is_certified(self) -> bool {
        matches!(self, Method::Certified | Method::CertifiedBall)
    }

    /// The name in files, flags and listings.
    pub const fn name(self) -> &'static str {
        match self {
            Method::Scalar => "scalar",
            Method::Gradient => "gradient",
            Method::Jacobian => "jacobian",
            Method::Frobenius => "frobenius",
            Method::Combined => "combined",
            Method::Directional => "directional",
            Method::Delta => "delta",
            Method::DeltaRay => "delta-ray",
            Method::Potential => "potential",
            Method::Sinh => "sinh",
            Method::Own => "own",
            Method::Certified => "certified",
            Method::CertifiedBall => "certified-ball",
        }
    }

    /// What it is, in a few words.
    pub const fn summary(self) -> &'static str {
        match self {
            Method::Scalar => "the steps' own derivative rules",
            Method::Gradient => "the exact gradient of r",
            Method::Jacobian => "the largest singular value of the Jacobian",
            Method::Frobenius => "the Frobenius norm of the Jacobian, a cheap bound of `jacobian`",
            Method::Combined => "the smaller of scalar and gradient",
            Method::Directional => "the stretch along the ray",
            Method::Delta => "finite differences along the three axes",
            Method::DeltaRay => "one finite difference, along the ray",
            Method::Potential => "half the potential over its gradient",
            Method::Sinh => "the potential with a hyperbolic sine, safe far away",
            Method::Own => "the distance that primitives have themselves",
            Method::Certified => "a proof: the segment of the ray that holds nothing of the set",
            Method::CertifiedBall => "a proof: the ball that holds nothing of the set",
        }
    }

    /// Whether it takes finite differences, and so needs a step for them.
    pub const fn is_difference(self) -> bool {
        matches!(self, Method::Delta | Method::DeltaRay)
    }

    /// Whether it differentiates the graph.
    pub const fn is_exact(self) -> bool {
        !matches!(self, Method::Scalar | Method::Delta | Method::DeltaRay | Method::Own) && !self.is_certified()
    }

    /// Whether it is a form of its own, made of the potential.
    pub const fn is_potential(self) -> bool {
        matches!(self, Method::Potential | Method::Sinh)
    }
}

/// How the end state and its derivative become a distance.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum DeForm {
    /// `(r - radius) / dr`, for orbits that grow by a factor.
    Linear,
    /// `r ln r / 2 dr`, for orbits that grow by a power.
    Logarithmic,
    /// `(largest component of z - radius) / dr`: the distance to a cube of half side `radius`, for attractors that are
    /// boxes. Orbits that do not escape are inside only where they end in the cube.
    Box,
    /// `(distance of z from the plane through 0 across axis - radius) / dr`, for orbits that need not escape, such as those
    /// of pseudo-Kleinian systems. Such an orbit is inside only where it ends in the slab.
    Plane,
    /// `distance of z from the orbit's end shape / dr`. No choice: orbits with an end shape have it, others do not.
    End,
}

impl DeForm {
    /// All forms that may be chosen, in the order of listings.
    pub const ALL: [DeForm; 4] = [DeForm::Linear, DeForm::Logarithmic, DeForm::Box, DeForm::Plane];

    /// The name in files, flags and listings.
    pub const fn name(self) -> &'static str {
        match self {
            DeForm::Linear => "linear",
            DeForm::Logarithmic => "logarithmic",
            DeForm::Box => "box",
            DeForm::Plane => "plane",
            DeForm::End => "end",
        }
    }

    /// What it is for, in a few words.
    pub const fn summary(self) -> &'static str {
        match self {
            DeForm::Linear => "(r - radius) / dr, for orbits that grow by a factor",
            DeForm::Logarithmic => "r ln r / 2 dr, for orbits that grow by a power",
            DeForm::Box => "distance to a cube, for attractors that are boxes",
            DeForm::Plane => "distance to a plane, for orbits that need not escape",
            DeForm::End => "distance to the end shape",
        }
    }

    /// Whether the form is that of an end shape, which decides membership of orbits that have not escaped.
    pub const fn is_shape(self) -> bool {
        matches!(self, DeForm::Box | DeForm::Plane | DeForm::End)
    }
}

/// What finite differences are taken of.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Difference {
    /// r.
    R,
    /// ln r, turned back into a slope of r: its window of usable steps is far wider where r grows by a power.
    LnR,
    /// The vector z: the length of its change, or the largest singular value of all three changes.
    Z,
}

impl Difference {
    /// All of them, in the order of listings.
    pub const ALL: [Difference; 3] = [Difference::R, Difference::LnR, Difference::Z];

    /// The name in files, flags and listings.
    pub const fn name(self) -> &'static str {
        match self {
            Difference::R => "r",
            Difference::LnR => "ln-r",
            Difference::Z => "z",
        }
    }
}

/// The step of finite differences, before the precision's least step.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub enum DifferenceStep {
    /// A share of the last estimate.
    Share(f64),
    /// A length in world units.
    Fixed(f64),
}

impl Default for DifferenceStep {
    /// A hundredth: larger steps see beyond the surface, smaller ones lose digits.
    fn default() -> Self {
        DifferenceStep::Share(0.01)
    }
}

impl DifferenceStep {
    /// The step at a point whose last estimate is `de`; `least` stands in where it is unknown, below that, or so large as near
    /// critical points alone, which says nothing.
    pub fn length(self, de: f64, least: f64) -> f64 {
        const MOST: f64 = 1e6;
        let wanted = match self {
            DifferenceStep::Share(share) => de * share,
            DifferenceStep::Fixed(step) => step,
        };
        if wanted < MOST { wanted.max(least) } else { least }
    }
}

/// Shortest step of a march where nothing else is asked for, as a share of the hit threshold. With a quarter, brute force
/// found few features that the march had stepped over (of the power-8 bulb's hits 0 to 3 % where whole thresholds lost
/// 5 %), for a tenth more estimates at most.
pub const LEAST_STEP: f64 = 0.25;

/// The same of a march of proofs, which walks at this step where nothing is proven. Of 26 systems quarters passed over
/// thin features of six, eighths of one; of 12,000 hits at 640x360 16ths and 64ths passed over a few in a thousand, these
/// over none. They cost no more: what the walk takes longer, shorter proofs save.
pub const LEAST_STEP_OF_PROOFS: f64 = 1.0 / 128.0;

/// Longest steps that may be asked for, in hit thresholds.
pub const MOST_STEPS: [f64; 2] = [0.01, 1e6];

/// The estimate below which a ray stops.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub enum StopAt {
    /// In pixels, from 0.001 to 100: it grows with the distance.
    Pixels(f64),
    /// In world units, above 0 and at most 1e6.
    World(f64),
}

impl StopAt {
    /// Pixels that a ray may stop at.
    pub const PIXELS: [f64; 2] = [1e-3, 100.0];
    /// World units.
    pub const WORLD: [f64; 2] = [1e-12, 1e6];

    /// Reads a number of pixels, such as `0.5`, or of world units, such as `0.01u`. The error says what is expected.
    pub fn parse(text: &str) -> Result<StopAt, String> {
        let (number, make, [least, most]): (&str, fn(f64) -> StopAt, [f64; 2]) = match text.trim().strip_suffix('u') {
            Some(number) => (number, StopAt::World, StopAt::WORLD),
            None => (text, StopAt::Pixels, StopAt::PIXELS),
        };
        match number.trim().parse::<f64>() {
            Ok(number) if (least..=most).contains(&number) => Ok(make(number)),
            Ok(_) => Err(format!("it must be from {least} to {most}")),
            Err(_) => Err("write pixels such as 0.5, or world units such as 0.01u".to_string()),
        }
    }
}

/// What a file fixes about the estimate; `None` is chosen automatically.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct EstimateSettings {
    /// Method.
    pub method: Option<Method>,
    /// Form.
    pub form: Option<DeForm>,
    /// Radius of the linear form (of a ball around the attractor), half side of the box, half thickness of the plane; in
    /// the final frame.
    pub radius: Option<f64>,
    /// Unit normal of the plane form.
    pub axis: Option<[f64; 3]>,
    /// Step multiplier in (0, 1].
    pub fudge: Option<f64>,
    /// What finite differences are taken of.
    pub difference: Option<Difference>,
    /// Step of finite differences.
    pub step: Option<DifferenceStep>,
    /// Shortest step of a march, as a share of the hit threshold, in (0, 1].
    pub least_step: Option<f64>,
    /// Longest step of a march in hit thresholds, from 0.01 to 1e6; `None` is as long as the estimate.
    pub most_step: Option<f64>,
    /// Whether orbits run on until they escape, even where a pixel shows nothing of what they would still do.
    pub late_ends: Option<bool>,
    /// Estimate below which a ray stops; `None` stops at members of the set alone.
    pub stop_at: Option<StopAt>,
    /// What the choice goes for besides the error budget.
    pub quality: Option<Quality>,
    /// Rows of the picture that these were measured on, where they are the outcome of a calibration.
    pub calibrated: Option<u32>,
}

/// What a choice of an estimate goes for besides the error budget.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Quality {
    /// Steps that are proven, at any price.
    Proof,
}

/// Rows of the picture that `calibrated: true` stands for: the default of `calibrate`, which is that of `render`.
pub const CALIBRATED_ROWS: u32 = 720;
/// How many times as fine as those that a choice was measured on pixels may be.
const FINER: u32 = 2;

impl EstimateSettings {
    /// These settings where they are given, else those of `other`.
    pub fn or(self, other: EstimateSettings) -> EstimateSettings {
        EstimateSettings {
            method: self.method.or(other.method),
            form: self.form.or(other.form),
            radius: self.radius.or(other.radius),
            axis: self.axis.or(other.axis),
            fudge: self.fudge.or(other.fudge),
            difference: self.difference.or(other.difference),
            step: self.step.or(other.step),
            least_step: self.least_step.or(other.least_step),
            most_step: self.most_step.or(other.most_step),
            late_ends: self.late_ends.or(other.late_ends),
            stop_at: self.stop_at.or(other.stop_at),
            quality: self.quality.or(other.quality),
            calibrated: self.calibrated.or(other.calibrated),
        }
    }

    /// Whether these are a calibration's outcome that does not hold for pictures of so many rows.
    pub fn is_too_coarse_for(&self, rows: u32) -> bool {
        self.calibrated.is_some_and(|measured| rows > measured.saturating_mul(FINER))
    }
}

/// The escape radius of orbits with an end shape that give none: none escapes.
pub const NO_ESCAPE: f64 = 1e18;

/// A field that the orbit's end is looked up in.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct EndShape {
    /// The field, in formula units: where it is not above 0 at z, the start point is in.
    pub field: NodeRef,
    /// Levels that it is looked up at; at the end alone where absent.
    pub levels: Option<Levels>,
}

/// At which levels of an orbit a field is looked up: before any iteration (0), after the first (1) and so on to the end.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Levels {
    /// First level.
    pub from: u32,
    /// How levels are joined.
    pub join: Join,
}

/// How the levels of a field are joined.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Join {
    /// What is in at any level.
    Union,
    /// What is in at all levels.
    Intersection,
    /// The first level without the others.
    Difference,
    /// A union whose seams are rounded with this radius, in units of the orbit's frame.
    SmoothUnion(f64),
}

/// Who says how many iterations an orbit has at most.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum IterationLimit {
    /// The file: no view asks for more.
    Stated,
    /// A built-in file, for its own view: closer views may ask for more.
    OfOwnView,
    /// The view.
    OfView,
}

/// How an orbit is iterated.
#[derive(Clone, PartialEq, Debug)]
pub struct OrbitSettings {
    /// What is added after each iteration.
    pub constant: Constant,
    /// Maps applied to the point before the first iteration.
    pub pre: Vec<NodeRef>,
    /// Maps applied to the state after the last one, before the distance is taken.
    pub post: Vec<NodeRef>,
    /// The state before the first iteration, apart from the constant; the point itself where absent.
    pub start: Option<[f64; 4]>,
    /// What ends an orbit.
    pub escape: Escape,
    /// The number that the escape test compares with: r is above this, where nothing else is asked for.
    pub escape_radius: f64,
    /// Iterations after which a point is inside.
    pub max_iterations: u32,
    /// Who says how many.
    pub limit: IterationLimit,
    /// Value of the point's w where the state has four components.
    pub slice: f64,
    /// Where one of these settings has four components.
    pub four: Option<Span>,
    /// The field that decides what is inside; replaces the escape test.
    pub shape: Option<EndShape>,
    /// What is fixed about the estimate.
    pub estimate: EstimateSettings,
}

impl Default for OrbitSettings {
    fn default() -> Self {
        OrbitSettings {
            constant: Constant::Mandelbrot,
            pre: Vec::new(),
            post: Vec::new(),
            start: None,
            escape: Escape::Length,
            escape_radius: 30.0,
            max_iterations: 20,
            limit: IterationLimit::OfView,
            slice: 0.0,
            four: None,
            shape: None,
            estimate: EstimateSettings::default(),
        }
    }
}

impl OrbitSettings {
    /// The radius of the linear form that fits a set which reaches `extent` from its origin: never so large that the form says 0
    /// right where orbits escape. Of convergence it is that of a ball around the point which is known to converge.
    pub fn linear_radius(&self, extent: f64, width: u8) -> f64 {
        let bound = self.escape_radius * self.escape.scale(width);
        if self.escape.is_convergence() || bound <= 0.0 { bound } else { extent.min(bound * 0.5) }
    }

    /// Lets orbits run on to their last iteration.
    pub fn never_escape(&mut self) {
        (self.escape, self.escape_radius) = (Escape::Length, NO_ESCAPE);
    }
}
