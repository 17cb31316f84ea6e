//! Gradients of GIMP (`.ggr`): segments with a curve each, mixed in sRGB or in hue, saturation and value.
//!
//! Source of the format: the developers' page "GIMP gradient file format", devel-docs/ggr.txt.

use super::gradient::Stop;
use super::space::linear;

/// Points of a segment that is not a straight line in sRGB.
const PIECES: usize = 12;

/// A segment: where it begins, has its middle and ends, its colours, and the numbers of its curve and of its way of mixing.
struct Segment {
    places: [f64; 3],
    colours: [[f64; 3]; 2],
    curve: u8,
    mixing: u8,
}

/// The stops of a file's text.
///
/// Errors: the number of the first wrong line, from 1, and what is wrong with it.
pub(super) fn stops(text: &str) -> Result<Vec<Stop>, (usize, String)> {
    let lines: Vec<(usize, &str)> = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).collect();
    let mut rest = lines.iter().filter(|(_, line)| !line.is_empty()).skip(1).peekable();
    rest.next_if(|(_, line)| line.starts_with("Name:"));
    let (number, count) = rest.next().ok_or((1, "it ends before the number of segments".to_string()))?;
    let count: usize =
        count.parse().map_err(|_| (*number, format!("expected the number of segments, found `{count}`")))?;
    let mut stops = Vec::new();
    for _ in 0..count.min(10_000) {
        let (number, line) = rest.next().ok_or((lines.len(), format!("it has fewer than {count} segments")))?;
        let segment = segment(line).ok_or((*number, "expected 13 numbers or more: a segment".to_string()))?;
        segment.push(&mut stops);
    }
    Ok(stops)
}

fn segment(line: &str) -> Option<Segment> {
    let numbers: Vec<f64> = line.split_whitespace().map_while(|part| part.parse().ok()).collect();
    if numbers.len() < 13 || numbers.iter().any(|number: &f64| !number.is_finite()) {
        return None;
    }
    let colour = |from: usize| [numbers[from], numbers[from + 1], numbers[from + 2]];
    Some(Segment {
        places: [numbers[0], numbers[1], numbers[2]],
        colours: [colour(3), colour(7)],
        curve: numbers[11] as u8,
        mixing: numbers[12] as u8,
    })
}

impl Segment {
    fn push(&self, stops: &mut Vec<Stop>) {
        let [left, _, right] = self.places;
        for i in 0..=PIECES {
            let share = i as f64 / PIECES as f64;
            let mixed = self.mixed(self.weight(share));
            stops.push(Stop { at: left + (right - left) * share, colour: mixed.map(|x| linear(x.clamp(0.0, 1.0))) });
        }
    }

    /// How much of the right colour there is at a share of the way.
    fn weight(&self, share: f64) -> f64 {
        let [left, middle, right] = self.places;
        let middle = ((middle - left) / (right - left).max(1e-12)).clamp(1e-6, 1.0 - 1e-6);
        let straight = match share <= middle {
            true => 0.5 * share / middle,
            false => 0.5 + 0.5 * (share - middle) / (1.0 - middle),
        };
        match self.curve {
            1 => share.powf(0.5f64.ln() / middle.ln()),
            2 => 0.5 - 0.5 * (straight * std::f64::consts::PI).cos(),
            3 => (1.0 - (straight - 1.0).powi(2)).max(0.0).sqrt(),
            4 => 1.0 - (1.0 - straight * straight).max(0.0).sqrt(),
            5 => f64::from(u8::from(share >= middle)),
            _ => straight,
        }
    }

    fn mixed(&self, weight: f64) -> [f64; 3] {
        let [a, b] = self.colours;
        if self.mixing == 0 {
            return [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * weight);
        }
        let (a, b) = (hsv(a), hsv(b));
        // 1 turns through the hues upwards, 2 downwards.
        let mut turn = b[0] - a[0];
        match self.mixing {
            1 if turn < 0.0 => turn += 1.0,
            2 if turn > 0.0 => turn -= 1.0,
            _ => {}
        }
        let hue = a[0] + turn * weight;
        rgb([hue - hue.floor(), a[1] + (b[1] - a[1]) * weight, a[2] + (b[2] - a[2]) * weight])
    }
}

fn hsv([r, g, b]: [f64; 3]) -> [f64; 3] {
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let range = most - least;
    if range <= 0.0 {
        return [0.0, 0.0, most];
    }
    let hue = if most == r {
        (g - b) / range
    } else if most == g {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    };
    [(hue / 6.0).rem_euclid(1.0), range / most, most]
}

fn rgb([hue, saturation, value]: [f64; 3]) -> [f64; 3] {
    [5.0, 3.0, 1.0].map(|offset| {
        let k: f64 = (offset + hue * 6.0) % 6.0;
        value - value * saturation * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}
