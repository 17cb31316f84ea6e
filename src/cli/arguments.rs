//! Arguments that several commands take, and how they are read.

use std::path::PathBuf;

use bulbfold::calibrate::Budget;
use bulbfold::engine::{BackendChoice, Request};
use bulbfold::graph::{
    Curve, DeForm, Difference, DifferenceStep, EstimateSettings, Film, MOST_STEPS, Method, PRESET, Quality, StopAt,
};
use bulbfold::math::Precision;
use bulbfold::shade::Size;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;

/// Where kernels run.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum BackendArg {
    /// A hardware GPU if there is one, else the CPU.
    Auto,
    /// The embedded CPU back end.
    Cpu,
    /// Any GPU adapter, also one in software.
    Gpu,
}

impl BackendArg {
    /// As the engine takes it.
    pub fn choice(self) -> BackendChoice {
        match self {
            BackendArg::Auto => BackendChoice::Auto,
            BackendArg::Cpu => BackendChoice::Cpu,
            BackendArg::Gpu => BackendChoice::Gpu,
        }
    }
}

/// Reads a precision by its name.
pub fn precision_parser() -> impl TypedValueParser<Value = Precision> {
    let help = |precision| match precision {
        Precision::F32 => "Single precision, many rays at a time",
        Precision::F64 => "Double precision, on the CPU",
    };
    let names = Precision::ALL.map(|precision| PossibleValue::new(precision.name()).help(help(precision)));
    let named = |name: String| Precision::ALL.into_iter().find(|precision| precision.name() == name);
    PossibleValuesParser::new(names).try_map(move |name| named(name).ok_or("no such precision"))
}

/// Precision of a picture.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum PicturePrecision {
    /// Single where the view's pixels are coarse enough for it, else double.
    Auto,
    /// Single precision, many rays at a time.
    F32,
    /// Double precision, on the CPU.
    F64,
}

impl PicturePrecision {
    /// What was asked for; nothing with `auto`.
    pub fn given(self) -> Option<Precision> {
        match self {
            PicturePrecision::Auto => None,
            PicturePrecision::F32 => Some(Precision::F32),
            PicturePrecision::F64 => Some(Precision::F64),
        }
    }
}

/// How distances are estimated: a method, or the file's, else the cheapest that is right.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct DeArg(pub Option<Method>);

/// Final form of the estimate, or the file's, else the one that fits the orbit's growth.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct FormArg(pub Option<DeForm>);

const AUTO: &str = "auto";

impl ValueEnum for DeArg {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: [DeArg; Method::ALL.len() + 1] = {
            let mut all = [DeArg(None); Method::ALL.len() + 1];
            let mut i = 0;
            while i < Method::ALL.len() {
                all[i + 1] = DeArg(Some(Method::ALL[i]));
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(match self.0 {
            None => PossibleValue::new(AUTO).help("the file's, else the cheapest that is right"),
            Some(method) => PossibleValue::new(method.name()).help(method.summary()),
        })
    }
}

impl ValueEnum for FormArg {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: [FormArg; DeForm::ALL.len() + 1] = {
            let mut all = [FormArg(None); DeForm::ALL.len() + 1];
            let mut i = 0;
            while i < DeForm::ALL.len() {
                all[i + 1] = FormArg(Some(DeForm::ALL[i]));
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(match self.0 {
            None => PossibleValue::new(AUTO).help("the file's, else the one that fits the orbit's growth"),
            Some(form) => PossibleValue::new(form.name()).help(form.summary()),
        })
    }
}

/// The distance estimate.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Estimate")]
pub struct EstimateArgs {
    /// Distance estimate
    #[arg(long, value_enum, default_value = AUTO, value_name = "METHOD")]
    pub de: DeArg,
    /// Form of the estimate
    #[arg(long, value_enum, default_value = AUTO, value_name = "FORM")]
    pub form: FormArg,
    /// Step multiplier, above 0 and at most 1
    #[arg(long, value_name = "F", value_parser = parse_fudge)]
    pub fudge: Option<f64>,
    /// Quantity of finite differences: r, ln-r or z [default: the one that fits method and form]
    #[arg(long, value_name = "OF", value_parser = parse_difference)]
    pub difference: Option<Difference>,
    /// Step of finite differences: a length in world units, or a percentage of the estimate [default: 1%]
    #[arg(long, value_name = "H", value_parser = parse_difference_step)]
    pub difference_step: Option<DifferenceStep>,
    /// Shortest step of a ray as a share of the hit threshold, above 0 and at most 1 [default: 0.25]
    #[arg(long, value_name = "S", value_parser = parse_fudge)]
    pub least_step: Option<f64>,
    /// Longest step of a ray in hit thresholds, from 0.01 to 1e6: for estimates that are too long [default: none]
    #[arg(long, value_name = "S", value_parser = parse_most_step)]
    pub most_step: Option<f64>,
    /// Let orbits run on until they escape, even where a pixel shows nothing of what they would still do
    #[arg(long)]
    pub late_ends: bool,
    /// Stop where the estimate is below so many pixels, or world units (0.01u), as other programs do, and not at the set
    /// itself: faster, softer and in front of it. Nothing is calibrated then, and proofs ignore it
    #[arg(long, value_name = "PIXELS|UNITSu", value_parser = StopAt::parse)]
    pub stop_at: Option<StopAt>,
}

/// The distance estimate, where it can be measured.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Estimate")]
pub struct AutoArgs {
    #[command(flatten)]
    pub estimate: EstimateArgs,
    /// Measure which estimate is the cheapest that keeps the error budget, or choose by rules
    #[arg(long, value_name = "on|off", default_value = "on", value_parser = parse_switch)]
    pub calibrate: Switch,
    /// Another goal than the cheapest: `proof` takes proven steps at any price
    #[arg(long, value_enum, value_name = "QUALITY")]
    pub quality: Option<QualityArg>,
    /// Allowed errors: hits missed, stops too early, median depth error in footprints
    #[arg(long, value_name = "M%,E%,D", default_value = "0.5%,5%,0.5", value_parser = parse_budget)]
    pub error_budget: Budget,
}

/// What the choice of an estimate goes for besides the error budget.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum QualityArg {
    /// Steps that are proven, at any price.
    Proof,
}

impl AutoArgs {
    /// A request for a picture of this size whose estimate is chosen like this.
    pub fn request(&self, size: Size) -> Request {
        Request {
            size,
            estimate: self.settings(),
            calibrate: self.calibrate.0,
            budget: self.error_budget,
            ..Request::default()
        }
    }

    /// What is asked for; the rest is chosen.
    pub fn settings(&self) -> EstimateSettings {
        let quality = self.quality.map(|QualityArg::Proof| Quality::Proof);
        EstimateSettings { quality, ..self.estimate.settings() }
    }
}

/// `on` or `off`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Switch(pub bool);

fn parse_switch(text: &str) -> Result<Switch, String> {
    match text {
        "on" => Ok(Switch(true)),
        "off" => Ok(Switch(false)),
        _ => Err("write on or off".into()),
    }
}

/// Reads `missed%,early%,error`; what is left out at the end keeps its default.
fn parse_budget(text: &str) -> Result<Budget, String> {
    let share = |text: &str| {
        let percent = text.trim().strip_suffix('%').ok_or("shares are percentages such as 0.5%")?;
        match parse_positive(percent)? {
            percent if percent <= 100.0 => Ok(percent / 100.0),
            _ => Err("it must be at most 100%".to_string()),
        }
    };
    let mut budget = Budget::default();
    let parts: Vec<&str> = text.split(',').collect();
    match parts[..] {
        [missed] => budget.missed = share(missed)?,
        [missed, early] => (budget.missed, budget.early) = (share(missed)?, share(early)?),
        [missed, early, error] => {
            (budget.missed, budget.early, budget.error) = (share(missed)?, share(early)?, parse_positive(error)?);
        }
        _ => return Err("write up to three numbers such as 0.5%,5%,0.5".into()),
    }
    Ok(budget)
}

impl EstimateArgs {
    /// What is asked for; the rest is chosen.
    pub fn settings(self) -> EstimateSettings {
        EstimateSettings {
            method: self.de.0,
            form: self.form.0,
            fudge: self.fudge,
            difference: self.difference,
            step: self.difference_step,
            least_step: self.least_step,
            most_step: self.most_step,
            late_ends: self.late_ends.then_some(true),
            stop_at: self.stop_at,
            ..EstimateSettings::default()
        }
    }
}

fn parse_most_step(text: &str) -> Result<f64, String> {
    let [least, most] = MOST_STEPS;
    let step = text.trim().parse::<f64>().ok().filter(|step| (least..=most).contains(step));
    step.ok_or_else(|| format!("it must be a number from {least} to {most}"))
}

fn parse_difference(text: &str) -> Result<Difference, String> {
    let names = Difference::ALL.map(Difference::name).join(", ");
    Difference::ALL.into_iter().find(|d| d.name() == text).ok_or_else(|| format!("choose one of: {names}"))
}

fn parse_difference_step(text: &str) -> Result<DifferenceStep, String> {
    match text.trim().strip_suffix('%') {
        Some(percent) => match parse_positive(percent)? / 100.0 {
            share if share <= 1.0 => Ok(DifferenceStep::Share(share)),
            _ => Err("it must be at most 100%".into()),
        },
        None => parse_positive(text).map(DifferenceStep::Fixed),
    }
}

/// The formula, and changes to it.
#[derive(Args, Clone, Debug)]
pub struct FormulaArgs {
    /// Formula file (.ron), graph script (.rhai) or name of a built-in fractal
    #[arg(add = ArgValueCompleter::new(super::shell::formulas))]
    pub file: PathBuf,
    #[command(flatten)]
    changes: ChangeArgs,
}

impl FormulaArgs {
    /// Takes out the changes that `takes` takes.
    pub fn take_changes(&mut self, mut takes: impl FnMut(&str, &str) -> bool) {
        self.changes.set.retain(|(path, value)| !takes(path, value));
    }

    /// What is changed in the formula.
    pub fn changes(&self) -> Vec<(String, String)> {
        self.changes.changes()
    }
}

/// Changes to a formula.
#[derive(Args, Clone, Default, Debug)]
pub struct ChangeArgs {
    /// Take the values of one of the file's presets; `bulbfold explain NAME` lists them
    #[arg(long, value_name = "NAME", add = ArgValueCompleter::new(super::shell::presets))]
    preset: Option<String>,
    /// Replace a parameter, a node's, or any part of the file, such as power=4, bulb.power=4 or look.fog=0.3
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set, add = ArgValueCompleter::new(super::shell::parameters))]
    set: Vec<(String, String)>,
}

impl ChangeArgs {
    /// Pairs of a path and a value in RON: the preset's, and then those that stand for themselves.
    pub fn changes(&self) -> Vec<(String, String)> {
        let preset = self.preset.iter().map(|name| (PRESET.to_string(), format!("{name:?}")));
        preset.chain(self.set.iter().cloned()).collect()
    }
}

/// The film: what replaces settings of the file's.
#[derive(Args, Clone, Default, Debug)]
#[command(next_help_heading = "Film")]
pub struct FilmArgs {
    /// Exposure in stops: each doubles the light [default: the file's, else 0]
    #[arg(long, value_name = "STOPS", allow_hyphen_values = true, value_parser = parse_exposure)]
    exposure: Option<f64>,
    /// Colour temperature of the light that is to look white, from 1667 to 25000 kelvin [default: the file's, else 6500]
    #[arg(long, value_name = "KELVIN", value_parser = parse_white_balance)]
    white_balance: Option<f64>,
    /// What becomes of bright light: none (cut off), filmic or agx [default: the file's, else filmic; none for planes]
    #[arg(long, value_name = "CURVE", value_parser = parse_curve)]
    curve: Option<String>,
}

impl FilmArgs {
    /// The settings as changes of the formula.
    pub fn changes(&self) -> Vec<(String, String)> {
        let exposure = self.exposure.map(|stops| ("film.exposure".to_string(), stops.to_string()));
        let balance = self.white_balance.map(|kelvin| ("film.white_balance".to_string(), kelvin.to_string()));
        let curve = self.curve.clone().map(|curve| ("film.curve".to_string(), curve));
        exposure.into_iter().chain(balance).chain(curve).collect()
    }
}

fn parse_exposure(text: &str) -> Result<f64, String> {
    let most = Film::MOST_STOPS;
    let stops = parse_number(text)?;
    if stops.abs() <= most { Ok(stops) } else { Err(format!("it must be from -{most} to {most}")) }
}

fn parse_white_balance(text: &str) -> Result<f64, String> {
    let kelvin = parse_number(text)?;
    let legal = Film::COLDEST..=Film::HOTTEST;
    if legal.contains(&kelvin) {
        Ok(kelvin)
    } else {
        Err(format!("it must be from {} to {}", legal.start(), legal.end()))
    }
}

fn parse_curve(text: &str) -> Result<String, String> {
    let names = Curve::ALL.map(|(name, _)| name);
    let known = names.into_iter().find(|name| *name == text);
    known.map(String::from).ok_or_else(|| format!("choose one of: {}", names.join(", ")))
}

fn parse_fudge(text: &str) -> Result<f64, String> {
    let fudge = parse_number(text)?;
    if fudge > 0.0 && fudge <= 1.0 { Ok(fudge) } else { Err("it must be above 0 and at most 1".into()) }
}

/// Reads `PATH=VALUE`.
pub fn parse_set(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((path, value)) if !path.trim().is_empty() && !value.trim().is_empty() => {
            Ok((path.trim().to_string(), value.trim().to_string()))
        }
        _ => Err("write a path, `=` and a value, such as power=4".into()),
    }
}

/// Reads a finite number.
pub fn parse_number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) => Err(format!("`{}` is not a finite number", text.trim())),
        Err(_) => Err(format!("`{}` is not a number", text.trim())),
    }
}

/// Reads a number above 0.
pub fn parse_positive(text: &str) -> Result<f64, String> {
    let number = parse_number(text)?;
    if number > 0.0 { Ok(number) } else { Err("it must be above 0".into()) }
}

/// Reads `u,v`.
pub fn parse_pair(text: &str) -> Result<[f64; 2], String> {
    let parts = text.split(',').map(parse_number).collect::<Result<Vec<f64>, String>>()?;
    <[f64; 2]>::try_from(parts).map_err(|_| "write two numbers such as 0.25,0.7".to_string())
}

/// Reads a vertical field of view in degrees.
pub fn parse_fov(text: &str) -> Result<f64, String> {
    let fov = parse_number(text)?;
    if (0.001..=360.0).contains(&fov) { Ok(fov) } else { Err("it must be from 0.001 to 360 degrees".into()) }
}

/// Reads `x,y,z`.
pub fn parse_vector(text: &str) -> Result<[f64; 3], String> {
    let parts = text.split(',').map(parse_number).collect::<Result<Vec<f64>, String>>()?;
    <[f64; 3]>::try_from(parts).map_err(|_| "write three numbers such as 1,0.5,-2".to_string())
}

#[cfg(test)]
mod tests {
    use super::{parse_budget, parse_set, parse_vector};

    #[test]
    fn budgets_are_two_shares_and_a_number() {
        assert_eq!(parse_budget("1%").unwrap().missed, 0.01);
        let budget = parse_budget("0.1%, 2%, 0.25").unwrap();
        assert_eq!((budget.missed, budget.early, budget.error), (0.001, 0.02, 0.25));
        for wrong in ["", "1", "101%", "-1%", "0%", "1%,1%,x", "1%,1%,1,1", "nan%"] {
            assert!(parse_budget(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn vectors_are_three_finite_numbers() {
        assert_eq!(parse_vector("1, -2.5,3e1"), Ok([1.0, -2.5, 30.0]));
        for wrong in ["1,2", "1,2,3,4", "1,2,nan", "1,2,inf", "", "a,b,c"] {
            assert!(parse_vector(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn settings_need_a_path_and_a_value() {
        assert_eq!(parse_set("bulb.power = 4"), Ok(("bulb.power".into(), "4".into())));
        for wrong in ["power", "=4", "power="] {
            assert!(parse_set(wrong).is_err(), "{wrong}");
        }
    }
}
