//! Recorded operations to instructions, with values kept in registers as long as they are needed.
//!
//! Since the code has no branches, the distance to the next use of every value is known. Where registers run out, the
//! value that is used last makes room (Belady's rule): it goes to the frame, unless it is there anyway.

mod outputs;

use std::ops::Range;

use rustc_hash::FxHashMap;

use super::active::Active;
use super::assemble::{Assembler, Source};
use super::instructions::{Form, Fused};
use super::segment::{CallSlots, Segment, Slots, Target};
use super::trace::{Binary, Kit, Operation, Place, Unary, Value};

/// Most vector registers of any instruction set.
const MOST_REGISTERS: usize = 32;
/// The first mask register that values may take: the machine's first cannot hold one, its last are the active lanes.
const FIRST_MASK: u8 = 1;
/// Mask registers of a machine that has them.
const MASKS: usize = 8;

impl Segment {
    /// Writes the code. Registers from `limit` on are set aside.
    pub(in crate::kernel::cpu::compiled) fn emit(
        &self,
        assembler: &mut Assembler,
        slots: &mut Slots,
        calls: CallSlots,
        limit: u8,
    ) {
        let mut emitter = Emitter::new(self, assembler, slots, calls, limit);
        for (i, operation) in self.operations.iter().enumerate() {
            if !emitter.uses[i].is_empty() {
                emitter.at = i as u32;
                emitter.operation(i as Value, *operation);
                while let Some(slot) = emitter.dying_slots.pop() {
                    emitter.slots.free(slot);
                }
            }
        }
        emitter.finish(self);
    }
}

struct Emitter<'a> {
    assembler: &'a mut Assembler,
    slots: &'a mut Slots,
    calls: CallSlots,
    operations: &'a [Operation],
    limit: u8,
    /// The operation being written.
    at: u32,
    /// Operations that read a value, the last one first.
    uses: Vec<Vec<u32>>,
    /// Register of a value (vector or mask).
    home: Vec<Option<u8>>,
    /// Where else it is.
    memory: Vec<Option<Source>>,
    spilled: Vec<bool>,
    /// Where a value goes in the end.
    targets: Vec<Option<Target>>,
    /// The last reads of what slots hold when the segment starts.
    reads: FxHashMap<u16, u32>,
    /// Slots whose values are dead, but which the current operation may still read from.
    dying_slots: Vec<u16>,
    vectors: [Option<Value>; MOST_REGISTERS],
    masks: [Option<Value>; MASKS],
    /// Copies in step.
    copies: u8,
}

impl<'a> Emitter<'a> {
    fn new(
        segment: &'a Segment,
        assembler: &'a mut Assembler,
        slots: &'a mut Slots,
        calls: CallSlots,
        limit: u8,
    ) -> Emitter<'a> {
        let count = segment.operations.len();
        let mut uses = vec![Vec::new(); count];
        let end = segment.outputs.iter().map(|o| o.0).chain(segment.activity_values());
        end.for_each(|value| uses[value as usize].push(count as u32));
        let needed = segment.needed();
        for i in (0..count).rev().filter(|&i| needed[i]) {
            segment.operations[i].sources().for_each(|source| uses[source as usize].push(i as u32));
        }
        let mut emitter = Emitter {
            assembler,
            slots,
            calls,
            operations: &segment.operations,
            limit,
            at: 0,
            uses,
            home: vec![None; count],
            memory: vec![None; count],
            spilled: vec![false; count],
            targets: vec![None; count],
            reads: FxHashMap::default(),
            dying_slots: Vec::new(),
            vectors: [None; MOST_REGISTERS],
            masks: [None; MASKS],
            copies: segment.activity.len() as u8,
        };
        segment.outputs.iter().for_each(|&(value, target)| emitter.targets[value as usize] = Some(target));
        for (i, operation) in segment.operations.iter().enumerate() {
            match *operation {
                _ if emitter.uses[i].is_empty() => {}
                Operation::Constant(bits) => {
                    emitter.memory[i] = Some(Source::Constant(emitter.assembler.constant(bits)));
                }
                Operation::Uniform(number) => {
                    emitter.memory[i] = Some(Source::Constant(emitter.assembler.uniform(number)));
                }
                Operation::Read(Place::Slot(slot)) => {
                    emitter.memory[i] = Some(Source::Slot(slot));
                    emitter.reads.insert(slot, emitter.uses[i][0]);
                }
                Operation::Read(Place::Register(register)) => {
                    emitter.home[i] = Some(register);
                    emitter.vectors[register as usize] = Some(i as Value);
                }
                Operation::Read(Place::Active(copy)) => match emitter.assembler.active(copy) {
                    Active::Mask(register) => emitter.home[i] = Some(register),
                    Active::Slot(slot) => emitter.memory[i] = Some(Source::Slot(slot)),
                },
                _ => {}
            }
        }
        emitter
    }

    fn next_use(&self, value: Value) -> u32 {
        self.uses[value as usize].last().copied().unwrap_or(u32::MAX)
    }

    fn is_used_later(&self, value: Value) -> bool {
        self.uses[value as usize].first().is_some_and(|&last| last > self.at)
    }

    /// True when the current operation may overwrite the value's register.
    fn dies(&self, value: Value) -> bool {
        self.home[value as usize].is_some_and(|r| r < self.limit) && !self.is_used_later(value)
    }

    /// True when the value lives in mask registers, where the machine has them.
    fn is_in_masks(&self, value: Value) -> bool {
        self.assembler.set.has_masks() && self.operations[value as usize].is_mask()
    }

    /// Saves a value to the frame, unless it is in memory: there, in a column or among the constants.
    fn spill(&mut self, value: Value) {
        let i = value as usize;
        if self.memory[i].is_some() || matches!(self.operations[i], Operation::Read(Place::Column(..))) {
            return;
        }
        let Some(home) = self.home[i] else { return };
        // Not tried with masks.
        if let Some(Target::Slot(slot)) = self.targets[i]
            && !self.assembler.set.has_masks()
            && !self.operations[i].is_mask()
            && self.reads.get(&slot).is_none_or(|&read| read < self.at)
        {
            self.assembler.store(slot, home);
            self.memory[i] = Some(Source::Slot(slot));
            return;
        }
        let slot = self.slots.take();
        match self.is_in_masks(value) {
            true => self.assembler.mask_store(slot, home),
            false => self.assembler.store(slot, home),
        }
        self.memory[i] = Some(Source::Slot(slot));
        self.spilled[i] = true;
    }

    /// Makes a vector register free that holds none of the values to keep.
    fn take_vector(&mut self, keep: &[Value]) -> u8 {
        let limit = self.limit;
        self.take(0..limit, keep, |emitter, r| &mut emitter.vectors[r as usize])
    }

    /// The same for a mask register.
    fn take_mask(&mut self, keep: &[Value]) -> u8 {
        match self.assembler.active(self.copies - 1) {
            Active::Mask(end) => self.take(FIRST_MASK..end, keep, |emitter, r| &mut emitter.masks[r as usize]),
            Active::Slot(_) => self.take_vector(keep),
        }
    }

    fn take(
        &mut self,
        registers: Range<u8>,
        keep: &[Value],
        holder: impl Fn(&mut Self, u8) -> &mut Option<Value>,
    ) -> u8 {
        if let Some(free) = registers.clone().find(|&r| holder(self, r).is_none()) {
            return free;
        }
        let held = registers.filter_map(|r| holder(self, r).map(|v| (self.next_use(v), r, v)));
        let held: Vec<_> = held.filter(|(_, _, v)| !keep.contains(v)).collect();
        let (_, register, victim) =
            held.into_iter().max().expect("an operation reads fewer values than there are registers");
        self.spill(victim);
        self.home[victim as usize] = None;
        *holder(self, register) = None;
        register
    }

    fn hold(&mut self, value: Value, register: u8) {
        self.home[value as usize] = Some(register);
        match self.is_in_masks(value) {
            true => self.masks[register as usize] = Some(value),
            false => self.vectors[register as usize] = Some(value),
        }
    }

    /// The register of a value, loaded where it has none.
    fn register(&mut self, value: Value, keep: &[Value]) -> u8 {
        if let Some(home) = self.home[value as usize] {
            return home;
        }
        let register = self.take_vector(keep);
        self.copy_to(register, value);
        self.hold(value, register);
        register
    }

    /// Copies a value to a register from wherever it is.
    fn copy_to(&mut self, register: u8, value: Value) {
        let source = match (self.home[value as usize], self.memory[value as usize]) {
            (Some(home), _) => Source::Register(home),
            (None, Some(source)) => source,
            (None, None) => {
                let Operation::Read(Place::Column(column, copy)) = self.operations[value as usize] else {
                    unreachable!("a value without a register is in memory")
                };
                return self.assembler.load_column(register, column, copy);
            }
        };
        self.assembler.load(register, source);
    }

    fn mask_register(&mut self, value: Value, keep: &[Value]) -> u8 {
        if !self.is_in_masks(value) {
            return self.register(value, keep);
        }
        if let Some(home) = self.home[value as usize] {
            return home;
        }
        let Some(Source::Slot(slot)) = self.memory[value as usize] else {
            unreachable!("a mask without a register is in the frame")
        };
        let register = self.take_mask(keep);
        self.assembler.mask_load(register, slot);
        self.hold(value, register);
        register
    }

    /// A value as the last source of an instruction, which may be in memory.
    fn source(&mut self, value: Value, keep: &[Value]) -> Source {
        match (self.home[value as usize], self.memory[value as usize]) {
            (None, Some(source)) if self.reads_from_memory(value) => source,
            _ => Source::Register(self.register(value, keep)),
        }
    }

    /// True when loading the value would not pay.
    fn reads_from_memory(&self, value: Value) -> bool {
        match (self.home[value as usize], self.memory[value as usize]) {
            (None, Some(Source::Constant(_))) => true,
            (None, Some(_)) => !self.is_used_later(value),
            _ => false,
        }
    }

    /// Ends the current operation's use of its sources.
    fn retire(&mut self, sources: impl Iterator<Item = Value>) {
        for value in sources {
            let i = value as usize;
            while self.uses[i].last().is_some_and(|&u| u <= self.at) {
                self.uses[i].pop();
            }
            if !self.uses[i].is_empty() {
                continue;
            }
            if let Some(home) = self.home[i].take()
                && home < self.assembler.set.registers()
            {
                match self.is_in_masks(value) {
                    true => self.masks[home as usize] = None,
                    false => self.vectors[home as usize] = None,
                }
            }
            if let (true, Some(Source::Slot(slot))) = (self.spilled[i], self.memory[i]) {
                self.dying_slots.push(slot);
                self.spilled[i] = false;
            }
        }
    }

    fn operation(&mut self, value: Value, operation: Operation) {
        match operation {
            Operation::Constant(_) | Operation::Uniform(_) | Operation::Read(_) => {}
            Operation::Unary(unary, a) => {
                let dst = match unary {
                    Unary::Neg | Unary::Abs => {
                        let a = self.register(a, &[a]);
                        let dst = self.result(value, operation);
                        self.assembler.sign(unary, dst, a);
                        dst
                    }
                    Unary::Sqrt | Unary::Floor => {
                        let a = self.source(a, &[a]);
                        let dst = self.result(value, operation);
                        self.assembler.unary(unary, dst, a);
                        dst
                    }
                };
                self.hold(value, dst);
            }
            Operation::Binary(binary, a, b) => {
                let swap = matches!(binary, Binary::Add | Binary::Mul) && self.reads_from_memory(a);
                let (a, b) = if swap { (b, a) } else { (a, b) };
                let (first, second) = (self.register(a, &[a, b]), self.source(b, &[a, b]));
                let dst = self.result(value, operation);
                self.assembler.binary(binary, dst, first, second);
                self.hold(value, dst);
            }
            Operation::MulAdd { .. } => self.mul_add(value, operation),
            Operation::Compare(comparison, a, b) => {
                let (first, second) = (self.register(a, &[a, b]), self.source(b, &[a, b]));
                self.retire(operation.sources());
                let dst = self.take_mask(&[]);
                self.assembler.compare(comparison, dst, first, second);
                self.hold(value, dst);
            }
            Operation::Select(mask, a, b) if !self.assembler.set.has_masks() && self.is_zero(b) => {
                self.masked(value, operation, Form::And, [mask, a]);
            }
            Operation::Select(mask, a, b) if !self.assembler.set.has_masks() && self.is_zero(a) => {
                self.masked(value, operation, Form::AndNot, [mask, b]);
            }
            Operation::Select(mask, a, b) => {
                let keep = [mask, a, b];
                let mask = self.mask_register(mask, &keep);
                let (otherwise, then) = (self.register(b, &keep), self.source(a, &keep));
                let dst = self.result(value, operation);
                self.assembler.select(dst, mask, otherwise, then);
                self.hold(value, dst);
            }
            Operation::FromMask(mask) => {
                let mask = self.mask_register(mask, &[mask]);
                let dst = self.result(value, operation);
                self.assembler.number_from_mask(dst, mask);
                self.hold(value, dst);
            }
            Operation::MaskAnd(a, b) | Operation::MaskOr(a, b) if !self.assembler.set.has_masks() => {
                let form = if matches!(operation, Operation::MaskAnd(..)) { Form::And } else { Form::Or };
                self.masked(value, operation, form, if self.reads_from_memory(a) { [b, a] } else { [a, b] });
            }
            Operation::MaskAndNot(a, b) if !self.assembler.set.has_masks() => {
                self.masked(value, operation, Form::AndNot, [b, a]);
            }
            Operation::MaskAnd(a, b) | Operation::MaskAndNot(a, b) | Operation::MaskOr(a, b) => {
                let (first, second) = (self.mask_register(a, &[a, b]), self.mask_register(b, &[a, b]));
                self.retire(operation.sources());
                let dst = self.take_mask(&[]);
                match operation {
                    Operation::MaskAnd(..) => self.assembler.mask_and(dst, first, second),
                    Operation::MaskAndNot(..) => self.assembler.mask_and_not(dst, first, second),
                    _ => self.assembler.mask_or(dst, first, second),
                }
                self.hold(value, dst);
            }
            Operation::MaskNot(a) => {
                let first = self.mask_register(a, &[a]);
                self.retire(operation.sources());
                let dst = self.take_mask(&[]);
                self.assembler.mask_not(dst, first);
                self.hold(value, dst);
            }
            Operation::Call(kit, a, b) => {
                self.call(kit, [a, b]);
                let dst = self.take_vector(&[]);
                self.assembler.load(dst, Source::Slot(self.calls.first + 2));
                self.hold(value, dst);
            }
            Operation::Second(_) => {
                // Recorded right behind its call, so the result still lies there.
                self.retire(operation.sources());
                let dst = self.take_vector(&[]);
                self.assembler.load(dst, Source::Slot(self.calls.first + 3));
                self.hold(value, dst);
            }
        }
    }

    /// True for the constant 0.
    fn is_zero(&self, value: Value) -> bool {
        self.operations[value as usize] == Operation::Constant(0)
    }

    /// A bitwise operation of a mask that is a vector, and a value.
    fn masked(&mut self, value: Value, operation: Operation, form: Form, [mask, a]: [Value; 2]) {
        let (first, second) = (self.register(mask, &[mask, a]), self.source(a, &[mask, a]));
        let dst = self.result(value, operation);
        let instruction = self.assembler.three(form, dst, first, second);
        self.assembler.push(instruction);
        self.hold(value, dst);
    }

    /// A register for the result, after the last use of sources that end here. A source that has to make room is
    /// saved first, and still there when the instruction reads it.
    fn result(&mut self, value: Value, operation: Operation) -> u8 {
        self.retire(operation.sources());
        match self.targets[value as usize] {
            // Not tried with masks either.
            Some(Target::Register(to))
                if !self.assembler.set.has_masks() && to < self.limit && self.vectors[to as usize].is_none() =>
            {
                to
            }
            _ => self.take_vector(&[]),
        }
    }

    fn mul_add(&mut self, value: Value, operation: Operation) {
        let Operation::MulAdd { a, b, c, minus_product, minus_c } = operation else { return };
        let keep = [a, b, c];
        let signs = (minus_product, minus_c);
        let (form, dst, second, last) = if self.dies(c) && c != a && c != b {
            let (a, b) = if self.reads_from_memory(a) { (b, a) } else { (a, b) };
            let (second, last) = (self.register(a, &keep), self.source(b, &keep));
            (Fused::Dst231, self.register(c, &keep), second, last)
        } else if let Some((x, y)) = [(a, b), (b, a)].into_iter().find(|&(x, y)| self.dies(x) && x != y && x != c) {
            let dst = self.register(x, &keep);
            if self.reads_from_memory(y) && self.home[c as usize].is_some() {
                (Fused::Dst132, dst, self.register(c, &keep), self.source(y, &keep))
            } else {
                (Fused::Dst213, dst, self.register(y, &keep), self.source(c, &keep))
            }
        } else {
            let (a, b) = if self.reads_from_memory(a) { (b, a) } else { (a, b) };
            let (second, last) = (self.register(a, &keep), self.source(b, &keep));
            let dst = self.take_vector(&keep);
            self.copy_to(dst, c);
            (Fused::Dst231, dst, second, last)
        };
        self.retire(operation.sources());
        self.assembler.mul_add(form, signs, dst, second, last);
        self.hold(value, dst);
    }

    fn call(&mut self, kit: Kit, arguments: [Value; 2]) {
        for (i, argument) in arguments.into_iter().enumerate() {
            let register = self.register(argument, &arguments);
            self.assembler.store(self.calls.first + i as u16, register);
        }
        self.retire(arguments.into_iter());
        let live = self.vectors.iter().chain(&self.masks).flatten().copied().collect::<Vec<_>>();
        for value in live {
            self.spill(value);
            self.home[value as usize] = None;
        }
        self.vectors = [None; MOST_REGISTERS];
        self.masks = [None; MASKS];
        self.assembler.save_active(self.copies);
        let table = if let Kit::Lookup(address) = kit { address } else { 0 };
        self.assembler.call(self.calls.kits.function(kit), self.calls.first, table);
        self.assembler.restore_active(self.copies);
    }
}
