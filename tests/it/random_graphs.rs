//! Random graphs for tests: one to four steps of the whole library with random parameters, the same for a seed.

use bulbfold::check::Random;
use bulbfold::formula::library::Library;
use bulbfold::formula::step::{ParamKind, ParamValue, StateWidth, Step, StepParam};

/// Steps that need more than an orbit's settings.
const LEFT_OUT: [&str; 3] = ["phoenix", "manowar", "linear"];

/// Whether orbits can grow by a step.
fn grows(step: &Step) -> bool {
    matches!(step.group.as_str(), "power" | "algebra") || ["scale", "axis_scale"].contains(&step.name.as_str())
}

/// A value near the default; `None` leaves it.
fn value(random: &mut Random, param: &StepParam) -> Option<String> {
    let near = |random: &mut Random, x: f64| {
        let shift = if x == 0.0 { random.range(-0.3, 0.3) } else { 0.0 };
        (x * random.range(0.6, 1.5) + shift).clamp(param.min, param.max)
    };
    Some(match (&param.kind, &param.default) {
        (ParamKind::Choice(words), _) => format!("{:?}", words[random.below(words.len())]),
        (ParamKind::Bool, _) => (random.unit() < 0.5).to_string(),
        (ParamKind::Int, ParamValue::Number(x)) => {
            (x + [-1.0, 0.0, 1.0, 2.0][random.below(4)]).clamp(param.min, param.max).to_string()
        }
        (ParamKind::Angle, _) => format!("{:.2}", random.range(-60.0, 60.0).clamp(param.min, param.max)),
        (ParamKind::Float, ParamValue::Number(x)) => format!("{:.4}", near(random, *x)),
        (ParamKind::Vec3, ParamValue::Vector(v)) => {
            let parts = v.map(|x| format!("{:.4}", near(random, x)));
            format!("({})", parts.join(", "))
        }
        _ => return None,
    })
}

fn written(random: &mut Random, step: &Step) -> String {
    let mut values = Vec::new();
    for param in &step.params {
        let wanted = if random.unit() < 0.7 { value(random, param) } else { None };
        values.extend(wanted.map(|value| format!("{}: {value}", param.name)));
    }
    format!("{}({})", step.name, values.join(", "))
}

/// The RON text of the graph of a seed.
pub fn random_graph(library: &Library, seed: u64) -> String {
    let mut random = Random::new(seed);
    let is_usable = |step: &&std::sync::Arc<Step>| {
        let fits = matches!(step.state, StateWidth::Three | StateWidth::Any);
        fits && step.distance.is_none() && !LEFT_OUT.contains(&step.name.as_str())
    };
    let steps: Vec<_> = library.steps().filter(is_usable).collect();
    let mut chosen: Vec<_> = (0..1 + random.below(4)).map(|_| steps[random.below(steps.len())]).collect();
    if !chosen.iter().any(|step| grows(step)) {
        let growing: Vec<_> = steps.iter().filter(|step| grows(step)).collect();
        let at = random.below(chosen.len());
        chosen[at] = growing[random.below(growing.len())];
    }
    let nodes: Vec<String> =
        chosen.iter().enumerate().map(|(i, step)| format!("\"s{i}\": {},", written(&mut random, step))).collect();
    let names: Vec<String> = (0..chosen.len()).map(|i| format!("\"s{i}\"")).collect();
    let constant = match random.unit() < 0.5 {
        true => "Mandelbrot".to_string(),
        false => format!(
            "Julia(({:.4}, {:.4}, {:.4}))",
            random.range(-0.8, 0.8),
            random.range(-0.8, 0.8),
            random.range(-0.8, 0.8)
        ),
    };
    let powers = chosen.iter().any(|step| matches!(step.group.as_str(), "power" | "algebra"));
    let radius = if powers { [10, 30, 100] } else { [30, 100, 1000] }[random.below(3)];
    let iterations = if powers { 4 + random.below(6) } else { 7 + random.below(8) };
    format!(
        "(nodes: {{ {} \"all\": Sequence([{}]) }}, output: \"all\", constant: {constant}, escape_radius: {radius}, max_iterations: {iterations})",
        nodes.join(" "),
        names.join(", ")
    )
}
