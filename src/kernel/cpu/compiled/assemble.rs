//! Machine code for AVX-512: instructions over numbered registers and a frame of vectors, and the memory that holds them.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use iced_x86::Code::*;
use iced_x86::{BlockEncoder, BlockEncoderOptions, Code, Instruction, InstructionBlock, MemoryOperand, Register};
use memmap2::{Mmap, MmapMut};

use super::trace::{Binary, Comparison, Unary};
use crate::kernel::cpu::Precision;

/// Bytes of a vector.
pub(super) const VECTOR: usize = 64;

/// Points at the frame of vectors.
const FRAME: Register = Register::RBX;
/// Points at the constants.
const CONSTANTS: Register = Register::R12;
/// The mask of active lanes; those of further copies lie before it.
pub(super) const ACTIVE: u8 = 7;

/// The last source of an instruction.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Source {
    Register(u8),
    Slot(u16),
    /// A number of the pool, in all lanes.
    Constant(u16),
}

/// A place in the code to jump to.
#[derive(Clone, Copy)]
pub(super) struct Label(u64);

/// Counters in the machine's general registers.
#[derive(Clone, Copy)]
pub(super) enum Counter {
    /// Iterations left.
    Iterations,
    /// Place in the schedule.
    Schedule,
}

impl Counter {
    fn register(self) -> Register {
        match self {
            Counter::Iterations => Register::R13,
            Counter::Schedule => Register::R14,
        }
    }
}

/// Which factor of a fused multiply-add the result overwrites.
#[derive(Clone, Copy)]
pub(super) enum Fused {
    /// `dst = dst * last + second`
    Dst132,
    /// `dst = second * dst + last`
    Dst213,
    /// `dst = second * last + dst`
    Dst231,
}

/// Instructions, and the constants that they refer to.
pub(super) struct Assembler {
    precision: Precision,
    instructions: Vec<Instruction>,
    labels: u64,
    /// The label of the next instruction.
    here: u64,
    /// Numbers and tables, in words of four bytes.
    pool: Vec<u32>,
    pooled: HashMap<u64, u16>,
    /// Places of the uniforms in the pool, by number.
    uniforms: BTreeMap<u16, u16>,
}

fn vector(number: u8) -> Register {
    Register::ZMM0 + u32::from(number)
}

fn mask(number: u8) -> Register {
    Register::K0 + u32::from(number)
}

fn slot(number: u16) -> MemoryOperand {
    MemoryOperand::with_base_displ(FRAME, i64::from(number) * VECTOR as i64)
}

fn constant(number: u16, broadcast: bool) -> MemoryOperand {
    let at = i64::from(number) * 4;
    MemoryOperand::new(CONSTANTS, Register::None, 1, at, 1, broadcast, Register::None)
}

/// The instruction set has every form that is asked for here; the forms are fixed by the code above them.
const VALID: &str = "operands fit the instruction";

impl Assembler {
    pub(super) fn new(precision: Precision) -> Assembler {
        let (instructions, pool, pooled) = (Vec::new(), Vec::new(), HashMap::new());
        Assembler { precision, instructions, labels: 0, here: 0, pool, pooled, uniforms: BTreeMap::new() }
    }

    /// The form of an instruction for the precision.
    fn form(&self, of_f32: Code, of_f64: Code) -> Code {
        match self.precision {
            Precision::F32 => of_f32,
            Precision::F64 => of_f64,
        }
    }

    /// The pool's place of these bits of a number.
    pub(super) fn constant(&mut self, bits: u64) -> u16 {
        let next = self.pool.len() as u16;
        *self.pooled.entry(bits).or_insert_with(|| {
            self.pool.push(bits as u32);
            if self.precision == Precision::F64 {
                self.pool.push((bits >> 32) as u32);
            }
            next
        })
    }

    /// The pool's place of a uniform.
    pub(super) fn uniform(&mut self, number: u16) -> u16 {
        let next = self.pool.len() as u16;
        let words = if self.precision == Precision::F64 { 2 } else { 1 };
        *self.uniforms.entry(number).or_insert_with(|| {
            self.pool.resize(usize::from(next) + words, 0);
            next
        })
    }

    /// Puts a table of numbers behind each other into the pool and gives the place of the first.
    pub(super) fn table(&mut self, values: impl Iterator<Item = u32>) -> u16 {
        let first = self.pool.len() as u16;
        self.pool.extend(values);
        first
    }

    pub(super) fn label(&mut self) -> Label {
        self.labels += 1;
        Label(self.labels)
    }

    /// Puts a label before the next instruction.
    pub(super) fn place(&mut self, label: Label) {
        if self.here != 0 {
            self.push(Instruction::with(Code::Nopd)); // one label an instruction
        }
        self.here = label.0;
    }

    fn push(&mut self, mut instruction: Instruction) {
        instruction.set_ip(std::mem::take(&mut self.here));
        self.instructions.push(instruction);
    }

    fn two(&mut self, code: Code, dst: Register, source: Source) -> Instruction {
        match source {
            Source::Register(r) => Instruction::with2(code, dst, vector(r)),
            Source::Slot(s) => Instruction::with2(code, dst, slot(s)),
            Source::Constant(c) => Instruction::with2(code, dst, constant(c, true)),
        }
        .expect(VALID)
    }

    fn three(&mut self, code: Code, dst: u8, a: u8, b: Source) -> Instruction {
        let (dst, a) = (vector(dst), vector(a));
        match b {
            Source::Register(r) => Instruction::with3(code, dst, a, vector(r)),
            Source::Slot(s) => Instruction::with3(code, dst, a, slot(s)),
            Source::Constant(c) => Instruction::with3(code, dst, a, constant(c, true)),
        }
        .expect(VALID)
    }

    /// Copies, loads or broadcasts into a register.
    pub(super) fn load(&mut self, dst: u8, source: Source) {
        let instruction = match source {
            Source::Constant(c) => {
                let code = self.form(EVEX_Vbroadcastss_zmm_k1z_xmmm32, EVEX_Vbroadcastsd_zmm_k1z_xmmm64);
                Instruction::with2(code, vector(dst), constant(c, false)).expect(VALID)
            }
            _ => self.two(EVEX_Vmovaps_zmm_k1z_zmmm512, vector(dst), source),
        };
        self.push(instruction);
    }

    /// Copies into a register where a mask is set.
    pub(super) fn merge(&mut self, dst: u8, condition: u8, source: u8) {
        let code = self.form(EVEX_Vmovaps_zmm_k1z_zmmm512, EVEX_Vmovapd_zmm_k1z_zmmm512);
        let mut instruction = self.two(code, vector(dst), Source::Register(source));
        instruction.set_op_mask(mask(condition));
        self.push(instruction);
    }

    /// Stores a register.
    pub(super) fn store(&mut self, to: u16, source: u8) {
        let code = self.form(EVEX_Vmovaps_zmmm512_k1z_zmm, EVEX_Vmovapd_zmmm512_k1z_zmm);
        self.push(Instruction::with2(code, slot(to), vector(source)).expect(VALID));
    }

    pub(super) fn unary(&mut self, operation: Unary, dst: u8, a: Source) {
        let instruction = match operation {
            Unary::Sqrt => {
                let code = self.form(EVEX_Vsqrtps_zmm_k1z_zmmm512b32_er, EVEX_Vsqrtpd_zmm_k1z_zmmm512b64_er);
                self.two(code, vector(dst), a)
            }
            Unary::Floor => {
                let code = self
                    .form(EVEX_Vrndscaleps_zmm_k1z_zmmm512b32_imm8_sae, EVEX_Vrndscalepd_zmm_k1z_zmmm512b64_imm8_sae);
                const DOWN_WITHOUT_EXCEPTIONS: u32 = 9;
                match a {
                    Source::Register(r) => Instruction::with3(code, vector(dst), vector(r), DOWN_WITHOUT_EXCEPTIONS),
                    Source::Slot(s) => Instruction::with3(code, vector(dst), slot(s), DOWN_WITHOUT_EXCEPTIONS),
                    Source::Constant(c) => {
                        Instruction::with3(code, vector(dst), constant(c, true), DOWN_WITHOUT_EXCEPTIONS)
                    }
                }
                .expect(VALID)
            }
            Unary::Neg | Unary::Abs => unreachable!("sign changes are bitwise, with a constant"),
        };
        self.push(instruction);
    }

    /// Flips (`neg`) or clears (`abs`) the sign bit.
    pub(super) fn sign(&mut self, operation: Unary, dst: u8, a: u8) {
        let bits = match (self.precision, operation) {
            (Precision::F32, Unary::Abs) => u64::from(u32::MAX >> 1),
            (Precision::F32, _) => 1 << 31,
            (Precision::F64, Unary::Abs) => u64::MAX >> 1,
            (Precision::F64, _) => 1 << 63,
        };
        let code = match operation {
            Unary::Abs => self.form(EVEX_Vandps_zmm_k1z_zmm_zmmm512b32, EVEX_Vandpd_zmm_k1z_zmm_zmmm512b64),
            _ => self.form(EVEX_Vxorps_zmm_k1z_zmm_zmmm512b32, EVEX_Vxorpd_zmm_k1z_zmm_zmmm512b64),
        };
        let bits = Source::Constant(self.constant(bits));
        let instruction = self.three(code, dst, a, bits);
        self.push(instruction);
    }

    pub(super) fn binary(&mut self, operation: Binary, dst: u8, a: u8, b: Source) {
        let code = match operation {
            Binary::Add => self.form(EVEX_Vaddps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vaddpd_zmm_k1z_zmm_zmmm512b64_er),
            Binary::Sub => self.form(EVEX_Vsubps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vsubpd_zmm_k1z_zmm_zmmm512b64_er),
            Binary::Mul => self.form(EVEX_Vmulps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vmulpd_zmm_k1z_zmm_zmmm512b64_er),
            Binary::Div => self.form(EVEX_Vdivps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vdivpd_zmm_k1z_zmm_zmmm512b64_er),
            Binary::Min => self.form(EVEX_Vminps_zmm_k1z_zmm_zmmm512b32_sae, EVEX_Vminpd_zmm_k1z_zmm_zmmm512b64_sae),
            Binary::Max => self.form(EVEX_Vmaxps_zmm_k1z_zmm_zmmm512b32_sae, EVEX_Vmaxpd_zmm_k1z_zmm_zmmm512b64_sae),
        };
        let instruction = self.three(code, dst, a, b);
        self.push(instruction);
    }

    pub(super) fn mul_add(&mut self, form: Fused, signs: (bool, bool), dst: u8, second: u8, last: Source) {
        let code = match (form, signs) {
            (Fused::Dst132, (false, false)) => {
                [EVEX_Vfmadd132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd132pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst132, (false, true)) => {
                [EVEX_Vfmsub132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub132pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst132, (true, false)) => {
                [EVEX_Vfnmadd132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd132pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst132, (true, true)) => {
                [EVEX_Vfnmsub132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub132pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst213, (false, false)) => {
                [EVEX_Vfmadd213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd213pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst213, (false, true)) => {
                [EVEX_Vfmsub213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub213pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst213, (true, false)) => {
                [EVEX_Vfnmadd213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd213pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst213, (true, true)) => {
                [EVEX_Vfnmsub213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub213pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst231, (false, false)) => {
                [EVEX_Vfmadd231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd231pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst231, (false, true)) => {
                [EVEX_Vfmsub231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub231pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst231, (true, false)) => {
                [EVEX_Vfnmadd231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd231pd_zmm_k1z_zmm_zmmm512b64_er]
            }
            (Fused::Dst231, (true, true)) => {
                [EVEX_Vfnmsub231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub231pd_zmm_k1z_zmm_zmmm512b64_er]
            }
        };
        let code = self.form(code[0], code[1]);
        let instruction = self.three(code, dst, second, last);
        self.push(instruction);
    }

    pub(super) fn compare(&mut self, comparison: Comparison, dst: u8, a: u8, b: Source) {
        // False where an argument is not a number, but for the inverse ones.
        let predicate: u32 = match comparison {
            Comparison::Less => 17,
            Comparison::LessOrEqual => 18,
            Comparison::Equal => 0,
            Comparison::IsTrue => 30,
            Comparison::NotLess => 21,
            Comparison::NotLessOrEqual => 22,
            Comparison::NotEqual => 4,
            Comparison::NotTrue => 26,
        };
        let code = self.form(EVEX_Vcmpps_kr_k1_zmm_zmmm512b32_imm8_sae, EVEX_Vcmppd_kr_k1_zmm_zmmm512b64_imm8_sae);
        let (dst, a) = (mask(dst), vector(a));
        let instruction = match b {
            Source::Register(r) => Instruction::with4(code, dst, a, vector(r), predicate),
            Source::Slot(s) => Instruction::with4(code, dst, a, slot(s), predicate),
            Source::Constant(c) => Instruction::with4(code, dst, a, constant(c, true), predicate),
        };
        self.push(instruction.expect(VALID));
    }

    pub(super) fn select(&mut self, dst: u8, condition: u8, otherwise: u8, then: Source) {
        let code = self.form(EVEX_Vblendmps_zmm_k1z_zmm_zmmm512b32, EVEX_Vblendmpd_zmm_k1z_zmm_zmmm512b64);
        let mut instruction = self.three(code, dst, otherwise, then);
        instruction.set_op_mask(mask(condition));
        self.push(instruction);
    }

    /// 1 where the mask is set, else 0.
    pub(super) fn number_from_mask(&mut self, dst: u8, condition: u8) {
        let one = match self.precision {
            Precision::F32 => u64::from(1f32.to_bits()),
            Precision::F64 => 1f64.to_bits(),
        };
        let one = self.constant(one);
        let code = self.form(EVEX_Vbroadcastss_zmm_k1z_xmmm32, EVEX_Vbroadcastsd_zmm_k1z_xmmm64);
        let mut instruction = Instruction::with2(code, vector(dst), constant(one, false)).expect(VALID);
        instruction.set_op_mask(mask(condition));
        instruction.set_zeroing_masking(true);
        self.push(instruction);
    }

    pub(super) fn mask_and(&mut self, dst: u8, a: u8, b: u8) {
        self.masks(VEX_Kandw_kr_kr_kr, dst, a, b);
    }

    pub(super) fn mask_or(&mut self, dst: u8, a: u8, b: u8) {
        self.masks(VEX_Korw_kr_kr_kr, dst, a, b);
    }

    /// `b` where `a` is not set.
    pub(super) fn mask_and_not(&mut self, dst: u8, a: u8, b: u8) {
        self.masks(VEX_Kandnw_kr_kr_kr, dst, a, b);
    }

    fn masks(&mut self, code: Code, dst: u8, a: u8, b: u8) {
        self.push(Instruction::with3(code, mask(dst), mask(a), mask(b)).expect(VALID));
    }

    pub(super) fn mask_not(&mut self, dst: u8, a: u8) {
        self.push(Instruction::with2(self.form(VEX_Knotw_kr_kr, VEX_Knotb_kr_kr), mask(dst), mask(a)).expect(VALID));
    }

    pub(super) fn mask_copy(&mut self, dst: u8, a: u8) {
        self.push(Instruction::with2(VEX_Kmovw_kr_km16, mask(dst), mask(a)).expect(VALID));
    }

    pub(super) fn mask_load(&mut self, dst: u8, from: u16) {
        self.push(Instruction::with2(VEX_Kmovw_kr_km16, mask(dst), slot(from)).expect(VALID));
    }

    pub(super) fn mask_store(&mut self, to: u16, a: u8) {
        self.push(Instruction::with2(VEX_Kmovw_m16_kr, slot(to), mask(a)).expect(VALID));
    }

    /// Calls a function with the address of a slot.
    pub(super) fn call(&mut self, function: Function, argument: u16) {
        self.push(Instruction::with2(Code::Lea_r64_m, Register::RDI, slot(argument)).expect(VALID));
        self.push(Instruction::with2(Code::Mov_r64_imm64, Register::RAX, function as usize as u64).expect(VALID));
        self.push(Instruction::with1(Code::Call_rm64, Register::RAX).expect(VALID));
    }

    fn branch(&mut self, code: Code, to: Label) {
        self.push(Instruction::with_branch(code, to.0).expect(VALID));
    }

    pub(super) fn jump(&mut self, to: Label) {
        self.branch(Code::Jmp_rel32_64, to);
    }

    /// Jumps when no lane of these masks is set. May overwrite the first mask that values take.
    pub(super) fn jump_if_none(&mut self, masks: &[u8], to: Label) {
        // One instruction looks at two masks.
        const EITHER: u8 = 1;
        let (mut first, last) = (masks[0], masks[masks.len() - 1]);
        for &number in masks.iter().take(masks.len() - 1).skip(1) {
            self.mask_or(EITHER, first, number);
            first = EITHER;
        }
        self.push(Instruction::with2(VEX_Kortestw_kr_kr, mask(first), mask(last)).expect(VALID));
        self.branch(Code::Je_rel32_64, to);
    }

    /// Jumps when at least as many lanes of these masks are set as the caller asked for.
    pub(super) fn jump_if_enough(&mut self, masks: &[u8], to: Label) {
        let (count, sum, wanted) = (Register::EAX, Register::ECX, Register::R15D);
        self.push(Instruction::with2(Code::Xor_r32_rm32, sum, sum).expect(VALID));
        for &number in masks {
            self.push(Instruction::with2(VEX_Kmovw_r32_kr, count, mask(number)).expect(VALID));
            self.push(Instruction::with2(Code::Popcnt_r32_rm32, count, count).expect(VALID));
            self.push(Instruction::with2(Code::Add_r32_rm32, sum, count).expect(VALID));
        }
        self.push(Instruction::with2(Code::Cmp_r32_rm32, sum, wanted).expect(VALID));
        self.branch(Code::Jae_rel32_64, to);
    }

    pub(super) fn set_counter(&mut self, counter: Counter, value: u32) {
        let code = Code::Mov_r64_imm64;
        self.push(Instruction::with2(code, counter.register(), u64::from(value)).expect(VALID));
    }

    /// Counts down and jumps while something is left.
    pub(super) fn count_down(&mut self, counter: Counter, to: Label) {
        self.push(Instruction::with1(Code::Dec_rm64, counter.register()).expect(VALID));
        self.branch(Code::Jne_rel32_64, to);
    }

    /// Jumps to the label that the schedule's table names, and moves the schedule on: from `end` back to `again`.
    pub(super) fn dispatch(&mut self, table: u16, again: u32, end: u32, labels: &[Label]) {
        let (eax, at) = (Register::EAX, Counter::Schedule.register());
        let entry = MemoryOperand::new(CONSTANTS, at, 4, i64::from(table) * 4, 1, false, Register::None);
        self.push(Instruction::with2(Code::Mov_r32_rm32, eax, entry).expect(VALID));
        self.push(Instruction::with1(Code::Inc_rm64, at).expect(VALID));
        self.push(Instruction::with2(Code::Cmp_rm64_imm32, at, end as i32).expect(VALID));
        let on = self.label();
        self.branch(Code::Jne_rel32_64, on);
        self.set_counter(Counter::Schedule, again);
        self.place(on);
        for (number, label) in labels.iter().enumerate().skip(1) {
            self.push(Instruction::with2(Code::Cmp_rm32_imm32, eax, number as i32).expect(VALID));
            self.branch(Code::Je_rel32_64, *label);
        }
        self.jump(labels[0]);
    }

    /// Saves the caller's registers and takes over the arguments: frame, constants, lanes wanted.
    pub(super) fn enter(&mut self) {
        for register in SAVED {
            self.push(Instruction::with1(Code::Push_r64, register).expect(VALID));
        }
        for (to, from) in [(FRAME, Register::RDI), (CONSTANTS, Register::RSI), (Register::R15, Register::RDX)] {
            self.push(Instruction::with2(Code::Mov_r64_rm64, to, from).expect(VALID));
        }
    }

    pub(super) fn leave(&mut self) {
        self.push(Instruction::with(VEX_Vzeroupper));
        for register in SAVED.into_iter().rev() {
            self.push(Instruction::with1(Code::Pop_r64, register).expect(VALID));
        }
        self.push(Instruction::with(Code::Retnq));
    }

    /// The code in memory, executable; `None` where the system does not allow that.
    pub(super) fn finish(self) -> Option<MachineCode> {
        // Branches are relative, so the code may lie anywhere.
        let block = InstructionBlock::new(&self.instructions, 0x1000);
        let bytes = BlockEncoder::encode(64, block, BlockEncoderOptions::NONE).ok()?.code_buffer;
        let mut memory = MmapMut::map_anon(bytes.len()).ok()?;
        memory.copy_from_slice(&bytes);
        let memory = Arc::new(memory.make_exec().ok()?);
        Some(MachineCode { memory, constants: self.pool, uniforms: self.uniforms })
    }
}

/// Registers that belong to the caller; five of them leave the stack aligned for calls.
const SAVED: [Register; 5] = [Register::RBX, Register::R12, Register::R13, Register::R14, Register::R15];

/// A function of the maths kit over the vectors at an address: two arguments, then two results.
pub(super) type Function = unsafe extern "sysv64" fn(*mut u8);

/// Executable code, its constants, and the places of uniforms among them.
#[derive(Clone)]
pub(super) struct MachineCode {
    memory: Arc<Mmap>,
    constants: Vec<u32>,
    uniforms: BTreeMap<u16, u16>,
}

impl MachineCode {
    /// Gives the uniforms their values, by number.
    pub(super) fn bind(&mut self, values: &[f64], precision: Precision) {
        for (&number, &place) in &self.uniforms {
            let Some(&value) = values.get(usize::from(number)) else { continue };
            let place = usize::from(place);
            match precision {
                Precision::F32 => self.constants[place] = (value as f32).to_bits(),
                Precision::F64 => {
                    self.constants[place] = value.to_bits() as u32;
                    self.constants[place + 1] = (value.to_bits() >> 32) as u32;
                }
            }
        }
    }

    /// Runs the code on a frame; marches go on while at least `wanted` lanes run.
    ///
    /// # Safety
    ///
    /// The processor must have AVX-512 as `fearless_simd` defines it, and the frame must have as many vectors as the code
    /// was written for.
    pub(super) unsafe fn run<V>(&self, frame: &mut [V], wanted: u32) {
        const { assert!(size_of::<V>() == VECTOR && align_of::<V>() == VECTOR) };
        type Entry<V> = unsafe extern "sysv64" fn(*mut V, *const u32, u64);
        // SAFETY: the memory holds a function of this type, which `Assembler` wrote: it saves the caller's registers,
        // reads and writes the frame and reads the constants only.
        unsafe {
            let entry = std::mem::transmute::<*const u8, Entry<V>>(self.memory.as_ptr());
            entry(frame.as_mut_ptr(), self.constants.as_ptr(), u64::from(wanted));
        }
    }
}
