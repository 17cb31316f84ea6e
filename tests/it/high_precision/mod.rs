//! The program's f64 values of z, r, J and every estimate against an independent computation with 115 digits.
//!
//! The other side is written from the definitions (`systems.rs`), with angles where the program has complex numbers,
//! conditions where it has clamps, and differences where it has derivatives. Points are drawn at random; those whose
//! orbits the rounding of f64 itself spoils (see [`WORST`]) are drawn again.

mod big;
mod systems;

use big::{Big, V, dot, length, scaled, sum, vector};
use bulbfold::check::{Backends, Formula, Random, Subject, Target};
use bulbfold::compose::{Purpose, compose_estimator};
use bulbfold::expr::Function;
use bulbfold::graph::Method;
use bulbfold::kernel::{Estimator, Kernel};
use systems::{Constant, Form, System};

/// Greatest relative difference.
const TOLERANCE: f64 = 1e-9;
/// Points of each system.
const POINTS: usize = 20;
/// Greatest product of stretches of an orbit: it multiplies the rounding of p, 1e-16.
const WORST: f64 = 1e5;
/// Step of finite differences as the program is told it, in world units.
const STEP: f64 = 1e-4;

/// The reference at the end of an orbit.
struct End {
    iterations: u32,
    z: V,
    /// Scalar running derivative.
    dr: Big,
    /// Derivatives of z by each coordinate of p: columns of J.
    columns: [V; 3],
}

/// z after a number of iterations, or where the orbit escapes if there is no number; and dr.
fn orbit(system: &System, p: &V, iterations: Option<u32>) -> Option<(V, Big, u32)> {
    let (mut z, mut dr) = (p.clone(), Big::from(1.0));
    let (mut before, mut before_dr) = (vector([0.0; 3]), Big::from(0.0));
    let (memory, share) = (Big::from(system.memory), Big::from(system.memory.abs()));
    let escape_radius = Big::from(system.escape_radius);
    for n in 0..iterations.unwrap_or(system.max_iterations) {
        let (mapped, factor) = (system.map)(&z, n);
        let mapped = sum(&mapped, &scaled(&before, &memory));
        before = z;
        z = match &system.constant {
            Constant::Point => sum(&mapped, p),
            Constant::Fixed(c) => sum(&mapped, &vector(*c)),
            Constant::None => mapped,
        };
        (dr, before_dr) = (&dr * factor + &share * before_dr, dr);
        if let Constant::Point = system.constant {
            dr = dr + Big::from(1.0);
        }
        if iterations.is_none() && escape_radius < length(&z) {
            return Some((z, dr, n + 1));
        }
    }
    iterations.map(|n| (z, dr, n))
}

/// `p` moved along an axis.
fn moved(p: &V, axis: usize, by: &Big) -> V {
    let mut moved = p.clone();
    moved[axis] = &moved[axis] + by;
    moved
}

impl End {
    /// `None` where the orbit does not escape.
    fn of(system: &System, p: &V) -> Option<End> {
        let (z, dr, iterations) = orbit(system, p, None)?;
        // Central differences: an error of h^2 = 1e-72 by the third derivative, and of 1e-115 / h = 1e-79 by rounding.
        let h = Big::two_to(-120);
        let column = |axis: usize| {
            let at = |by: &Big| orbit(system, &moved(p, axis, by), Some(iterations)).expect("a number is given").0;
            let (after, before) = (at(&h), at(&-h.clone()));
            [0, 1, 2].map(|i| (&after[i] - &before[i]) / (&h * Big::from(2.0)))
        };
        Some(End { iterations, z, dr, columns: [column(0), column(1), column(2)] })
    }

    fn r(&self) -> Big {
        length(&self.z)
    }

    /// Length of the gradient of r.
    fn slope(&self) -> Big {
        let gradient = self.columns.clone().map(|column| dot(&column, &self.z) / self.r());
        length(&gradient)
    }

    /// The largest singular value of J: the root of the largest root of the characteristic polynomial of J^T J, which
    /// Newton's method comes down to from the trace.
    fn stretch(&self) -> Big {
        let entry = |i: usize, j: usize| dot(&self.columns[i], &self.columns[j]);
        let (a, b, c) = (entry(0, 0), entry(1, 1), entry(2, 2));
        let (d, e, f) = (entry(0, 1), entry(0, 2), entry(1, 2));
        let trace = &a + &b + &c;
        let minors = &a * &b + &a * &c + &b * &c - &d * &d - &e * &e - &f * &f;
        let two = Big::from(2.0);
        let determinant = &a * &b * &c + &two * &d * &e * &f - &a * &f * &f - &b * &e * &e - &c * &d * &d;
        let mut root = trace.clone();
        // Equal roots, as of similarities, are approached by a third or a half of the way in each step only.
        for _ in 0..500 {
            let value = ((&root - &trace) * &root + &minors) * &root - &determinant;
            let slope = (Big::from(3.0) * &root - &two * &trace) * &root + &minors;
            if slope <= &trace * &trace * Big::two_to(-200) {
                break;
            }
            root = root - value / slope;
        }
        root.sqrt()
    }

    /// Length of J d.
    fn along(&self, d: &V) -> Big {
        let parts: Vec<V> = (0..3).map(|i| scaled(&self.columns[i], &d[i])).collect();
        length(&sum(&sum(&parts[0], &parts[1]), &parts[2]))
    }

    /// Root of the sum of all squares of J.
    fn frobenius(&self) -> Big {
        self.columns.iter().map(|column| dot(column, column)).reduce(|a, b| a + b).expect("three columns").sqrt()
    }

    /// Distance of the form, for a derivative.
    fn distance(&self, form: Form, dr: &Big) -> Big {
        match form {
            Form::Linear(radius) => (self.r() - Big::from(radius)) / dr,
            Form::Logarithmic(_) => self.r() * self.r().ln() / (Big::from(2.0) * dr),
        }
    }
}

/// The derivative of r from values at p + h e_i, all at the iteration count of p; of ln r for logarithmic forms.
fn difference_slope(system: &System, end: &End, p: &V) -> Big {
    let (h, r) = (Big::from(STEP), end.r());
    let gradient = [0, 1, 2].map(|axis| {
        let shifted = length(&orbit(system, &moved(p, axis, &h), Some(end.iterations)).expect("a number is given").0);
        match system.form {
            Form::Linear(_) => (shifted - &r) / &h,
            Form::Logarithmic(_) => (shifted / &r).ln() * &r / &h,
        }
    });
    length(&gradient)
}

/// Length of the change of z along d, at the iteration count of p.
fn change_along(system: &System, end: &End, p: &V, d: &V) -> Big {
    let h = Big::from(STEP);
    let shifted = orbit(system, &sum(p, &scaled(d, &h)), Some(end.iterations)).expect("a number is given").0;
    length(&sum(&shifted, &scaled(&end.z, &Big::from(-1.0)))) / h
}

/// What the method must say. A method that has no reference here fails the test.
fn expected(method: Method, system: &System, end: &End, p: &V, d: &V) -> Option<Big> {
    let form = system.form;
    Some(match method.name() {
        "scalar" => end.distance(form, &end.dr),
        "gradient" => end.distance(form, &end.slope()),
        "combined" => end.distance(form, &end.dr.max(&end.slope())),
        "jacobian" => end.distance(form, &end.stretch()),
        "frobenius" => end.distance(form, &end.frobenius()),
        "directional" => end.distance(form, &end.along(d)),
        "delta" => end.distance(form, &difference_slope(system, end, p)),
        "delta-ray" => end.distance(form, &change_along(system, end, p, d)),
        "potential" => match form {
            // ln r / power^n over twice the length of its gradient: the powers cancel.
            Form::Logarithmic(_) => end.r().ln() / (Big::from(2.0) * end.slope() / end.r()),
            Form::Linear(_) => panic!("a potential where r grows by a factor"),
        },
        "sinh" => {
            // Where iterations grow r by different powers there is no one potential to compare with.
            let Form::Logarithmic(Some(power)) = form else { return None };
            let scale = Big::from(power).powi(end.iterations as usize);
            let (g, slope) = (end.r().ln() / &scale, end.slope() / (end.r() * &scale));
            (Big::from(1.0) - (Big::from(-2.0) * g).exp()) / (Big::from(4.0) * slope)
        }
        // A proof depends on how far it was asked to reach; tests/it/certified.rs attacks them.
        "certified" | "certified-ball" => return None,
        name => panic!("the method {name} has no reference"),
    })
}

/// Points whose orbits escape after some iterations, with what is right there.
fn points(system: &System) -> Vec<([f64; 3], End)> {
    let mut random = Random::new(5);
    let mut found = Vec::new();
    for _ in 0..4000 {
        let p = [0; 3].map(|_| random.range(-system.reach, system.reach));
        let Some(end) = End::of(system, &vector(p)) else { continue };
        // Below a radius of 1 the logarithmic form has no answer, nor the linear one inside its own.
        let sound = end.distance(system.form, &end.dr) > Big::from(1e-3);
        if end.iterations >= 2 && sound && end.dr < Big::from(WORST) {
            found.push((p, end));
        }
        if found.len() == POINTS {
            break;
        }
    }
    assert_eq!(found.len(), POINTS, "{}: too few points escape as they should", system.name);
    found
}

fn close(found: f64, wanted: &Big, size: &Big, what: &str) {
    let error = (Big::from(found) - wanted).abs().to_f64() / size.abs().to_f64();
    assert!(error <= TOLERANCE, "{what}: {found}, the reference says {}: off by {error:e}", wanted.to_f64());
}

fn inwards(p: [f64; 3]) -> [f64; 3] {
    let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
    p.map(|x| -x / length)
}

fn columns(points: &[[f64; 3]]) -> Vec<Vec<f64>> {
    let directions: Vec<[f64; 3]> = points.iter().map(|p| inwards(*p)).collect();
    Estimator::columns(points, &directions, &vec![STEP; points.len()], 1e-9)
}

/// Everything the orbit carries at its end, the count of iterations last: z, dr, rows of J.
fn state_kernel(subject: &Subject) -> (Kernel, Vec<String>) {
    let choices = subject.choices(Some(Method::Combined)).expect("the method applies");
    let mut estimator =
        compose_estimator(&subject.composer(), &choices, Purpose::March).unwrap_or_else(|e| panic!("{}", e.message));
    let orbit = &mut estimator.orbits[0];
    let mut finish = Function::new("state", orbit.finish.inputs.clone());
    for (i, port) in orbit.state.iter().enumerate() {
        finish.output(port.name.clone(), subject.arena.input(i as u16, port.ty));
    }
    let mut combine = Function::new("combine", estimator.combine.inputs[..Estimator::inputs().len()].to_vec());
    combine.inputs.extend(finish.output_ports());
    let mut ends = estimator.combine.inputs.clone();
    combine.inputs.extend(ends.split_off(ends.len() - 2));
    let first = Estimator::inputs().len();
    for i in first..combine.inputs.len() {
        let port = combine.inputs[i].clone();
        combine.output(port.name, subject.arena.input(i as u16, port.ty));
    }
    let names = orbit.state.iter().map(|port| port.name.clone()).collect();
    orbit.finish = finish;
    estimator.combine = combine;
    (Kernel::Estimate(estimator), names)
}

fn check_state(system: &System, subject: &Subject, points: &[([f64; 3], End)]) {
    let (kernel, names) = state_kernel(subject);
    assert_eq!(names[..5], ["z", "dr", "j_x", "j_y", "j_z"], "the state has other parts now");
    let remembered = ["z", "dr", "j_x", "j_y", "j_z"].map(|name| format!("before_0_{name}"));
    assert_eq!(names[5..], if system.memory == 0.0 { Vec::new() } else { remembered.to_vec() });
    let places: Vec<[f64; 3]> = points.iter().map(|(p, _)| *p).collect();
    let out = Backends::cpu_only().run(Target::CPU_F64, subject.arena, &kernel, &columns(&places)).unwrap();
    for (i, (p, end)) in points.iter().enumerate() {
        let place = |what: &str| format!("{}: {what} at {p:?}", system.name);
        assert_eq!(out[out.len() - 1][i], f64::from(end.iterations), "{}", place("iterations"));
        let size = end.frobenius();
        for k in 0..3 {
            close(out[k][i], &end.z[k], &end.r(), &place("z"));
            for axis in 0..3 {
                // Components are compared with the size of all of J: small ones are differences of large ones.
                close(out[4 + 3 * k + axis][i], &end.columns[axis][k], &size, &place("J"));
            }
        }
        close(out[3][i], &end.dr, &end.dr, &place("dr"));
    }
}

fn check_estimates(system: &System, subject: &Subject, points: &[([f64; 3], End)]) {
    let places: Vec<[f64; 3]> = points.iter().map(|(p, _)| *p).collect();
    let backends = Backends::cpu_only();
    for method in Method::ALL {
        let Some(choices) = subject.choices(Some(method)) else { continue };
        let probe = compose_estimator(&subject.composer(), &choices, Purpose::Probe);
        let kernel = Kernel::Estimate(probe.unwrap_or_else(|e| panic!("{}", e.message)));
        let out = backends.run(Target::CPU_F64, subject.arena, &kernel, &columns(&places)).unwrap();
        for (i, (p, end)) in points.iter().enumerate() {
            let d = vector(inwards(*p));
            let Some(wanted) = expected(method, system, end, &vector(*p), &d) else { continue };
            let wanted = wanted.max(&Big::from(0.0));
            let what = format!("{}: {} at {p:?}", system.name, method.name());
            assert_eq!(out[1][i], 0.0, "{what}: inside");
            close(out[0][i], &wanted, &wanted, &what);
            close(out[3][i], &end.r(), &end.r(), &what);
        }
    }
}

fn check(index: usize) {
    let system = systems::all().swap_remove(index);
    let formula = Formula::from_ron(&system.text).unwrap_or_else(|error| panic!("{}\n{error}", system.text));
    let subject = formula.subject();
    let points = points(&system);
    check_state(&system, &subject, &points);
    check_estimates(&system, &subject, &points);
}

macro_rules! tests {
    ($($name:ident = $index:expr;)*) => {
        $(#[test]
        fn $name() {
            check($index);
        })*

        #[test]
        fn every_system_is_tested() {
            assert_eq!([$($index),*], std::array::from_fn::<usize, 11, _>(|i| i));
            assert_eq!(systems::all().len(), 11);
        }
    };
}

tests! {
    bulb_of_power_8_acos = 0;
    bulb_of_power_2_asin = 1;
    bulb_of_power_3_y = 2;
    mandelbox_of_scale_2 = 3;
    mandelbox_of_negative_scale = 4;
    menger_sponge = 5;
    sierpinski_tetrahedron = 6;
    turned_icosahedron = 7;
    quaternion_julia_set = 8;
    mandelbox_and_bulb_by_turns = 9;
    quaternion_phoenix = 10;
}

/// The big numbers against values that are known by heart.
#[test]
fn big_numbers_have_their_digits() {
    let close = |a: Big, b: Big| assert!((a - b).abs() < Big::two_to(-370));
    close(Big::pi().sin(), Big::from(0.0));
    close(Big::from(2.0).sqrt().powi(2), Big::from(2.0));
    close(Big::from(1.0).exp().ln(), Big::from(1.0));
    close(Big::from(-0.5).asin().sin(), Big::from(-0.5));
    for angle in [-3.0, -2.0, -1.0, -0.1, 0.4, 1.3, 1.7, 2.9] {
        let angle = Big::from(angle);
        close((&angle.sin() * Big::from(3.0)).atan2(&(angle.cos() * Big::from(3.0))), angle);
    }
    for x in [1.0, -0.1, 1e300, 3.3e-200, 0.75] {
        assert_eq!(Big::from(x).to_f64(), x);
    }
    assert_eq!(Big::two_to(-120).to_f64(), 2f64.powi(-120));
}
