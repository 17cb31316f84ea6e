//! Several vectors in step: straight-line code for one vector becomes code for more of them.
//!
//! An operation waits for its arguments several cycles, and a fractal's iteration is mostly one chain of such waits. With
//! the operations of independent vectors near each other the processor works on one while the other waits.

use std::collections::HashMap;
use std::ops::Range;

use super::instructions::InstructionSet;
use super::segment::{Activity, Segment, Target};
use super::trace::{Operation, Place, Value};
use crate::expr::ops::Operator;
use crate::kernel::cpu::tapes::{OrbitTapes, Program};
use crate::kernel::tape::Code;

/// Vectors in step. With more of them fewer lanes are busy while the last one iterates.
pub(super) const COPIES: usize = 2;
/// Vectors in step where all their state has room in registers and an iteration waits long, with AVX2, whose vectors are half as
/// long. A march of the box took an eighth less time than with two, that of a sponge without quotients a twentieth more, and so did
/// those of larger states.
pub(super) const MORE_COPIES: usize = 3;
/// Numbers of a state that has room.
const SMALL_STATE: usize = 4;

/// Vectors in step of a kernel.
pub(super) fn copies_of(program: &Program, set: InstructionSet) -> usize {
    let estimator = match program {
        Program::Map(_) => return COPIES,
        Program::Estimate(tapes) => tapes,
        Program::March(tapes) => &tapes.estimator,
    };
    let is_small = |orbit: &OrbitTapes| orbit.state <= SMALL_STATE && waits(orbit);
    match set == InstructionSet::Avx2 && estimator.orbits.iter().all(is_small) {
        true => MORE_COPIES,
        false => COPIES,
    }
}

/// Whether an iteration has a quotient or a root, whose results take several times as long as others.
fn waits(orbit: &OrbitTapes) -> bool {
    let mut instructions = orbit.set.tapes[orbit.items..].iter().flat_map(|item| &item.instructions);
    instructions.any(|instruction| matches!(instruction.code, Code::Apply(Operator::Div | Operator::Sqrt)))
}

/// How the operations of the vectors in step follow each other.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Order {
    /// Alternates operations of each: for code that is run once, where no vector has a head start.
    ByTurns,
    /// Vector by vector, which needs the fewest registers: for loops, whose iterations overlap by themselves.
    OneByOne,
}

impl Segment {
    /// The code for `count` vectors. A place of a further copy lies so many behind that of the first as its number says.
    pub(super) fn copies(&self, count: usize, order: Order) -> Segment {
        let mut copied = Segment { operations: Vec::new(), outputs: Vec::new(), activity: Vec::new() };
        let mut numbers = vec![vec![0; self.operations.len()]; count];
        let mut shared = HashMap::new();
        let mut copy_operation = |i: usize, copy: usize, numbers: &mut [Value], operations: &mut Vec<Operation>| {
            let operation = match self.operations[i] {
                Operation::Read(place) => Operation::Read(place.of_copy(copy)),
                other => other.with_sources(|value| numbers[value as usize]),
            };
            let next = operations.len() as Value;
            numbers[i] = match operation {
                // What all copies have in common is there once.
                Operation::Constant(_) | Operation::Uniform(_) => *shared.entry(operation).or_insert(next),
                _ => next,
            };
            if numbers[i] == next {
                operations.push(operation);
            }
        };
        let groups: Vec<_> = self.groups().collect();
        let at_a_time = if order == Order::ByTurns { 1 } else { groups.len().max(1) };
        for part in groups.chunks(at_a_time) {
            for (copy, numbers) in numbers.iter_mut().enumerate() {
                let operations = part.iter().flat_map(Range::clone);
                operations.for_each(|i| copy_operation(i, copy, numbers, &mut copied.operations));
            }
        }
        for (copy, numbers) in numbers.iter().enumerate() {
            let of = |value: Value| numbers[value as usize];
            let outputs = self.outputs.iter().map(|&(value, target)| (of(value), target_of(target, copy)));
            copied.outputs.extend(outputs);
            copied.activity.extend(self.activity.iter().map(|activity| match *activity {
                Activity::Unchanged => Activity::Unchanged,
                Activity::Become(value) => Activity::Become(of(value)),
                Activity::Lose(value) => Activity::Lose(of(value)),
                Activity::Note(value) => Activity::Note(of(value)),
            }));
        }
        copied
    }

    /// Operations that must stay together: a call and its second result, which lies in memory until the next call.
    fn groups(&self) -> impl Iterator<Item = Range<usize>> {
        let is_second = |i: usize| matches!(self.operations.get(i), Some(Operation::Second(_)));
        (0..self.operations.len())
            .filter(move |&i| !is_second(i))
            .map(move |i| i..if is_second(i + 1) { i + 2 } else { i + 1 })
    }
}

impl Place {
    /// The place of a copy, of one of the first copy.
    pub(super) fn of_copy(self, copy: usize) -> Place {
        match self {
            Place::Slot(slot) => Place::Slot(slot + copy as u16),
            Place::Register(register) => Place::Register(register + copy as u8),
            Place::Active(first) => Place::Active(first + copy as u8),
            Place::Column(column, first) => Place::Column(column, first + copy as u8),
        }
    }
}

fn target_of(target: Target, copy: usize) -> Target {
    match target {
        Target::Slot(slot) => Target::Slot(slot + copy as u16),
        Target::Column(column, first) => Target::Column(column, first + copy as u8),
        Target::Register(register) => Target::Register(register + copy as u8),
        Target::ActiveRegister(register) => Target::ActiveRegister(register + copy as u8),
    }
}
