//! How orbits are iterated and pictures are taken: the settings of a fractal file.

use super::NodeRef;

/// Which constant is added after each iteration.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Constant {
    /// The start point.
    Mandelbrot,
    /// A fixed one.
    Julia([f64; 3]),
    /// `(1 - amount)` times the start point plus `amount` times a fixed one.
    Mix([f64; 3], f64),
    /// None.
    Off,
}

impl Constant {
    /// How much of the start point is in it: the "+1" of the running derivative.
    pub fn start_weight(self) -> f64 {
        match self {
            Constant::Mandelbrot => 1.0,
            Constant::Mix(_, amount) => 1.0 - amount,
            Constant::Julia(_) | Constant::Off => 0.0,
        }
    }
}

/// How a distance is estimated from an orbit.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, PartialOrd, Ord)]
pub enum Method {
    /// The steps' own rules composed.
    Scalar,
    /// The exact gradient of r, by differentiating the graph.
    Gradient,
    /// The smaller of scalar and gradient.
    Combined,
    /// Finite differences of r at equal iteration count (Makin/Buddhi).
    Delta,
    /// A proof: the segment of the ray around the point that holds nothing of the set.
    Certified,
    /// A proof: the ball around the point that holds nothing of the set.
    CertifiedBall,
}

impl Method {
    /// All methods, in the order of listings.
    pub const ALL: [Method; 6] = [
        Method::Scalar,
        Method::Gradient,
        Method::Combined,
        Method::Delta,
        Method::Certified,
        Method::CertifiedBall,
    ];

    /// True for methods that prove what they say.
    pub fn is_certified(self) -> bool {
        matches!(self, Method::Certified | Method::CertifiedBall)
    }

    /// The name in files, flags and listings.
    pub fn name(self) -> &'static str {
        match self {
            Method::Scalar => "scalar",
            Method::Gradient => "gradient",
            Method::Combined => "combined",
            Method::Delta => "delta",
            Method::Certified => "certified",
            Method::CertifiedBall => "certified-ball",
        }
    }
}

/// How r and its derivative become a distance.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum DeForm {
    /// `(r - radius) / dr`, for orbits that grow by a factor.
    Linear,
    /// `r ln r / 2 dr`, for orbits that grow by a power.
    Logarithmic,
}

impl DeForm {
    /// The name in files, flags and listings.
    pub fn name(self) -> &'static str {
        match self {
            DeForm::Linear => "linear",
            DeForm::Logarithmic => "logarithmic",
        }
    }
}

/// What a file fixes about the estimate; `None` is chosen automatically.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct EstimateSettings {
    /// Method.
    pub method: Option<Method>,
    /// Form.
    pub form: Option<DeForm>,
    /// Radius of the linear form: of a ball around the attractor, in the final frame.
    pub radius: Option<f64>,
    /// Step multiplier in (0, 1].
    pub fudge: Option<f64>,
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
    /// An orbit has escaped when r is above this.
    pub escape_radius: f64,
    /// Iterations after which a point is inside.
    pub max_iterations: u32,
    /// Start value of w where the state has four components.
    pub slice: f64,
    /// What is fixed about the estimate.
    pub estimate: EstimateSettings,
}

impl Default for OrbitSettings {
    fn default() -> Self {
        OrbitSettings {
            constant: Constant::Mandelbrot,
            pre: Vec::new(),
            post: Vec::new(),
            escape_radius: 30.0,
            max_iterations: 20,
            slice: 0.0,
            estimate: EstimateSettings::default(),
        }
    }
}

/// A perspective camera.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Camera {
    /// Position in world units.
    pub position: [f64; 3],
    /// The point in the middle of the picture.
    pub target: [f64; 3],
    /// Roughly upwards.
    pub up: [f64; 3],
    /// Angle from the bottom to the top of the picture, in radians.
    pub fov: f64,
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
    /// Base colour, and those that the traps of the origin and the planes x, y and z blend in.
    pub palette: [[f64; 3]; 5],
    /// Background at the bottom and the top of the picture.
    pub background: [[f64; 3]; 2],
    /// Share of light lost per unit of distance; 0 is no fog.
    pub fog: f64,
}

impl Default for Look {
    fn default() -> Self {
        Look {
            sun_direction: [-0.55, 0.75, 0.6],
            sun: [2.1, 1.9, 1.6],
            sky: [0.42, 0.55, 0.78],
            shadows: true,
            occlusion: 0.85,
            palette: [
                [0.72, 0.68, 0.60],
                [0.75, 0.36, 0.12],
                [0.10, 0.33, 0.55],
                [0.82, 0.58, 0.20],
                [0.30, 0.46, 0.28],
            ],
            background: [[0.035, 0.045, 0.065], [0.16, 0.21, 0.29]],
            fog: 0.0,
        }
    }
}
