//! One step with its parameters: jumps, values that are not numbers, its scalar rule against the true stretch, its growth.

use std::sync::Arc;

use super::continuity::{Continuity, search};
use super::spread;
use super::{Finding, Health, Kind, Params, Severity, number, shown};
use crate::check::backends::Backends;
use crate::check::steps::{StepCase, largest_stretch, widths};
use crate::diag::{Diagnostic, Span};
use crate::expr::{Arena, Function};
use crate::formula::library::Library;
use crate::formula::shape::ShapeDistance;
use crate::formula::step::{Growth, ScalarRule, Step};
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::{Backend, Kernel};
use crate::math::Precision;
use crate::math::random::Random;

/// States that a rule is compared at.
const POINTS: usize = 800;
/// Relative share that an exact rule may be below the true stretch: rounding of the singular value.
const ROUNDING: f64 = 1e-6;
/// The same where the stretch is a finite difference.
const ROUNDING_OF_DIFFERENCES: f64 = 1e-3;
/// Step of finite differences, relative to the state.
const DIFFERENCE: f64 = 1e-5;
/// Share of the states at which a heuristic rule may be exceeded: beyond that it is a wrong one.
const MOSTLY: f64 = 0.75;
/// A rule that is never nearer to the stretch than this wastes steps.
const LOOSE: f64 = 1.5;
/// Growth of r by more than this power is no constant factor.
const POWER: f64 = 1.05;

/// Checks one step with its default parameters and those of each of its examples.
pub fn check_step(library: &Library, step: &Step) -> Result<Health, Diagnostic> {
    let mut health = Health::default();
    let defaults: Params = step.params.iter().map(|p| (p.name.clone(), p.default.clone())).collect();
    check_node(library, step, &step.name, &defaults, &mut health)?;
    let mut known = vec![defaults.clone()];
    for example in &step.examples {
        let mut params = defaults.clone();
        for (name, value) in &example.params {
            params.iter_mut().filter(|(known, _)| known == name).for_each(|(_, v)| *v = value.clone());
        }
        if !known.contains(&params) {
            let mut of_example = Health::default();
            let given: Vec<String> = example.params.iter().map(|(n, v)| format!("{n}: {}", value_text(v))).collect();
            check_node(library, step, &format!("{}({})", step.name, given.join(", ")), &params, &mut of_example)?;
            health.measures.append(&mut of_example.measures);
            health.findings.append(&mut of_example.findings);
            known.push(params);
        }
    }
    health.findings.extend(missing_texts(step));
    health.findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(health)
}

/// What a step's description could say: nothing needs it, but readers do.
fn missing_texts(step: &Step) -> Option<Finding> {
    let texts = [("summary", &step.summary), ("source", &step.source)];
    let mut missing: Vec<String> =
        texts.iter().filter(|(_, text)| text.is_empty()).map(|(name, _)| format!("`{name}`")).collect();
    missing.extend(step.params.iter().filter(|p| p.help.is_empty()).map(|p| format!("the `help` of `{}`", p.name)));
    (!missing.is_empty()).then(|| Finding {
        severity: Severity::Note,
        kind: Kind::Description,
        subject: step.name.clone(),
        message: format!("the description lacks {}", missing.join(", ")),
        help: "optional; it tells readers of the file what it does and where it comes from".into(),
        span: Span::new(step.text, 0, 0),
        point: None,
    })
}

fn value_text(value: &crate::formula::step::ParamValue) -> String {
    use crate::formula::step::ParamValue;
    match value {
        ParamValue::Number(x) => number(*x),
        ParamValue::Bool(b) => b.to_string(),
        ParamValue::Vector(v) => shown(v),
        ParamValue::Point(v) => shown(v),
        ParamValue::Matrix(rows) => format!("[{}]", rows.map(|row| shown(&row)).join(", ")),
        ParamValue::Word(word) => word.clone(),
    }
}

/// Checks one step with its parameters; `name` is what the report calls it.
pub(super) fn check_node(
    library: &Library,
    step: &Step,
    name: &str,
    params: &Params,
    health: &mut Health,
) -> Result<(), Diagnostic> {
    let width = widths(step)[0];
    let backends = Backends::cpu_only();
    let case = StepCase { library, step, backends: &backends };
    let arena = Arc::new(Arena::default());
    let failed =
        |text: String| Diagnostic::error(format!("the step `{}` cannot be traced: {}", step.name, text.trim()));
    let (ports, traced) = case.trace(&arena, width, params, step.scalar_rule.is_some()).map_err(failed)?;
    let mut function = Function::new("step", ports);
    function.output("z", traced.z);
    if let Some(dr) = traced.dr {
        function.output("dr", dr);
    }
    let images = usize::from(traced.z.ty().width);
    let map = Runner::new(&arena, function, width, images);
    let exact = match step.differentiable {
        true => {
            let function = case.jacobian_function(&arena, width, params, false).map_err(failed)?;
            Some(Runner::new(&arena, function, width, images))
        }
        false => None,
    };
    let check = Check { library, step, name, width: usize::from(width), map, exact };
    check.continuity(health);
    check.numbers(health);
    if let Some(distance) = step.distance {
        check.slope(distance, health);
        return Ok(());
    }
    check.rule(health);
    check.growth(params, health);
    Ok(())
}

/// A function of states in f64.
struct Runner {
    cpu: Cpu,
    kernel: CpuKernel,
    width: u8,
    /// Components of an image: one of a shape, whose image is its distance.
    images: usize,
}

impl Runner {
    fn new(arena: &Arc<Arena>, function: Function, width: u8, images: usize) -> Runner {
        let cpu = Cpu::new(Precision::F64);
        let kernel = cpu.prepare(arena, &Kernel::Map(function)).expect("the CPU takes every kernel");
        Runner { cpu, kernel, width, images }
    }

    /// Columns of the outputs at states, with a running derivative of 1.
    fn run(&self, states: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let columns = self.cpu.upload(&StepCase::columns(self.width, states)).expect("the CPU holds every column");
        let result = self.cpu.run(&self.kernel, &[&columns]).expect("the CPU runs every kernel");
        self.cpu.download(&result).expect("the CPU holds every column")
    }

    /// Images of states.
    fn images(&self, states: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let out = self.run(states);
        (0..states.len()).map(|i| (0..self.images).map(|k| out[k][i]).collect()).collect()
    }
}

struct Check<'a> {
    library: &'a Library,
    step: &'a Step,
    name: &'a str,
    width: usize,
    map: Runner,
    exact: Option<Runner>,
}

impl Check<'_> {
    /// The place of a text in the step's file; the file's start where it does not occur.
    fn span(&self, text: &str) -> Span {
        let source = self.library.sources.text(self.step.text);
        let (at, length) = source.find(text).map_or((0, 1), |at| (at, text.len()));
        Span::new(self.step.text, at, at + length)
    }

    fn found(&self, severity: Severity, kind: Kind, message: String, help: &str, span: Span) -> Finding {
        let subject = self.name.to_string();
        Finding { severity, kind, subject, message, help: help.to_string(), span, point: None }
    }

    fn continuity(&self, health: &mut Health) {
        // A jump that the step's notes tell of is a known weakness, not a mistake.
        let is_known = self.step.notes.to_lowercase().contains("discontinuous");
        let name = &self.name;
        let (text, finding) = match search(self.width, &|states| self.map.images(states)) {
            Continuity::Lipschitz(stretch) => {
                (format!("yes; close points part by up to {} times", number(stretch)), None)
            }
            Continuity::Jump { at, by } => {
                let severity = if is_known { Severity::Warning } else { Severity::Wrong };
                let message = format!("`{name}` jumps by {} at z = {}", number(by), shown(&at));
                let help = "no estimate is right across a jump: write it as a fold (min, max, abs), which is continuous, \
                            or say `Discontinuous` in the step's notes and expect holes there";
                let text = format!("jumps at {}", shown(&at));
                (text, Some((severity, Kind::Jump, message, help, at)))
            }
            Continuity::Pole { at } => {
                let message = format!("`{name}` goes to infinity at z = {}", shown(&at));
                let help = "keep the divisor above a small number with max(), so that steps near it stay above 0";
                let text = format!("a pole at {}", shown(&at));
                (text, Some((Severity::Warning, Kind::Stretch, message, help, at)))
            }
            Continuity::Unbounded { at, exponent } => {
                let power = number(exponent);
                let message = format!("the stretch of `{name}` grows like distance^{power} towards z = {}", shown(&at));
                let help = "distances next to it are underestimated or overestimated without bound: keep roots and \
                            angles away from it with max()";
                (
                    format!("unbounded stretch at {}", shown(&at)),
                    Some((Severity::Warning, Kind::Stretch, message, help, at)),
                )
            }
        };
        health.measure(self.name, "continuous", text);
        if let Some((severity, kind, message, help, at)) = finding {
            let finding = self.found(severity, kind, message, help, self.span("fn step"));
            health.findings.push(Finding { point: Some(at), ..finding });
        }
    }

    /// Finite states must have finite images, also at the origin, on axes and planes.
    fn numbers(&self, health: &mut Health) {
        let values = [0.0, -0.0, 1.0, -1.0, 0.5, 1e-8, 1e-160];
        let count = values.len().pow(self.width as u32);
        let state = |i: usize| (0..self.width).map(|k| values[i / values.len().pow(k as u32) % values.len()]).collect();
        let states: Vec<Vec<f64>> = (0..count).map(state).collect();
        let images = self.map.images(&states);
        let bad = images.iter().position(|image| image.iter().any(|x| x.is_nan()));
        if let Some(i) = bad {
            let message = format!("`{}` gives NaN at z = {}", self.name, shown(&states[i]));
            let help = "such points count as escaped and leave holes: guard divisions and roots with max()";
            let finding = self.found(Severity::Wrong, Kind::NotANumber, message, help, self.span("fn step"));
            health.findings.push(Finding { point: Some(states[i].clone()), ..finding });
        }
    }

    /// States all over the place: in a box, beside the axes, and over four orders of size.
    fn states(&self) -> Vec<Vec<f64>> {
        let mut random = Random::new(23);
        (0..POINTS)
            .map(|i| {
                let mut z: Vec<f64> = (0..self.width).map(|_| random.range(-2.5, 2.5)).collect();
                let size = 10f64.powf(random.range(-2.0, 1.3));
                let kept = random.below(self.width);
                match i % 4 {
                    2 => z.iter_mut().enumerate().filter(|(k, _)| *k != kept).for_each(|(_, x)| *x *= 0.03),
                    3 => z.iter_mut().for_each(|x| *x *= size / 2.5),
                    _ => {}
                }
                z
            })
            .collect()
    }

    /// True stretches: by the differentiated map, else by central differences.
    fn stretches(&self, states: &[Vec<f64>]) -> Vec<f64> {
        let n = self.width;
        if let Some(exact) = &self.exact {
            let out = exact.run(states);
            let m = exact.images;
            let column = |i: usize, axis: usize| (0..m).map(|k| out[m * (1 + axis) + k][i]).collect::<Vec<f64>>();
            return (0..states.len())
                .map(|i| largest_stretch(&(0..n).map(|a| column(i, a)).collect::<Vec<_>>()))
                .collect();
        }
        let step_of = |z: &[f64]| DIFFERENCE * z.iter().fold(1e-2, |size: f64, x| size.max(x.abs()));
        let mut moved = Vec::new();
        for z in states {
            for axis in 0..n {
                for sign in [-1.0, 1.0] {
                    let mut z = z.clone();
                    z[axis] += sign * step_of(&z);
                    moved.push(z);
                }
            }
        }
        let images = self.map.images(&moved);
        let column = |i: usize, axis: usize| {
            let at = (i * n + axis) * 2;
            let width = 2.0 * step_of(&states[i]);
            images[at].iter().zip(&images[at + 1]).map(|(a, b)| (b - a) / width).collect::<Vec<f64>>()
        };
        (0..states.len()).map(|i| largest_stretch(&(0..n).map(|a| column(i, a)).collect::<Vec<_>>())).collect()
    }

    /// A distance must not rise by more than 1 a length, or marches step through the shape.
    fn slope(&self, distance: ShapeDistance, health: &mut Health) {
        let kind = if distance == ShapeDistance::Exact { "exact" } else { "a bound" };
        health.measure(self.name, "distance", kind);
        let mut states = self.states();
        if self.width == 4 {
            // A shape of four components is one of the unit sphere.
            for z in &mut states {
                let length = z.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
                z.iter_mut().for_each(|x| *x /= length);
            }
        }
        let slopes = self.stretches(&states);
        let steepest = slopes.iter().zip(&states).filter(|(slope, _)| slope.is_finite());
        let Some((slope, z)) = steepest.max_by(|a, b| a.0.total_cmp(b.0)) else { return };
        health.measure(self.name, "slope", format!("up to {}", number(*slope)));
        let slack = if self.exact.is_some() { ROUNDING } else { ROUNDING_OF_DIFFERENCES };
        if *slope > 1.0 + slack {
            let message =
                format!("the distance of `{}` rises by {} a length at z = {}", self.name, number(*slope), shown(z));
            let help = "divide the distance by its largest slope, and say `distance: \"bound\"`";
            let finding = self.found(Severity::Wrong, Kind::Rule, message, help, self.span("fn distance"));
            health.findings.push(Finding { point: Some(z.clone()), ..finding });
        }
    }

    fn rule(&self, health: &mut Health) {
        let Some(rule) = self.step.scalar_rule else {
            health.measure(self.name, "scalar rule", "none; the exact derivative is used");
            return;
        };
        let states = self.states();
        let rules = self.map.run(&states).swap_remove(self.map.images);
        let compared: Vec<(f64, &Vec<f64>, f64, f64)> = self
            .stretches(&states)
            .into_iter()
            .zip(rules)
            .zip(&states)
            .filter(|((stretch, rule), _)| stretch.is_finite() && *stretch > 1e-300 && (rule.is_nan() || *rule < 1e300))
            .map(|((stretch, rule), z)| (rule / stretch, z, rule, stretch))
            .collect();
        let Some(worst) = compared.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return };
        // A rule that is not a number bounds nothing.
        let worst = compared.iter().find(|c| c.0.is_nan()).unwrap_or(worst);
        let slack = if self.exact.is_some() { ROUNDING } else { ROUNDING_OF_DIFFERENCES };
        let exceeded = compared.iter().filter(|c| c.0.is_nan() || c.0 < 1.0 - slack).count();
        let share = exceeded as f64 / compared.len() as f64;
        let kind = if rule == ScalarRule::Exact { "exact" } else { "heuristic" };
        let text = match exceeded {
            0 => format!("{kind}; {} to {} times the true stretch", number(worst.0), number(largest(&compared))),
            _ => format!(
                "{kind}; exceeded at {:.0} % of {} states, by up to {} times",
                (100.0 * share).max(1.0),
                compared.len(),
                number(1.0 / worst.0)
            ),
        };
        health.measure(self.name, "scalar rule", text);
        if let Some(finding) = self.judge_rule(rule, share, worst) {
            health.findings.push(Finding { point: Some(worst.1.clone()), ..finding });
        }
    }

    fn judge_rule(&self, rule: ScalarRule, share: f64, worst: &(f64, &Vec<f64>, f64, f64)) -> Option<Finding> {
        let (ratio, z, found, stretch) = worst;
        let span = self.span("fn derivative");
        let (name, at) = (self.name, shown(z));
        let (found, stretch) = (number(*found), number(*stretch));
        if share == 0.0 {
            let message = format!(
                "the scalar rule of `{name}` is never below {} times the true stretch: every step is that much too short",
                number(*ratio)
            );
            let help = "divide the rule by that, or drop it: the exact derivative is used then";
            return (*ratio > LOOSE).then(|| self.found(Severity::Warning, Kind::Rule, message, help, span));
        }
        let message = format!(
            "the scalar rule of `{name}` is too small: at z = {at} it says {found}, but the true stretch is {stretch}"
        );
        match rule {
            ScalarRule::Exact => {
                let help = "an exact rule must never be below the true stretch, or marches miss hits: correct it, mark it \
                            `scalar_rule: \"heuristic\"`, or drop it and the exact derivative is used";
                Some(self.found(Severity::Wrong, Kind::Rule, message, help, span))
            }
            ScalarRule::Heuristic if share > MOSTLY => {
                let message = format!("{message}, and it is too small at {:.0} % of all states", 100.0 * share);
                let help = "a rule that is mostly too small is wrong even as a heuristic: correct it, or drop it and the \
                            exact derivative is used";
                Some(self.found(Severity::Wrong, Kind::Rule, message, help, span))
            }
            ScalarRule::Heuristic => {
                let message = format!(
                    "the heuristic rule of `{name}` is exceeded by up to {} times, at z = {at}",
                    number(1.0 / ratio)
                );
                let help = "known of heuristic rules: methods other than `scalar` do not depend on it";
                Some(self.found(Severity::Note, Kind::Rule, message, help, span))
            }
        }
    }

    /// Growth of r far out against what the step declares.
    fn growth(&self, params: &Params, health: &mut Health) {
        let directions = spread(64, 0.3);
        let radius = |scale: f64| -> Vec<f64> {
            let state = |d: &[f64; 3]| (0..self.width).map(|k| d.get(k).copied().unwrap_or(0.4) * scale).collect();
            let states: Vec<Vec<f64>> = directions.iter().map(state).collect();
            let images = self.map.images(&states);
            images.iter().map(|image| image.iter().map(|x| x * x).sum::<f64>().sqrt()).collect()
        };
        let Some(exponent) = steady_exponent(radius) else {
            health.measure(self.name, "growth", "goes up and down: no power fits");
            return;
        };
        let text = match exponent > POWER {
            true => power_text(exponent),
            false => "a constant factor or less".into(),
        };
        health.measure(self.name, "growth", text);
        let is_default = self.step.params.iter().zip(params).all(|(p, (_, value))| p.default == *value);
        // Other parameters may turn a power into a factor (a bulb of power 1); the file describes the defaults.
        let severity = if is_default { Severity::Wrong } else { Severity::Note };
        let (declared, expected) = match (self.step.growth, exponent > POWER) {
            (Some(Growth::Power), false) => ("power", "linear"),
            (Some(Growth::Linear), true) => ("linear", "power"),
            (None, true) => ("none", "power"),
            _ => return,
        };
        let message = format!(
            "the step `{}` declares the growth {declared}, but far out r grows by {}",
            self.name,
            power_text(exponent)
        );
        let help =
            format!("write `growth: \"{expected}\"` in the step's description; the choice of a method depends on it");
        let span = if self.step.growth.is_some() { self.span("growth:") } else { self.span("group:") };
        health.findings.push(self.found(severity, Kind::Growth, message, &help, span));
    }
}

fn largest(compared: &[(f64, &Vec<f64>, f64, f64)]) -> f64 {
    compared.iter().map(|c| c.0).fold(0.0, f64::max)
}

/// A power of growth in words.
pub(super) fn power_text(exponent: f64) -> String {
    if exponent < LARGEST { format!("power {}", number(exponent)) } else { "a high power".into() }
}

/// Powers beyond this are those of numbers beyond the range of numbers.
const LARGEST: f64 = 1e3;
/// Powers of two decades that differ by more than this share are those of no steady growth.
const STEADY: f64 = 0.1;

/// The power by which r grows far out, by three radii; `None` where decades do not agree on one.
pub(super) fn steady_exponent(radius: impl Fn(f64) -> Vec<f64>) -> Option<f64> {
    let [near, middle, far] = [1e3, 1.3e4, 1.1e5].map(radius);
    let scale = |exponent: f64, ratio: f64| if exponent < f64::MAX { exponent / ratio.log10() } else { exponent };
    let first = scale(median_exponent(&near, &middle), 13.0);
    let second = scale(median_exponent(&middle, &far), 11.0 / 1.3);
    // Numbers end before powers do.
    if second == f64::MAX {
        return Some(first);
    }
    let is_steady = (first - second).abs() <= STEADY * first.abs().max(1.0);
    is_steady.then_some(first).or((first.max(second) <= POWER).then_some(first.max(second)))
}

/// The median over directions of the power by which r grows from `near` to `far`, where `far` is ten times further out.
pub(super) fn median_exponent(near: &[f64], far: &[f64]) -> f64 {
    // What goes to 0 does not grow, what is beyond the range of numbers grows by any power.
    let exponent = |(a, b): (&f64, &f64)| match *b {
        0.0 => 0.0,
        b => Some((b / a).log10()).filter(|e| e.is_finite()).unwrap_or(f64::MAX),
    };
    let mut exponents: Vec<f64> = near.iter().zip(far).map(exponent).collect();
    exponents.sort_by(f64::total_cmp);
    exponents[exponents.len() / 2]
}
