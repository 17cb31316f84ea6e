//! Mirrored rays of a part of the picture: ray after ray, each from where the one before met a surface that mirrors.

use super::passes::{Chain, Passes, Role, Slot, Written};
use super::renderer::timed;
use super::{Renderer, Stats};
use crate::kernel::{Backend, BackendError};

/// Passes of mirrored rays, made ready on a back end.
pub(super) struct Mirror<B: Backend> {
    /// Mirrored rays and their ends to what is shown with them, and to the next rays.
    step: Chain<B>,
    /// What is shown to colours.
    end: Chain<B>,
    /// Those to what is kept besides.
    data: Option<Chain<B>>,
    /// Rays that follow each other at most.
    most: u32,
}

/// Colours, and the marches that led to them.
type Shown<C> = (C, Vec<C>);

impl<B: Backend> Mirror<B> {
    /// Makes the passes of mirrored rays ready; `chain` makes those that lead from some slots to others.
    pub fn new(
        passes: &Passes<()>,
        most: u32,
        has_data: bool,
        chain: &mut impl FnMut(&[Slot], &[Slot]) -> Result<Chain<B>, BackendError>,
    ) -> Result<Mirror<B>, BackendError> {
        let marches = passes.iter().map(|pass| pass.writes).filter(|slot| slot.is_further_march());
        let marches = marches.filter(|slot| *slot != Slot::Passing);
        let wanted: Vec<Slot> = [Slot::MirrorsAfter, Slot::NextRays].into_iter().chain(marches).collect();
        let data = has_data.then(|| chain(&[Slot::Rays, Slot::Ends, Slot::Colours], &[Slot::Data]));
        Ok(Mirror {
            step: chain(&[Slot::Rays, Slot::Ends, Slot::Mirrors], &wanted)?,
            end: chain(&[Slot::MirrorsAfter], &[Slot::Colours])?,
            data: data.transpose()?,
            most,
        })
    }

    /// What is kept of pixels besides their colours.
    pub fn data(
        &self,
        backend: &B,
        (rays, ends, colours): (&B::Columns, &B::Columns, &B::Columns),
    ) -> Result<Option<B::Columns>, BackendError> {
        let Some(data) = &self.data else { return Ok(None) };
        let given = [(Slot::Rays, rays), (Slot::Ends, ends), (Slot::Colours, colours)];
        Ok(data.run(backend, &given, |_, _| {})?.take(Slot::Data))
    }
}

impl<B: Backend> Renderer<'_, B> {
    /// The colours with what mirrors show, from what the passes of the picture's own rays wrote.
    pub(super) fn mirrored(
        &self,
        mirror: &Mirror<B>,
        first: &mut Written<B::Columns>,
        stats: &mut Stats,
    ) -> Result<Shown<B::Columns>, BackendError> {
        let mut shown = first.take(Slot::MirrorsAfter).expect("the first step says what is shown");
        let mut rays = first.take(Slot::NextRays).expect("a surface gives the mirrored ray");
        let mut marches = Vec::new();
        for _ in 0..mirror.most {
            let ends = timed(&mut stats.shadow, || self.ends(&rays))?;
            let given = [(Slot::Rays, &rays), (Slot::Ends, &ends), (Slot::Mirrors, &shown)];
            let mut written = mirror.step.run(self.backend, &given, |role, time| match role {
                Role::ShadowMarch(_) | Role::CornerMarch => stats.shadow += time,
                _ => stats.shade += time,
            })?;
            shown = written.take(Slot::MirrorsAfter).expect("a step says what is shown");
            rays = written.take(Slot::NextRays).expect("a surface gives the mirrored ray");
            marches.push(ends);
            marches.extend(written.rest());
        }
        let mut written = mirror.end.run(self.backend, &[(Slot::MirrorsAfter, &shown)], |_, _| {})?;
        Ok((written.take(Slot::Colours).expect("what is shown has colours"), marches))
    }
}
