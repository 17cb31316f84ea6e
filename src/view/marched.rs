//! Marching the centre of every pixel, and what is asked about each of them.

use super::View;
use crate::check::truth::{self, Scale, Truths};
use crate::compose::{ComposeResult, Composer, Purpose, compose_estimator};
use crate::expr::Arena;
use crate::film::tiles;
use crate::kernel::cpu::Cpu;
use crate::kernel::records::{Marched, Ray};
use crate::kernel::{Backend, BackendError, Kernel, Status};
use crate::march::stop_at_crossing;
use crate::math::Precision;
use crate::render::passes::{Chain, Passes, Slot, centres};
use crate::render::{Marches, Pipeline, Role};
use crate::shade::Size;

/// Pixels that are marched at once.
const BATCH: usize = 1 << 14;

/// The kernels of a view.
pub struct ViewKernels<'a> {
    pipeline: &'a Pipeline,
    /// The march that ends where the surface is crossed.
    crossing: Option<Kernel>,
    /// Hits to the origin of the estimate in front of them.
    decision: Option<Passes<Kernel>>,
}

/// What the marches of all pixels gave. All lists are in the order of `pixels`.
pub struct PixelMarches {
    /// Columns and rows.
    pub size: Size,
    /// Columns of [`Marched`].
    pub hits: Vec<Vec<f64>>,
    /// Where the first step behind the surface landed, as a depth; negative where there was none. Empty unless asked for.
    pub crossing: Vec<f64>,
    /// The last point in front of the surface before that step. Empty unless asked for.
    pub before: Vec<f64>,
    /// Number of what the estimate in front of the hit came from. Empty unless asked for.
    pub decider: Vec<f64>,
}

impl<'a> ViewKernels<'a> {
    /// Composes what a view needs besides the pipeline's own kernels.
    pub fn new(composer: &Composer, pipeline: &'a Pipeline, view: View) -> ComposeResult<ViewKernels<'a>> {
        let crossing = match view {
            View::Overshoot | View::Confidence => {
                Some(Kernel::March(stop_at_crossing(composer.arena, pipeline.march())))
            }
            _ => None,
        };
        let decision = match view {
            View::Method => {
                let estimator = compose_estimator(composer, &pipeline.plan.choices, Purpose::Decision)?;
                let mut passes = Passes::default();
                let point = pipeline.kernel(Role::SurfacePoint).clone();
                passes.push(Role::SurfacePoint, [Slot::Rays, Slot::Ends], Slot::Queries, point);
                passes.push(Role::Surface, [Slot::Queries], Slot::Surfaces, Kernel::Estimate(estimator));
                Some(passes)
            }
            _ => None,
        };
        Ok(ViewKernels { pipeline, crossing, decision })
    }

    /// Marches all pixels. `progress` receives the share that is done.
    pub fn run<B: Backend>(
        &self,
        backend: &B,
        arena: &Arena,
        size: Size,
        progress: &mut dyn FnMut(f64),
    ) -> Result<PixelMarches, BackendError> {
        let prepare = |kernel: &Kernel| backend.prepare(arena, kernel);
        let marches = Marches::new(backend, arena, &self.pipeline.passes)?;
        let crossing = self.crossing.as_ref().map(prepare).transpose()?;
        let seen = [Slot::Rays, Slot::Ends];
        let decision =
            self.decision.as_ref().map(|passes| Chain::compile(backend, arena, passes, &seen, &[Slot::Surfaces]));
        let decision = decision.transpose()?;
        let mut marched = PixelMarches {
            size,
            hits: vec![Vec::new(); Marched::WIDTH],
            crossing: Vec::new(),
            before: Vec::new(),
            decider: Vec::new(),
        };
        let pixels = pixels(size);
        for batch in pixels.chunks(BATCH) {
            let rays = marches.rays(backend, &centres(batch))?;
            let hits = marches.ends(backend, &rays)?;
            let columns = backend.download(&hits)?;
            marched.hits.iter_mut().zip(columns).for_each(|(all, part)| all.extend(part));
            if let Some(crossing) = &crossing {
                let ends = backend.download(&backend.run(crossing, &[&rays])?)?;
                let ends = Marched::of(&ends);
                marched.crossing.extend(ends.t_inside);
                marched.before.extend(ends.t_outside);
            }
            if let Some(decision) = &decision {
                let written = decision.run(backend, &[(Slot::Rays, &rays), (Slot::Ends, &hits)], |_, _| {})?;
                for decided in written.rest() {
                    let decided = backend.download(&decided)?;
                    marched.decider.extend(decided.last().expect("a decision has outputs"));
                }
            }
            progress(marched.hits[0].len() as f64 / pixels.len() as f64);
        }
        Ok(marched)
    }
}

impl PixelMarches {
    /// What the marches gave.
    pub fn ends(&self) -> Marched<&[f64]> {
        Marched::of(&self.hits)
    }

    /// How the ray of a pixel ended.
    pub fn status(&self, i: usize) -> Status {
        self.ends().ray(i).end()
    }
}

/// All pixels of a picture in the order in which they are marched: tile by tile, neighbours together.
pub fn pixels(size: Size) -> Vec<(u32, u32)> {
    tiles(size).iter().flat_map(|tile| tile.pixels()).collect()
}

/// Walks the rays through all pixels' centres by brute force, in f64; in the order of `pixels`. `progress` receives the
/// share that is done.
pub fn find_truths(
    composer: &Composer,
    pipeline: &Pipeline,
    size: Size,
    progress: &mut dyn FnMut(f64),
) -> ComposeResult<Truths> {
    let cpu = Cpu::new(Precision::F64);
    let run = || -> Result<Vec<Vec<f64>>, BackendError> {
        let camera = cpu.prepare(composer.arena, pipeline.kernel(Role::Camera))?;
        cpu.download(&cpu.run(&camera, &[&cpu.upload(&centres(&pixels(size)))?])?)
    };
    let columns = run().expect("the CPU runs every kernel");
    let vector = |first: usize, i: usize| [0, 1, 2].map(|k| columns[first + k][i]);
    let Ray { origin, direction, .. } = Ray::COLUMNS;
    let rays: Vec<truth::Ray> = (0..columns[origin].len()).map(|i| (vector(origin, i), vector(direction, i))).collect();
    let scale = Scale::of_view(&pipeline.camera, size, pipeline.plan.bounding_radius);
    let mut told = |share: f64| {
        progress(share);
        true
    };
    Truths::find(composer, &pipeline.plan.choices, &rays, scale, &mut told)
}
