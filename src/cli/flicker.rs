//! `bulbfold animate --check`: small pictures of neighbouring frames, and what flickers in them.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::Write;

use bulbfold::engine::{Animation, Moments, Observer, Request, Stage};
use bulbfold::film::{Flicker, Layer, Layers, Rows, Sight, flicker};
use bulbfold::shade::Size;

use super::moments::FilmMoments;
use super::{Failure, Outcome, Session};

/// Columns of the small pictures.
const COLUMNS: u32 = 192;
/// Frames that are looked at, each between its neighbours.
const LOOKED_AT: usize = 24;
/// What is flicker: shares of pixels, and of the brightness.
const MOST: Flicker = Flicker { hits: 0.003, brightness: 0.01, step: 0.02 };

/// Checks frames of a film, and prints what flickers.
pub fn check(
    session: &Session,
    (moments, frames): (&FilmMoments, &[u32]),
    request: &Request,
    out: &mut dyn Write,
) -> Outcome {
    let failed = |error| session.failed(error);
    let Size { width, height } = request.size;
    let size = Size { width: COLUMNS.min(width), height: (height * COLUMNS.min(width) / width).max(1) };
    let request = Request { size, samples: 2, layers: Layers::NONE.and(Layer::Depth), path: None, ..request.clone() };
    let mut watch = session.watch();
    let mut animation = Animation::settle(moments, &request, &mut watch).map_err(failed)?;
    let [first, last] = [frames[0], frames[frames.len() - 1]];
    if last < first + 2 {
        return Err(super::usage("flicker shows in three frames and more", "give more --frames or --seconds"));
    }
    let inner = (last - first - 1) as usize;
    let looked = inner.min(LOOKED_AT);
    let middles: Vec<u32> = (0..looked).map(|i| first + 1 + (i * inner / looked) as u32).collect();
    let (mut seen, mut flickers) = (BTreeMap::new(), 0);
    for (i, &middle) in middles.iter().enumerate() {
        for frame in middle - 1..=middle + 1 {
            if let Entry::Vacant(entry) = seen.entry(frame) {
                entry.insert(sight(session, &mut animation, (frame * moments.clock.blur) as usize)?);
            }
        }
        seen.retain(|frame, _| *frame + 1 >= middle);
        let found = flicker(&seen[&(middle - 1)], &seen[&middle], &seen[&(middle + 1)]);
        let is_bad = found.hits > MOST.hits || found.brightness > MOST.brightness || found.step > MOST.step;
        flickers += usize::from(is_bad);
        if is_bad {
            writeln!(
                out,
                "frame {}: hits of {:.2} % of the pixels jump, {:.2} % flash, the brightness steps by {:.1} %",
                middle + 1,
                100.0 * found.hits,
                100.0 * found.brightness,
                100.0 * found.step
            )?;
        }
        watch.progress(Stage::Rendering, (i + 1) as f64 / looked as f64);
    }
    drop(watch);
    let count = moments.count() / moments.clock.blur as usize;
    writeln!(
        out,
        "{flickers} of {looked} frames flicker (of {count}; one estimate for all: {})",
        animation.estimate_name()
    )?;
    if flickers == 0 { Ok(()) } else { Err(Failure::Work("the film flickers".into())) }
}

/// Brightness and depth of a moment.
fn sight(session: &Session, animation: &mut Animation, moment: usize) -> Result<Sight, Failure> {
    let job = animation.job(moment).map_err(|error| session.failed(error))?;
    let mut sink = Small(Sight { size: job.size(), brightness: Vec::new(), depth: Vec::new() });
    session.engine.render(&job, job.rows(), &mut sink, &mut ()).map_err(|error| session.failed(error))?;
    Ok(sink.0)
}

struct Small(Sight);

impl bulbfold::engine::Sink for Small {
    fn layers(&self) -> Layers {
        Layers::SRGB.and(Layer::Depth)
    }

    fn push(&mut self, rows: Rows) -> std::io::Result<()> {
        let luma = |rgb: &[u8]| {
            let [r, g, b] = [0, 1, 2].map(|k| f32::from(rgb[k]) / 255.0);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        self.0.brightness.extend(rows.srgb.chunks_exact(3).map(luma));
        self.0.depth.extend(rows.layer(Layer::Depth));
        Ok(())
    }
}
