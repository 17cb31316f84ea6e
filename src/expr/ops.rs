//! The operator table: one row an operator, and the only place that knows operators by name.
//!
//! A row holds the operator's WGSL spelling, notation, help, evaluation (once, generic over [`Real`]) and derivative rule (made of
//! other operators). All operators here are *componentwise*: they take one to three arguments of one width and give a
//! result of that width. Booleans are evaluated as 1 and 0. [`execute`] is the interpreter's dispatch, made from the
//! same rows.

use super::Expr;
use super::enclose::{Bounds, UNBOUNDED, crosses_cut};
use crate::math::Real;

/// What a row of the table says, apart from its evaluation.
pub struct Info {
    /// Name in lower case, as listings print it.
    pub name: &'static str,
    /// Number of arguments, 1 to 3.
    pub arity: usize,
    /// Booleans in: every argument that must be boolean, by bit.
    pub bool_arguments: u8,
    /// True when the result is boolean.
    pub bool_result: bool,
    /// WGSL text with `{0}`, `{1}`, `{2}` for the arguments and `{t}` for the type in a helper's name.
    pub wgsl: &'static str,
    /// How tightly its notation binds: 8 stands alone, then powers, products, quotients, sums, comparisons, `and`, `or`.
    pub level: u8,
    /// Notation in plain text; `#0.4` is the first argument, in brackets where it binds less than 4.
    pub plain: &'static str,
    /// Notation in LaTeX, in the same form.
    pub latex: &'static str,
    /// One sentence for the reference.
    pub help: &'static str,
    /// False if the value jumps: derivative checks and continuity reports skip those places only.
    pub continuous: bool,
}

/// What kind of work an operator is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum OperatorKind {
    /// Sums, differences and negatives.
    Add,
    /// Products.
    Mul,
    /// Quotients.
    Div,
    /// Square roots.
    Sqrt,
    /// Trigonometric functions and their inverses.
    Trig,
    /// Exponentials, logarithms and powers.
    Exp,
    /// Comparisons, choices, least and largest, and logic.
    Compare,
    /// Absolute values, signs, roundings and remainders.
    Other,
}

/// A function from argument values to a value, over any [`Real`].
trait Evaluate {
    fn evaluate<R: Real>(token: R::Token, a: R, b: R, c: R) -> R;
}

/// Register operands of one instruction: up to four components of up to three arguments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Operands {
    /// Components to compute, 1 to 4.
    pub width: u8,
    /// Where each component goes.
    pub dst: [u16; 4],
    /// Where each component of a second result goes.
    pub dst2: [u16; 4],
    /// Registers of each argument's components.
    pub args: [[u16; 4]; 4],
}

/// One register: `K` vectors of lanes.
pub type Register<R, const K: usize> = [R; K];

#[inline(always)]
fn apply<E: Evaluate, R: Real, const K: usize>(
    token: R::Token,
    arity: usize,
    registers: &mut [Register<R, K>],
    operands: &Operands,
) {
    for i in 0..operands.width as usize {
        // Whole registers are copied out first: the compiler then keeps them in the machine's own.
        let a = registers[operands.args[0][i] as usize];
        let b = if arity > 1 { registers[operands.args[1][i] as usize] } else { a };
        let c = if arity > 2 { registers[operands.args[2][i] as usize] } else { a };
        let mut result = a;
        for k in 0..K {
            result[k] = E::evaluate(token, a[k], b[k], c[k]);
        }
        registers[operands.dst[i] as usize] = result;
    }
}

macro_rules! arity {
    ($a:ident) => {
        1
    };
    ($a:ident, $b:ident) => {
        2
    };
    ($a:ident, $b:ident, $c:ident) => {
        3
    };
}

macro_rules! bind {
    ($va:ident $vb:ident $vc:ident; $a:ident) => {
        let $a = $va;
        let _ = ($vb, $vc);
    };
    ($va:ident $vb:ident $vc:ident; $a:ident, $b:ident) => {
        let ($a, $b) = ($va, $vb);
        let _ = $vc;
    };
    ($va:ident $vb:ident $vc:ident; $a:ident, $b:ident, $c:ident) => {
        let ($a, $b, $c) = ($va, $vb, $vc);
    };
}

macro_rules! operators {
    ($(
        $variant:ident $name:literal ($($arg:ident),+) bools($bools:literal, $bool_result:literal) continuous($continuous:literal)
        wgsl $wgsl:literal help $help:literal
        notation($level:literal, $plain:literal, $latex:literal)
        evaluate($token:ident) $body:block
        derivative($x:ident, $y:ident, $d:ident) $rule:block
        enclose($b:ident) $bounds:block
    )*) => {
        /// A componentwise operator of the table.
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Operator { $( #[doc = $help] $variant ),* }

        $( struct $variant; impl Evaluate for $variant {
            #[inline(always)]
            fn evaluate<R: Real>($token: R::Token, va: R, vb: R, vc: R) -> R {
                bind!(va vb vc; $($arg),+);
                let _ = $token;
                $body
            }
        } )*

        impl Operator {
            /// Every operator, in the order of the table.
            pub const ALL: &'static [Operator] = &[ $( Operator::$variant ),* ];

            /// The operator's row.
            pub fn info(self) -> &'static Info {
                match self { $( Operator::$variant => &Info {
                    name: $name, arity: arity!($($arg),+), bool_arguments: $bools, bool_result: $bool_result, level: $level, plain: $plain, latex: $latex,
                    wgsl: $wgsl, help: $help, continuous: $continuous,
                } ),* }
            }

            /// How many times as long as a product it takes, roughly, on every back end.
            pub fn weight(self) -> f64 {
                match self {
                    Operator::Pow => 16.0,
                    Operator::Sin | Operator::Cos | Operator::Asin | Operator::Acos | Operator::Atan2 => 12.0,
                    Operator::Exp | Operator::Ln => 8.0,
                    Operator::Sqrt | Operator::Div => 3.0,
                    _ => 1.0,
                }
            }

            /// The kind that counts of operations list it under.
            pub fn kind(self) -> OperatorKind {
                match self {
                    Operator::Neg | Operator::Add | Operator::Sub => OperatorKind::Add,
                    Operator::Mul => OperatorKind::Mul,
                    Operator::Div => OperatorKind::Div,
                    Operator::Sqrt => OperatorKind::Sqrt,
                    Operator::Sin | Operator::Cos | Operator::Asin | Operator::Acos | Operator::Atan2 => {
                        OperatorKind::Trig
                    }
                    Operator::Exp | Operator::Ln | Operator::Pow => OperatorKind::Exp,
                    Operator::Abs | Operator::Floor | Operator::Sign | Operator::Mod => OperatorKind::Other,
                    _ => OperatorKind::Compare,
                }
            }

            /// The value for one lane in f64; used to fold constants.
            pub fn evaluate_f64(self, a: f64, b: f64, c: f64) -> f64 {
                match self { $( Operator::$variant => <$variant as Evaluate>::evaluate::<f64>((), a, b, c) ),* }
            }

            /// Bounds of one component of the result from those of the arguments.
            pub fn enclose<'g>(self, bounds: &[Bounds<'g>]) -> Bounds<'g> {
                match self { $( Operator::$variant => { let $b = bounds; $bounds } ),* }
            }

            /// The derivative of the result `y` from the arguments `x` and their derivatives `d`.
            #[allow(unused_variables, reason = "a row uses what its rule needs")]
            pub fn derivative<'g>(self, x: &[Expr<'g>], y: Expr<'g>, d: &[Expr<'g>]) -> Expr<'g> {
                match self { $( Operator::$variant => { let ($x, $y, $d) = (x, y, d); $rule } ),* }
            }
        }

        /// Runs one operator on registers: `operands.width` components, all lanes.
        #[inline(always)]
        pub fn execute<R: Real, const K: usize>(
            operator: Operator, token: R::Token, registers: &mut [Register<R, K>], operands: &Operands,
        ) {
            match operator { $(
                Operator::$variant => apply::<$variant, R, K>(token, arity!($($arg),+), registers, operands),
            )* }
        }
    };
}

/// Keeps divisions by a length or a square root finite where the derivative has a pole.
const TINY: f64 = 1e-30;

/// `slope` where `x` is in [-1, 1]; 0 beyond, where the inverse sine and cosine clamp their argument.
fn inside_unit<'g>(x: Expr<'g>, slope: Expr<'g>) -> Expr<'g> {
    x.abs().le(x.lift(1.0)).select(slope, x.lift(0.0))
}

operators! {
    Neg "neg" (a) bools(0, false) continuous(true)
        wgsl "-{0}" help "The negative."
        notation(4, "-#0.5", "-#0.5")
        evaluate(_t) { -a } derivative(x, y, d) { -d[0] }
        enclose(b) { b[0].falling(|x| -x) }
    Abs "abs" (a) bools(0, false) continuous(true)
        wgsl "abs({0})" help "The absolute value."
        notation(8, "|#0.0|", "\\left|#0.0\\right|")
        evaluate(_t) { a.abs() } derivative(x, y, d) { x[0].lt(x[0].lift(0.0)).select(-d[0], d[0]) }
        enclose(b) { Bounds { lo: b[0].lo.max(-b[0].hi).max(b[0].lo.lift(0.0)), hi: b[0].magnitude() } }
    Sqrt "sqrt" (a) bools(0, false) continuous(true)
        wgsl "sqrt({0})" help "The square root; NaN below 0."
        notation(8, "√(#0.0)", "\\sqrt{#0.0}")
        evaluate(_t) { a.sqrt() } derivative(x, y, d) { d[0] * 0.5 / y.max(y.lift(TINY)) }
        enclose(b) { b[0].rising(|x| x.max(x.lift(0.0)).sqrt()) }
    Floor "floor" (a) bools(0, false) continuous(false)
        wgsl "floor({0})" help "The largest whole number not above the argument."
        notation(8, "floor(#0.0)", "\\left\\lfloor #0.0\\right\\rfloor")
        evaluate(_t) { a.floor() } derivative(x, y, d) { y.lift(0.0) }
        enclose(b) { b[0].rising(Expr::floor) }
    Sign "sign" (a) bools(0, false) continuous(false)
        wgsl "sign({0})" help "-1, 0 or 1."
        notation(8, "sign(#0.0)", "\\operatorname{sgn}\\left(#0.0\\right)")
        evaluate(t) {
            let (zero, one) = (R::splat(t, 0.0), R::splat(t, 1.0));
            R::select(a.lt(zero), -one, R::select(zero.lt(a), one, zero))
        }
        derivative(x, y, d) { y.lift(0.0) }
        enclose(b) { b[0].rising(Expr::sign) }
    Sin "sin" (a) bools(0, false) continuous(true)
        wgsl "sin({0})" help "The sine of an angle in radians."
        notation(8, "sin(#0.0)", "\\sin\\left(#0.0\\right)")
        evaluate(_t) { a.sin_cos().0 } derivative(x, y, d) { x[0].cos() * d[0] }
        enclose(b) { b[0].wave(Expr::sin) }
    Cos "cos" (a) bools(0, false) continuous(true)
        wgsl "cos({0})" help "The cosine of an angle in radians."
        notation(8, "cos(#0.0)", "\\cos\\left(#0.0\\right)")
        evaluate(_t) { a.sin_cos().1 } derivative(x, y, d) { -(x[0].sin() * d[0]) }
        enclose(b) { b[0].wave(Expr::cos) }
    Asin "asin" (a) bools(0, false) continuous(true)
        wgsl "bf_asin_{t}({0})" help "The inverse sine in radians; the argument is clamped to [-1, 1]."
        notation(8, "arcsin(#0.0)", "\\arcsin\\left(#0.0\\right)")
        evaluate(t) { let one = R::splat(t, 1.0); a.max(-one).min(one).asin() }
        derivative(x, y, d) { inside_unit(x[0], d[0] / (1.0 - x[0] * x[0]).max(x[0].lift(1e-12)).sqrt()) }
        enclose(b) { b[0].rising(Expr::asin) }
    Acos "acos" (a) bools(0, false) continuous(true)
        wgsl "bf_acos_{t}({0})" help "The inverse cosine in radians; the argument is clamped to [-1, 1]."
        notation(8, "arccos(#0.0)", "\\arccos\\left(#0.0\\right)")
        evaluate(t) { let one = R::splat(t, 1.0); a.max(-one).min(one).acos() }
        derivative(x, y, d) { inside_unit(x[0], -(d[0] / (1.0 - x[0] * x[0]).max(x[0].lift(1e-12)).sqrt())) }
        enclose(b) { b[0].falling(Expr::acos) }
    Exp "exp" (a) bools(0, false) continuous(true)
        wgsl "exp({0})" help "e to the power of the argument."
        notation(8, "exp(#0.0)", "\\exp\\left(#0.0\\right)")
        evaluate(_t) { a.exp() } derivative(x, y, d) { y * d[0] }
        enclose(b) { b[0].rising(Expr::exp) }
    Ln "ln" (a) bools(0, false) continuous(true)
        wgsl "log({0})" help "The natural logarithm; NaN below 0."
        notation(8, "ln(#0.0)", "\\ln\\left(#0.0\\right)")
        evaluate(_t) { a.ln() } derivative(x, y, d) { d[0] / x[0] }
        enclose(b) { b[0].rising(|x| x.lift(TINY).lt(x).select(x.max(x.lift(TINY)).ln(), x.lift(-UNBOUNDED))) }
    Not "not" (a) bools(1, true) continuous(true)
        wgsl "!{0}" help "True where the argument is false."
        notation(2, "not #0.3", "\\lnot #0.3")
        evaluate(t) { R::splat(t, 1.0) - a } derivative(x, y, d) { y }
        enclose(b) { b[0].falling(|x| !x) }
    Add "add" (a, b) bools(0, false) continuous(true)
        wgsl "{0} + {1}" help "The sum."
        notation(4, "#0.4 + #1.4", "#0.4 + #1.4")
        evaluate(_t) { a + b } derivative(x, y, d) { d[0] + d[1] }
        enclose(b) { Bounds { lo: b[0].lo + b[1].lo, hi: b[0].hi + b[1].hi } }
    Sub "sub" (a, b) bools(0, false) continuous(true)
        wgsl "{0} - {1}" help "The difference."
        notation(4, "#0.4 - #1.5", "#0.4 - #1.5")
        evaluate(_t) { a - b } derivative(x, y, d) { d[0] - d[1] }
        enclose(b) { Bounds { lo: b[0].lo - b[1].hi, hi: b[0].hi - b[1].lo } }
    Mul "mul" (a, b) bools(0, false) continuous(true)
        wgsl "{0} * {1}" help "The product."
        notation(6, "#0.6 #1.6", "#0.6\\,#1.6")
        evaluate(_t) { a * b }
        derivative(x, y, d) {
            if x[0].id == x[1].id { (x[0] + x[0]) * d[0] } else { d[0] * x[1] + x[0] * d[1] }
        }
        enclose(b) { b[0].times(b[1]) }
    Div "div" (a, b) bools(0, false) continuous(true)
        wgsl "{0} / {1}" help "The quotient."
        notation(5, "#0.6 / #1.7", "\\frac{#0.0}{#1.0}")
        evaluate(_t) { a / b } derivative(x, y, d) { (d[0] - y * d[1]) / x[1] }
        enclose(b) { b[0].times(b[1].reciprocal()) }
    Min "min" (a, b) bools(0, false) continuous(true)
        wgsl "min({0}, {1})" help "The smaller one."
        notation(8, "min(#0.0, #1.0)", "\\min\\left(#0.0, #1.0\\right)")
        evaluate(_t) { a.min(b) } derivative(x, y, d) { x[1].lt(x[0]).select(d[1], d[0]) }
        enclose(b) { Bounds { lo: b[0].lo.min(b[1].lo), hi: b[0].hi.min(b[1].hi) } }
    Max "max" (a, b) bools(0, false) continuous(true)
        wgsl "max({0}, {1})" help "The larger one."
        notation(8, "max(#0.0, #1.0)", "\\max\\left(#0.0, #1.0\\right)")
        evaluate(_t) { a.max(b) } derivative(x, y, d) { x[1].lt(x[0]).select(d[0], d[1]) } // at a tie, what `min` does not take
        enclose(b) { Bounds { lo: b[0].lo.max(b[1].lo), hi: b[0].hi.max(b[1].hi) } }
    Pow "pow" (a, b) bools(0, false) continuous(true)
        wgsl "bf_pow_{t}({0}, {1})" help "The first argument to the power of the second; NaN for a negative base."
        notation(7, "#0.8^#1.8", "{#0.8}^{#1.0}")
        evaluate(_t) { a.pow(b) }
        derivative(x, y, d) { x[1] * x[0].pow(x[1] - 1.0) * d[0] + y * x[0].max(x[0].lift(TINY)).ln() * d[1] }
        enclose(b) { b[0].rising(|x| x.max(x.lift(TINY))).corners(b[1], Expr::pow) }
    Atan2 "atan2" (a, b) bools(0, false) continuous(false)
        wgsl "bf_atan2_{t}({0}, {1})" help "The angle in (-pi, pi] of the point whose y is the first argument and whose x is the second."
        notation(8, "atan2(#0.0, #1.0)", "\\operatorname{atan2}\\left(#0.0, #1.0\\right)")
        evaluate(_t) { a.atan2(b) }
        derivative(x, y, d) { (x[1] * d[0] - x[0] * d[1]) / (x[0] * x[0] + x[1] * x[1]).max(x[0].lift(TINY)) }
        enclose(b) {
            let (angles, pi) = (b[0].corners(b[1], Expr::atan2), std::f64::consts::PI);
            let cut = crosses_cut(b[0], b[1]);
            Bounds { lo: cut.select(cut.arena.f(-pi), angles.lo), hi: cut.select(cut.arena.f(pi), angles.hi) }
        }
    Mod "mod" (a, b) bools(0, false) continuous(false)
        wgsl "bf_mod_{t}({0}, {1})" help "The remainder with the sign of the second argument."
        notation(5, "#0.6 mod #1.7", "#0.6 \\bmod #1.7")
        evaluate(_t) { a - b * (a / b).floor() } derivative(x, y, d) { d[0] - (x[0] / x[1]).floor() * d[1] }
        enclose(b) {
            let turns = b[0].times(b[1].reciprocal()).rising(Expr::floor);
            let whole = b[1].times(turns);
            Bounds { lo: b[0].lo - whole.hi, hi: b[0].hi - whole.lo }
        }
    Lt "lt" (a, b) bools(0, true) continuous(false)
        wgsl "{0} < {1}" help "True where the first argument is the smaller one."
        notation(3, "#0.4 < #1.4", "#0.4 < #1.4")
        evaluate(t) { R::from_mask(t, a.lt(b)) } derivative(x, y, d) { y }
        enclose(b) { Bounds { lo: b[0].hi.lt(b[1].lo), hi: b[0].lo.lt(b[1].hi) } }
    Le "le" (a, b) bools(0, true) continuous(false)
        wgsl "{0} <= {1}" help "True where the first argument is not the larger one."
        notation(3, "#0.4 ≤ #1.4", "#0.4 \\le #1.4")
        evaluate(t) { R::from_mask(t, a.le(b)) } derivative(x, y, d) { y }
        enclose(b) { Bounds { lo: b[0].hi.le(b[1].lo), hi: b[0].lo.le(b[1].hi) } }
    Eq "eq" (a, b) bools(0, true) continuous(false)
        wgsl "{0} == {1}" help "True where both are equal."
        notation(3, "#0.4 = #1.4", "#0.4 = #1.4")
        evaluate(t) { R::from_mask(t, a.eq(b)) } derivative(x, y, d) { y }
        enclose(b) { Bounds { lo: b[0].lo.arena.bool(false), hi: b[0].lo.le(b[1].hi).and(b[1].lo.le(b[0].hi)) } }
    And "and" (a, b) bools(3, true) continuous(true)
        wgsl "{0} & {1}" help "True where both are."
        notation(2, "#0.2 and #1.2", "#0.2 \\land #1.2")
        evaluate(_t) { a * b } derivative(x, y, d) { y }
        enclose(b) { Bounds { lo: b[0].lo.and(b[1].lo), hi: b[0].hi.and(b[1].hi) } }
    Or "or" (a, b) bools(3, true) continuous(true)
        wgsl "{0} | {1}" help "True where either is."
        notation(1, "#0.1 or #1.1", "#0.1 \\lor #1.1")
        evaluate(_t) { a.max(b) } derivative(x, y, d) { y }
        enclose(b) { Bounds { lo: b[0].lo.or(b[1].lo), hi: b[0].hi.or(b[1].hi) } }
    Clamp "clamp" (a, b, c) bools(0, false) continuous(true)
        wgsl "min(max({0}, {1}), {2})" help "The first argument moved into the range from the second to the third."
        notation(8, "clamp(#0.0, #1.0, #2.0)", "\\operatorname{clamp}\\left(#0.0, #1.0, #2.0\\right)")
        evaluate(_t) { a.max(b).min(c) }
        derivative(x, y, d) { x[0].lt(x[1]).select(d[1], x[2].lt(x[0]).select(d[2], d[0])) }
        enclose(b) { Bounds { lo: b[0].lo.clamp(b[1].lo, b[2].lo), hi: b[0].hi.clamp(b[1].hi, b[2].hi) } }
    Select "select" (a, b, c) bools(1, false) continuous(false)
        wgsl "select({2}, {1}, {0})" help "The second argument where the first is true, else the third."
        notation(0, "#1.1 if #0.0, else #2.0", "#1.0 \\text{ if } #0.0 \\text{, else } #2.0")
        evaluate(_t) { R::select(a.to_mask(), b, c) } derivative(x, y, d) { x[0].select(d[1], d[2]) }
        enclose(b) {
            let pick = |then: Expr<'g>, either: Expr<'g>, other: Expr<'g>| b[0].lo.select(then, b[0].hi.select(either, other));
            Bounds {
                lo: pick(b[1].lo, b[1].lo.min(b[2].lo), b[2].lo),
                hi: pick(b[1].hi, b[1].hi.max(b[2].hi), b[2].hi),
            }
        }
}
