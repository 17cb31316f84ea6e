//! What a render counts and how long it takes.

use std::time::Duration;

use crate::kernel::records::Marched;
use crate::kernel::{Compiling, Status};
use crate::march::is_undecided;

/// What a render counted. Rays are the primary ones, all samples of all pixels.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Stats {
    /// Primary rays.
    pub rays: u64,
    /// Pixels that got all their samples.
    pub refined: u64,
    /// Rays that hit.
    pub hits: u64,
    /// Rays that ran out of steps.
    pub unfinished: u64,
    /// Rays with an estimate that was not a number.
    pub nan: u64,
    /// With a certified method, rays that crossed something unproven: neither proven empty nor a hit within a few
    /// thresholds. `None` with estimates, which prove nothing.
    pub undecided: Option<u64>,
    /// Estimates of primary rays.
    pub estimates: u64,
    /// Most march steps of a ray.
    pub max_steps: u64,
    /// Iterations of all estimates of primary rays.
    pub iterations: u64,
    /// Beams: cones of rays that were marched before the rays themselves.
    pub beams: u64,
    /// Whether there are none because rays end elsewhere with them, or the picture is too small to tell.
    pub are_beams_wrong: bool,
    /// Estimates of beams; `estimates` does not hold them.
    pub beam_estimates: u64,
    /// Estimates of shadow rays.
    pub shadow_estimates: u64,
    /// Time to compile kernels.
    pub compile: Duration,
    /// What the back end has compiled by then, where it keeps account.
    pub compiling: Option<Compiling>,
    /// Time to render, without compiling.
    pub render: Duration,
    /// Time in marches of primary rays and beams, summed over threads.
    pub march: Duration,
    /// Time in marches of shadow rays, summed over threads.
    pub shadow: Duration,
    /// Time in everything else that is computed of rays and colours, summed over threads.
    pub shade: Duration,
    /// Time in which results were waited for, counted and set, summed over threads. A back end that runs kernels while the
    /// next ones are handed to it is waited for here, and the times above are those of handing over.
    pub results: Duration,
}

impl Stats {
    /// Adds what a part of the picture counted. Times of compiling and of the whole render are not a part's.
    pub fn add(&mut self, part: &Stats) {
        self.rays += part.rays;
        self.refined += part.refined;
        self.hits += part.hits;
        self.unfinished += part.unfinished;
        self.nan += part.nan;
        if let Some(undecided) = &mut self.undecided {
            *undecided += part.undecided.unwrap_or(0);
        }
        self.estimates += part.estimates;
        self.max_steps = self.max_steps.max(part.max_steps);
        self.iterations += part.iterations;
        self.beams += part.beams;
        self.beam_estimates += part.beam_estimates;
        self.shadow_estimates += part.shadow_estimates;
        self.march += part.march;
        self.shadow += part.shadow;
        self.shade += part.shade;
        self.results += part.results;
    }

    /// The columns of a march's output that [`Stats::count`] takes; the status is the first.
    pub(super) fn counted(&self) -> Vec<usize> {
        // Only proofs are asked for the last estimate.
        let Marched { last_de, status, steps, iterations, nan, .. } = Marched::COLUMNS;
        let last = self.undecided.map(|_| last_de);
        [status, steps, iterations, nan].into_iter().chain(last).collect()
    }

    /// Counts the marches of primary rays; `hits` are the columns [`Stats::counted`] of a march's output.
    pub(super) fn count<N: Copy + Into<f64>>(&mut self, hits: &[&[N]]) {
        let column = |number: usize| hits[number].iter().map(|&x| x.into());
        let [status, steps, iterations, nan] = [0, 1, 2, 3].map(column);
        self.rays += hits[0].len() as u64;
        let [hit, miss] = [Status::Hit, Status::Miss].map(Status::code);
        let (mut estimates, mut iterated, mut longest) = (0.0, 0.0, 0.0_f64);
        for ((code, steps), (iterations, nan)) in status.zip(steps).zip(iterations.zip(nan)) {
            self.hits += u64::from(code == hit);
            self.unfinished += u64::from(code != hit && code != miss);
            self.nan += u64::from(nan > 0.0);
            estimates += steps;
            iterated += iterations;
            longest = if steps > longest { steps } else { longest };
        }
        self.estimates += estimates as u64;
        self.iterations += iterated as u64;
        self.max_steps = self.max_steps.max(longest as u64);
        if let Some(undecided) = &mut self.undecided {
            let rays = column(4).zip(column(1)).zip(column(0));
            let is_open =
                |&((last, steps), code): &((f64, f64), f64)| is_undecided(last, steps, Status::from_code(code));
            *undecided += rays.filter(is_open).count() as u64;
        }
    }
}
