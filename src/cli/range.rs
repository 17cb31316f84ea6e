//! Values that move from frame to frame, as the command line says them.

use std::str::FromStr;

/// A name, and what it is in each frame.
#[derive(Clone, PartialEq, Debug)]
pub struct Range {
    /// A parameter, a path into the file, or a part of the view.
    pub name: String,
    values: Values,
}

#[derive(Clone, PartialEq, Debug)]
enum Values {
    /// Numbers in the first and in the last frame.
    Ends([Vec<f64>; 2]),
    /// A value for each frame, as formula files write it.
    List(Vec<String>),
}

/// Parts of the view, and their numbers.
const VIEW: [(&str, usize); 5] = [("camera", 3), ("target", 3), ("up", 3), ("fov", 1), ("turn", 1)];

/// Fields of a file's camera, and the parts of the view that they are.
const CAMERA: [(&str, &str); 4] =
    [("camera.position", "camera"), ("camera.target", "target"), ("camera.up", "up"), ("camera.fov", "fov")];

impl Range {
    /// Its numbers in a frame, counted from 0: exactly the ends in the first and last. Whole ends give whole numbers wherever
    /// the way falls on one.
    pub fn numbers(&self, frame: impl Into<f64>, frames: u32) -> Vec<f64> {
        let (frame, last) = (frame.into(), f64::from(frames.saturating_sub(1).max(1)));
        let between = |a: f64, b: f64| match a.fract() == 0.0 && b.fract() == 0.0 {
            true => a + (b - a) * frame / last,
            false => a * (1.0 - frame / last) + b * (frame / last),
        };
        match &self.values {
            Values::Ends([from, to]) => from.iter().zip(to).map(|(a, b)| between(*a, *b)).collect(),
            // What is no number was refused when the list was read, where numbers must be.
            Values::List(list) => {
                list.get(frame.round() as usize).and_then(|text| numbers(text).ok()).unwrap_or_default()
            }
        }
    }

    /// Its value in a frame as formula files write it.
    pub fn ron(&self, frame: impl Into<f64>, frames: u32) -> String {
        let frame = frame.into();
        if let Values::List(list) = &self.values {
            return list.get(frame.round() as usize).cloned().unwrap_or_default();
        }
        let numbers: Vec<String> = self.numbers(frame, frames).iter().map(f64::to_string).collect();
        if numbers.len() == 1 { numbers[0].clone() } else { format!("({})", numbers.join(", ")) }
    }

    /// Whether it moves the view, and not the formula.
    pub fn is_of_view(&self) -> bool {
        VIEW.iter().any(|(view, _)| *view == self.name)
    }

    /// Frames that it has values for; any number where it has two ends.
    pub fn frames(&self) -> Option<usize> {
        match &self.values {
            Values::Ends(_) => None,
            Values::List(list) => Some(list.len()),
        }
    }
}

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Range, String> {
        let expected = "write NAME=FROM..TO such as power=2..12 or target=0,0,0..0,0,1, or a list such as seed=3,7,18";
        let (name, values) = text.split_once('=').ok_or(expected)?;
        let name = name.trim();
        if name.is_empty() {
            return Err(expected.into());
        }
        let name = CAMERA.iter().find(|(field, _)| *field == name).map_or(name, |(_, part)| part).to_string();
        let values = match values.split_once("..") {
            Some((from, to)) => Values::Ends([numbers(from)?, numbers(to)?]),
            None => Values::List(list(values).filter(|list| list.len() > 1).ok_or(expected)?),
        };
        let all = match &values {
            Values::Ends([from, to]) if from.len() != to.len() => {
                return Err(format!("one end has {} numbers and the other {}", from.len(), to.len()));
            }
            Values::Ends(ends) => ends.to_vec(),
            Values::List(list) if VIEW.iter().any(|(view, _)| *view == name) => {
                list.iter().map(|text| numbers(text)).collect::<Result<_, _>>()?
            }
            Values::List(_) => Vec::new(),
        };
        if let Some((_, count)) = VIEW.iter().find(|(view, _)| *view == name)
            && let Some(odd) = all.iter().find(|numbers| numbers.len() != *count)
        {
            return Err(format!("`{name}` takes {count} numbers, not {}", odd.len()));
        }
        if name == "fov" && all.iter().any(|end| !(0.001..=360.0).contains(&end[0])) {
            return Err("`fov` must be from 0.001 to 360 degrees".into());
        }
        Ok(Range { name, values })
    }
}

/// Values between the commas outside of brackets and quotes; nothing if one is empty or a bracket is not closed.
fn list(text: &str) -> Option<Vec<String>> {
    let (mut depth, mut quoted, mut items) = (0i32, false, vec![String::new()]);
    for c in text.chars() {
        match c {
            '"' => quoted = !quoted,
            '(' | '[' | '{' if !quoted => depth += 1,
            ')' | ']' | '}' if !quoted => depth -= 1,
            ',' if !quoted && depth == 0 => {
                items.push(String::new());
                continue;
            }
            _ => {}
        }
        items.last_mut()?.push(c);
    }
    let items: Vec<String> = items.iter().map(|item| item.trim().to_string()).collect();
    (depth == 0 && !quoted && items.iter().all(|item| !item.is_empty())).then_some(items)
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
        assert_eq!(
            (range.name.as_str(), range.numbers(0, 7), range.numbers(6, 7)),
            ("bulb.power", vec![-0.1], vec![12.3])
        );
        let range: Range = "camera=(1,2,3)..3,2,1".parse().unwrap();
        assert_eq!(range.numbers(1, 3), [2.0, 2.0, 2.0]);
        assert_eq!(range.ron(1, 5), "(1.5, 2, 2.5)");
        assert_eq!(range.numbers(0, 1), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn whole_numbers_stay_whole() {
        for (text, frames) in [("seed=1..20", 20), ("seed=0..297", 100), ("seed=-50..48", 99), ("seed=20..1", 20)] {
            let range: Range = text.parse().unwrap();
            let texts: Vec<String> = (0..frames).map(|frame| range.ron(frame, frames)).collect();
            assert!(texts.iter().all(|text| text.parse::<i64>().is_ok()), "{text}: {texts:?}");
        }
    }

    #[test]
    fn lists_give_a_value_to_each_frame() {
        let range: Range = "seed = 3, 7,18".parse().unwrap();
        assert_eq!((range.frames(), range.ron(1, 3), range.ron(2, 3)), (Some(3), "7".into(), "18".into()));
        let range: Range = "camera.position=(1,2,3),(3,2,1)".parse().unwrap();
        assert_eq!((range.name.as_str(), range.numbers(1, 2)), ("camera", vec![3.0, 2.0, 1.0]));
        let range: Range = "estimate.method=scalar,gradient".parse().unwrap();
        assert_eq!(range.ron(1, 2), "gradient");
    }

    #[test]
    fn wrong_ranges_are_refused() {
        let wrong = [
            "power",
            "power=2",
            "=1..2",
            "power=a..2",
            "camera=1..2",
            "x=1,2..3",
            "fov=0..10",
            "x=nan..1",
            "x=1,,2",
            "x=(1,2",
            "camera=1,2",
            "fov=40,400",
            "turn=a,b",
        ];
        for wrong in wrong {
            assert!(wrong.parse::<Range>().is_err(), "{wrong}");
        }
    }
}
