//! Which method, form, radius and step multiplier an orbit gets: what its file or the command line fixes, else by the
//! design's rules and two measurements in f64, growth far out and extent.

use serde::{Deserialize, Serialize};

use super::maps::{scalar_rules, steps_of};
use super::measure::{measure_extent, measure_growth, measure_tightness};
use super::nearby::{measure_ends, measure_stops};
use super::reach::{FAR, Found, Reach, has_endless_primitives, member_beyond, primitive_reach, search};
use super::{ComposeResult, Composer, FieldOrbit, field_orbits};
use crate::formula::step::{Growth, ScalarRule};
use crate::graph::{
    DeForm, Difference, DifferenceStep, Escape, EstimateSettings, Join, LEAST_STEP, LEAST_STEP_OF_PROOFS, Method,
    NodeKind, NodeRef, StopAt,
};
use crate::math::Precision;

/// How distances are estimated from one orbit.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Choice {
    /// Method.
    pub method: Method,
    /// Form.
    pub form: DeForm,
    /// Radius of the linear form, half side of the box, half thickness of the plane; in the orbit's final frame.
    pub radius: f64,
    /// Unit normal of the plane form.
    pub axis: [f64; 3],
    /// Power by which r grows in one iteration, on average over a cycle; 1 if it grows by a factor.
    pub power: f64,
    /// What finite differences are taken of; `None` follows method and form.
    pub difference: Option<Difference>,
    /// Step multiplier.
    pub fudge: f64,
    /// Whether the orbit can be differentiated; normals need finite differences where it cannot.
    pub differentiable: bool,
    /// Whether the scalar rules grow as fast as orbits do, as measured; false if not every step has one.
    pub tight: bool,
    /// Whether orbits may end at the footprint, as measured: members of the set are within the threshold then.
    pub ends: bool,
    /// Whether rays stop at a threshold: the field then says 0 if it does not know that something is within it.
    pub stops: bool,
    /// Radius of a ball around the orbit's own origin that holds the set, as measured.
    pub extent: f64,
    /// Whether orbits end by the length of z: only then does the size of the threshold's image tell how much of the set is near.
    pub by_length: bool,
    /// What it is computed in: proofs leave room for rounding.
    pub precision: Precision,
    /// Methods that apply.
    pub applicable: Vec<Method>,
    /// Why this method and form.
    pub reason: String,
}

impl Default for Choice {
    /// `scalar`, linear with radius 0, for orbits that nothing is known of.
    fn default() -> Choice {
        Choice {
            method: Method::Scalar,
            form: DeForm::Linear,
            radius: 0.0,
            axis: [0.0, 0.0, 1.0],
            power: 1.0,
            difference: None,
            fudge: 1.0,
            differentiable: false,
            tight: false,
            ends: false,
            stops: false,
            extent: 0.0,
            by_length: true,
            precision: Precision::F32,
            applicable: Vec::new(),
            reason: String::new(),
        }
    }
}

/// Choices for all orbits of a field, and its extent.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Plan {
    /// One for each of [`field_orbits`].
    pub choices: Vec<Choice>,
    /// Radius of a ball around the world's origin that holds everything drawn.
    pub bounding_radius: f64,
    /// How that is known.
    pub reach: Reach,
    /// How far out the farthest member was seen; 0 if none was looked for.
    pub members: f64,
    /// Step multiplier of the whole field.
    pub fudge: f64,
    /// Shortest step of a march, as a share of the hit threshold: the least that is asked for.
    pub least_step: f64,
    /// Longest step of a march in hit thresholds: the least that is asked for, or infinity.
    #[serde(with = "unbounded")]
    pub most_step: f64,
    /// Estimate below which a ray stops: the nearest to the set that is asked for. `None` stops at members alone.
    pub stop_at: Option<StopAt>,
    /// Step of finite differences: the first that an orbit asks for.
    pub difference_step: DifferenceStep,
    /// What a user should know, for example that a method that was asked for does not apply.
    pub warnings: Vec<String>,
}

/// A number that may be infinite, which JSON has no word for: `null` there.
mod unbounded {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[allow(clippy::trivially_copy_pass_by_ref)]
    pub(super) fn serialize<S: Serializer>(x: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        x.is_finite().then_some(*x).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

impl Plan {
    /// True if every orbit is certified: the march then proposes how far a proof is to reach.
    pub fn is_certified(&self) -> bool {
        !self.choices.is_empty() && self.choices.iter().all(|c| c.method.is_certified())
    }

    /// The same, computed in a precision.
    #[must_use]
    pub fn in_precision(mut self, precision: Precision) -> Plan {
        self.choices.iter_mut().for_each(|choice| choice.precision = precision);
        self
    }

    /// The same with orbits that run on until they escape or `max_iterations` are done.
    #[must_use]
    pub fn with_late_ends(mut self) -> Plan {
        self.choices.iter_mut().for_each(|choice| choice.ends = false);
        self
    }

    /// Methods that apply to every orbit; `own` where there is none.
    pub fn applicable(&self) -> Vec<Method> {
        let applies = |m: &Method| match self.choices.is_empty() {
            true => *m == Method::Own,
            false => self.choices.iter().all(|c| c.applicable.contains(m)),
        };
        Method::ALL.into_iter().filter(applies).collect()
    }
}

/// Makes the choices. `wanted` overrides what files fix.
pub fn choose(composer: &Composer, wanted: &EstimateSettings) -> ComposeResult<Plan> {
    let orbits = field_orbits(composer);
    let mut warnings = super::unread::warnings(composer, &orbits)?;
    let mut choices = Vec::new();
    for orbit in &orbits {
        let settings = wanted.or(orbit.settings.estimate);
        choices.push(choose_orbit(composer, orbit, &settings, &mut warnings)?);
    }
    // Proofs need a march of their own: none of the orbits has one where one of them cannot.
    let blocks = orbits.iter().zip(&choices).find(|(_, choice)| !choice.applicable.contains(&Method::Certified));
    if let (Some((blocking, _)), true) = (blocks, choices.iter().any(|c: &Choice| c.method.is_certified())) {
        let name = &composer.graph.node(blocking.root).name;
        warnings.push(format!("no orbit is certified: the method does not apply to `{name}`"));
        for (orbit, choice) in orbits.iter().zip(&mut choices).filter(|(_, choice)| choice.method.is_certified()) {
            let settings = EstimateSettings { method: None, ..wanted.or(orbit.settings.estimate) };
            *choice = choose_orbit(composer, orbit, &settings, &mut warnings)?;
        }
    }
    // So one certified orbit makes all of them so.
    if let Some(method) = choices.iter().map(|c: &Choice| c.method).find(|m| m.is_certified()) {
        choices.iter_mut().filter(|c| !c.method.is_certified()).for_each(|c| c.method = method);
    }
    let mut radii = Vec::new();
    for (orbit, choice) in orbits.iter().zip(&mut choices) {
        let settings = wanted.or(orbit.settings.estimate);
        measure_set(composer, orbit, choice, settings.late_ends == Some(true))?;
        let extent = choice.extent;
        let fixed = settings.radius;
        if matches!(choice.form, DeForm::Linear | DeForm::Box) {
            // Beyond half the escape radius the form would say 0 right where orbits escape.
            let width = composer.graph.state_width(orbit.root, &orbit.settings);
            choice.radius = fixed.unwrap_or_else(|| orbit.settings.linear_radius(extent, width));
        }
        radii.extend(orbit.frame.reach(extent));
    }
    let Found { radius: bounding_radius, reach, members } = reach_of(composer, &choices, &radii, &mut warnings)?;
    let fudge = wanted.fudge.unwrap_or_else(|| choices.iter().map(|c| c.fudge).fold(1.0, f64::min));
    if let (true, Some(method)) = (orbits.is_empty(), wanted.method)
        && method != Method::Own
    {
        let why = "primitives are not iterated";
        warnings.push(format!("the method `{}` does not apply: {why}; using `own`", method.name()));
    }
    let steps = orbits.iter().filter_map(|orbit| wanted.or(orbit.settings.estimate).step);
    let difference_step = steps.into_iter().next().unwrap_or_default();
    let shares = orbits.iter().filter_map(|orbit| wanted.or(orbit.settings.estimate).least_step);
    let least_step = shares.chain(wanted.least_step).reduce(f64::min);
    let longest = orbits.iter().filter_map(|orbit| wanted.or(orbit.settings.estimate).most_step);
    let most_step = longest.chain(wanted.most_step).fold(f64::INFINITY, f64::min);
    let certified = choices.iter().any(|choice| choice.method.is_certified());
    let least_step = least_step.unwrap_or(if certified { LEAST_STEP_OF_PROOFS } else { LEAST_STEP });
    let stop_at = if certified { None } else { choose_stop(composer, wanted, (&orbits, &mut choices), &mut warnings)? };
    let plan = Plan {
        choices,
        bounding_radius,
        reach,
        members,
        fudge,
        least_step,
        most_step,
        stop_at,
        difference_step,
        warnings,
    };
    Ok(plan)
}

/// Measures what a choice says of the set: its extent, and what may be trusted.
fn measure_set(composer: &Composer, orbit: &FieldOrbit, choice: &mut Choice, late: bool) -> ComposeResult<()> {
    choice.extent = measure_extent(composer, orbit)?;
    if !choice.form.is_shape() {
        let has_both = [Method::Scalar, Method::Directional].iter().all(|m| choice.applicable.contains(m));
        choice.tight = has_both && measure_tightness(composer, orbit, choice.extent)?;
        choice.ends = !late && choice.by_length && measure_ends(composer, orbit, choice)?;
    }
    Ok(())
}

/// The threshold that rays stop at: what the command line or the file asks for, as long as every orbit's estimate means
/// that members are near where it is that small.
fn choose_stop(
    composer: &Composer,
    wanted: &EstimateSettings,
    (orbits, choices): (&[FieldOrbit], &mut [Choice]),
    warnings: &mut Vec<String>,
) -> ComposeResult<Option<StopAt>> {
    let graph = composer.graph;
    let own = match &graph.node(graph.output).kind {
        NodeKind::Orbit { settings, .. } => settings.estimate.stop_at,
        _ => None,
    };
    let Some(stop_at) = wanted.stop_at.or(own).or(graph.orbit.estimate.stop_at) else { return Ok(None) };
    let world = match stop_at {
        StopAt::Pixels(_) => None,
        StopAt::World(length) => Some(length),
    };
    for (orbit, choice) in orbits.iter().zip(&*choices).filter(|(_, choice)| !choice.form.is_shape()) {
        let scale = orbit.frame.reach(1.0).map_or(1.0, |reach| reach - orbit.frame.reach(0.0).unwrap_or(0.0));
        if !measure_stops(composer, orbit, choice, world.map(|length| length / scale.max(1e-30)))? {
            let (name, method) = (&composer.graph.node(orbit.root).name, choice.method.name());
            warnings.push(format!(
                "rays go on to the set: where the estimate of `{name}` by `{method}` is below `stop_at` there is nothing near; \
                 another method may do (`--de jacobian`, `--de delta`)"
            ));
            return Ok(None);
        }
    }
    choices.iter_mut().for_each(|choice| choice.stops = true);
    Ok(Some(stop_at))
}

fn choose_orbit(
    composer: &Composer,
    orbit: &FieldOrbit,
    settings: &EstimateSettings,
    warnings: &mut Vec<String>,
) -> ComposeResult<Choice> {
    let mut roots = vec![orbit.root];
    roots.extend(orbit.settings.pre.iter().chain(&orbit.settings.post));
    roots.extend(orbit.frame.maps());
    let steps: Vec<_> = roots.iter().flat_map(|root| steps_of(composer, *root)).collect();
    let blocking = steps.iter().find(|s| !s.differentiable).map(|s| s.name.clone());
    let rules: Option<Vec<ScalarRule>> = roots.iter().map(|root| scalar_rules(composer, *root)).collect();
    let exact = rules.as_ref().is_some_and(|r| !r.contains(&ScalarRule::Heuristic));
    let has_power = steps.iter().any(|s| s.growth == Some(Growth::Power));
    let has_linear = steps.iter().any(|s| s.growth == Some(Growth::Linear));
    let growth = measure_growth(composer, orbit)?;
    let levels = orbit.settings.shape.and_then(|shape| shape.levels);
    let smooth = levels.is_some_and(|levels| matches!(levels.join, Join::SmoothUnion(_)));
    let power = if orbit.settings.shape.is_some() { 1.0 } else { growth.power };
    let remembers = steps_of(composer, orbit.root).iter().find(|s| s.remembers()).map(|s| s.name.clone());
    let escape = orbit.settings.escape;
    let facts = Facts { blocking, remembers, has_rules: rules.is_some(), smooth, power, escape };
    let applicable: Vec<Method> = Method::ALL.into_iter().filter(|m| facts.why_not(*m).is_none()).collect();
    let blocking = &facts.blocking;
    let (mut method, mut reason) = match (blocking, rules.is_some()) {
        (Some(step), _) => {
            (Method::Delta, format!("the step `{step}` cannot be differentiated, so finite differences are taken"))
        }
        (None, false) => (Method::Gradient, "not every step states a scalar rule".to_string()),
        (None, true) if exact && !has_power => (Method::Scalar, "every step's scalar rule is exact".to_string()),
        (None, true) if has_power && !has_linear && !is_mixed(&steps) => {
            (Method::Gradient, "only a power: the exact gradient takes the fewest steps".to_string())
        }
        _ => (Method::Combined, "a hybrid: the smaller of the scalar rule and the exact gradient".to_string()),
    };
    if smooth && rules.is_some() {
        (method, reason) = (Method::Scalar, "levels with rounded seams are blended by the scalar rules".to_string());
    }
    if let Some(wanted) = settings.method {
        match facts.why_not(wanted) {
            None => (method, reason) = (wanted, "as asked".to_string()),
            Some(why) => warnings.push(format!(
                "the method `{}` does not apply: {why}; using `{}`",
                wanted.name(),
                method.name()
            )),
        }
    }
    let form = match settings.form {
        Some(form) if orbit.settings.shape.is_some() => {
            warnings.push(format!(
                "the form `{}` does not apply: the orbit's end shape decides what is inside",
                form.name()
            ));
            DeForm::End
        }
        None if orbit.settings.shape.is_some() => DeForm::End,
        Some(form) if method.is_potential() && form != DeForm::Logarithmic => {
            let (form, method) = (form.name(), method.name());
            warnings.push(format!("the form `{form}` does not apply: `{method}` is logarithmic by itself"));
            DeForm::Logarithmic
        }
        Some(form) if method.is_certified() && form.is_shape() => {
            let (form, method) = (form.name(), method.name());
            warnings.push(format!("the form `{form}` does not apply: `{method}` works only for orbits that escape"));
            growth.form()
        }
        Some(form @ (DeForm::Box | DeForm::Plane)) if escape.is_convergence() => {
            warnings.push(format!("the form `{}` does not apply: the orbit ends by convergence", form.name()));
            DeForm::Linear
        }
        Some(form) => form,
        None if escape.is_convergence() => DeForm::Linear,
        None if escape != Escape::Length && orbit.settings.escape_radius <= 1.0 => DeForm::Linear,
        None if method.is_potential() => DeForm::Logarithmic,
        None => {
            reason = format!("{reason}; {}", growth.evidence);
            growth.form()
        }
    };
    let default_fudge = if method.is_difference() { 0.7 } else { 1.0 };
    Ok(Choice {
        method,
        form,
        radius: settings.radius.unwrap_or(0.0),
        axis: settings.axis.unwrap_or([0.0, 0.0, 1.0]),
        power: growth.power,
        difference: settings.difference,
        fudge: settings.fudge.unwrap_or(default_fudge),
        differentiable: facts.blocking.is_none(),
        tight: false,
        ends: false,
        stops: false,
        extent: 0.0,
        by_length: escape == Escape::Length,
        precision: Precision::F32,
        applicable,
        reason,
    })
}

/// What decides which methods apply to an orbit.
struct Facts {
    /// A step that cannot be differentiated.
    blocking: Option<String>,
    /// An iterated step that reads its state of the time before.
    remembers: Option<String>,
    /// Whether all steps state scalar rules.
    has_rules: bool,
    /// Whether levels are joined with rounded seams, which depend on the distances themselves.
    smooth: bool,
    /// Power by which r grows in an iteration.
    power: f64,
    /// What ends the orbit.
    escape: Escape,
}

impl Facts {
    /// Why a method does not apply; `None` if it does.
    fn why_not(&self, method: Method) -> Option<String> {
        let no_rules = || Some("not every step states a scalar rule".to_string());
        if let (Some(step), true) = (&self.remembers, method.is_certified()) {
            return Some(format!(
                "the step `{step}` remembers its state of the time before, which proofs do not follow"
            ));
        }
        if method.is_certified() && self.escape == Escape::Still {
            return Some("proofs do not follow how far an orbit moves in an iteration".to_string());
        }
        if method.is_potential() && self.escape.is_convergence() {
            return Some("the orbit ends by convergence, and its potential is that of r".to_string());
        }
        match (method, &self.blocking) {
            (Method::Own, _) => Some("an iterated map has no distance of its own, only primitives have".to_string()),
            (method, _) if self.smooth && method != Method::Scalar => {
                Some("levels with rounded seams are blended by the steps' scalar rules".to_string())
            }
            (method, Some(step)) if method.is_exact() => Some(format!("the step `{step}` cannot be differentiated")),
            (Method::Scalar | Method::Combined, _) if !self.has_rules => no_rules(),
            (method, _) if method.is_potential() && self.power == 1.0 => {
                Some("r grows by a factor and not by a power, so there is no potential".to_string())
            }
            _ => None,
        }
    }
}

/// True where folds take part beside the powers.
fn is_mixed(steps: &[&crate::formula::step::Step]) -> bool {
    steps.iter().any(|s| s.group == "fold")
}

/// Bounding radius of a field, and how it is known. `radii` are those of its orbits.
fn reach_of(
    composer: &Composer,
    choices: &[Choice],
    radii: &[f64],
    warnings: &mut Vec<String>,
) -> ComposeResult<Found> {
    let is_endless = has_endless_primitives(composer);
    if let Some(radius) = composer.graph.bounding_radius {
        if !is_endless
            && !composer.graph.cuts
            && let Some(p) = member_beyond(composer, choices, radius)?
        {
            let [x, y, z] = p.map(|x| format!("{x:.3}"));
            warnings.push(format!(
                "the bounding radius of {radius} cuts the set: ({x}, {y}, {z}) belongs to it; \
                 write a larger one, or `cuts: true` where that is meant"
            ));
        }
        return Ok(Found { radius, reach: Reach::Stated, members: 0.0 });
    }
    if is_endless || is_made_of_primitives(composer) {
        let reach = if is_endless { Reach::Endless } else { Reach::Exact };
        return Ok(Found { radius: field_reach(composer, radii), reach, members: 0.0 });
    }
    let found = search(composer, choices)?;
    if found.reach == Reach::Endless {
        warnings.push(format!(
            "the set reaches beyond {FAR} units, where rays end; write `bounding_radius` to end them elsewhere"
        ));
    }
    Ok(found)
}

/// True if a field is made of primitives and their unions alone, so that its size is known.
fn is_made_of_primitives(composer: &Composer) -> bool {
    let mut open = vec![composer.graph.output];
    let mut seen = vec![false; composer.graph.nodes.len()];
    while let Some(node) = open.pop() {
        if std::mem::replace(&mut seen[node.0], true) {
            continue;
        }
        match &composer.graph.node(node).kind {
            NodeKind::Primitive(_) => {}
            NodeKind::Union(of) => open.extend(of),
            NodeKind::Transform { of, .. } => open.push(*of),
            _ => return false,
        }
    }
    true
}

/// Radius of a ball around the world's origin that holds the output. Unbounded primitives are cut to the rest's size.
fn field_reach(composer: &Composer, radii: &[f64]) -> f64 {
    let of_orbits = radii.iter().copied().fold(0.0, f64::max);
    let mut of_primitives: f64 = 0.0;
    let mut stack = vec![(composer.graph.output, super::placement::Frame::default())];
    while let Some((node, frame)) = stack.pop() {
        match &composer.graph.node(node).kind {
            NodeKind::Primitive(primitive) => {
                if let Some(reach) = primitive_reach(primitive).and_then(|reach| frame.reach(reach)) {
                    of_primitives = of_primitives.max(reach);
                }
            }
            NodeKind::Transform { of, placement } => stack.push((*of, frame.inside(*placement))),
            NodeKind::Orbit { .. } => {}
            kind => stack.extend(kind.wires().into_iter().map(|wire: NodeRef| (wire, frame.clone()))),
        }
    }
    let reach = of_orbits.max(of_primitives);
    if reach == 0.0 { 10.0 } else { reach }
}
