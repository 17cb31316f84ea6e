//! What can be chosen from: methods, forms and ways of stepping, and the plan that each of them makes.

use crate::check::Subject;
use crate::compose::{FieldOrbit, Plan, field_orbits};
use crate::graph::{DeForm, EstimateSettings, LEAST_STEP, LEAST_STEP_OF_PROOFS, Method};

/// Step multipliers, from the cheapest.
pub const FUDGES: [f64; 8] = [1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05];
/// Shortest steps as shares of the hit threshold, from the cheapest.
pub const LEAST_STEPS: [f64; 5] =
    [LEAST_STEP, LEAST_STEP / 4.0, LEAST_STEP / 16.0, LEAST_STEP / 64.0, LEAST_STEP / 256.0];

/// Longest steps in hit thresholds, from the cheapest, besides no limit at all.
pub const MOST_STEPS: [f64; 4] = [16.0, 4.0, 1.0, 0.25];

/// One way of estimating distances and stepping by them.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Candidate {
    /// Method of every orbit that it applies to and that fixes none; `None` if there is none to choose, as for primitives.
    pub method: Option<Method>,
    /// Form; `None` is what the orbit's growth calls for.
    pub form: Option<DeForm>,
    /// Step multiplier in (0, 1].
    pub fudge: f64,
    /// Shortest step as a share of the hit threshold.
    pub least_step: f64,
    /// Longest step in hit thresholds; `None` is as long as the estimate.
    pub most_step: Option<f64>,
    /// Whether orbits run on until they escape.
    pub late_ends: bool,
}

impl Candidate {
    /// The settings that ask for it.
    pub fn settings(&self) -> EstimateSettings {
        EstimateSettings {
            method: self.method,
            form: self.form,
            fudge: Some(self.fudge),
            least_step: Some(self.least_step),
            most_step: self.most_step,
            late_ends: self.late_ends.then_some(true),
            ..EstimateSettings::default()
        }
    }

    /// Method and form in words.
    pub fn name(&self) -> String {
        let method = self.method.unwrap_or(Method::Own).name();
        let late = if self.late_ends { " late" } else { "" };
        self.form.map_or(format!("{method}{late}"), |form| format!("{method} {}{late}", form.name()))
    }
}

/// What is left to choose: a subject's plan by the rules, what its file and the command line fix, and the rest.
pub struct Space {
    /// The plan by the rules.
    pub base: Plan,
    orbits: Vec<FieldOrbit>,
    /// What is fixed for each orbit.
    fixed: Vec<EstimateSettings>,
    /// Methods (and forms other than the rules') that can be chosen, in the order of listings.
    pub kinds: Vec<(Option<Method>, Option<DeForm>)>,
    /// Step multipliers, falling.
    pub fudges: Vec<f64>,
    /// Shortest steps, falling.
    pub least_steps: Vec<f64>,
    /// Longest steps in hit thresholds, falling; empty where that is fixed.
    pub most_steps: Vec<f64>,
    /// Whether proofs are asked for, at any price.
    pub wants_proof: bool,
    /// What to tell where they are and no proof applies.
    pub unproven: Option<String>,
}

impl Space {
    /// What can be chosen for a subject whose plan was made with `wanted`.
    pub fn new(subject: &Subject, wanted: &EstimateSettings) -> Space {
        let base = subject.plan.clone();
        let orbits = field_orbits(&subject.composer());
        let fixed: Vec<EstimateSettings> = orbits.iter().map(|orbit| wanted.or(orbit.settings.estimate)).collect();
        let is_free = |asked: fn(&EstimateSettings) -> bool| !fixed.iter().any(asked) && !asked(wanted);
        let mut kinds = vec![];
        for method in Method::ALL {
            let open = base.choices.iter().zip(&fixed).filter(|(_, fixed)| fixed.method.is_none());
            let applies = open.filter(|(choice, _)| choice.applicable.contains(&method)).count() > 0;
            // With exact derivatives the potential is the gradient's own number. What is known along primary rays alone
            // says nothing of shadow rays, and misses most where maps jump.
            let along_rays = matches!(method, Method::Directional | Method::DeltaRay);
            if applies && !along_rays && !matches!(method, Method::Own | Method::Potential) {
                kinds.push((Some(method), None));
            }
        }
        if kinds.is_empty() {
            kinds.push((base.choices.first().map(|choice| choice.method), None));
        }
        let wants_proof = wanted.quality.is_some() || fixed.iter().any(|e| e.quality.is_some());
        let is_proof = |kind: &(Option<Method>, Option<DeForm>)| kind.0.is_some_and(Method::is_certified);
        let has_proofs = kinds.iter().any(is_proof);
        if wants_proof && has_proofs {
            kinds.retain(is_proof);
        }
        let unproven = (wants_proof && !has_proofs).then(|| {
            "no proof applies to this formula, so the cheapest estimate is taken that keeps the budget".into()
        });
        let other = |(method, _): &(Option<Method>, _)| Some((*method, Some(other_form(&base, &fixed, *method)?)));
        let others: Vec<_> = kinds.iter().filter_map(other).collect();
        kinds.extend(others);
        let fudges = if is_free(|e| e.fudge.is_some()) { FUDGES.to_vec() } else { vec![base.fudge] };
        let least_steps = match is_free(|e| e.least_step.is_some()) {
            true => LEAST_STEPS.to_vec(),
            false => vec![base.least_step],
        };
        let most_steps = if is_free(|e| e.most_step.is_some()) { MOST_STEPS.to_vec() } else { Vec::new() };
        Space { base, orbits, fixed, kinds, fudges, least_steps, most_steps, wants_proof, unproven }
    }

    /// True if nothing is left to choose.
    pub fn is_decided(&self) -> bool {
        self.kinds.len() == 1 && self.fudges.len() == 1 && self.least_steps.len() == 1
    }

    /// The longest of the shortest steps that a method may take. Who asks for proofs wants nothing missed, so their walk is
    /// not made cheaper than it was measured to be safe.
    pub fn longest_step(&self, method: Option<Method>) -> f64 {
        let is_proof = method.is_some_and(Method::is_certified);
        let safe = self.least_steps.iter().find(|step| !is_proof || **step <= LEAST_STEP_OF_PROOFS);
        *safe.unwrap_or(&self.least_steps[0])
    }

    /// The longest step of candidates that are tried first: none, unless one is fixed.
    pub fn first_most_step(&self) -> Option<f64> {
        Some(self.base.most_step).filter(|step| step.is_finite())
    }

    /// The plan of a candidate.
    pub fn plan(&self, candidate: &Candidate) -> Plan {
        let mut plan = self.base.clone();
        for ((choice, orbit), fixed) in plan.choices.iter_mut().zip(&self.orbits).zip(&self.fixed) {
            if let (Some(method), None) = (candidate.method, fixed.method)
                && choice.applicable.contains(&method)
            {
                choice.method = method;
            }
            let form = match fixed.form {
                _ if choice.form == DeForm::End => DeForm::End,
                Some(form) => form,
                None if choice.method.is_potential() => DeForm::Logarithmic,
                None => candidate.form.unwrap_or(choice.form),
            };
            if form == DeForm::Linear && choice.form != DeForm::Linear {
                // In a state of four components the sum of sizes is compared with half of it.
                choice.radius = fixed.radius.unwrap_or_else(|| orbit.settings.linear_radius(choice.extent, 4));
            }
            choice.form = form;
            choice.fudge = candidate.fudge;
        }
        if candidate.late_ends {
            plan = plan.with_late_ends();
        }
        plan.fudge = candidate.fudge;
        plan.least_step = candidate.least_step;
        plan.most_step = candidate.most_step.unwrap_or(f64::INFINITY);
        plan
    }

    /// The candidate that the rules make.
    pub fn by_rule(&self) -> Candidate {
        let method = self.base.choices.first().map(|c| c.method);
        let known = self.kinds.iter().any(|(m, _)| *m == method);
        let method = if known { method } else { self.kinds[0].0 };
        let (fudge, least_step) = (self.base.fudge, self.base.least_step);
        Candidate { method, form: None, fudge, least_step, most_step: self.first_most_step(), late_ends: false }
    }

    /// The two most careful candidates among the methods that are cheap enough to march thousands of rays with: proofs
    /// before bounds before estimates, short steps.
    pub fn careful(&self) -> Vec<Candidate> {
        let careful = [Method::CertifiedBall, Method::Frobenius, Method::Combined, Method::Scalar, Method::Delta];
        let kinds: Vec<Option<Method>> = self.kinds.iter().map(|(method, _)| *method).collect();
        let mut methods: Vec<Option<Method>> = careful.map(Some).into_iter().filter(|m| kinds.contains(m)).collect();
        if methods.is_empty() {
            methods.push(kinds[0]);
        }
        let least_step = self.least_steps[self.least_steps.len().min(2) - 1];
        let with = |method: Option<Method>| {
            let is_proof = method.is_some_and(Method::is_certified);
            let (fudge, least_step) = match is_proof {
                true => (self.fudges[0], self.longest_step(method)),
                false => (self.fudges[self.fudges.len().min(5) - 1], least_step),
            };
            Candidate { method, form: None, fudge, least_step, most_step: self.first_most_step(), late_ends: false }
        };
        methods.into_iter().take(2).map(with).collect()
    }
}

/// The form that the rules did not take, where an end shape is not part of the set's definition.
fn other_form(base: &Plan, fixed: &[EstimateSettings], method: Option<Method>) -> Option<DeForm> {
    let method = method.filter(|m| matches!(m, Method::Scalar | Method::Gradient | Method::Combined))?;
    let choice = base.choices.first()?;
    let is_open = fixed.iter().all(|f| f.form.is_none()) && base.choices.iter().all(|c| c.form == choice.form);
    match choice.form {
        _ if !is_open || !choice.applicable.contains(&method) => None,
        DeForm::Linear => Some(DeForm::Logarithmic),
        DeForm::Logarithmic => Some(DeForm::Linear),
        DeForm::Box | DeForm::Plane | DeForm::End => None,
    }
}
