//! What a picture shows, in text: the part of a key that all kinds of pictures share.

use bulbfold::calibrate::cache::hash;
use bulbfold::diag::{Sources, Span};
use bulbfold::engine::{Error, Job};
use bulbfold::film::Layers;
use bulbfold::graph::{NodeKind, ValidGraph, print};
use bulbfold::render::RenderSettings;

/// Counts changes of what pictures show: those of older programs are other pictures.
const VERSION: u32 = 1;

/// The graph with all its settings and the texts of its steps and materials. Comments, tests, descriptions and what other moments of a
/// film show do not.
pub fn graph_text(sources: &Sources, graph: &ValidGraph) -> String {
    let mut scene = graph.scene.clone();
    scene.motion = None;
    scene.look.parts.iter_mut().for_each(|part| part.span = Span::NONE);
    let mut text = format!("{}\n{scene:?} {:?}", print::listing(graph), graph.bounding_radius);
    let materials = scene.look.paints().filter_map(|paint| paint.material.as_ref());
    materials.for_each(|used| text.push_str(sources.text(used.material.text)));
    for node in &graph.nodes {
        match &node.kind {
            NodeKind::Step { step, .. } | NodeKind::Shape { step, .. } => text.push_str(sources.text(step.text)),
            NodeKind::Orbit { settings, .. } => text.push_str(&format!("{settings:?}")),
            _ => {}
        }
    }
    text
}

/// The key of a picture: everything that its pixels follow from but the back end, which all give the same picture, and the form of
/// its files.
pub fn job_key(job: &Job) -> Result<String, Error> {
    let composed = job.composed()?;
    let settings = RenderSettings { layers: Layers::NONE, ..composed.settings.clone() };
    let graph = graph_text(&job.formula.library().sources, &composed.graph);
    let text = format!("{VERSION} {settings:?} {:?}\n{graph}", job.plan);
    Ok(format!("{:032x}", hash(text.as_bytes())))
}
