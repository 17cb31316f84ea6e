//! The instruction sets that machine code is written for, and the form of every vector instruction in each.

use iced_x86::Code::*;
use iced_x86::{Code, Register};

use super::trace::{Binary, Unary};
use crate::math::Precision;

/// An instruction set of the processor.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(in crate::kernel::cpu) enum InstructionSet {
    /// 256-bit vectors with fused multiply-adds; masks are vectors.
    Avx2,
    /// 512-bit vectors with masks in registers of their own.
    Avx512,
}

impl InstructionSet {
    /// As people write it.
    pub(in crate::kernel::cpu) fn name(self) -> &'static str {
        match self {
            InstructionSet::Avx2 => "AVX2",
            InstructionSet::Avx512 => "AVX-512",
        }
    }

    /// Bytes of a vector.
    pub(super) fn bytes(self) -> usize {
        match self {
            InstructionSet::Avx2 => 32,
            InstructionSet::Avx512 => 64,
        }
    }

    /// Numbers of a vector.
    pub(in crate::kernel::cpu) fn lanes(self, precision: Precision) -> usize {
        self.bytes() / precision.bytes()
    }

    /// Vector registers.
    pub(super) fn registers(self) -> u8 {
        match self {
            InstructionSet::Avx2 => 16,
            InstructionSet::Avx512 => 32,
        }
    }

    /// True where masks have registers of their own.
    pub(super) fn has_masks(self) -> bool {
        self == InstructionSet::Avx512
    }

    /// Words of four bytes that a number takes among the constants: instructions of AVX-512 spread one themselves.
    pub(super) fn pooled_words(self, precision: Precision) -> usize {
        match self {
            InstructionSet::Avx2 => self.bytes() / 4,
            InstructionSet::Avx512 => precision.bytes() / 4,
        }
    }

    /// A vector register.
    pub(super) fn vector(self, number: u8) -> Register {
        let first = match self {
            InstructionSet::Avx2 => Register::YMM0,
            InstructionSet::Avx512 => Register::ZMM0,
        };
        first + u32::from(number)
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

/// A vector instruction, whatever its set and precision.
#[derive(Clone, Copy)]
pub(super) enum Form {
    Load,
    /// A load in a number's own type, as masked moves need it.
    Move,
    Store,
    /// A load of what is aligned like its numbers only.
    LoadUnaligned,
    StoreUnaligned,
    /// One number into all lanes; only with AVX-512, whose constants are single.
    Broadcast,
    Sqrt,
    Floor,
    And,
    AndNot,
    Or,
    Xor,
    Binary(Binary),
    /// With the signs of the product and of the summand flipped, or not.
    MulAdd(Fused, (bool, bool)),
    Compare,
    Blend,
    /// Sign bits of all lanes; only without masks.
    Signs,
}

impl Form {
    /// The form of an operation on one number, where it is an instruction.
    pub(super) fn of_unary(operation: Unary) -> Form {
        match operation {
            Unary::Sqrt => Form::Sqrt,
            Unary::Floor => Form::Floor,
            Unary::Abs => Form::And,
            Unary::Neg => Form::Xor,
        }
    }

    /// The instruction.
    pub(super) fn code(self, set: InstructionSet, precision: Precision) -> Code {
        let [wide, narrow] = self.codes();
        let (single, double) = match set {
            InstructionSet::Avx512 => wide,
            InstructionSet::Avx2 => narrow,
        };
        match precision {
            Precision::F32 => single,
            Precision::F64 => double,
        }
    }

    /// For AVX-512 and AVX2, each for f32 and f64.
    fn codes(self) -> [(Code, Code); 2] {
        match self {
            Form::Load => [
                (EVEX_Vmovaps_zmm_k1z_zmmm512, EVEX_Vmovaps_zmm_k1z_zmmm512),
                (VEX_Vmovaps_ymm_ymmm256, VEX_Vmovaps_ymm_ymmm256),
            ],
            Form::Move => [
                (EVEX_Vmovaps_zmm_k1z_zmmm512, EVEX_Vmovapd_zmm_k1z_zmmm512),
                (VEX_Vmovaps_ymm_ymmm256, VEX_Vmovapd_ymm_ymmm256),
            ],
            Form::Store => [
                (EVEX_Vmovaps_zmmm512_k1z_zmm, EVEX_Vmovapd_zmmm512_k1z_zmm),
                (VEX_Vmovaps_ymmm256_ymm, VEX_Vmovapd_ymmm256_ymm),
            ],
            Form::LoadUnaligned => [
                (EVEX_Vmovups_zmm_k1z_zmmm512, EVEX_Vmovupd_zmm_k1z_zmmm512),
                (VEX_Vmovups_ymm_ymmm256, VEX_Vmovupd_ymm_ymmm256),
            ],
            Form::StoreUnaligned => [
                (EVEX_Vmovups_zmmm512_k1z_zmm, EVEX_Vmovupd_zmmm512_k1z_zmm),
                (VEX_Vmovups_ymmm256_ymm, VEX_Vmovupd_ymmm256_ymm),
            ],
            Form::Broadcast => [
                (EVEX_Vbroadcastss_zmm_k1z_xmmm32, EVEX_Vbroadcastsd_zmm_k1z_xmmm64),
                (VEX_Vbroadcastss_ymm_m32, VEX_Vbroadcastsd_ymm_m64),
            ],
            Form::Sqrt => [
                (EVEX_Vsqrtps_zmm_k1z_zmmm512b32_er, EVEX_Vsqrtpd_zmm_k1z_zmmm512b64_er),
                (VEX_Vsqrtps_ymm_ymmm256, VEX_Vsqrtpd_ymm_ymmm256),
            ],
            Form::Floor => [
                (EVEX_Vrndscaleps_zmm_k1z_zmmm512b32_imm8_sae, EVEX_Vrndscalepd_zmm_k1z_zmmm512b64_imm8_sae),
                (VEX_Vroundps_ymm_ymmm256_imm8, VEX_Vroundpd_ymm_ymmm256_imm8),
            ],
            Form::And => [
                (EVEX_Vandps_zmm_k1z_zmm_zmmm512b32, EVEX_Vandpd_zmm_k1z_zmm_zmmm512b64),
                (VEX_Vandps_ymm_ymm_ymmm256, VEX_Vandpd_ymm_ymm_ymmm256),
            ],
            Form::AndNot => [
                (EVEX_Vandnps_zmm_k1z_zmm_zmmm512b32, EVEX_Vandnpd_zmm_k1z_zmm_zmmm512b64),
                (VEX_Vandnps_ymm_ymm_ymmm256, VEX_Vandnpd_ymm_ymm_ymmm256),
            ],
            Form::Or => [
                (EVEX_Vorps_zmm_k1z_zmm_zmmm512b32, EVEX_Vorpd_zmm_k1z_zmm_zmmm512b64),
                (VEX_Vorps_ymm_ymm_ymmm256, VEX_Vorpd_ymm_ymm_ymmm256),
            ],
            Form::Xor => [
                (EVEX_Vxorps_zmm_k1z_zmm_zmmm512b32, EVEX_Vxorpd_zmm_k1z_zmm_zmmm512b64),
                (VEX_Vxorps_ymm_ymm_ymmm256, VEX_Vxorpd_ymm_ymm_ymmm256),
            ],
            Form::Binary(operation) => binary_codes(operation),
            Form::MulAdd(fused, signs) => mul_add_codes(fused, signs),
            Form::Compare => [
                (EVEX_Vcmpps_kr_k1_zmm_zmmm512b32_imm8_sae, EVEX_Vcmppd_kr_k1_zmm_zmmm512b64_imm8_sae),
                (VEX_Vcmpps_ymm_ymm_ymmm256_imm8, VEX_Vcmppd_ymm_ymm_ymmm256_imm8),
            ],
            Form::Blend => [
                (EVEX_Vblendmps_zmm_k1z_zmm_zmmm512b32, EVEX_Vblendmpd_zmm_k1z_zmm_zmmm512b64),
                (VEX_Vblendvps_ymm_ymm_ymmm256_ymm, VEX_Vblendvpd_ymm_ymm_ymmm256_ymm),
            ],
            Form::Signs => [(INVALID, INVALID), (VEX_Vmovmskps_r32_ymm, VEX_Vmovmskpd_r32_ymm)],
        }
    }
}

fn binary_codes(operation: Binary) -> [(Code, Code); 2] {
    match operation {
        Binary::Add => [
            (EVEX_Vaddps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vaddpd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vaddps_ymm_ymm_ymmm256, VEX_Vaddpd_ymm_ymm_ymmm256),
        ],
        Binary::Sub => [
            (EVEX_Vsubps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vsubpd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vsubps_ymm_ymm_ymmm256, VEX_Vsubpd_ymm_ymm_ymmm256),
        ],
        Binary::Mul => [
            (EVEX_Vmulps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vmulpd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vmulps_ymm_ymm_ymmm256, VEX_Vmulpd_ymm_ymm_ymmm256),
        ],
        Binary::Div => [
            (EVEX_Vdivps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vdivpd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vdivps_ymm_ymm_ymmm256, VEX_Vdivpd_ymm_ymm_ymmm256),
        ],
        Binary::Min => [
            (EVEX_Vminps_zmm_k1z_zmm_zmmm512b32_sae, EVEX_Vminpd_zmm_k1z_zmm_zmmm512b64_sae),
            (VEX_Vminps_ymm_ymm_ymmm256, VEX_Vminpd_ymm_ymm_ymmm256),
        ],
        Binary::Max => [
            (EVEX_Vmaxps_zmm_k1z_zmm_zmmm512b32_sae, EVEX_Vmaxpd_zmm_k1z_zmm_zmmm512b64_sae),
            (VEX_Vmaxps_ymm_ymm_ymmm256, VEX_Vmaxpd_ymm_ymm_ymmm256),
        ],
    }
}

fn mul_add_codes(fused: Fused, signs: (bool, bool)) -> [(Code, Code); 2] {
    match (fused, signs) {
        (Fused::Dst132, (false, false)) => [
            (EVEX_Vfmadd132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd132pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfmadd132ps_ymm_ymm_ymmm256, VEX_Vfmadd132pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst132, (false, true)) => [
            (EVEX_Vfmsub132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub132pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfmsub132ps_ymm_ymm_ymmm256, VEX_Vfmsub132pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst132, (true, false)) => [
            (EVEX_Vfnmadd132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd132pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfnmadd132ps_ymm_ymm_ymmm256, VEX_Vfnmadd132pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst132, (true, true)) => [
            (EVEX_Vfnmsub132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub132pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfnmsub132ps_ymm_ymm_ymmm256, VEX_Vfnmsub132pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst213, (false, false)) => [
            (EVEX_Vfmadd213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd213pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfmadd213ps_ymm_ymm_ymmm256, VEX_Vfmadd213pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst213, (false, true)) => [
            (EVEX_Vfmsub213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub213pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfmsub213ps_ymm_ymm_ymmm256, VEX_Vfmsub213pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst213, (true, false)) => [
            (EVEX_Vfnmadd213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd213pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfnmadd213ps_ymm_ymm_ymmm256, VEX_Vfnmadd213pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst213, (true, true)) => [
            (EVEX_Vfnmsub213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub213pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfnmsub213ps_ymm_ymm_ymmm256, VEX_Vfnmsub213pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst231, (false, false)) => [
            (EVEX_Vfmadd231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd231pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfmadd231ps_ymm_ymm_ymmm256, VEX_Vfmadd231pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst231, (false, true)) => [
            (EVEX_Vfmsub231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub231pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfmsub231ps_ymm_ymm_ymmm256, VEX_Vfmsub231pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst231, (true, false)) => [
            (EVEX_Vfnmadd231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd231pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfnmadd231ps_ymm_ymm_ymmm256, VEX_Vfnmadd231pd_ymm_ymm_ymmm256),
        ],
        (Fused::Dst231, (true, true)) => [
            (EVEX_Vfnmsub231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub231pd_zmm_k1z_zmm_zmmm512b64_er),
            (VEX_Vfnmsub231ps_ymm_ymm_ymmm256, VEX_Vfnmsub231pd_ymm_ymm_ymmm256),
        ],
    }
}
