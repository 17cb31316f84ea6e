//! The light of the surroundings: radiance by direction, and what of it falls on a surface.

use crate::colour::Panorama;
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::graph::Environment;
use crate::kernel::cpu::Cpu;
use crate::kernel::{Backend, BackendError, Kernel};
use crate::math::Precision;

/// Radiance that comes from a direction, a unit vector; `up` is straight up.
pub fn radiance<'g>(arena: &'g Arena, environment: &Environment, up: [f64; 3], direction: Expr<'g>) -> Expr<'g> {
    let height = direction.dot(arena.v3(up));
    let zero = arena.f(0.0);
    match *environment {
        Environment::Dome { sky, sun } => {
            let [mean, slope] = dome(sky, sun);
            arena.v3(mean) + arena.v3(slope) * height
        }
        Environment::Gradient { ground, horizon, zenith } => {
            let slope = |to: [f64; 3]| arena.v3([0, 1, 2].map(|i| to[i] - horizon[i]));
            if ground == horizon && zenith == horizon {
                return arena.v3(horizon);
            }
            arena.v3(horizon) + slope(zenith) * height.max(zero) + slope(ground) * (-height).max(zero)
        }
        Environment::Daylight { sun, turbidity, strength, ground } => {
            let sky = daylight(arena, (sun, turbidity), direction, height) * strength;
            let above = height.smoothstep(arena.f(-0.06), arena.f(0.02));
            arena.v3(ground).mix(sky, above)
        }
        Environment::Picture { ref panorama, strength, turn } => panorama.radiance(arena, turn, direction) * strength,
    }
}

/// Radiance of a dome at the horizon, and what it grows by straight up; straight down it is not below 0.
fn dome(sky: [f64; 3], sun: [f64; 3]) -> [[f64; 3]; 2] {
    let of = |of_sky: f64, of_sun: f64| [0, 1, 2].map(|i| of_sky * sky[i] + of_sun * sun[i]);
    [of(0.6, 0.03), of(0.6, -0.045)]
}

/// Coefficients of Perez' formula for the luminance Y and the chromaticities x and y: slope by turbidity, and constant.
const PEREZ: [[[f64; 2]; 5]; 3] = [
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
];
/// The zenith's chromaticities: by the square of turbidity, turbidity and 1, and by the sun's angle cubed to 1.
const ZENITH: [[[f64; 4]; 3]; 2] = [
    [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
    [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
];
/// Radiance of a thousand candelas a square metre.
const KILOCANDELA: f64 = 0.035;

/// The clear sky of Preetham, Shirley and Smits (1999), in linear sRGB: their fits of Perez' formula.
fn daylight<'g>(
    arena: &'g Arena,
    (sun, turbidity): ([f64; 3], f64),
    direction: Expr<'g>,
    height: Expr<'g>,
) -> Expr<'g> {
    let sun_angle = sun[2].clamp(0.0, 1.0).acos();
    let t = turbidity;
    let chi = (4.0 / 9.0 - t / 120.0) * (std::f64::consts::PI - 2.0 * sun_angle);
    let luminance = ((4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192).max(0.5);
    let chromaticity = |table: [[f64; 4]; 3]| {
        let row = |row: [f64; 4]| row.iter().fold(0.0, |sum, c| sum * sun_angle + c);
        (row(table[0]) * t + row(table[1])) * t + row(table[2])
    };
    let zenith = [luminance, chromaticity(ZENITH[0]), chromaticity(ZENITH[1])];
    let cosine = height.max(arena.f(0.03));
    let away = direction.dot(arena.v3(sun));
    let angle = away.acos();
    let value = |k: usize| {
        let [a, b, c, d, e] = PEREZ[k].map(|[slope, constant]| slope * t + constant);
        let sun_sq = sun_angle.cos().powi(2);
        let there = (1.0 + a * b.exp()) * (1.0 + c * (d * sun_angle).exp() + e * sun_sq);
        let by_height = ((b / cosine).exp() * a) + 1.0;
        let by_sun = (angle * d).exp() * c + (away * away * e) + 1.0;
        by_height * by_sun * (zenith[k] / there)
    };
    let (luminance, x, y) = (value(0).max(arena.f(0.0)) * KILOCANDELA, value(1), value(2));
    let scale = luminance / y;
    let (big_x, big_z) = (x * scale, (1.0 - x - y) * scale);
    let row = |r: [f64; 3]| (big_x * r[0] + luminance * r[1] + big_z * r[2]).max(arena.f(0.0));
    arena.compose(&[row([3.2406, -1.5372, -0.4986]), row([-0.9689, 1.8758, 0.0415]), row([0.0557, -0.2040, 1.0570])])
}

/// The light that falls on surfaces from all around: the mean radiance over the side of a normal, weighted by the cosine (irradiance over
/// pi), as a polynomial of the normal (nine spherical harmonics; Ramamoorthi and Hanrahan, 2001).
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Irradiance([[f64; 3]; 9]);

/// Bands and directions a band of the sums over all directions.
const BANDS: usize = 64;
const AROUND: usize = 64;

/// The harmonics, without their common constants, that come with each coefficient.
fn harmonics([x, y, z]: [f64; 3]) -> [f64; 9] {
    [1.0, x, y, z, x * y, y * z, z * x, 3.0 * z * z - 1.0, x * x - y * y]
}

/// What a coefficient of irradiance is of the sum of radiance with its harmonic: norm of the harmonic, squared, times the share of its
/// degree that a cosine keeps (1, 2/3, 1/4).
const WEIGHTS: [f64; 9] = [1.0, 2.0, 2.0, 2.0, 3.75, 3.75, 3.75, 0.3125, 0.9375];

impl Irradiance {
    /// That of an environment, by sums over directions.
    ///
    /// Errors: those of the CPU back end.
    pub fn new(environment: &Environment, up: [f64; 3]) -> Result<Irradiance, BackendError> {
        // Of what grows evenly with height two thirds of the slope are left (the second degree's share), and no sum is needed.
        if let Environment::Dome { sky, sun } = *environment {
            let [mean, slope] = dome(sky, sun);
            let along = up.map(|part| slope.map(|slope| slope * part * 2.0 / 3.0));
            let mut coefficients = [[0.0; 3]; 9];
            (coefficients[0], coefficients[1], coefficients[2], coefficients[3]) = (mean, along[0], along[1], along[2]);
            return Ok(Irradiance(coefficients));
        }
        if let Environment::Picture { panorama, strength, turn } = environment {
            return Ok(Irradiance::of_picture(panorama, *strength, *turn));
        }
        let arena = Arena::default();
        let mut function = Function::new("environment", vec![Port::new("direction", Type::V3)]);
        let direction = arena.input(0, Type::V3);
        function.output("radiance", radiance(&arena, environment, up, direction));
        let mut columns = [0, 1, 2].map(|_| Vec::with_capacity(BANDS * AROUND));
        for band in 0..BANDS {
            let z = (band as f64 + 0.5) / BANDS as f64 * 2.0 - 1.0;
            for step in 0..AROUND {
                let (sin, cos) = ((step as f64 + 0.5) / AROUND as f64 * std::f64::consts::TAU).sin_cos();
                let flat = (1.0 - z * z).sqrt();
                columns.iter_mut().zip([flat * cos, flat * sin, z]).for_each(|(column, x)| column.push(x));
            }
        }
        let cpu = Cpu::new(Precision::F64);
        let kernel = cpu.prepare(&arena, &Kernel::Map(function))?;
        let found = cpu.download(&cpu.run(&kernel, &[&cpu.upload(&columns)?])?)?;
        let of = |columns: &[Vec<f64>], i: usize| [columns[0][i], columns[1][i], columns[2][i]];
        let share = 1.0 / (BANDS * AROUND) as f64;
        Ok(Irradiance::summed((0..BANDS * AROUND).map(|i| (of(&columns, i), of(&found, i), share))))
    }

    /// That of a picture, by a sum over its texels, in parts where they are large.
    fn of_picture(panorama: &Panorama, strength: f64, turn: f64) -> Irradiance {
        let parts = (BANDS as u32 / panorama.size()[1]).max(1);
        let texels = panorama.texels().flat_map(|texel| std::iter::repeat_n(texel, (parts * parts) as usize));
        Irradiance::summed(texels.zip(panorama.directions(parts)).map(|(texel, [around, polar, solid])| {
            let ((sin, cos), (flat, z)) = ((around - turn).sin_cos(), polar.sin_cos());
            let radiance = texel.map(|part| f64::from(part) * strength);
            ([flat * sin, flat * cos, z], radiance, solid / (4.0 * std::f64::consts::PI))
        }))
    }

    /// The sum of light from directions, each with its radiance and its share of all.
    fn summed(light: impl Iterator<Item = ([f64; 3], [f64; 3], f64)>) -> Irradiance {
        let mut sums = [[0.0; 3]; 9];
        for (direction, radiance, share) in light {
            for (sum, part) in sums.iter_mut().zip(harmonics(direction)) {
                (0..3).for_each(|k| sum[k] += part * radiance[k] * share);
            }
        }
        let mut coefficients = [[0.0; 3]; 9];
        for (to, (sum, weight)) in coefficients.iter_mut().zip(sums.iter().zip(WEIGHTS)) {
            *to = sum.map(|x| x * weight);
        }
        Irradiance(coefficients)
    }

    /// On a surface with a normal.
    pub fn on<'g>(&self, normal: Expr<'g>) -> Expr<'g> {
        let arena = normal.arena;
        let parts = normal.components();
        let (x, y, z) = (parts[0], parts[1], parts[2]);
        let values = [x, y, z, x * y, y * z, z * x, z * z * 3.0 - 1.0, x * x - y * y];
        let largest = self.0.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        let is_seen = |c: &[f64; 3]| c.iter().any(|x| x.abs() > largest * 1e-9);
        let terms = self.0[1..].iter().zip(values).filter(|(c, _)| is_seen(c));
        let sum = terms.fold(arena.v3(self.0[0]), |sum, (c, value)| sum + arena.v3(*c) * value);
        sum.max(arena.f(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::Irradiance;
    use crate::graph::Environment;

    #[test]
    fn a_sky_of_one_lights_everything_by_one() {
        let white = Environment::Gradient { ground: [1.0; 3], horizon: [1.0; 3], zenith: [1.0; 3] };
        let Irradiance(found) = Irradiance::new(&white, [0.0, 0.0, 1.0]).expect("the CPU computes it");
        assert!((found[0][0] - 1.0).abs() < 1e-12);
        assert!(found[1..].iter().flatten().all(|x| x.abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_dome_lights_as_the_sum_over_its_directions_says() {
        let (sky, sun) = ([0.4, 0.5, 0.8], [2.0, 1.8, 1.5]);
        let [mean, slope] = super::dome(sky, sun);
        let at = |height: f64| [0, 1, 2].map(|i| mean[i] + height * slope[i]);
        let same = Environment::Gradient { ground: at(-1.0), horizon: mean, zenith: at(1.0) };
        let up = [0.0, 0.0, 1.0];
        let [Irradiance(a), Irradiance(b)] =
            [Environment::Dome { sky, sun }, same].map(|sky| Irradiance::new(&sky, up).expect("the CPU computes it"));
        a.iter().flatten().zip(b.iter().flatten()).for_each(|(a, b)| assert!((a - b).abs() < 1e-3, "{a} {b}"));
    }

    #[test]
    fn a_sky_that_grows_with_height_lights_by_two_thirds_of_its_slope() {
        let sky = Environment::Gradient { ground: [0.0; 3], horizon: [1.0; 3], zenith: [2.0; 3] };
        let Irradiance(found) = Irradiance::new(&sky, [0.0, 0.0, 1.0]).expect("the CPU computes it");
        assert!((found[0][0] - 1.0).abs() < 1e-9 && (found[3][0] - 2.0 / 3.0).abs() < 1e-3, "{found:?}");
    }
}
