//! What commands that look at a fractal share: its view, the iterations that the view needs, and a word where the camera is in the set.

use std::sync::Arc;

use bulbfold::check::Subject;
use bulbfold::compose::{Composer, Plan, choose};
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, EstimateSettings, ValidGraph};
use bulbfold::render::{Iterations, Standpoint, camera_of, standpoint};
use bulbfold::shade::Size;

use super::{Failure, Session};

/// What a view is settled for: the picture's size, what is asked of the estimate, and whether the view is the file's own.
#[derive(Clone, Copy)]
pub struct Wanted<'a> {
    /// The picture's size.
    pub size: Size,
    /// What is asked of the estimate.
    pub estimate: &'a EstimateSettings,
    /// Whether the file chose the view.
    pub is_own: bool,
}

/// The plan that the rules make of a graph.
pub fn plan_of(
    session: &Session,
    arena: &Arc<Arena>,
    graph: &ValidGraph,
    estimate: &EstimateSettings,
) -> Result<Plan, Failure> {
    choose(&Composer { arena, library: &session.library, graph }, estimate)
        .map_err(|diagnostic| session.failure(diagnostic))
}

/// The graph with a camera: the file's, or one that frames what is there; with the plan where one was made. Graphs of a plane
/// stay as they are.
pub fn framed(
    session: &Session,
    arena: &Arc<Arena>,
    graph: ValidGraph,
    estimate: &EstimateSettings,
) -> Result<(ValidGraph, Option<Plan>), Failure> {
    if graph.plane.is_some() || graph.camera.is_some() {
        return Ok((graph, None));
    }
    let plan = plan_of(session, arena, &graph, estimate)?;
    let camera = camera_of(&Composer { arena, library: &session.library, graph: &graph }, &plan);
    Ok((graph.with_camera(camera), Some(plan)))
}

/// The iterations that the view of a graph needs, where its limit follows the view.
pub fn iterations(
    session: &Session,
    arena: &Arc<Arena>,
    graph: &ValidGraph,
    wanted: Wanted,
) -> Result<Option<Iterations>, Failure> {
    let composer = Composer { arena, library: &session.library, graph };
    if !Iterations::follow(&composer, wanted.is_own) {
        return Ok(None);
    }
    let plan = plan_of(session, arena, graph, wanted.estimate)?;
    Iterations::of_view(&composer, &plan, wanted.size, wanted.is_own).map_err(|diagnostic| session.failure(diagnostic))
}

/// The graph as its own view shows it: framed, with the iterations that pictures of this size need.
pub fn seen(
    session: &Session,
    arena: &Arc<Arena>,
    graph: ValidGraph,
    size: Size,
    estimate: &EstimateSettings,
) -> Result<ValidGraph, Failure> {
    let (graph, _) = framed(session, arena, graph, estimate)?;
    let found = iterations(session, arena, &graph, Wanted { size, estimate, is_own: true })?;
    Ok(found.map_or_else(|| graph.clone(), |found| found.apply(&graph)))
}

/// Tells where a camera is in the set, in which no ray has a way to go; true where it is.
pub fn warns_of_inside(session: &Session, subject: &Subject, camera: &Camera) -> Result<bool, Failure> {
    let found =
        standpoint(&subject.composer(), &subject.plan, camera).map_err(|diagnostic| session.failure(diagnostic))?;
    let Standpoint::Inside(way) = found else { return Ok(false) };
    let shown = |p: [f64; 3]| p.map(|x| ((x * 1e6).round() / 1e6).to_string()).join(",");
    let help = match way {
        Some(p) => format!("the nearest free point found is {}: `--camera={}`", shown(p).replace(',', ", "), shown(p)),
        None => "no free point was found around it".to_string(),
    };
    let at = shown(camera.position).replace(',', ", ");
    session.warn(&format!("the camera is inside of the set: no ray from ({at}) goes anywhere; {help}"));
    Ok(true)
}
