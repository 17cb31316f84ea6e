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
    normal: Expr<'g>,
    /// Unit vector towards the viewer.
    view: Expr<'g>,
    /// What the base returns of the light that it gets.
    base: Expr<'g>,
    /// Share of light that goes through, where some does.
    through: Option<Expr<'g>>,
    /// What the layer reflects at the angle of view.
    reflectance: Expr<'g>,
    facets: Facets<'g>,
    /// The coat's facets and its reflectance, where there is one.
    coat: Option<(Facets<'g>, Expr<'g>)>,
    emission: Option<Expr<'g>>,
    roughness: Expr<'g>,
}

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
            false => (tinted * (1.0 - matter.transmission), Some(tinted * matter.transmission)),
        };
        let coat = (!is(matter.coat, 0.0)).then(|| {
            let facets = Facets::new(matter.coat_roughness, cos_view);
            (facets, schlick(arena.f(COAT), matter.coat_roughness, cos_view) * matter.coat)
        });
        let emission = (!is(matter.emission, 0.0)).then_some(matter.emission);
        let facets = Facets::new(roughness, cos_view);
        Finish { normal, view, base, through, reflectance, facets, coat, emission, roughness }
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
            Some((facets, reflectance)) => {
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
        let reflected = self.normal * (self.normal.dot(self.view) * 2.0) - self.view;
        let mut all = self.base * around + self.reflectance * mirrored(reflected, self.roughness);
        if let Some(through) = self.through {
            // Bent towards the normal, as glass does once.
            let bent = (-self.view - self.normal * 0.35).normalize();
            all = all + through * beyond(bent);
        }
        match &self.coat {
            None => all,
            Some((_, reflectance)) => all * (1.0 - *reflectance) + mirrored(reflected, arena.f(0.0)) * *reflectance,
        }
    }

    /// The chances that a path is scattered by the coat and by the layer; the rest is the base's.
    fn chances(&self) -> (Expr<'g>, Expr<'g>) {
        let arena = self.base.arena;
        let mean = |colour: Expr<'g>| {
            let parts = colour.components();
            (parts[0] + parts[1] + parts[2]) * (1.0 / 3.0)
        };
        let (layer, base) = (mean(self.reflectance), mean(self.base));
        let of_layer = layer / (layer + base).max(arena.f(1e-6));
        // Neither is left out where it adds light.
        let least = arena.f(0.0).lt(base).select(arena.f(0.9), arena.f(1.0));
        let of_layer = of_layer.max(arena.f(0.1)).min(least);
        match &self.coat {
            None => (arena.f(0.0), of_layer),
            Some((_, reflectance)) => {
                let of_coat = (*reflectance / (*reflectance + layer + base).max(arena.f(1e-6))).max(arena.f(0.1));
                (of_coat, (1.0 - of_coat) * of_layer)
            }
        }
    }

    /// A direction in which a path goes on, what of its light comes from there (times the cosine), and the density of the direction.
    pub fn scattered(&self, random: &Random<Expr<'g>>) -> (Expr<'g>, Expr<'g>, Expr<'g>) {
        let arena = self.base.arena;
        let (of_coat, of_layer) = self.chances();
        let matte = super::path::around(self.normal, (1.0 - random.u).max(arena.f(0.0)).sqrt(), random.v);
        let mirrored = |facets: &Facets<'g>| {
            let half = facets.visible(self.normal, self.view, (random.u, random.v));
            half * (half.dot(self.view) * 2.0) - self.view
        };
        let below = random.lobe.lt(of_coat + of_layer).select(mirrored(&self.facets), matte);
        let direction = match &self.coat {
            None => below,
            Some((facets, _)) => random.lobe.lt(of_coat).select(mirrored(facets), below),
        };
        let direction = direction.normalize();
        let value = self.lit(direction) * (1.0 / std::f64::consts::PI);
        (direction, value, self.density(direction))
    }

    /// The density, by solid angle, with which [`Finish::scattered`] gives a direction.
    pub fn density(&self, direction: Expr<'g>) -> Expr<'g> {
        let arena = self.base.arena;
        let (of_coat, of_layer) = self.chances();
        let cosine = self.normal.dot(direction).max(arena.f(0.0));
        let half = (direction + self.view).normalize();
        let matte = cosine * (1.0 / std::f64::consts::PI);
        let layer = self.facets.density(self.normal, half);
        let mut all = layer * of_layer + matte * (1.0 - of_coat - of_layer);
        if let Some((facets, _)) = &self.coat {
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
    /// What surfaces are made of that nothing is said of but their colour: smooth stone.
    pub fn of_colour(base: Expr<'g>) -> Matter<Expr<'g>> {
        let f = |x: f64| base.arena.f(x);
        Matter {
            base,
            metallic: f(0.0),
            roughness: f(0.55),
            specular: f(1.0),
            transmission: f(0.0),
            ior: f(1.5),
            coat: f(0.0),
            coat_roughness: f(0.05),
            emission: base.arena.v3([0.0; 3]),
        }
    }
}
