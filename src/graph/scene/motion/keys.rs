//! Values between keys: numbers, points and colours that move from one key to the next.

use super::ease::Ease;
use crate::colour::{from_oklab, oklab};
use crate::diag::Span;
use crate::formula::value::{Value, ValueKind};

/// What a track holds at a time.
#[derive(Clone, PartialEq, Debug)]
pub enum Moving {
    /// A number, or several that move together, such as a point.
    Numbers(Vec<f64>),
    /// A colour, linear; it moves through OKLab (Ottosson, 2020).
    Colour([f64; 3]),
    /// Anything else: it jumps at its keys.
    Fixed(Value),
}

/// A value at a time.
#[derive(Clone, PartialEq, Debug)]
pub struct Key {
    /// Seconds from the film's start.
    pub time: f64,
    /// The value there.
    pub value: Moving,
    /// The way to it from the key before; the track's where absent.
    pub way: Option<Way>,
}

/// The way from one key to the next.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Way {
    /// In proportion to the time, or to what a curve makes of it.
    Eased(Ease),
    /// The earlier value up to the later key.
    Step,
    /// A cubic whose slopes never overshoot (Fritsch and Butland, 1984); it passes keys smoothly.
    Monotone,
    /// A centripetal Catmull-Rom curve (Yuksel, Schaefer and Keyser, 2011); it passes keys smoothly, and may overshoot.
    CatmullRom,
}

/// What comes before the first key and after the last.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Repeat {
    /// The first and the last value.
    #[default]
    Hold,
    /// All again from the first key.
    Loop,
    /// All backwards, and then again.
    Mirror,
}

/// A track of keys: at least one, in the order of their times.
#[derive(Clone, PartialEq, Debug)]
pub struct Keys {
    keys: Vec<Key>,
    way: Way,
    repeat: Repeat,
}

impl Keys {
    /// A track of keys in the order of their times. With `turn`, numbers go to each key the short way around, where so much is a whole turn.
    ///
    /// Errors: no key; times that do not rise; values of different kinds; values that can only jump and are asked to do more.
    pub fn new(mut keys: Vec<Key>, way: Way, repeat: Repeat, turn: Option<f64>) -> Result<Keys, String> {
        let Some(first) = keys.first() else { return Err("a track needs a key".into()) };
        if let Some(pair) = keys.windows(2).find(|pair| pair[0].time >= pair[1].time) {
            return Err(format!("the key at {} s comes after the one at {} s", pair[1].time, pair[0].time));
        }
        let is_alike = |key: &Key| match (&first.value, &key.value) {
            (Moving::Numbers(a), Moving::Numbers(b)) => a.len() == b.len(),
            (a, b) => std::mem::discriminant(a) == std::mem::discriminant(b),
        };
        if let Some(odd) = keys.iter().find(|key| !is_alike(key)) {
            return Err(format!("the value at {} s is of another kind than the first one", odd.time));
        }
        if let Some(turn) = turn {
            unwind(&mut keys, turn);
        }
        Ok(Keys { keys, way, repeat })
    }

    /// The keys, in the order of their times.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// The value at a time, in seconds.
    pub fn at(&self, time: f64) -> Moving {
        let time = self.folded(time);
        let keys = &self.keys;
        let last = keys.len() - 1;
        if time <= keys[0].time {
            return keys[0].value.clone();
        }
        if time >= keys[last].time {
            return keys[last].value.clone();
        }
        let after = keys.partition_point(|key| key.time <= time);
        match keys[after].way.unwrap_or(self.way) {
            Way::Step => keys[after - 1].value.clone(),
            way => self.between(after, time, way),
        }
    }

    /// A time within the keys.
    fn folded(&self, time: f64) -> f64 {
        let (first, last) = (self.keys[0].time, self.keys[self.keys.len() - 1].time);
        let span = last - first;
        match self.repeat {
            Repeat::Hold => time,
            _ if span <= 0.0 => time,
            Repeat::Loop => first + (time - first).rem_euclid(span),
            Repeat::Mirror => first + span - ((time - first).rem_euclid(2.0 * span) - span).abs(),
        }
    }

    /// The value between the key before `after` and this one.
    fn between(&self, after: usize, time: f64, way: Way) -> Moving {
        let (from, to) = (&self.keys[after - 1], &self.keys[after]);
        let share = (time - from.time) / (to.time - from.time);
        let mixed = |numbers: &dyn Fn(&Moving) -> Vec<f64>| match way {
            Way::Eased(ease) => mix(&numbers(&from.value), &numbers(&to.value), ease.at(share)),
            Way::Monotone => self.monotone(after, share, numbers),
            Way::CatmullRom => self.catmull_rom(after, share, numbers),
            Way::Step => numbers(&from.value),
        };
        match &from.value {
            Moving::Numbers(_) => Moving::Numbers(mixed(&Moving::numbers)),
            Moving::Colour(_) => {
                let lab = mixed(&|value| oklab(value.rgb()).to_vec());
                Moving::Colour(from_oklab([lab[0], lab[1], lab[2]]).map(|part| part.max(0.0)))
            }
            Moving::Fixed(_) => from.value.clone(),
        }
    }

    /// Time and numbers of a key; those of repeated tracks go on beyond the ends.
    fn neighbour(&self, at: isize, numbers: &dyn Fn(&Moving) -> Vec<f64>) -> Option<(f64, Vec<f64>)> {
        let (keys, last) = (&self.keys, self.keys.len() as isize - 1);
        let span = keys[last as usize].time - keys[0].time;
        let (at, moved) = match (at, self.repeat) {
            (0.., _) if at <= last => (at, 0.0),
            (-1, Repeat::Loop) => (last - 1, -span),
            (_, Repeat::Loop) if at == last + 1 => (1, span),
            _ => return None,
        };
        let key = &keys[at as usize];
        Some((key.time + moved, numbers(&key.value)))
    }

    /// Hermite interpolation with slopes that keep the values between those of the keys.
    fn monotone(&self, after: usize, share: f64, numbers: &dyn Fn(&Moving) -> Vec<f64>) -> Vec<f64> {
        let near: Vec<Option<(f64, Vec<f64>)>> =
            (-2..=1).map(|i| self.neighbour(after as isize + i, numbers)).collect();
        let [before, from, to, behind] = [0, 1, 2, 3].map(|i| near[i].as_ref());
        let (Some(from), Some(to)) = (from, to) else { return Vec::new() };
        let width = to.0 - from.0;
        let part = |k: usize| {
            let rise = |a: &(f64, Vec<f64>), b: &(f64, Vec<f64>)| ((b.1[k] - a.1[k]) / (b.0 - a.0), b.0 - a.0);
            let own = rise(from, to);
            let slope = |other: Option<(f64, f64)>| other.map_or(own.0, |other| harmonic(other, own));
            let slopes = [slope(before.map(|key| rise(key, from))), slope(behind.map(|key| rise(to, key)))];
            hermite([from.1[k], to.1[k]], slopes.map(|slope| slope * width), share)
        };
        (0..from.1.len()).map(part).collect()
    }

    /// The curve of Barry and Goldman (1988) through four neighbours, whose knots are as far apart as the roots of their distances.
    fn catmull_rom(&self, after: usize, share: f64, numbers: &dyn Fn(&Moving) -> Vec<f64>) -> Vec<f64> {
        let point = |i: isize| self.neighbour(after as isize + i, numbers).map(|(_, point)| point);
        let (Some(from), Some(to)) = (point(-1), point(0)) else { return Vec::new() };
        // Beyond the ends the curve goes straight on.
        let before = point(-2).unwrap_or_else(|| mix(&to, &from, 2.0));
        let behind = point(1).unwrap_or_else(|| mix(&from, &to, 2.0));
        centripetal([&before, &from, &to, &behind], share)
    }
}

impl Moving {
    fn numbers(&self) -> Vec<f64> {
        match self {
            Moving::Numbers(numbers) => numbers.clone(),
            Moving::Colour(colour) => colour.to_vec(),
            Moving::Fixed(_) => Vec::new(),
        }
    }

    fn rgb(&self) -> [f64; 3] {
        match self {
            Moving::Colour(colour) => *colour,
            _ => [0.0; 3],
        }
    }

    /// The value as files write it.
    pub fn ron(&self) -> String {
        let joined = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        match self {
            Moving::Numbers(numbers) if numbers.len() == 1 => numbers[0].to_string(),
            Moving::Numbers(numbers) => format!("({})", joined(numbers)),
            Moving::Colour(colour) => format!("({})", joined(colour)),
            Moving::Fixed(value) => value.kind.to_string(),
        }
    }

    /// The value as if it stood at a place of a file.
    pub fn value(&self, span: Span) -> Value {
        let number = |number: &f64| Value::new(span, ValueKind::Number(*number));
        match self {
            Moving::Numbers(numbers) if numbers.len() == 1 => number(&numbers[0]),
            Moving::Numbers(numbers) => Value::new(span, ValueKind::List(numbers.iter().map(number).collect())),
            Moving::Colour(colour) => Value::new(span, ValueKind::List(colour.iter().map(number).collect())),
            Moving::Fixed(value) => value.clone(),
        }
    }
}

/// Makes every number of a key the one of its turns that is the nearest to the key before.
fn unwind(keys: &mut [Key], turn: f64) {
    for i in 1..keys.len() {
        let (done, rest) = keys.split_at_mut(i);
        if let (Moving::Numbers(before), Moving::Numbers(numbers)) = (&done[i - 1].value, &mut rest[0].value) {
            for (number, before) in numbers.iter_mut().zip(before) {
                *number -= ((*number - before) / turn).round() * turn;
            }
        }
    }
}

/// A share of the way from one list of numbers to another; exact at both ends.
pub fn mix(from: &[f64], to: &[f64], share: f64) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| if share == 1.0 { *b } else { a + (b - a) * share }).collect()
}

/// The weighted harmonic mean of two slopes with the widths that they hold for; 0 where they differ in sign.
fn harmonic((a, before): (f64, f64), (b, behind): (f64, f64)) -> f64 {
    if a * b <= 0.0 {
        return 0.0;
    }
    let [first, second] = [2.0 * behind + before, behind + 2.0 * before];
    (first + second) / (first / a + second / b)
}

/// The cubic with these ends and slopes, at a share of the way.
fn hermite([from, to]: [f64; 2], [leaving, arriving]: [f64; 2], t: f64) -> f64 {
    let (squared, cubed) = (t * t, t * t * t);
    from * (2.0 * cubed - 3.0 * squared + 1.0)
        + leaving * (cubed - 2.0 * squared + t)
        + to * (3.0 * squared - 2.0 * cubed)
        + arriving * (cubed - squared)
}

/// A centripetal Catmull-Rom curve between the second and the third of four points, at a share of the way.
pub fn centripetal(points: [&[f64]; 4], share: f64) -> Vec<f64> {
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().powf(0.25);
    let middle = apart(points[1], points[2]);
    if middle == 0.0 {
        return points[1].to_vec();
    }
    // Equal points would have no way between them.
    let least = middle * 1e-3;
    let mut knots = [0.0; 4];
    for i in 1..4 {
        knots[i] = knots[i - 1] + apart(points[i - 1], points[i]).max(least);
    }
    let u = knots[1] + (knots[2] - knots[1]) * share;
    let blend = |a: &[f64], b: &[f64], from: usize, to: usize| mix(a, b, (u - knots[from]) / (knots[to] - knots[from]));
    let [a, b, c] = [0, 1, 2].map(|i| blend(points[i], points[i + 1], i, i + 1));
    let (d, e) = (blend(&a, &b, 0, 2), blend(&b, &c, 1, 3));
    blend(&d, &e, 1, 2)
}

#[cfg(test)]
mod tests {
    use super::{Key, Keys, Moving, Repeat, Way};
    use crate::graph::scene::motion::ease::Ease;

    const LINEAR: Way = Way::Eased(Ease::Linear);

    fn track(points: &[(f64, f64)], way: Way, repeat: Repeat) -> Keys {
        let key = |(time, value): &(f64, f64)| Key { time: *time, value: Moving::Numbers(vec![*value]), way: None };
        Keys::new(points.iter().map(key).collect(), way, repeat, None).expect("it is a track")
    }

    fn number(keys: &Keys, time: f64) -> f64 {
        match keys.at(time) {
            Moving::Numbers(numbers) => numbers[0],
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_way_meets_its_keys() {
        let points = [(0.0, 1.0), (1.0, 3.0), (2.0, 2.5), (4.0, -1.0)];
        for way in [LINEAR, Way::Step, Way::Monotone, Way::CatmullRom, Way::Eased(Ease::InOut)] {
            let keys = track(&points, way, Repeat::Hold);
            for (time, value) in points {
                assert!((number(&keys, time) - value).abs() < 1e-12, "{way:?} at {time}");
            }
            assert_eq!((number(&keys, -1.0), number(&keys, 9.0)), (1.0, -1.0), "{way:?}");
        }
        assert_eq!(number(&track(&points, Way::Step, Repeat::Hold), 0.999), 1.0);
        assert_eq!(number(&track(&points, LINEAR, Repeat::Hold), 3.0), 0.75);
    }

    #[test]
    fn monotone_tracks_never_overshoot_and_never_jump() {
        let points = [(0.0, 0.0), (1.0, 0.0), (1.2, 5.0), (3.0, 5.0), (4.0, 4.0), (5.0, 9.0)];
        let keys = track(&points, Way::Monotone, Repeat::Hold);
        let mut before = 0.0;
        for i in 0..=5000 {
            let (time, value) = (f64::from(i) * 1e-3, number(&keys, f64::from(i) * 1e-3));
            let after = points.partition_point(|(t, _)| *t <= time).clamp(1, 5);
            let (low, high) = (points[after - 1].1.min(points[after].1), points[after - 1].1.max(points[after].1));
            assert!((low - 1e-9..=high + 1e-9).contains(&value), "{time}: {value}");
            assert!((value - before).abs() < 0.06, "{time}: {before} to {value}");
            before = value;
        }
    }

    #[test]
    fn a_catmull_rom_track_through_a_line_is_the_line() {
        let keys = track(&[(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (3.0, 3.0)], Way::CatmullRom, Repeat::Hold);
        for i in 0..=30 {
            let time = f64::from(i) * 0.1;
            assert!((number(&keys, time) - time).abs() < 1e-9, "{time}");
        }
    }

    #[test]
    fn tracks_repeat() {
        let points = [(1.0, 0.0), (2.0, 2.0), (3.0, 0.0)];
        let (around, back) = (track(&points, LINEAR, Repeat::Loop), track(&points[..2], LINEAR, Repeat::Mirror));
        for (time, value) in [(0.5, 1.0), (1.5, 1.0), (3.5, 1.0), (4.0, 2.0), (5.25, 0.5)] {
            assert!((number(&around, time) - value).abs() < 1e-12, "{time}");
            assert!((number(&back, time) - value).abs() < 1e-12, "{time}");
        }
        // The slope at the seam is the same from both sides.
        let smooth = track(&[(0.0, 1.0), (1.0, 2.0), (2.0, 0.0), (3.0, 1.0)], Way::CatmullRom, Repeat::Loop);
        let slope = |a: f64, b: f64| (number(&smooth, b) - number(&smooth, a)) / (b - a);
        assert!((slope(2.9999, 2.999_99) - slope(3.000_01, 3.0001)).abs() < 1e-2);
    }

    #[test]
    fn angles_go_the_short_way() {
        let key = |time, value| Key { time, value: Moving::Numbers(vec![value]), way: None };
        let keys = Keys::new(vec![key(0.0, 350.0), key(1.0, 10.0), key(2.0, 340.0)], LINEAR, Repeat::Hold, Some(360.0));
        let keys = keys.expect("it is a track");
        assert_eq!((number(&keys, 0.5), number(&keys, 1.5)), (360.0, 355.0));
    }

    #[test]
    fn colours_move_through_oklab() {
        let key = |time, colour| Key { time, value: Moving::Colour(colour), way: None };
        let keys = vec![key(0.0, [0.0; 3]), key(1.0, [1.0; 3])];
        let keys = Keys::new(keys, LINEAR, Repeat::Hold, None).expect("it is a track");
        // Half of the lightness of white is an eighth of its light.
        let Moving::Colour(grey) = keys.at(0.5) else { panic!("it is a colour") };
        assert!(grey.iter().all(|part| (part - 0.125).abs() < 1e-3), "{grey:?}");
    }

    #[test]
    fn what_is_no_track_is_refused() {
        let key = |time, value| Key { time, value, way: None };
        let one = || Moving::Numbers(vec![1.0]);
        for keys in [
            vec![],
            vec![key(1.0, one()), key(1.0, one())],
            vec![key(0.0, one()), key(1.0, Moving::Numbers(vec![1.0, 2.0]))],
            vec![key(0.0, one()), key(1.0, Moving::Colour([0.0; 3]))],
        ] {
            assert!(Keys::new(keys.clone(), LINEAR, Repeat::Hold, None).is_err(), "{keys:?}");
        }
    }
}
