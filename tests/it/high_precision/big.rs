//! Numbers of 384 bits (115 digits), with the operators that formulas are written in.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

use astro_float::{BigFloat, Consts, RoundingMode};

/// Bits of every result.
const BITS: usize = 384;
const ROUND: RoundingMode = RoundingMode::ToEven;

thread_local! {
    /// Digits of pi and of ln 2 that were needed so far.
    static CONSTANTS: RefCell<Consts> = RefCell::new(Consts::new().expect("constants need memory only"));
}

fn with_constants(of: impl FnOnce(&mut Consts) -> BigFloat) -> Big {
    CONSTANTS.with(|constants| Big(of(&mut constants.borrow_mut())))
}

/// A number of [`BITS`] bits.
#[derive(Clone, Debug)]
pub struct Big(BigFloat);

/// A point or vector.
pub type V = [Big; 3];

impl From<f64> for Big {
    /// Exact: no bit of the double is lost.
    fn from(x: f64) -> Big {
        Big(BigFloat::from_f64(x, BITS))
    }
}

impl Big {
    /// 2 to a whole power.
    pub fn two_to(exponent: i32) -> Big {
        let mut one = BigFloat::from_f64(0.5, BITS);
        one.set_exponent(exponent + 1);
        Big(one)
    }

    /// The circle's ratio.
    pub fn pi() -> Big {
        Big::from(-1.0).acos()
    }

    /// The nearest double, within a unit of its last place.
    pub fn to_f64(&self) -> f64 {
        let Some((words, _, sign, exponent, _)) = self.0.as_raw_parts() else { return f64::NAN };
        // The value is 0.m times 2^exponent, with the most significant word last.
        let mantissa = words.iter().rev().take(2).fold((0.0, 1.0), |(sum, unit), word| {
            let unit = unit * 2f64.powi(-64);
            (sum + *word as f64 * unit, unit)
        });
        let size = mantissa.0 * 2f64.powi(exponent);
        if sign == astro_float::Sign::Neg { -size } else { size }
    }

    pub fn sqrt(&self) -> Big {
        Big(self.0.sqrt(BITS, ROUND))
    }

    pub fn abs(&self) -> Big {
        Big(self.0.abs())
    }

    pub fn powi(&self, n: usize) -> Big {
        Big(self.0.powi(n, BITS, ROUND))
    }

    pub fn ln(&self) -> Big {
        with_constants(|constants| self.0.ln(BITS, ROUND, constants))
    }

    pub fn exp(&self) -> Big {
        with_constants(|constants| self.0.exp(BITS, ROUND, constants))
    }

    pub fn sin(&self) -> Big {
        with_constants(|constants| self.0.sin(BITS, ROUND, constants))
    }

    pub fn cos(&self) -> Big {
        with_constants(|constants| self.0.cos(BITS, ROUND, constants))
    }

    pub fn acos(&self) -> Big {
        with_constants(|constants| self.0.acos(BITS, ROUND, constants))
    }

    pub fn asin(&self) -> Big {
        with_constants(|constants| self.0.asin(BITS, ROUND, constants))
    }

    fn atan(&self) -> Big {
        with_constants(|constants| self.0.atan(BITS, ROUND, constants))
    }

    /// The angle of the point (x, y) with `self` as y, in -pi ... pi.
    pub fn atan2(&self, x: &Big) -> Big {
        let zero = Big::from(0.0);
        if x.abs() < self.abs() {
            let quarter = Big::pi() / Big::from(2.0);
            let from_y = (x / self).atan();
            return if *self > zero { quarter - from_y } else { -quarter - from_y };
        }
        let angle = (self / x).atan();
        match (*x > zero, *self >= zero) {
            (true, _) => angle,
            (false, true) => angle + Big::pi(),
            (false, false) => angle - Big::pi(),
        }
    }

    pub fn max(&self, other: &Big) -> Big {
        if self < other { other.clone() } else { self.clone() }
    }
}

impl PartialEq for Big {
    fn eq(&self, other: &Big) -> bool {
        self.0.cmp(&other.0) == Some(0)
    }
}

impl PartialOrd for Big {
    fn partial_cmp(&self, other: &Big) -> Option<Ordering> {
        self.0.cmp(&other.0).map(|sign| sign.cmp(&0))
    }
}

impl Neg for Big {
    type Output = Big;
    fn neg(self) -> Big {
        Big(self.0.neg())
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait<&Big> for &Big {
            type Output = Big;
            fn $method(self, other: &Big) -> Big {
                Big(self.0.$method(&other.0, BITS, ROUND))
            }
        }
        impl $trait<Big> for &Big {
            type Output = Big;
            fn $method(self, other: Big) -> Big {
                $trait::$method(self, &other)
            }
        }
        impl $trait<&Big> for Big {
            type Output = Big;
            fn $method(self, other: &Big) -> Big {
                $trait::$method(&self, other)
            }
        }
        impl $trait<Big> for Big {
            type Output = Big;
            fn $method(self, other: Big) -> Big {
                $trait::$method(&self, &other)
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

/// Exact copies of three doubles.
pub fn vector(v: [f64; 3]) -> V {
    v.map(Big::from)
}

pub fn dot(a: &V, b: &V) -> Big {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

pub fn length(a: &V) -> Big {
    dot(a, a).sqrt()
}

pub fn scaled(a: &V, by: &Big) -> V {
    [&a[0] * by, &a[1] * by, &a[2] * by]
}

pub fn sum(a: &V, b: &V) -> V {
    [&a[0] + &b[0], &a[1] + &b[1], &a[2] + &b[2]]
}

pub fn cross(a: &V, b: &V) -> V {
    let part = |i: usize, j: usize| &a[i] * &b[j] - &a[j] * &b[i];
    [part(1, 2), part(2, 0), part(0, 1)]
}
