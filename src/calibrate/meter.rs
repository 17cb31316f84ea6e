//! How much a calibration may compute: counted in operations, in proportion to the picture, and never timed.

use super::Options;
use crate::kernel::work::Work;

/// Operations (products of two numbers) that a calibration may always take: half a second on two cores of 2022
/// for formulas that need it all.
pub const LEAST_WORK: f64 = 8e9;
/// Share of the operations of a picture with one sample a pixel that it may take where that is more.
const SHARE_OF_PICTURE: f64 = 0.1;
/// What a pixel takes besides its primary ray (its shadow and its colour), as a share of that.
const BESIDES_PRIMARY: f64 = 1.0;
/// Operations in whose time one operation of a kernel is composed and compiled.
const COMPILING: f64 = 30_000.0;

/// What was spent, and what may be.
pub(super) struct Meter {
    limit: f64,
    spent: f64,
}

impl Meter {
    /// A meter for a picture whose rays cost about `price` operations each.
    pub fn new(options: &Options, price: f64) -> Meter {
        let pixels = f64::from(options.size.width) * f64::from(options.size.height);
        let picture = pixels * price * (1.0 + BESIDES_PRIMARY);
        Meter { limit: options.effort * LEAST_WORK.max(SHARE_OF_PICTURE * picture), spent: 0.0 }
    }

    /// Operations that may be spent in all.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Operations that are left of so many times the limit; below 0 where more was spent.
    pub fn left(&self, times: f64) -> f64 {
        times * self.limit - self.spent
    }

    /// Share that is spent, at most 1.
    pub fn share(&self) -> f64 {
        (self.spent / self.limit).min(1.0)
    }

    /// Counts operations.
    pub fn spend(&mut self, operations: f64) {
        self.spent += operations;
    }

    /// Counts the compiling of a kernel.
    pub fn compiled(&mut self, work: &Work) {
        self.spent += COMPILING * (work.estimate + work.iteration);
    }
}
