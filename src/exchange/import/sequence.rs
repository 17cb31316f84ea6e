//! Mandelbulber's nine slots: which formula runs at which iteration, and what each adds.

use super::ask::Ask;
use super::settings::Section;
use super::table::{Adds, Expanded, Row};
use super::text::sequence;
use super::value::{written, written_vector};
use super::{Lost, LostKind};
use crate::diag::Diagnostics;
use crate::graph::Schedule;

/// Iterations of a hybrid that are looked at to find its period.
const LOOKED_AT: u32 = 1000;

/// A slot with a formula in it.
pub struct Slot<'t> {
    /// Its number in the settings, from 1.
    pub number: usize,
    /// Its place among those that take turns, from 1.
    pub place: usize,
    /// The formula.
    pub row: &'t Row,
    /// The formula with the slot's settings.
    pub expanded: Expanded,
    /// Name of its node.
    pub name: String,
    /// The constant that its iterations add, as graph files write it.
    pub constant: String,
    /// How much of an iteration counts.
    pub weight: f64,
    /// Iterations at a time.
    count: u32,
    /// First and last iteration that may use it.
    range: (u32, u32),
}

impl<'t> Slot<'t> {
    /// Reads a slot's settings. In old hybrids the constant is common; where it is `own`, each slot has one of its own.
    pub fn new(
        (number, row): (usize, &'t Row),
        expanded: Expanded,
        (main, mode, own): (&Section, Mode, bool),
        lost: &mut Vec<Lost>,
        d: &mut Diagnostics,
    ) -> Slot<'t> {
        let of = |name: &str| format!("{name}_{number}");
        let weight = match mode {
            Mode::Hybrid => main.number(&of("formula_weight"), 1.0, d).clamp(0.0, 1.0),
            _ => 1.0,
        };
        let whole = |number: f64| number.clamp(0.0, f64::from(LOOKED_AT * 10)) as u32;
        let count = whole(main.number(&of("formula_iterations"), 1.0, d));
        let start = whole(main.number(&of("formula_start_iteration"), 0.0, d));
        let stop = whole(main.number(&of("formula_stop_iteration"), 250.0, d));
        let mut constant = constant((number, row), (main, own), weight, lost, d);
        let mut expanded = expanded;
        if constant == "Off" && expanded.steps.iter().any(|step| step.contains("add_constant(")) {
            // The map reads the constant, so there has to be one; what the iteration adds is taken off again.
            constant = added((number, row), (main, own), weight, lost, d);
            expanded.steps.push("add_constant(matrix: [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])".into());
        }
        Slot {
            number,
            place: number,
            row,
            expanded,
            name: String::new(),
            constant,
            weight,
            count,
            range: (start, stop),
        }
    }

    /// The slot's map as a node.
    pub fn node(&self) -> String {
        let map = sequence(&self.expanded.steps);
        match self.weight < 1.0 {
            true => format!("Blend(b: {map}, weight: {})", written(self.weight)),
            false => map,
        }
    }
}

/// How slots work together.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mode {
    /// Only the first is used.
    Single,
    /// They take turns.
    Hybrid,
    /// Each is an object of its own.
    Boolean,
}

/// The constant of a slot.
fn constant(
    (number, row): (usize, &Row),
    (main, is_own): (&Section, bool),
    weight: f64,
    lost: &mut Vec<Lost>,
    d: &mut Diagnostics,
) -> String {
    let is_switched = main.switch(&format!("dont_add_c_constant_{number}"), false, d);
    let adds = match row.constant {
        Adds::Point => !is_switched,
        Adds::Nothing => is_switched,
        Adds::Always => true,
    };
    // Asked for in any case, so that nobody hears of settings that were read.
    let mut unused = Vec::new();
    let constant = added((number, row), (main, is_own), weight, if adds { lost } else { &mut unused }, d);
    if adds { constant } else { "Off".into() }
}

/// The constant of a slot that adds one.
fn added(
    (number, row): (usize, &Row),
    (main, is_own): (&Section, bool),
    weight: f64,
    lost: &mut Vec<Lost>,
    d: &mut Diagnostics,
) -> String {
    let own = |name: &str| if is_own { format!("{name}_{number}") } else { name.to_string() };
    let is_julia = main.switch(&own("julia_mode"), false, d);
    let julia = main.vector(&own("julia_c"), [0.0; 3], d);
    let factor = main.vector(&own("fractal_constant_factor"), [1.0; 3], d);
    if is_julia && row.constant != Adds::Always {
        let parts: [f64; 3] = std::array::from_fn(|i| julia[i] * factor[i] * weight);
        return format!("Julia({})", written_vector(&parts));
    }
    let factor = if row.constant == Adds::Always { [1.0; 3] } else { factor };
    let share = factor[0] * weight;
    if factor.iter().any(|part| *part != factor[0]) || !(0.0..=1.0).contains(&share) {
        let what = format!("{} {} {} {}", own("fractal_constant_factor"), factor[0], factor[1], factor[2]);
        let why = "only one factor from 0 to 1 for all coordinates can be written; 1 is taken".to_string();
        lost.push(Lost { kind: LostKind::Shape, what, why });
        return "Mandelbrot".into();
    }
    match share == 1.0 {
        true => "Mandelbrot".into(),
        false => format!("Mix(julia: (0.0, 0.0, 0.0), amount: {})", written(1.0 - share)),
    }
}

/// Indices of the slots that run at iterations 0, 1, 2 ...: each slot in turn for its number of iterations, without those
/// whose range does not hold the iteration; after the last (of nine or more) from slot `repeat_from` on.
pub fn turns(slots: &[&Slot], repeat_from: usize, iterations: u32) -> Vec<usize> {
    let mut found = Vec::new();
    let (mut number, mut done) = (1, 0);
    let last = slots.iter().map(|slot| slot.place).max().unwrap_or(1).max(9);
    let next = |number: usize| if number >= last { repeat_from.clamp(1, last) } else { number + 1 };
    let runs = |number: usize, i: u32| {
        slots.iter().position(|slot| slot.place == number && (slot.range.0..=slot.range.1).contains(&i))
    };
    for i in 0..iterations.min(LOOKED_AT) {
        done += 1;
        for _ in 0..last {
            if runs(number, i).is_some() {
                break;
            }
            number = next(number);
        }
        // Where nothing may run the program runs the slot that it has come to.
        let at = runs(number, i).or_else(|| slots.iter().position(|slot| slot.place == number)).unwrap_or(0);
        found.push(at);
        if done >= slots[at].count {
            (number, done) = (next(number), 0);
        }
    }
    found
}

/// The node that runs named nodes by a sequence of turns.
pub fn schedule(names: &[String], turns: &[usize]) -> String {
    let Schedule { prefix, cycle } = Schedule::of_sequence(turns);
    // Turns are counted from iteration 0, also where a prefix comes first.
    let rotated: Vec<usize> =
        (0..cycle.len()).map(|i| cycle[(i + cycle.len() - prefix.len() % cycle.len()) % cycle.len()]).collect();
    let quoted = |item: usize| format!("\"{}\"", names[item]);
    let mut node = match runs(&rotated).as_slice() {
        [(item, _)] => quoted(*item),
        runs => {
            let parts: Vec<String> = runs.iter().map(|(item, count)| format!("({}, {count})", quoted(*item))).collect();
            format!("Alternate([{}])", parts.join(", "))
        }
    };
    let mut end = prefix.len();
    for (item, count) in runs(&prefix).into_iter().rev() {
        node = format!("Between(of: {}, from: {}, to: {end}, otherwise: {node})", quoted(item), end - count);
        end -= count;
    }
    node
}

/// Items and how often each stands in a row.
fn runs(items: &[usize]) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for &item in items {
        match runs.last_mut() {
            Some((last, count)) if *last == item => *count += 1,
            _ => runs.push((item, 1)),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::schedule;

    #[test]
    fn turns_behind_a_prefix_keep_their_places() {
        let names = ["a", "b", "c"].map(String::from);
        assert_eq!(schedule(&names, &[0, 0, 1, 0, 0, 1]), r#"Alternate([("a", 2), ("b", 1)])"#);
        assert_eq!(schedule(&names, &[1, 1, 1]), r#""b""#);
        // c c c, then a b a b: iteration 3 is an a, so even iterations are b.
        let text = schedule(&names, &[2, 2, 2, 0, 1, 0, 1]);
        assert_eq!(text, r#"Between(of: "c", from: 0, to: 3, otherwise: Alternate([("b", 1), ("a", 1)]))"#);
    }
}
