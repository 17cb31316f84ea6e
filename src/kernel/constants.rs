//! Numbers that tapes read and do not compute: constants, which are known when a kernel is compiled, and uniforms, which are
//! known when it is run.

use std::collections::BTreeMap;

use crate::expr::{Arena, Function, Op};

/// Constants and uniforms of the tapes that run on one register file, each with its register.
#[derive(Clone, Debug, Default)]
pub struct Constants {
    /// By the bits of the value.
    registers: BTreeMap<u64, u16>,
    /// By the uniform's number: register and value, 0 until [`Constants::bind`].
    uniforms: BTreeMap<u16, (u16, f64)>,
}

impl Constants {
    /// Values and their registers, uniforms included.
    pub fn iter(&self) -> impl Iterator<Item = (u16, f64)> + '_ {
        let constants = self.registers.iter().map(|(bits, register)| (*register, f64::from_bits(*bits)));
        constants.chain(self.uniforms.values().copied())
    }

    /// Numbers and registers of the uniforms that are read.
    pub fn uniforms(&self) -> impl Iterator<Item = (u16, u16)> + '_ {
        self.uniforms.iter().map(|(number, (register, _))| (*number, *register))
    }

    /// Gives the uniforms their values, by number. Numbers beyond the list keep what they have.
    pub fn bind(&mut self, values: &[f64]) {
        for (number, (_, value)) in &mut self.uniforms {
            *value = values.get(usize::from(*number)).copied().unwrap_or(*value);
        }
    }

    /// Registers in use.
    pub(super) fn len(&self) -> usize {
        self.registers.len() + self.uniforms.len()
    }

    /// Takes registers, from `free_from` on, for all that a function reads.
    pub(super) fn collect(&mut self, arena: &Arena, function: &Function, free_from: u16) {
        for id in function.nodes(arena) {
            let node = arena.node(id);
            if let Op::Uniform(number) = node.op {
                let next = free_from + self.len() as u16;
                self.uniforms.entry(number).or_insert((next, 0.0));
            }
            for value in node.constant().iter().flat_map(|values| &values[..node.ty.width as usize]) {
                let next = free_from + self.len() as u16;
                self.registers.entry(value.to_bits()).or_insert(next);
            }
        }
    }

    /// Register of a constant that was collected, by its bits.
    pub(super) fn register(&self, bits: u64) -> u16 {
        self.registers[&bits]
    }

    /// Register of a uniform that was collected.
    pub(super) fn uniform(&self, number: u16) -> u16 {
        self.uniforms[&number].0
    }
}
