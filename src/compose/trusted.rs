//! Plans that were kept somewhere, and may have been changed there.

use super::{Choice, Plan};
use crate::graph::{DeForm, DifferenceStep};

impl Plan {
    /// Whether this could be a choice for the orbits that `rules` is one for: what was measured is the same, and what was chosen is in
    /// range.
    pub fn is_choice_of(&self, rules: &Plan) -> bool {
        let is_share = |x: f64| x > 0.0 && x <= 1.0;
        let is_step = match self.difference_step {
            DifferenceStep::Share(x) | DifferenceStep::Fixed(x) => x > 0.0 && x.is_finite(),
        };
        self.choices.len() == rules.choices.len()
            && self.choices.iter().zip(&rules.choices).all(|(own, rule)| own.is_choice_of(rule))
            && self.bounding_radius == rules.bounding_radius
            && self.stop_at == rules.stop_at
            && is_share(self.fudge)
            && is_share(self.least_step)
            && self.most_step > 0.0
            && is_step
    }
}

impl Choice {
    /// Whether this could be a choice where the rules make that one.
    fn is_choice_of(&self, rule: &Choice) -> bool {
        let measured = |choice: &Choice| {
            (
                choice.differentiable,
                choice.tight,
                choice.by_length,
                choice.extent.to_bits(),
                choice.axis.map(f64::to_bits),
            )
        };
        measured(self) == measured(rule)
            && self.applicable == rule.applicable
            && (self.method == rule.method || rule.applicable.contains(&self.method))
            && (self.form == DeForm::End) == (rule.form == DeForm::End)
            && self.radius.is_finite()
            && self.power.is_finite()
            && self.fudge > 0.0
            && self.fudge <= 1.0
    }
}
