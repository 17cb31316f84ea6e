//! What was moved since a formula's file was read.

use std::collections::BTreeMap;

use crate::engine::Formula;
use crate::explore::{Number, numbers};
use crate::graph::{Camera, PRESET};

/// What was moved since a formula's file was read.
#[derive(Clone, Default, PartialEq, Debug)]
pub struct Sight {
    /// The preset that is shown.
    pub preset: Option<String>,
    /// Numbers by their paths, as `--set` names them.
    pub numbers: BTreeMap<String, f64>,
    /// Where the camera was moved to.
    pub camera: Option<Camera>,
}

impl Sight {
    /// The changes that make the formula: pairs of a path and a value in RON.
    pub fn changes(&self) -> Vec<(String, String)> {
        let preset = self.preset.iter().map(|name| (PRESET.to_string(), format!("{name:?}")));
        preset.chain(self.numbers.iter().map(|(path, value)| (path.clone(), value.to_string()))).collect()
    }

    /// Whether anything was moved.
    pub fn is_moved(&self) -> bool {
        *self != Sight::default()
    }
}

/// A number of a formula that a hand can move.
#[derive(Clone, PartialEq, Debug)]
pub struct Slider {
    /// Where it stands, as `--set` names it.
    pub path: String,
    /// What it does, with its unit; empty where the file does not say.
    pub help: String,
    /// Least and greatest value that are shown: the range, or the part of a wide range around the value.
    pub range: [f64; 2],
    /// Its value in the file.
    pub value: f64,
    /// Whether it is whole.
    pub is_whole: bool,
}

/// Values from one end of a slider to the other, at most, as multiples of what the file has.
const WIDEST: f64 = 4.0;

/// The numbers of a formula that have a range: its parameters, those of its steps, its constant. Empty where it cannot be read as a tree.
pub fn sliders(formula: &Formula) -> Vec<Slider> {
    let slider = |number: Number| {
        let Number { path, help, range: [least, most], value, is_whole } = number;
        let reach = 0.5 * WIDEST * value.abs().max(1.0);
        let is_wide = most - least > 4.0 * reach;
        let range = if is_wide { [least.max(value - reach), most.min(value + reach)] } else { [least, most] };
        Slider { path, help, range, value, is_whole }
    };
    numbers(formula).into_iter().filter(|number| number.range[0] < number.range[1]).map(slider).collect()
}
