//! One orbit: start values and iterations with their derivatives. What the end state says is the module `estimate`'s.

use rhai::Map;

use super::choose::MEASURED_CYCLE;
use super::levels::Joined;
use super::placement::Frame;
use super::{Choice, ComposeResult, Composer, Purpose};
use crate::expr::{Arena, Differentiator, Expr, Function, Port, Type};
use crate::formula::script::base_scope;
use crate::formula::step::{ParamKind, ScalarRule, Step, StepInputs, Traced, script_expr, script_value};
use crate::formula::symbolic::to_dynamic;
use crate::graph::{
    Condition, Constant, DeForm, IterationMap, MapTree, Method, NodeKind, NodeRef, OrbitSettings, ParamInput,
    resolve_schedule,
};
use crate::kernel::{EstimatorInputs, Orbit};

/// Value and scalar derivative of a map.
pub(super) type Moved<'g> = Traced<'g>;

/// What an orbit carries besides z.
pub(super) struct Carried {
    /// Running derivative.
    pub(super) scalar: bool,
    /// Rows of the Jacobian by p: the gradient of each component of z.
    pub(super) jacobian: bool,
    /// Derivative of z along the ray.
    pub(super) along: bool,
    /// Orbits of shifted points.
    pub(super) shifted: Shifted,
    /// Orbit traps.
    pub(super) traps: bool,
}

/// Which points finite differences are taken to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shifted {
    None,
    /// p + h along each axis.
    Axes,
    /// p + h along the ray.
    Ray,
}

impl Carried {
    pub(super) const NOTHING: Carried =
        Carried { scalar: false, jacobian: false, along: false, shifted: Shifted::None, traps: false };

    pub(super) fn of(choice: &Choice, purpose: Purpose) -> Carried {
        if purpose == Purpose::Surface {
            let shifted = if choice.differentiable { Shifted::None } else { Shifted::Axes };
            return Carried { jacobian: choice.differentiable, shifted, traps: true, ..Carried::NOTHING };
        }
        let nothing = Carried::NOTHING;
        match choice.method {
            Method::Scalar => Carried { scalar: true, ..nothing },
            Method::Gradient | Method::Jacobian | Method::Frobenius | Method::Potential | Method::Sinh => {
                Carried { jacobian: true, ..nothing }
            }
            Method::Combined => Carried { scalar: true, jacobian: true, ..nothing },
            Method::Directional => Carried { along: true, ..nothing },
            Method::Delta => Carried { shifted: Shifted::Axes, ..nothing },
            Method::DeltaRay => Carried { shifted: Shifted::Ray, ..nothing },
            // Certified orbits have a builder of their own.
            Method::Own | Method::Certified | Method::CertifiedBall => nothing,
        }
    }
}

/// Expressions of the whole state.
#[derive(Clone)]
pub(super) struct State<'g> {
    pub(super) z: Expr<'g>,
    pub(super) dr: Option<Expr<'g>>,
    pub(super) rows: Vec<Expr<'g>>,
    pub(super) along: Option<Expr<'g>>,
    pub(super) shifted: Vec<Expr<'g>>,
    pub(super) trap: Option<Expr<'g>>,
    /// Levels of the orbit's shape so far.
    pub(super) joined: Option<Joined<'g>>,
}

impl<'g> State<'g> {
    pub(super) fn parts(&self) -> Vec<(String, Expr<'g>)> {
        let numbered = |name: &'static str, list: &[Expr<'g>]| {
            let axes = ["x", "y", "z", "w"];
            list.iter().zip(axes).map(|(e, axis)| (format!("{name}_{axis}"), *e)).collect::<Vec<_>>()
        };
        let mut parts = vec![("z".to_string(), self.z)];
        parts.extend(self.dr.map(|dr| ("dr".to_string(), dr)));
        parts.extend(numbered("j", &self.rows));
        parts.extend(self.along.map(|along| ("along".to_string(), along)));
        parts.extend(numbered("z", &self.shifted));
        parts.extend(self.trap.map(|trap| ("trap".to_string(), trap)));
        if let Some(joined) = &self.joined {
            parts.push(("level".to_string(), joined.d));
            parts.extend(joined.gradient.map(|gradient| ("level_gradient".to_string(), gradient)));
        }
        parts
    }

    /// The same parts as inputs of a function, starting at input `first`.
    pub(super) fn as_inputs(&self, first: usize) -> State<'g> {
        let mut next = first as u16;
        let mut input = |e: Expr<'g>| {
            next += 1;
            e.arena.input(next - 1, e.ty())
        };
        State {
            z: input(self.z),
            dr: self.dr.map(&mut input),
            rows: self.rows.iter().map(|e| input(*e)).collect(),
            along: self.along.map(&mut input),
            shifted: self.shifted.iter().map(|e| input(*e)).collect(),
            trap: self.trap.map(&mut input),
            joined: self
                .joined
                .as_ref()
                .map(|joined| Joined { d: input(joined.d), gradient: joined.gradient.map(&mut input) }),
        }
    }

    pub(super) fn ports(&self) -> Vec<Port> {
        self.parts().into_iter().map(|(name, e)| Port::new(name, e.ty())).collect()
    }
}

/// Values of the start point that iterations read: c and its derivatives, each a constant or a frozen input.
pub(super) struct Constants<'g> {
    pub(super) c: Expr<'g>,
    /// Growth of c per unit of p: the "+1".
    pub(super) dc: Expr<'g>,
    /// Gradients of its components by p.
    pub(super) rows: Vec<Expr<'g>>,
    /// Its derivative along the ray.
    pub(super) along: Option<Expr<'g>>,
    /// It at the shifted points.
    pub(super) shifted: Vec<Expr<'g>>,
    /// Step of finite differences.
    pub(super) h: Expr<'g>,
    /// Hit threshold.
    pub(super) hit_eps: Expr<'g>,
}

/// Builds the orbit of a node for a purpose.
pub(super) fn compose_orbit(
    composer: &Composer,
    name: String,
    root: NodeRef,
    settings: &OrbitSettings,
    frame: &Frame,
    choice: &Choice,
    purpose: Purpose,
) -> ComposeResult<Orbit> {
    if choice.method.is_certified() && purpose != Purpose::Surface {
        return super::certified::compose_certified(composer, name, root, settings, frame, choice, purpose);
    }
    let width = composer.graph.state_width(root, settings);
    let mut carried = Carried::of(choice, purpose);
    carried.traps &= composer.graph.look.reads_traps();
    OrbitBuilder { composer, settings, frame, width, carried, choice, purpose }.build(name, root)
}

pub(super) struct OrbitBuilder<'a> {
    pub(super) composer: &'a Composer<'a>,
    pub(super) settings: &'a OrbitSettings,
    pub(super) frame: &'a Frame,
    pub(super) width: u8,
    pub(super) carried: Carried,
    pub(super) choice: &'a Choice,
    pub(super) purpose: Purpose,
}

impl<'a> OrbitBuilder<'a> {
    fn build(&self, name: String, root: NodeRef) -> ComposeResult<Orbit> {
        let (maps, schedule) =
            resolve_schedule(self.composer.graph, root, self.settings.constant, self.settings.max_iterations);
        let (start, constants) = self.start()?;
        let (init, frozen, constants) = self.freeze(&name, &start, constants, &maps);
        let inputs = start.as_inputs(0);
        let n = self.composer.arena.input((start.parts().len() + frozen.len()) as u16, Type::F);
        let mut ports = start.ports();
        ports.extend(frozen.clone());
        ports.push(Port::new("n", Type::F));
        let mut items = Vec::new();
        for (i, item) in maps.iter().enumerate() {
            let mut function = Function::new(format!("{name}_iterate_{i}"), ports.clone());
            let next = self.iterate(item, &inputs, &constants, n)?;
            for (name, e) in next.parts() {
                function.output(name, e);
            }
            function.output("escaped", self.has_ended(&next, constants.hit_eps));
            items.push(function);
        }
        let mut finish = Function::new(format!("{name}_finish"), ports);
        self.finish(&mut finish, &inputs, &constants, n)?;
        Ok(Orbit {
            name,
            state: start.ports(),
            frozen,
            init,
            items,
            schedule,
            finish,
            max_iterations: self.settings.max_iterations,
        })
    }

    /// Start values as expressions of the [`EstimatorInputs`].
    pub(super) fn start(&self) -> ComposeResult<(State<'a>, Constants<'a>)> {
        let arena = self.composer.arena;
        let EstimatorInputs { p, d, h, hit_eps } = EstimatorInputs::new(arena);
        let offsets = match self.carried.shifted {
            Shifted::None => Vec::new(),
            Shifted::Axes => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| arena.v3(axis)).to_vec(),
            Shifted::Ray => vec![d],
        };
        let begin = |p: Expr<'a>| -> ComposeResult<Moved<'a>> {
            let dr = self.carried.scalar.then(|| arena.f(1.0));
            let Moved { z: local, dr } = self.frame.locate(self.composer, Moved { z: p, dr })?;
            let z = self.widened(local, self.settings.slice);
            let zero = z.lift(0.0);
            self.apply_all(&self.settings.pre, Moved { z, dr }, zero)
        };
        let first = begin(p)?;
        let rows = match self.carried.jacobian {
            true => Differentiator::by(arena, p).tangents(first.z),
            false => Vec::new(),
        };
        let along = self.carried.along.then(|| Differentiator::new(arena, &[(p, d)]).derivative(first.z));
        let shifted = offsets.iter().map(|offset| begin(p + *offset * h).map(|m| m.z));
        let shifted = shifted.collect::<ComposeResult<Vec<_>>>()?;
        let far = arena.constant(Type::V4, [1e6; 4]);
        let state = State {
            z: first.z,
            dr: first.dr,
            rows: rows.clone(),
            along,
            shifted: shifted.clone(),
            trap: self.carried.traps.then_some(far),
            joined: None,
        };
        let dc = first.dr.unwrap_or_else(|| arena.f(0.0));
        let constants = Constants { c: first.z, dc, rows, along, shifted, h, hit_eps };
        let state = self.with_level(state, None, &constants, arena.f(0.0))?;
        Ok((state, constants))
    }

    /// A point as the first state: with `w` added where the state has four components that no first map makes.
    fn widened(&self, local: Expr<'a>, w: f64) -> Expr<'a> {
        let embeds = self.settings.pre.iter().any(|node| self.composer.graph.embeds(*node));
        if self.width != 4 || embeds {
            return local;
        }
        let parts = local.components();
        self.composer.arena.compose(&[parts[0], parts[1], parts[2], self.composer.arena.f(w)])
    }

    /// Makes the `init` function; what iterations read of the start point becomes frozen inputs unless it is constant.
    pub(super) fn freeze(
        &self,
        name: &str,
        start: &State<'a>,
        constants: Constants<'a>,
        maps: &[IterationMap],
    ) -> (Function, Vec<Port>, Constants<'a>) {
        let mut init = Function::new(format!("{name}_init"), crate::kernel::Estimator::inputs());
        for (name, e) in start.parts() {
            init.output(name, e);
        }
        let mut frozen = Vec::new();
        let mut next = start.parts().len() as u16;
        let mut freeze = |name: &str, e: Expr<'a>| {
            if e.as_constant().is_some() {
                return e;
            }
            init.output(name, e);
            frozen.push(Port::new(name, e.ty()));
            next += 1;
            e.arena.input(next - 1, e.ty())
        };
        let moves = maps.iter().any(|m| m.constant.start_weight() != 0.0);
        let mut keep = |name: &str, e: Expr<'a>| if moves { freeze(name, e) } else { e.lift(0.0) };
        let mut all = |names: [&str; 4], list: &[Expr<'a>]| -> Vec<Expr<'a>> {
            list.iter().zip(names).map(|(e, name)| keep(name, *e)).collect()
        };
        let rows = all(["c_x", "c_y", "c_z", "c_w"], &constants.rows);
        let shifted = all(["c_at_x", "c_at_y", "c_at_z", "c_at_w"], &constants.shifted);
        let along = constants.along.map(|e| keep("c_along", e));
        let c = keep("c", constants.c);
        let dc = keep("dc", constants.dc);
        let h = if self.carried.shifted == Shifted::None { constants.h } else { freeze("h", constants.h) };
        let hit_eps = if self.follows_footprint() { freeze("hit_eps", constants.hit_eps) } else { constants.hit_eps };
        (init, frozen, Constants { c, dc, rows, along, shifted, h, hit_eps })
    }

    /// One iteration: the map, then the constant.
    pub(super) fn iterate(
        &self,
        item: &IterationMap,
        state: &State<'a>,
        constants: &Constants<'a>,
        n: Expr<'a>,
    ) -> ComposeResult<State<'a>> {
        let arena = self.composer.arena;
        let weight = item.constant.start_weight();
        let c = self.constant(item.constant, constants.c);
        let input = Moved { z: state.z, dr: state.dr };
        let moved = apply(self.composer, &item.map, input, c, n)?;
        let z = moved.z + c;
        let dr = moved.dr.map(|dr| dr + constants.dc * weight);
        let rows = match self.carried.jacobian {
            true => {
                let seeds = [(state.z, state.rows.clone()), (constants.c, constants.rows.clone())];
                Differentiator::of_gradients(arena, &seeds).tangents(z)
            }
            false => Vec::new(),
        };
        let along = state.along.zip(constants.along).map(|(along, c_along)| {
            Differentiator::new(arena, &[(state.z, along), (constants.c, c_along)]).derivative(z)
        });
        let mut shifted = Vec::new();
        for (z, c) in state.shifted.iter().zip(&constants.shifted) {
            let c = self.constant(item.constant, *c);
            let moved = apply(self.composer, &item.map, Moved { z: *z, dr: None }, c, n)?;
            shifted.push(moved.z + c);
        }
        let trap = state.trap.map(|trap| {
            let sizes = z.xyz().abs().components();
            trap.min(arena.compose(&[z.xyz().dot(z.xyz()), sizes[0], sizes[1], sizes[2]]))
        });
        let next = State { z, dr, rows, along, shifted, trap, joined: None };
        self.with_level(next, state.joined.as_ref(), constants, n + 1.0)
    }

    /// The constant of an iteration from the start point's.
    fn constant(&self, constant: Constant, c: Expr<'a>) -> Expr<'a> {
        fixed_constant(self.composer.arena, constant, c)
    }

    pub(super) fn apply_all(&self, nodes: &[NodeRef], moved: Moved<'a>, c: Expr<'a>) -> ComposeResult<Moved<'a>> {
        apply_all(self.composer, nodes, moved, c)
    }
}

/// What an iteration adds, from the start point's constant.
pub(super) fn fixed_constant<'a>(arena: &'a Arena, constant: Constant, c: Expr<'a>) -> Expr<'a> {
    let fixed = |v: [f64; 3]| arena.constant(c.ty(), [v[0], v[1], v[2], 0.0]);
    match constant {
        Constant::Mandelbrot => c,
        Constant::Julia(v) => fixed(v),
        Constant::Mix(v, amount) => c * (1.0 - amount) + fixed(v) * amount,
        Constant::Off => c.lift(0.0),
    }
}

/// Applies maps one after the other, each as its first iteration.
pub(super) fn apply_all<'a>(
    composer: &Composer<'a>,
    nodes: &[NodeRef],
    mut moved: Moved<'a>,
    c: Expr<'a>,
) -> ComposeResult<Moved<'a>> {
    let n = composer.arena.f(0.0);
    for node in nodes {
        let (maps, _) = resolve_schedule(composer.graph, *node, Constant::Off, 1);
        moved = apply(composer, &maps[0].map, moved, c, n)?;
    }
    Ok(moved)
}

/// Applies a map to a state.
pub(super) fn apply<'a>(
    composer: &Composer<'a>,
    map: &MapTree,
    input: Moved<'a>,
    c: Expr<'a>,
    n: Expr<'a>,
) -> ComposeResult<Moved<'a>> {
    let again = |m: &Moved<'a>| Moved { z: m.z, dr: m.dr };
    match map {
        MapTree::Identity => Ok(input),
        MapTree::Step(node) => apply_step(composer, *node, input, c, n),
        MapTree::Sequence(parts) => parts.iter().try_fold(input, |moved, part| apply(composer, part, moved, c, n)),
        MapTree::Repeat(of, times) => (0..*times).try_fold(input, |moved, _| apply(composer, of, moved, c, n)),
        MapTree::Blend(a, b, weight) => {
            let a = apply(composer, a, again(&input), c, n)?;
            let b = apply(composer, b, input, c, n)?;
            let z = a.z * (1.0 - weight) + b.z * *weight;
            let dr = a.dr.zip(b.dr).map(|(a, b)| a * (1.0 - weight).abs() + b * weight.abs());
            Ok(Moved { z, dr })
        }
        MapTree::Choose(when, then, otherwise) => {
            let holds = condition(*when, input.z);
            let then = apply(composer, then, again(&input), c, n)?;
            let otherwise = apply(composer, otherwise, input, c, n)?;
            let dr = then.dr.zip(otherwise.dr).map(|(a, b)| holds.select(a, b));
            Ok(Moved { z: holds.select(then.z, otherwise.z), dr })
        }
    }
}

pub(super) fn condition<'g>(when: Condition, z: Expr<'g>) -> Expr<'g> {
    let arena = z.arena;
    match when {
        Condition::RadiusBelow(limit) => z.dot(z).lt(arena.f(limit * limit)),
        Condition::RadiusAbove(limit) => arena.f(limit * limit).lt(z.dot(z)),
        Condition::Negative(axis) => z.component(axis.min(z.ty().width - 1)).lt(arena.f(0.0)),
        Condition::Positive(axis) => arena.f(0.0).lt(z.component(axis.min(z.ty().width - 1))),
        // Conditions on the iteration number were decided by the schedule.
        Condition::IterationBelow(_) | Condition::IterationEvery(_) => arena.bool(true),
    }
}

fn apply_step<'a>(
    composer: &Composer<'a>,
    node: NodeRef,
    input: Moved<'a>,
    c: Expr<'a>,
    n: Expr<'a>,
) -> ComposeResult<Moved<'a>> {
    let place = composer.graph.node(node);
    let NodeKind::Step { step, params } = &place.kind else {
        return Ok(input); // the schedule makes `MapTree::Step` of step nodes only
    };
    let map = param_map(composer, step, params, n);
    let narrow = step.state == crate::formula::step::StateWidth::Three && input.z.ty().width == 4;
    let before = input.dr;
    let inputs = StepInputs { z: input.z, c, dr: input.dr };
    let library = composer.library;
    let mut moved = step
        .trace(&library.engine, &library.sources, composer.arena, inputs, &map)
        .map_err(|error| error.label(place.span, format!("used by the node `{}`", place.name)))?;
    if narrow {
        // w is left as it was, so the derivative cannot shrink below what it had.
        moved.dr = moved.dr.zip(before).map(|(after, before)| after.max(before));
    }
    Ok(moved)
}

/// A step's parameters as its script sees them.
pub(super) fn param_map<'a>(composer: &Composer<'a>, step: &Step, params: &[ParamInput], n: Expr<'a>) -> Map {
    let mut map = Map::new();
    for (param, value) in step.params.iter().zip(params) {
        map.insert(param.name.as_str().into(), param_value(composer, &param.kind, value, n));
    }
    map
}

fn param_value<'a>(composer: &Composer<'a>, kind: &ParamKind, value: &ParamInput, n: Expr<'a>) -> rhai::Dynamic {
    match value {
        ParamInput::Known(value) => script_value(composer.arena, kind, value),
        ParamInput::OfIteration(text) => {
            let mut scope = base_scope();
            for param in &composer.graph.params {
                scope.push_constant(param.name.clone(), param.value);
            }
            scope.push_constant_dynamic("n", to_dynamic(composer.arena, n));
            let value = composer.library.engine.expression(text, &mut scope).unwrap_or(rhai::Dynamic::UNIT);
            match (value.read_lock::<crate::formula::symbolic::Symbol>(), value.as_float()) {
                (Some(symbol), _) => script_expr(composer.arena, kind, composer.arena.expr(symbol.expr().id)),
                (None, Ok(x)) => script_expr(composer.arena, kind, composer.arena.f(x)),
                _ => rhai::Dynamic::from_float(value.as_int().map_or(f64::NAN, |i| i as f64)),
            }
        }
    }
}

/// A function that maps z to r after one cycle of the schedule without its constants: how orbits grow far out. Also gives
/// the number of iterations in it: 16 at most.
pub fn compose_growth(
    composer: &Composer,
    root: NodeRef,
    settings: &OrbitSettings,
) -> ComposeResult<(Function, usize)> {
    let width = composer.graph.state_width(root, settings);
    let (maps, schedule) = resolve_schedule(composer.graph, root, settings.constant, settings.max_iterations);
    let mut function = Function::new("growth", vec![Port::new("z", Type::F.with_width(width))]);
    let z = composer.arena.input(0, Type::F.with_width(width));
    let n = composer.arena.f(0.0);
    let mut moved = Moved { z, dr: None };
    for item in schedule.cycle.iter().take(MEASURED_CYCLE) {
        moved = apply(composer, &maps[*item].map, moved, z.lift(0.0), n)?;
    }
    function.output("r", moved.z.length());
    Ok((function, schedule.cycle.len().min(MEASURED_CYCLE)))
}

/// The steps of a node and of all it is wired to.
pub(super) fn steps_of<'g>(composer: &'g Composer, root: NodeRef) -> Vec<&'g Step> {
    let mut stack = vec![root];
    let mut seen = vec![false; composer.graph.nodes.len()];
    let mut steps = Vec::new();
    while let Some(of) = stack.pop() {
        if std::mem::replace(&mut seen[of.0], true) {
            continue;
        }
        let kind = &composer.graph.node(of).kind;
        if let NodeKind::Step { step, .. } = kind {
            steps.push(&**step);
        }
        stack.extend(kind.wires());
    }
    steps
}

/// The weakest scalar rule of a map's steps; `None` where one of them has none.
pub fn scalar_rules(composer: &Composer, root: NodeRef) -> Option<ScalarRule> {
    let rules = steps_of(composer, root).into_iter().map(|s| s.scalar_rule).collect::<Option<Vec<_>>>()?;
    Some(if rules.contains(&ScalarRule::Heuristic) { ScalarRule::Heuristic } else { ScalarRule::Exact })
}

/// A kernel that says `inside` for points of an orbit's own frame.
pub(super) fn compose_membership(
    composer: &Composer,
    root: NodeRef,
    settings: &OrbitSettings,
) -> ComposeResult<crate::kernel::Kernel> {
    let choice = Choice::default();
    let frame = Frame::default();
    let width = composer.graph.state_width(root, settings);
    let is_shape = settings.shape.is_some();
    let choice = Choice { form: if is_shape { DeForm::End } else { choice.form }, ..choice };
    let carried = Carried::NOTHING;
    let purpose = Purpose::Estimate;
    let builder = OrbitBuilder { composer, settings, frame: &frame, width, carried, choice: &choice, purpose };
    let orbit = builder.build("membership".to_string(), root)?;
    let mut inputs = crate::kernel::Estimator::inputs();
    inputs.extend(orbit.finish.output_ports());
    inputs.push(Port::new("inside", Type::B));
    inputs.push(Port::new("n", Type::F));
    let mut combine = Function::new("combine", inputs);
    let mut inside = composer.arena.input((combine.inputs.len() - 2) as u16, Type::B);
    if is_shape {
        let de = composer.arena.input(crate::kernel::Estimator::inputs().len() as u16, Type::F);
        inside = inside.and(de.lt(composer.arena.f(0.0)));
    }
    combine.output("inside", inside);
    Ok(crate::kernel::Kernel::Estimate(crate::kernel::Estimator { orbits: vec![orbit], combine }))
}
