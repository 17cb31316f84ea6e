//! What surfaces are made of: layers of colour and materials as expressions, and which of their values become columns.
//!
//! A surface estimator writes the [`Matter`] of the part that is seen, but only what differs from place to place or from part to
//! part ([`write_matter`]); whoever reads it finds the rest as constants ([`read_matter`]).

use super::paint::{distances, paint, usable_trap};
use super::{ComposeResult, Composer};
use crate::expr::{Arena, Expr, Function, Inputs, Type};
use crate::formula::material::{INPUTS, OUTPUTS};
use crate::graph::{Blend, By, Layer, Look, MOST_LAYERS, MaterialUse, Paint, Spread};
use crate::kernel::records::Matter;

/// What is known of a place of a surface.
#[derive(Clone, Copy)]
pub(super) struct Place<'g> {
    /// The point, in the frame of its part.
    pub(super) position: Expr<'g>,
    /// Out of the surface.
    pub(super) normal: Expr<'g>,
    /// Towards the viewer.
    pub(super) view: Expr<'g>,
    /// Radius of a pixel.
    pub(super) footprint: Expr<'g>,
    /// Traps as the orbit carries them.
    pub(super) trap: Expr<'g>,
    /// What the orbit noted of them; 0 where nothing asks.
    pub(super) caught: Expr<'g>,
    pub(super) places: Expr<'g>,
    /// Iterations, the same without steps, and the last radius.
    pub(super) iterations: Expr<'g>,
    pub(super) smooth: Expr<'g>,
    pub(super) radius: Expr<'g>,
}

impl<'g> Place<'g> {
    fn values(self) -> [Expr<'g>; 10] {
        let Place { position, normal, view, footprint, trap, caught, places, iterations, smooth, radius } = self;
        [position, normal, view, footprint, trap, caught, places, iterations, smooth, radius]
    }

    /// Each value of two places made one.
    pub(super) fn joined(
        a: Option<Self>,
        b: Option<Self>,
        join: impl Fn(Expr<'g>, Expr<'g>) -> Expr<'g>,
    ) -> Option<Self> {
        let (a, b) = (a?.values(), b?.values());
        let [position, normal, view, footprint, trap, caught, places, iterations, smooth, radius] =
            std::array::from_fn(|i| join(a[i], b[i]));
        Some(Place { position, normal, view, footprint, trap, caught, places, iterations, smooth, radius })
    }
}

/// The paint of a part, and its number: 0 is that of all that has none of its own.
#[derive(Clone, Copy)]
pub(super) struct Painter<'a> {
    pub(super) paint: &'a Paint,
    pub(super) number: usize,
}

impl<'a> Painter<'a> {
    /// That of all that has none of its own.
    pub(super) fn of_look(look: &'a Look) -> Painter<'a> {
        Painter { paint: &look.paint, number: 0 }
    }

    /// The matter of a place. In the picture of a plane with a normal `across` a trap that lies along it has no effect.
    pub(super) fn matter<'g>(
        &self,
        composer: &Composer<'g>,
        place: &Place<'g>,
        across: Option<[f64; 3]>,
    ) -> ComposeResult<Matter<Expr<'g>>> {
        let (arena, look) = (composer.arena, &composer.graph.scene.look);
        let layers = self.paint.shown_layers();
        let (colour, tone) = match layers {
            [] => (paint(look, &self.paint.palette, usable_trap(place.trap), across), arena.f(0.0)),
            layers => layered(arena, look, layers, place),
        };
        let Some(used) = &self.paint.material else {
            return Ok(matter_of(|i| if i == 0 { colour } else { constant(arena, i, [OUTPUTS[i].2; 3]) }));
        };
        let inputs = INPUTS.iter().map(|(name, ..)| match *name {
            "position" => place.position,
            "normal" => place.normal,
            "view" => place.view,
            "footprint" => place.footprint,
            "traps" => distances(look, usable_trap(place.trap)),
            "caught" => place.caught,
            "places" => place.places,
            "iterations" => place.iterations,
            "smooth" => place.smooth,
            "radius" => place.radius,
            "part" => arena.f(self.number as f64),
            "colour" => colour,
            _ => tone,
        });
        let inputs: Vec<Expr> = inputs.collect();
        let library = composer.library;
        let params = used.material.script_params(arena, &used.params);
        let outputs = used.material.trace((&library.engine, &library.sources), arena, &inputs, &params)?;
        Ok(matter_of(|i| outputs[i].unwrap_or_else(|| constant(arena, i, [OUTPUTS[i].2; 3]))))
    }

    /// The numbers that the layers are placed by, in the fields of a matter: three in the base colour, three in the emission, and the number of the
    /// paint as metalness.
    pub(super) fn tones<'g>(&self, composer: &Composer<'g>, place: &Place<'g>) -> Matter<Expr<'g>> {
        let (arena, look) = (composer.arena, &composer.graph.scene.look);
        let value = |i: usize| self.paint.layers.get(i).map_or(arena.f(0.0), |layer| number(look, layer.by, place));
        let three = |from: usize| arena.compose(&[value(from), value(from + 1), value(from + 2)]);
        matter_of(|i| match OUTPUTS[i].0 {
            "base" => three(0),
            "emission" => three(MOST_LAYERS / 2),
            "metallic" => arena.f(self.number as f64),
            _ => constant(arena, i, [OUTPUTS[i].2; 3]),
        })
    }
}

/// The colour of layers over one another, and the place in the first one's gradient.
fn layered<'g>(arena: &'g Arena, look: &Look, layers: &[Layer], place: &Place<'g>) -> (Expr<'g>, Expr<'g>) {
    let mut colour = arena.v3([1.0; 3]);
    let mut first = None;
    for layer in layers {
        let t = placed(arena, layer, number(look, layer.by, place));
        first = first.or(Some(t));
        let own = layer.gradient.compose(arena, t);
        let over = match layer.blend {
            Blend::Mix => own,
            Blend::Multiply => colour * own,
            Blend::Add => colour + own,
        };
        colour = colour.mix(over, arena.f(layer.weight));
    }
    (colour, first.unwrap_or_else(|| arena.f(0.0)))
}

/// The number that a layer is placed by.
fn number<'g>(look: &Look, by: By, place: &Place<'g>) -> Expr<'g> {
    let arena = place.trap.arena;
    match by {
        By::Trap(i) => distances(look, usable_trap(place.trap)).component(i),
        By::Caught(i) => place.caught.component(i),
        By::Where(i) => place.places.component(i),
        By::Iterations => place.iterations,
        By::Smooth => place.smooth,
        By::Radius => place.radius,
        By::Distance => place.position.length(),
        By::Position(along) => place.position.dot(arena.v3(along)),
        By::Normal(along) => place.normal.dot(arena.v3(along)),
        By::Facing => place.normal.dot(place.view).abs(),
    }
}

/// The place in a layer's gradient.
fn placed<'g>(arena: &'g Arena, layer: &Layer, number: Expr<'g>) -> Expr<'g> {
    match &layer.spread {
        Spread::Value(from, to) => {
            let t = (number - *from) * (1.0 / (to - from));
            if layer.gradient.is_cyclic() { t } else { t.clamp(arena.f(0.0), arena.f(1.0)) }
        }
        Spread::Cyclic(period, begin) => {
            let t = number * (1.0 / period) + *begin;
            let share = t - t.floor();
            // What does not end as it began goes back the way it came.
            if layer.gradient.is_cyclic() { share } else { 1.0 - (share * 2.0 - 1.0).abs() }
        }
        // Nothing was looked at: most of what is nearer than some units differs.
        Spread::Quantile(cuts) if cuts.len() < 2 => number.abs() / (number.abs() + 1.0),
        Spread::Quantile(cuts) => even(arena, cuts, number),
    }
}

/// The share of what was seen that lies below a number: straight between the cuts.
fn even<'g>(arena: &'g Arena, cuts: &[f64], number: Expr<'g>) -> Expr<'g> {
    let each = 1.0 / (cuts.len() - 1) as f64;
    let size = cuts.iter().fold(1e-30, |size: f64, cut| size.max(cut.abs()));
    let terms = cuts.windows(2).map(|pair| {
        let width = pair[1] - pair[0];
        match width > 1e-6 * size {
            true => ((number - pair[0]) * (1.0 / width)).clamp(arena.f(0.0), arena.f(1.0)) * each,
            false => arena.f(pair[1]).le(number).select(arena.f(each), arena.f(0.0)),
        }
    });
    terms.reduce(|a, b| a + b).unwrap_or_else(|| arena.f(0.0))
}

/// A matter of an expression for each of its fields, in order.
fn matter_of<'g>(mut field: impl FnMut(usize) -> Expr<'g>) -> Matter<Expr<'g>> {
    let mut numbers = 0..;
    Matter::COLUMNS.map(|_| field(numbers.next().unwrap_or_default()))
}

fn constant(arena: &Arena, field: usize, value: [f64; 3]) -> Expr<'_> {
    match OUTPUTS[field].1 {
        Type::F => arena.f(value[0]),
        _ => arena.v3(value),
    }
}

/// The values of the fields that are the same all over the picture.
fn constants(look: &Look) -> Vec<Option<[f64; 3]>> {
    let of = |paint: &Paint, i: usize| match &paint.material {
        Some(used) => used.study.constant(i),
        None => (i > 0).then_some([OUTPUTS[i].2; 3]),
    };
    let shared = |i: usize| {
        let first = of(&look.paint, i)?;
        look.paints().all(|paint| of(paint, i) == Some(first)).then_some(first)
    };
    (0..OUTPUTS.len()).map(shared).collect()
}

/// Whether a field of a material is, or may be somewhere, a number of which `is` holds.
fn may_be(used: &MaterialUse, name: &str, is: impl Fn(f64) -> bool) -> bool {
    let field = OUTPUTS.iter().position(|output| output.0 == name).unwrap_or_default();
    used.study.constant(field).is_none_or(|value| is(value[0]))
}

/// Whether some surface of a look may mirror: its own layer or its coat is less rough than `blurred` somewhere.
pub(crate) fn may_mirror(look: &Look, blurred: f64) -> bool {
    look.paints().filter_map(|paint| paint.material.as_ref()).any(|used| {
        let is_smooth = |name: &str| may_be(used, name, |roughness| roughness < blurred);
        is_smooth("roughness") || (may_be(used, "coat", |coat| coat > 0.0) && is_smooth("coat_roughness"))
    })
}

/// Whether light may go through some surface of a look.
pub(crate) fn may_transmit(look: &Look) -> bool {
    let mut used = look.paints().filter_map(|paint| paint.material.as_ref());
    used.any(|used| may_be(used, "transmission", |share| share > 0.0))
}

/// Writes what of a matter is not constant as the next outputs of a function.
pub(super) fn write_matter(look: &Look, matter: Matter<Expr<'_>>, function: &mut Function) {
    for ((value, constant), (name, ..)) in matter.values().into_iter().zip(constants(look)).zip(OUTPUTS) {
        if constant.is_none() {
            function.output(*name, value);
        }
    }
}

/// The matter of a painted look as the next inputs of a function; `None` of looks whose traps alone colour their surfaces.
pub(crate) fn read_matter<'g>(look: &Look, arena: &'g Arena, inputs: &mut Inputs<'g>) -> Option<Matter<Expr<'g>>> {
    let known = constants(look);
    look.is_painted().then(|| {
        matter_of(|i| match known[i] {
            Some(value) => constant(arena, i, value),
            None => inputs.take(OUTPUTS[i].0, OUTPUTS[i].1),
        })
    })
}

/// Each field of two matters made one.
pub(super) fn joined<'g>(
    a: Option<Matter<Expr<'g>>>,
    b: Option<Matter<Expr<'g>>>,
    join: impl Fn(Expr<'g>, Expr<'g>) -> Expr<'g>,
) -> Option<Matter<Expr<'g>>> {
    let (a, b) = (a?, b?);
    let mut others = b.values().into_iter();
    Some(a.map(|own| others.next().map_or(own, |other| join(own, other))))
}

#[cfg(test)]
mod tests {
    use super::OUTPUTS;
    use crate::expr::Port;
    use crate::kernel::records::Matter;

    #[test]
    fn materials_return_the_fields_of_matter() {
        let outputs: Vec<Port> = OUTPUTS.iter().map(|(name, ty, ..)| Port::new(*name, *ty)).collect();
        assert_eq!(outputs, Matter::ports());
    }
}
