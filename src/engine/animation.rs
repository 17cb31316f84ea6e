//! The frames of an animation, settled together: one framing, one limit of iterations, one precision and, where they agree, one
//! estimate, so that nothing jumps from frame to frame.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::{CameraChange, Error, Observer, Request, Settling};
use crate::compose::Plan;
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::graph::{EstimateSettings, ValidGraph};
use crate::math::Precision;
use crate::render::Iterations;

/// A frame before it is settled.
pub struct Frame {
    /// The graph with the frame's values.
    pub graph: ValidGraph,
    /// What the frame changes of the camera.
    pub camera: CameraChange,
}

/// Frames with their views, in the precision that the finest of them needs.
pub struct Animation<'a> {
    library: &'a Library,
    request: &'a Request,
    /// The graph of each frame, seen as that frame sees it.
    pub graphs: Vec<ValidGraph>,
    /// The precision of all.
    pub precision: Precision,
}

/// How the frames' estimates are chosen.
pub enum Estimates {
    /// The same for all: the key frames agree on method and form, and the smallest fudge and shortest step are safe for
    /// all of them.
    Shared(EstimateSettings),
    /// Every frame is measured by itself.
    Own,
}

impl<'a> Animation<'a> {
    /// Settles views, iterations and precision of frames, of which there is at least one.
    pub fn settle(
        library: &'a Library,
        request: &'a Request,
        frames: Vec<Frame>,
        observer: &mut dyn Observer,
    ) -> Result<Animation<'a>, Error> {
        let asked = request.first_precision()?;
        let mut animation = Animation { library, request, graphs: Vec::new(), precision: asked };
        let is_own = frames.iter().all(|frame| frame.camera.is_empty());
        animation.view(frames)?;
        animation.limit(is_own)?;
        animation.tone()?;
        for graph in key_frames(&animation.graphs) {
            let arena = Arc::new(Arena::default());
            let settling = Settling { library, arena: &arena, request };
            let resolution = settling.resolution(graph, settling.plan(graph)?, asked)?;
            animation.precision = settling.precision(animation.precision, &resolution, observer);
        }
        Ok(animation)
    }

    /// Gives every frame its camera. One framing serves all: each framed by itself would jump.
    fn view(&mut self, frames: Vec<Frame>) -> Result<(), Error> {
        let mut base = None;
        for Frame { graph, camera } in frames {
            let arena = Arc::new(Arena::default());
            let request = Request { camera, ..self.request.clone() };
            let settling = Settling { library: self.library, arena: &arena, request: &request };
            let graph = match base {
                Some(camera) if graph.scene.camera.is_none() && graph.scene.plane.is_none() => {
                    graph.with_camera(camera)
                }
                _ => settling.framed(graph)?.graph,
            };
            base = base.or(graph.scene.camera);
            let graph = settling.viewed(graph)?.graph;
            // The light of the first frame's view lights all.
            self.graphs.push(graph.at_home(base));
        }
        Ok(())
    }

    /// Gives all frames the largest limit of iterations that a key frame needs.
    fn limit(&mut self, is_own: bool) -> Result<(), Error> {
        let mut most: Option<Iterations> = None;
        for graph in key_frames(&self.graphs) {
            let arena = Arc::new(Arena::default());
            let settling = Settling { library: self.library, arena: &arena, request: self.request };
            let found = settling.iterations(graph, is_own)?;
            most = most.map_or(found, |most| Some(found.map_or(most, |found| most.max(found))));
        }
        if let Some(most) = most {
            self.graphs = self.graphs.iter().map(|graph| most.apply(graph)).collect();
        }
        Ok(())
    }

    /// Places the gradients of all frames by what the first one shows, so that colours stay where they are.
    fn tone(&mut self) -> Result<(), Error> {
        let Some(first) = self.graphs.first() else { return Ok(()) };
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: self.library, arena: &arena, request: self.request };
        let tones = settling.toned(first.clone(), &settling.plan(first)?)?.scene.look.tones();
        if !tones.is_empty() {
            self.graphs = self.graphs.iter().map(|graph| graph.clone().with_tones(&tones)).collect();
        }
        Ok(())
    }

    /// Chooses the estimates by the key frames.
    pub fn estimates(&self, observer: &mut dyn Observer) -> Result<Estimates, Error> {
        let mut chosen = Vec::new();
        for graph in key_frames(&self.graphs) {
            let arena = Arc::new(Arena::default());
            let settling = Settling { library: self.library, arena: &arena, request: self.request };
            let calibration = settling.estimate(graph, settling.plan(graph)?, self.precision, observer)?;
            chosen.push(calibration.chosen);
        }
        let first = chosen[0];
        if chosen.iter().any(|other| (other.method, other.form) != (first.method, first.form)) {
            return Ok(Estimates::Own);
        }
        let least = |of: fn(&EstimateSettings) -> Option<f64>| chosen.iter().filter_map(of).reduce(f64::min);
        let [fudge, least_step, most_step] = [least(|s| s.fudge), least(|s| s.least_step), least(|s| s.most_step)];
        let late_ends = chosen.iter().any(|s| s.late_ends == Some(true)).then_some(true);
        let shared = EstimateSettings { fudge, least_step, most_step, late_ends, ..first };
        Ok(Estimates::Shared(shared.or(self.request.estimate)))
    }

    /// The plan of a frame whose expressions go to `arena`.
    pub fn plan(
        &self,
        number: usize,
        estimates: &Estimates,
        arena: &Arc<Arena>,
        observer: &mut dyn Observer,
    ) -> Result<Plan, Error> {
        let graph = &self.graphs[number];
        match estimates {
            Estimates::Shared(wanted) => {
                let request = Request { estimate: *wanted, ..self.request.clone() };
                Settling { library: self.library, arena, request: &request }.plan(graph)
            }
            Estimates::Own => {
                let settling = Settling { library: self.library, arena, request: self.request };
                Ok(settling.estimate(graph, settling.plan(graph)?, self.precision, observer)?.plan)
            }
        }
    }
}

/// First, middle and last frame: those that speak for the others.
fn key_frames(graphs: &[ValidGraph]) -> Vec<&ValidGraph> {
    let last = graphs.len() - 1;
    BTreeSet::from([0, last / 2, last]).into_iter().map(|i| &graphs[i]).collect()
}
