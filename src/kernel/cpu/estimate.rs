//! Estimates: orbits iterated until every lane has escaped. The twin of `shaders/iterate.wgsl` and `estimate.wgsl`.

use super::interpret::{Machine, interpret, load_pack, store_pack};
use super::tapes::{EstimatorTapes, OrbitTapes, TapeSet};
use crate::expr::ops::Register;
use crate::kernel::records::Query;
use crate::kernel::tape::Tape;
use crate::math::{Pack, Real};

/// Columns of a point.
pub(super) const POINT: usize = Query::WIDTH;

/// Register files of one task.
pub(super) struct Files<R: Real, const K: usize> {
    pub(super) orbits: Vec<Vec<Register<R, K>>>,
    pub(super) combine: Vec<Register<R, K>>,
}

impl<R: Machine + Pack, const K: usize> Files<R, K> {
    pub(super) fn new(token: R::Token, tapes: &EstimatorTapes) -> Self {
        Files {
            orbits: tapes.orbits.iter().map(|o| o.set.register_file(token)).collect(),
            combine: tapes.combine.register_file(token),
        }
    }
}

#[inline(always)]
pub(super) fn run_map<R: Machine + Pack, const K: usize>(
    token: R::Token,
    set: &TapeSet,
    inputs: &[&[R::Scalar]],
    outputs: &mut [&mut [R::Scalar]],
) {
    let tape = &set.tapes[0];
    let mut registers = set.register_file::<R, K>(token);
    for at in (0..inputs[0].len()).step_by(R::LANES * K) {
        for (column, &register) in inputs.iter().zip(&tape.inputs) {
            registers[register as usize] = load_pack(token, column, at);
        }
        interpret::<R, K>(token, tape, &mut registers);
        for (column, &register) in outputs.iter_mut().zip(&tape.outputs) {
            store_pack(&registers[register as usize], column, at);
        }
    }
}

#[inline(always)]
pub(super) fn run_estimates<R: Machine + Pack, const K: usize>(
    token: R::Token,
    tapes: &EstimatorTapes,
    inputs: &[&[R::Scalar]],
    outputs: &mut [&mut [R::Scalar]],
) {
    let mut files = Files::<R, K>::new(token, tapes);
    let zero = R::splat(token, 0.0);
    let mut live = [zero; K];
    for at in (0..inputs[0].len()).step_by(R::LANES * K) {
        let mut point = [live; POINT];
        for (value, column) in point.iter_mut().zip(inputs) {
            *value = load_pack(token, column, at);
        }
        for k in 0..K {
            live[k] = R::from_mask(token, zero.le(point[Query::COLUMNS.hit_eps][k]));
        }
        estimate::<R, K>(token, tapes, &mut files, &point, &live);
        for (column, &register) in outputs.iter_mut().zip(&tapes.combine.tapes[0].outputs) {
            store_pack(&files.combine[register as usize], column, at);
        }
    }
}

/// Estimates at a pack of points (columns of a [`Query`]); the results lie in the output registers of `combine`.
/// Lanes where `live` is 0 are not waited for. Returns the iterations of all orbits.
#[inline(always)]
pub(super) fn estimate<R: Machine + Pack, const K: usize>(
    token: R::Token,
    tapes: &EstimatorTapes,
    files: &mut Files<R, K>,
    point: &[Register<R, K>; POINT],
    live: &Register<R, K>,
) -> Register<R, K> {
    let combine = &tapes.combine.tapes[0];
    let mut next = POINT;
    for &i in combine.read.iter().take_while(|&&i| usize::from(i) < POINT) {
        files.combine[combine.inputs[usize::from(i)] as usize] = point[usize::from(i)];
    }
    let mut total = [R::splat(token, 0.0); K];
    for (orbit, registers) in tapes.orbits.iter().zip(&mut files.orbits) {
        let (inside, n) = iterate::<R, K>(token, orbit, registers, point, live);
        let finish = &orbit.set.tapes[1];
        registers[orbit.state + orbit.frozen] = n;
        interpret::<R, K>(token, finish, registers);
        for &output in &finish.outputs {
            files.combine[combine.inputs[next] as usize] = registers[output as usize];
            next += 1;
        }
        files.combine[combine.inputs[next] as usize] = inside;
        files.combine[combine.inputs[next + 1] as usize] = n;
        next += 2;
        for k in 0..K {
            total[k] = total[k] + n[k];
        }
    }
    interpret::<R, K>(token, combine, &mut files.combine);
    total
}

/// Iterates an orbit until every live lane has escaped or `max_iterations` are done. Leaves the end state in the state
/// registers; returns 1 where a lane has not escaped, and the iterations done.
#[inline(always)]
pub(super) fn iterate<R: Machine + Pack, const K: usize>(
    token: R::Token,
    orbit: &OrbitTapes,
    registers: &mut [Register<R, K>],
    point: &[Register<R, K>; POINT],
    live: &Register<R, K>,
) -> (Register<R, K>, Register<R, K>) {
    let init = &orbit.set.tapes[0];
    for &i in &init.read {
        registers[init.inputs[usize::from(i)] as usize] = point[usize::from(i)];
    }
    interpret::<R, K>(token, init, registers);
    for (i, &output) in init.outputs.iter().enumerate() {
        registers[i] = registers[output as usize];
    }
    let mut active = *live;
    let mut n = [R::splat(token, 0.0); K];
    for iteration in 0..orbit.max_iterations as usize {
        registers[orbit.state + orbit.frozen] = [R::splat(token, iteration as f64); K];
        let item = &orbit.set.tapes[orbit.items + orbit.schedule.item(iteration)];
        interpret::<R, K>(token, item, registers);
        if !keep_active::<R, K>(token, item, registers, orbit.state, &mut active, &mut n) {
            break;
        }
    }
    (active, n)
}

/// Takes over the new state where a lane is active, counts its iteration, and ends the lanes that escaped.
/// Returns whether any lane is still active.
#[inline(always)]
pub(super) fn keep_active<R: Machine + Pack, const K: usize>(
    token: R::Token,
    item: &Tape,
    registers: &mut [Register<R, K>],
    state: usize,
    active: &mut Register<R, K>,
    n: &mut Register<R, K>,
) -> bool {
    let (zero, one) = (R::splat(token, 0.0), R::splat(token, 1.0));
    let mut masks = [zero.lt(one); K];
    let mut all = true;
    for k in 0..K {
        masks[k] = active[k].to_mask();
        all &= !R::mask_any(R::mask_not(masks[k]));
    }
    for i in 0..state {
        let mut new = registers[item.outputs[i] as usize];
        if !all {
            let old = registers[i];
            for k in 0..K {
                new[k] = R::select(masks[k], new[k], old[k]);
            }
        }
        registers[i] = new;
    }
    let escaped = registers[item.outputs[state] as usize];
    let mut any = false;
    for k in 0..K {
        n[k] = n[k] + active[k];
        active[k] = R::select(escaped[k].to_mask(), zero, active[k]);
        any |= R::mask_any(active[k].to_mask());
    }
    any
}
