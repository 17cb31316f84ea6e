//! Variations of formulas: drafts of new ones from the texts of old ones, and which of them are worth a look.
//!
//! In comes a [`Parent`], a formula as its value tree. [`vary`] draws a draft with other numbers, or with other steps too;
//! [`breed()`] draws one of two parents. A [`Judge`] settles a draft and looks at it with a coarse grid of rays: what shows nothing,
//! is dust or plain, is cut by the frame, costs too much, cannot be estimated or looks like another is rejected, with its [`Reason`]. [`search`] goes on until enough
//! drafts are left. Everything follows from texts, settings and seed; no clock is involved.

mod breed;
mod judge;
mod numbers;
mod structure;
mod text;
mod tree;

use std::sync::Arc;

pub use breed::breed;
pub use judge::{Accepted, Judge, Reason, Verdict};
pub use numbers::{Number, numbers};

use crate::diag::Diagnostics;
use crate::engine::{Engine, Error, Formula, FormulaMessages};
use crate::formula::library::Library;
use crate::formula::value::Value;
use crate::load::{Bundle, load_text, tree as load_tree};
use crate::math::random::Random;

/// Drafts that are tried for each one that is wanted.
const TRIES: u64 = 12;

/// A formula that others are made of.
pub struct Parent {
    /// Its file's stem.
    pub name: String,
    /// Its value tree, with the values that were set.
    tree: Value,
    /// Its steps beside the built-in ones, and all texts that were read.
    library: Library,
    /// Names and texts of these steps.
    steps: Vec<(String, String)>,
}

impl Parent {
    /// The parent that a formula is.
    ///
    /// Errors: [`Error::Request`] where objects of the formula are files of their own.
    pub fn of(formula: &Formula, name: &str) -> Result<Parent, Error> {
        let bundle = formula.bundle();
        if let Some((file, _)) = bundle.files.first() {
            let text = format!("`{name}` shows the file {file}, and a new formula is one file");
            return Err(Error::request(text, "vary that file, or write its nodes into the scene"));
        }
        let (mut library, mut messages) = (formula.library().clone(), Diagnostics::default());
        match load_tree(&mut library, &bundle, &mut messages).filter(|_| !messages.has_errors()) {
            Some(tree) => {
                let Bundle { steps, .. } = bundle;
                Ok(Parent { name: name.to_string(), tree, library, steps })
            }
            None => Err(Error::Formula(Box::new(FormulaMessages { messages, sources: library.sources }))),
        }
    }

    /// Names and texts of the steps that its drafts need beside them.
    pub fn steps(&self) -> &[(String, String)] {
        &self.steps
    }

    /// The text of its tree, as drafts are written.
    pub fn text(&self) -> String {
        text::written(&self.tree, &[])
    }

    /// Reads the text of a draft.
    ///
    /// Errors: [`Error::Formula`].
    pub fn read(&self, text: &str) -> Result<Arc<Formula>, Error> {
        let (mut library, mut messages) = (self.library.clone(), Diagnostics::default());
        match load_text(&mut library, &format!("{}.ron", self.name), text, &[], &mut messages)
            .filter(|_| !messages.has_errors())
        {
            Some(loaded) => Ok(Arc::new(Formula::of(library, loaded))),
            None => Err(Error::Formula(Box::new(FormulaMessages { messages, sources: library.sources }))),
        }
    }
}

/// How far drafts go from their parent.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Variation {
    /// Other seeds draw other drafts.
    pub seed: u64,
    /// How far numbers move, from 0 to 1: about this share of themselves, within their ranges.
    pub amount: f64,
    /// Whether steps are exchanged, inserted, removed and put into another order, too.
    pub structure: bool,
}

/// A formula that may become a file.
#[derive(Clone, Debug)]
pub struct Draft {
    tree: Value,
    /// What differs from the parent, a line each.
    pub changes: Vec<String>,
    /// What the file says of its making.
    head: Vec<String>,
}

impl Draft {
    /// The text of its file.
    pub fn text(&self) -> String {
        let lines: Vec<String> = self.head.iter().chain(&self.changes).cloned().collect();
        text::written(&self.tree, &lines)
    }

    /// The same seen by a camera that frames what is there; `None` where it has no camera of its own.
    fn without_camera(&self) -> Option<Draft> {
        let mut draft = self.clone();
        tree::remove(&mut draft.tree, &["camera"]).then_some(draft)
    }
}

/// The generator of one draft of a seed.
fn random_of(seed: u64, number: u64) -> Random {
    let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(number));
    Random::new(random.next_u64())
}

/// Draws a draft: always the same one of this variation and number.
///
/// Errors: [`Error::Request`] where the parent has nothing that could be varied.
pub fn vary(parent: &Parent, variation: &Variation, number: u64) -> Result<Draft, Error> {
    let mut random = random_of(variation.seed, number);
    let (mut tree, library, mut changes) = (parent.tree.clone(), &parent.library, Vec::new());
    if variation.structure {
        let wanted = 1 + random.below(2);
        changes.extend((0..wanted).filter_map(|_| structure::change(&mut tree, library, &mut random)));
    }
    let is_rebuilt = !changes.is_empty();
    numbers::complete(&mut tree, library);
    let moved = numbers::move_some(&mut tree, library, variation.amount, &mut random);
    if moved.changes.is_empty() && !is_rebuilt {
        let text = format!("`{}` has no numbers that could be varied", parent.name);
        return Err(Error::request(text, "--structure varies its steps"));
    }
    let keeps = if is_rebuilt { tree::Keeps::Nothing } else { moved.keeps };
    tree::forget(&mut tree, keeps);
    changes.extend(moved.changes);
    let how = if variation.structure { ", structure" } else { "" };
    let head = vec![format!(
        "A variation of {} (seed {}, draft {number}, amount {}{how}).",
        parent.name, variation.seed, variation.amount
    )];
    tree::set_text(&mut tree, "summary", format!("A variation of {}.", parent.name));
    Ok(Draft { tree, changes, head })
}

/// A draft that was accepted.
pub struct Survivor {
    /// The draft.
    pub draft: Draft,
    /// What the judge saw.
    pub accepted: Accepted,
}

impl Survivor {
    /// The text of its file, with an estimate that was measured.
    ///
    /// Errors: [`Error::Formula`].
    pub fn text(&self) -> Result<String, Error> {
        let job = &self.accepted.job;
        judge::with_estimate(&job.formula, &self.draft.text(), &job.request)
    }
}

/// What a search found.
#[derive(Default)]
pub struct Found {
    /// In the order of their numbers.
    pub survivors: Vec<Survivor>,
    /// How many were rejected for each reason, in the order of [`Reason::ALL`].
    pub rejected: [usize; Reason::ALL.len()],
    /// What is wrong with the first draft that could not be composed.
    pub broken: Option<Error>,
}

impl Found {
    /// `7 rejected: 4 empty, 3 cut by the frame`.
    pub fn rejections(&self) -> String {
        let all: usize = self.rejected.iter().sum();
        let named = Reason::ALL.iter().zip(self.rejected).filter(|(_, count)| *count > 0);
        let named: Vec<String> = named.map(|(reason, count)| format!("{count} {}", reason.name())).collect();
        if all == 0 { "none rejected".into() } else { format!("{all} rejected: {}", named.join(", ")) }
    }
}

/// Draws drafts until `count` of them are accepted, or some times as many are drawn. `tell` hears how many are.
///
/// Errors: those of `draw`.
pub fn search(
    engine: &Engine,
    (judge, parent): (&Judge, &Parent),
    count: usize,
    draw: impl Fn(u64) -> Result<Draft, Error>,
    tell: &mut dyn FnMut(usize),
) -> Result<Found, Error> {
    let mut found = Found::default();
    for number in 1..=TRIES * count as u64 {
        if found.survivors.len() == count {
            break;
        }
        let (draft, judged) = seen(engine, (judge, parent), draw(number)?, &found.survivors);
        match judged {
            Ok(accepted) => found.survivors.push(Survivor { draft, accepted }),
            Err((reason, error)) => {
                found.rejected[reason as usize] += 1;
                found.broken = found.broken.take().or(error);
            }
        }
        tell(found.survivors.len());
    }
    Ok(found)
}

/// A draft and what is said of it: a set of another size or place may want another camera.
fn seen(engine: &Engine, (judge, parent): (&Judge, &Parent), draft: Draft, known: &[Survivor]) -> (Draft, Verdict) {
    let judged = judge.judge(engine, parent, &draft.text(), known);
    let free = match judged {
        Err((Reason::Empty | Reason::Full | Reason::Cut, _)) => draft.without_camera(),
        _ => None,
    };
    match free {
        Some(free) => {
            let judged = judge.judge(engine, parent, &free.text(), known);
            (free, judged)
        }
        None => (draft, judged),
    }
}
