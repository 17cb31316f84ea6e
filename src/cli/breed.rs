//! `bulbfold breed`: formulas of two others, on a contact sheet and as files.

use std::io::Write;
use std::path::PathBuf;

use bulbfold::explore::breed;
use clap::Args;

use super::vary::{BroodArgs, Places, parent, raise, stem_of};
use super::{Outcome, Session};

/// Arguments of `breed`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold breed mandelbox menger
  bulbfold breed mandelbox_vary/mandelbox_03.ron mandelbox_vary/mandelbox_11.ron --count 12 -o children.png

Children of the same formula have numbers between those of both. Children of two formulas iterate both: alternately, one within the
other, one after the other, or blended. What shows nothing, costs too much or cannot be estimated is rejected and counted, as `vary` does.")]
pub struct Arguments {
    /// Formula file (.ron), graph script (.rhai) or the name of a built-in fractal
    #[arg(value_name = "A")]
    first: PathBuf,
    /// The other one
    #[arg(value_name = "B")]
    second: PathBuf,
    #[command(flatten)]
    brood: BroodArgs,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let Arguments { first, second, brood } = arguments;
    let name = format!("{}_{}", stem_of(first), stem_of(second));
    let places = Places::new(brood, &format!("{name}_breed"))?;
    let (one, a) = parent(session, first, &[], "`breed`")?;
    let (other, b) = parent(session, second, &[], "`breed`")?;
    let draw = |number: u64| breed(&a, &b, brood.seed, number);
    // The library of the parent that was read last has the steps of both.
    raise(session, brood, (&places, &name), (&[one, other], &[&b, &a]), draw, out)
}
