//! The CPU's form of a function: instructions over numbered registers, one register a scalar.
//!
//! Vectors are lists of registers, so composing, splatting and taking components cost nothing; components that nothing
//! reads are not computed. Registers are reused as soon as their value is dead, which keeps the working set small: a
//! register holds a whole pack of rays.

mod lowering;

use std::fmt::Write as _;
use std::sync::Arc;

pub use self::lowering::lower_group;
use rustc_hash::FxHashMap;

use super::constants::Constants;
use crate::expr::Table;
use crate::expr::ops::{Operands, Operator};

/// What an instruction does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Code {
    /// A componentwise operator.
    Apply(Operator),
    /// `dst[0]` is the sum of the products of the first two arguments.
    Dot,
    /// `dst[0]` and `dst[1]` are sine and cosine of the first argument's first component.
    SinCos,
    /// `dst` is the first argument.
    Copy,
    /// `dst[0]` is the number of the tape's table of this number at the first argument.
    Lookup(u16),
    /// The complex product of `a + i c` and `b + i d`: `dst` is `a b - c d`, `dst2` is `c b + a d`.
    ComplexProduct,
    /// A sum or difference that computes its products itself.
    Products(Products),
}

/// Fused forms of products and sums of the arguments a, b, c and d, by component.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Products {
    /// `a b + c`
    MulAdd,
    /// `a b - c`
    MulSub,
    /// `c - a b`
    SubMul,
    /// `a b + c d`
    Sum,
    /// `a b - c d`
    Difference,
}

impl Products {
    /// The name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Products::MulAdd => "mul_add",
            Products::MulSub => "mul_sub",
            Products::SubMul => "sub_mul",
            Products::Sum => "sum_of_products",
            Products::Difference => "difference_of_products",
        }
    }

    /// Number of arguments.
    pub fn arity(self) -> usize {
        if matches!(self, Products::Sum | Products::Difference) { 4 } else { 3 }
    }
}

/// One instruction.
#[derive(Clone, Copy, Debug)]
pub struct Instruction {
    /// What to do.
    pub code: Code,
    /// With which registers.
    pub operands: Operands,
}

/// A function as instructions.
#[derive(Clone, Debug)]
pub struct Tape {
    /// The function's name.
    pub name: String,
    /// In order.
    pub instructions: Vec<Instruction>,
    /// The register of each scalar of the inputs.
    pub inputs: Vec<u16>,
    /// Which scalars of the inputs anything reads, in order: the others need not be loaded.
    pub read: Vec<u16>,
    /// The register of each scalar of the outputs.
    pub outputs: Vec<u16>,
    /// Registers that the tape needs in all.
    pub register_count: usize,
    /// What it looks up.
    pub tables: Vec<Arc<Table>>,
}
impl Tape {
    /// A listing, one instruction a line.
    pub fn listing(&self, constants: &Constants) -> String {
        let mut text =
            format!("{} ({} instructions, {} registers)\n", self.name, self.instructions.len(), self.register_count);
        let values: FxHashMap<u16, f64> = constants.iter().collect();
        let uniforms: FxHashMap<u16, u16> = constants.uniforms().map(|(number, register)| (register, number)).collect();
        let name = |register: u16| match values.get(&register) {
            _ if uniforms.contains_key(&register) => format!("uniform{}", uniforms[&register]),
            Some(value) => format!("{value}"),
            None if self.inputs.contains(&register) => format!("in{}", register - self.inputs[0]),
            None => format!("r{register}"),
        };
        let list = |registers: &[u16]| registers.iter().map(|&r| name(r)).collect::<Vec<_>>().join(" ");
        for instruction in &self.instructions {
            let o = &instruction.operands;
            let width = o.width as usize;
            let (label, targets, arity) = match instruction.code {
                Code::Apply(operator) => (operator.info().name, width, operator.info().arity),
                Code::Dot => ("dot", 1, 2),
                Code::SinCos => ("sin_cos", 2, 1),
                Code::Copy => ("copy", 1, 1),
                Code::Lookup(_) => ("look_up", 1, 1),
                Code::ComplexProduct => ("complex_product", width, 4),
                Code::Products(products) => (products.name(), width, products.arity()),
            };
            let arguments: Vec<String> = o.args[..arity].iter().map(|a| list(&a[..width])).collect();
            let second = match instruction.code {
                Code::ComplexProduct => format!(", {}", list(&o.dst2[..targets])),
                _ => String::new(),
            };
            let _ = writeln!(text, "  {}{second} = {label} {}", list(&o.dst[..targets]), arguments.join(", "));
        }
        let _ = writeln!(text, "  return {}", list(&self.outputs));
        text
    }
}
