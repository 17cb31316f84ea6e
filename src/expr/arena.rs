//! The arena of nodes, and [`Expr`], the handle that formulas are written with.

use std::fmt;
use std::ops::{Add, Div, Mul, Neg, Sub};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rustc_hash::FxHashMap;

use super::ops::Operator;
use super::simplify;
use super::table::Table;
use crate::diag::Span;

/// A scalar, 3-vector or 4-vector of numbers or booleans.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Type {
    /// True for booleans.
    pub is_bool: bool,
    /// Components: 1, 3 or 4.
    pub width: u8,
}

impl Type {
    /// A number.
    pub const F: Type = Type { is_bool: false, width: 1 };
    /// Three numbers.
    pub const V3: Type = Type { is_bool: false, width: 3 };
    /// Four numbers.
    pub const V4: Type = Type { is_bool: false, width: 4 };
    /// A truth value.
    pub const B: Type = Type { is_bool: true, width: 1 };

    /// The same kind with another number of components.
    pub fn with_width(self, width: u8) -> Type {
        Type { width, ..self }
    }

    /// The name in WGSL.
    pub fn wgsl(self) -> &'static str {
        match (self.is_bool, self.width) {
            (false, 1) => "f32",
            (false, 3) => "vec3<f32>",
            (false, _) => "vec4<f32>",
            (true, 1) => "bool",
            (true, 3) => "vec3<bool>",
            (true, _) => "vec4<bool>",
        }
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match (self.is_bool, self.width) {
            (false, 1) => "number",
            (false, 3) => "vec3",
            (false, _) => "vec4",
            (true, 1) => "boolean",
            (true, 3) => "boolean vec3",
            (true, _) => "boolean vec4",
        })
    }
}

impl fmt::Debug for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A node of an [`Arena`]. Ids grow from arguments to results, so ascending order is an evaluation order.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct NodeId(pub(super) u32);

impl NodeId {
    /// Position in the arena.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// What a node does with its arguments.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Op {
    /// The constant whose components have these f64 bits.
    Const([u64; 4]),
    /// The function's input of this number.
    Input(u16),
    /// The kernel's number of this place in its list of uniforms: the same for all elements of a run, and known only then.
    Uniform(u16),
    /// A vector from its components.
    Compose,
    /// A vector of equal components.
    Splat,
    /// One component of a vector.
    Extract(u8),
    /// The sum of the componentwise products.
    Dot,
    /// The number of the arena's table of this number at an index.
    Lookup(u16),
    /// A componentwise operator of the table.
    Apply(Operator),
}

/// A node: operation, arguments, type, and the place in a user's file that made it first.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// What it does.
    pub op: Op,
    args: [NodeId; 4],
    arity: u8,
    /// Type of the result.
    pub ty: Type,
    /// Where it was made.
    pub span: Span,
}

impl Node {
    /// The arguments.
    pub fn args(&self) -> &[NodeId] {
        &self.args[..self.arity as usize]
    }

    /// The components of a constant.
    pub fn constant(&self) -> Option<[f64; 4]> {
        match self.op {
            Op::Const(bits) => Some(bits.map(f64::from_bits)),
            _ => None,
        }
    }
}

type Key = (Op, [NodeId; 4], u8, Type);

/// A hash-consed store of nodes: building an equal node twice gives the same id. Threads may share one: nodes are read without
/// a lock and made under one.
#[derive(Default)]
pub struct Arena {
    /// Grows only, and only under the lock.
    nodes: boxcar::Vec<Node>,
    /// The tables that nodes look up; grows as nodes do.
    tables: boxcar::Vec<Arc<Table>>,
    made: Mutex<Made>,
    /// Keeps every operation that is asked for, and only folds constants.
    as_written: bool,
}

/// What making a node needs.
#[derive(Default)]
struct Made {
    known: FxHashMap<Key, NodeId>,
    /// Place that new nodes carry.
    span: Option<Span>,
}

impl Arena {
    /// An arena that keeps every operation that is asked for, also the same one again, and only folds constants: what
    /// simplification and sharing are compared with. No kernel is made of it.
    pub fn as_written() -> Arena {
        Arena { as_written: true, ..Arena::default() }
    }

    /// False if the arena simplifies.
    pub(super) fn is_as_written(&self) -> bool {
        self.as_written
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.count()
    }

    /// True before the first node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A copy of a node.
    pub fn node(&self, id: NodeId) -> Node {
        self.nodes[id.index()]
    }

    /// The handle of a node.
    pub fn expr(&self, id: NodeId) -> Expr<'_> {
        Expr { arena: self, id }
    }

    /// Nodes made from now on carry this place.
    pub fn set_span(&self, span: Span) {
        self.made().span = Some(span);
    }

    /// The number `x`.
    pub fn f(&self, x: f64) -> Expr<'_> {
        self.constant(Type::F, [x, 0.0, 0.0, 0.0])
    }

    /// The constant 3-vector.
    pub fn v3(&self, v: [f64; 3]) -> Expr<'_> {
        self.constant(Type::V3, [v[0], v[1], v[2], 0.0])
    }

    /// A constant; components beyond the type's width are ignored.
    pub fn constant(&self, ty: Type, mut components: [f64; 4]) -> Expr<'_> {
        components[ty.width as usize..].fill(0.0);
        self.intern(Op::Const(components.map(f64::to_bits)), &[], ty)
    }

    /// The truth value.
    pub fn bool(&self, value: bool) -> Expr<'_> {
        self.constant(Type::B, [f64::from(u8::from(value)), 0.0, 0.0, 0.0])
    }

    /// A table by its number.
    pub fn table(&self, number: u16) -> &Arc<Table> {
        &self.tables[usize::from(number)]
    }

    /// The number of a table, which is kept where it is new.
    pub(super) fn table_number(&self, table: &Arc<Table>) -> u16 {
        let _made = self.made();
        let is_it = |known: &Arc<Table>| Arc::ptr_eq(known, table) || known == table;
        let known = self.tables.iter().find(|(_, known)| is_it(known)).map(|(number, _)| number);
        u16::try_from(known.unwrap_or_else(|| self.tables.push(table.clone()))).expect("pictures have few tables")
    }

    /// The number of a table at an index.
    pub(super) fn lookup_in(&self, number: u16, index: Expr<'_>) -> Expr<'_> {
        self.intern(Op::Lookup(number), &[index.id], Type::F)
    }

    /// The function input of this number and type.
    pub fn input(&self, number: u16, ty: Type) -> Expr<'_> {
        self.intern(Op::Input(number), &[], ty)
    }

    /// The kernel's uniform of this number.
    pub fn uniform(&self, number: u16) -> Expr<'_> {
        self.intern(Op::Uniform(number), &[], Type::F)
    }

    /// A node like another one, with other arguments of the same types, as it is: nothing is simplified.
    pub(crate) fn with_args(&self, node: &Node, args: &[NodeId]) -> NodeId {
        self.intern(node.op, args, node.ty).id
    }

    /// A vector from three or four numbers (or booleans).
    pub fn compose<'g>(&'g self, parts: &[Expr<'g>]) -> Expr<'g> {
        assert!(parts.len() == 3 || parts.len() == 4, "vectors have three or four components");
        let ty = parts[0].ty().with_width(parts.len() as u8);
        simplify::compose(self, parts, ty)
    }

    /// Stores a node as it is, once.
    pub(super) fn intern(&self, op: Op, args: &[NodeId], ty: Type) -> Expr<'_> {
        let mut padded = [NodeId(u32::MAX); 4];
        padded[..args.len()].copy_from_slice(args);
        let arity = args.len() as u8;
        let made = &mut *self.made();
        let span = made.span.unwrap_or(Span::NONE);
        let new = || {
            let place = self.nodes.push(Node { op, args: padded, arity, ty, span });
            NodeId(u32::try_from(place).expect("node limits are far below 2^32"))
        };
        let id = match self.as_written && !args.is_empty() {
            true => new(),
            false => *made.known.entry((op, padded, arity, ty)).or_insert_with(new),
        };
        Expr { arena: self, id }
    }

    /// A thread that panicked left a whole store behind.
    fn made(&self) -> MutexGuard<'_, Made> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A node of an arena with overloaded operators. Scalars combine with vectors as if written into every component.
///
/// Building is total for well-typed operands; combining vectors of different width is a bug of the caller and panics.
#[derive(Clone, Copy)]
pub struct Expr<'g> {
    /// The arena that holds the node.
    pub arena: &'g Arena,
    /// The node.
    pub id: NodeId,
}

impl fmt::Debug for Expr<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {}", self.id, self.ty())
    }
}

impl<'g> Expr<'g> {
    /// Its type.
    pub fn ty(self) -> Type {
        self.arena.node(self.id).ty
    }

    /// Its node.
    pub fn node(self) -> Node {
        self.arena.node(self.id)
    }

    /// Its components when it is constant.
    pub fn as_constant(self) -> Option<[f64; 4]> {
        self.node().constant()
    }

    /// The constant `x` in as many components as `self` has.
    pub fn lift(self, x: f64) -> Expr<'g> {
        self.arena.f(x).widen(self.ty().width)
    }

    /// A scalar written into `width` components; a vector of that width as it is.
    pub fn widen(self, width: u8) -> Expr<'g> {
        let ty = self.ty();
        if ty.width == width {
            return self;
        }
        assert_eq!(ty.width, 1, "only a scalar can be widened");
        simplify::splat(self, ty.with_width(width))
    }

    /// Applies an operator of the table, widening scalars to the widest argument.
    pub fn apply(operator: Operator, args: &[Expr<'g>]) -> Expr<'g> {
        let width = args.iter().map(|a| a.ty().width).max().unwrap_or(1);
        let args: Vec<Expr<'g>> = args.iter().map(|a| a.widen(width)).collect();
        let ty = Type { is_bool: operator.info().bool_result, width };
        simplify::apply(operator, &args, ty)
    }

    /// Component `i` (0 is x).
    pub fn component(self, i: u8) -> Expr<'g> {
        simplify::extract(self, i)
    }

    /// All components.
    pub fn components(self) -> Vec<Expr<'g>> {
        (0..self.ty().width).map(|i| self.component(i)).collect()
    }

    /// The first three components.
    pub fn xyz(self) -> Expr<'g> {
        if self.ty().width == 3 {
            return self;
        }
        self.arena.compose(&[self.component(0), self.component(1), self.component(2)])
    }

    /// The scalar product.
    pub fn dot(self, other: Expr<'g>) -> Expr<'g> {
        simplify::dot(self, other)
    }

    /// The Euclidean length.
    pub fn length(self) -> Expr<'g> {
        self.dot(self).sqrt()
    }

    /// The vector of length 1 in this direction; 0 for 0.
    pub fn normalize(self) -> Expr<'g> {
        self / self.length().max(self.arena.f(1e-30))
    }

    /// The vector product of two 3-vectors.
    pub fn cross(self, o: Expr<'g>) -> Expr<'g> {
        let (a, b) = (self.components(), o.components());
        let minor = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
        self.arena.compose(&[minor(1, 2), minor(2, 0), minor(0, 1)])
    }

    /// `self` to a whole power by products; negative powers divide.
    pub fn powi(self, n: i32) -> Expr<'g> {
        if n < 0 {
            return self.lift(1.0) / self.powi(-n);
        }
        let (mut result, mut square, mut n) = (self.lift(1.0), self, n);
        while n > 0 {
            if n & 1 == 1 {
                result = result * square;
            }
            n >>= 1;
            if n > 0 {
                square = square * square;
            }
        }
        result
    }

    /// `self + (other - self) * t`.
    pub fn mix(self, other: Expr<'g>, t: Expr<'g>) -> Expr<'g> {
        self + (other - self) * t
    }

    /// `a` where `self` (a boolean) is true, else `b`.
    pub fn select(self, a: Expr<'g>, b: Expr<'g>) -> Expr<'g> {
        Expr::apply(Operator::Select, &[self, a, b])
    }
}

macro_rules! methods {
    ($($method:ident ( $($arg:ident),* ) $operator:ident $doc:literal;)*) => {
        impl<'g> Expr<'g> { $(
            #[doc = $doc]
            pub fn $method(self $(, $arg: Expr<'g>)*) -> Expr<'g> {
                Expr::apply(Operator::$operator, &[self $(, $arg)*])
            }
        )* }
    };
}

methods! {
    abs() Abs "The absolute value.";
    sqrt() Sqrt "The square root.";
    floor() Floor "Rounds down.";
    sign() Sign "-1, 0 or 1.";
    sin() Sin "The sine.";
    cos() Cos "The cosine.";
    asin() Asin "The inverse sine.";
    acos() Acos "The inverse cosine.";
    exp() Exp "The exponential.";
    ln() Ln "The natural logarithm.";
    min(b) Min "The smaller one.";
    max(b) Max "The larger one.";
    pow(b) Pow "A real power.";
    atan2(x) Atan2 "The angle of the point (x, self).";
    modulo(b) Mod "The remainder with the sign of `b`.";
    lt(b) Lt "True where `self` is smaller.";
    le(b) Le "True where `self` is not larger.";
    equals(b) Eq "True where both are equal.";
    and(b) And "True where both are.";
    or(b) Or "True where either is.";
    clamp(lo, hi) Clamp "Moved into the range.";
}

macro_rules! overload {
    ($($trait:ident $method:ident $operator:ident;)*) => { $(
        impl<'g> $trait for Expr<'g> {
            type Output = Expr<'g>;
            fn $method(self, other: Expr<'g>) -> Expr<'g> {
                Expr::apply(Operator::$operator, &[self, other])
            }
        }
        impl<'g> $trait<f64> for Expr<'g> {
            type Output = Expr<'g>;
            fn $method(self, other: f64) -> Expr<'g> {
                Expr::apply(Operator::$operator, &[self, self.arena.f(other)])
            }
        }
        impl<'g> $trait<Expr<'g>> for f64 {
            type Output = Expr<'g>;
            fn $method(self, other: Expr<'g>) -> Expr<'g> {
                Expr::apply(Operator::$operator, &[other.arena.f(self), other])
            }
        }
    )* };
}

overload! {
    Add add Add;
    Sub sub Sub;
    Mul mul Mul;
    Div div Div;
}

impl<'g> std::ops::Not for Expr<'g> {
    type Output = Expr<'g>;
    fn not(self) -> Expr<'g> {
        Expr::apply(Operator::Not, &[self])
    }
}

impl<'g> Neg for Expr<'g> {
    type Output = Expr<'g>;
    fn neg(self) -> Expr<'g> {
        Expr::apply(Operator::Neg, &[self])
    }
}
