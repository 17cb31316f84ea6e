//! Distance fields: orbits, primitives and their combinations, joined into one estimator.

use super::footprint::{follows_footprint, is_marked};
use super::maps::Moved;
use super::matter::{Painter, Place as Seen, write_matter};
use super::orbit::compose_orbit;
use super::paint::{Marked, untouched};
use super::placement::{Frame, Place, copies, farther_copies};
use super::unrolled::unrolled;
use super::value::FieldValue;
use super::{Choice, ComposeResult, Composer, Purpose};
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::graph::{DeForm, Method, NodeKind, NodeRef, OrbitSettings, Part, Tiling};
use crate::kernel::records::{Answer, Matter, Query, Surface};
use crate::kernel::{Estimator, Orbit};
use crate::math::Precision;

/// Extent from which on r ln r / 2 dr, which is half of r ln r for a power, says more than the distance to the set's middle.
const OUTGROWN: f64 = 4.5;

/// An orbit of the field, and where it stands.
#[derive(Clone)]
pub struct FieldOrbit {
    /// The orbit node.
    pub node: NodeRef,
    /// The map that it iterates.
    pub root: NodeRef,
    /// How.
    pub settings: OrbitSettings,
    /// Its own frame.
    pub frame: Frame,
}

/// All orbits of the graph's output, each once for every frame that it stands in.
pub fn field_orbits(composer: &Composer) -> Vec<FieldOrbit> {
    let mut orbits = Vec::new();
    collect(composer, composer.graph.output, &Frame::default(), &mut orbits);
    orbits
}

fn collect(composer: &Composer, node: NodeRef, frame: &Frame, orbits: &mut Vec<FieldOrbit>) {
    match &composer.graph.node(node).kind {
        NodeKind::Orbit { of, settings } => {
            let known = orbits.iter().any(|o| o.node == node && o.frame == *frame);
            if !known {
                let settings = OrbitSettings { slice: settings.slice + frame.slice(), ..(**settings).clone() };
                orbits.push(FieldOrbit { node, root: *of, settings, frame: frame.clone() });
            }
        }
        NodeKind::Transform { of, placement } => collect(composer, *of, &frame.inside(*placement), orbits),
        NodeKind::Warp { of, by } => collect(composer, *of, &frame.with(Place::Warped(*by)), orbits),
        NodeKind::Tile { of, tiling } => {
            for shift in copies(*tiling) {
                collect(composer, *of, &frame.with(Place::Tiled(*tiling, shift)), orbits);
            }
        }
        kind if !kind.is_map() => {
            for wire in kind.wires() {
                collect(composer, wire, frame, orbits);
            }
        }
        _ => {}
    }
}

/// What an estimate can come from.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Decider {
    /// Name of the orbit's or primitive's node.
    pub node: String,
    /// The method; of `combined` the one whose slope is the larger.
    pub method: Method,
    /// The form, where there is one.
    pub form: Option<DeForm>,
}

/// What the numbers of [`Purpose::Decision`] stand for: two for each orbit (the second for the gradient of `combined`),
/// then one for each primitive.
pub fn deciders(composer: &Composer, choices: &[Choice]) -> Vec<Decider> {
    let name = |node: NodeRef| composer.graph.node(node).name.clone();
    let mut all = Vec::new();
    for (orbit, choice) in field_orbits(composer).iter().zip(choices) {
        let methods = match choice.method {
            Method::Combined => [Method::Scalar, Method::Gradient],
            method => [method; 2],
        };
        all.extend(methods.map(|method| Decider { node: name(orbit.root), method, form: Some(choice.form) }));
    }
    let own = |node| Decider { node: name(node), method: Method::Own, form: None };
    all.extend(field_primitives(composer).into_iter().map(own));
    all
}

/// Primitives of the graph's output, each once.
pub(super) fn field_primitives(composer: &Composer) -> Vec<NodeRef> {
    let mut open = vec![composer.graph.output];
    let mut found = Vec::new();
    let mut seen = vec![false; composer.graph.nodes.len()];
    while let Some(node) = open.pop() {
        if std::mem::replace(&mut seen[node.0], true) {
            continue;
        }
        match &composer.graph.node(node).kind {
            NodeKind::Primitive(_) | NodeKind::Shape { .. } => found.push(node),
            NodeKind::Orbit { .. } => {}
            NodeKind::Transform { of, .. } | NodeKind::Warp { of, .. } => open.push(*of),
            kind if !kind.is_map() => open.extend(kind.wires()),
            _ => {}
        }
    }
    found
}

/// Builds the estimator of the whole field. `choices` has one entry for each of [`field_orbits`].
pub fn compose_estimator(composer: &Composer, choices: &[Choice], purpose: Purpose) -> ComposeResult<Estimator> {
    match purpose == Purpose::Surface && choices.iter().any(|choice| choice.stops) {
        true => super::soft::compose_soft_surface(composer, choices),
        false => compose_showing(composer, choices, purpose, Shows::Matter),
    }
}

/// An estimator for surfaces of a painted look whose outputs are the numbers of `Painter::tones`, as a [`Matter`] without constants.
pub fn compose_tones(composer: &Composer, choices: &[Choice]) -> ComposeResult<Estimator> {
    compose_showing(composer, choices, Purpose::Surface, Shows::Tones)
}

/// What a surface's matter holds.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shows {
    /// What it is made of.
    Matter,
    /// The numbers that its layers are placed by.
    Tones,
}

fn compose_showing(
    composer: &Composer,
    choices: &[Choice],
    purpose: Purpose,
    shows: Shows,
) -> ComposeResult<Estimator> {
    let specs = field_orbits(composer);
    let mut orbits = Vec::new();
    for (i, (spec, choice)) in specs.iter().zip(choices).enumerate() {
        let name = format!("orbit_{i}");
        orbits.push(compose_orbit(composer, name, spec.root, &spec.settings, &spec.frame, choice, purpose)?);
    }
    let mut inputs = Estimator::inputs();
    let leaves: Vec<Leaf> = orbits.iter().map(|orbit| Leaf::new(composer.arena, orbit, &mut inputs)).collect();
    let mut combine = Function::new("combine", inputs);
    let Query { p, .. } = Query::first(composer.arena);
    let (at, n) = (p, composer.arena.f(0.0));
    let painter = Painter::of_look(&composer.graph.scene.look);
    let field =
        FieldBuilder { composer, specs: &specs, choices, leaves: Some(&leaves), purpose, at, n, painter, shows };
    field.outputs(&mut combine)?;
    drop_unread(composer.arena, &mut orbits, &combine);
    Ok(Estimator { orbits, combine })
}

/// Makes 0 of the orbits' results that nothing reads: what they took is then computed no more.
pub(super) fn drop_unread(arena: &Arena, orbits: &mut [Orbit], combine: &Function) {
    let mut at = Estimator::inputs().len();
    for orbit in orbits {
        for (port, value) in &mut orbit.finish.outputs {
            if !combine.reads(arena, at) {
                *value = arena.constant(port.ty, [0.0; 4]).id;
            }
            at += 1;
        }
        // Then come `inside` and `n`, which cost nothing.
        at += 2;
    }
}

/// An orbit's results as inputs of `combine`.
pub(super) struct Leaf<'g> {
    /// `de, ...` or, for a surface, `gradient, trap, de`.
    outputs: Vec<Expr<'g>>,
    inside: Expr<'g>,
    n: Expr<'g>,
}

impl<'g> Leaf<'g> {
    /// The results of an orbit, as further inputs.
    pub(super) fn new(arena: &'g Arena, orbit: &Orbit, inputs: &mut Vec<Port>) -> Leaf<'g> {
        let mut input = |name: &str, ty: Type| {
            inputs.push(Port::new(format!("{}_{name}", orbit.name), ty));
            arena.input((inputs.len() - 1) as u16, ty)
        };
        let outputs = orbit.finish.output_ports().iter().map(|port| input(&port.name, port.ty)).collect();
        Leaf { outputs, inside: input("inside", Type::B), n: input("n", Type::F) }
    }
}

#[derive(Clone, Copy)]
pub(super) struct FieldBuilder<'a, 'g> {
    pub(super) composer: &'a Composer<'g>,
    pub(super) specs: &'a [FieldOrbit],
    pub(super) choices: &'a [Choice],
    /// Results of the orbits; without them orbits are unrolled.
    pub(super) leaves: Option<&'a [Leaf<'g>]>,
    pub(super) purpose: Purpose,
    /// Where the field is looked up, three or four components.
    pub(super) at: Expr<'g>,
    /// Number of the iteration, which parameters of shapes may depend on.
    pub(super) n: Expr<'g>,
    /// The paint of the part that is looked up.
    pub(super) painter: Painter<'a>,
    pub(super) shows: Shows,
}

/// The signed distance of a field from a point of its frame, three or four components: what end shapes say. Orbits in it
/// are unrolled.
pub(super) fn shape_at<'g>(
    composer: &Composer<'g>,
    field: NodeRef,
    z: Expr<'g>,
    n: Expr<'g>,
) -> ComposeResult<Expr<'g>> {
    let purpose = Purpose::Estimate;
    let (painter, shows) = (Painter::of_look(&composer.graph.scene.look), Shows::Matter);
    let builder = FieldBuilder { composer, specs: &[], choices: &[], leaves: None, purpose, at: z, n, painter, shows };
    Ok(builder.value(field, &Frame::default())?.d)
}

impl<'g> FieldBuilder<'_, 'g> {
    fn outputs(&self, combine: &mut Function) -> ComposeResult<()> {
        let arena = self.composer.arena;
        let value = self.value(self.composer.graph.output, &Frame::default())?;
        match self.purpose {
            Purpose::Estimate | Purpose::Proof | Purpose::March | Purpose::Truth => {
                Answer { de: self.seen(&value), inside: value.inside }.write(combine);
            }
            Purpose::Surface => {
                let gradient = value.gradient.unwrap_or_else(|| arena.v3([0.0, 0.0, 1.0]));
                match (self.shows, self.matter(&value)?) {
                    (Shows::Tones, Some(tones)) => tones.write(combine),
                    (_, matter) => {
                        Surface { gradient, trap: value.trap.unwrap_or_else(|| untouched(arena)) }.write(combine);
                        matter.into_iter().for_each(|matter| {
                            write_matter(&self.composer.graph.scene.look, matter, combine);
                        });
                    }
                }
            }
            Purpose::Probe => {
                Answer { de: value.d, inside: value.inside }.write(combine);
                let first = self.leaves.and_then(|leaves| leaves.first());
                combine.output("n", first.map_or(arena.f(0.0), |leaf| leaf.n));
                combine.output("r", first.map_or(arena.f(0.0), |leaf| leaf.outputs[1]));
                combine.output("z", first.map_or(arena.constant(Type::V4, [0.0; 4]), |leaf| leaf.outputs[2]));
            }
            Purpose::Decision => {
                Answer { de: value.d, inside: value.inside }.write(combine);
                combine.output("decider", value.decider.unwrap_or_else(|| arena.f(0.0)));
            }
        }
        Ok(())
    }

    /// The distance as a march sees it: 0, which is nothing known, where rays stop at thresholds and what is this near was cut away.
    fn seen(&self, value: &FieldValue<'g>) -> Expr<'g> {
        match value.unclear.filter(|_| self.choices.iter().any(|choice| choice.stops)) {
            Some(unclear) => {
                let near = value.d.lt(Query::first(self.composer.arena).hit_eps);
                unclear.and(near).select(value.d.lift(0.0), value.d)
            }
            None => value.d,
        }
    }

    /// The value of a node.
    pub(super) fn value(&self, node: NodeRef, frame: &Frame) -> ComposeResult<FieldValue<'g>> {
        let graph = self.composer.graph;
        let is_it = |part: &Part| match graph.node(node).kind {
            NodeKind::Orbit { of, .. } => part.node == of || part.node == node,
            _ => part.node == node,
        };
        let parts = &graph.scene.look.parts;
        match parts.iter().position(is_it) {
            Some(i) => {
                let painter = Painter { paint: &parts[i].paint, number: i + 1 };
                FieldBuilder { painter, ..*self }.value_of(node, frame)
            }
            None => self.value_of(node, frame),
        }
    }

    /// The value with what its part is made of, where the look is painted: from its traps and normal, iterations and what the orbit
    /// noted.
    pub(super) fn painted(
        &self,
        value: FieldValue<'g>,
        frame: &Frame,
        iterations: Expr<'g>,
        marked: &Marked<'g>,
    ) -> ComposeResult<FieldValue<'g>> {
        let Composer { arena, graph, .. } = *self.composer;
        let (Some(trap), Some(normal)) = (value.trap, value.gradient) else { return Ok(value) };
        if !graph.scene.look.is_painted() {
            return Ok(value);
        }
        let Query { d, hit_eps, .. } = Query::first(arena);
        let place = Seen {
            position: self.local(frame)?.xyz(),
            normal,
            view: -d,
            footprint: hit_eps,
            trap,
            caught: marked.caught,
            places: marked.places,
            iterations,
            smooth: marked.smooth,
            radius: marked.radius,
        };
        Ok(match graph.scene.look.parts.is_empty() {
            true => FieldValue { place: Some(place), ..value },
            false => FieldValue { matter: Some(self.matter_at(&place)?), ..value },
        })
    }

    fn matter_at(&self, place: &Seen<'g>) -> ComposeResult<Matter<Expr<'g>>> {
        let plane = self.composer.graph.scene.plane;
        match self.shows {
            Shows::Matter => self.painter.matter(self.composer, place, plane.map(|plane| cross(plane.right, plane.up))),
            Shows::Tones => Ok(self.painter.tones(self.composer, place)),
        }
    }

    /// What the surface of the whole field is made of, where the look is painted.
    pub(super) fn matter(&self, value: &FieldValue<'g>) -> ComposeResult<Option<Matter<Expr<'g>>>> {
        match &value.place {
            Some(place) => self.matter_at(place).map(Some),
            None => Ok(value.matter),
        }
    }

    fn value_of(&self, node: NodeRef, frame: &Frame) -> ComposeResult<FieldValue<'g>> {
        Ok(match &self.composer.graph.node(node).kind {
            NodeKind::Orbit { of, settings } => match self.leaves {
                Some(leaves) => self.orbit(node, frame, leaves)?,
                None => {
                    let at = self.local(frame)?;
                    // Where space has four components they are moved with it.
                    let up = if at.ty().width == 4 { 0.0 } else { frame.slice() };
                    let settings = OrbitSettings { slice: settings.slice + up, ..(**settings).clone() };
                    let (d, inside) = unrolled(self.composer, *of, &settings, at)?;
                    FieldValue { shallow: Some(inside), ..FieldValue::plain(self.back(frame, d)?, inside) }
                }
            },
            NodeKind::Primitive(primitive) => self.primitive(node, primitive, frame)?,
            NodeKind::Shape { step, params } => self.shape(node, (step, params), frame)?,
            NodeKind::Transform { of, placement } => self.value(*of, &frame.inside(*placement))?,
            NodeKind::Warp { of, by } => self.value(*of, &frame.with(Place::Warped(*by)))?,
            NodeKind::Tile { of, tiling } => self.tiled(*of, *tiling, frame)?,
            NodeKind::Union(of) => self.fold(of, frame, |a, b| a.nearer(b))?,
            NodeKind::Intersection(of) => self.fold(of, frame, |a, b| a.farther(b))?,
            NodeKind::Difference { a, b } => {
                let (a, b) = (self.value(*a, frame)?, self.value(*b, frame)?);
                // How far it is to the wall of an orbit from inside it is not known: 0 makes the march walk.
                a.farther(b.turned())
            }
            NodeKind::SmoothUnion { of, radius } => self.fold(of, frame, |a, b| a.smooth(b, *radius))?,
            _ => unreachable!("validation wraps maps into orbits where fields belong"),
        })
    }

    fn fold(
        &self,
        of: &[NodeRef],
        frame: &Frame,
        join: impl Fn(FieldValue<'g>, FieldValue<'g>) -> FieldValue<'g>,
    ) -> ComposeResult<FieldValue<'g>> {
        let mut values = of.iter().map(|node| self.value(*node, frame));
        let first = values.next().expect("lists of nodes are never empty")?;
        values.try_fold(first, |a, b| Ok(join(a, b?)))
    }

    /// The point in a frame.
    pub(super) fn local(&self, frame: &Frame) -> ComposeResult<Expr<'g>> {
        Ok(frame.locate(self.composer, Moved { z: self.at, dr: None })?.z)
    }

    /// A distance of a frame in units of the outermost one.
    pub(super) fn back(&self, frame: &Frame, d: Expr<'g>) -> ComposeResult<Expr<'g>> {
        frame.distance_back(self.composer, self.at, d, Precision::F32.unit())
    }

    /// The nearest copies of a field, and no farther than others can be.
    fn tiled(&self, of: NodeRef, tiling: Tiling, frame: &Frame) -> ComposeResult<FieldValue<'g>> {
        let mut values =
            copies(tiling).into_iter().map(|shift| self.value(of, &frame.with(Place::Tiled(tiling, shift))));
        let first = values.next().expect("the nearest copy is always there")?;
        let all = values.try_fold(first, |a, b| Ok(a.nearer(b?)))?;
        let d = match farther_copies(self.local(frame)?.xyz(), tiling) {
            Some(others) => all.d.min(self.back(frame, others)?),
            None => all.d,
        };
        Ok(FieldValue { d, ..all })
    }

    fn orbit(&self, node: NodeRef, frame: &Frame, leaves: &[Leaf<'g>]) -> ComposeResult<FieldValue<'g>> {
        let i = self.specs.iter().position(|s| s.node == node && s.frame == *frame);
        let i = i.expect("every orbit of the output was collected");
        let leaf = &leaves[i];
        let zero = self.composer.arena.f(0.0);
        let is_surface = self.purpose == Purpose::Surface;
        let de = if is_surface { leaf.outputs[2] } else { leaf.outputs[0] };
        let stays = match follows_footprint(&self.choices[i], self.purpose) {
            true => leaf.inside.or(is_marked(de)),
            false => leaf.inside,
        };
        let inside = match self.choices[i].form {
            DeForm::Linear | DeForm::Logarithmic => stays,
            // What has not escaped is in the set where it ends in the shape; a plane is as thick as the hit threshold.
            DeForm::Box => leaf.inside.and(de.le(zero)),
            DeForm::Plane => leaf.inside.and(de.le(Query::first(self.composer.arena).hit_eps)),
            DeForm::End => leaf.inside.and(de.lt(zero)),
        };
        let shown = |at: usize| is_surface.then(|| leaf.outputs[at]);
        let decider = (self.purpose == Purpose::Decision).then(|| {
            let first = self.composer.arena.f(2.0 * i as f64);
            leaf.outputs.get(1).map_or(first, |part| first + *part)
        });
        let d = match self.choices[i].form {
            // How deep it is in an end shape is known.
            DeForm::End => leaf.inside.select(de, de.max(zero)),
            _ => inside.select(zero, self.capped(de, frame, &self.choices[i])?),
        };
        // What is known at the point alone may not hold as far as it says where space is warped; proofs do.
        let mut way = frame.clone();
        for map in &self.specs[i].settings.pre {
            way = way.with(Place::Warped(*map));
        }
        let is_shape = self.choices[i].form == DeForm::End;
        let warped = frame.maps().next().is_some() || (is_shape && way.maps().next().is_some());
        let d = match warped && !self.choices[i].method.is_certified() {
            true => {
                let scale = way.scale_at(self.composer, self.at, Precision::F32.unit())?;
                way.distance_back(self.composer, self.at, d / scale, Precision::F32.unit())?
            }
            false => d,
        };
        let (gradient, trap, shallow) = (shown(0), shown(1), (!is_shape).then_some(inside));
        let plain = FieldValue::plain(d, inside);
        let value = FieldValue { shallow, gradient, trap, decider, ..plain };
        let marks = self.composer.graph.scene.look.marks();
        let further = if is_surface { &leaf.outputs[3..] } else { &[] };
        self.painted(value, frame, leaf.n, &Marked::read(self.composer.arena, marks, further))
    }

    /// Of a large set that rays come to from far away: half the way to its middle is the most that an estimate says, since
    /// r ln r / dr outgrows the distance there.
    fn capped(&self, de: Expr<'g>, frame: &Frame, choice: &Choice) -> ComposeResult<Expr<'g>> {
        let is_placed = frame.places().iter().all(|place| matches!(place, Place::Placed(_)));
        let outgrows = choice.form == DeForm::Logarithmic && !choice.method.is_certified();
        if !outgrows || choice.extent < OUTGROWN || !is_placed {
            return Ok(de);
        }
        let half = (self.local(frame)?.xyz().length() * 0.5).max(de.lift(1.0)) * frame.scale();
        // What is not a number stays so.
        Ok(half.lt(de).select(half, de))
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    glam::DVec3::from(a).cross(glam::DVec3::from(b)).into()
}
