//! What a march of proofs does differently: it proposes how far the next proof is to reach, and remembers whether it crossed
//! anything unproven.
//!
//! The proven step of the last estimate stands in `last_de`, and its sign is the memory: negative once a stretch of the
//! ray was walked over without proof and left again, or a hit was walked up to for longer than a footprint. The
//! walk is that of estimates in smaller steps, so pictures are closed.

use super::Inputs;
use crate::expr::{Expr, Function};
use crate::kernel::Status;

/// The next proof is to reach this much further than the last one did.
const PROPOSAL: f64 = 1.5;
/// Share of the ray's range that the first proof is to reach.
const FIRST: f64 = 0.25;
/// Steps of the walk that a proof is to reach at least: a 16th of the hit threshold by default. With 24 bulbs took a tenth
/// more orbits, with 96 (a third of a threshold) twice as many, since proofs that reach further than can be proven are worth
/// less than shorter ones.
const LEAST: f64 = 16.0;
/// Shortest proof that is taken, as a share of a step of the walk. Twice a step made no difference.
const SHORTEST: f64 = 0.5;
/// Hit thresholds that a ray may walk unproven up to a hit: a pixel's footprint there.
const NEAR: f64 = 2.0;
/// Added to the size of a negative `last_de`, so that 0 has a sign too.
const SIGNED_ZERO: f64 = 1e-30;

/// True where a finished ray of a march of proofs crossed something unproven: its answer is neither a proof of emptiness nor
/// a hit within a footprint. `last_de` and `steps` are the march's columns.
pub fn is_undecided(last_de: f64, steps: f64, status: Status) -> bool {
    steps > 0.0 && (last_de < 0.0 || status == Status::Unfinished)
}

/// How far the next proof is to reach; `walk` is a step of the walk.
pub(super) fn proposal<'g>(ray: &Inputs<'g>, walk: Expr<'g>) -> Expr<'g> {
    let zero = ray.t.lift(0.0);
    let is_first = ray.t_outside.lt(zero).and(ray.t_inside.lt(zero));
    let first = (ray.t_far - ray.t_near) * FIRST;
    is_first.select(first, ray.last_de.abs() * PROPOSAL).max(walk * LEAST)
}

/// How far the march goes: as far as is proven, or a step of the walk.
pub(super) fn step<'g>(proven: Expr<'g>, walk: Expr<'g>) -> Expr<'g> {
    proven.lt(walk * SHORTEST).select(walk, proven)
}

/// What `advance` has worked out already.
pub(super) struct Steps<'g> {
    pub(super) walk: Expr<'g>,
    pub(super) hit_eps: Expr<'g>,
    pub(super) de: Expr<'g>,
    pub(super) t_outside: Expr<'g>,
    pub(super) t_inside: Expr<'g>,
    pub(super) hit: Expr<'g>,
    pub(super) miss: Expr<'g>,
    pub(super) crossed: Expr<'g>,
}

/// The outputs of `advance`. `t_front` is where the present walk began.
pub(super) fn advance<'g>(function: &mut Function, ray: &Inputs<'g>, steps: &Steps<'g>, status: Expr<'g>, t: Expr<'g>) {
    let arena = ray.t.arena;
    let zero = arena.f(0.0);
    let is_first = ray.t_outside.lt(zero).and(ray.t_inside.lt(zero));
    let marked = ray.last_de.lt(zero).and(!is_first);
    let shortest = steps.walk * SHORTEST;
    let walks = steps.de.lt(shortest).and(!steps.crossed);
    let walked = ray.last_de.abs().lt(shortest).and(!is_first);
    // A walk ends where a proof goes on, where the ray leaves, or at a hit that is too far from where it began.
    let left = walked.and(!walks).and(!steps.crossed);
    let left_unproven = steps.miss.and(walks);
    let far_hit = steps.hit.and((steps.hit_eps * NEAR).lt(t - ray.t_front));
    let undecided = marked.or(left).or(left_unproven).or(far_hit);
    let size = steps.crossed.select(ray.last_de.abs(), steps.de);
    function.output("t", t);
    function.output("t_front", steps.crossed.or(walks.and(walked)).select(ray.t_front, ray.t));
    function.output("t_outside", steps.t_outside.max(arena.f(-1.0)));
    function.output("t_inside", steps.t_inside);
    function.output("last_de", undecided.select(-(size + SIGNED_ZERO), size));
    function.output("status", status);
}
