//! Functions of shading languages that are made of the operators of the table, so that no back end knows them and their
//! derivatives and bounds follow.

use super::Expr;

/// Coefficients 1/3!, 1/5!, ... of the hyperbolic sine, the last first.
const SINH: [f64; 7] = [
    1.0 / 1_307_674_368_000.0,
    1.0 / 6_227_020_800.0,
    1.0 / 39_916_800.0,
    1.0 / 362_880.0,
    1.0 / 5040.0,
    1.0 / 120.0,
    1.0 / 6.0,
];

/// Below this the series of the hyperbolic sine is used, which ends 2e-17 from the sine's value in relation to it; above, the
/// difference of two exponentials loses less than two units of the last place.
const SERIES_ENDS: f64 = 0.5;

impl<'g> Expr<'g> {
    /// The hyperbolic sine by its series, of the argument moved to where that holds, so that the other side of a choice stays
    /// finite.
    fn sinh_near_zero(self) -> Expr<'g> {
        let x = self.clamp(self.lift(-1.0), self.lift(1.0));
        let square = x * x;
        let sum = SINH[1..].iter().fold(self.lift(SINH[0]), |sum, coefficient| sum * square + *coefficient);
        x + x * square * sum
    }

    fn is_near_zero(self) -> Expr<'g> {
        self.abs().lt(self.lift(SERIES_ENDS))
    }

    /// The hyperbolic sine.
    pub fn sinh(self) -> Expr<'g> {
        let e = self.exp();
        self.is_near_zero().select(self.sinh_near_zero(), (e - 1.0 / e) * 0.5)
    }

    /// The hyperbolic cosine.
    pub fn cosh(self) -> Expr<'g> {
        let e = self.exp();
        (e + 1.0 / e) * 0.5
    }

    /// The hyperbolic tangent; no exponential of a large number is taken.
    pub fn tanh(self) -> Expr<'g> {
        let sinh = self.sinh_near_zero();
        let near = sinh / (sinh * sinh + 1.0).sqrt();
        // The argument stands in it once, so bounds are tight.
        let far = 2.0 / ((self.abs() * -2.0).exp() + 1.0) - 1.0;
        self.is_near_zero().select(near, self.lt(self.lift(0.0)).select(-far, far))
    }

    /// The inverse tangent.
    pub fn atan(self) -> Expr<'g> {
        self.atan2(self.lift(1.0))
    }

    /// Without the part behind the decimal point.
    pub fn trunc(self) -> Expr<'g> {
        self.lt(self.lift(0.0)).select(-((-self).floor()), self.floor())
    }

    /// The nearest whole number, of two equally near ones the even one (WGSL).
    pub fn round(self) -> Expr<'g> {
        let up = (self + 0.5).floor();
        let over = up - self;
        let half = self.lift(0.5);
        let odd = up.modulo(self.lift(2.0)).equals(self.lift(1.0));
        // Just below a half, and where numbers have no halves, the sum above is rounded up.
        half.lt(over).or(over.equals(half).and(odd)).select(up - 1.0, up)
    }

    /// 0 below `low`, 1 above `high`, and smooth between.
    pub fn smoothstep(self, low: Expr<'g>, high: Expr<'g>) -> Expr<'g> {
        let share = (self - low) / (high - low);
        let t = share.clamp(share.lift(0.0), share.lift(1.0));
        t * t * (3.0 - t * 2.0)
    }
}
