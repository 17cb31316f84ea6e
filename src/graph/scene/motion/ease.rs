//! Easings: how time passes between two keys.

/// What becomes of the time between two keys.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Ease {
    /// Nothing.
    Linear,
    /// It starts slowly.
    In,
    /// It ends slowly.
    Out,
    /// It starts and ends slowly.
    InOut,
    /// It starts and ends without a push, too: speed and its change are 0 there (Perlin, 2002).
    Smooth,
    /// A cubic Bezier curve from (0, 0) to (1, 1) with two handles, as in CSS: x of the handles from 0 to 1.
    Bezier([f64; 4]),
}

impl Ease {
    /// All but Bezier curves, with the names that files use.
    pub const NAMES: [(&'static str, Ease); 5] = [
        ("linear", Ease::Linear),
        ("ease", Ease::InOut),
        ("ease-in", Ease::In),
        ("ease-out", Ease::Out),
        ("smooth", Ease::Smooth),
    ];

    /// The share of the way at a share of the time; both from 0 to 1, but for Bezier curves whose handles lie beyond.
    pub fn at(self, time: f64) -> f64 {
        let time = time.clamp(0.0, 1.0);
        match self {
            Ease::Linear => time,
            Ease::In => time * time * time,
            Ease::Out => 1.0 - (1.0 - time).powi(3),
            Ease::InOut => time * time * (3.0 - 2.0 * time),
            Ease::Smooth => time * time * time * (10.0 + time * (6.0 * time - 15.0)),
            Ease::Bezier([x1, y1, x2, y2]) => {
                let curve = |a: f64, b: f64, s: f64| {
                    let rest = 1.0 - s;
                    3.0 * a * s * rest * rest + 3.0 * b * s * s * rest + s * s * s
                };
                // x rises with s where handles lie between the keys, so halving finds it.
                let (mut low, mut high) = (0.0, 1.0);
                for _ in 0..60 {
                    let middle = (low + high) / 2.0;
                    if curve(x1, x2, middle) < time { low = middle } else { high = middle }
                }
                curve(y1, y2, (low + high) / 2.0)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Ease;

    #[test]
    fn easings_begin_and_end_where_they_should() {
        for ease in [Ease::Linear, Ease::In, Ease::Out, Ease::InOut, Ease::Smooth, Ease::Bezier([0.25, 0.1, 0.25, 1.0])]
        {
            assert!(ease.at(0.0).abs() < 1e-9 && (ease.at(1.0) - 1.0).abs() < 1e-9, "{ease:?}");
            assert!(ease.at(0.3) < ease.at(0.4), "{ease:?}");
        }
        assert!(Ease::In.at(0.1) < 0.01 && Ease::Out.at(0.9) > 0.99);
    }

    #[test]
    fn bezier_curves_are_those_of_css() {
        // The keyword `ease` of CSS at half of the time, and a curve that is a line.
        assert!((Ease::Bezier([0.25, 0.1, 0.25, 1.0]).at(0.5) - 0.802_4).abs() < 1e-4);
        assert!((Ease::Bezier([0.3, 0.3, 0.6, 0.6]).at(0.7) - 0.7).abs() < 1e-9);
    }
}
