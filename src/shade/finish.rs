//! How a surface scatters light: a matte base under a layer of microfacets, and a clear coat over both.
//!
//! Microfacets are those of Walter et al. (GGX, 2007) with the masking of Heitz (2014), and the light that they scatter more than
//! once is added as Turquin (2019) does, so that a white surface returns all that it gets. What the layer reflects, by
//! Schlick's approximation (1994) at the angle of view, the base under it does not get.

use crate::expr::Expr;
use crate::kernel::records::{Matter, Random};

/// Least width of the microfacets' distribution: narrower ones show a lamp as a point that no pixel meets.
const LEAST_ALPHA: f64 = 2e-3;
/// Reflectance of a clear coat along its normal: that of an index of refraction of 1.5.
const COAT: f64 = 0.04;

/// Roughness up to which a surface mirrors sharply, and from which on it does not.
const SHARP: f64 = 0.1;
/// See [`SHARP`].
pub const BLURRED: f64 = 0.4;

/// The share of light that microfacets scatter more than once: a polynomial of s = c / (c + alpha), with c the cosine of the angle of
/// view, whose coefficients are polynomials of alpha. Fitted to integrals over visible normals: within 0.006, and 0.004 in the mean.
const LOST: [[f64; 4]; 5] = [
    [0.01645, -0.08868, 0.12219, -0.03963],
    [-0.18676, 1.25419, 3.52616, -1.19853],
    [2.40767, -5.20995, -11.98589, 3.7662],
    [-4.36701, 6.57421, 30.96312, -10.25851],
    [2.12342, -2.45801, -24.09236, 6.49882],
];

/// Microfacets of one width, seen from one side.
#[derive(Clone, Copy)]
struct Facets<'g> {
    alpha: Expr<'g>,
    /// Cosine of the angle of view.
    cos_view: Expr<'g>,
    /// 1 / (1 - what is scattered more than once).
    gain: Expr<'g>,
}

/// A surface, ready to be lit.
pub struct Finish<'g> {
    /// Unit vector across the surface, on the viewer's side.
    pub(super) normal: Expr<'g>,
    /// Unit vector towards the viewer.
    view: Expr<'g>,
    /// What the base returns of the light that it gets.
    base: Expr<'g>,
    /// Share of light that goes through, where some does.
    through: Option<Expr<'g>>,
    /// What the layer reflects at the angle of view.
    reflectance: Expr<'g>,
    facets: Facets<'g>,
    /// The coat's facets, its reflectance and its roughness, where there is one.
    coat: Option<(Facets<'g>, Expr<'g>, Expr<'g>)>,
    emission: Option<Expr<'g>>,
    roughness: Expr<'g>,
    /// Index of refraction on the viewer's side over that behind the surface.
    ratio: Expr<'g>,
}

/// How a path goes on.
pub struct Scattered<'g> {
    /// Its direction.
    pub direction: Expr<'g>,
    /// What of the light from there is scattered to the viewer, times the cosine.
    pub value: Expr<'g>,
    /// Density of the direction by solid angle.
    pub density: Expr<'g>,
    /// Whether it goes through the surface, where it can.
    pub crosses: Option<Expr<'g>>,
}

/// Density of directions that are bent: no light is found in them by other means.
const BENT: f64 = 1e6;

/// Whether an expression is this number on all paths.
fn is(value: Expr<'_>, number: f64) -> bool {
    value.as_constant().is_some_and(|value| value[..3].iter().all(|part| *part == number) || value[0] == number)
}

impl<'g> Facets<'g> {
    fn new(roughness: Expr<'g>, cos_view: Expr<'g>) -> Facets<'g> {
        let arena = roughness.arena;
        let alpha = (roughness * roughness).max(arena.f(LEAST_ALPHA));
        let s = cos_view / (cos_view + alpha);
        let of_alpha = |row: [f64; 4]| ((alpha * row[3] + row[2]) * alpha + row[1]) * alpha + row[0];
        let lost = LOST.iter().rev().skip(1).fold(of_alpha(LOST[4]), |sum, row| sum * s + of_alpha(*row));
        let kept = 1.0 - lost.clamp(arena.f(0.0), arena.f(0.95));
        Facets { alpha, cos_view, gain: 1.0 / kept }
    }

    /// Pi times the distribution of normals times the masking, over four cosines: what a mirror of all light scatters from `light`, for
    /// a strength of pi.
    fn scatter(&self, normal: Expr<'g>, half: Expr<'g>, cos_light: Expr<'g>) -> Expr<'g> {
        let square = self.alpha * self.alpha;
        let cos_half = normal.dot(half);
        let peak = cos_half * cos_half * (square - 1.0) + 1.0;
        let masked = |a: Expr<'g>, b: Expr<'g>| a * (b * b * (1.0 - square) + square).sqrt();
        let masking = masked(cos_light, self.cos_view) + masked(self.cos_view, cos_light);
        square * self.gain * 0.5 / (peak * peak * masking.max(square.lift(1e-6)))
    }
}

impl<'g> Facets<'g> {
    /// A normal of the facets that are seen, by two random numbers (Heitz, 2018).
    fn visible(&self, normal: Expr<'g>, view: Expr<'g>, (u, v): (Expr<'g>, Expr<'g>)) -> Expr<'g> {
        let arena = view.arena;
        let zero = arena.f(0.0);
        let (right, up) = super::path::frame_of(normal);
        let (x, y, z) = (view.dot(right) * self.alpha, view.dot(up) * self.alpha, self.cos_view);
        let stretched = arena.compose(&[x, y, z]).normalize();
        let parts = stretched.components();
        let flat = parts[0] * parts[0] + parts[1] * parts[1];
        let across = arena.compose(&[-parts[1], parts[0], zero]) / flat.max(arena.f(1e-12)).sqrt();
        let first = arena.f(1e-9).lt(flat).select(across, arena.v3([1.0, 0.0, 0.0]));
        let second = stretched.cross(first);
        let (radius, angle) = (u.sqrt(), v * std::f64::consts::TAU);
        let (a, b) = (radius * angle.cos(), radius * angle.sin());
        let share = (parts[2] + 1.0) * 0.5;
        let b = (1.0 - share) * (1.0 - a * a).max(zero).sqrt() + share * b;
        let c = (1.0 - a * a - b * b).max(zero).sqrt();
        let on_ball = first * a + second * b + stretched * c;
        let parts = on_ball.components();
        let half = arena.compose(&[parts[0] * self.alpha, parts[1] * self.alpha, parts[2].max(arena.f(1e-6))]);
        let parts = half.normalize().components();
        right * parts[0] + up * parts[1] + normal * parts[2]
    }

    /// The density, by solid angle, of what mirrors by a visible normal `half` between view and direction.
    fn density(&self, normal: Expr<'g>, half: Expr<'g>) -> Expr<'g> {
        let square = self.alpha * self.alpha;
        let cos_half = normal.dot(half);
        let peak = cos_half * cos_half * (square - 1.0) + 1.0;
        let cosine = self.cos_view;
        let masked = cosine + (cosine * cosine * (1.0 - square) + square).sqrt();
        square / (peak * peak * masked * (2.0 * std::f64::consts::PI))
    }
}

/// Schlick's reflectance at a cosine, of what has `along` along the normal; rough surfaces have a weaker edge (Lagarde, 2011).
fn schlick<'g>(along: Expr<'g>, roughness: Expr<'g>, cosine: Expr<'g>) -> Expr<'g> {
    let arena = along.arena;
    let edge = (1.0 - cosine).clamp(arena.f(0.0), arena.f(1.0)).powi(5);
    along + (along.max(1.0 - roughness) - along) * edge
}

/// What a surface makes of light that goes through it: where the colour comes with the way inside, nothing.
fn tint<'g>(matter: &Matter<Expr<'g>>) -> Expr<'g> {
    let depth = matter.transmission_depth;
    if is(depth, 0.0) {
        return matter.base;
    }
    depth.lift(0.0).lt(depth).select(depth.arena.v3([1.0; 3]), matter.base)
}

impl<'g> Finish<'g> {
    /// A surface of some matter; `normal` points to the viewer's side, `view` is the unit vector towards the viewer.
    pub fn new(matter: &Matter<Expr<'g>>, normal: Expr<'g>, view: Expr<'g>) -> Finish<'g> {
        let arena = normal.arena;
        let cos_view = normal.dot(view).max(arena.f(1e-3));
        let roughness = matter.roughness;
        let ratio = (matter.ior - 1.0) / (matter.ior + 1.0);
        let dielectric = ratio * ratio * matter.specular;
        let along = arena.v3([1.0; 3]) * dielectric;
        let along = if is(matter.metallic, 0.0) { along } else { along.mix(matter.base, matter.metallic) };
        let reflectance = schlick(along, roughness, cos_view);
        let below = 1.0 - reflectance;
        let solid = if is(matter.metallic, 0.0) { below } else { below * (1.0 - matter.metallic) };
        let tinted = matter.base * solid;
        let (base, through) = match is(matter.transmission, 0.0) {
            true => (tinted, None),
            false => (tinted * (1.0 - matter.transmission), Some(tint(matter) * solid * matter.transmission)),
        };
        let coat = (!is(matter.coat, 0.0)).then(|| {
            let facets = Facets::new(matter.coat_roughness, cos_view);
            let reflectance = schlick(arena.f(COAT), matter.coat_roughness, cos_view) * matter.coat;
            (facets, reflectance, matter.coat_roughness)
        });
        let emission = (!is(matter.emission, 0.0)).then_some(matter.emission);
        let facets = Facets::new(roughness, cos_view);
        Finish { normal, view, base, through, reflectance, facets, coat, emission, roughness, ratio: 1.0 / matter.ior }
    }

    /// What is seen of a light in direction `light` whose strength is 1: the radiance, for a white matte surface that faces it 1.
    pub fn lit(&self, light: Expr<'g>) -> Expr<'g> {
        let arena = light.arena;
        let cos_light = self.normal.dot(light).max(arena.f(0.0));
        let half = (light + self.view).normalize();
        let layer = self.reflectance * self.facets.scatter(self.normal, half, cos_light);
        let below = self.base + layer;
        let all = match &self.coat {
            None => below,
            Some((facets, reflectance, _)) => {
                let over = *reflectance * facets.scatter(self.normal, half, cos_light);
                below * (1.0 - *reflectance) + arena.v3([1.0; 3]) * over
            }
        };
        all * cos_light
    }

    /// What is seen of light from all sides: `around` is the mean over the side of the normal (its irradiance over pi), `mirrored` what
    /// a mirror would show and `beyond` what is behind, as functions of a direction.
    pub fn surrounded(
        &self,
        around: Expr<'g>,
        mirrored: impl Fn(Expr<'g>, Expr<'g>) -> Expr<'g>,
        beyond: impl Fn(Expr<'g>) -> Expr<'g>,
    ) -> Expr<'g> {
        let arena = around.arena;
        let reflected = self.reflected();
        let mut all = self.base * around + self.reflectance * mirrored(reflected, self.roughness);
        if let Some(through) = self.through {
            // Bent towards the normal, as glass does once.
            let bent = (-self.view - self.normal * 0.35).normalize();
            all = all + through * beyond(bent);
        }
        match &self.coat {
            None => all,
            Some((_, reflectance, _)) => all * (1.0 - *reflectance) + mirrored(reflected, arena.f(0.0)) * *reflectance,
        }
    }

    /// The direction of which a mirror in the surface shows something.
    pub fn reflected(&self) -> Expr<'g> {
        self.normal * (self.normal.dot(self.view) * 2.0) - self.view
    }

    /// What share of the light from the mirrored direction a viewer sees as in a mirror, and what [`Finish::surrounded`] shows in its
    /// place: rough surfaces mirror nothing sharply.
    pub fn mirror(&self, mirrored: impl Fn(Expr<'g>, Expr<'g>) -> Expr<'g>) -> (Expr<'g>, Expr<'g>) {
        let arena = self.roughness.arena;
        let sharp = |roughness: Expr<'g>| 1.0 - roughness.smoothstep(arena.f(SHARP), arena.f(BLURRED));
        let layer = self.reflectance * sharp(self.roughness);
        let reflected = self.reflected();
        let counted = layer * mirrored(reflected, self.roughness);
        let Some((_, reflectance, roughness)) = self.coat else { return (layer, counted) };
        let over = reflectance * sharp(roughness);
        let below = 1.0 - reflectance;
        (layer * below + over, counted * below + mirrored(reflected, arena.f(0.0)) * over)
    }

    /// The same surface where a condition says that the viewer is behind it, in what light goes through: what is not reflected, by Fresnel's
    /// equations, leaves.
    #[must_use]
    pub fn seen_from_inside(mut self, is_inside: Expr<'g>, matter: &Matter<Expr<'g>>) -> Finish<'g> {
        let Some(through) = self.through else { return self };
        let arena = self.normal.arena;
        let (zero, one) = (arena.f(0.0), arena.f(1.0));
        let (ior, cos_view) = (matter.ior, self.facets.cos_view);
        let left = 1.0 - ior * ior * (1.0 - cos_view * cos_view);
        let cos_out = left.max(zero).sqrt();
        let across = (ior * cos_view - cos_out) / (ior * cos_view + cos_out);
        let along = (ior * cos_out - cos_view) / (ior * cos_out + cos_view);
        let reflected = left.le(zero).select(one, (across * across + along * along) * 0.5);
        let (white, black) = (arena.v3([1.0; 3]), arena.v3([0.0; 3]));
        self.through = Some(is_inside.select(tint(matter) * (1.0 - reflected), through));
        self.reflectance = is_inside.select(white * reflected, self.reflectance);
        self.base = is_inside.select(black, self.base);
        self.ratio = is_inside.select(ior, self.ratio);
        self.coat = self.coat.map(|(facets, coat, roughness)| (facets, is_inside.select(zero, coat), roughness));
        self
    }

    /// The chances that a path is scattered by the coat and by the layer, and that it goes through; the rest is the base's.
    fn chances(&self) -> (Expr<'g>, Expr<'g>, Option<Expr<'g>>) {
        let arena = self.base.arena;
        let mean = |colour: Expr<'g>| {
            let parts = colour.components();
            (parts[0] + parts[1] + parts[2]) * (1.0 / 3.0)
        };
        let (layer, base) = (mean(self.reflectance), mean(self.base));
        let through = self.through.map(mean);
        let below = through.map_or(base, |through| base + through);
        let of_layer = layer / (layer + below).max(arena.f(1e-6));
        // Neither is left out where it adds light.
        let least = arena.f(0.0).lt(below).select(arena.f(0.9), arena.f(1.0));
        let of_layer = of_layer.max(arena.f(0.1)).min(least);
        let of_coat =
            self.coat.map(|(_, coat, _)| (coat / (coat + layer + below).max(arena.f(1e-6))).max(arena.f(0.1)));
        let rest = of_coat.map_or(arena.f(1.0), |of_coat| 1.0 - of_coat);
        let of_through = |through: Expr<'g>| rest * (1.0 - of_layer) * (through / below.max(arena.f(1e-6)));
        (of_coat.unwrap_or(arena.f(0.0)), rest * of_layer, through.map(of_through))
    }

    /// A direction in which a path goes on.
    pub fn scattered(&self, random: &Random<Expr<'g>>) -> Scattered<'g> {
        let arena = self.base.arena;
        let (of_coat, of_layer, of_through) = self.chances();
        let matte = super::path::around(self.normal, (1.0 - random.u).max(arena.f(0.0)).sqrt(), random.v);
        let half = |facets: &Facets<'g>| facets.visible(self.normal, self.view, (random.u, random.v));
        let mirrored = |half: Expr<'g>| half * (half.dot(self.view) * 2.0) - self.view;
        let own = half(&self.facets);
        let above = of_coat + of_layer;
        let below = random.lobe.lt(above).select(mirrored(own), matte);
        let direction = match &self.coat {
            None => below,
            Some((facets, ..)) => random.lobe.lt(of_coat).select(mirrored(half(facets)), below),
        };
        let direction = direction.normalize();
        let scattered = Scattered {
            direction,
            value: self.lit(direction) * (1.0 / std::f64::consts::PI),
            density: self.density(direction),
            crosses: None,
        };
        let (Some(through), Some(of_through)) = (self.through, of_through) else { return scattered };
        let crosses = above.le(random.lobe).and(random.lobe.lt(above + of_through));
        let through = self.coat.map_or(through, |(_, coat, _)| through * (1.0 - coat));
        Scattered {
            direction: crosses.select(self.bent(own), direction),
            value: crosses.select(through * BENT, scattered.value),
            density: crosses.select(of_through * BENT, scattered.density),
            crosses: Some(crosses),
        }
    }

    /// The direction in which light goes on behind the surface, by Snell's law at a facet.
    fn bent(&self, facet: Expr<'g>) -> Expr<'g> {
        let cosine = facet.dot(self.view);
        let left = 1.0 - self.ratio * self.ratio * (1.0 - cosine * cosine);
        let behind = left.max(cosine.lift(0.0)).sqrt();
        (facet * (self.ratio * cosine - behind) - self.view * self.ratio).normalize()
    }

    /// The density, by solid angle, with which [`Finish::scattered`] gives a direction on the viewer's side.
    pub fn density(&self, direction: Expr<'g>) -> Expr<'g> {
        let arena = self.base.arena;
        let (of_coat, of_layer, of_through) = self.chances();
        let cosine = self.normal.dot(direction).max(arena.f(0.0));
        let half = (direction + self.view).normalize();
        let matte = cosine * (1.0 / std::f64::consts::PI);
        let layer = self.facets.density(self.normal, half);
        let rest = 1.0 - of_coat - of_layer;
        let rest = of_through.map_or(rest, |of_through| rest - of_through);
        let mut all = layer * of_layer + matte * rest;
        if let Some((facets, ..)) = &self.coat {
            all = all + facets.density(self.normal, half) * of_coat;
        }
        arena.f(0.0).lt(cosine).select(all, arena.f(0.0))
    }

    /// What it emits itself, where it does.
    pub fn emission(&self) -> Option<Expr<'g>> {
        self.emission
    }
}

impl<'g> Matter<Expr<'g>> {
    /// The share of light that is left after some way inside, by colour (Beer and Lambert); `None` where all of it is left everywhere.
    pub fn share_left(&self, way: Expr<'g>) -> Option<Expr<'g>> {
        let (arena, depth) = (way.arena, self.transmission_depth);
        let parts = || self.base.components().into_iter().map(|part| part.max(arena.f(1e-6)).ln()).collect::<Vec<_>>();
        let is_deep = arena.f(0.0).lt(depth);
        let left = || (arena.compose(&parts()) * (way / depth.max(arena.f(1e-12)))).exp();
        (!is(depth, 0.0)).then(|| is_deep.select(left(), arena.v3([1.0; 3])))
    }

    /// What surfaces are made of that nothing is said of but their colour: smooth stone.
    pub fn of_colour(base: Expr<'g>) -> Matter<Expr<'g>> {
        let f = |x: f64| base.arena.f(x);
        Matter {
            base,
            metallic: f(0.0),
            roughness: f(0.55),
            specular: f(1.0),
            transmission: f(0.0),
            transmission_depth: f(0.0),
            ior: f(1.5),
            coat: f(0.0),
            coat_roughness: f(0.05),
            emission: base.arena.v3([0.0; 3]),
        }
    }
}
