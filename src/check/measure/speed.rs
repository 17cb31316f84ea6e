//! How fast a picture's rays are marched on a back end: times of several runs, and what was counted in them.
//!
//! In comes a [`Pipeline`] and a back end; out comes a [`Speed`]. The rays are those of pixels on
//! an even grid over the picture: all of them where the back end is fast enough for the time that is given.

use std::time::{Duration, Instant};

use crate::expr::Arena;
use crate::kernel::records::Marched;
use crate::kernel::{Backend, BackendError};
use crate::render::passes::{Chain, Slot, centres};
use crate::render::{Pipeline, Role};
use crate::shade::Size;

/// Runs that are made at least, after one that warms up and is not counted.
const LEAST_RUNS: usize = 3;
/// Runs that are made at most.
const MOST_RUNS: usize = 50;
/// Pixels of the first, uncounted run on a sample.
const FIRST_PIXELS: usize = 2048;

/// Times of repeated runs of the same work.
#[derive(Clone, PartialEq, Debug)]
pub struct Times(Vec<Duration>);

impl Times {
    /// Runs `work` for about as long as `enough`, at least three times.
    pub fn of<E>(enough: Duration, mut work: impl FnMut() -> Result<Duration, E>) -> Result<Times, E> {
        let begin = Instant::now();
        let mut times = Vec::new();
        while times.len() < LEAST_RUNS || (times.len() < MOST_RUNS && begin.elapsed() < enough) {
            times.push(work()?);
        }
        times.sort();
        Ok(Times(times))
    }

    /// The fastest.
    pub fn fastest(&self) -> Duration {
        self.0[0]
    }

    /// The median.
    pub fn median(&self) -> Duration {
        self.0[self.0.len() / 2]
    }

    /// How much longer than the fastest the median is, as a share of the fastest: what the machine's other work did.
    pub fn spread(&self) -> f64 {
        self.median().as_secs_f64() / self.fastest().as_secs_f64().max(1e-12) - 1.0
    }

    /// Number of runs.
    pub fn runs(&self) -> usize {
        self.0.len()
    }
}

/// What a march did to the rays of a picture.
#[derive(Clone, PartialEq, Debug)]
pub struct Speed {
    /// Rays marched in each run.
    pub pixels: usize,
    /// Estimates of one run.
    pub estimates: f64,
    /// Iterations of all of them.
    pub iterations: f64,
    /// Times of the runs, without compiling and copying.
    pub times: Times,
}

impl Speed {
    /// Nanoseconds of a ray in the fastest run.
    pub fn ns_per_pixel(&self) -> f64 {
        self.times.fastest().as_nanos() as f64 / self.pixels.max(1) as f64
    }

    /// Estimates of a ray.
    pub fn estimates_per_pixel(&self) -> f64 {
        self.estimates / self.pixels.max(1) as f64
    }

    /// Iterations of an estimate.
    pub fn iterations_per_estimate(&self) -> f64 {
        self.iterations / self.estimates.max(1.0)
    }
}

/// Every pixel of a picture in groups of neighbours that back ends work on together, or an even grid of about `count`.
pub fn pixels(size: Size, count: usize) -> Vec<(u32, u32)> {
    let all = size.width as usize * size.height as usize;
    if count >= all {
        return crate::film::tiles(size).iter().flat_map(|tile| tile.pixels()).collect();
    }
    let stride = (all as f64 / count.max(1) as f64).sqrt().ceil().max(1.0) as usize;
    let line = move |length: u32| (0..length).skip((stride / 2).min(length as usize - 1)).step_by(stride);
    line(size.height).flat_map(|y| line(size.width).map(move |x| (x, y))).collect()
}

/// How runs are timed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Timing {
    /// Time to spend, about.
    pub enough: Duration,
    /// True for back ends that few pixels do not keep busy: all are marched, however long that takes.
    pub is_device: bool,
}

/// How a back end is asked to run a kernel on columns.
pub type Run<'a, B> =
    &'a dyn Fn(&<B as Backend>::Prepared, &<B as Backend>::Columns) -> Result<<B as Backend>::Columns, BackendError>;

/// Times the march of a picture's rays, run by `run`, which is the back end's own or does that on some threads.
pub fn march_speed<B: Backend>(
    backend: &B,
    arena: &Arena,
    pipeline: &Pipeline,
    size: Size,
    timing: Timing,
    run: Run<B>,
) -> Result<Speed, BackendError> {
    let camera = Chain::compile(backend, arena, &pipeline.passes, &[Slot::Points], &[Slot::Rays])?;
    let march = backend.prepare(arena, pipeline.kernel(Role::March))?;
    let rays = |pixels: &[(u32, u32)]| camera.write(backend, Slot::Points, &centres(pixels), Slot::Rays);
    let timed = |rays: &B::Columns| {
        let start = Instant::now();
        let out = run(&march, rays)?;
        backend.finish()?;
        Ok((start.elapsed(), out))
    };
    // A sample says how many pixels can be marched often enough.
    let all = size.width as usize * size.height as usize;
    let sample = pixels(size, FIRST_PIXELS);
    let (first, _) = timed(&rays(&sample)?)?;
    let each = first.as_secs_f64() / sample.len() as f64;
    let fit = (timing.enough.as_secs_f64() / (LEAST_RUNS + 1) as f64 / each.max(1e-12)) as usize;
    let chosen = pixels(size, if timing.is_device { all } else { fit.max(FIRST_PIXELS) });
    let rays = rays(&chosen)?;
    let out = backend.download(&timed(&rays)?.1)?;
    let Marched { steps, iterations, .. } = Marched::of(&out).map(|column| column.iter().sum::<f64>());
    let times = Times::of(timing.enough, || timed(&rays).map(|(time, _)| time))?;
    Ok(Speed { pixels: chosen.len(), estimates: steps, iterations, times })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::{Times, pixels};
    use crate::shade::Size;

    #[test]
    fn the_fastest_and_the_median_of_several_runs_count() {
        let mut all = [5u64, 1, 3].into_iter();
        let times = Times::of(Duration::ZERO, || Ok::<_, ()>(Duration::from_millis(all.next().unwrap_or(9))));
        let times = times.expect("nothing fails");
        assert_eq!((times.fastest().as_millis(), times.median().as_millis(), times.runs()), (1, 3, 3));
        assert!((times.spread() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn samples_are_even_and_never_empty() {
        let size = Size { width: 64, height: 48 };
        assert_eq!(pixels(size, usize::MAX).len(), 64 * 48);
        let some = pixels(size, 100);
        assert!((50..=100).contains(&some.len()), "{}", some.len());
        assert!(some.iter().all(|p| p.0 < 64 && p.1 < 48));
        assert_eq!(pixels(Size { width: 1, height: 1 }, 0).len(), 1);
        assert!(!pixels(Size { width: 9000, height: 1 }, 5).is_empty());
    }
}
