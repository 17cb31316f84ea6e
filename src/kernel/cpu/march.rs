//! Marches: packs of rays, one estimate at a time. The twin of `shaders/march.wgsl`.

use super::estimate::{Files, POINT, estimate};
use super::interpret::{Machine, interpret, load_pack, store_pack};
use super::tapes::MarchTapes;
use crate::expr::ops::Register;
use crate::kernel::Status;
use crate::kernel::records::{MarchState, Marched, Ray, UNKNOWN};
use crate::math::Pack;

/// Rays being marched: their columns, compacted as rays finish.
pub(super) struct Rays<T> {
    columns: Vec<Vec<T>>,
    ids: Vec<u32>,
}

/// Columns of [`Rays`]: ray, state, then counters.
pub(super) const RAY: usize = Ray::WIDTH;
/// The columns of near and far ends.
pub(super) const ENDS: [usize; 2] = [Ray::COLUMNS.t_near, Ray::COLUMNS.t_far];
pub(super) const STATE: usize = MarchState::WIDTH;
pub(super) const STATUS: usize = RAY + Marched::COLUMNS.status;
pub(super) const STEPS: usize = RAY + Marched::COLUMNS.steps;
pub(super) const COLUMNS: usize = RAY + Marched::WIDTH;

#[inline(always)]
pub(super) fn run_march<R: Machine + Pack, const K: usize>(
    token: R::Token,
    tapes: &MarchTapes,
    inputs: &[&[R::Scalar]],
    outputs: &mut [&mut [R::Scalar]],
) where
    R::Scalar: Default,
{
    let pack = R::LANES * K;
    let len = inputs[0].len();
    let mut rays = Rays::start(inputs, R::scalar);
    rays.retire(outputs, false);
    let mut files = Files::<R, K>::new(token, &tapes.estimator);
    let mut locate = tapes.locate.register_file::<R, K>(token);
    let mut advance = tapes.advance.register_file::<R, K>(token);
    for step in 0..tapes.max_march_steps {
        let mut finished = 0;
        for at in (0..rays.ids.len()).step_by(pack) {
            finished += march_pack::<R, K>(token, tapes, &mut files, &mut locate, &mut advance, &mut rays, at);
        }
        // Moving rays together costs about as much as an estimate of those moved: wait until a quarter is done.
        let last = step + 1 == tapes.max_march_steps;
        if last || finished * 4 >= rays.ids.len() {
            rays.retire(outputs, last);
        }
        if rays.ids.is_empty() {
            break;
        }
    }
    debug_assert!(outputs.iter().all(|c| c.len() == len));
}

/// Estimates once for a pack of rays and advances them. Returns how many of its rays are done.
#[inline(always)]
pub(super) fn march_pack<R: Machine + Pack, const K: usize>(
    token: R::Token,
    tapes: &MarchTapes,
    files: &mut Files<R, K>,
    locate: &mut [Register<R, K>],
    advance: &mut [Register<R, K>],
    rays: &mut Rays<R::Scalar>,
    at: usize,
) -> usize {
    let (locate_tape, advance_tape) = (&tapes.locate.tapes[0], &tapes.advance.tapes[0]);
    for i in 0..RAY + STATE {
        let value = load_pack(token, &rays.columns[i], at);
        locate[locate_tape.inputs[i] as usize] = value;
        advance[advance_tape.inputs[i] as usize] = value;
    }
    interpret::<R, K>(token, locate_tape, locate);
    let mut point = [[R::splat(token, 0.0); K]; POINT];
    for (value, &output) in point.iter_mut().zip(&locate_tape.outputs) {
        *value = locate[output as usize];
    }
    let status = locate[locate_tape.inputs[STATUS] as usize];
    let mut running = [R::splat(token, 0.0); K];
    for k in 0..K {
        running[k] = R::from_mask(token, status[k].eq(R::splat(token, Status::RUNNING)));
    }
    let iterations = estimate::<R, K>(token, &tapes.estimator, files, &point, &running);
    let combine = &tapes.estimator.combine.tapes[0];
    for i in 0..2 {
        advance[advance_tape.inputs[RAY + STATE + i] as usize] = files.combine[combine.outputs[i] as usize];
    }
    let de = files.combine[combine.outputs[0] as usize];
    interpret::<R, K>(token, advance_tape, advance);
    for i in 0..STATE {
        let mut value = load_pack::<R, K>(token, &rays.columns[RAY + i], at);
        let new = &advance[advance_tape.outputs[i] as usize];
        for k in 0..K {
            value[k] = R::select(running[k].to_mask(), new[k], value[k]);
        }
        store_pack::<R, K>(&value, &mut rays.columns[RAY + i], at);
    }
    let mut counts = [running, iterations, [R::splat(token, 0.0); K]];
    for k in 0..K {
        counts[1][k] = iterations[k] * running[k];
        counts[2][k] = running[k] * R::from_mask(token, R::mask_not(de[k].eq(de[k])));
    }
    for (i, count) in counts.iter().enumerate() {
        let mut sum = load_pack::<R, K>(token, &rays.columns[STEPS + i], at);
        for k in 0..K {
            sum[k] = sum[k] + count[k];
        }
        store_pack::<R, K>(&sum, &mut rays.columns[STEPS + i], at);
    }
    let end = (at + R::LANES * K).min(rays.ids.len());
    (at..end).filter(|&i| !rays.is_running(i)).count()
}

/// Puts rays at their near end: the columns of a [`Marched`]. A ray whose range is empty has missed before it starts.
#[inline(always)]
pub(super) fn start<T: Copy + PartialOrd>([near, far]: [&[T]; 2], columns: &mut [&mut [T]], scalar: impl Fn(f64) -> T) {
    let [zero, unknown, running, miss] = [0.0, UNKNOWN, Status::RUNNING, Status::Miss.code()].map(scalar);
    let Marched { t, t_front, t_outside, t_inside, last_de, status, steps, iterations, nan } = Marched::COLUMNS;
    [t, t_front].into_iter().for_each(|column| columns[column].copy_from_slice(near));
    [t_outside, t_inside, last_de].into_iter().for_each(|column| columns[column].fill(unknown));
    for ((status, near), far) in columns[status].iter_mut().zip(near).zip(far) {
        *status = if near < far { running } else { miss };
    }
    [steps, iterations, nan].into_iter().for_each(|column| columns[column].fill(zero));
}

impl<T: Copy + PartialOrd + Into<f64>> Rays<T> {
    /// All rays at their near end.
    pub(super) fn start(inputs: &[&[T]], scalar: impl Fn(f64) -> T) -> Rays<T> {
        let len = inputs[0].len();
        let mut columns: Vec<Vec<T>> = inputs.iter().map(|column| column.to_vec()).collect();
        columns.resize_with(COLUMNS, || vec![scalar(0.0); len]);
        let mut state: Vec<&mut [T]> = columns[RAY..].iter_mut().map(Vec::as_mut_slice).collect();
        start(ENDS.map(|column| inputs[column]), &mut state, scalar);
        Rays { columns, ids: (0..len as u32).collect() }
    }

    pub(super) fn is_running(&self, i: usize) -> bool {
        self.columns[STATUS][i].into() == Status::RUNNING
    }

    /// Writes out the rays that are done (all of them at the end) and moves the others together.
    pub(super) fn retire(&mut self, outputs: &mut [&mut [T]], all: bool) {
        let is_done = |i: &u32| all || !self.is_running(*i as usize);
        let (done, kept): (Vec<u32>, Vec<u32>) = (0..self.ids.len() as u32).partition(is_done);
        // Column by column, so that each is a walk through memory.
        for (output, column) in outputs.iter_mut().zip(&self.columns[RAY..]) {
            done.iter().for_each(|&i| output[self.ids[i as usize] as usize] = column[i as usize]);
        }
        // Those before the first that is done stay where they are.
        let first = done.first().map_or(self.ids.len(), |&i| i as usize);
        for column in &mut self.columns {
            (first..kept.len()).for_each(|i| column[i] = column[kept[i] as usize]);
            column.truncate(kept.len());
        }
        (first..kept.len()).for_each(|i| self.ids[i] = self.ids[kept[i] as usize]);
        self.ids.truncate(kept.len());
    }
}
