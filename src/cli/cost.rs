//! `bulbfold compile --emit cost`: what every step of a formula costs, as a table.

use std::fmt::Write as _;
use std::sync::Arc;

use bulbfold::compose::{ComposeResult, Composer, IterationParts, field_orbits, iteration_parts};
use bulbfold::expr::ops::{Operator, OperatorKind};
use bulbfold::expr::{Arena, Function};
use bulbfold::kernel::Orbit;
use bulbfold::kernel::cost::{Cost, MarchCost, in_cycle};
use bulbfold::render::Pipeline;

/// Width of the first column.
const NAMES: usize = 34;

/// What is said of the steps of a proof.
const BARE_STEPS: &str = "Steps are listed without the bounds that a proof carries; the running iteration has them.\n";

/// The table of a picture's march. Errors are a step's.
pub fn table(composer: &Composer, pipeline: &Pipeline) -> ComposeResult<String> {
    let march = pipeline.march();
    let mut text = String::new();
    let orbits = field_orbits(composer);
    let written = Arc::new(Arena::as_written());
    let as_written = Composer { arena: &written, ..*composer };
    for ((orbit, choice), kernel) in orbits.iter().zip(&pipeline.plan.choices).zip(&march.estimator.orbits) {
        let _ = writeln!(
            text,
            "{}: {}, {}; at most {} iterations",
            composer.graph.node(orbit.root).name,
            choice.method.name(),
            choice.form.name(),
            kernel.max_iterations
        );
        if choice.method.is_certified() {
            text.push_str(BARE_STEPS);
        }
        header(&mut text);
        let parts = iteration_parts(composer, orbit, choice)?;
        let plain = iteration_parts(&as_written, orbit, choice)?;
        let table = OrbitTable { composer, written: &written, kernel };
        for (i, (parts, plain)) in parts.iter().zip(&plain).enumerate() {
            table.iteration(&mut text, i, parts, plain);
        }
        table.mean(&mut text);
        text.push('\n');
    }
    let cost = MarchCost::of(composer.arena, march);
    header(&mut text);
    row(&mut text, "an estimate without iterations", None, cost.estimate);
    row(&mut text, "a march step without its estimate", None, cost.step);
    text.push_str(&legend());
    Ok(text)
}

fn header(text: &mut String) {
    let _ = write!(text, "{:<NAMES$}{:>6}{:>7}{:>7}", "operations", "all", "value", "deriv");
    Cost::KINDS.iter().for_each(|kind| {
        let _ = write!(text, "{kind:>8}");
    });
    let _ = writeln!(text, "{:>10}", "products");
}

/// A line: all operations, those of the value alone and what the derivative adds, all by kind, all in products.
fn row(text: &mut String, name: &str, value: Option<Cost>, all: Cost) {
    let _ = write!(text, "{name:<NAMES$}{:>6}", number(all.operations()));
    let [of_value, derivative] = match value {
        Some(value) => [value.operations(), all.operations() - value.operations()].map(number),
        None => ["", ""].map(String::from),
    };
    let _ = write!(text, "{of_value:>7}{derivative:>7}");
    for count in all.counts() {
        let _ = write!(text, "{:>8}", if count == 0.0 { "-".into() } else { number(count) });
    }
    let _ = writeln!(text, "{:>10}", number(all.products));
}

/// A count without needless digits.
fn number(count: f64) -> String {
    match count {
        count if count.abs() >= 1e7 => format!("{count:.1e}"),
        count if (count - count.round()).abs() < 1e-9 => format!("{count:.0}"),
        count => format!("{count:.1}"),
    }
}

fn legend() -> String {
    let kinds = [OperatorKind::Div, OperatorKind::Sqrt, OperatorKind::Exp, OperatorKind::Trig];
    let mut weights = Vec::new();
    for operator in Operator::ALL.iter().filter(|operator| kinds.contains(&operator.kind())) {
        weights.push(format!("{} {}", operator.info().name, operator.weight()));
    }
    format!(
        "\nA product and a sum in one (mul_add) are one operation. \"As written\" counts what the steps ask for, before anything is\n\
         shared, simplified or fused. \"Products\" weighs expensive operations by how many products they take:\n{}.\n",
        weights.join(", ")
    )
}

struct OrbitTable<'a> {
    composer: &'a Composer<'a>,
    written: &'a Arena,
    kernel: &'a Orbit,
}

impl OrbitTable<'_> {
    fn iteration(&self, text: &mut String, i: usize, parts: &IterationParts, plain: &IterationParts) {
        let schedule = &self.kernel.schedule;
        let runs = (0..self.kernel.max_iterations as usize).filter(|&n| schedule.item(n) == i).count();
        let many =
            if self.kernel.items.len() > 1 { format!("iteration {i}, {runs} times") } else { "iteration".into() };
        let _ = writeln!(text, "{many}");
        let (mut value_sum, mut sum) = (Cost::default(), Cost::default());
        for part in &parts.parts {
            let [value, all] = [&part.value, &part.all].map(|f| self.cost(f));
            (value_sum, sum) = (value_sum + value, sum + all);
            let named = part.step.is_empty() || part.step == part.name;
            let name = if named { part.name.clone() } else { format!("{} ({})", part.name, part.step) };
            row(text, &format!("  {name}"), Some(value), all);
        }
        row(text, "  sum of these", Some(value_sum), sum);
        let whole = &parts.whole;
        row(text, "  together, as it runs", Some(self.cost(&whole.value)), self.cost(&self.kernel.items[i]));
        let [value, all] = [&plain.whole.value, &plain.whole.all].map(|f| Cost::of_nodes(self.written, f));
        row(text, "  together, as written", Some(value), all);
    }

    fn cost(&self, function: &Function) -> Cost {
        Cost::of(self.composer.arena, function)
    }

    /// The average of a cycle, where there is more than one iteration in it.
    fn mean(&self, text: &mut String) {
        if self.kernel.items.len() > 1 {
            let items: Vec<Cost> = self.kernel.items.iter().map(|item| self.cost(item)).collect();
            row(text, "an iteration on the average", None, in_cycle(&self.kernel.schedule, &items));
        }
    }
}
