//! Formulas at points, on everything that can run them.

use bulbfold::check::{Backends, Formula, Subject, Target};
use bulbfold::compose::{Purpose, compose_estimator};
use bulbfold::graph::Method;
use bulbfold::kernel::Kernel;

use crate::support::formula;

pub type P = [f64; 3];

thread_local! {
    /// Opened once a test, since opening a GPU takes longer than a case, and never closed: drivers cannot be while a
    /// thread ends.
    static BACKENDS: &'static Backends = Box::leak(Box::new(Backends::new()));
}

pub fn backends() -> &'static Backends {
    BACKENDS.with(|backends| *backends)
}

pub fn length(p: P) -> f64 {
    p.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// One answer, with what it came from.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    pub target: Target,
    pub method: Method,
    pub p: P,
    pub de: f64,
    pub inside: bool,
}

impl Answer {
    /// A number from 0 up, as every estimate must be.
    #[track_caller]
    pub fn sound(self) -> Answer {
        assert!(self.de.is_finite() && self.de >= 0.0, "no distance: {self:?}");
        self
    }

    /// Relative error that rounding may make, and differences over a hundredth of the estimate in addition: along the ray
    /// they go inwards, where r is less, which counts the more the farther r has grown.
    pub fn slack(&self) -> f64 {
        let single = if self.target == Target::CPU_F64 { 1e-9 } else { 1e-4 };
        let difference = match self.method {
            Method::Delta => 3e-2,
            Method::DeltaRay => 0.4,
            _ => 0.0,
        };
        single + difference
    }

    /// The estimate of a method that takes nothing but the derivative of r, or one that is the same here. Methods that take
    /// more of the Jacobian or a safer form may say less, never more.
    #[track_caller]
    pub fn is(self, wanted: f64) -> Answer {
        let tolerance = self.slack() * wanted.abs();
        let exact = ["scalar", "gradient", "combined", "delta", "potential"].contains(&self.method.name());
        let low = if exact { wanted - tolerance } else { 0.0 };
        assert!(low <= self.de && self.de <= wanted + tolerance, "expected {wanted}: {self:?}");
        self
    }
}

/// The answers of all methods that apply, on all back ends.
pub fn answers(formula: &Formula, points: &[P]) -> Vec<Answer> {
    let subject = formula.subject();
    let mut answers = Vec::new();
    let mut methods = 0;
    for method in Method::ALL {
        let Some(choices) = subject.choices(Some(method)) else { continue };
        methods += 1;
        let kernel = subject.estimator(&choices).unwrap_or_else(|e| panic!("{}", e.message));
        for target in backends().targets() {
            let values = subject.estimates(backends(), target, &kernel, points).unwrap();
            let answer = |(p, (de, inside)): (&P, (f64, bool))| Answer { target, method, p: *p, de, inside };
            answers.extend(points.iter().zip(values).map(answer));
        }
    }
    assert!(methods > 0, "no method applies");
    check_surface(&subject, points);
    answers
}

/// What surfaces are coloured by is finite at all points, and gradients are of length 1, or 0 where there is none.
fn check_surface(subject: &Subject, points: &[P]) {
    let estimator = compose_estimator(&subject.composer(), &subject.plan.choices, Purpose::Surface);
    let kernel = Kernel::Estimate(estimator.unwrap_or_else(|e| panic!("{}", e.message)));
    let columns = bulbfold::kernel::Estimator::columns(
        points,
        &vec![[1.0, 0.0, 0.0]; points.len()],
        &vec![1e-4; points.len()],
        1e-4,
    );
    for target in backends().targets() {
        let out = backends().run(target, subject.arena, &kernel, &columns).unwrap();
        for (i, p) in points.iter().enumerate() {
            let gradient = length([out[0][i], out[1][i], out[2][i]]);
            // One that is no number or infinite becomes the view's direction when colours are made.
            assert!(!gradient.is_finite() || gradient < 1.001, "{target:?} at {p:?}: a gradient of length {gradient}");
        }
    }
}

/// Answers of a formula text, each sound.
pub fn sound_answers(text: &str, points: &[P]) -> Vec<Answer> {
    answers(&formula(text), points).into_iter().map(Answer::sound).collect()
}

/// Checks that all answers of a formula are sound.
#[track_caller]
pub fn all_sound(formula: &Formula, points: &[P]) {
    for answer in answers(formula, points) {
        answer.sound();
    }
}

/// Depths of rays with every method on every back end.
pub fn depths(text: &str, rays: &[(P, P)], hit_eps: f64, mut check: impl FnMut(Target, Method, usize, Option<f64>)) {
    let formula = formula(text);
    for method in Method::ALL {
        let mut subject = formula.subject();
        let Some(choices) = subject.choices(Some(method)) else { continue };
        subject.plan.choices = choices;
        for target in backends().targets() {
            let found =
                subject.depths(backends(), target, rays, hit_eps).unwrap().unwrap_or_else(|e| panic!("{}", e.message));
            found.into_iter().enumerate().for_each(|(i, depth)| check(target, method, i, depth));
        }
    }
}
