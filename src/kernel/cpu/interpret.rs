//! The interpreter: a tape on a register file, and columns in and out of registers.

use std::sync::Arc;

use fearless_simd::Simd;

use crate::expr::Table;
use crate::expr::ops::{Operands, Register, execute};
use crate::kernel::tape::{Code, Instruction, Products, Tape};
use crate::math::{Lanes, Pack, Real};

/// A number type that tapes can be interpreted over: knows how to enable its instruction set for a call, and looks tables up.
pub trait Machine: Real {
    /// Calls `f` in a function compiled for the token's instruction set.
    fn enter<T>(token: Self::Token, f: impl FnOnce() -> T) -> T;
    /// The numbers of a table at these indices.
    fn look_up(token: Self::Token, table: &Arc<Table>, index: Self) -> Self;
}

impl Machine for f64 {
    #[inline(always)]
    fn enter<T>((): (), f: impl FnOnce() -> T) -> T {
        f()
    }

    #[inline(always)]
    fn look_up((): (), table: &Arc<Table>, index: f64) -> f64 {
        f64::from(table.at(index))
    }
}

impl<S: Simd> Machine for Lanes<S> {
    #[inline(always)]
    fn enter<T>(token: S, f: impl FnOnce() -> T) -> T {
        token.vectorize(f)
    }

    #[inline(always)]
    fn look_up(token: S, table: &Arc<Table>, index: Self) -> Self {
        looked_up(token, table, index)
    }
}

/// The numbers of a table at the indices in a vector's lanes.
#[inline(always)]
pub(super) fn looked_up<S: Simd>(token: S, table: &Table, index: Lanes<S>) -> Lanes<S> {
    let mut lanes = [0.0; 64];
    index.store(&mut lanes);
    lanes[..Lanes::<S>::LANES].iter_mut().for_each(|lane| *lane = table.at(f64::from(*lane)));
    Lanes::load(token, &lanes)
}

/// Runs a tape on a register file. One instance a number type, entered by a plain call.
#[inline(never)]
pub(super) fn interpret<R: Machine, const K: usize>(token: R::Token, tape: &Tape, registers: &mut [Register<R, K>]) {
    R::enter(
        token,
        #[inline(always)]
        || {
            for instruction in &tape.instructions {
                run_instruction::<R, K>(token, (tape, instruction), registers);
            }
        },
    );
}

#[inline(always)]
pub(super) fn run_instruction<R: Machine, const K: usize>(
    token: R::Token,
    (tape, instruction): (&Tape, &Instruction),
    registers: &mut [Register<R, K>],
) {
    let o = &instruction.operands;
    match instruction.code {
        Code::Apply(operator) => execute::<R, K>(operator, token, registers, o),
        Code::Dot => {
            let (a, b) = (registers[o.args[0][0] as usize], registers[o.args[1][0] as usize]);
            let mut sum = a;
            for k in 0..K {
                sum[k] = a[k] * b[k];
            }
            for i in 1..o.width as usize {
                let (a, b) = (registers[o.args[0][i] as usize], registers[o.args[1][i] as usize]);
                for k in 0..K {
                    sum[k] = a[k].mul_add(b[k], sum[k]);
                }
            }
            registers[o.dst[0] as usize] = sum;
        }
        Code::SinCos => {
            let angle = registers[o.args[0][0] as usize];
            let (mut sin, mut cos) = (angle, angle);
            for k in 0..K {
                (sin[k], cos[k]) = angle[k].sin_cos();
            }
            registers[o.dst[0] as usize] = sin;
            registers[o.dst[1] as usize] = cos;
        }
        Code::ComplexProduct => complex_product::<R, K>(registers, o),
        Code::Products(Products::MulAdd) => products::<R, K, 3>(
            registers,
            o,
            #[inline(always)]
            |[a, b, c, _]| a.mul_add(b, c),
        ),
        Code::Products(Products::MulSub) => products::<R, K, 3>(
            registers,
            o,
            #[inline(always)]
            |[a, b, c, _]| a.mul_add(b, -c),
        ),
        Code::Products(Products::SubMul) => products::<R, K, 3>(
            registers,
            o,
            #[inline(always)]
            |[a, b, c, _]| (-a).mul_add(b, c),
        ),
        Code::Products(Products::Sum) => products::<R, K, 4>(
            registers,
            o,
            #[inline(always)]
            |[a, b, c, d]| a.mul_add(b, c * d),
        ),
        Code::Products(Products::Difference) => products::<R, K, 4>(
            registers,
            o,
            #[inline(always)]
            |[a, b, c, d]| a.mul_add(b, -(c * d)),
        ),
        Code::Copy => registers[o.dst[0] as usize] = registers[o.args[0][0] as usize],
        Code::Lookup(number) => {
            let table = &tape.tables[usize::from(number)];
            let index = registers[o.args[0][0] as usize];
            registers[o.dst[0] as usize] = index.map(|index| R::look_up(token, table, index));
        }
    }
}

/// Multiplies complex numbers; the factor that components share stays in the machine's registers.
#[inline(always)]
fn complex_product<R: Machine, const K: usize>(registers: &mut [Register<R, K>], o: &Operands) {
    let (mut b, mut d) = (registers[o.args[1][0] as usize], registers[o.args[3][0] as usize]);
    for i in 0..o.width as usize {
        if i > 0 && (o.args[1][i] != o.args[1][i - 1] || o.args[3][i] != o.args[3][i - 1]) {
            (b, d) = (registers[o.args[1][i] as usize], registers[o.args[3][i] as usize]);
        }
        let (a, c) = (registers[o.args[0][i] as usize], registers[o.args[2][i] as usize]);
        let (mut real, mut imaginary) = (a, a);
        for k in 0..K {
            real[k] = a[k].mul_add(b[k], -(c[k] * d[k]));
            imaginary[k] = c[k].mul_add(b[k], a[k] * d[k]);
        }
        registers[o.dst[i] as usize] = real;
        registers[o.dst2[i] as usize] = imaginary;
    }
}

/// Applies a fused form to all components and lanes.
#[inline(always)]
fn products<R: Machine, const K: usize, const ARITY: usize>(
    registers: &mut [Register<R, K>],
    o: &Operands,
    form: impl Fn([R; 4]) -> R,
) {
    for i in 0..o.width as usize {
        let (a, b) = (registers[o.args[0][i] as usize], registers[o.args[1][i] as usize]);
        let c = registers[o.args[2][i] as usize];
        let d = if ARITY > 3 { registers[o.args[3][i] as usize] } else { c };
        let mut result = a;
        for k in 0..K {
            result[k] = form([a[k], b[k], c[k], d[k]]);
        }
        registers[o.dst[i] as usize] = result;
    }
}

/// Reads a pack of a column, repeating the last element beyond its end.
#[inline(always)]
pub(super) fn load_pack<R: Pack, const K: usize>(token: R::Token, column: &[R::Scalar], at: usize) -> Register<R, K> {
    let mut register = [R::splat(token, 0.0); K];
    for (k, value) in register.iter_mut().enumerate() {
        let from = at + k * R::LANES;
        if from + R::LANES <= column.len() {
            *value = R::load(token, &column[from..]);
        } else {
            let mut lanes = [column[column.len() - 1]; 64];
            if from < column.len() {
                lanes[..column.len() - from].copy_from_slice(&column[from..]);
            }
            *value = R::load(token, &lanes);
        }
    }
    register
}

/// Writes a pack into a column, leaving out what lies beyond its end.
#[inline(always)]
pub(super) fn store_pack<R: Pack, const K: usize>(register: &Register<R, K>, column: &mut [R::Scalar], at: usize) {
    for (k, value) in register.iter().enumerate() {
        let from = at + k * R::LANES;
        if from + R::LANES <= column.len() {
            value.store(&mut column[from..]);
        } else if from < column.len() {
            let mut lanes = [column[0]; 64];
            value.store(&mut lanes);
            let count = column.len() - from;
            column[from..].copy_from_slice(&lanes[..count]);
        }
    }
}
