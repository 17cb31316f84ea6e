//! The end of a segment: its outputs go to their places, and lanes become active or cease to be.

use super::Emitter;
use crate::kernel::cpu::compiled::active::Active;
use crate::kernel::cpu::compiled::assemble::Source;
use crate::kernel::cpu::compiled::segment::{Activity, Segment, Target};
use crate::kernel::cpu::compiled::trace::{Operation, Place, Value};

impl Emitter<'_> {
    /// Stores the outputs.
    pub(super) fn finish(&mut self, segment: &Segment) {
        self.at = self.operations.len() as u32;
        for (copy, activity) in segment.activity.iter().enumerate() {
            if let Activity::Become(mask) = *activity {
                let mask = self.mask_register(mask, &[]);
                self.assembler.activate(copy as u8, mask);
            }
        }
        // Masks that are vectors have been read: their registers are needed.
        let is_over = !self.assembler.set.has_masks();
        if is_over {
            self.deactivate(segment);
        }
        self.move_out_of_the_way(segment);
        for (value, target) in &segment.outputs {
            if self.is_there(*value, *target) || matches!(target, Target::Register(to) if *to < self.limit) {
                continue;
            }
            let register = self.register(*value, &[]);
            match *target {
                Target::Slot(slot) => self.assembler.store(slot, register),
                Target::Column(column, copy) => self.assembler.store_column(column, copy, register),
                Target::Register(to) => self.assembler.load(to, Source::Register(register)),
                // Registers of a state lie by copy.
                Target::ActiveRegister(to) => {
                    let copy = (to - self.limit) % self.copies;
                    let condition = match self.assembler.active(copy) {
                        Active::Mask(condition) => condition,
                        Active::Slot(slot) => {
                            let condition = self.take_vector(&[*value]);
                            self.assembler.load(condition, Source::Slot(slot));
                            condition
                        }
                    };
                    self.assembler.merge(to, condition, register);
                }
            }
        }
        self.shuffle(segment);
        if !is_over {
            self.deactivate(segment);
        }
        for i in 0..self.operations.len() {
            if let (true, Some(Source::Slot(slot))) = (self.spilled[i], self.memory[i]) {
                self.slots.free(slot);
            }
        }
    }

    /// Ends the lanes that are no longer active, or notes them.
    fn deactivate(&mut self, segment: &Segment) {
        for (copy, activity) in segment.activity.iter().enumerate() {
            if let Activity::Lose(mask) = *activity {
                let mask = self.mask_register(mask, &[]);
                self.assembler.deactivate(copy as u8, mask);
            }
        }
        let noted = segment.activity.iter().filter_map(|activity| match *activity {
            Activity::Note(mask) => Some(mask),
            _ => None,
        });
        let noted: Vec<Value> = noted.collect();
        if !noted.is_empty() {
            let masks: Vec<u8> = noted.iter().map(|&mask| self.mask_register(mask, &noted)).collect();
            self.assembler.note(&masks);
        }
    }

    /// Moves outputs into the registers that are theirs from here on, of those that are not set aside.
    fn shuffle(&mut self, segment: &Segment) {
        let ends_here = |&(value, target): &(Value, Target)| match target {
            Target::Register(to) if to < self.limit => Some((value, to)),
            _ => None,
        };
        let all: Vec<(Value, u8)> = segment.outputs.iter().filter_map(ends_here).collect();
        let mut left = all.clone();
        loop {
            left.retain(|&(value, to)| self.home[value as usize] != Some(to));
            let is_free = |to: u8| self.vectors[to as usize].is_none_or(|held| left.iter().all(|&(v, _)| v != held));
            if let Some(i) = left.iter().position(|&(_, to)| is_free(to)) {
                let (value, to) = left.swap_remove(i);
                self.copy_to(to, value);
                if let Some(home) = self.home[value as usize]
                    && !all.contains(&(value, home))
                {
                    self.vectors[home as usize] = None;
                }
                if let Some(held) = self.vectors[to as usize] {
                    self.home[held as usize] = None;
                }
                self.hold(value, to);
            } else if let Some(&(_, to)) = left.first() {
                // A circle: what is in the way goes elsewhere.
                let held = self.vectors[to as usize].expect("what is not free is held");
                let keep: Vec<Value> = all.iter().map(|&(value, _)| value).collect();
                let elsewhere = self.take_vector(&keep);
                self.assembler.load(elsewhere, Source::Register(to));
                self.vectors[to as usize] = None;
                self.hold(held, elsewhere);
            } else {
                return;
            }
        }
    }

    /// True when an output is an input that stays where it is.
    fn is_there(&self, value: Value, target: Target) -> bool {
        if let (Some(Source::Slot(from)), Target::Slot(to)) = (self.memory[value as usize], target)
            && from == to
        {
            return true;
        }
        match (self.operations[value as usize], target) {
            (Operation::Read(Place::Slot(from)), Target::Slot(to)) => from == to,
            (Operation::Read(Place::Register(from)), Target::Register(to) | Target::ActiveRegister(to)) => from == to,
            _ => false,
        }
    }

    /// Copies outputs that another output would overwrite before they are stored.
    fn move_out_of_the_way(&mut self, segment: &Segment) {
        for (value, target) in &segment.outputs {
            if self.is_there(*value, *target) {
                continue;
            }
            let overwritten = |place: Place| {
                segment.outputs.iter().any(|(_, other)| match (place, *other) {
                    (Place::Slot(from), Target::Slot(to)) => from == to,
                    (Place::Register(from), Target::Register(to) | Target::ActiveRegister(to)) => from == to,
                    _ => false,
                })
            };
            match self.operations[*value as usize] {
                Operation::Read(place @ Place::Slot(_)) if overwritten(place) => {
                    self.register(*value, &[]);
                    // Should it need memory again, then elsewhere.
                    self.memory[*value as usize] = None;
                }
                Operation::Read(place @ Place::Register(from)) if from >= self.limit && overwritten(place) => {
                    let register = self.take_vector(&[]);
                    self.assembler.load(register, Source::Register(from));
                    self.hold(*value, register);
                }
                _ => {}
            }
        }
    }
}
