//! Orbits: the form of the estimate against the growth of r, and declared radii against members of the set.

use super::rule::{power_text, steady_exponent};
use super::{Finding, Health, Kind, Severity, number, shown, spread};
use crate::check::backends::{Backends, Target};
use crate::check::subject::Subject;
use crate::check::truth::Members;
use crate::compose::placement::Frame;
use crate::compose::{Composer, FieldOrbit, Reach, compose_growth, field_orbits};
use crate::diag::Diagnostic;
use crate::graph::{DeForm, NodeKind, Primitive};
use crate::kernel::cpu::Cpu;
use crate::kernel::{Backend, Kernel};
use crate::math::Precision;
use crate::math::random::Random;

/// Growth of r by more than this power is logarithmic.
const POWER: f64 = 1.05;
/// Members that are wanted, points tried in one go, and goes.
const MEMBERS: usize = 200;
const TRIES: usize = 20_000;
const GOES: usize = 5;
/// Iterations beyond the limit that members of the limit set should survive, most first.
const DEEPER: [u32; 5] = [12, 8, 4, 2, 0];
/// Iterations of members that are followed at most.
const FOLLOWED: u32 = 4;
/// Finitely many iterations leave the set thicker: what members reach less this share counts.
const THICKER: f64 = 0.02;
/// A radius that makes estimates this many times too large is wrong, and one that makes them this small costs steps.
const TOO_LARGE: f64 = 1.05;
const TOO_SMALL: f64 = 0.8;

/// The form of each orbit's estimate against the growth of r over one cycle.
pub(super) fn check_forms(subject: &Subject, health: &mut Health) -> Result<(), Diagnostic> {
    let composer = subject.composer();
    for (orbit, choice) in field_orbits(&composer).iter().zip(&subject.plan.choices) {
        let node = subject.graph.node(orbit.node);
        let Some(exponent) = growth_exponent(&composer, orbit)? else {
            let text = format!("{}; far out r goes up and down, which fits no power", choice.form.name());
            health.measure(&node.name, "form", text);
            continue;
        };
        let measured = if exponent > POWER { DeForm::Logarithmic } else { DeForm::Linear };
        let growth = match measured {
            DeForm::Linear => "r grows by a constant factor a cycle".to_string(),
            _ => format!("r grows by {} a cycle", power_text(exponent)),
        };
        health.measure(&node.name, "form", format!("{}; far out {growth}", choice.form.name()));
        // One that was measured on the view may be the other: a test holds it to the truth.
        let stated = orbit.settings.estimate.form.filter(|_| orbit.settings.estimate.calibrated.is_none());
        let Some(fixed) = stated.filter(|form| is_about_growth(*form) && *form != measured) else {
            continue;
        };
        let message = format!(
            "the form of the estimate is fixed as {}, but {growth}, which is {}",
            fixed.name(),
            measured.name()
        );
        let help = format!("write `form: {}` or leave it out, so that it is measured", measured.name());
        let subject = node.name.clone();
        health.findings.push(Finding {
            severity: Severity::Wrong,
            kind: Kind::Form,
            subject,
            message,
            help,
            span: node.span,
            point: None,
        });
    }
    Ok(())
}

fn is_about_growth(form: DeForm) -> bool {
    form == DeForm::Linear || form == DeForm::Logarithmic
}

/// `None` where r goes up and down.
fn growth_exponent(composer: &Composer, orbit: &FieldOrbit) -> Result<Option<f64>, Diagnostic> {
    let (function, _) = compose_growth(composer, orbit.root, &orbit.settings)?;
    let width = usize::from(composer.graph.state_width(orbit.root, &orbit.settings));
    let cpu = Cpu::new(Precision::F64);
    let kernel = cpu.prepare(composer.arena, &Kernel::Map(function)).expect("the CPU takes every kernel");
    let directions = spread(64, 0.3);
    let radius = |scale: f64| -> Vec<f64> {
        let number = |d: &[f64], k: usize| d.get(k).copied().unwrap_or(0.4) * scale;
        let column = |k: usize| Vec::from_iter(directions.iter().map(|d| number(d, k)));
        let columns = cpu.upload(&Vec::from_iter((0..width).map(column))).expect("the CPU holds every column");
        let result = cpu.run(&kernel, &[&columns]).expect("the CPU runs every kernel");
        cpu.download(&result).expect("the CPU holds every column").swap_remove(0)
    };
    Ok(steady_exponent(radius))
}

/// The radius of the linear form against how far the orbits of members go.
pub(super) fn check_radius(subject: &Subject, health: &mut Health) -> Result<(), Diagnostic> {
    let orbits = field_orbits(&subject.composer());
    let [orbit] = &orbits[..] else { return Ok(()) };
    let choice = &subject.plan.choices[0];
    let is_plain = orbit.frame == Frame::default() && orbit.settings.post.is_empty() && orbit.settings.pre.is_empty();
    let is_alone = matches!(subject.graph.node(subject.graph.output).kind, NodeKind::Orbit { .. });
    if choice.form != DeForm::Linear || !choice.by_length || !is_plain || !is_alone {
        return Ok(());
    }
    let Some((deeper, members)) = find_members(subject)? else { return Ok(()) };
    let mut farthest: (f64, [f64; 3]) = (0.0, [0.0; 3]);
    for iterations in 0..=deeper.min(FOLLOWED) {
        let states = match iterations {
            0 => members.iter().map(|p| p.to_vec()).collect(),
            count => {
                let kernel = subject.orbit_kernel(count)?;
                let states = subject.orbits(&Backends::cpu_only(), Target::CPU_F64, &kernel, &members);
                states.expect("the CPU runs every kernel")
            }
        };
        for (state, p) in states.iter().zip(&members) {
            let r = state.iter().map(|x| x * x).sum::<f64>().sqrt();
            if r > farthest.0 {
                farthest = (r, *p);
            }
        }
    }
    let node = subject.graph.node(orbit.node);
    let is_declared = orbit.settings.estimate.radius.is_some();
    let kind = if is_declared { "declared" } else { "measured by itself" };
    let (used, reached) = (number(choice.radius), number(farthest.0));
    health.measure(
        &node.name,
        "radius",
        format!("{used} ({kind}); orbits of {} members reach {reached}", members.len()),
    );
    let mut found = |severity: Severity, message: String, help: String| {
        let (subject, span) = (node.name.clone(), node.span);
        let point = Some(farthest.1.to_vec());
        health.findings.push(Finding { severity, kind: Kind::Radius, subject, message, help, span, point });
    };
    // Estimates are taken where orbits escape, so r is at least the escape radius: (r - radius) / dr for a set that
    // reaches further than the radius is too large by this factor at most.
    let escape = orbit.settings.escape_radius;
    // Members that come back from beyond the escape radius say nothing of a ball that orbits end in.
    if farthest.0 * (1.0 - THICKER) >= escape {
        return Ok(());
    }
    let factor = |reach: f64| (escape - choice.radius) / (escape - reach);
    if factor(farthest.0 * (1.0 - THICKER)) > 1.0 {
        let is_wrong = is_declared && factor(farthest.0) > TOO_LARGE;
        let message = format!(
            "the radius of the linear form is {used}, but the orbit of the member {} reaches {reached}: distances may be \
             overestimated by {:.1} %",
            shown(&farthest.1),
            100.0 * (factor(farthest.0) - 1.0)
        );
        let severity = if is_wrong { Severity::Wrong } else { Severity::Warning };
        found(severity, message, format!("write `estimate: (radius: {reached})`, or a larger `escape_radius`"));
    } else if is_declared && factor(farthest.0) < TOO_SMALL {
        let message = format!("the radius of the linear form is {used}, but orbits of members stay within {reached}");
        let help = format!("distances are underestimated, which costs steps: try `estimate: (radius: {reached})`");
        found(Severity::Note, message, help);
    }
    Ok(())
}

/// Iterations beyond the limit that members survive, and the members.
type Found = (u32, Vec<[f64; 3]>);

/// Members of the set that survive as many iterations beyond the limit as is possible, and how many.
fn find_members(subject: &Subject) -> Result<Option<Found>, Diagnostic> {
    for deeper in DEEPER {
        let graph = subject.graph.with_orbit_settings(|settings| settings.max_iterations += deeper);
        let composer = Composer { graph: &graph, ..subject.composer() };
        let kernel = Members::new(&composer, &subject.plan.choices)?;
        let mut random = Random::new(31);
        let mut found = Vec::new();
        for _ in 0..GOES {
            let points: Vec<[f64; 3]> = (0..TRIES).map(|_| random.in_ball(subject.plan.bounding_radius)).collect();
            let inside = kernel.inside(&points, &vec![1e-9; points.len()]);
            found.extend(points.into_iter().zip(inside).filter(|(_, inside)| *inside).map(|(p, _)| p));
            if found.len() >= MEMBERS {
                return Ok(Some((deeper, found)));
            }
        }
        if deeper == 0 && !found.is_empty() {
            return Ok(Some((deeper, found)));
        }
    }
    Ok(None)
}

/// The declared bounding sphere against members of the set outside it.
pub(super) fn check_bounds(subject: &Subject, health: &mut Health) -> Result<(), Diagnostic> {
    let radius = subject.plan.bounding_radius;
    let is_declared = subject.graph.bounding_radius.is_some();
    let is_endless = |kind: &NodeKind| matches!(kind, NodeKind::Primitive(Primitive::Plane { .. }));
    let kind = match subject.plan.reach {
        Reach::Exact => "that of its primitives",
        Reach::Sampled => "a guess: sampled, with a margin",
        reach => reach.name(),
    };
    if subject.graph.nodes.iter().any(|node| is_endless(&node.kind)) {
        health.measure("picture", "bounds", format!("{} ({kind}); planes go on beyond", number(radius)));
        return Ok(());
    }
    let members = Members::new(&subject.composer(), &subject.plan.choices)?;
    let mut random = Random::new(37);
    let mut farthest: Option<(f64, [f64; 3])> = None;
    // From the bounding sphere outwards, and inside it.
    for (low, high) in [(1.0, 1.1), (1.1, 2.0), (0.0, 1.0)] {
        let mut point = || {
            let r = radius * (random.unit() * (f64::powi(high, 3) - f64::powi(low, 3)) + f64::powi(low, 3)).cbrt();
            random.direction().map(|x| x * r)
        };
        let points: Vec<[f64; 3]> = (0..TRIES).map(|_| point()).collect();
        let inside = members.inside(&points, &vec![1e-9; points.len()]);
        for (p, _) in points.into_iter().zip(inside).filter(|(_, inside)| *inside) {
            let r = glam::DVec3::from(p).length();
            if farthest.is_none_or(|(known, _)| r > known) {
                farthest = Some((r, p));
            }
        }
    }
    let Some((reached, p)) = farthest else {
        health.measure("picture", "bounds", format!("{} ({kind}); no member was met", number(radius)));
        return Ok(());
    };
    health.measure("picture", "bounds", format!("{} ({kind}); members reach {}", number(radius), number(reached)));
    if reached > radius && !subject.graph.cuts {
        health.findings.push(Finding {
            severity: if is_declared { Severity::Wrong } else { Severity::Warning },
            kind: Kind::Bounds,
            subject: "picture".into(),
            message: format!(
                "the bounding radius is {}, but {} belongs to the set, {} from the origin: the picture is cut",
                number(radius),
                shown(&p),
                number(reached)
            ),
            help: format!("write `bounding_radius: {}` or more", number(reached * 1.02)),
            span: subject.graph.node(subject.graph.output).span,
            point: Some(p.to_vec()),
        });
    }
    Ok(())
}
