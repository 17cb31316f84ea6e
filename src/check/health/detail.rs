//! The iteration limit against a pixel's footprint: iterations that no pixel shows, and surfaces that are dust.

use super::{Finding, Health, Kind, Severity};
use crate::check::subject::Subject;
use crate::check::truth::{Ray, Scale, Truth, Truths, view_rays};
use crate::compose::Composer;
use crate::diag::Diagnostic;
use crate::graph::ValidGraph;
use crate::shade::{Size, frame_automatically};

/// Rays through the picture.
const RAYS: usize = 300;
/// Hits below which nothing is said.
const FEW: usize = 20;
/// An iteration is not seen where it changes fewer than this share of the hits by a quarter of a footprint.
const UNSEEN: f64 = 0.02;
const QUARTER: f64 = 0.25;
/// A surface is dust where more than this share of the hits is thinner than half a pixel or ambiguous.
const DUST: f64 = 0.5;
/// The share that a better limit leaves.
const CLEAN: f64 = 0.25;
/// Iterations by which the limit is lowered at most to find a better one.
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

/// The share of the hits that are thinner than half a pixel, or changed with every finer step.
fn dust(truths: &Truths) -> f64 {
    let [hits, _, ambiguous] = truths.counts();
    (truths.thin() + ambiguous) as f64 / (hits + ambiguous).max(1) as f64
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
    let camera = subject.graph.camera.unwrap_or_else(|| frame_automatically(subject.plan.bounding_radius));
    let scale = Scale::of_view(&camera, size, subject.plan.bounding_radius);
    let view = View { subject, rays: view_rays(&camera, size, RAYS, 9), scale };
    let full = view.truths(subject.graph)?;
    let [hits, misses, ambiguous] = full.counts();
    let share = dust(&full);
    let pixels = format!("{}x{}", size.width, size.height);
    health.measure(
        "picture",
        "rays",
        format!("{hits} hits, {misses} misses, {ambiguous} ambiguous; {:.0} % dust at {pixels}", 100.0 * share),
    );
    if hits + ambiguous < FEW {
        health.measure("picture", "iterations", "too few rays hit to say");
        return Ok(());
    }
    let lowest = LOWER.min(least.saturating_sub(1));
    let mut found = |message: String, help: String| {
        let span = subject.graph.node(subject.graph.output).span;
        let (severity, kind, subject) = (Severity::Warning, Kind::Iterations, "picture".to_string());
        health.findings.push(Finding { severity, kind, subject, message, help, span, point: None });
    };
    let mut unseen = 0;
    let mut cleaner = None;
    for fewer in 1..=lowest {
        let other = view.with_fewer(fewer)?;
        if unseen == fewer - 1 && change(&full, &other) < UNSEEN {
            unseen = fewer;
        } else if share <= DUST {
            break;
        }
        if share > DUST && dust(&other) <= CLEAN {
            cleaner = Some(fewer);
            break;
        }
    }
    if unseen > 0 {
        let message = format!("the last {unseen} of {most} iterations change nothing that a pixel shows at {pixels}");
        found(message, format!("`max_iterations: {}` gives the same picture sooner", most - unseen));
    }
    if share > DUST {
        let message = format!(
            "{:.0} % of the hits at {pixels} are thinner than half a pixel: the surface is turning to dust",
            100.0 * share
        );
        let help = match cleaner {
            Some(fewer) => format!("`max_iterations: {}` keeps it closed; a larger picture shows more", most - fewer),
            None => "lower `max_iterations`, or render a larger picture".to_string(),
        };
        found(message, help);
    }
    let text = match unseen {
        0 => format!("{most}; the last one shows"),
        _ => format!("{most}; the last {unseen} do not show"),
    };
    health.measure("picture", "iterations", text);
    Ok(())
}
