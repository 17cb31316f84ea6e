//! Paths of light: at each surface that a ray meets, light that comes straight from a light source, and the ray on which the path goes on.
//!
//! A path is followed from the camera. At each of its points one light is picked and its light is added if nothing stands between
//! (next-event estimation), and the next direction is picked as the surface scatters light. Where such a ray ends in the sun's disc, or a
//! light's sample could have been found by scattering, both ways share the light by the balance heuristic (Veach, 1997).
//! Random numbers come in from outside: [`Random`]. So both back ends follow the same paths.

use super::colour::{Face, facing_normal};
use super::finish::{Finish, Scattered};
use super::light::Incoming;
use super::panorama::Sampler;
use super::{Air, Lighting, Seen, Threshold, range_within};
use crate::compose::Bounds;
use crate::compose::matter::may_transmit;
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{Light, LightKind, Look};
use crate::kernel::records::{Marched, Path, Random, Ray, UNKNOWN, is_unknown};
use crate::march::is_hit_of;

/// What paths are composed from.
pub struct Paths<'a> {
    /// The look of surfaces.
    pub look: &'a Look,
    /// The light.
    pub lighting: &'a Lighting,
    /// Hit thresholds of its rays.
    pub threshold: Threshold,
    /// What rays are cut to.
    pub bounds: &'a Bounds,
    /// Surfaces that a path meets before chance may end it.
    pub sure_bounces: u32,
}

/// Radiance that the later points of one path add at most: rarer and brighter ones would be white dots.
const BRIGHTEST: f64 = 16.0;
/// Least and most chance that a path goes on.
const SURVIVAL: (f64, f64) = (0.05, 0.98);

/// A point of a path, ready to be lit.
struct Point<'g> {
    seen: Seen<'g>,
    normal: Expr<'g>,
    finish: Finish<'g>,
    path: Path<Expr<'g>>,
    random: Random<Expr<'g>>,
    /// Where rays leave the surface on the viewer's side.
    start: Expr<'g>,
    hit_eps: Expr<'g>,
    /// Whether the path is inside what light goes through, where it can be.
    inside: Option<Expr<'g>>,
}

impl<'g> Point<'g> {
    /// How the path goes on, where rays leave the surface for there, and whether they are inside then.
    fn onwards(&self) -> (Scattered<'g>, Expr<'g>, Option<Expr<'g>>) {
        let scattered = self.finish.scattered(&self.random);
        let (Some(crosses), Some(inside)) = (scattered.crosses, self.inside) else {
            return (scattered, self.start, None);
        };
        let Ray { origin, direction, .. } = self.seen.ray;
        let behind = origin + direction * self.seen.march.t - self.normal * (self.hit_eps * 2.0);
        let start = crosses.select(behind, self.start);
        (scattered, start, Some(crosses.and(!inside).or((!crosses).and(inside))))
    }
}

/// A direction towards a light.
struct Sampled<'g> {
    incoming: Incoming<'g>,
    /// Density of the direction by solid angle; nothing of lights without extent.
    density: Option<Expr<'g>>,
    /// Number of lights, which is one over the chance of this one.
    among: f64,
}

impl Paths<'_> {
    fn read<'g>(&self, inputs: &mut Inputs<'g>) -> Point<'g> {
        let seen = Seen::read(inputs);
        let face = Face::read(self.look, inputs);
        let (mut path, random) = (Path::read(inputs), Random::read(inputs));
        let direction = seen.ray.direction;
        let inside = may_transmit(self.look).then(|| path.inside.lift(0.5).lt(path.inside));
        let finish = match inside {
            None => face.finish(&seen),
            Some(inside) => {
                let outwards = inside.select(-face.gradient, face.gradient);
                let normal = facing_normal(outwards, direction);
                Finish::new(&face.matter, normal, -direction).seen_from_inside(inside, &face.matter)
            }
        };
        if let Some(inside) = inside
            && let Some(left) = face.matter.share_left(seen.march.t - seen.ray.t_near)
        {
            path.throughput = path.throughput * inside.select(left, path.throughput.lift(1.0));
        }
        let normal = finish.normal;
        let hit_eps = self.threshold.at(seen.march.t);
        let front = seen.front(hit_eps);
        // Rays that come from inside end beyond the surface.
        let front = inside.map_or(front, |inside| inside.select(seen.march.t - hit_eps * 4.0, front));
        let start = seen.ray.origin + direction * front + normal * (hit_eps * 2.0);
        Point { seen, normal, finish, path, random, start, hit_eps, inside }
    }

    /// A light and a direction towards it, picked by chance.
    fn sample<'g>(&self, arena: &'g Arena, point: &Point<'g>) -> Option<Sampled<'g>> {
        let among = self.lighting.picked() as f64;
        let pick = point.random.light * among;
        let random = (point.random.light_u, point.random.light_v);
        let lights = self.lighting.lights.iter().map(|light| sampled(arena, light, point.start, random));
        let around = self.lighting.sampler.iter().map(|sampler| self.surroundings(arena, sampler, random));
        let mut all = lights.chain(around).enumerate().collect::<Vec<_>>().into_iter().rev();
        let (_, (first, density)) = all.next()?;
        let has_extent = self.lighting.lights.iter().any(|light| extent(light) > 0.0);
        let has_extent = has_extent || self.lighting.sampler.is_some();
        let far = arena.f(1e30);
        let mut found = (first.direction, first.distance.unwrap_or(far), first.strength, density);
        for (number, (own, density)) in all {
            let is_it = pick.lt(arena.f(number as f64 + 1.0));
            found = (
                is_it.select(own.direction, found.0),
                is_it.select(own.distance.unwrap_or(far), found.1),
                is_it.select(own.strength, found.2),
                is_it.select(density, found.3),
            );
        }
        let incoming = Incoming { direction: found.0, distance: Some(found.1), strength: found.2 };
        Some(Sampled { incoming, density: has_extent.then_some(found.3), among })
    }

    /// A direction towards the surroundings, picked by their light, and its density.
    fn surroundings<'g>(
        &self,
        arena: &'g Arena,
        sampler: &Sampler,
        random: (Expr<'g>, Expr<'g>),
    ) -> (Incoming<'g>, Expr<'g>) {
        let direction = sampler.direction(arena, random);
        let density = sampler.density(arena, direction);
        let strength = self.lighting.radiance(arena, direction) / (density * std::f64::consts::PI);
        (Incoming { direction, distance: None, strength }, density)
    }

    /// Points of paths to rays towards the lights that are picked there.
    pub fn compose_light_ray(&self, arena: &Arena, skipped: f64) -> Function {
        let mut inputs = Inputs::new(arena);
        let point = self.read(&mut inputs);
        let mut function = inputs.function("light_ray");
        let nowhere = arena.f(Ray::NOWHERE);
        let Some(Sampled { incoming, .. }) = self.sample(arena, &point) else {
            let ray = Ray { t_far: nowhere, ..point.seen.ray };
            ray.write(&mut function);
            return function;
        };
        let Incoming { direction, distance, .. } = incoming;
        let (_, far) = range_within(self.bounds, point.start, direction, arena.f(0.0));
        let far = distance.map_or(far, |distance| far.min(distance));
        let faces = arena.f(0.0).lt(point.normal.dot(direction));
        let wanted = point.seen.is_hit().and(faces).and(arena.f(0.0).lt(far));
        let t = point.seen.march.t;
        let ray = Ray {
            origin: point.start - direction * t,
            direction,
            t_near: t + point.hit_eps * skipped,
            t_far: wanted.select(t + far, nowhere),
        };
        ray.write(&mut function);
        function
    }

    /// Points of paths to the rays on which they go on; empty ones where they end.
    pub fn compose_bounce_ray(&self, arena: &Arena, skipped: f64) -> Function {
        let mut inputs = Inputs::new(arena);
        let point = self.read(&mut inputs);
        let mut function = inputs.function("bounce_ray");
        let (Scattered { direction, .. }, start, is_inside) = point.onwards();
        let (throughput, goes_on) = self.onwards(arena, &point);
        let (_, far) = range_within(self.bounds, start, direction, arena.f(0.0));
        let is_alive = goes_on.and(arena.f(0.0).lt(brightest(throughput)));
        let t = point.seen.march.t;
        let near = t + point.hit_eps * skipped;
        let ray = Ray {
            origin: start - direction * t,
            direction,
            t_near: is_inside.map_or(near, |is_inside| is_inside.select(t, near)),
            // A ray that leaves at once sees the surroundings: its range is empty, and it lives.
            t_far: is_alive.and(arena.f(0.0).lt(far)).select(t + far, arena.f(Ray::NOWHERE)),
        };
        ray.write(&mut function);
        function
    }

    /// What of a path's light goes on with its next ray, and whether it does.
    fn onwards<'g>(&self, arena: &'g Arena, point: &Point<'g>) -> (Expr<'g>, Expr<'g>) {
        let (zero, one) = (arena.f(0.0), arena.f(1.0));
        let Scattered { direction, value, density, crosses } = point.finish.scattered(&point.random);
        let above = zero.lt(point.normal.dot(direction)).and(zero.lt(density));
        let above = crosses.map_or(above, |crosses| above.or(crosses));
        let weight = above.select(value / density.max(arena.f(1e-12)), arena.v3([0.0; 3]));
        let throughput = point.path.throughput * weight;
        let (least, most) = SURVIVAL;
        let chance = brightest(throughput).clamp(arena.f(least), arena.f(most));
        let is_sure = point.path.bounces.lt(arena.f(f64::from(self.sure_bounces)));
        let survives = is_sure.or(point.random.survival.lt(chance));
        let scale = is_sure.select(one, one / chance);
        let goes_on = point.seen.is_hit().and(survives);
        (goes_on.select(throughput * scale, arena.v3([0.0; 3])), goes_on)
    }

    /// Points of paths, and the marches towards the lights that were picked there, to the paths' next states.
    pub fn compose_path(&self, arena: &Arena) -> Function {
        let mut inputs = Inputs::new(arena);
        let point = self.read(&mut inputs);
        let shadow = (self.lighting.picked() > 0).then(|| Marched::read_as("light_", &mut inputs));
        let passing = self.lighting.atmosphere.glow.map(|_| Marched::read_as("glow_", &mut inputs));
        let mut function = inputs.function("path");
        let (path, direction) = (point.path, point.seen.ray.direction);
        let is_first = is_unknown(path.density);
        let is_hit = point.seen.is_hit();
        let nothing = arena.v3([0.0; 3]);

        // What the ray has met: a surface with its own light and that of a light source, or the surroundings.
        let mut here = point.finish.emission().unwrap_or(nothing);
        if let (Some(shadow), Some(sampled)) = (shadow, self.sample(arena, &point)) {
            here = here + self.straight(arena, &point, shadow, &sampled);
        }
        let beyond = self.found_surroundings(arena, &point) + self.found_lights(arena, &point);
        let around = is_first.select(self.lighting.background(arena, direction), beyond);
        let air = Air { arena, lighting: self.lighting, seen: &point.seen, passing };
        let through_air = air.seen_through(here, around);
        let met = is_hit.select(here, around);
        let met = if air.is_clear() { met } else { is_first.select(through_air, met) };
        let light = met * path.throughput;
        let bounded = light * (arena.f(BRIGHTEST) / brightest(light).max(arena.f(BRIGHTEST)));
        let radiance = path.radiance + is_first.select(light, bounded);

        let (throughput, goes_on) = self.onwards(arena, &point);
        let throughput = match air.is_clear() {
            true => throughput,
            false => is_first.select(throughput * air.share_kept(), throughput),
        };
        let (Scattered { density, .. }, _, is_inside) = point.onwards();
        let next = Path {
            throughput,
            density: goes_on.select(density, arena.f(0.0)),
            bounces: path.bounces + 1.0,
            // What is not a number is nothing.
            radiance: radiance.le(arena.f(1e30)).select(radiance, nothing),
            inside: is_inside.map_or(arena.f(0.0), |is_inside| is_inside.select(arena.f(1.0), arena.f(0.0))),
        };
        next.write(&mut function);
        function
    }

    /// The light of the source that was picked, if nothing stands between.
    fn straight<'g>(
        &self,
        arena: &'g Arena,
        point: &Point<'g>,
        shadow: Marched<Expr<'g>>,
        sampled: &Sampled<'g>,
    ) -> Expr<'g> {
        let Incoming { direction, strength, .. } = &sampled.incoming;
        let is_lit = is_hit_of(shadow).select(arena.f(0.0), arena.f(sampled.among));
        let mut share = is_lit;
        if let Some(density) = sampled.density {
            // Of suns the rays that are scattered find a share, too.
            let own = density * (1.0 / sampled.among);
            let other = point.finish.density(*direction);
            share = arena.f(0.0).lt(density).select(is_lit * own / (own + other).max(arena.f(1e-12)), is_lit);
        }
        point.finish.lit(*direction) * *strength * share
    }

    /// The light of the surroundings that a scattered ray ends in: what [`Paths::straight`] leaves to it, where it finds some.
    fn found_surroundings<'g>(&self, arena: &'g Arena, point: &Point<'g>) -> Expr<'g> {
        let direction = point.seen.ray.direction;
        let radiance = self.lighting.radiance(arena, direction);
        let Some(sampler) = &self.lighting.sampler else { return radiance };
        let own = sampler.density(arena, direction) * (1.0 / self.lighting.picked() as f64);
        radiance * (point.path.density / (point.path.density + own).max(arena.f(1e-12)))
    }

    /// The light of suns whose discs a scattered ray ends in: what [`Paths::straight`] leaves to it.
    fn found_lights<'g>(&self, arena: &'g Arena, point: &Point<'g>) -> Expr<'g> {
        let among = self.lighting.picked() as f64;
        let mut sum = arena.v3([0.0; 3]);
        for light in &self.lighting.lights {
            let LightKind::Sun { direction, angle, .. } = light.kind else { continue };
            let cosine = (angle / 2.0).cos();
            if angle == 0.0 {
                continue;
            }
            let solid = std::f64::consts::TAU * (1.0 - cosine);
            let own = 1.0 / (solid * among);
            let is_in = arena.f(cosine).lt(point.seen.ray.direction.dot(arena.v3(direction)));
            let share = point.path.density / (point.path.density + own);
            let radiance = light.colour.map(|part| part * std::f64::consts::PI / solid);
            sum = sum + is_in.select(arena.v3(radiance) * share, arena.v3([0.0; 3]));
        }
        sum
    }
}

/// The path before its first ray: all light counts, and no ray was scattered.
pub fn first_path() -> [f64; Path::<usize>::WIDTH] {
    [1.0, 1.0, 1.0, UNKNOWN, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Rays of paths to the same where paths are inside what light goes through, else to empty ones.
pub fn compose_inner_ray(arena: &Arena) -> Function {
    let mut inputs = Inputs::new(arena);
    let (ray, path) = (Ray::read(&mut inputs), Path::read(&mut inputs));
    let mut function = inputs.function("inner_ray");
    let t_far = arena.f(0.5).lt(path.inside).select(ray.t_far, arena.f(Ray::NOWHERE));
    Ray { t_far, ..ray }.write(&mut function);
    function
}

/// Ends of rays as if they were outside, ends of those inside, and paths to the ends that count.
pub fn compose_join_ends(arena: &Arena) -> Function {
    let mut inputs = Inputs::new(arena);
    let (outer, inner) = (Marched::read(&mut inputs), Marched::read_as("inner_", &mut inputs));
    let path = Path::read(&mut inputs);
    let mut function = inputs.function("join_ends");
    let is_inside = arena.f(0.5).lt(path.inside);
    let mut others = inner.values().into_iter();
    outer.map(|own| others.next().map_or(own, |other| is_inside.select(other, own))).write(&mut function);
    function
}

/// The greatest component.
pub(super) fn brightest(colour: Expr<'_>) -> Expr<'_> {
    let parts = colour.components();
    parts[0].max(parts[1]).max(parts[2])
}

/// The extent of a light: the angle of a sun, the radius of a lamp.
fn extent(light: &Light) -> f64 {
    match light.kind {
        LightKind::Sun { angle, .. } => angle,
        LightKind::Lamp { radius, .. } => radius,
    }
}

/// A direction towards a light, picked evenly from those to its disc, and its density: 0 for lights without extent and for lamps, which no
/// scattered ray finds.
fn sampled<'g>(
    arena: &'g Arena,
    light: &Light,
    point: Expr<'g>,
    (u, v): (Expr<'g>, Expr<'g>),
) -> (Incoming<'g>, Expr<'g>) {
    let centre = Incoming::new(arena, light, point);
    let zero = arena.f(0.0);
    let (least, density) = match light.kind {
        LightKind::Sun { angle: 0.0, .. } | LightKind::Lamp { radius: 0.0, .. } => return (centre, zero),
        LightKind::Sun { angle, .. } => {
            let cosine = (angle / 2.0).cos();
            (arena.f(cosine), arena.f(1.0 / (std::f64::consts::TAU * (1.0 - cosine))))
        }
        LightKind::Lamp { radius, .. } => {
            let far = centre.distance.unwrap_or(zero) + radius;
            let sine = (far.lift(radius) / far.max(arena.f(radius))).min(arena.f(1.0));
            ((1.0 - sine * sine).max(zero).sqrt(), zero)
        }
    };
    let cosine = 1.0 - (1.0 - least) * u;
    let direction = around(centre.direction, cosine, v);
    (Incoming { direction, ..centre }, density)
}

/// The direction at an angle of this cosine around an axis, `turn` from 0 to 1 of the way around it.
pub(super) fn around<'g>(axis: Expr<'g>, cosine: Expr<'g>, turn: Expr<'g>) -> Expr<'g> {
    let (right, up) = frame_of(axis);
    let sine = (1.0 - cosine * cosine).max(cosine.lift(0.0)).sqrt();
    let angle = turn * std::f64::consts::TAU;
    (axis * cosine + (right * angle.cos() + up * angle.sin()) * sine).normalize()
}

/// Two unit vectors across a third and each other (Duff et al., 2017).
pub(super) fn frame_of(axis: Expr<'_>) -> (Expr<'_>, Expr<'_>) {
    let arena = axis.arena;
    let parts = axis.components();
    let (x, y, z) = (parts[0], parts[1], parts[2]);
    let sign = arena.f(0.0).le(z).select(arena.f(1.0), arena.f(-1.0));
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    let right = arena.compose(&[sign * x * x * a + 1.0, sign * b, -sign * x]);
    let up = arena.compose(&[b, sign + y * y * a, -y]);
    (right, up)
}
