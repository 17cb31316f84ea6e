//! The iteration limit against a pixel's footprint: iterations that no pixel shows.

use super::{Finding, Health, Kind, Severity};
use crate::check::subject::Subject;
use crate::check::truth::{Ray, Scale, Truth, Truths, view_rays};
use crate::compose::Composer;
use crate::diag::Diagnostic;
use crate::graph::ValidGraph;
use crate::render::camera_of;
use crate::shade::Size;

/// Rays through the picture.
const RAYS: usize = 300;
/// Hits below which nothing is said.
const FEW: usize = 20;
/// An iteration is not seen where it changes fewer than this share of the hits by a quarter of a footprint.
const UNSEEN: f64 = 0.02;
const QUARTER: f64 = 0.25;
/// Iterations by which the limit is lowered at most.
const LOWER: u32 = 12;

/// The truth of a view with other iteration limits.
struct View<'a> {
    subject: &'a Subject<'a>,
    rays: Vec<Ray>,
    scale: Scale,
}

impl View<'_> {
    fn truths(&self, graph: &ValidGraph) -> Result<Truths, Diagnostic> {
        let composer = Composer { graph, ..self.subject.composer() };
        Truths::find(&composer, &self.subject.plan.choices, &self.rays, self.scale, &mut |_| true)
    }

    fn with_fewer(&self, fewer: u32) -> Result<Truths, Diagnostic> {
        self.truths(&self.subject.graph.with_orbit_settings(|settings| settings.max_iterations -= fewer))
    }
}

/// The share of the hits of either that the other has not within a quarter of a footprint.
fn change(a: &Truths, b: &Truths) -> f64 {
    let scale = a.scale;
    let mut hits = 0;
    let mut changed = 0;
    for (a, b) in a.depths.iter().zip(&b.depths).map(|(x, y)| (*x, *y)) {
        hits += usize::from(a.depth().is_some() || b.depth().is_some());
        changed += usize::from(match (a, b) {
            (Truth::Hit(x), Truth::Hit(y)) => (x - y).abs() > QUARTER * scale.footprint(x),
            (a, b) => a != b,
        });
    }
    changed as f64 / hits.max(1) as f64
}

/// Looks at the limit of the orbits that are iterated most.
pub(super) fn check_iterations(subject: &Subject, size: Size, health: &mut Health) -> Result<(), Diagnostic> {
    let limits: Vec<u32> =
        crate::compose::field_orbits(&subject.composer()).iter().map(|o| o.settings.max_iterations).collect();
    let (Some(&least), Some(&most)) = (limits.iter().min(), limits.iter().max()) else { return Ok(()) };
    let camera = camera_of(&subject.composer(), &subject.plan);
    let scale = Scale::of_view(&camera, size, subject.plan.bounding_radius);
    let view = View { subject, rays: view_rays(&camera, size, RAYS, 9), scale };
    let full = view.truths(subject.graph)?;
    let [hits, misses, ambiguous] = full.counts();
    let pixels = format!("{}x{}", size.width, size.height);
    health.measure("picture", "rays", format!("{hits} hits, {misses} misses, {ambiguous} ambiguous at {pixels}"));
    if hits + ambiguous < FEW {
        health.measure("picture", "iterations", "too few rays hit to say");
        return Ok(());
    }
    let lowest = LOWER.min(least.saturating_sub(1));
    let mut unseen = 0;
    while unseen < lowest && change(&full, &view.with_fewer(unseen + 1)?) < UNSEEN {
        unseen += 1;
    }
    if unseen > 0 {
        let which = if unseen == lowest { format!("{unseen} or more") } else { unseen.to_string() };
        health.findings.push(Finding {
            severity: Severity::Note,
            kind: Kind::Iterations,
            subject: "picture".to_string(),
            message: format!("the last {which} of {most} iterations change nothing that a pixel shows at {pixels}"),
            help: format!(
                "a render leaves them out by itself; exported shaders are just as good and faster with `max_iterations: {}`",
                most - unseen
            ),
            span: subject.graph.node(subject.graph.output).span,
            point: None,
        });
    }
    let text = match unseen {
        0 => format!("{most}; the last one shows"),
        _ => format!("{most}; the last {unseen} do not show"),
    };
    health.measure("picture", "iterations", text);
    Ok(())
}
