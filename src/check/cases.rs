//! The tests that a formula file holds, each on one back end.

use super::agreement::agreement;
use super::backends::{Backends, Target};
use super::report::expect_near;
use super::subject::Subject;
use crate::compose::ComposeResult;
use crate::diag::Span;
use crate::graph::{Method, Symmetry, TestKind};
use crate::math::random::Random;

/// Points that symmetries are tried at.
const SYMMETRY_POINTS: usize = 200;
/// Shares of disagreements that single precision may show in a symmetry: rounding near the boundary grows with every
/// iteration, and a few moves of the point do not always show it.
const SYMMETRY_SHARE_F32: f64 = 0.02;
/// Share of a picture's pixels on which back ends must agree.
const AGREE_SHARE: f64 = 0.998;
/// Points whose estimates are compared with brute force, spheres tried around each, and samples of each sphere.
const BRUTE_POINTS: usize = 48;
const BRUTE_SHELLS: usize = 6;
const BRUTE_SAMPLES: usize = 128;
/// Iterations that brute force makes beyond the file's limit.
const DEEPER: u32 = 6;

/// What one test needs.
pub(super) struct Case<'a> {
    pub(super) subject: &'a Subject<'a>,
    pub(super) backends: &'a Backends,
    pub(super) target: Target,
}

/// A test's name.
pub(super) fn label(kind: &TestKind) -> String {
    match kind {
        TestKind::Inside(p) => format!("inside{}", point_text(&p.components())),
        TestKind::Outside(p) => format!("outside{}", point_text(&p.components())),
        TestKind::Orbit { point, iterations, .. } => {
            format!("orbit{} after {iterations}", point_text(&point.components()))
        }
        TestKind::Estimate { point, method, .. } => {
            format!("estimate{} {}", point_text(&point.components()), method.map_or("chosen", Method::name))
        }
        TestKind::Ray { origin, direction, .. } => {
            format!("ray{} towards {}", point_text(&origin.components()), point_text(direction))
        }
        TestKind::Symmetric(symmetry) => format!("symmetric {}", symmetry_text(*symmetry)),
        TestKind::AgreesOnBackends => "agrees_on_backends".into(),
        TestKind::NeverAbove { factor } => format!("never_above {factor}"),
    }
}

fn point_text(p: &[f64]) -> String {
    let parts: Vec<String> = p.iter().map(|x| short(*x)).collect();
    format!("({})", parts.join(", "))
}

/// A number with at most six digits.
fn short(x: f64) -> String {
    let text = x.to_string();
    if text.len() <= 8 { text } else { format!("{x:.6}") }
}

fn symmetry_text(symmetry: Symmetry) -> String {
    let axis = |i: u8| ["x", "y", "z"][usize::from(i.min(2))];
    match symmetry {
        Symmetry::Mirror(i) => format!("mirror {}", axis(i)),
        Symmetry::Swap(i, j) => format!("swap {} {}", axis(i), axis(j)),
        Symmetry::Turn(about, angle) => format!("turn {} by {}", point_text(&about), short(angle.to_degrees())),
    }
}

/// Whether a test says anything about a back end.
pub(super) fn applies(kind: &TestKind, target: Target) -> bool {
    match kind {
        TestKind::AgreesOnBackends => target != Target::CPU_F64,
        TestKind::NeverAbove { .. } => target == Target::CPU_F64,
        _ => true,
    }
}

impl Case<'_> {
    /// Runs one test; a point's fourth component is that of the slice that is looked at.
    pub(super) fn check(&self, kind: &TestKind) -> Result<(), String> {
        let Some(w) = kind.w() else { return self.check_here(kind) };
        let graph = self.subject.graph.with_orbit_settings(|settings| {
            settings.slice = w;
            settings.four = settings.four.or(Some(Span::NONE));
        });
        let Subject { library, arena, .. } = *self.subject;
        let subject = Subject { library, arena, graph: &graph, plan: self.subject.plan.clone() };
        Case { subject: &subject, backends: self.backends, target: self.target }.check_here(kind)
    }

    fn check_here(&self, kind: &TestKind) -> Result<(), String> {
        match kind {
            TestKind::Inside(p) => self.membership(p.at, true),
            TestKind::Outside(p) => self.membership(p.at, false),
            TestKind::Orbit { point, iterations, expect, tolerance } => {
                self.orbit(point.at, *iterations, expect, *tolerance)
            }
            TestKind::Estimate { point, method, expect, tolerance } => {
                let method_used = method.or(self.subject.method()).unwrap_or(Method::Scalar);
                let (found, _) = self.estimates(*method, &[point.at])?[0];
                expect_near("estimate", found, *expect, tolerance + self.target.estimate_slack(method_used))
            }
            TestKind::Ray { origin, direction, expect, tolerance } => {
                self.ray(origin.at, *direction, *expect, *tolerance)
            }
            TestKind::Symmetric(symmetry) => self.symmetric(*symmetry),
            TestKind::AgreesOnBackends => self.agrees(),
            TestKind::NeverAbove { factor } => self.never_above(*factor),
        }
    }

    fn composed<T>(&self, result: ComposeResult<T>) -> Result<T, String> {
        result.map_err(|error| error.rendered(&self.subject.library.sources))
    }

    fn estimates(&self, method: Option<Method>, points: &[[f64; 3]]) -> Result<Vec<(f64, bool)>, String> {
        let choices = self.subject.choices(method).ok_or_else(|| {
            let reason = self.subject.plan.choices.first().map_or("", |c| c.reason.as_str());
            format!("the method {} does not apply here: {reason}", method.map_or("", Method::name))
        })?;
        let kernel = self.composed(self.subject.estimator(&choices))?;
        self.subject.estimates(self.backends, self.target, &kernel, points).map_err(|e| e.to_string())
    }

    fn membership(&self, point: [f64; 3], expected: bool) -> Result<(), String> {
        let (de, inside) = self.estimates(None, &[point])?[0];
        match (inside == expected, expected) {
            (true, _) => Ok(()),
            (false, true) => Err(format!("expected inside, found outside with a distance estimate of {de}")),
            (false, false) => Err("expected outside, found inside".into()),
        }
    }

    fn orbit(&self, point: [f64; 3], iterations: u32, expect: &[f64], tolerance: f64) -> Result<(), String> {
        let kernel = self.composed(self.subject.orbit_kernel(iterations))?;
        let orbits = self.subject.orbits(self.backends, self.target, &kernel, &[point]).map_err(|e| e.to_string())?;
        let found = &orbits[0];
        if expect.len() > found.len() {
            return Err(format!("the state has {} components, the test expects {}", found.len(), expect.len()));
        }
        // Large components lose digits to the small ones, so the state's size decides.
        let size = expect.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
        let slack = (tolerance + self.target.orbit_slack(iterations)) * size;
        let near = expect.iter().zip(found).all(|(e, f)| (e - f).abs() <= slack);
        match near {
            true => Ok(()),
            false => Err(format!(
                "state after {iterations} iterations: expected {expect:?} (tolerance {slack:.1e}), found {found:?}"
            )),
        }
    }

    fn ray(&self, origin: [f64; 3], direction: [f64; 3], expect: Option<f64>, tolerance: f64) -> Result<(), String> {
        let size = expect.unwrap_or(1.0).max(1.0);
        let slack = tolerance + self.target.depth_slack();
        let depths = self.subject.depths(self.backends, self.target, &[(origin, direction)], slack * size * 0.5);
        let found = self.composed(depths.map_err(|e| e.to_string())?)?[0];
        match (expect, found) {
            (None, None) => Ok(()),
            (Some(expected), Some(found)) => expect_near("depth", found, expected, slack),
            (Some(expected), None) => Err(format!("expected a hit at depth {expected}, found a miss")),
            (None, Some(found)) => Err(format!("expected a miss, found a hit at depth {found}")),
        }
    }

    /// Estimates at points, their images and both moved a little: what a move explains is no disagreement.
    fn symmetric(&self, symmetry: Symmetry) -> Result<(), String> {
        let radius = self.subject.plan.bounding_radius;
        let mut random = Random::new(1);
        let points: Vec<[f64; 3]> = (0..SYMMETRY_POINTS).map(|_| random.in_ball(radius)).collect();
        let moves: Vec<[f64; 3]> =
            (0..4).map(|_| random.direction().map(|x| x * radius * self.target.rounding())).collect();
        let mut all = Vec::new();
        for p in &points {
            for start in [*p, image(symmetry, *p)] {
                all.push(start);
                all.extend(moves.iter().map(|m| [0, 1, 2].map(|i| start[i] + m[i])));
            }
        }
        let values = self.estimates(None, &all)?;
        let each = 1 + moves.len();
        let spread = |at: usize| (1..each).map(|i| (values[at].0 - values[at + i].0).abs()).fold(0.0, f64::max);
        let flips = |at: usize| (1..each).any(|i| values[at].1 != values[at + i].1);
        let relative = match self.subject.method() {
            // Forward differences over a hundredth of the estimate look to one side, and far out orbits bend a lot.
            Some(method) if method.is_difference() => 0.1,
            _ => self.target.estimate_slack(Method::Scalar),
        };
        let mut wrong = Vec::new();
        for (i, p) in points.iter().enumerate() {
            let (a, b) = (2 * i * each, (2 * i + 1) * each);
            let slack = 1e-6 * radius + relative * values[a].0.abs() + 8.0 * (spread(a) + spread(b));
            let near = (values[a].0 - values[b].0).abs() <= slack || (values[a].0.is_nan() && values[b].0.is_nan());
            let explained = flips(a) || flips(b);
            if !explained && (values[a].1 != values[b].1 || !near) {
                wrong.push(format!("at {p:?}: estimate {:?}, at its image {:?}", values[a], values[b]));
            }
        }
        let allowed = if self.target == Target::CPU_F64 { 0.0 } else { SYMMETRY_SHARE_F32 };
        if wrong.len() as f64 <= allowed * SYMMETRY_POINTS as f64 {
            return Ok(());
        }
        Err(format!("{} of {SYMMETRY_POINTS} points disagree with their image; the first {}", wrong.len(), wrong[0]))
    }

    fn agrees(&self) -> Result<(), String> {
        let agreement = agreement(self.subject, self.backends, self.target)?;
        match agreement.share() >= AGREE_SHARE {
            true => Ok(()),
            false => Err(format!(
                "depths: expected {:.1} % of pixels within half a pixel of cpu_f64, found {:.2} %: {}",
                100.0 * AGREE_SHARE,
                100.0 * agreement.share(),
                agreement.text()
            )),
        }
    }

    /// Looks for points inside nearer than the estimate allows, around random points outside and some nearer to the set.
    fn never_above(&self, factor: f64) -> Result<(), String> {
        let radius = self.subject.plan.bounding_radius;
        let mut random = Random::new(2);
        let mut points: Vec<[f64; 3]> = (0..BRUTE_POINTS).map(|_| random.in_ball(radius)).collect();
        let values = self.estimates(None, &points)?;
        for (p, (de, _)) in points.iter_mut().zip(&values).step_by(2) {
            let r = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            let shrink = (1.0 - 0.8 * de / r.max(1e-9)).clamp(0.0, 1.0);
            *p = p.map(|x| x * shrink);
        }
        let values = self.estimates(None, &points)?;
        let mut samples = Vec::new();
        let mut owners = Vec::new();
        for (i, (p, (de, inside))) in points.iter().zip(&values).enumerate() {
            if *inside || !de.is_finite() {
                continue;
            }
            for shell in 1..=BRUTE_SHELLS {
                let reach = 0.999 * de / (1.0 + factor) * (shell as f64 / BRUTE_SHELLS as f64).sqrt();
                for _ in 0..BRUTE_SAMPLES {
                    let d = random.direction();
                    samples.push([0, 1, 2].map(|k| p[k] + reach * d[k]));
                    owners.push((i, reach));
                }
            }
        }
        // The limit set, not the shell of points that only run out of iterations: estimates are of the former.
        let thin = self.composed(self.subject.deeper_estimator(DEEPER))?;
        let found = self.subject.estimates(self.backends, self.target, &thin, &samples).map_err(|e| e.to_string())?;
        match owners.iter().zip(&found).find(|(_, (_, inside))| *inside) {
            None => Ok(()),
            Some(((i, reach), _)) => Err(format!(
                "at {:?}: expected an estimate of at most {} times the distance {reach} of a point inside, found {}",
                points[*i],
                1.0 + factor,
                values[*i].0
            )),
        }
    }
}

fn image(symmetry: Symmetry, mut p: [f64; 3]) -> [f64; 3] {
    match symmetry {
        Symmetry::Mirror(i) => {
            p[usize::from(i.min(2))] *= -1.0;
            p
        }
        Symmetry::Swap(i, j) => {
            p.swap(usize::from(i.min(2)), usize::from(j.min(2)));
            p
        }
        Symmetry::Turn(axis, angle) => {
            let turn = glam::DQuat::from_axis_angle(glam::DVec3::from(axis), angle);
            (turn * glam::DVec3::from(p)).to_array()
        }
    }
}
