//! Marches compared with the truth.

use serde::{Deserialize, Serialize};

use super::stops::{EARLY, EARLY_FOOTPRINTS};
use super::{Ray, Scale, Truth, Truths, point, ray_columns, view_rays};
use crate::check::subject::Subject;
use crate::compose::{Choice, ComposeResult, Composer, Purpose, compose_estimator};
use crate::expr::Arena;
use crate::kernel::cpu::Cpu;
use crate::kernel::records::Marched;
use crate::kernel::{Backend, BackendError, Kernel, Status};
use crate::march::{MarchSettings, compose_march, is_undecided};
use crate::math::Precision;
use crate::render::{RenderSettings, Role, compose_pipeline};

/// What is less likely than this is evidence.
const UNLIKELY: f64 = 0.05;
/// A stop behind the truth by more than this many footprints has passed the surface.
const BEHIND_FOOTPRINTS: f64 = 2.0;

/// How a march ended on one ray.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct End {
    /// How.
    pub status: Status,
    /// Depth of the hit; where the march was, else.
    pub t: f64,
    /// Estimates made.
    pub estimates: u64,
    /// Iterations of all of them.
    pub iterations: u64,
    /// Whether an estimate was not a number.
    pub nan: bool,
    /// Of a march of proofs: whether it crossed anything unproven.
    pub undecided: bool,
}

impl End {
    /// The depth of a hit.
    pub fn depth(&self) -> Option<f64> {
        (self.status == Status::Hit).then_some(self.t)
    }
}

/// Errors that a march may make. Shares are from 0 to 1.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Budget {
    /// Share of the hits that may be missed, or met more than two footprints behind.
    pub missed: f64,
    /// Share of the stops that may be in front of the truth by more than 0.5 % of the bounding radius.
    pub early: f64,
    /// Median depth error, in footprints (a footprint is a pixel's diameter at the hit).
    pub error: f64,
}

impl Default for Budget {
    /// Missed under 0.5 %, early stops under 5 %, median depth error under half a footprint.
    fn default() -> Budget {
        Budget { missed: 0.005, early: 0.05, error: 0.5 }
    }
}

/// How a march does against the truth of the same rays. Shares are from 0 to 1.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Judgement {
    /// Rays with a settled hit.
    pub hits: usize,
    /// Rays that settled on a miss.
    pub misses: usize,
    /// Rays that settled on nothing, and are left out of everything below.
    pub ambiguous: usize,
    /// Hits on something thinner than a hit threshold (half a footprint) along the ray. They count like all others.
    pub thin: usize,
    /// Share of all hits, thin ones included, that the march passed: it missed, ran out of steps, or stopped more than two
    /// footprints behind.
    pub missed: f64,
    /// The same share of the thin hits alone.
    pub missed_thin: f64,
    /// The same share of the hits that are not thin.
    pub missed_thick: f64,
    /// Share, of all settled rays that the march stopped on, of stops in front of the truth by more than 0.5 % of the
    /// bounding radius (or four footprints, where those are less); a stop on a ray that misses counts, too.
    pub early: f64,
    /// Settled rays that the march stopped on.
    pub stops: usize,
    /// Stops that would be early, but a member of the set lies within an eighth of a footprint: there is something
    /// thinner than brute force can see. Not counted as early.
    pub finer: usize,
    /// Median of the depth error of the hits, in footprints (a footprint is a pixel's diameter at the hit).
    pub median_error: f64,
    /// Settled rays that ran out of steps.
    pub unfinished: usize,
    /// Of a march of proofs: settled rays that crossed something unproven.
    pub undecided: usize,
    /// Hits that were passed on rays that did not: errors of the proofs, or of rounding.
    pub disproven: usize,
    /// Rays with an estimate that was not a number.
    pub nan: usize,
    /// Estimates a ray, on the average of all rays.
    pub estimates: f64,
    /// Iterations a ray, on the average of all rays.
    pub iterations: f64,
}

impl Judgement {
    /// Whether an error budget is kept.
    pub fn is_within(&self, budget: &Budget) -> bool {
        self.missed <= budget.missed && self.early <= budget.early && self.median_error <= budget.error
    }

    /// Whether these rays are evidence that an error budget is broken: at a rate of the budget itself, so many would be
    /// missed (or early) in less than one of twenty such samples. A single miss of 150 hits is none.
    pub fn is_evidence_against(&self, budget: &Budget) -> bool {
        let is_too_much = |share: f64, of: usize, allowed: f64| {
            let count = (share * of as f64).round() as usize;
            share > allowed && chance_of_at_least(count, of, allowed) < UNLIKELY
        };
        is_too_much(self.missed, self.hits, budget.missed)
            || is_too_much(self.early, self.stops, budget.early)
            || self.median_error > budget.error
    }
}

/// The chance of `count` or more of `of` independent events that happen at `rate` each.
pub fn chance_of_at_least(count: usize, of: usize, rate: f64) -> f64 {
    // By logarithms: of many events the first terms are below the least number.
    let mut term = of as f64 * (1.0 - rate).ln();
    let odds = (rate / (1.0 - rate).max(f64::MIN_POSITIVE)).ln();
    let mut below = 0.0;
    for k in 0..count {
        below += term.exp();
        term += (of.saturating_sub(k) as f64 / (k + 1) as f64).ln() + odds;
    }
    1.0 - below
}

/// The march of a candidate: its choices (one for each orbit of the field) and how it steps.
pub fn candidate(composer: &Composer, choices: &[Choice], settings: &MarchSettings) -> ComposeResult<Kernel> {
    let estimator = compose_estimator(composer, choices, Purpose::March)?;
    Ok(Kernel::March(compose_march(composer.arena, estimator, settings)))
}

/// Marches rays, clipped to the bounding sphere, on a back end.
pub fn march_rays<B: Backend>(
    backend: &B,
    arena: &Arena,
    march: &Kernel,
    rays: &[Ray],
    bounding_radius: f64,
) -> Result<Vec<End>, BackendError> {
    let prepared = backend.prepare(arena, march)?;
    let columns = backend.upload(&ray_columns(rays, bounding_radius))?;
    Ok(ends(&backend.download(&backend.run(&prepared, &[&columns])?)?, rays.len()))
}

/// The ends of the first `count` rays from the columns of a march.
pub fn ends(out: &[Vec<f64>], count: usize) -> Vec<End> {
    let end = |march: Marched<f64>| End {
        status: march.end(),
        undecided: is_undecided(march.last_de, march.steps, march.end()),
        t: march.t,
        estimates: march.steps as u64,
        iterations: march.iterations as u64,
        nan: march.nan > 0.0,
    };
    Marched::of(out).rays().take(count).map(end).collect()
}

impl Truths {
    /// Compares a march of the same rays with the truth. Panics unless there is an end for each ray.
    pub fn judge(&self, ends: &[End]) -> Judgement {
        assert_eq!(ends.len(), self.rays.len(), "a march of other rays");
        let [hits, misses, ambiguous] = self.counts();
        let mut judged = Judgement { hits, misses, ambiguous, thin: self.thin(), ..Judgement::default() };
        let (mut missed, mut early, mut stops) = ([0usize; 2], 0usize, 0usize);
        let mut errors = Vec::new();
        for (i, end) in ends.iter().enumerate() {
            judged.nan += usize::from(end.nan);
            judged.estimates += end.estimates as f64;
            judged.iterations += end.iterations as f64;
            if self.depths[i] == Truth::Ambiguous {
                continue;
            }
            judged.unfinished += usize::from(end.status == Status::Unfinished);
            judged.undecided += usize::from(end.undecided);
            stops += usize::from(end.depth().is_some());
            if self.is_early(i, end) {
                match self.are_members_near(&[(self.rays[i], end.t)])[0] {
                    true => judged.finer += 1,
                    false => early += 1,
                }
            }
            let Some(truth) = self.depths[i].depth() else { continue };
            let error = end.depth().map_or(f64::INFINITY, |t| (t - truth) / self.scale.footprint(truth));
            missed[usize::from(self.thick[i])] += usize::from(error > BEHIND_FOOTPRINTS);
            // Proofs speak of the set itself, not of what a pixel shows of it.
            let passed = || self.members().inside(&[point(self.rays[i], truth)], &[0.0])[0];
            judged.disproven += usize::from(error > BEHIND_FOOTPRINTS && !end.undecided && passed());
            errors.push(error.abs());
        }
        let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
        judged.missed = share(missed[0] + missed[1], hits);
        judged.missed_thin = share(missed[0], judged.thin);
        judged.missed_thick = share(missed[1], hits - judged.thin);
        judged.early = share(early, stops);
        judged.stops = stops;
        judged.estimates /= ends.len().max(1) as f64;
        judged.iterations /= ends.len().max(1) as f64;
        errors.sort_by(f64::total_cmp);
        judged.median_error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
        judged
    }

    /// Whether a march stopped in front of the truth, or where there is nothing.
    pub fn is_early(&self, ray: usize, end: &End) -> bool {
        let Some(t) = end.depth() else { return false };
        match self.depths[ray] {
            Truth::Hit(truth) => {
                let slack = (EARLY * self.scale.bounding_radius).min(EARLY_FOOTPRINTS * self.scale.footprint(truth));
                t < truth - slack
            }
            Truth::Miss => true,
            Truth::Ambiguous => false,
        }
    }

    /// Which of these depths on rays are members of the set.
    pub fn are_members(&self, places: &[(Ray, f64)]) -> Vec<bool> {
        let points: Vec<[f64; 3]> = places.iter().map(|&(ray, t)| point(ray, t)).collect();
        let eps: Vec<f64> = places.iter().map(|(_, t)| self.scale.pixel.radius(*t)).collect();
        self.members().inside(&points, &eps)
    }
}

/// Marches random rays of the formula's own view as a picture of these settings would, in f64, and compares them with the
/// truth.
pub fn judge(subject: &Subject, rays: usize, settings: &RenderSettings) -> Result<Judgement, String> {
    // Rays meet the solid, of which a plane is a cut.
    let graph = subject.graph.clone().without_plane();
    let composer = Composer { graph: &graph, ..subject.composer() };
    let pipeline = compose_pipeline(&composer, settings).map_err(|e| e.rendered(&subject.library.sources))?;
    let scale = Scale::of_view(&pipeline.camera, settings.size, pipeline.plan.bounding_radius);
    let rays = view_rays(&pipeline.camera, settings.size, rays, 4);
    let truths = Truths::find(&composer, &pipeline.plan.choices, &rays, scale, &mut |_| true);
    let truths = truths.map_err(|error| error.rendered(&subject.library.sources))?;
    let ends = march_rays(
        &Cpu::new(Precision::F64),
        subject.arena,
        pipeline.kernel(Role::March),
        &truths.rays,
        scale.bounding_radius,
    );
    Ok(truths.judge(&ends.map_err(|error| error.to_string())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chances_are_binomial() {
        // Of two coins: at least one head 3/4, two 1/4.
        assert!((chance_of_at_least(1, 2, 0.5) - 0.75).abs() < 1e-12);
        assert!((chance_of_at_least(2, 2, 0.5) - 0.25).abs() < 1e-12);
        assert_eq!(chance_of_at_least(0, 100, 0.3), 1.0);
        assert!(chance_of_at_least(3, 2, 0.5).abs() < 1e-12);
        // Near the mean of very many it is a half.
        assert!((chance_of_at_least(2500, 50_000, 0.05) - 0.5).abs() < 0.01);
    }

    #[test]
    fn few_misses_of_few_hits_are_no_evidence() {
        let budget = Budget::default();
        let judged = |missed: usize, hits: usize| Judgement {
            hits,
            stops: hits,
            missed: missed as f64 / hits as f64,
            ..Judgement::default()
        };
        assert!(!judged(1, 150).is_within(&budget) && !judged(1, 150).is_evidence_against(&budget));
        assert!(judged(4, 150).is_evidence_against(&budget));
        assert!(!judged(8, 1500).is_evidence_against(&budget));
        assert!(judged(15, 1500).is_evidence_against(&budget));
        let early = Judgement { early: 0.15, ..judged(0, 100) };
        assert!(early.is_evidence_against(&budget));
        let off = Judgement { median_error: 0.6, ..judged(0, 100) };
        assert!(off.is_evidence_against(&budget));
    }
}
