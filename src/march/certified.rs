//! The march of proofs: it proposes how far the next proof is to reach, looks in the middle of that stretch, and remembers
//! whether it crossed anything unproven.
//!
//! A proof holds on both sides of its point, so the point is put ahead of where the march is: what reaches back to there
//! is proven up to as far again in front. Where it does not reach back, a shorter stretch is tried; where even the
//! shortest one is not proven, the ray walks on, from point to point, until one is inside or a proof succeeds.
//!
//! How far the next proof is to reach stands in `last_de`, and its sign is the memory: negative once a stretch of the
//! ray was walked over without proof and left again, or a hit was walked up to for longer than a footprint. The
//! walk is that of estimates in smaller steps, so pictures are closed.

use super::{BISECTION, MarchSettings, Moment, least_gap};
use crate::expr::Expr;
use crate::kernel::Status;
use crate::kernel::records::{Answer, MarchState, UNKNOWN, is_known, is_unknown};

/// What a proof that reached as far as it was to lets the next one try. More finds long stretches sooner, but a ball that
/// is too large to prove anything wastes an orbit: with 2 bulbs of even power took a fifth more orbits.
const LONGER: f64 = 1.4;
/// What a proof that reached less far than it was to lets the next one try, as a multiple of how far it reached: the larger
/// the ball, the worse its bounds, so asking for much more than that gives less.
const AFTER_LESS: f64 = 1.1;
/// Share of what a proof was to reach that counts as all of it.
const WHOLE: f64 = 0.99;
/// Where the point of a proof is, as a share of how far that is to reach to both sides. Of 3,000 rays each the least orbits
/// were taken with 0.3 to 0.5; at 0, where only one half of a proof is of use, a quarter more.
const AHEAD: f64 = 0.4;
/// Share of what was proven around a point too far ahead that the next proof is to reach.
const AGAIN: f64 = 0.9;
/// The same at least, as a share of what the last proof was to reach: a ball that meets a jump or a fold proves nothing, and
/// one half as large often all. Starting over from the shortest proof took a quarter more orbits on boxes.
const SHRINK: f64 = 0.5;
/// Share of a stretch that the next one is, where the point ahead was inside.
const NEARER: f64 = 0.25;
/// Share of the ray's range that the first proof is to reach; its point is where the ray starts.
const FIRST: f64 = 0.25;
/// Share of the rest of a ray's range that a proof needs reach at most.
const REST: f64 = 1.02 / (1.0 + AHEAD);
/// Steps of the walk that a proof is to reach at least: a 16th of the hit threshold by default. With 2 bulbs took as many
/// orbits and boxes a sixth more, with 16 it was the other way round, and proofs that reach further than can be proven are
/// worth less than shorter ones.
const LEAST: f64 = 8.0;
/// Steps of its own length that a walk takes before they become longer: the more they are the longer they become.
const AS_LONG: f64 = 2000.0;
/// Hit thresholds that a step of the walk is long at most.
const LONGEST: f64 = 0.5;
/// What is remembered of a step of the walk, as a share of it; half tells it from a proof.
const WALKED: f64 = 0.25;
/// Hit thresholds that a ray may walk unproven up to a hit: a pixel's footprint there.
const NEAR: f64 = 2.0;
/// Added to the size of a negative `last_de`, so that 0 has a sign too.
const SIGNED_ZERO: f64 = 1e-30;

/// True where a finished ray of a march of proofs crossed something unproven: its answer is neither a proof of emptiness nor
/// a hit within a footprint. `last_de` and `steps` are the march's columns.
pub fn is_undecided(last_de: f64, steps: f64, status: Status) -> bool {
    steps > 0.0 && (last_de < 0.0 || status == Status::Unfinished)
}

/// What the next estimate of a ray is to be.
pub(super) struct Stretch<'g> {
    /// A step of the walk; not below what the precision has at `t`.
    walk: Expr<'g>,
    /// Whether there was no estimate yet.
    is_first: Expr<'g>,
    /// Whether the surface is between two points, and the one to look at between them.
    bisects: Expr<'g>,
    /// Whether nothing shorter is tried: the point is a step of the walk ahead.
    searches: Expr<'g>,
    /// How far the proof is to reach.
    pub(super) reach: Expr<'g>,
    /// How far ahead of the march its point is.
    pub(super) ahead: Expr<'g>,
}

impl<'g> Stretch<'g> {
    pub(super) fn new(now: &Moment<'g>, settings: &MarchSettings) -> Stretch<'g> {
        let Moment { ray, state } = now;
        let zero = state.t.lift(0.0);
        let bisects = is_known(state.t_inside);
        let is_first = is_unknown(state.t_outside).and(is_unknown(state.t_inside));
        // Where nothing is ever proven a walk would not end.
        let hit_eps = now.hit_eps(settings);
        let walked = is_first.select(zero, state.t - state.t_front);
        let longer = (walked * (1.0 / AS_LONG)).min(hit_eps * LONGEST);
        let walk = (hit_eps * settings.least_step).max(longer).max(least_gap(now, settings));
        let first = (ray.t_far - ray.t_near) * FIRST;
        let next = state.last_de.abs().min((ray.t_far - state.t) * REST);
        let least = walk * LEAST;
        let reach = is_first.select(first, next).max(least);
        let searches = reach.le(least).and(!is_first);
        let ahead = searches.select(walk, reach * AHEAD);
        Stretch { walk, is_first, bisects, searches, reach, ahead: bisects.or(is_first).select(zero, ahead) }
    }
}

/// The new state from the estimate of the ray's [`Stretch`]. `t_front` is where the present walk began; up to `t`
/// everything is proven empty or was walked over, so `t_outside` is `t` unless the march bisects.
pub(super) fn advance<'g>(
    now: &Moment<'g>,
    settings: &MarchSettings,
    Answer { de, inside }: Answer<Expr<'g>>,
) -> MarchState<Expr<'g>> {
    let Moment { ray, state } = now;
    let arena = state.t.arena;
    let zero = arena.f(0.0);
    let hit_eps = now.hit_eps(settings);
    let Stretch { walk, is_first, bisects, searches, reach, ahead } = Stretch::new(now, settings);
    let proven = zero.le(de).select(de, zero);
    let at = state.t + ahead;

    // A point far ahead that is inside is not the first one.
    let crossed = bisects.or(inside.and(searches.or(is_first)));
    let t_inside = inside.and(crossed).select(at, state.t_inside);
    let t_outside = bisects.and(inside).or(is_first.and(inside)).select(state.t_outside, state.t);
    let middle = (t_inside + t_outside) * 0.5;
    let between = t_outside.lt(middle).and(middle.lt(t_inside));
    let narrow = (t_inside - t_outside).le(hit_eps * BISECTION).or(!between);
    let hit = crossed.and(narrow.or(is_unknown(t_outside)));

    let reaches = (!inside).and(ahead.le(proven)).and(!crossed);
    let walks = searches.and(!reaches).and(!crossed);
    let forward = reaches.select(at + proven, walks.select(at, state.t));
    let miss = (!crossed).and(ray.t_far.le(forward));
    let t = hit.select(t_inside.max(ray.t_near), crossed.select(middle, forward.min(ray.t_far)));

    // A walk ends where a proof goes on, where the ray leaves, or at a hit that is too far from where it began.
    let walked = state.last_de.abs().lt(walk * (2.0 * WALKED)).and(!is_first);
    let t_front = bisects.or(walked.and(walks.or(crossed))).select(state.t_front, state.t);
    let far_hit = hit.and((hit_eps * NEAR).lt(t - t_front));
    let marked = state.last_de.lt(zero).and(!is_first);
    let undecided = marked.or(walked.and(reaches)).or(miss.and(walks)).or(far_hit);
    let longer = (reach * WHOLE).le(proven).select(reach * LONGER, proven * AFTER_LESS);
    let shorter = inside.select(reach * NEARER, (proven * AGAIN).max(reach * SHRINK));
    let of_proof = reaches.select(longer, shorter).max(walk);
    let size = crossed.select(state.last_de.abs(), walks.select(walk * WALKED, of_proof));

    let code = |status: Status| arena.f(status.code());
    let status = miss.select(code(Status::Miss), hit.select(code(Status::Hit), state.status));
    let t_outside = crossed.select(t_outside, t);
    MarchState {
        t,
        t_front,
        t_outside: t_outside.max(arena.f(UNKNOWN)),
        t_inside,
        last_de: undecided.select(-(size + SIGNED_ZERO), size),
        status,
    }
}
