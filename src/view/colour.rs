//! Colour maps and the axes that values are laid along.

/// How values become places on a colour bar, and those colours.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Axis {
    /// Values from `low` to `high`, both above 0, by their logarithm.
    Log {
        /// The least value of the bar.
        low: f64,
        /// The largest.
        high: f64,
    },
    /// Values of both signs up to `far`, about linear below `near` and logarithmic beyond.
    Signed {
        /// Where the logarithm takes over.
        near: f64,
        /// The largest value of the bar.
        far: f64,
    },
}

impl Axis {
    /// A logarithmic axis that holds the bulk of some values: all but half a percent at each end, in whole steps of 1, 2 and
    /// 5. Values beyond take the colour of the end.
    pub fn fit(values: &[f64]) -> Axis {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite() && *v > 0.0).collect();
        sorted.sort_by(f64::total_cmp);
        if sorted.is_empty() {
            return Axis::Log { low: 1.0, high: 10.0 };
        }
        let [least, most] = [5, 995].map(|part| sorted[(sorted.len() - 1) * part / 1000]);
        let steps = || (-12..=12).flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e)));
        let low = steps().rfind(|s| *s <= least).unwrap_or(least);
        let high = steps().find(|s| *s >= most && *s > low).unwrap_or(most);
        Axis::Log { low, high }
    }

    /// Where a value is on the bar, from 0 to 1; what lies beyond an end is there.
    pub fn place(self, value: f64) -> f64 {
        match self {
            Axis::Log { low, high } => ((value / low).ln() / (high / low).ln()).clamp(0.0, 1.0),
            Axis::Signed { near, far } => {
                let part = (value.abs() / near).ln_1p() / (far / near).ln_1p();
                0.5 + 0.5 * part.min(1.0).copysign(value)
            }
        }
    }

    /// The largest value of the bar.
    pub fn high(self) -> f64 {
        match self {
            Axis::Log { high, .. } => high,
            Axis::Signed { far, .. } => far,
        }
    }

    /// The colour of a value, sRGB from 0 to 1.
    pub fn colour(self, value: f64) -> [f64; 3] {
        self.colour_at(self.place(value))
    }

    /// The colour of a place on the bar.
    pub fn colour_at(self, place: f64) -> [f64; 3] {
        match self {
            Axis::Log { .. } => viridis(place),
            Axis::Signed { .. } => diverging(place),
        }
    }

    /// Values to write beside the bar, the least first.
    pub fn ticks(self) -> Vec<f64> {
        match self {
            Axis::Log { low, high } => {
                let parts: &[f64] = if high / low > 1e3 { &[1.0] } else { &[1.0, 2.0, 5.0] };
                let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
                let all = decades.flat_map(|e| parts.iter().map(move |m| m * 10f64.powi(e)));
                all.filter(|v| (low * 0.999..=high * 1.001).contains(v)).collect()
            }
            Axis::Signed { near, far } => {
                let decades = (far / near).log10().round() as i32;
                let positive: Vec<f64> = (0..=decades).map(|e| near * 10f64.powi(e)).collect();
                let negative = positive.iter().rev().map(|v| -v);
                negative.chain([0.0]).chain(positive.iter().copied()).collect()
            }
        }
    }
}

/// Coefficients of [`viridis`], the constant first.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.277_727_327_223_417_7, 0.005_407_344_544_966_578, 0.334_099_805_335_306_1],
    [0.105_093_043_108_577_4, 1.404_613_529_898_575, 1.384_590_162_594_685],
    [-0.330_861_828_725_556_3, 0.214_847_559_468_213, 0.095_095_163_028_236_59],
    [-4.634_230_498_983_486, -5.799_100_973_351_585, -19.332_440_956_279_87],
    [6.228_269_936_347_081, 14.179_933_366_805_09, 56.690_552_600_681_05],
    [4.776_384_997_670_288, -13.745_145_377_746_01, -65.353_032_633_372_34],
    [-5.435_455_855_934_631, 4.645_852_612_178_535, 26.312_435_249_583_2],
];

/// The map viridis (S. van der Walt and N. Smith, matplotlib, 2015, CC0): even steps look even, and readers without full
/// colour vision see the same order. `x` from 0 (dark) to 1 (light); what is outside takes the end. sRGB.
///
/// A polynomial fitted by M. Zucker (shadertoy.com/view/WlfXRN, 2019, CC0), within 0.01 of the table.
pub fn viridis(x: f64) -> [f64; 3] {
    let x = x.clamp(0.0, 1.0);
    [0, 1, 2].map(|i| VIRIDIS.iter().rev().fold(0.0, |sum, c| sum * x + c[i]).clamp(0.0, 1.0))
}

/// Colours of [`diverging`], the last one the middle's mirror of the first.
const DIVERGING: [u32; 11] = [
    0x05_30_61, 0x21_66_ac, 0x43_93_c3, 0x92_c5_de, 0xd1_e5_f0, 0xf7_f7_f7, 0xfd_db_c7, 0xf4_a5_82, 0xd6_60_4d,
    0xb2_18_2b, 0x67_00_1f,
];

/// A map for values of both signs: blue below, white at 0.5, red above. sRGB.
///
/// RdBu of ColorBrewer 2.0 (C. Brewer, 2002, Apache 2.0), made for readers without full colour vision, with straight lines
/// between its eleven colours.
pub fn diverging(x: f64) -> [f64; 3] {
    let at = x.clamp(0.0, 1.0) * (DIVERGING.len() - 1) as f64;
    let first = (at as usize).min(DIVERGING.len() - 2);
    let share = at - first as f64;
    let (a, b) = (srgb(DIVERGING[first]), srgb(DIVERGING[first + 1]));
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * share)
}

/// The parts of `0xRRGGBB`, from 0 to 1.
pub(super) fn srgb(hex: u32) -> [f64; 3] {
    [16, 8, 0].map(|shift| f64::from((hex >> shift) & 0xff) / 255.0)
}
