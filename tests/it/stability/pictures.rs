//! Whole pictures: cameras in awkward places, and numbers that are none.

use std::sync::Arc;

use bulbfold::check::Formula;
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::graph::{EstimateSettings, Method};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::math::Precision;
use bulbfold::render::{RenderSettings, Renderer, Stats, compose_pipeline};
use bulbfold::shade::Size;

use crate::support::{folder, formula};

const SIZE: Size = Size { width: 12, height: 8 };
const PIXELS: u64 = 96;

/// A ball of radius 1 as a Julia set, seen by a camera.
fn ball(position: &str, target: &str, rest: &str) -> String {
    format!(
        r#"(nodes: {{ "bulb": bulb_power(power: 8) }}, constant: Julia((0, 0, 0)), escape_radius: 10,
            max_iterations: 40, bounding_radius: 2, estimate: (form: logarithmic),
            camera: (position: {position}, target: {target}, fov: 40) {rest})"#
    )
}

struct Picture {
    precision: Precision,
    method: Method,
    depths: Vec<Option<f64>>,
    stats: Stats,
    rgb: Vec<u8>,
}

/// A tiny picture with every method that applies, in both precisions.
fn pictures(formula: &Formula) -> Vec<Picture> {
    let mut pictures = Vec::new();
    let subject = formula.subject();
    for method in Method::ALL.into_iter().filter(|m| subject.choices(Some(*m)).is_some()) {
        for precision in [Precision::F64, Precision::F32] {
            let settings = RenderSettings {
                size: SIZE,
                estimate: EstimateSettings { method: Some(method), ..EstimateSettings::default() },
                precision,
                ..RenderSettings::default()
            };
            let arena = Arc::new(Arena::default());
            let composer = Composer { arena: &arena, ..subject.composer() };
            let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|e| panic!("{}", e.message));
            let cpu = Cpu::new(precision);
            let mut renderer = Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap();
            let image = renderer.render(&mut |_| true).unwrap().expect("nobody stops it");
            let stats = renderer.stats.clone();
            let pixels: Vec<(u32, u32)> = (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (x, y))).collect();
            let depths = renderer.depths(&pixels).unwrap();
            assert_eq!(stats.rays, PIXELS);
            assert!(depths.iter().flatten().all(|depth| depth.is_finite()), "{method:?} {precision:?}: {depths:?}");
            pictures.push(Picture { precision, method, depths, stats, rgb: image.rgb });
        }
    }
    pictures
}

impl Picture {
    /// No pixel is black: NaN would be, the background and lit surfaces are not.
    fn has_no_black_pixel(&self) {
        for (i, pixel) in self.rgb.chunks(3).enumerate() {
            assert!(pixel != [0, 0, 0], "{:?} {:?}: pixel {i} is black", self.method, self.precision);
        }
    }

    /// Rays that ran out of steps and should not have.
    fn open_rays(&self) -> u64 {
        self.stats.unfinished - self.counted_as_open()
    }

    /// Rays of a march of proofs that ran out of steps, all counted as undecided. Beside the poles of a bulb directions
    /// are stretched P times as much as lengths, so balls there prove far less than the way to the surface.
    fn counted_as_open(&self) -> u64 {
        if self.method.is_certified() && self.stats.undecided >= Some(self.stats.unfinished) {
            self.stats.unfinished
        } else {
            0
        }
    }

    fn place(&self) -> String {
        format!("{:?} {:?}: {:?} {:?}", self.method, self.precision, self.stats, self.depths)
    }
}

pub fn camera_inside_the_set() {
    for picture in pictures(&formula(&ball("(0.1, 0.2, 0.3)", "(0, 5, 0)", ""))) {
        assert_eq!((picture.stats.hits, picture.stats.nan), (PIXELS, 0), "{}", picture.place());
        assert_eq!(picture.stats.estimates, PIXELS, "{}", picture.place());
        assert!(picture.depths.iter().all(|depth| *depth == Some(0.0)), "{}", picture.place());
        picture.has_no_black_pixel();
    }
}

pub fn camera_inside_the_bounding_sphere() {
    for picture in pictures(&formula(&ball("(0, -1.5, 0)", "(0, 0, 0)", ""))) {
        picture.has_no_black_pixel();
        assert_eq!((picture.stats.unfinished, picture.stats.nan), (0, 0), "{}", picture.place());
        // The middle four pixels look at the ball's front, half a unit away.
        for i in [41, 42, 53, 54] {
            let depth = picture.depths[i].unwrap_or_else(|| panic!("{}", picture.place()));
            assert!((depth - 0.5).abs() < 0.03, "{}", picture.place());
        }
    }
}

pub fn camera_on_the_surface() {
    for picture in pictures(&formula(&ball("(0, -1, 0)", "(0, 0, 0)", ""))) {
        assert_eq!((picture.stats.hits, picture.stats.nan), (PIXELS, 0), "{}", picture.place());
        assert!(picture.depths.iter().all(|d| d.is_some_and(|d| d < 1e-6)), "{}", picture.place());
        picture.has_no_black_pixel();
    }
    for picture in pictures(&formula(&ball("(0, -1.000001, 0)", "(0, -5, 0)", ""))) {
        assert_eq!((picture.stats.hits, picture.open_rays()), (0, 0), "{}", picture.place());
        assert!(picture.stats.nan == 0 || picture.method.is_difference(), "{}", picture.place());
        picture.has_no_black_pixel();
    }
}

pub fn zoom() {
    for height in [1e-5, 1e-9, 1e-13] {
        let position = format!("(0, {:?}, 0)", -1.0 - height);
        // What the position rounded to.
        let height = (1.0 + height) - 1.0;
        for picture in pictures(&formula(&ball(&position, "(0, 0, 0)", ""))) {
            picture.has_no_black_pixel();
            // A wide angle sees the horizon of nothing: every ray hits.
            assert_eq!(picture.stats.hits + picture.counted_as_open(), PIXELS, "{height} {}", picture.place());
            if picture.counted_as_open() > 0 {
                continue;
            }
            // A shifted point's orbit overflows single precision long before that of p escapes: counted, walked on from.
            assert!(picture.stats.nan == 0 || picture.method.is_difference(), "{height} {}", picture.place());
            // Differences have no digits left where steps of 1e-8 are longer than the way to go.
            if picture.precision == Precision::F64 && !(picture.method.is_difference() && height < 1e-7) {
                let depth = picture.depths[41].expect("it hits");
                // The pixel is beside the middle: a little farther. Below 1e-12 positions have three digits.
                let slack = if height < 1e-12 { 0.03 } else { 0.02 };
                assert!((depth / height - 1.0).abs() < slack, "{height}: {}", picture.place());
            }
        }
    }
}

/// A step of its own beside the formula.
fn with_step(step: &str) -> (tempfile::TempDir, Formula) {
    let folder = folder();
    std::fs::write(folder.path().join("odd.rhai"), step).unwrap();
    let text = ball("(0, -3, 0)", "(0, 0, 0)", "")
        .replace("bulb_power(power: 8)", "bulb_power(power: 2), \"odd\": odd(), \"all\": Sequence([\"odd\", \"bulb\"])")
        .replace("constant:", "output: \"all\", constant:");
    std::fs::write(folder.path().join("formula.ron"), text).unwrap();
    let formula = Formula::open(folder.path().join("formula.ron")).unwrap_or_else(|error| panic!("{error}"));
    (folder, formula)
}

fn odd_step(image: &str, rule: &str) -> String {
    format!(
        r#"
fn step(z, c, p) {{ {image} }}
fn derivative(z, dr, p) {{ {rule} }}
#{{ group: "transform", summary: "Gives odd numbers.", source: "A test.", scalar_rule: "heuristic", params: [],
    examples: [ #{{ z: [-0.5, 0.0, 0.0], expect: [-0.5, 0.0, 0.0] }} ] }}
"#
    )
}

pub fn nan_is_counted() {
    // The root of a negative number for x > 1, which no point of the ball comes to.
    let odd = odd_step("z + vec3(0.0, 0.0, sqrt(1.0 - z.x) - sqrt(abs(1.0 - z.x)))", "dr");
    ball_behind_odd_numbers(&odd, [1.5, 0.0, 0.0]);
}

pub fn infinity_is_counted() {
    // e^10000 a hundredth outside of the ball, 1 inside of it.
    let odd = odd_step("z * exp(max(dot(z, z) - 1.0, 0.0) * 1.0e6)", "dr");
    ball_behind_odd_numbers(&odd, [1.2, 0.3, 0.0]);
}

/// Checks pictures of a ball whose step gives odd numbers outside of it only.
fn ball_behind_odd_numbers(step: &str, outside: [f64; 3]) {
    let (_folder, formula) = with_step(step);
    assert!(!formula.inside(outside), "NaN and infinity count as escaped");
    assert!(formula.inside([0.5, 0.0, 0.0]) && formula.inside([-0.5, 0.0, 0.0]));
    for picture in pictures(&formula) {
        picture.has_no_black_pixel();
        // A proof says that it has none instead of passing on what is not a number.
        let counted = if picture.method.is_certified() { picture.stats.undecided } else { Some(picture.stats.nan) };
        assert!(counted > Some(0) && picture.stats.unfinished == 0, "{}", picture.place());
        let depth = picture.depths[41].unwrap_or_else(|| panic!("{}", picture.place()));
        assert!((depth - 2.0).abs() < 0.05, "{}", picture.place());
    }
}
