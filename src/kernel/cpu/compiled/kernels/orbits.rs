//! Orbits: where their values live, how they start, iterate and end.
//!
//! With masks, lanes that are done keep their state: each iteration is taken over where lanes are active. Without them
//! *all lanes go on*: iterations read and write the state alone, in registers if it fits, and only when a lane escapes is its
//! state copied to where results lie. What lanes compute after that is never looked at.

use super::{Around, Builder, Numbers, Outputs, read_all, run_tape, store, store_all};
use crate::kernel::cpu::compiled::assemble::{Counter, Label};
use crate::kernel::cpu::compiled::segment::{Activity, Segment, Target};
use crate::kernel::cpu::compiled::trace::{Place, Recorder, Traced, TracedMask, Value};
use crate::kernel::cpu::tapes::OrbitTapes;
use crate::kernel::tape::Tape;
use crate::math::Real;

/// Most registers that a state may keep through its iterations when it needs them alone.
const MOST_SET_ASIDE: usize = 14;

/// Where an orbit's values live through its iterations.
pub(super) struct Places {
    state: Vec<Place>,
    /// Where the state of each lane ends up: where it is, unless all lanes go on.
    results: Vec<Place>,
    frozen: Vec<Place>,
    /// Iterations done, by lane.
    n: Place,
    /// The iteration's number, the same in all lanes.
    iteration: Place,
    /// First of the registers that are set aside from start to end.
    pub(super) limit: u8,
    /// First of the registers that hold the state between iterations.
    first: u8,
}

/// What orbits share.
pub(super) struct Start {
    /// The point to estimate at.
    pub(super) point: Vec<Place>,
    /// The numbers of its scalars that are read after the first orbit's start.
    pub(super) later: Vec<u16>,
    /// Lanes where an estimate is wanted.
    pub(super) live: Place,
}

impl Builder {
    /// True when lanes that are done are iterated further, for want of masks.
    fn all_go_on(&self) -> bool {
        !self.assembler.set.has_masks()
    }

    /// Decides where an orbit's values live: in registers, unless there are too many or a function takes them all.
    pub(super) fn place(&mut self, orbit: &OrbitTapes) -> Places {
        let (frozen, iteration) = (self.places(orbit.frozen), self.places(1)[0]);
        let mut results = self.places(orbit.state + 1);
        let n = results.pop().expect("one more than the state");
        let end = self.registers;
        let places = Places { state: results.clone(), results, frozen, n, iteration, limit: end, first: end };
        let mut items = orbit.set.tapes[orbit.items..].iter();
        let has_calls = items.any(|item| self.item(orbit, item, &places).has_calls());
        let needed = (orbit.state + usize::from(!self.all_go_on())) * self.copies;
        // Between iterations that go on there are the masks of lanes that escaped, too, and all of these masks in one.
        let most = if self.all_go_on() { usize::from(end) - self.copies - 1 } else { MOST_SET_ASIDE };
        let in_registers = !has_calls && needed <= most;
        let first = if in_registers { end - needed as u8 } else { end };
        let mut state: Vec<Place> = (first..end).step_by(self.copies).map(Place::Register).collect();
        match (self.all_go_on(), in_registers) {
            (true, true) => Places { state, first, ..places },
            (true, false) => Places { state: self.places(orbit.state), ..places },
            (false, true) => {
                let n = state.pop().expect("one more than the state");
                Places { results: state.clone(), state, n, limit: first, first, ..places }
            }
            (false, false) => places,
        }
    }

    /// The orbit's start values; before the first orbit also the kernel's own beginning.
    pub(super) fn begin(
        &mut self,
        orbit: &OrbitTapes,
        places: &Places,
        around: &impl Around,
        start: &Start,
        first: bool,
    ) {
        let recorder = self.recorder();
        let mut outputs = Vec::new();
        let (values, active) = match first {
            true => {
                let (values, active) = around.begin(&recorder);
                let stored = |&i: &u16| store(values[usize::from(i)], start.point[usize::from(i)]);
                outputs.extend(start.later.iter().map(stored));
                outputs.push(store(Traced::from_mask(&recorder, active), start.live));
                (values, active)
            }
            false => (read_all(&recorder, &start.point), recorder.read(start.live).to_mask()),
        };
        let started = run_tape(&recorder, &orbit.set, &orbit.set.tapes[0], &values);
        let (state, frozen) = started.split_at(orbit.state);
        outputs.extend(store_all(state, &places.state));
        if places.results != places.state {
            outputs.extend(store_all(state, &places.results));
        }
        outputs.extend(store_all(frozen, &places.frozen));
        let zero = Traced::splat(&recorder, 0.0);
        outputs.extend([store(zero, places.n), store(zero, places.iteration)]);
        let active = active.value;
        self.emit(recorder, outputs, Activity::Become(active), places.limit);
    }

    /// Iterates until no lane is active or `max_iterations` are done.
    pub(super) fn iterate(&mut self, orbit: &OrbitTapes, places: &Places) {
        if orbit.max_iterations == 0 {
            return;
        }
        let copies = self.copies as u8;
        let items = orbit.set.tapes[orbit.items..].iter();
        let items: Vec<Segment> = items.map(|item| self.item(orbit, item, places)).collect();
        let counts = items.iter().any(|item| item.reads(places.iteration));
        let [again, next, escaped, done] = [(); 4].map(|()| self.assembler.label());
        self.assembler.set_counter(Counter::Iterations, orbit.max_iterations);
        self.assembler.set_counter(Counter::Schedule, 0);
        if self.all_go_on() {
            self.assembler.jump_if_none_active(copies, done);
            self.assembler.place(again);
        } else {
            self.assembler.place(again);
            self.assembler.jump_if_none_active(copies, done);
        }
        let labels = self.dispatch(orbit, items.len());
        for (i, item) in items.iter().enumerate() {
            self.assembler.place(labels[i]);
            self.emit_copies(item, places.limit);
            if self.all_go_on() {
                self.assembler.jump_if_any(copies, escaped);
            }
            if i + 1 < items.len() {
                self.assembler.jump(next);
            }
        }
        self.assembler.place(next);
        if counts {
            let recorder = self.recorder();
            let iteration = recorder.read(places.iteration) + Traced::splat(&recorder, 1.0);
            let stored = vec![store(iteration, places.iteration)];
            self.emit(recorder, stored, Activity::Unchanged, places.first);
        }
        self.assembler.count_down(Counter::Iterations, again);
        if self.all_go_on() {
            self.keep_active(orbit, places);
            self.assembler.jump(done);
            self.assembler.place(escaped);
            self.keep_escaped(orbit, places);
            self.assembler.jump_if_none_active(copies, done);
            self.assembler.jump(next);
        }
        self.assembler.place(done);
    }

    /// Labels for the items of an iteration; with more than one, jumps to that of the schedule.
    fn dispatch(&mut self, orbit: &OrbitTapes, items: usize) -> Vec<Label> {
        let labels: Vec<_> = (0..items).map(|_| self.assembler.label()).collect();
        if items > 1 {
            let schedule = &orbit.schedule;
            let all = schedule.prefix.iter().chain(&schedule.cycle).map(|&item| item as u32);
            let table = self.assembler.table(all);
            let (prefix, cycle) = (schedule.prefix.len() as u32, schedule.cycle.len() as u32);
            self.assembler.dispatch(table, prefix, prefix + cycle, &labels);
        }
        labels
    }

    /// One iteration. With masks: the new state where lanes are active, and the end of those that escaped. Without: the new
    /// state of all lanes, and in the first registers the masks of those that escaped now.
    fn item(&self, orbit: &OrbitTapes, item: &Tape, places: &Places) -> Segment {
        let recorder = self.recorder();
        let mut inputs = read_all(&recorder, &places.state);
        inputs.extend(read_all(&recorder, &places.frozen));
        inputs.push(recorder.read(places.iteration));
        let results = run_tape(&recorder, &orbit.set, item, &inputs);
        let (state, escaped) = (&results[..orbit.state], results[orbit.state].to_mask());
        if self.all_go_on() {
            let escaped = Traced::mask_and(escaped, recorder.active());
            let mut outputs = store_all(state, &places.state);
            outputs.push((escaped.value, Target::Register(0)));
            return Segment { operations: recorder.finish(), outputs, activity: vec![Activity::Unchanged] };
        }
        let n = recorder.read(places.n) + Traced::splat(&recorder, 1.0);
        let new = state.iter().zip(&places.state).chain([(&n, &places.n)]);
        let outputs = new.map(|(value, &place)| store_active(&recorder, *value, place)).collect();
        let activity = vec![Activity::Lose(escaped.value)];
        Segment { operations: recorder.finish(), outputs, activity }
    }

    /// Keeps the state of lanes that escaped in this iteration, and ends them.
    fn keep_escaped(&mut self, orbit: &OrbitTapes, places: &Places) {
        let recorder = self.recorder();
        let n = Traced::splat(&recorder, f64::from(orbit.max_iterations) + 1.0) - recorder.left();
        let escaped = recorder.mask(Place::Register(0));
        let outputs = keep(&recorder, escaped, n, places);
        let activity = Activity::Lose(escaped.value);
        self.emit(recorder, outputs, activity, places.first);
    }

    /// Keeps the state of lanes that are active after the last iteration.
    fn keep_active(&mut self, orbit: &OrbitTapes, places: &Places) {
        let recorder = self.recorder();
        let n = Traced::splat(&recorder, f64::from(orbit.max_iterations));
        let outputs = keep(&recorder, recorder.active(), n, places);
        self.emit(recorder, outputs, Activity::Unchanged, places.first);
    }
}

/// State and number of iterations to where results lie, in the lanes of a mask.
fn keep<'a>(recorder: &'a Recorder, lanes: TracedMask<'a>, n: Traced<'a>, places: &Places) -> Outputs {
    let new = read_all(recorder, &places.state).into_iter().zip(&places.results).chain([(n, &places.n)]);
    new.map(|(new, &place)| store(Traced::select(lanes, new, recorder.read(place)), place)).collect()
}

/// A value and the target that overwrites a place where lanes are active; elsewhere it keeps its value.
fn store_active<'a>(recorder: &'a Recorder, value: Traced<'a>, place: Place) -> (Value, Target) {
    match place {
        Place::Register(register) => (value.value, Target::ActiveRegister(register)),
        // What is stored in parts cannot be read back before it has reached the cache.
        _ => store(Traced::select(recorder.active(), value, recorder.read(place)), place),
    }
}

/// What an orbit's end state says: the outputs of `finish`, then where it is inside, and its iterations.
pub(super) fn finish<'a>(recorder: &'a Recorder, orbit: &OrbitTapes, places: &Places) -> Numbers<'a> {
    let n = recorder.read(places.n);
    let mut inputs = read_all(recorder, &places.results);
    inputs.extend(read_all(recorder, &places.frozen));
    inputs.push(n);
    let mut values = run_tape(recorder, &orbit.set, &orbit.set.tapes[1], &inputs);
    values.push(Traced::from_mask(recorder, recorder.active()));
    values.push(n);
    values
}
