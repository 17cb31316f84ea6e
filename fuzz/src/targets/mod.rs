//! The targets by subject.

pub mod film;
pub mod imports;
pub mod machine;
pub mod readers;
pub mod writers;

use std::cell::RefCell;
use std::sync::Arc;

use bulbfold::compose::{Choice, Composer, Plan, Reach, field_orbits, scalar_rules};
use bulbfold::diag::Diagnostics;
use bulbfold::formula::library::Library;
use bulbfold::graph::{DeForm, DifferenceStep, LEAST_STEP, Method};

/// Inputs after which the library is built anew: it keeps every text that it has read.
const RENEW: u32 = 500;

thread_local! {
    static LIBRARY: RefCell<(Library, u32)> = RefCell::new((Library::builtin(), 0));
}

/// Does something with the built-in steps.
fn with_library<T>(work: impl FnOnce(&mut Library) -> T) -> T {
    LIBRARY.with(|cell| {
        let mut kept = cell.borrow_mut();
        kept.1 += 1;
        if kept.1 > RENEW {
            *kept = (Library::builtin(), 0);
        }
        work(&mut kept.0)
    })
}

/// What is refused has a message, and every message can be shown.
fn expect_told(library: &Library, d: &Diagnostics, is_taken: bool) {
    assert!(is_taken || d.has_errors(), "a file was refused without a message");
    let shown = d.render(&library.sources, false);
    assert!(is_taken || !shown.is_empty(), "a message shows nothing");
}

/// Text of bytes that may be none: as much of it as is UTF-8.
fn as_text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    String::from_utf8_lossy(bytes)
}

/// A choice for each orbit that needs no measurement; the first bits of `salt` choose among the methods that apply.
fn fixed_choices(composer: &Composer, salt: u64) -> Vec<Choice> {
    let of = |method: Method, differentiable: bool| Choice {
        method,
        form: if salt & 8 == 0 { DeForm::Logarithmic } else { DeForm::Linear },
        differentiable,
        applicable: Method::ALL.to_vec(),
        ..Choice::default()
    };
    field_orbits(composer)
        .iter()
        .map(|orbit| {
            let settings = &orbit.settings;
            let roots =
                [orbit.root].into_iter().chain(settings.pre.iter().copied()).chain(settings.post.iter().copied());
            let rules: Vec<_> = roots.map(|root| scalar_rules(composer, root)).collect();
            let methods: &[Method] = match rules.iter().all(Option::is_some) {
                true => &[Method::Scalar, Method::Combined, Method::Gradient, Method::Delta],
                false => &[Method::Gradient, Method::Delta, Method::Directional, Method::DeltaRay],
            };
            of(methods[(salt & 3) as usize], true)
        })
        .collect()
}

/// A plan of fixed choices.
fn fixed_plan(composer: &Composer, salt: u64) -> Plan {
    Plan {
        choices: fixed_choices(composer, salt),
        bounding_radius: 4.0,
        reach: Reach::Stated,
        members: 0.0,
        fudge: 1.0,
        most_step: f64::INFINITY,
        least_step: LEAST_STEP,
        stop_at: None,
        difference_step: DifferenceStep::default(),
        warnings: Vec::new(),
    }
}

/// A hash of an input, for choices that it does not make by itself.
fn salt(bytes: &[u8]) -> u64 {
    (bulbfold::calibrate::cache::hash(bytes) >> 13) as u64
}

/// Names of a composer's parts, owned by the caller.
fn composer<'a>(
    arena: &'a Arc<bulbfold::expr::Arena>,
    library: &'a Library,
    graph: &'a bulbfold::graph::ValidGraph,
) -> Composer<'a> {
    Composer { arena, library, graph }
}
