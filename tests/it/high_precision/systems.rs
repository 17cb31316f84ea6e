//! Eleven systems, written from their definitions: maps of the point with the stretch that the scalar rule gives them.

use super::big::{Big, V, cross, dot, length, scaled, sum, vector};

/// One system: how the program is told of it, and how it is computed here.
pub struct System {
    pub name: &'static str,
    /// The graph file.
    pub text: String,
    /// The map of iteration n (without its constant), and the factor of the scalar rule.
    pub map: fn(&V, u32) -> (V, Big),
    /// What is added after each iteration.
    pub constant: Constant,
    /// How much of z of the iteration before is added.
    pub memory: f64,
    pub escape_radius: f64,
    pub max_iterations: u32,
    pub form: Form,
    /// Half the side of the cube that points are taken from.
    pub reach: f64,
}

pub enum Constant {
    Point,
    Fixed([f64; 3]),
    None,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Form {
    /// The radius of the ball that the distance is taken to.
    Linear(f64),
    /// The power by which r grows in an iteration, where all have the same.
    Logarithmic(Option<f64>),
}

#[derive(Clone, Copy)]
enum Convention {
    Acos,
    Asin,
    Y,
}

/// Length to the n-th power, both angles n-fold (White and Nylander; y after Quilez).
fn bulb(z: &V, n: usize, convention: Convention) -> (V, Big) {
    let r = length(z);
    let many = Big::from(n as f64);
    let (theta, phi) = match convention {
        Convention::Acos => ((&z[2] / &r).acos(), z[1].atan2(&z[0])),
        Convention::Asin => ((&z[2] / &r).asin(), z[1].atan2(&z[0])),
        Convention::Y => ((&z[1] / &r).acos(), z[0].atan2(&z[2])),
    };
    let (theta, phi) = (theta * &many, phi * &many);
    let (st, ct, sp, cp) = (theta.sin(), theta.cos(), phi.sin(), phi.cos());
    let direction = match convention {
        Convention::Acos => [&st * cp, &st * sp, ct],
        Convention::Asin => [&ct * cp, &ct * sp, st],
        Convention::Y => [&st * sp, ct, &st * cp],
    };
    (scaled(&direction, &r.powi(n)), many * r.powi(n - 1))
}

/// Box fold with limit 1, sphere fold with radii 1/2 and 1, scale (Lowe).
fn boxed(z: &V, scale: f64) -> (V, Big) {
    let (one, two) = (Big::from(1.0), Big::from(2.0));
    let folded = z.clone().map(|x| match () {
        _ if x > one => &two - x,
        _ if x < Big::from(-1.0) => Big::from(-2.0) - x,
        _ => x,
    });
    let r_sq = dot(&folded, &folded);
    let factor = match () {
        _ if r_sq < Big::from(0.25) => Big::from(4.0),
        _ if r_sq < one => one / r_sq,
        _ => one,
    };
    (scaled(&folded, &(&factor * Big::from(scale))), factor * Big::from(scale.abs()))
}

fn menger(z: &V) -> (V, Big) {
    let mut parts = z.clone().map(|x| x.abs());
    parts.sort_by(|a, b| b.partial_cmp(a).expect("no NaN"));
    let third = Big::from(1.0) / Big::from(3.0);
    parts[2] = (&parts[2] - &third).abs() + third;
    (parts.map(|x| x * Big::from(3.0) - Big::from(2.0)), Big::from(3.0))
}

fn tetrahedron(z: &V) -> (V, Big) {
    let [mut x, mut y, mut z] = z.clone();
    let zero = Big::from(0.0);
    if &x + &y < zero {
        (x, y) = (-y, -x);
    }
    if &x + &z < zero {
        (x, z) = (-z, -x);
    }
    if &y + &z < zero {
        (y, z) = (-z, -y);
    }
    ([x, y, z].map(|x| x * Big::from(2.0) - Big::from(1.0)), Big::from(2.0))
}

/// A corner of the icosahedron, as the graph file gives it.
const CORNER: [f64; 3] = [0.850_650_808_352_04, 0.525_731_112_119_133_6, 0.0];

/// The 15 mirrors of the icosahedron, each turned towards the wedge with the corners (1, 0, 0), (phi, 1, 0) and
/// (phi, 0, 1/phi).
fn icosahedral_mirrors() -> Vec<V> {
    let one = Big::from(1.0);
    let phi = (Big::from(5.0).sqrt() + &one) / Big::from(2.0);
    let zero = || Big::from(0.0);
    let short = &one / &phi;
    let corners =
        [[one.clone(), zero(), zero()], [phi.clone(), one.clone(), zero()], [phi.clone(), zero(), short.clone()]];
    let unit = |v: &V| scaled(v, &(Big::from(1.0) / length(v)));
    let interior = corners.iter().map(unit).reduce(|a, b| sum(&a, &b)).expect("three corners");
    let mut normals = vec![[one.clone(), zero(), zero()], [zero(), one.clone(), zero()], [zero(), zero(), one.clone()]];
    for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        let v = [one.clone(), &phi * Big::from(a), &short * Big::from(b)];
        for turn in 0..3 {
            normals.push([0, 1, 2].map(|i| v[(i + turn) % 3].clone()));
        }
    }
    let oriented = |n: V| if dot(&n, &interior) > zero() { unit(&n) } else { unit(&scaled(&n, &Big::from(-1.0))) };
    normals.into_iter().map(oriented).collect()
}

thread_local! {
    static MIRRORS: Vec<V> = icosahedral_mirrors();
    /// Unit axis, sine and cosine of the turn by 5 degrees about (0.3, 0.2, 1).
    static TURN: (V, Big, Big) = {
        let axis = vector([0.3, 0.2, 1.0]);
        let angle = Big::pi() * Big::from(5.0) / Big::from(180.0);
        (scaled(&axis, &(Big::from(1.0) / length(&axis))), angle.sin(), angle.cos())
    };
}

/// Mirrored until no mirror has the point behind it, turned (Rodrigues), scaled by 2.3 about the corner.
fn icosahedron(z: &V) -> (V, Big) {
    let mut z = z.clone();
    MIRRORS.with(|mirrors| {
        while let Some(n) = mirrors.iter().find(|n| dot(n, &z) < Big::two_to(-300) * Big::from(-1.0)) {
            z = sum(&z, &scaled(n, &(dot(n, &z) * Big::from(-2.0))));
        }
    });
    let turned = TURN.with(|(axis, s, c)| {
        let along = dot(axis, &z) * (Big::from(1.0) - c);
        sum(&sum(&scaled(&z, c), &scaled(&cross(axis, &z), s)), &scaled(axis, &along))
    });
    let scale = Big::from(2.3);
    let centre = scaled(&vector(CORNER), &(Big::from(1.0) - &scale));
    (sum(&scaled(&turned, &scale), &centre), scale)
}

fn quaternion_square(z: &V) -> (V, Big) {
    let [x, y, z] = z;
    let two = Big::from(2.0);
    let image = [x * x - y * y - z * z, &two * x * y, &two * x * z];
    (image, two * (x * x + y * y + z * z).sqrt())
}

const BOX: &str = r#""fold": box_fold(limit: 1), "ball": sphere_fold(min_radius: 0.5, fixed_radius: 1)"#;

fn bulb_system(name: &'static str, convention: &str, n: u32, map: fn(&V, u32) -> (V, Big)) -> System {
    let (escape_radius, max_iterations) = (if n == 2 { 40.0 } else { 10.0 }, if n == 8 { 5 } else { 9 });
    System {
        name,
        text: format!(
            r#"(nodes: {{ "bulb": bulb_power(power: {n}, convention: {convention}) }}, escape_radius: {escape_radius},
                max_iterations: {max_iterations}, bounding_radius: 2, estimate: (form: logarithmic))"#
        ),
        map,
        constant: Constant::Point,
        memory: 0.0,
        escape_radius,
        max_iterations,
        form: Form::Logarithmic(Some(f64::from(n))),
        reach: 1.3,
    }
}

fn box_system(name: &'static str, scale: f64, radius: f64, reach: f64, map: fn(&V, u32) -> (V, Big)) -> System {
    let max_iterations = 12;
    System {
        name,
        text: format!(
            r#"(nodes: {{ {BOX}, "grow": scale(scale: {scale:?}), "box": Sequence(["fold", "ball", "grow"]) }},
                output: "box", escape_radius: 60, max_iterations: {max_iterations}, bounding_radius: 12,
                estimate: (form: linear, radius: {radius}))"#
        ),
        map,
        constant: Constant::Point,
        memory: 0.0,
        escape_radius: 60.0,
        max_iterations,
        form: Form::Linear(radius),
        reach,
    }
}

fn similarity(
    name: &'static str,
    nodes: &str,
    parts: &str,
    radius: f64,
    max_iterations: u32,
    map: fn(&V, u32) -> (V, Big),
) -> System {
    System {
        name,
        text: format!(
            r#"(nodes: {{ {nodes}, "all": Sequence([{parts}]) }}, output: "all", constant: Off, escape_radius: 8,
                max_iterations: {max_iterations}, bounding_radius: 2, estimate: (form: linear, radius: {radius}))"#
        ),
        map,
        constant: Constant::None,
        memory: 0.0,
        escape_radius: 8.0,
        max_iterations,
        form: Form::Linear(radius),
        reach: 1.2,
    }
}

/// All of them.
pub fn all() -> Vec<System> {
    vec![
        bulb_system("bulb of power 8, acos", "acos", 8, |z, _| bulb(z, 8, Convention::Acos)),
        bulb_system("bulb of power 2, asin", "asin", 2, |z, _| bulb(z, 2, Convention::Asin)),
        bulb_system("bulb of power 3, y axis", "y", 3, |z, _| bulb(z, 3, Convention::Y)),
        box_system("Mandelbox of scale 2", 2.0, 10.392_304_845, 6.5, |z, _| boxed(z, 2.0)),
        box_system("Mandelbox of scale -1.5", -1.5, 3.464_101_615, 3.0, |z, _| boxed(z, -1.5)),
        similarity(
            "Menger sponge",
            r#""fold": menger_fold(), "grow": scale(scale: 3, centre: (1, 1, 1))"#,
            r#""fold", "grow""#,
            1.732_050_808,
            7,
            |z, _| menger(z),
        ),
        similarity(
            "Sierpinski tetrahedron",
            r#""fold": tetra_fold(), "grow": scale(scale: 2, centre: (1, 1, 1))"#,
            r#""fold", "grow""#,
            1.732_050_808,
            9,
            |z, _| tetrahedron(z),
        ),
        similarity(
            "turned icosahedron",
            r#""fold": icosa_fold(), "turn": rotate(axis: (0.3, 0.2, 1.0), angle: 5),
                "grow": scale(scale: 2.3, centre: (0.8506508083520400, 0.5257311121191336, 0.0))"#,
            r#""fold", "turn", "grow""#,
            1.0,
            9,
            |z, _| icosahedron(z),
        ),
        System {
            name: "quaternion Julia set",
            text: r#"(nodes: { "square": quaternion_square() }, constant: Julia((-0.125, 0.0, 0.885)),
                escape_radius: 40, max_iterations: 12, bounding_radius: 2, estimate: (form: logarithmic))"#
                .to_string(),
            map: |z, _| quaternion_square(z),
            constant: Constant::Fixed([-0.125, 0.0, 0.885]),
            memory: 0.0,
            escape_radius: 40.0,
            max_iterations: 12,
            form: Form::Logarithmic(Some(2.0)),
            reach: 1.3,
        },
        System {
            name: "Mandelbox and bulb, alternating",
            text: format!(
                r#"(nodes: {{ {BOX}, "grow": scale(scale: -1.5), "box": Sequence(["fold", "ball", "grow"]),
                    "bulb": bulb_power(power: 8), "turns": Alternate(["box", "bulb"]) }}, output: "turns",
                    escape_radius: 100, max_iterations: 4, bounding_radius: 3.5, estimate: (form: logarithmic))"#
            ),
            map: |z, n| if n % 2 == 0 { boxed(z, -1.5) } else { bulb(z, 8, Convention::Acos) },
            constant: Constant::Point,
            memory: 0.0,
            escape_radius: 100.0,
            max_iterations: 4,
            form: Form::Logarithmic(None),
            reach: 2.0,
        },
        System {
            name: "quaternion Phoenix",
            text: r#"(nodes: { "phoenix": phoenix(share: -0.5) }, constant: Julia((0.1, 0.25, 0.5)),
                escape_radius: 40, max_iterations: 12, bounding_radius: 2, estimate: (form: logarithmic))"#
                .to_string(),
            map: |z, _| quaternion_square(z),
            constant: Constant::Fixed([0.1, 0.25, 0.5]),
            memory: -0.5,
            escape_radius: 40.0,
            max_iterations: 12,
            form: Form::Logarithmic(Some(2.0)),
            reach: 1.3,
        },
    ]
}
