//! Values that move from frame to frame, as the command line says them.

use std::str::FromStr;

/// A name, and the numbers that it has in the first and in the last frame.
#[derive(Clone, PartialEq, Debug)]
pub struct Range {
    /// A parameter, or a part of the view.
    pub name: String,
    ends: [Vec<f64>; 2],
}

/// Parts of the view, and their numbers.
const VIEW: [(&str, usize); 5] = [("camera", 3), ("target", 3), ("up", 3), ("fov", 1), ("turn", 1)];

impl Range {
    /// The value at a share of the way, from 0 to 1: exactly the ends there.
    pub fn at(&self, share: f64) -> Vec<f64> {
        let [from, to] = &self.ends;
        from.iter().zip(to).map(|(a, b)| a * (1.0 - share) + b * share).collect()
    }

    /// A value as formula files write it.
    pub fn ron(value: &[f64]) -> String {
        let numbers: Vec<String> = value.iter().map(f64::to_string).collect();
        if numbers.len() == 1 { numbers[0].clone() } else { format!("({})", numbers.join(", ")) }
    }
}

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Range, String> {
        let expected = "write NAME=FROM..TO such as power=2..12 or target=0,0,0..0,0,1";
        let (name, ends) = text.split_once('=').ok_or(expected)?;
        let (from, to) = ends.split_once("..").ok_or(expected)?;
        let (name, ends) = (name.trim().to_string(), [numbers(from)?, numbers(to)?]);
        if name.is_empty() {
            return Err(expected.into());
        }
        let [from, to] = &ends;
        if from.len() != to.len() {
            return Err(format!("one end has {} numbers and the other {}", from.len(), to.len()));
        }
        if let Some((_, count)) = VIEW.iter().find(|(view, _)| *view == name)
            && from.len() != *count
        {
            return Err(format!("`{name}` takes {count} numbers, not {}", from.len()));
        }
        if name == "fov" && ends.iter().any(|end| !(0.001..=175.0).contains(&end[0])) {
            return Err("`fov` must be from 0.001 to 175 degrees".into());
        }
        Ok(Range { name, ends })
    }
}

/// Reads numbers between commas, in parentheses or without.
fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let text = text.trim();
    let inner = text.strip_prefix('(').and_then(|t| t.strip_suffix(')')).unwrap_or(text);
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err(format!("`{}` is not a number", part.trim())),
    };
    inner.split(',').map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::Range;

    #[test]
    fn ranges_meet_their_ends_exactly() {
        let range: Range = "bulb.power = -0.1..12.3".parse().unwrap();
        assert_eq!((range.name.as_str(), range.at(0.0), range.at(1.0)), ("bulb.power", vec![-0.1], vec![12.3]));
        let range: Range = "camera=(1,2,3)..3,2,1".parse().unwrap();
        assert_eq!(range.at(0.5), [2.0, 2.0, 2.0]);
        assert_eq!(Range::ron(&range.at(0.25)), "(1.5, 2, 2.5)");
    }

    #[test]
    fn wrong_ranges_are_refused() {
        for wrong in ["power", "power=2", "=1..2", "power=a..2", "camera=1..2", "x=1,2..3", "fov=0..10", "x=nan..1"] {
            assert!(wrong.parse::<Range>().is_err(), "{wrong}");
        }
    }
}
