//! The active lanes of the vectors in step: where they are kept, how they change, and jumps that ask for them.
//!
//! With AVX-512 the masks of active lanes have the machine's last mask registers. Elsewhere masks are vectors, and those of the
//! active lanes lie in the frame, so that all registers are there for values.

use iced_x86::Code::*;
use iced_x86::{Code, Instruction, Register};

use super::assemble::{Assembler, Label, Source, VALID, mask};
use super::instructions::Form;

/// The mask of active lanes; those of further copies lie before it.
const ACTIVE: u8 = 7;

/// Where the active lanes of a copy are kept.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Active {
    /// A mask register.
    Mask(u8),
    /// A vector of the frame.
    Slot(u16),
}

impl Assembler {
    /// Where a copy's active lanes are kept.
    pub(super) fn active(&self, copy: u8) -> Active {
        match self.set.has_masks() {
            true => Active::Mask(ACTIVE - copy),
            false => Active::Slot(self.active_slot(copy)),
        }
    }

    /// The slot of a copy's active lanes; with mask registers they are there only during calls.
    fn active_slot(&self, copy: u8) -> u16 {
        self.first_active + u16::from(copy)
    }

    /// The active lanes become those of a mask.
    pub(super) fn activate(&mut self, copy: u8, condition: u8) {
        match self.active(copy) {
            Active::Mask(active) => {
                self.push(Instruction::with2(VEX_Kmovw_kr_km16, mask(active), mask(condition)).expect(VALID));
            }
            Active::Slot(slot) => self.store(slot, condition),
        }
    }

    /// The lanes of a mask are no longer active. Where masks are vectors, this one is overwritten.
    pub(super) fn deactivate(&mut self, copy: u8, condition: u8) {
        match self.active(copy) {
            Active::Mask(active) => {
                let (active, condition) = (mask(active), mask(condition));
                self.push(Instruction::with3(VEX_Kandnw_kr_kr_kr, active, condition, active).expect(VALID));
            }
            Active::Slot(slot) => {
                let instruction = self.three(Form::AndNot, condition, condition, Source::Slot(slot));
                self.push(instruction);
                self.store(slot, condition);
            }
        }
    }

    /// Notes which lanes of the copies' masks are active, and sets the zero flag when none is. The masks' registers are overwritten.
    pub(super) fn note(&mut self, conditions: &[u8]) {
        let copies = conditions.len() as u16;
        for (copy, &condition) in (0..).zip(conditions) {
            let instruction = self.three(Form::And, condition, condition, Source::Slot(self.active_slot(copy)));
            self.push(instruction);
            self.store(self.first_active + copies + u16::from(copy), condition);
        }
        let (&either, others) = conditions.split_first().expect("at least one vector is in step");
        for &condition in others {
            let instruction = self.three(Form::Or, either, either, Source::Register(condition));
            self.push(instruction);
        }
        self.test_vector(either);
    }

    /// Jumps when the last note had any lanes. Moves may stand between.
    pub(super) fn jump_if_any_noted(&mut self, to: Label) {
        self.branch(Code::Jne_rel32_64, to);
    }

    /// The lanes noted last are no longer active.
    pub(super) fn deactivate_noted(&mut self, copies: u8) {
        const NOTED: u8 = 0;
        for copy in 0..copies {
            self.load(NOTED, Source::Slot(self.first_active + u16::from(copies) + u16::from(copy)));
            self.deactivate(copy, NOTED);
        }
    }

    /// Jumps unless all lanes are active. May overwrite the first register. For masks that are vectors.
    pub(super) fn jump_unless_all_active(&mut self, copies: u8, to: Label) {
        const ALL: u8 = 0;
        self.load(ALL, Source::Slot(self.active_slot(0)));
        for copy in 1..copies {
            let instruction = self.three(Form::And, ALL, ALL, Source::Slot(self.active_slot(copy)));
            self.push(instruction);
        }
        let (signs, lanes) = (self.code(Form::Signs), self.set.lanes(self.precision));
        self.push(Instruction::with2(signs, Register::EAX, self.vector(ALL)).expect(VALID));
        self.push(Instruction::with2(Code::Cmp_rm32_imm32, Register::EAX, (1 << lanes) - 1).expect(VALID));
        self.branch(Code::Jne_rel32_64, to);
    }

    /// Saves the active lanes before a call, which may change the registers of masks.
    pub(super) fn save_active(&mut self, copies: u8) {
        for copy in 0..copies {
            if let Active::Mask(active) = self.active(copy) {
                self.mask_store(self.active_slot(copy), active);
            }
        }
    }

    /// Brings them back.
    pub(super) fn restore_active(&mut self, copies: u8) {
        for copy in 0..copies {
            if let Active::Mask(active) = self.active(copy) {
                self.mask_load(active, self.active_slot(copy));
            }
        }
    }

    /// Jumps when no lane is active. May overwrite the first register or mask that values take.
    pub(super) fn jump_if_none_active(&mut self, copies: u8, to: Label) {
        match self.active(0) {
            Active::Mask(first) => self.test_masks(first, copies),
            Active::Slot(first) => self.test_vectors(first, copies),
        }
        self.branch(Code::Je_rel32_64, to);
    }

    /// Sets the zero flag when no lane of the copies' masks is set.
    fn test_masks(&mut self, first: u8, copies: u8) {
        // One instruction looks at two masks.
        const EITHER: u8 = 1;
        let (mut either, last) = (first, first + 1 - copies);
        for copy in 1..copies.max(1) - 1 {
            self.mask_or(EITHER, either, first - copy);
            either = EITHER;
        }
        self.push(Instruction::with2(VEX_Kortestw_kr_kr, mask(either), mask(last)).expect(VALID));
    }

    /// The same for masks in the frame.
    fn test_vectors(&mut self, first: u16, copies: u8) {
        const EITHER: u8 = 0;
        self.load(EITHER, Source::Slot(first));
        for copy in 1..u16::from(copies) {
            let instruction = self.three(Form::Or, EITHER, EITHER, Source::Slot(first + copy));
            self.push(instruction);
        }
        self.test_vector(EITHER);
    }

    /// Sets the zero flag when no lane of a mask is set.
    fn test_vector(&mut self, condition: u8) {
        let condition = self.vector(condition);
        self.push(Instruction::with2(VEX_Vtestps_ymm_ymmm256, condition, condition).expect(VALID));
    }

    /// Jumps when at least as many lanes are active as the caller asked for.
    pub(super) fn jump_if_enough_active(&mut self, copies: u8, to: Label) {
        let (count, sum, wanted) = (Register::EAX, Register::ECX, Register::R15D);
        self.push(Instruction::with2(Code::Xor_r32_rm32, sum, sum).expect(VALID));
        for copy in 0..copies {
            match self.active(copy) {
                Active::Mask(active) => {
                    self.push(Instruction::with2(VEX_Kmovw_r32_kr, count, mask(active)).expect(VALID));
                }
                Active::Slot(slot) => {
                    self.load(0, Source::Slot(slot));
                    let code = self.code(Form::Signs);
                    self.push(Instruction::with2(code, count, self.vector(0)).expect(VALID));
                }
            }
            self.push(Instruction::with2(Code::Popcnt_r32_rm32, count, count).expect(VALID));
            self.push(Instruction::with2(Code::Add_r32_rm32, sum, count).expect(VALID));
        }
        self.push(Instruction::with2(Code::Cmp_r32_rm32, sum, wanted).expect(VALID));
        self.branch(Code::Jae_rel32_64, to);
    }
}
