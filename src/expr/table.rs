//! Tables of numbers that expressions look up by index.

use std::fmt;
use std::sync::Arc;

use super::{Arena, Expr};

/// Numbers that kernels look up by index: read only, the same for all elements and all runs.
#[derive(PartialEq)]
pub struct Table {
    numbers: Vec<f32>,
    ends: [f32; 2],
    key: u64,
}

impl fmt::Debug for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "table of {} numbers, {:016x}", self.numbers.len(), self.key)
    }
}

impl Table {
    /// Most numbers: all indices are whole in single precision.
    pub const MOST: usize = 1 << 24;

    /// A table of these numbers. One without a number holds a single 0; numbers beyond [`Table::MOST`] are left out, and what is
    /// not finite is 0.
    pub fn new(mut numbers: Vec<f32>) -> Table {
        numbers.truncate(Table::MOST);
        numbers.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = 0.0);
        if numbers.is_empty() {
            numbers.push(0.0);
        }
        let ends = numbers.iter().fold([f32::MAX, f32::MIN], |[low, high], x| [low.min(*x), high.max(*x)]);
        let mixed = |key: u64, x: &f32| (key ^ u64::from(x.to_bits())).wrapping_mul(0x0100_0000_01b3);
        let key = numbers.iter().fold(0xcbf2_9ce4_8422_2325, mixed);
        Table { numbers, ends, key }
    }

    /// The numbers in order.
    pub fn numbers(&self) -> &[f32] {
        &self.numbers
    }

    /// The least and the largest number.
    pub fn ends(&self) -> [f64; 2] {
        self.ends.map(f64::from)
    }

    /// Equal where the numbers are (FNV-1a over their bits).
    pub fn key(&self) -> u64 {
        self.key
    }

    /// The largest index.
    pub fn last(&self) -> usize {
        self.numbers.len() - 1
    }

    /// The number at an index, which is rounded down and moved into the range; what is not a number is index 0.
    #[inline]
    pub fn at(&self, index: f64) -> f32 {
        self.numbers[(index as usize).min(self.last())]
    }
}

impl Arena {
    /// The number of a table at an index, which is rounded down and moved into the range. The derivative is 0.
    pub fn look_up<'g>(&'g self, table: &Arc<Table>, index: Expr<'g>) -> Expr<'g> {
        match index.as_constant() {
            Some([index, ..]) => self.f(f64::from(table.at(index))),
            None => self.lookup_in(self.table_number(table), index),
        }
    }
}
