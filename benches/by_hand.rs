//! Estimates by the compiled kernels against the same formulas written by hand, on one thread in f32.
//!
//! Both iterate the same points (a square of a grid across the fractal, which fits the caches) with the same scalar derivative; the
//! hand-written forms run over the same vectors, one or two or four of them in step, and the fastest counts. The processor's
//! peak is measured beside them: independent chains of multiply-adds. A share of it is operations of the formula's
//! graph (each sum, product, comparison, quotient, root or choice of a component is one, a multiply-add two) for all
//! points and iterations, against two a multiply-add. Times are the least of several alternating runs.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use bulbfold::compose::{Composer, Purpose, choose, compose_estimator};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::{Arena, Function, Port};
use bulbfold::formula::library::Library;
use bulbfold::graph::{EstimateSettings, Method};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::tape::{Code, Products, lower_group};
use bulbfold::kernel::{Backend, Estimator, Kernel};
use bulbfold::load::load;
use bulbfold::math::Lanes;
use bulbfold::math::Precision;
use bulbfold::math::real::{Pack, Real};
use fearless_simd::{Level, Simd, dispatch};

/// Points along each edge of the square.
const EDGE: usize = 128;
const ROUNDS: usize = 60;

/// A point and the scalar derivative there.
#[derive(Clone, Copy)]
struct State<R> {
    z: [R; 3],
    dr: R,
}

/// A formula by hand.
trait ByHand {
    const NAME: &'static str;
    const ITERATIONS: usize;
    const ESCAPE_RADIUS: f64;
    /// Half extent of the points.
    const EXTENT: f64;
    fn iterate<R: Real>(token: R::Token, iteration: usize, state: State<R>, c: [R; 3]) -> State<R>;
    #[inline(always)]
    fn estimate<R: Real>(token: R::Token, r: R, dr: R) -> R {
        r * r.ln() * R::splat(token, 0.5) / dr
    }
}

struct Bulb;
struct Mandelbox;
struct BoxBulb;

#[inline(always)]
fn dot<R: Real>(z: [R; 3]) -> R {
    z[2].mul_add(z[2], z[1].mul_add(z[1], z[0] * z[0]))
}

/// The square of a complex number.
#[inline(always)]
fn square<R: Real>([re, im]: [R; 2]) -> [R; 2] {
    [re.mul_add(re, -(im * im)), (re + re) * im]
}

#[inline(always)]
fn bulb<R: Real>(token: R::Token, State { z, dr }: State<R>, c: [R; 3]) -> State<R> {
    let one = R::splat(token, 1.0);
    let rho_sq = z[1].mul_add(z[1], z[0] * z[0]);
    let off_axis = R::splat(token, 1e-30).lt(rho_sq);
    let per_rho = one / R::select(off_axis, rho_sq, one).sqrt();
    let x = R::select(off_axis, z[0], one);
    let tilt = square(square(square([z[2], rho_sq * per_rho])));
    let turn = square(square(square([x * per_rho, z[1] * per_rho])));
    let r_sq = z[2].mul_add(z[2], rho_sq);
    let r_7 = r_sq * r_sq * r_sq * r_sq.sqrt();
    let dr = (R::splat(token, 8.0) * dr).mul_add(r_7, one);
    State { z: [tilt[1].mul_add(turn[0], c[0]), tilt[1].mul_add(turn[1], c[1]), tilt[0] + c[2]], dr }
}

#[inline(always)]
fn mandelbox<R: Real>(token: R::Token, scale: f64, State { mut z, dr }: State<R>, c: [R; 3]) -> State<R> {
    let one = R::splat(token, 1.0);
    let two = R::splat(token, 2.0);
    for x in &mut z {
        *x = two.mul_add(x.max(-one).min(one), -*x);
    }
    let factor = one / dot(z).max(R::splat(token, 0.25)).min(one);
    let (growth, stretch) = (factor * R::splat(token, scale), factor * R::splat(token, scale.abs()));
    for i in 0..3 {
        z[i] = z[i].mul_add(growth, c[i]);
    }
    State { z, dr: dr.mul_add(stretch, one) }
}

impl ByHand for Bulb {
    const NAME: &'static str = "mandelbulb";
    const ITERATIONS: usize = 6;
    const ESCAPE_RADIUS: f64 = 10.0;
    const EXTENT: f64 = 1.2;
    #[inline(always)]
    fn iterate<R: Real>(token: R::Token, _: usize, state: State<R>, c: [R; 3]) -> State<R> {
        bulb(token, state, c)
    }
}

impl ByHand for Mandelbox {
    const NAME: &'static str = "mandelbox";
    const ITERATIONS: usize = 10;
    const ESCAPE_RADIUS: f64 = 60.0;
    const EXTENT: f64 = 7.0;
    #[inline(always)]
    fn iterate<R: Real>(token: R::Token, _: usize, state: State<R>, c: [R; 3]) -> State<R> {
        mandelbox(token, 2.0, state, c)
    }
    #[inline(always)]
    fn estimate<R: Real>(token: R::Token, r: R, dr: R) -> R {
        (r - R::splat(token, 10.3923054)) / dr
    }
}

impl ByHand for BoxBulb {
    const NAME: &'static str = "box_bulb";
    const ITERATIONS: usize = 4;
    const ESCAPE_RADIUS: f64 = 100.0;
    const EXTENT: f64 = 2.5;
    #[inline(always)]
    fn iterate<R: Real>(token: R::Token, iteration: usize, state: State<R>, c: [R; 3]) -> State<R> {
        match iteration % 2 {
            0 => mandelbox(token, -1.5, state, c),
            _ => bulb(token, state, c),
        }
    }
}

/// Estimates of `K` vectors in step.
#[inline(always)]
fn estimate_pack<F: ByHand, R: Pack, const K: usize>(token: R::Token, c: [[R; 3]; K]) -> [R; K] {
    let zero = R::splat(token, 0.0);
    let escape = R::splat(token, F::ESCAPE_RADIUS * F::ESCAPE_RADIUS);
    let mut states = [State { z: c[0], dr: R::splat(token, 1.0) }; K];
    let mut active = [zero.le(zero); K];
    for k in 0..K {
        states[k].z = c[k];
    }
    for iteration in 0..F::ITERATIONS {
        let mut any = false;
        for k in 0..K {
            let new = F::iterate(token, iteration, states[k], c[k]);
            for i in 0..3 {
                states[k].z[i] = R::select(active[k], new.z[i], states[k].z[i]);
            }
            states[k].dr = R::select(active[k], new.dr, states[k].dr);
            active[k] = R::mask_and(active[k], dot(new.z).le(escape));
            any |= R::mask_any(active[k]);
        }
        if !any {
            break;
        }
    }
    let mut estimates = [zero; K];
    for k in 0..K {
        let de = F::estimate(token, dot(states[k].z).sqrt(), states[k].dr).max(zero);
        estimates[k] = R::select(active[k], zero, de);
    }
    estimates
}

#[inline(always)]
fn estimate_all<F: ByHand, S: Simd, const K: usize>(token: S, points: &[Vec<f32>], out: &mut [f32]) {
    let lanes = <Lanes<S> as Pack>::LANES;
    for at in (0..out.len()).step_by(lanes * K) {
        let mut c = [[Lanes::<S>::splat(token, 0.0); 3]; K];
        for (k, c) in c.iter_mut().enumerate() {
            for i in 0..3 {
                c[i] = Lanes::load(token, &points[i][at + k * lanes..]);
            }
        }
        let estimates = estimate_pack::<F, Lanes<S>, K>(token, c);
        for k in 0..K {
            estimates[k].store(&mut out[at + k * lanes..]);
        }
    }
}

/// Iterations that a point takes, one at a time.
fn iterations<F: ByHand>(c: [f64; 3]) -> usize {
    let mut state = State { z: c, dr: 1.0 };
    for iteration in 0..F::ITERATIONS {
        state = F::iterate((), iteration, state, c);
        if dot(state.z) > F::ESCAPE_RADIUS * F::ESCAPE_RADIUS {
            return iteration + 1;
        }
    }
    F::ITERATIONS
}

/// Operations of a function's graph.
fn operations(arena: &Arena, function: &Function) -> usize {
    let (tapes, _) = lower_group(arena, &[(function, 0)], Port::scalars(&function.inputs) as u16);
    let count = |code: Code, width: usize| match code {
        Code::Copy => 0,
        Code::Apply(_) | Code::SinCos | Code::Lookup(_) => width,
        Code::Dot => 2 * width - 1,
        Code::ComplexProduct => 6 * width,
        Code::Products(Products::Sum | Products::Difference) => 3 * width,
        Code::Products(_) => 2 * width,
    };
    tapes.iter().flat_map(|tape| &tape.instructions).map(|i| count(i.code, usize::from(i.operands.width.max(1)))).sum()
}

/// A square of a grid across the fractal, row by row.
fn points(extent: f64) -> Vec<[f64; 3]> {
    let along = |i: usize| extent * (2.0 * (i as f64 + 0.5) / EDGE as f64 - 1.0);
    (0..EDGE * EDGE).map(|i| [along(i % EDGE), along(i / EDGE), 0.1]).collect()
}

/// Seconds that a call takes.
#[inline(always)]
fn seconds(f: impl FnOnce()) -> f64 {
    let start = Instant::now();
    f();
    start.elapsed().as_secs_f64()
}

/// Multiply-adds per second, all lanes counted.
#[inline(always)]
fn peak<S: Simd>(token: S) -> f64 {
    const CHAINS: usize = 12;
    const LENGTH: usize = 200_000;
    let (a, b) = (Lanes::splat(token, black_box(0.999)), Lanes::splat(token, black_box(0.001)));
    let mut chains = [a; CHAINS];
    for (number, chain) in chains.iter_mut().enumerate() {
        *chain = Lanes::splat(token, black_box(number as f64));
    }
    let time = seconds(
        #[inline(always)]
        || {
            for _ in 0..LENGTH {
                for chain in &mut chains {
                    *chain = chain.mul_add(a, b);
                }
            }
        },
    );
    let mut end = [0.0; 64];
    let mut sum = a;
    for chain in chains {
        sum = sum + chain;
    }
    sum.store(&mut end);
    black_box(end);
    (CHAINS * LENGTH * <Lanes<S> as Pack>::LANES) as f64 / time
}

/// The compiled estimator of a built-in fractal with its scalar derivative, and the operations of its estimates.
fn composed(name: &str) -> (Arc<Arena>, Estimator) {
    let mut library = Library::builtin();
    let loaded = load(&mut library, name, &[], &mut Diagnostics::default()).expect("built-in fractals load");
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &library, graph: &loaded.graph };
    let settings = EstimateSettings { method: Some(Method::Scalar), ..EstimateSettings::default() };
    let plan = choose(&composer, &settings).expect("built-in fractals compose");
    let estimator = compose_estimator(&composer, &plan.choices, Purpose::March).expect("built-in fractals compose");
    (arena, estimator)
}

fn compare<F: ByHand>(level: Level) {
    let (arena, estimator) = composed(F::NAME);
    let points = points(F::EXTENT);
    let columns = Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &[1e-4], 0.0);
    let cpu = Cpu::new(Precision::F32);
    let kernel = cpu.prepare(&arena, &Kernel::Estimate(estimator.clone())).expect("kernels compile");
    let upload = cpu.upload(&columns).expect("columns fit");
    let narrow: Vec<Vec<f32>> = columns[..3].iter().map(|c| c.iter().map(|&x| x as f32).collect()).collect();
    let mut out = vec![0.0; points.len()];
    let mut compiled = Vec::new();
    let (mut best, mut by_hand, mut top) = (f64::MAX, [f64::MAX; 3], 0f64);
    for _ in 0..ROUNDS {
        best = best.min(seconds(|| compiled = vec![cpu.run(&kernel, &[&upload]).expect("kernels run")]));
        dispatch!(level, simd => {
            by_hand[0] = by_hand[0].min(seconds(#[inline(always)] || estimate_all::<F, _, 1>(simd, &narrow, &mut out)));
            by_hand[1] = by_hand[1].min(seconds(#[inline(always)] || estimate_all::<F, _, 2>(simd, &narrow, &mut out)));
            by_hand[2] = by_hand[2].min(seconds(#[inline(always)] || estimate_all::<F, _, 4>(simd, &narrow, &mut out)));
            top = top.max(peak(simd));
        });
    }
    let estimates = &cpu.download(&compiled[0]).expect("the CPU holds every column")[0];
    let near = |(a, b): (&f64, &f32)| (a - f64::from(*b)).abs() <= 1e-2 * (a.abs() + f64::from(b.abs())) + 1e-5;
    let agree = estimates.iter().zip(&out).filter(|&pair| near(pair)).count() as f64 / points.len() as f64;

    let orbit = &estimator.orbits[0];
    let items: Vec<usize> = orbit.items.iter().map(|item| operations(&arena, item)).collect();
    let around = operations(&arena, &orbit.finish) + operations(&arena, &estimator.combine);
    let of_iteration: Vec<usize> = (0..F::ITERATIONS).map(|i| items[orbit.schedule.item(i)]).collect();
    let of_point = |p: &[f64; 3]| around + of_iteration[..iterations::<F>(*p)].iter().sum::<usize>();
    let total: usize = points.iter().map(of_point).sum();
    let (count, hand) = (points.len() as f64, by_hand.into_iter().fold(f64::MAX, f64::min));
    println!(
        "{:<11} compiled {:6.1} M estimates/s, by hand {:6.1} (1, 2, 4 vectors: {}), ratio {:3.0} %; \
         {:5.1} of {:5.1} GFLOP/s, {:2.0} % of peak; {:.2} % of the values agree",
        F::NAME,
        count / best / 1e6,
        count / hand / 1e6,
        by_hand.map(|time| format!("{:.1}", count / time / 1e6)).join(", "),
        100.0 * hand / best,
        total as f64 / best / 1e9,
        2.0 * top / 1e9,
        100.0 * total as f64 / best / (2.0 * top),
        100.0 * agree
    );
}

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is made once, here");
    let level = Level::new();
    println!("{}, one thread", Cpu::new(Precision::F32).description());
    // On the pool's own thread, so that kernels start without waking it.
    rayon::scope(|_| {
        compare::<Bulb>(level);
        compare::<Mandelbox>(level);
        compare::<BoxBulb>(level);
    });
}
