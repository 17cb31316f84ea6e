//! Straight-line code: recorded operations, where their results go, and the frame's vectors.

use super::kit::Kits;
use super::trace::{Operation, Place, Value};

/// Where an output goes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Target {
    Slot(u16),
    /// A vector of a column that the kernel writes: that of a copy in the current block.
    Column(u16, u8),
    /// A register, whether it is set aside or not.
    Register(u8),
    /// A register that is set aside, in active lanes only.
    ActiveRegister(u8),
}

/// What becomes of the active lanes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Activity {
    Unchanged,
    /// They are those of a mask, from before the outputs are stored.
    Become(Value),
    /// Those of a mask are no longer active, once the outputs are stored.
    Lose(Value),
    /// Those of a mask are about to be lost: they are noted, and a jump may ask whether there are any. For masks that are vectors.
    Note(Value),
}

/// Straight-line code.
pub(super) struct Segment {
    pub(super) operations: Vec<Operation>,
    pub(super) outputs: Vec<(Value, Target)>,
    /// Of each copy.
    pub(super) activity: Vec<Activity>,
}

/// Vectors of the frame.
#[derive(Default)]
pub(super) struct Slots {
    next: u16,
    free: Vec<u16>,
}

impl Slots {
    /// Takes vectors that lie behind each other, and gives the first.
    pub(super) fn take_many(&mut self, count: usize) -> u16 {
        let first = self.next;
        self.next += count as u16;
        first
    }

    pub(super) fn take(&mut self) -> u16 {
        self.free.pop().unwrap_or_else(|| self.take_many(1))
    }

    /// Gives a vector back.
    pub(super) fn free(&mut self, slot: u16) {
        self.free.push(slot);
    }

    pub(super) fn len(&self) -> usize {
        usize::from(self.next)
    }
}

/// Slots that calls use: two arguments, two results; then those of the copies' active lanes, and of lanes about to be lost.
#[derive(Clone, Copy)]
pub(super) struct CallSlots {
    pub(super) first: u16,
    pub(super) kits: Kits,
}

impl CallSlots {
    /// How many there are.
    pub(super) fn count(copies: usize) -> usize {
        4 + 2 * copies
    }

    /// The first of the slots for the active lanes.
    pub(super) fn first_active(self) -> u16 {
        self.first + 4
    }
}

impl Segment {
    /// Numbers the operations that the outputs need.
    pub(super) fn needed(&self) -> Vec<bool> {
        let mut needed = vec![false; self.operations.len()];
        for value in self.outputs.iter().map(|o| o.0).chain(self.activity_values()) {
            needed[value as usize] = true;
        }
        for i in (0..self.operations.len()).rev().filter(|&i| self.operations[i].sources().next().is_some()) {
            if needed[i] {
                self.operations[i].sources().for_each(|source| needed[source as usize] = true);
            }
        }
        needed
    }

    pub(super) fn activity_values(&self) -> impl Iterator<Item = Value> {
        self.activity.iter().filter_map(|activity| match *activity {
            Activity::Unchanged => None,
            Activity::Become(value) | Activity::Lose(value) | Activity::Note(value) => Some(value),
        })
    }

    /// True when this is an iteration, which lanes leave.
    pub(super) fn is_iteration(&self) -> bool {
        self.activity.iter().any(|activity| matches!(activity, Activity::Lose(_) | Activity::Note(_)))
    }

    /// True when a function is called, which takes all registers.
    pub(super) fn has_calls(&self) -> bool {
        let needed = self.needed();
        self.operations.iter().zip(needed).any(|(operation, needed)| needed && matches!(operation, Operation::Call(..)))
    }

    /// True when the value of a place is used.
    pub(super) fn reads(&self, place: Place) -> bool {
        let needed = self.needed();
        self.operations.iter().zip(needed).any(|(operation, needed)| needed && *operation == Operation::Read(place))
    }
}
