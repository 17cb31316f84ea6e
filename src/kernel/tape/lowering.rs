//! From functions to tapes: what is needed of each node, which operations are fused, and which registers values get.

use std::sync::Arc;

use rustc_hash::{FxHashMap, FxHashSet};

use super::{Code, Instruction, Products, Tape};
use crate::expr::ops::{Operands, Operator};
use crate::expr::{Arena, Function, NodeId, Op, Port, Table};
use crate::kernel::constants::Constants;

/// Lowers functions that share a register file: each with the register of its first input, which none may overwrite.
/// Their constants are shared and lie from `free_from`, behind all inputs; temporaries follow.
pub fn lower_group(arena: &Arena, functions: &[(&Function, u16)], free_from: u16) -> (Vec<Tape>, Constants) {
    let mut constants = Constants::default();
    for (function, _) in functions {
        constants.collect(arena, function, free_from);
    }
    let first_temporary = free_from + constants.len() as u16;
    let tapes = functions
        .iter()
        .map(|(function, inputs_at)| Lowering::new(arena, function, *inputs_at, &constants, first_temporary).finish())
        .collect();
    (tapes, constants)
}

struct Lowering<'a> {
    arena: &'a Arena,
    function: &'a Function,
    nodes: Vec<NodeId>,
    needed: FxHashMap<NodeId, u8>,
    uses: FxHashMap<NodeId, u32>,
    /// Sines and cosines that are needed, by their angles.
    waves: FxHashMap<(Operator, NodeId), NodeId>,
    /// Products and quotients that are computed by what reads them.
    absorbed: FxHashSet<NodeId>,
    /// Virtual register of each component; pinned ones first.
    registers: FxHashMap<NodeId, [u32; 4]>,
    constants: &'a Constants,
    inputs_at: u16,
    pinned: u32,
    next_virtual: u32,
    instructions: Vec<(Code, Operands32)>,
    /// Tables that are looked up, with their numbers in the arena.
    tables: Vec<(u16, Arc<Table>)>,
}

/// Operands before registers are allocated.
#[derive(Clone, Copy, Default)]
struct Operands32 {
    width: u8,
    dst: [u32; 4],
    dst2: [u32; 4],
    args: [[u32; 4]; 4],
    /// Arguments in use.
    arity: u8,
    dst_count: u8,
    dst2_count: u8,
}

impl<'a> Lowering<'a> {
    fn new(
        arena: &'a Arena,
        function: &'a Function,
        inputs_at: u16,
        constants: &'a Constants,
        first_temporary: u16,
    ) -> Self {
        let nodes = function.nodes(arena);
        let mut lowering = Lowering {
            arena,
            function,
            nodes,
            needed: FxHashMap::default(),
            uses: FxHashMap::default(),
            waves: FxHashMap::default(),
            absorbed: FxHashSet::default(),
            registers: FxHashMap::default(),
            constants,
            inputs_at,
            pinned: u32::from(first_temporary),
            next_virtual: u32::from(first_temporary),
            instructions: Vec::new(),
            tables: Vec::new(),
        };
        lowering.find_needed();
        lowering.find_absorbed();
        lowering
    }

    /// Marks the components that the outputs depend on, and counts uses of each node.
    fn find_needed(&mut self) {
        for (port, id) in &self.function.outputs {
            *self.needed.entry(*id).or_default() |= mask(port.ty.width);
            *self.uses.entry(*id).or_default() += 2; // an output is never fused away
        }
        for &id in self.nodes.iter().rev() {
            let bits = self.needed.get(&id).copied().unwrap_or(0);
            if bits == 0 {
                continue;
            }
            let node = self.arena.node(id);
            for (i, arg) in node.args().iter().enumerate() {
                let from_arg = match node.op {
                    Op::Compose => u8::from(bits >> i & 1 == 1),
                    Op::Splat => 1,
                    Op::Extract(k) => 1 << k,
                    Op::Dot => mask(self.arena.node(*arg).ty.width),
                    _ => bits,
                };
                *self.needed.entry(*arg).or_default() |= from_arg;
                *self.uses.entry(*arg).or_default() += 1;
            }
            if let Op::Apply(operator @ (Operator::Sin | Operator::Cos)) = node.op {
                self.waves.insert((operator, node.args()[0]), id);
            }
        }
    }

    fn fresh(&mut self) -> u32 {
        self.next_virtual += 1;
        self.next_virtual - 1
    }

    fn lower_node(&mut self, id: NodeId) {
        let bits = self.needed.get(&id).copied().unwrap_or(0);
        if bits == 0 || self.registers.contains_key(&id) {
            return;
        }
        let node = self.arena.node(id);
        let args = node.args();
        let known: Vec<[u32; 4]> = args.iter().map(|a| self.registers.get(a).copied().unwrap_or([0; 4])).collect();
        let of = |k: usize| known[k];
        let registers = match node.op {
            Op::Const(values) => {
                let mut registers = [0; 4];
                for i in 0..node.ty.width as usize {
                    registers[i] = u32::from(self.constants.register(values[i]));
                }
                registers
            }
            Op::Uniform(number) => [u32::from(self.constants.uniform(number)); 4],
            Op::Input(number) => {
                let before = Port::scalars(&self.function.inputs[..number as usize]) as u32;
                std::array::from_fn(|i| u32::from(self.inputs_at) + before + i as u32)
            }
            Op::Compose => std::array::from_fn(|i| match args.get(i) {
                Some(arg) if bits >> i & 1 == 1 => self.registers[arg][0],
                _ => 0,
            }),
            Op::Splat => [of(0)[0]; 4],
            Op::Extract(k) => [of(0)[k as usize]; 4],
            Op::Dot => {
                let d = self.fresh();
                let width = self.arena.node(args[0]).ty.width;
                self.emit(Code::Dot, width, [d, 0, 0, 0], 1, &[of(0), of(1)]);
                [d; 4]
            }
            Op::Lookup(number) => {
                let (d, table) = (self.fresh(), self.table(number));
                self.emit(Code::Lookup(table), 1, [d, 0, 0, 0], 1, &[of(0)]);
                [d; 4]
            }
            Op::Apply(operator) => self.lower_apply(id, operator, bits),
        };
        self.registers.insert(id, registers);
    }

    /// The tape's number of one of the arena's tables.
    fn table(&mut self, number: u16) -> u16 {
        let known = self.tables.iter().position(|(known, _)| *known == number);
        let place = known.unwrap_or_else(|| {
            self.tables.push((number, self.arena.table(number).clone()));
            self.tables.len() - 1
        });
        place as u16
    }

    fn lower_apply(&mut self, id: NodeId, operator: Operator, bits: u8) -> [u32; 4] {
        let node = self.arena.node(id);
        if matches!(operator, Operator::Sin | Operator::Cos)
            && node.ty.width == 1
            && let Some(registers) = self.fuse_sin_cos(operator, node.args()[0])
        {
            return registers;
        }
        let (code, arguments) = self.fuse_products(operator, node.args());
        let mut registers = [0; 4];
        let mut dst = [0; 4];
        let mut args = [[0; 4]; 4];
        let mut width = 0;
        for i in (0..4).filter(|i| bits >> i & 1 == 1) {
            if let Some(same) = self.unchanged(operator, node.args(), i) {
                registers[i] = same;
                continue;
            }
            registers[i] = self.fresh();
            dst[width] = registers[i];
            for (k, argument) in arguments.iter().enumerate() {
                args[k][width] = self.registers[argument][i];
            }
            width += 1;
        }
        if width > 0 {
            self.emit(code, width as u8, dst, width as u8, &args[..arguments.len()]);
        }
        registers
    }

    /// `a * b + c`, `a * b - c` and `c - a * b`, where nothing else reads the product, are one instruction, and so is a constant
    /// times `1 / a`: finds such products and quotients.
    fn find_absorbed(&mut self) {
        let mut absorbed = FxHashSet::default();
        for id in self.nodes.iter().filter(|id| self.needed.contains_key(id)) {
            let node = self.arena.node(*id);
            match node.op {
                Op::Apply(Operator::Mul) => {
                    absorbed.extend(self.inverse_factor(node.args()).map(|(_, inverse)| inverse))
                }
                Op::Apply(Operator::Add | Operator::Sub) => {
                    absorbed.extend(node.args().iter().filter(|term| self.is_fusible(**term)));
                }
                _ => {}
            }
        }
        self.absorbed = absorbed;
    }

    /// Whether a term of a sum is a product that nothing else reads.
    fn is_fusible(&self, term: NodeId) -> bool {
        let node = self.arena.node(term);
        let is_once = node.op == Op::Apply(Operator::Mul) && self.uses.get(&term) == Some(&1);
        is_once && self.inverse_factor(node.args()).is_none()
    }

    /// A constant number and the quotient of 1 that it is multiplied by, where nothing else reads that.
    fn inverse_factor(&self, factors: &[NodeId]) -> Option<(NodeId, NodeId)> {
        let is_constant = |id: NodeId| matches!(self.arena.node(id).op, Op::Const(_));
        let is_inverse = |id: NodeId| {
            let node = self.arena.node(id);
            let is_quotient =
                node.op == Op::Apply(Operator::Div) && node.ty.width == 1 && self.uses.get(&id) == Some(&1);
            is_quotient && self.arena.node(node.args()[0]).constant().is_some_and(|c| c[0] == 1.0)
        };
        let orders = [(factors[0], factors[1]), (factors[1], factors[0])];
        orders.into_iter().find(|&(factor, quotient)| is_constant(factor) && is_inverse(quotient))
    }

    /// The register of a component of a sum whose other term is 0 there.
    fn unchanged(&self, operator: Operator, args: &[NodeId], i: usize) -> Option<u32> {
        let is_zero = |id: &NodeId| self.arena.node(*id).constant().is_some_and(|c| c[i] == 0.0);
        let kept = match operator {
            Operator::Add if is_zero(&args[0]) => args[1],
            Operator::Add | Operator::Sub if is_zero(&args[1]) => args[0],
            _ => return None,
        };
        (!self.absorbed.contains(&kept)).then(|| self.registers[&kept][i])
    }

    /// The instruction and arguments that compute a node, with absorbed products taken in.
    fn fuse_products(&self, operator: Operator, args: &[NodeId]) -> (Code, Vec<NodeId>) {
        if operator == Operator::Mul
            && let Some((factor, quotient)) = self.inverse_factor(args)
        {
            return (Code::Apply(Operator::Div), vec![factor, self.arena.node(quotient).args()[1]]);
        }
        if !matches!(operator, Operator::Add | Operator::Sub) {
            return (Code::Apply(operator), args.to_vec());
        }
        let factors = |i: usize| self.absorbed.contains(&args[i]).then(|| self.arena.node(args[i]).args().to_vec());
        let is_add = operator == Operator::Add;
        let join = |mut a: Vec<NodeId>, b: &[NodeId]| {
            a.extend_from_slice(b);
            a
        };
        match (factors(0), factors(1)) {
            (Some(a), Some(b)) => {
                (Code::Products(if is_add { Products::Sum } else { Products::Difference }), join(a, &b))
            }
            (Some(a), None) => {
                (Code::Products(if is_add { Products::MulAdd } else { Products::MulSub }), join(a, &args[1..]))
            }
            (None, Some(b)) => {
                (Code::Products(if is_add { Products::MulAdd } else { Products::SubMul }), join(b, &args[..1]))
            }
            (None, None) => (Code::Apply(operator), args.to_vec()),
        }
    }

    /// Sine and cosine of one angle are one instruction where both are needed.
    fn fuse_sin_cos(&mut self, operator: Operator, angle: NodeId) -> Option<[u32; 4]> {
        let other = if operator == Operator::Sin { Operator::Cos } else { Operator::Sin };
        let twin = *self.waves.get(&(other, angle))?;
        let (sin, cos) = (self.fresh(), self.fresh());
        let angle = self.registers[&angle];
        self.emit(Code::SinCos, 1, [sin, cos, 0, 0], 2, &[angle]);
        let (own, twins) = if operator == Operator::Sin { (sin, cos) } else { (cos, sin) };
        self.registers.insert(twin, [twins; 4]);
        Some([own; 4])
    }

    fn emit(&mut self, code: Code, width: u8, dst: [u32; 4], dst_count: u8, arguments: &[[u32; 4]]) {
        let mut args = [[0; 4]; 4];
        args[..arguments.len()].copy_from_slice(arguments);
        let operands =
            Operands32 { width, dst, args, arity: arguments.len() as u8, dst_count, ..Operands32::default() };
        self.instructions.push((code, operands));
    }

    fn finish(mut self) -> Tape {
        for id in self.nodes.clone() {
            if !self.absorbed.contains(&id) {
                self.lower_node(id);
            }
        }
        let outputs = self.lower_outputs();
        self.pair_complex_products();
        self.allocate(outputs)
    }

    /// Joins `a b - c d` with a later `c b + a d`: real and imaginary part of one product, whose operands are then read
    /// once. Powers and squares, and their derivatives, are made of these.
    fn pair_complex_products(&mut self) {
        // Sums by the registers that they read, since all of them are those of the difference.
        let mut sums: FxHashMap<[u32; 4], Vec<usize>> = FxHashMap::default();
        for (i, (code, operands)) in self.instructions.iter().enumerate() {
            if *code == Code::Products(Products::Sum) {
                sums.entry(operands.first_factors()).or_default().push(i);
            }
        }
        let mut taken = FxHashSet::default();
        for i in 0..self.instructions.len() {
            let (code, real) = self.instructions[i];
            if code != Code::Products(Products::Difference) {
                continue;
            }
            let twin = sums.get(&real.first_factors()).into_iter().flatten().copied().find(|j| {
                let sum = &self.instructions[*j].1;
                *j > i && !taken.contains(j) && sum.width == real.width && real.is_twin(sum)
            });
            if let Some(j) = twin {
                taken.insert(j);
                let (_, imaginary) = self.instructions[j];
                let joined = Operands32 { dst2: imaginary.dst, dst2_count: imaginary.dst_count, ..real };
                self.instructions[i] = (Code::ComplexProduct, real.ordered_for(&imaginary, joined));
            }
        }
        let mut position = 0;
        self.instructions.retain(|_| {
            position += 1;
            !taken.contains(&(position - 1))
        });
    }

    /// Virtual registers of the outputs; an output that is another input's register, or a constant, is copied, so that
    /// outputs may be written back over the inputs in any order.
    fn lower_outputs(&mut self) -> Vec<u32> {
        let mut outputs = Vec::new();
        for (port, id) in &self.function.outputs {
            for i in 0..port.ty.width as usize {
                let position = u32::from(self.inputs_at) + outputs.len() as u32;
                let register = self.registers[id][i];
                if register < self.pinned && register != position {
                    let d = self.fresh();
                    self.emit(Code::Copy, 1, [d, 0, 0, 0], 1, &[[register, 0, 0, 0]]);
                    outputs.push(d);
                } else {
                    outputs.push(register);
                }
            }
        }
        outputs
    }

    /// Maps virtual to physical registers: pinned ones stay, temporaries are reused after their last use.
    fn allocate(self, outputs: Vec<u32>) -> Tape {
        let mut last_use: FxHashMap<u32, usize> = FxHashMap::default();
        for (position, (_, operands)) in self.instructions.iter().enumerate() {
            for register in operands.sources().chain(operands.targets()) {
                last_use.insert(register, position);
            }
        }
        last_use.extend(outputs.iter().map(|&register| (register, usize::MAX)));
        let mut physical: FxHashMap<u32, u16> = FxHashMap::default();
        let mut free: Vec<u16> = Vec::new();
        let mut count = self.pinned as u16;
        let pinned = self.pinned;
        let place = |map: &FxHashMap<u32, u16>, register: u32| {
            if register < pinned { register as u16 } else { map[&register] }
        };
        let mut instructions = Vec::with_capacity(self.instructions.len());
        for (position, (code, operands)) in self.instructions.iter().enumerate() {
            for register in operands.targets() {
                let slot = free.pop().unwrap_or_else(|| {
                    count += 1;
                    count - 1
                });
                physical.insert(register, slot);
            }
            let mut result = Operands { width: operands.width, ..Operands::default() };
            for k in 0..operands.dst_count as usize {
                result.dst[k] = place(&physical, operands.dst[k]);
            }
            for k in 0..operands.dst2_count as usize {
                result.dst2[k] = place(&physical, operands.dst2[k]);
            }
            for k in 0..operands.arity as usize {
                for i in 0..operands.width as usize {
                    result.args[k][i] = place(&physical, operands.args[k][i]);
                }
            }
            let mut dead: Vec<u32> = operands.sources().chain(operands.targets()).collect();
            dead.sort_unstable();
            dead.dedup();
            for register in dead {
                if register >= pinned && last_use[&register] == position {
                    free.push(physical[&register]);
                }
            }
            instructions.push(Instruction { code: *code, operands: result });
        }
        let input_count = Port::scalars(&self.function.inputs) as u16;
        let mut read: FxHashSet<u32> = outputs.iter().copied().collect();
        read.extend(self.instructions.iter().flat_map(|(_, operands)| operands.sources()));
        Tape {
            name: self.function.name.clone(),
            instructions,
            inputs: (self.inputs_at..self.inputs_at + input_count).collect(),
            read: (0..input_count).filter(|i| read.contains(&u32::from(self.inputs_at + i))).collect(),
            outputs: outputs.iter().map(|&register| place(&physical, register)).collect(),
            register_count: count as usize,
            tables: self.tables.into_iter().map(|(_, table)| table).collect(),
        }
    }
}

impl Operands32 {
    /// The two products of a fused form, each as the pair of its factors.
    fn products(&self) -> [[[u32; 4]; 2]; 2] {
        [[self.args[0], self.args[1]], [self.args[2], self.args[3]]]
    }

    /// The order `[a, b, c, d]` of this difference's factors in which `sum` is `c b + a d`.
    fn twin_order(&self, sum: &Operands32) -> Option<[[u32; 4]; 4]> {
        let same = |p: [[u32; 4]; 2], q: [[u32; 4]; 2]| p == q || p == [q[1], q[0]];
        let [first, second] = self.products();
        let sums = sum.products();
        for (a, b) in [(first[0], first[1]), (first[1], first[0])] {
            for (c, d) in [(second[0], second[1]), (second[1], second[0])] {
                let (cb, ad) = ([c, b], [a, d]);
                if (same(sums[0], cb) && same(sums[1], ad)) || (same(sums[0], ad) && same(sums[1], cb)) {
                    return Some([a, b, c, d]);
                }
            }
        }
        None
    }

    /// The registers of the first components of its factors, in ascending order.
    fn first_factors(&self) -> [u32; 4] {
        let mut registers = self.args.map(|arg| arg[0]);
        registers.sort_unstable();
        registers
    }

    fn is_twin(&self, sum: &Operands32) -> bool {
        self.twin_order(sum).is_some()
    }

    fn ordered_for(&self, sum: &Operands32, joined: Operands32) -> Operands32 {
        Operands32 { args: self.twin_order(sum).unwrap_or(self.args), ..joined }
    }

    fn sources(&self) -> impl Iterator<Item = u32> + '_ {
        self.args[..self.arity as usize].iter().flat_map(|a| a[..self.width as usize].iter().copied())
    }

    fn targets(&self) -> impl Iterator<Item = u32> + '_ {
        self.dst[..self.dst_count as usize].iter().chain(&self.dst2[..self.dst2_count as usize]).copied()
    }
}

fn mask(width: u8) -> u8 {
    (1 << width) - 1
}
