//! One orbit: start values and iterations with their derivatives. What the end state says is the module `estimate`'s.

use super::footprint::{SHARE_OF_TRUTH, can_follow_footprint, trusts_rules};
use super::levels::Joined;
use super::maps::{Memory, Moved, apply, apply_all, fixed_constant, remembering};
use super::paint::{Notes, untouched};
use super::placement::Frame;
use super::{Choice, ComposeResult, Composer, Purpose};
use crate::expr::{Differentiator, Expr, Function, Port, Type};
use crate::graph::{Constant, Escape, IterationMap, Marks, Method, NodeRef, OrbitSettings, resolve_schedule};
use crate::kernel::Orbit;
use crate::kernel::records::Query;

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
    /// What else is noted for colours and matter.
    pub(super) marks: Marks,
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
    pub(super) const NOTHING: Carried = Carried {
        scalar: false,
        jacobian: false,
        along: false,
        shifted: Shifted::None,
        traps: false,
        marks: Marks { caught: [false; 4], places: [false; 4], smooth: false, radius: false },
    };

    /// What the method needs, and what tells of the footprint: in marches the scalar rules where they are to be trusted, else the
    /// derivative along the ray.
    pub(super) fn of(choice: &Choice, purpose: Purpose) -> Carried {
        let mut carried = Carried::by_method(choice, purpose);
        if !can_follow_footprint(choice, purpose) {
            return carried;
        }
        if purpose == Purpose::Truth {
            return Carried { shifted: Shifted::Ray, ..Carried::NOTHING };
        }
        let trusts = trusts_rules(choice);
        let tells = carried.jacobian || carried.along || carried.scalar && trusts;
        if !tells {
            carried.scalar |= trusts && choice.applicable.contains(&Method::Scalar);
            carried.along = choice.differentiable && !(carried.scalar && trusts);
        }
        carried
    }

    fn by_method(choice: &Choice, purpose: Purpose) -> Carried {
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
    /// What is noted for colours and matter.
    pub(super) notes: Notes<'g>,
    /// Levels of the orbit's shape so far.
    pub(super) joined: Option<Joined<'g>>,
    /// What steps that remember had the last time.
    pub(super) before: Vec<Before<'g>>,
}

/// What a node of a step that remembers had the last time that it ran: loop variables beside the state, made only for steps
/// that ask for them.
#[derive(Clone)]
pub(super) struct Before<'g> {
    /// The step's node; none for what the escape test compares with.
    node: Option<NodeRef>,
    pub(super) z: Expr<'g>,
    pub(super) dr: Option<Expr<'g>>,
    pub(super) rows: Vec<Expr<'g>>,
    pub(super) along: Option<Expr<'g>>,
    pub(super) shifted: Vec<Expr<'g>>,
}

impl<'g> Before<'g> {
    /// The whole of a state, for an escape test that compares it with the next.
    fn of(state: &State<'g>) -> Before<'g> {
        let State { z, dr, rows, along, shifted, .. } = state.clone();
        Before { node: None, z, dr, rows, along, shifted }
    }

    /// Nothing yet: zeros of the types that the state has.
    fn nothing(node: Option<NodeRef>, state: &State<'g>) -> Before<'g> {
        let zero = |e: &Expr<'g>| e.arena.constant(e.ty(), [0.0; 4]);
        Before {
            node,
            z: zero(&state.z),
            dr: state.dr.as_ref().map(zero),
            rows: state.rows.iter().map(zero).collect(),
            along: state.along.as_ref().map(zero),
            shifted: state.shifted.iter().map(zero).collect(),
        }
    }

    fn parts(&self) -> impl Iterator<Item = (&'static str, Expr<'g>)> {
        let numbered = |names: [&'static str; 4], list: &[Expr<'g>]| names.into_iter().zip(list.to_vec());
        let rows = numbered(["j_x", "j_y", "j_z", "j_w"], &self.rows);
        let shifted = numbered(["z_x", "z_y", "z_z", "z_w"], &self.shifted);
        let first = [("z", Some(self.z)), ("dr", self.dr)].into_iter().filter_map(|(name, e)| e.map(|e| (name, e)));
        first.chain(rows).chain(self.along.map(|e| ("along", e))).chain(shifted)
    }

    /// The same parts, each made another in the order of [`Before::parts`].
    fn map(&self, mut other: impl FnMut(Expr<'g>) -> Expr<'g>) -> Before<'g> {
        Before {
            node: self.node,
            z: other(self.z),
            dr: self.dr.map(&mut other),
            rows: self.rows.iter().map(|e| other(*e)).collect(),
            along: self.along.map(&mut other),
            shifted: self.shifted.iter().map(|e| other(*e)).collect(),
        }
    }
}

impl<'g> State<'g> {
    /// Replaces z by a point that is the same for all sample points: its derivatives are 0.
    fn fix(&mut self, start: [f64; 4]) {
        let arena = self.z.arena;
        let zero = |e: &Expr<'g>| arena.constant(e.ty(), [0.0; 4]);
        self.z = arena.constant(self.z.ty(), start);
        self.dr = self.dr.as_ref().map(zero);
        self.rows = self.rows.iter().map(zero).collect();
        self.along = self.along.as_ref().map(zero);
        self.shifted = self.shifted.iter().map(|z| arena.constant(z.ty(), start)).collect();
    }

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
        parts.extend(self.notes.parts().map(|(name, e)| (name.to_string(), e)));
        if let Some(joined) = &self.joined {
            parts.push(("level".to_string(), joined.d));
            parts.extend(joined.gradient.map(|gradient| ("level_gradient".to_string(), gradient)));
        }
        for (i, before) in self.before.iter().enumerate() {
            parts.extend(before.parts().map(|(name, e)| (format!("before_{i}_{name}"), e)));
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
            notes: self.notes.map(&mut input),
            joined: self
                .joined
                .as_ref()
                .map(|joined| Joined { d: input(joined.d), gradient: joined.gradient.map(&mut input) }),
            before: self.before.iter().map(|before| before.map(&mut input)).collect(),
        }
    }

    /// What steps remember of the time before.
    fn remembered(&self) -> impl Iterator<Item = &Before<'g>> {
        self.before.iter().filter(|before| before.node.is_some())
    }

    /// What z and its running derivative, or the i-th shifted orbit, remember.
    fn memory(&self, shifted: Option<usize>) -> Memory<'g> {
        let of = |before: &Before<'g>| {
            let node = before.node?;
            Some(match shifted {
                None => (node, Moved { z: before.z, dr: before.dr }),
                Some(i) => (node, Moved { z: before.shifted[i], dr: None }),
            })
        };
        Memory::of(self.before.iter().filter_map(of))
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
    let width = composer.graph.state_width(root, settings);
    let mut carried = Carried::of(choice, purpose);
    let look = &composer.graph.scene.look;
    carried.traps &= look.reads_traps();
    if purpose == Purpose::Surface && look.is_painted() {
        carried.marks = look.marks();
    }
    let builder = OrbitBuilder { composer, settings, root, frame, width, carried, choice, purpose };
    let is_proof = choice.method.is_certified() && purpose != Purpose::Surface;
    match is_proof && !(purpose == Purpose::Truth && builder.follows_footprint()) {
        true => super::certified::compose_certified(&builder, name),
        false => builder.build(name),
    }
}

pub(super) struct OrbitBuilder<'a> {
    pub(super) composer: &'a Composer<'a>,
    pub(super) settings: &'a OrbitSettings,
    /// The map that it iterates.
    pub(super) root: NodeRef,
    pub(super) frame: &'a Frame,
    pub(super) width: u8,
    pub(super) carried: Carried,
    pub(super) choice: &'a Choice,
    pub(super) purpose: Purpose,
}

impl<'a> OrbitBuilder<'a> {
    pub(super) fn build(&self, name: String) -> ComposeResult<Orbit> {
        let (maps, schedule) =
            resolve_schedule(self.composer.graph, self.root, self.settings.constant, self.settings.max_iterations);
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

    /// Start values as expressions of the [`Query`].
    pub(super) fn start(&self) -> ComposeResult<(State<'a>, Constants<'a>)> {
        let arena = self.composer.arena;
        let Query { p, d, h, hit_eps } = Query::first(arena);
        let h = if self.purpose == Purpose::Truth { hit_eps * SHARE_OF_TRUTH } else { h };
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
        let far = untouched(arena);
        let mut state = State {
            z: first.z,
            dr: first.dr,
            rows: rows.clone(),
            along,
            shifted: shifted.clone(),
            trap: self.carried.traps.then_some(far),
            notes: self.first_notes(first.z),
            joined: None,
            before: Vec::new(),
        };
        if let Some(start) = self.settings.start {
            state.fix(start);
        }
        let before = remembering(self.composer, self.root).into_iter().map(Some);
        let compared = (self.settings.escape == Escape::Still).then_some(None);
        state.before = before.chain(compared).map(|node| Before::nothing(node, &state)).collect();
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
        let mut memory = state.memory(None);
        if let Some(trap) = state.trap {
            let folds = self.composer.graph.scene.look.folds();
            memory.sides = folds.map(|(i, axis)| (axis, trap.component(i as u8))).collect();
        }
        let moved = apply(self.composer, &item.map, input, c, n, &mut memory)?;
        let z = moved.z + c;
        let dr = moved.dr.map(|dr| dr + constants.dc * weight);
        let mut before: Vec<Before> = state.before.clone();
        for (before, now) in before.iter_mut().zip(memory.values()) {
            (before.z, before.dr) = (now.z, now.dr);
        }
        let mut rows = Vec::new();
        if self.carried.jacobian {
            let mut seeds = vec![(state.z, state.rows.clone()), (constants.c, constants.rows.clone())];
            seeds.extend(state.remembered().map(|before| (before.z, before.rows.clone())));
            let mut differentiator = Differentiator::of_gradients(arena, &seeds);
            rows = differentiator.tangents(z);
            before.iter_mut().for_each(|before| before.rows = differentiator.tangents(before.z));
        }
        let along = state.along.zip(constants.along).map(|(along, c_along)| {
            let mut seeds = vec![(state.z, along), (constants.c, c_along)];
            seeds.extend(state.remembered().filter_map(|before| Some((before.z, before.along?))));
            let mut differentiator = Differentiator::new(arena, &seeds);
            before.iter_mut().for_each(|before| before.along = Some(differentiator.derivative(before.z)));
            differentiator.derivative(z)
        });
        let mut shifted = Vec::new();
        for (i, (z, c)) in state.shifted.iter().zip(&constants.shifted).enumerate() {
            let c = self.constant(item.constant, *c);
            let mut memory = state.memory(Some(i));
            let moved = apply(self.composer, &item.map, Moved { z: *z, dr: None }, c, n, &mut memory)?;
            before.iter_mut().zip(memory.values()).for_each(|(before, now)| before.shifted[i] = now.z);
            shifted.push(moved.z + c);
        }
        let trap = state.trap.map(|trap| self.trapped(trap, z, n, &memory.sides)).transpose()?;
        let traps = [state.trap, trap].map(|trap| trap.unwrap_or_else(|| untouched(arena)));
        let notes = self.noted(&state.notes, [state.z, z], traps, n);
        if let Some(compared) = before.iter_mut().find(|before| before.node.is_none()) {
            *compared = Before::of(state);
        }
        let next = State { z, dr, rows, along, shifted, trap, notes, joined: None, before };
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
