//! What is known of a step over a ball around its argument: by its file's own rules where it states them, else by bounds
//! of its derivative.

use rhai::Map;

use super::rounding::roundings;
use crate::compose::{ComposeResult, Composer};
use crate::diag::Diagnostic;
use crate::expr::differentiate::reachable;
use crate::expr::enclose::{UNBOUNDED, enclose_jacobian, norm_bound, substitute};
use crate::expr::{Differentiator, Encloser, Expr, Type};
use crate::formula::step::{ScalarRule, StateWidth, Step, StepInputs};
use crate::graph::{NodeKind, NodeRef};

/// What a step does to a ball, or to a segment in it. Lengths are in the step's own frame.
pub(super) struct StepRule<'g> {
    /// The image of the centre.
    pub(super) image: Expr<'g>,
    /// Most that a distance from the centre grows by, for points of the ball; of the tube where the tangent bends.
    pub(super) growth: Expr<'g>,
    /// Most that a distance of any two points of the ball grows by; at least [`UNBOUNDED`] where the step may jump.
    pub(super) stretch: Expr<'g>,
    /// The same for distances of the constant, where the step reads it.
    pub(super) by_constant: Option<Expr<'g>>,
    /// What becomes of the given vector.
    pub(super) tangent: Option<Tangent<'g>>,
    /// How much rounding there may be in the image: units of its length times the error of one rounding.
    pub(super) roundings: f64,
}

/// The derivative along a vector.
#[derive(Clone, Copy)]
pub(super) enum Tangent<'g> {
    /// At all points of the ball it lies in a ball with this centre and radius.
    Within(Expr<'g>, Expr<'g>),
    /// What it is at the centre, how long the second derivative of the [`Line`]'s image is at most by the way along it, and
    /// most that a distance grows by within the line's tube.
    Bending(Expr<'g>, Expr<'g>, Expr<'g>),
    /// A vector, a radius and a factor: the image of z + s v + s u is within s (radius + factor |u|) of the image of z
    /// plus s times the vector, for points that [`RuleInputs::l`] speaks of.
    Chord(Expr<'g>, Expr<'g>, Expr<'g>),
}

impl<'g> Tangent<'g> {
    fn parts(self) -> Vec<Expr<'g>> {
        match self {
            Tangent::Within(middle, radius) => vec![middle, radius],
            Tangent::Bending(along, bend, tube) => vec![along, bend, tube],
            Tangent::Chord(middle, radius, factor) => vec![middle, radius, factor],
        }
    }
}

/// What goes into a rule.
#[derive(Clone, Copy)]
pub(super) struct RuleInputs<'g> {
    /// Centre.
    pub(super) z: Expr<'g>,
    /// Radius of the ball.
    pub(super) e: Expr<'g>,
    /// Constant that the step may read, and the radius of the ball that it ranges over.
    pub(super) c: Expr<'g>,
    pub(super) e_c: Expr<'g>,
    /// Of a segment: its direction, whose derivatives are wanted.
    pub(super) line: Option<Line<'g>>,
    /// Points at s of the start lie within l s of the centre, and within e.
    pub(super) l: Expr<'g>,
    /// Number of the iteration.
    pub(super) n: Expr<'g>,
}

/// A segment through the centre and a tube around it.
#[derive(Clone, Copy)]
pub(super) struct Line<'g> {
    /// Direction by the start's parameter.
    pub(super) v: Expr<'g>,
    /// The same of length 1, as the step sees it; 0 where v is.
    pub(super) unit: Expr<'g>,
    /// How far it goes to both sides, as the step sees it.
    pub(super) reach: Expr<'g>,
    /// Radius of the tube.
    pub(super) tube: Expr<'g>,
}

impl<'g> Line<'g> {
    /// What a step sees of it that leaves w alone.
    fn in_space(self) -> Line<'g> {
        let seen = self.unit.xyz();
        let share = seen.length();
        Line { unit: seen * (1.0 / share.max(share.lift(1e-30))), reach: self.reach * share, ..self }
    }

    fn parts(&self) -> [Expr<'g>; 4] {
        [self.v, self.unit, self.reach, self.tube]
    }
}

/// First of the inputs that stand for a rule's arguments while it is traced; functions have far fewer inputs.
const PLACEHOLDERS: u16 = 60_000;

/// The rule of a step node. It is traced with inputs of its own instead of its arguments, so that identities do not
/// reach through them: what the argument was made of is not the step's business. The arguments are then put in.
pub(super) fn step_rule<'a>(
    composer: &Composer<'a>,
    node: NodeRef,
    inputs: RuleInputs<'a>,
) -> ComposeResult<Option<StepRule<'a>>> {
    let place = composer.graph.node(node);
    let NodeKind::Step { step, params } = &place.kind else { return Ok(None) };
    let arena = composer.arena;
    let input = |i: u16, ty: Type| arena.input(PLACEHOLDERS + i, ty);
    let (wide, number) = (inputs.z.ty(), Type::F);
    let is_narrow = step.state == StateWidth::Three && wide.width == 4;
    let line = inputs.line.map(|line| if is_narrow { line.in_space() } else { line });
    // A constant that is known is used as it is.
    let c = if inputs.c.as_constant().is_some() { inputs.c } else { input(1, wide) };
    let symbols = RuleInputs {
        z: input(0, wide),
        e: input(2, number),
        c,
        e_c: input(3, number),
        line: line.map(|line| Line {
            v: input(4, wide),
            unit: input(6, line.unit.ty()),
            reach: input(7, number),
            tube: input(8, number),
        }),
        l: input(5, number),
        n: inputs.n,
    };
    let map = super::super::maps::param_map(composer, step, params, inputs.n);
    let rule = Tracer { composer, step, map: &map, inputs: symbols }
        .rule()
        .map_err(|error| error.label(place.span, format!("used by the node `{}`", place.name)))?;
    let mut places =
        vec![(symbols.z, inputs.z), (symbols.e, inputs.e), (symbols.e_c, inputs.e_c), (symbols.l, inputs.l)];
    if inputs.c.as_constant().is_none() {
        places.push((symbols.c, inputs.c));
    }
    if let (Some(symbols), Some(line)) = (symbols.line, line) {
        places.extend(symbols.parts().into_iter().zip(line.parts()));
    }
    let mut roots = vec![rule.image, rule.growth, rule.stretch];
    roots.extend(rule.by_constant);
    roots.extend(rule.tangent.iter().flat_map(|tangent| tangent.parts()));
    let mut real = substitute(arena, &roots, &places).into_iter();
    let mut next = || real.next().expect("as many come out as went in");
    Ok(Some(StepRule {
        image: next(),
        growth: next(),
        stretch: next(),
        by_constant: rule.by_constant.map(|_| next()),
        tangent: rule.tangent.map(|tangent| match tangent {
            Tangent::Within(..) => Tangent::Within(next(), next()),
            Tangent::Bending(..) => Tangent::Bending(next(), next(), next()),
            Tangent::Chord(..) => Tangent::Chord(next(), next(), next()),
        }),
        roundings: rule.roundings,
    }))
}

struct Tracer<'a, 's> {
    composer: &'s Composer<'a>,
    step: &'s Step,
    map: &'s Map,
    inputs: RuleInputs<'a>,
}

impl<'a> Tracer<'a, '_> {
    fn rule(&self) -> Result<StepRule<'a>, Diagnostic> {
        let arena = self.composer.arena;
        let image = self.image()?;
        let nodes = reachable(arena, &[image.id]);
        let reads_c = self.inputs.c.as_constant().is_none() && nodes.contains(&self.inputs.c.id);
        let (stretch, by_constant) = self.stretch(image, reads_c)?;
        let tangent = match self.inputs.line {
            Some(line) if self.step.differentiable && !reads_c => self.tangent(image, line)?,
            _ => None,
        };
        let growth = match tangent {
            // Everything is in the tube.
            Some(Tangent::Bending(_, _, within)) => within,
            _ if reads_c => stretch,
            _ => self.number("growth")?.unwrap_or(stretch),
        };
        Ok(StepRule { image, growth, stretch, by_constant, tangent, roundings: roundings(image) })
    }

    fn tangent(&self, image: Expr<'a>, line: Line<'a>) -> Result<Option<Tangent<'a>>, Diagnostic> {
        let (arena, library) = (self.composer.arena, self.composer.library);
        let RuleInputs { z, l, e, .. } = self.inputs;
        let Line { v, unit, reach, tube } = line;
        let chord = self.step.trace_chord(&library.engine, &library.sources, arena, &[z, v, l, e], self.map)?;
        if let Some([middle, radius]) = chord.filter(|_| self.step.scalar_rule == Some(ScalarRule::Exact))
            && let (_, Some(factor)) = self.trace(Some(arena.f(1.0)))?
        {
            return Ok(Some(Tangent::Chord(middle, radius, factor)));
        }
        let along = Differentiator::new(arena, &[(z, v)]).derivative(image);
        if let Some(bend) = self.traced_number("bend", &[z, unit, reach])? {
            let within = match self.traced_number("tube", &[z, unit, reach, tube])? {
                Some(number) => self.with_w(number),
                // The ball that holds the tube.
                None => {
                    Tracer { inputs: RuleInputs { e: reach + tube, ..self.inputs }, ..*self }.stretch(image, false)?.0
                }
            };
            return Ok(Some(Tangent::Bending(along, bend, within)));
        }
        // Of maps whose derivative is only guessed by r, bounds of the derivative over a ball were measured to be wider
        // than a stated growth, at four times its cost: there the segment starts again.
        if self.step.scalar_rule == Some(ScalarRule::Heuristic) {
            return Ok(None);
        }
        let bounds = Encloser::new(arena, &[(self.inputs.z, self.inputs.e)]).bounds(along);
        let middle: Vec<Expr> = bounds.iter().map(|b| b.middle()).collect();
        let radius: Vec<Expr> = bounds.iter().map(|b| b.half_width()).collect();
        Ok(Some(Tangent::Within(arena.compose(&middle), arena.compose(&radius).length())))
    }

    fn image(&self) -> Result<Expr<'a>, Diagnostic> {
        self.trace(None).map(|(image, _)| image)
    }

    fn trace(&self, dr: Option<Expr<'a>>) -> Result<(Expr<'a>, Option<Expr<'a>>), Diagnostic> {
        let library = self.composer.library;
        // Iterated steps that remember are not proven; where one runs once there is nothing before it.
        let inputs = StepInputs::first(self.inputs.z, self.inputs.c, dr);
        let traced = self.step.trace(&library.engine, &library.sources, self.composer.arena, inputs, self.map)?;
        Ok((traced.z, traced.dr))
    }

    /// A rule of the step's file, at least 1 if the step leaves w alone.
    fn number(&self, function: &str) -> Result<Option<Expr<'a>>, Diagnostic> {
        let number = self.traced_number(function, &[self.inputs.z, self.inputs.e])?;
        Ok(number.map(|number| self.with_w(number)))
    }

    fn traced_number(&self, function: &str, arguments: &[Expr<'a>]) -> Result<Option<Expr<'a>>, Diagnostic> {
        let library = self.composer.library;
        let arena = self.composer.arena;
        self.step.trace_number(&library.engine, &library.sources, arena, function, arguments, self.map)
    }

    fn with_w(&self, number: Expr<'a>) -> Expr<'a> {
        let narrow = self.step.state == StateWidth::Three && self.inputs.z.ty().width == 4;
        if narrow { number.max(number.lift(1.0)) } else { number }
    }

    /// Most that distances of z grow by, and of the constant where the step reads it.
    fn stretch(&self, image: Expr<'a>, reads_c: bool) -> Result<(Expr<'a>, Option<Expr<'a>>), Diagnostic> {
        Ok(match self.stated_stretch(image, reads_c)? {
            Some(stretch) => (stretch, None),
            None => self.derived_stretch(image, reads_c),
        })
    }

    /// The stretch by `fn stretch`, or the largest value over the ball of an exact scalar rule of a step that does not
    /// jump there.
    fn stated_stretch(&self, image: Expr<'a>, reads_c: bool) -> Result<Option<Expr<'a>>, Diagnostic> {
        if reads_c {
            return Ok(None);
        }
        if let Some(stretch) = self.number("stretch")? {
            return Ok(Some(stretch));
        }
        if self.step.scalar_rule != Some(ScalarRule::Exact) {
            return Ok(None);
        }
        let arena = self.composer.arena;
        let (_, Some(factor)) = self.trace(Some(arena.f(1.0)))? else { return Ok(None) };
        let most = self.encloser().bounds(factor)[0].hi;
        Ok(Some(self.unless_it_jumps(image, self.with_w(most))))
    }

    fn encloser(&self) -> Encloser<'a> {
        let inputs = &self.inputs;
        let mut balls = vec![(inputs.z, inputs.e)];
        if inputs.c.as_constant().is_none() {
            balls.push((inputs.c, inputs.e_c));
        }
        Encloser::new(self.composer.arena, &balls)
    }

    fn unless_it_jumps(&self, image: Expr<'a>, stretch: Expr<'a>) -> Expr<'a> {
        let mut encloser = self.encloser();
        encloser.bounds(image);
        encloser.jumps().select(stretch.lift(UNBOUNDED), stretch)
    }

    /// The stretch by bounds of the Jacobian over the ball, by z and where it is read by c.
    fn derived_stretch(&self, image: Expr<'a>, reads_c: bool) -> (Expr<'a>, Option<Expr<'a>>) {
        let arena = self.composer.arena;
        if !self.step.differentiable {
            return (arena.f(UNBOUNDED), reads_c.then(|| arena.f(UNBOUNDED)));
        }
        let by = |x: Expr<'a>| {
            let rows = enclose_jacobian(&mut self.encloser(), arena, image, x);
            self.unless_it_jumps(image, norm_bound(&rows))
        };
        (by(self.inputs.z), reads_c.then(|| by(self.inputs.c)))
    }
}
