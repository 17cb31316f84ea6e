//! Marching: rays through an estimator until they hit, miss or run out of steps.
//!
//! In comes an estimator with `de, inside`; out comes a [`March`] kernel. Everything a march does between two estimates
//! is straight-line and stands here as expressions, once for all back ends: where to estimate ([`compose_march`]'s
//! `locate`) and what to make of the answer (`advance`). Rules: a step is the estimate times `fudge`, at least
//! `least_step` times the hit threshold; an estimate under the threshold whose point is still outside is walked on from, so only a point that is
//! inside stops the ray; from there it bisects back to the boundary. Steps may be longer (see `relaxed`); many rays may share
//! the first part of their way (see `beam`), and those to lights need less (see `shadow`), and
//! some only look around (see `near`).

mod beam;
mod certified;
mod inner;
mod near;
mod relaxed;
mod shadow;
mod still;

pub use beam::{beam_plan, compose_beam_march};
pub use certified::is_undecided;
pub use inner::compose_inner_march;
pub use near::{LEAST_HEIGHT, closest, compose_corner_march, compose_passing_march, corner_plan, openness};
pub use shadow::{Disc, SKIPPED, compose_shadow_march, is_hit_of, shadow_plan, share_lit, tells_nearness};
pub use still::{compose_still, still_plan};

use serde::{Deserialize, Serialize};

use self::relaxed::Relaxed;
use crate::compose::Plan;
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{DifferenceStep, LEAST_STEP, StopAt};
use crate::kernel::records::{Answer, MarchState, Query, Ray, is_known, is_unknown};
use crate::kernel::{Estimator, March, Status};
use crate::math::Precision;

/// How far rays go and when they stop.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct MarchSettings {
    /// Step multiplier in (0, 1].
    pub fudge: f64,
    /// Radius of a pixel at distance 1.
    pub pixel_radius: f64,
    /// Part of the hit threshold that does not grow with distance, in world units.
    pub hit_eps: f64,
    /// Estimates after which a ray is unfinished.
    pub max_march_steps: u32,
    /// Shortest step as a share of the hit threshold: what is thinner along a ray may be stepped over.
    pub least_step: f64,
    /// Longest step in hit thresholds, or infinity: an estimate that is too long passes no more than that.
    pub most_step: f64,
    /// What it is computed in: steps, differences and bisections stay above what that can resolve.
    pub precision: Precision,
    /// Whether estimates are proofs: `h` then says how far the next one is to reach.
    pub certified: bool,
    /// Step of finite differences, where that is above the least one.
    pub difference_step: DifferenceStep,
    /// Whether a ray stops where the estimate falls below the hit threshold, wherever the set is.
    pub stops_at_threshold: bool,
    /// How much longer than the estimate times `fudge` a step may be; 1 takes no longer ones. Longer steps need estimates
    /// that hold all around their point.
    pub relaxation: f64,
}

/// A hit threshold along a ray, or the radius of a pixel there: in world units, by the ray's parameter.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Threshold {
    /// What it grows by with the distance.
    pub pixel_radius: f64,
    /// What does not grow, in world units.
    pub fixed: f64,
}

impl Threshold {
    /// The threshold at a depth, as an expression.
    pub fn at<'g>(self, t: Expr<'g>) -> Expr<'g> {
        if self.fixed > 0.0 { t * self.pixel_radius + self.fixed } else { t * self.pixel_radius }
    }

    /// The radius at a depth.
    pub fn radius(self, t: f64) -> f64 {
        t * self.pixel_radius + self.fixed
    }

    /// The diameter at a depth: a pixel's footprint.
    pub fn footprint(self, t: f64) -> f64 {
        2.0 * self.radius(t)
    }

    /// The same, larger by a factor.
    #[must_use]
    pub fn times(self, factor: f64) -> Threshold {
        Threshold { pixel_radius: self.pixel_radius * factor, fixed: self.fixed * factor }
    }
}

impl From<f64> for Threshold {
    /// A threshold that grows with the distance, by its size at distance 1.
    fn from(pixel_radius: f64) -> Threshold {
        Threshold { pixel_radius, fixed: 0.0 }
    }
}

/// Estimates after which a ray of estimates is unfinished.
const MAX_STEPS: u32 = 1000;
/// The same where estimates are proofs: a ray walks as long as it must through what can't be proven. Beside the axis of an
/// asin bulb of power 2 that takes thousands of steps. And where no step may be long.
const MAX_LONG_STEPS: u32 = 20_000;

impl Default for MarchSettings {
    fn default() -> Self {
        MarchSettings {
            fudge: 1.0,
            pixel_radius: 1e-3,
            hit_eps: 0.0,
            max_march_steps: MAX_STEPS,
            least_step: LEAST_STEP,
            most_step: f64::INFINITY,
            precision: Precision::F32,
            certified: false,
            difference_step: DifferenceStep::default(),
            stops_at_threshold: false,
            relaxation: 1.0,
        }
    }
}

impl MarchSettings {
    /// The hit threshold.
    pub fn threshold(&self) -> Threshold {
        Threshold { pixel_radius: self.pixel_radius, fixed: self.hit_eps }
    }

    /// How a plan's estimates are marched: what is not the plan's is a pixel's radius and the precision.
    pub fn of_plan(plan: &Plan, pixel: impl Into<Threshold>, precision: Precision) -> MarchSettings {
        // Half a pixel, or what the plan says.
        let pixel = match plan.stop_at {
            None => pixel.into(),
            Some(StopAt::Pixels(pixels)) => pixel.into().times(2.0 * pixels),
            Some(StopAt::World(fixed)) => Threshold { pixel_radius: 0.0, fixed },
        };
        MarchSettings {
            fudge: plan.fudge,
            pixel_radius: pixel.pixel_radius,
            hit_eps: pixel.fixed,
            stops_at_threshold: plan.stop_at.is_some(),
            least_step: plan.least_step,
            most_step: plan.most_step,
            precision,
            certified: plan.is_certified(),
            max_march_steps: if plan.is_certified() || plan.most_step.is_finite() { MAX_LONG_STEPS } else { MAX_STEPS },
            difference_step: plan.difference_step,
            relaxation: relaxed::of_plan(plan),
        }
    }
}

/// Share of the hit threshold that bisection narrows a hit down to.
const BISECTION: f64 = 1.0 / 8.0;

/// A ray and how far its march is, as inputs of `locate` and `advance`.
struct Moment<'g> {
    ray: Ray<Expr<'g>>,
    state: MarchState<Expr<'g>>,
}

/// Share of a ray's far end up to which its longest steps do not shrink with the distance: beside the camera they would be
/// countless.
const NEAREST: f64 = 1.0 / 64.0;

impl<'g> Moment<'g> {
    fn read(inputs: &mut Inputs<'g>) -> Moment<'g> {
        Moment { ray: Ray::read(inputs), state: MarchState::read(inputs) }
    }

    /// The inputs of `locate`, and the function of them.
    fn locate(arena: &'g Arena) -> (Moment<'g>, Function) {
        let mut inputs = Inputs::new(arena);
        (Moment::read(&mut inputs), inputs.function("locate"))
    }

    /// The inputs of `advance`, and the function of them.
    fn advance(arena: &'g Arena) -> (Moment<'g>, Answer<Expr<'g>>, Function) {
        let mut inputs = Inputs::new(arena);
        (Moment::read(&mut inputs), Answer::read(&mut inputs), inputs.function("advance"))
    }

    /// The point of the ray at `t`.
    fn point(&self, t: Expr<'g>) -> Expr<'g> {
        self.ray.origin + self.ray.direction * t
    }

    /// The longest step at `t`, where there is one.
    fn longest_step(&self, settings: &MarchSettings) -> Option<Expr<'g>> {
        let eps = || self.state.t.max(self.ray.t_far * NEAREST) * settings.pixel_radius + settings.hit_eps;
        settings.most_step.is_finite().then(|| eps() * settings.most_step.max(settings.least_step))
    }

    fn hit_eps(&self, settings: &MarchSettings) -> Expr<'g> {
        self.state.t * settings.pixel_radius + settings.hit_eps
    }

    /// The step of finite differences at a point.
    fn difference(&self, settings: &MarchSettings, p: Expr<'g>) -> Expr<'g> {
        let sizes = p.abs().components();
        let largest = sizes[0].max(sizes[1]).max(sizes[2]).max(p.arena.f(1.0));
        // A share of the last estimate is below 0, and the least step taken, before there is one.
        let wanted = match settings.difference_step {
            DifferenceStep::Share(share) => self.state.last_de * share,
            DifferenceStep::Fixed(step) => p.arena.f(step),
        };
        wanted.max(largest * settings.precision.min_difference())
    }
}

/// Joins an estimator with the march's own functions.
pub fn compose_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let mut locate = compose_locate(arena, settings);
    for (number, (port, value)) in locate.outputs.iter_mut().enumerate() {
        if !estimator.reads(arena, number) {
            *value = arena.constant(port.ty, [0.0; 4]).id;
        }
    }
    March { estimator, locate, advance: compose_advance(arena, settings), max_march_steps: settings.max_march_steps }
}

/// The point to estimate at, the ray's direction, the step of finite differences there, and the hit threshold.
fn compose_locate(arena: &Arena, settings: &MarchSettings) -> Function {
    let (now, mut function) = Moment::locate(arena);
    let stretch = settings.certified.then(|| certified::Stretch::new(&now, settings));
    let at = stretch.as_ref().map_or(now.state.t, |stretch| now.state.t + stretch.ahead);
    let p = now.point(at);
    let h = stretch.map_or_else(|| now.difference(settings, p), |stretch| stretch.reach);
    Query { p, d: now.ray.direction, h, hit_eps: now.hit_eps(settings) }.write(&mut function);
    function
}

/// The least step that any precision has at `t`.
fn least_gap<'g>(now: &Moment<'g>, settings: &MarchSettings) -> Expr<'g> {
    now.state.t * (2.0 * f64::from(f32::EPSILON)) + settings.precision.min_difference() * 0.01
}

/// How near to each other the ends of a bisection need to be, somewhere around `t`: there is always a number between farther ones.
fn narrow_gap<'g>(now: &Moment<'g>, settings: &MarchSettings) -> Expr<'g> {
    now.state.t * (settings.pixel_radius * BISECTION).max(4.0 * settings.precision.epsilon())
        + settings.hit_eps * BISECTION
}

/// The new state of a ray from its state and the estimate at `t`.
fn compose_advance(arena: &Arena, settings: &MarchSettings) -> Function {
    let (now, answer, mut function) = Moment::advance(arena);
    if settings.certified {
        certified::advance(&now, settings, answer).write(&mut function);
        return function;
    }
    let (Moment { state, ray }, Answer { de, inside }) = (&now, answer);
    let zero = arena.f(0.0);
    let hit_eps = now.hit_eps(settings);

    let t_inside = inside.select(state.t, state.t_inside);
    let t_outside = inside.select(state.t_outside, state.t);
    let crossed = is_known(t_inside);

    // Marching: forward by the estimate. A NaN estimate walks on. A step below the spacing of numbers at t, or of no length at
    // t = 0, would stand still: then the least step that any precision has is taken.
    let usable = zero.le(de).select(de, zero);
    let walk = hit_eps * settings.least_step;
    let longest = now.longest_step(settings);
    let step = (usable * settings.fudge).max(walk);
    let wanted = state.t + longest.map_or(step, |longest| step.min(longest));
    let forward = wanted.le(state.t).select(state.t + least_gap(&now, settings), wanted);
    let relaxed = Relaxed::new(&now, settings, walk, usable);
    let farther = relaxed.as_ref().map_or(forward, |relaxed| relaxed.farther(&now, forward));
    let farther = longest.map_or(farther, |longest| farther.min((state.t + longest).max(forward)));
    // Bisecting: to the middle, until the ends are near each other. A ray that starts inside hits there.
    let width = t_inside - t_outside;
    let middle = t_outside + width * 0.5;
    let narrow = width.le(narrow_gap(&now, settings)).or(is_unknown(t_outside));
    let bisected = crossed.and(narrow);
    let below = usable.lt(hit_eps);
    // An estimate of 0 outside says that nothing is known.
    let near = settings.stops_at_threshold.then(|| below.and(zero.lt(de)).and(!inside));
    let hit = near.map_or(bisected, |near| near.or(bisected));
    let t_inside = near.map_or(t_inside, |near| near.select(state.t, t_inside));
    let goes_on = !near.map_or(crossed, |near| near.or(crossed));
    let miss = ray.t_far.le(forward).and(goes_on);
    let code = |status: Status| arena.f(status.code());
    let status = miss.select(code(Status::Miss), hit.select(code(Status::Hit), arena.f(Status::RUNNING)));
    let t = hit.select(t_inside, crossed.select(middle, farther.min(ray.t_far)));
    // The front stays where a walk under the threshold began.
    let walking = below.and(state.last_de.lt(hit_eps)).and(is_known(state.last_de));
    let mut stays = crossed.or(walking);
    let running = arena.f(Status::RUNNING);
    let mut next = MarchState { t, t_front: state.t, t_outside, t_inside, last_de: usable, status };
    if let Some((back, t)) = relaxed.map(|relaxed| relaxed.back(&now, settings, inside)) {
        let here = MarchState { t, status: running, ..*state };
        next = next.or(back, here);
        stays = stays.or(back);
    }
    next.t_front = stays.select(state.t_front, state.t);
    next.write(&mut function);
    function
}

/// The same march without bisection: a hit stays where the step that crossed the surface landed, so that `t_inside` says how
/// far it went.
pub fn stop_at_crossing(arena: &Arena, march: &March) -> March {
    let mut advance = march.advance.clone();
    let MarchState { t_inside, status, .. } = state_of(arena, &advance);
    let crossed = is_known(t_inside);
    set_status(&mut advance, crossed.select(arena.f(Status::Hit.code()), status));
    March { advance, ..march.clone() }
}

/// The state that an `advance` gives.
fn state_of<'g>(arena: &'g Arena, advance: &Function) -> MarchState<Expr<'g>> {
    // Every field is a number: its column is its output.
    MarchState::COLUMNS.map(|output| arena.expr(advance.outputs[output].1))
}

/// Makes an `advance` give another status.
fn set_status(advance: &mut Function, status: Expr) {
    advance.outputs[MarchState::COLUMNS.status].1 = status.id;
}
