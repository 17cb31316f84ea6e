//! Operations on masks: in mask registers where the instruction set has them, elsewhere in vectors.

use iced_x86::Code::*;
use iced_x86::{Code, Instruction};

use super::assemble::{Assembler, Source, VALID, mask};
use super::instructions::Form;
use crate::math::Precision;

impl Assembler {
    pub(super) fn mask_and(&mut self, dst: u8, a: u8, b: u8) {
        self.masks(VEX_Kandw_kr_kr_kr, Form::And, dst, a, b);
    }

    /// Lanes of `a` that are none of `b`.
    pub(super) fn mask_and_not(&mut self, dst: u8, a: u8, b: u8) {
        self.masks(VEX_Kandnw_kr_kr_kr, Form::AndNot, dst, b, a);
    }

    pub(super) fn mask_or(&mut self, dst: u8, a: u8, b: u8) {
        self.masks(VEX_Korw_kr_kr_kr, Form::Or, dst, a, b);
    }

    fn masks(&mut self, of_masks: Code, of_vectors: Form, dst: u8, a: u8, b: u8) {
        let instruction = match self.set.has_masks() {
            true => Instruction::with3(of_masks, mask(dst), mask(a), mask(b)).expect(VALID),
            false => self.three(of_vectors, dst, a, Source::Register(b)),
        };
        self.push(instruction);
    }

    pub(super) fn mask_not(&mut self, dst: u8, a: u8) {
        if !self.set.has_masks() {
            let all = Source::Constant(self.constant(u64::MAX));
            let instruction = self.three(Form::Xor, dst, a, all);
            return self.push(instruction);
        }
        let code = match self.precision {
            Precision::F32 => VEX_Knotw_kr_kr,
            Precision::F64 => VEX_Knotb_kr_kr,
        };
        self.push(Instruction::with2(code, mask(dst), mask(a)).expect(VALID));
    }

    pub(super) fn mask_load(&mut self, dst: u8, from: u16) {
        let from = self.slot(from);
        self.push(Instruction::with2(VEX_Kmovw_kr_km16, mask(dst), from).expect(VALID));
    }

    pub(super) fn mask_store(&mut self, to: u16, a: u8) {
        let to = self.slot(to);
        self.push(Instruction::with2(VEX_Kmovw_m16_kr, to, mask(a)).expect(VALID));
    }
}
