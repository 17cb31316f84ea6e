//! Recording: the interpreter run on values that are names, so that tapes become lists of machine-level operations.
//!
//! Nothing here knows an operator of the formula language: a tape is interpreted over [`Traced`], and what its operators
//! do with numbers is what gets recorded. So compiled code does what the interpreter does, operation by operation.

use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};
use std::sync::Arc;

use rustc_hash::FxHashMap;

use crate::expr::Table;
use crate::kernel::cpu::interpret::Machine;
use crate::math::Precision;
use crate::math::Real;
use crate::math::scalar::FUSED;

/// Number of a recorded value: its operation's place in the list.
pub(super) type Value = u32;

/// Where a value is when a segment starts.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum Place {
    /// A vector in the frame, by number.
    Slot(u16),
    /// A machine register, by number.
    Register(u8),
    /// The mask of active lanes of a copy, by number.
    Active(u8),
    /// A vector of a column that the kernel runs over: that of a copy in the current block.
    Column(u16, u8),
}

/// One machine-level operation on all lanes.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum Operation {
    /// The bits of a number, in all lanes.
    Constant(u64),
    /// The uniform of this number, in all lanes.
    Uniform(u16),
    Read(Place),
    Unary(Unary, Value),
    Binary(Binary, Value, Value),
    /// `±(a b) ± c`, rounded once.
    MulAdd {
        a: Value,
        b: Value,
        c: Value,
        minus_product: bool,
        minus_c: bool,
    },
    Compare(Comparison, Value, Value),
    /// The second value where the mask is set, else the third.
    Select(Value, Value, Value),
    /// 1 where the mask is set, else 0.
    FromMask(Value),
    MaskAnd(Value, Value),
    /// Lanes of the first that are none of the second.
    MaskAndNot(Value, Value),
    MaskOr(Value, Value),
    MaskNot(Value),
    /// The first result of a function of the maths kit; the arguments beyond its own are repeated.
    Call(Kit, Value, Value),
    /// The second result of a call.
    Second(Value),
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum Unary {
    Neg,
    Abs,
    Sqrt,
    Floor,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    Min,
    Max,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum Comparison {
    Less,
    LessOrEqual,
    Equal,
    /// Of a boolean held as a number: true above one half.
    IsTrue,
    NotLess,
    NotLessOrEqual,
    NotEqual,
    NotTrue,
}

impl Comparison {
    /// True where this one is false, which is also where an argument is not a number.
    fn inverse(self) -> Comparison {
        use Comparison::*;
        match self {
            Less => NotLess,
            LessOrEqual => NotLessOrEqual,
            Equal => NotEqual,
            IsTrue => NotTrue,
            NotLess => Less,
            NotLessOrEqual => LessOrEqual,
            NotEqual => Equal,
            NotTrue => IsTrue,
        }
    }
}

/// Functions that are called rather than written out.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum Kit {
    SinCos,
    Atan2,
    Acos,
    Asin,
    Exp,
    Ln,
    Pow,
    /// The number of the table at this address at an index.
    Lookup(u64),
}

impl Operation {
    /// The values that it reads.
    pub(super) fn sources(self) -> impl Iterator<Item = Value> {
        use Operation::*;
        let list = match self {
            Constant(_) | Uniform(_) | Read(_) => [None; 3],
            Unary(_, a) | FromMask(a) | MaskNot(a) | Second(a) => [Some(a), None, None],
            Binary(_, a, b) | Compare(_, a, b) | Call(_, a, b) => [Some(a), Some(b), None],
            MaskAnd(a, b) | MaskAndNot(a, b) | MaskOr(a, b) => [Some(a), Some(b), None],
            MulAdd { a, b, c, .. } | Select(a, b, c) => [Some(a), Some(b), Some(c)],
        };
        list.into_iter().flatten()
    }

    /// The same operation on other values.
    pub(super) fn with_sources(self, to: impl Fn(Value) -> Value) -> Operation {
        use Operation::*;
        match self {
            Constant(_) | Uniform(_) | Read(_) => self,
            Unary(unary, a) => Unary(unary, to(a)),
            FromMask(a) => FromMask(to(a)),
            MaskNot(a) => MaskNot(to(a)),
            Second(a) => Second(to(a)),
            Binary(binary, a, b) => Binary(binary, to(a), to(b)),
            Compare(comparison, a, b) => Compare(comparison, to(a), to(b)),
            MaskAnd(a, b) => MaskAnd(to(a), to(b)),
            MaskAndNot(a, b) => MaskAndNot(to(a), to(b)),
            MaskOr(a, b) => MaskOr(to(a), to(b)),
            Call(kit, a, b) => Call(kit, to(a), to(b)),
            Select(a, b, c) => Select(to(a), to(b), to(c)),
            MulAdd { a, b, c, minus_product, minus_c } => {
                MulAdd { a: to(a), b: to(b), c: to(c), minus_product, minus_c }
            }
        }
    }

    /// True when the result is a mask.
    pub(super) fn is_mask(self) -> bool {
        use Operation::*;
        matches!(self, Compare(..) | MaskAnd(..) | MaskAndNot(..) | MaskOr(..) | MaskNot(_) | Read(Place::Active(_)))
    }
}

/// What has been recorded; equal operations on equal values are one.
pub(super) struct Recorder {
    precision: Precision,
    operations: RefCell<Vec<Operation>>,
    known: RefCell<FxHashMap<Operation, Value>>,
}

impl Recorder {
    pub(super) fn new(precision: Precision) -> Recorder {
        Recorder { precision, operations: RefCell::default(), known: RefCell::default() }
    }

    /// The value of an operation.
    pub(super) fn value(&self, operation: Operation) -> Value {
        *self.known.borrow_mut().entry(operation).or_insert_with(|| {
            let mut operations = self.operations.borrow_mut();
            operations.push(operation);
            operations.len() as Value - 1
        })
    }

    /// A number that is somewhere when the segment starts.
    pub(super) fn read(&self, place: Place) -> Traced<'_> {
        self.number(Operation::Read(place))
    }

    /// A uniform of the kernel.
    pub(super) fn uniform(&self, number: u16) -> Traced<'_> {
        self.number(Operation::Uniform(number))
    }

    /// The lanes that are active when the segment starts, as a mask.
    pub(super) fn active(&self) -> TracedMask<'_> {
        TracedMask { value: self.value(Operation::Read(Place::Active(0))), recorder: self }
    }

    fn number(&self, operation: Operation) -> Traced<'_> {
        Traced { value: self.value(operation), recorder: self }
    }

    /// The opposite of a mask.
    fn inverse(&self, mask: Value) -> Operation {
        match self.operation(mask) {
            Operation::Compare(comparison, a, b) => Operation::Compare(comparison.inverse(), a, b),
            _ => Operation::MaskNot(mask),
        }
    }

    /// The lanes of two masks.
    fn both(&self, a: Value, b: Value) -> Operation {
        match (self.operation(a), self.operation(b)) {
            (_, Operation::MaskNot(b)) => Operation::MaskAndNot(a, b),
            (Operation::MaskNot(a), _) => Operation::MaskAndNot(b, a),
            _ => Operation::MaskAnd(a, b),
        }
    }

    fn operation(&self, value: Value) -> Operation {
        self.operations.borrow()[value as usize]
    }

    /// The operations in order.
    pub(super) fn finish(self) -> Vec<Operation> {
        self.operations.into_inner()
    }
}

/// A number whose arithmetic is recorded.
#[derive(Clone, Copy)]
pub(super) struct Traced<'a> {
    pub(super) value: Value,
    recorder: &'a Recorder,
}

/// The result of a comparison of [`Traced`] numbers.
#[derive(Clone, Copy)]
pub(super) struct TracedMask<'a> {
    pub(super) value: Value,
    recorder: &'a Recorder,
}

impl<'a> Traced<'a> {
    fn unary(self, operation: Unary) -> Self {
        self.recorder.number(Operation::Unary(operation, self.value))
    }

    fn binary(self, operation: Binary, other: Self) -> Self {
        if let Some(mask) = self.logic(operation, other) {
            return self.recorder.number(Operation::FromMask(mask));
        }
        self.recorder.number(Operation::Binary(operation, self.value, other.value))
    }

    /// Booleans are numbers on tapes (0 or 1); their products, maxima and complements are operations on masks.
    fn logic(self, operation: Binary, other: Self) -> Option<Value> {
        let mask = |x: Self| match self.recorder.operation(x.value) {
            Operation::FromMask(mask) => Some(mask),
            _ => None,
        };
        let logic = match (operation, mask(self), mask(other)) {
            (Binary::Mul, Some(a), Some(b)) => self.recorder.both(a, b),
            (Binary::Max, Some(a), Some(b)) => Operation::MaskOr(a, b),
            (Binary::Sub, None, Some(b)) if self.is(1.0) => self.recorder.inverse(b),
            _ => return None,
        };
        Some(self.recorder.value(logic))
    }

    fn compare(self, comparison: Comparison, other: Self) -> TracedMask<'a> {
        let value = self.recorder.value(Operation::Compare(comparison, self.value, other.value));
        TracedMask { value, recorder: self.recorder }
    }

    fn call(self, kit: Kit, other: Self) -> Self {
        self.recorder.number(Operation::Call(kit, self.value, other.value))
    }

    fn is(self, x: f64) -> bool {
        self.value == Self::splat(self.recorder, x).value
    }

    /// The value without its sign change, and whether it had one.
    fn without_sign(self) -> (Value, bool) {
        match self.recorder.operation(self.value) {
            Operation::Unary(Unary::Neg, of) => (of, true),
            _ => (self.value, false),
        }
    }
}

impl Add for Traced<'_> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        match (self.without_sign(), other.without_sign()) {
            (_, (subtrahend, true)) => self.binary(Binary::Sub, Traced { value: subtrahend, ..other }),
            ((subtrahend, true), _) => other.binary(Binary::Sub, Traced { value: subtrahend, ..self }),
            _ => self.binary(Binary::Add, other),
        }
    }
}

impl Sub for Traced<'_> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.binary(Binary::Sub, other)
    }
}

impl Mul for Traced<'_> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        // The same bits, and the units that multiply are the busy ones.
        match (self.is(2.0), other.is(2.0)) {
            (_, true) => self + self,
            (true, _) => other + other,
            _ => self.binary(Binary::Mul, other),
        }
    }
}

impl Div for Traced<'_> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        self.binary(Binary::Div, other)
    }
}

impl Neg for Traced<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        self.unary(Unary::Neg)
    }
}

impl<'a> Real for Traced<'a> {
    type Token = &'a Recorder;
    type Mask = TracedMask<'a>;

    fn splat(recorder: &'a Recorder, x: f64) -> Self {
        recorder.number(Operation::Constant(match recorder.precision {
            Precision::F32 => u64::from((x as f32).to_bits()),
            Precision::F64 => x.to_bits(),
        }))
    }

    fn abs(self) -> Self {
        self.unary(Unary::Abs)
    }

    fn sqrt(self) -> Self {
        self.unary(Unary::Sqrt)
    }

    fn floor(self) -> Self {
        self.unary(Unary::Floor)
    }

    fn min(self, other: Self) -> Self {
        self.binary(Binary::Min, other)
    }

    fn max(self, other: Self) -> Self {
        self.binary(Binary::Max, other)
    }

    fn mul_add(self, a: Self, b: Self) -> Self {
        if self.recorder.precision == Precision::F64 && !FUSED {
            return self * a + b;
        }
        // The machine's fused forms change signs for nothing.
        let ((x, minus_x), (c, minus_c)) = (self.without_sign(), b.without_sign());
        let operation = Operation::MulAdd { a: x, b: a.value, c, minus_product: minus_x, minus_c };
        self.recorder.number(operation)
    }

    fn sin_cos(self) -> (Self, Self) {
        let sin = self.call(Kit::SinCos, self);
        (sin, self.recorder.number(Operation::Second(sin.value)))
    }

    fn atan2(self, x: Self) -> Self {
        self.call(Kit::Atan2, x)
    }

    fn acos(self) -> Self {
        self.call(Kit::Acos, self)
    }

    fn asin(self) -> Self {
        self.call(Kit::Asin, self)
    }

    fn exp(self) -> Self {
        self.call(Kit::Exp, self)
    }

    fn ln(self) -> Self {
        self.call(Kit::Ln, self)
    }

    fn pow(self, y: Self) -> Self {
        self.call(Kit::Pow, y)
    }

    fn lt(self, other: Self) -> TracedMask<'a> {
        self.compare(Comparison::Less, other)
    }

    fn le(self, other: Self) -> TracedMask<'a> {
        self.compare(Comparison::LessOrEqual, other)
    }

    fn eq(self, other: Self) -> TracedMask<'a> {
        self.compare(Comparison::Equal, other)
    }

    /// A choice within a choice that has the same other value is one, of both masks.
    fn select(mask: TracedMask<'a>, a: Self, b: Self) -> Self {
        let recorder = a.recorder;
        let (both, value) = match recorder.operation(a.value) {
            Operation::Select(inner, value, other) if other == b.value => (recorder.both(mask.value, inner), value),
            Operation::Select(inner, other, value) if other == b.value => {
                (recorder.both(mask.value, recorder.value(recorder.inverse(inner))), value)
            }
            _ => return recorder.number(Operation::Select(mask.value, a.value, b.value)),
        };
        recorder.number(Operation::Select(recorder.value(both), value, b.value))
    }

    fn mask_and(a: TracedMask<'a>, b: TracedMask<'a>) -> TracedMask<'a> {
        TracedMask { value: a.recorder.value(a.recorder.both(a.value, b.value)), ..a }
    }

    fn mask_or(a: TracedMask<'a>, b: TracedMask<'a>) -> TracedMask<'a> {
        TracedMask { value: a.recorder.value(Operation::MaskOr(a.value, b.value)), ..a }
    }

    fn mask_not(a: TracedMask<'a>) -> TracedMask<'a> {
        TracedMask { value: a.recorder.value(a.recorder.inverse(a.value)), ..a }
    }

    fn from_mask(recorder: &'a Recorder, mask: TracedMask<'a>) -> Self {
        recorder.number(Operation::FromMask(mask.value))
    }

    fn to_mask(self) -> TracedMask<'a> {
        match self.recorder.operation(self.value) {
            Operation::FromMask(value) => TracedMask { value, recorder: self.recorder },
            _ => {
                let half = Self::splat(self.recorder, 0.5);
                self.compare(Comparison::IsTrue, half)
            }
        }
    }
}

impl Machine for Traced<'_> {
    fn enter<T>(_: Self::Token, f: impl FnOnce() -> T) -> T {
        f()
    }

    fn look_up(_: Self::Token, table: &Arc<Table>, index: Self) -> Self {
        index.call(Kit::Lookup(Arc::as_ptr(table).expose_provenance() as u64), index)
    }
}
