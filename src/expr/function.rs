//! A function: named inputs and outputs over the nodes of an arena. What kernels are made of.

use super::differentiate::reachable;
use super::{Arena, Expr, NodeId, Op, Type};

/// A named, typed value that goes into or comes out of a function.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Port {
    /// Name in generated code.
    pub name: String,
    /// Type.
    pub ty: Type,
}

impl Port {
    /// A port.
    pub fn new(name: impl Into<String>, ty: Type) -> Port {
        Port { name: name.into(), ty }
    }

    /// Scalars that all the ports hold together.
    pub fn scalars(ports: &[Port]) -> usize {
        ports.iter().map(|p| p.ty.width as usize).sum()
    }
}

/// The inputs of a function that is being composed, taken one after the other.
pub struct Inputs<'g> {
    arena: &'g Arena,
    ports: Vec<Port>,
}

impl<'g> Inputs<'g> {
    /// None yet.
    pub fn new(arena: &'g Arena) -> Inputs<'g> {
        Inputs { arena, ports: Vec::new() }
    }

    /// The next input.
    pub fn take(&mut self, name: impl Into<String>, ty: Type) -> Expr<'g> {
        self.ports.push(Port::new(name, ty));
        self.arena.input((self.ports.len() - 1) as u16, ty)
    }

    /// A function of these inputs, whose outputs are all still to be added.
    pub fn function(self, name: impl Into<String>) -> Function {
        Function::new(name, self.ports)
    }
}

/// A straight-line function. Input `i` is the arena's node `Input(i)` of the port's type.
#[derive(Clone, Debug)]
pub struct Function {
    /// Name in generated code.
    pub name: String,
    /// What goes in.
    pub inputs: Vec<Port>,
    /// What comes out, and the node that computes it.
    pub outputs: Vec<(Port, NodeId)>,
}

impl Function {
    /// A function whose outputs are all still to be added.
    pub fn new(name: impl Into<String>, inputs: Vec<Port>) -> Function {
        Function { name: name.into(), inputs, outputs: Vec::new() }
    }

    /// The input expressions, in order.
    pub fn input_exprs<'g>(&self, arena: &'g Arena) -> Vec<Expr<'g>> {
        self.inputs.iter().enumerate().map(|(i, port)| arena.input(i as u16, port.ty)).collect()
    }

    /// Adds an output.
    pub fn output(&mut self, name: impl Into<String>, value: Expr<'_>) {
        self.outputs.push((Port::new(name, value.ty()), value.id));
    }

    /// The ports of the outputs.
    pub fn output_ports(&self) -> Vec<Port> {
        self.outputs.iter().map(|(port, _)| port.clone()).collect()
    }

    /// Nodes that the outputs need, in evaluation order.
    pub fn nodes(&self, arena: &Arena) -> Vec<NodeId> {
        let roots: Vec<NodeId> = self.outputs.iter().map(|(_, id)| *id).collect();
        reachable(arena, &roots)
    }

    /// True when an output depends on input `number`.
    pub fn reads(&self, arena: &Arena, number: usize) -> bool {
        self.nodes(arena).iter().any(|&id| arena.node(id).op == Op::Input(number as u16))
    }
}
