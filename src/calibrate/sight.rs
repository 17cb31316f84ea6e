//! The rays that candidates are judged on: a few with a truth, and many without.
//!
//! Wherever a march stops on a member of the set, whoever passes it there has missed it: so any number of rays has known
//! hits, which cost a march each and no brute force. Careful marches find most of them.

use std::ops::Range;

use super::evidence::{Count, Tally};
use super::{MOST_RAYS, Options};
use crate::check::truth::{End, Ray, Truth, Truths, view_rays};

/// A stop this many footprints behind a known member has passed it, as in [`Judgement`](crate::check::truth::Judgement).
const BEHIND_FOOTPRINTS: f64 = 2.0;

/// How a march did on one ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Depth of its stop, or infinity.
    t: f64,
    is_early: bool,
}

/// The rays, and what is known of them.
pub(super) struct Sight<'a> {
    /// Rays with a truth before the others.
    pub rays: Vec<Ray>,
    truths: &'a Truths,
    /// Depth of the first known member of each ray, or infinity.
    known: Vec<f64>,
}

impl<'a> Sight<'a> {
    pub fn new(options: &Options, truths: &'a Truths) -> Sight<'a> {
        let mut rays = truths.rays.clone();
        rays.extend(view_rays(&options.camera, options.size, MOST_RAYS.saturating_sub(rays.len()), options.seed + 1));
        let mut known = vec![f64::INFINITY; rays.len()];
        for (known, truth) in known.iter_mut().zip(&truths.depths) {
            *known = truth.depth().unwrap_or(f64::INFINITY);
        }
        Sight { rays, truths, known }
    }

    /// Rays with a truth.
    pub fn settled(&self) -> usize {
        self.truths.rays.len()
    }

    /// Judges the stops of a march on some of the rays, and learns from them which members there are.
    pub fn look(&mut self, range: Range<usize>, ends: &[End]) -> Vec<Seen> {
        let first = range.start;
        let stop = |i: usize| ends[i - first].depth();
        let mut seen: Vec<Seen> =
            ends.iter().map(|end| Seen { t: end.depth().unwrap_or(f64::INFINITY), is_early: false }).collect();
        let stops: Vec<usize> = range
            .clone()
            .filter(|&i| match i < self.settled() {
                true => self.truths.is_early(i, &ends[i - first]),
                false => stop(i).is_some(),
            })
            .collect();
        let places: Vec<(Ray, f64)> = stops.iter().map(|&i| (self.rays[i], seen[i - first].t)).collect();
        let (with, without) = places.split_at(stops.iter().filter(|&&i| i < self.settled()).count());
        let mut wrong: Vec<bool> = self.truths.are_members_near(with).into_iter().map(|near| !near).collect();
        let members = self.truths.are_members(without);
        wrong.extend(self.truths.are_early(without, &members));
        for (&i, is_early) in stops.iter().zip(wrong) {
            seen[i - first].is_early = is_early;
        }
        for (&i, _) in stops[with.len()..].iter().zip(&members).filter(|(_, is_member)| **is_member) {
            self.known[i] = self.known[i].min(seen[i - first].t);
        }
        seen
    }

    /// What a march did on the first rays.
    pub fn tally(&self, seen: &[Seen]) -> Tally {
        let mut tally = Tally::default();
        let mut errors = Vec::new();
        for (i, (seen, &known)) in seen.iter().zip(&self.known).enumerate() {
            let truth = self.truths.depths.get(i);
            if truth == Some(&Truth::Ambiguous) {
                continue;
            }
            tally.early.of += usize::from(seen.t.is_finite());
            tally.early.seen += usize::from(seen.is_early);
            if known.is_infinite() {
                continue;
            }
            let footprint = self.truths.scale.footprint(known);
            let is_missed = seen.t > known + BEHIND_FOOTPRINTS * footprint;
            add(&mut tally.missed, is_missed);
            if truth.is_some() {
                add(&mut tally.missed_truth, is_missed);
                tally.missed_thin += usize::from(is_missed && !self.truths.thick[i]);
                errors.push(((seen.t - known) / footprint).abs());
            }
        }
        errors.sort_by(f64::total_cmp);
        tally.error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
        tally
    }
}

fn add(count: &mut Count, is_seen: bool) {
    count.of += 1;
    count.seen += usize::from(is_seen);
}
