//! Several vectors in step: straight-line code for one vector becomes code for more of them.
//!
//! An operation waits for its arguments several cycles, and a fractal's iteration is mostly one chain of such waits. With
//! the operations of independent vectors between each other the processor works on one while the other waits.

use std::collections::HashMap;

use super::instructions::InstructionSet;
use super::segment::{Activity, Segment, Target};
use super::trace::{Operation, Place, Value};
use crate::kernel::cpu::tapes::Program;

/// Vectors in step. Marches take longer with more: fewer lanes are busy while the last of them iterates, and values go to
/// memory for want of registers.
pub(in crate::kernel::cpu) const COPIES: usize = 2;
/// Vectors in step of estimates with AVX2, whose vectors are half as long: as many as have room in registers for most states.
const ESTIMATE_COPIES: usize = 3;

/// Vectors in step of a kernel.
pub(super) fn copies_of(program: &Program, set: InstructionSet) -> usize {
    match (program, set) {
        (Program::Estimate(_), InstructionSet::Avx2) => ESTIMATE_COPIES,
        _ => COPIES,
    }
}

impl Segment {
    /// The code for `count` vectors, by turns an operation of each. A place of a further copy lies so many behind that of the
    /// first as its number says.
    pub(super) fn copies(&self, count: usize) -> Segment {
        let mut copied = Segment { operations: Vec::new(), outputs: Vec::new(), activity: Vec::new() };
        let mut numbers = vec![vec![0; self.operations.len()]; count];
        let mut shared = HashMap::new();
        let mut copy_operation = |i: usize, copy: usize, numbers: &mut [Value], operations: &mut Vec<Operation>| {
            let operation = match self.operations[i] {
                Operation::Read(place) => Operation::Read(place_of(place, copy)),
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
        for group in self.groups() {
            for (copy, numbers) in numbers.iter_mut().enumerate() {
                group.clone().for_each(|i| copy_operation(i, copy, numbers, &mut copied.operations));
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
            }));
        }
        copied
    }

    /// Operations that must stay together: a call and its second result, which lies in memory until the next call.
    fn groups(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let is_second = |i: usize| matches!(self.operations.get(i), Some(Operation::Second(_)));
        (0..self.operations.len())
            .filter(move |&i| !is_second(i))
            .map(move |i| i..if is_second(i + 1) { i + 2 } else { i + 1 })
    }
}

fn place_of(place: Place, copy: usize) -> Place {
    match place {
        Place::Slot(slot) => Place::Slot(slot + copy as u16),
        Place::Register(register) => Place::Register(register + copy as u8),
        Place::Active(first) => Place::Active(first + copy as u8),
        Place::Column(column, first) => Place::Column(column, first + copy as u8),
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
