//! Orbits: where their values live, how they start, iterate and end.
//!
//! Lanes that are done keep their state: each iteration is taken over where lanes are active. With masks that is a masked move
//! into registers that are set aside. Without them it is a choice between the old and the new number, and the registers that
//! hold the state between iterations are there for all values within one.

use super::{Around, Builder, Numbers, Outputs, read_all, run_tape, store, store_all};
use crate::kernel::cpu::compiled::assemble::{Counter, Label};
use crate::kernel::cpu::compiled::segment::{Activity, Segment, Target};
use crate::kernel::cpu::compiled::trace::{Place, Recorder, Traced};
use crate::kernel::cpu::tapes::OrbitTapes;
use crate::kernel::tape::Tape;
use crate::math::Real;

/// Most registers that a state may keep through its iterations when it needs them alone.
const MOST_SET_ASIDE: usize = 14;
/// Registers that a state leaves free between iterations where it is chosen without masks.
const LEFT_FREE: usize = 3;

/// Where an orbit's values live through its iterations.
pub(super) struct Places {
    state: Vec<Place>,
    frozen: Vec<Place>,
    /// Iterations done, by lane.
    n: Place,
    /// Whether those are counted.
    counts: bool,
    /// The iteration's number, the same in all lanes.
    iteration: Place,
    /// Whether iterations read that.
    numbered: bool,
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
    /// Whether these are read after the first orbit's start.
    pub(super) keeps_live: bool,
}

impl Builder {
    /// Decides where an orbit's values live: in registers, unless there are too many or a function takes them all. `counts` is
    /// whether anything reads the iterations of each lane.
    pub(super) fn place(&mut self, orbit: &OrbitTapes, counts: bool) -> Places {
        let (frozen, iteration) = (self.places(orbit.frozen), self.places(1)[0]);
        let mut state = self.places(orbit.state + 1);
        let n = state.pop().expect("one more than the state");
        let (end, has_masks) = (self.registers, self.assembler.set.has_masks());
        let counts = counts || has_masks;
        let mut places = Places { state, frozen, n, counts, iteration, numbered: false, limit: end, first: end };
        let items = self.items(orbit, &places);
        places.numbered = items.iter().any(|item| item.reads(places.iteration));
        let needed = (orbit.state + usize::from(has_masks)) * self.copies;
        let most = if has_masks { MOST_SET_ASIDE } else { usize::from(end) - LEFT_FREE };
        if needed > most || items.iter().any(Segment::has_calls) {
            return places;
        }
        places.first = end - needed as u8;
        places.state = (places.first..end).step_by(self.copies).map(Place::Register).collect();
        if has_masks {
            places.n = places.state.pop().expect("one more than the state");
            places.limit = places.first;
        }
        places
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
                if start.keeps_live {
                    outputs.push(store(Traced::from_mask(&recorder, active), start.live));
                }
                (values, active)
            }
            false => (read_all(&recorder, &start.point), recorder.read(start.live).to_mask()),
        };
        let started = run_tape(&recorder, &orbit.set, &orbit.set.tapes[0], &values);
        let (state, frozen) = started.split_at(orbit.state);
        outputs.extend(store_all(state, &places.state));
        outputs.extend(store_all(frozen, &places.frozen));
        let zero = Traced::splat(&recorder, 0.0);
        outputs.push(store(zero, places.n));
        if places.numbered {
            outputs.push(store(zero, places.iteration));
        }
        let active = active.value;
        self.emit(recorder, outputs, Activity::Become(active), places.limit);
    }

    /// Iterates until no lane is active or `max_iterations` are done.
    pub(super) fn iterate(&mut self, orbit: &OrbitTapes, places: &Places) {
        if orbit.max_iterations == 0 {
            return;
        }
        let copies = self.copies as u8;
        let items = self.items(orbit, places);
        let [again, next, done] = [(); 3].map(|()| self.assembler.label());
        self.assembler.set_counter(Counter::Iterations, orbit.max_iterations);
        self.assembler.set_counter(Counter::Schedule, 0);
        self.assembler.place(again);
        self.assembler.jump_if_none_active(copies, done);
        let labels = self.dispatch(orbit, items.len());
        for (i, item) in items.iter().enumerate() {
            self.assembler.place(labels[i]);
            self.emit_copies(item, places.limit);
            if i + 1 < items.len() {
                self.assembler.jump(next);
            }
        }
        self.assembler.place(next);
        if places.numbered {
            let recorder = self.recorder();
            let iteration = recorder.read(places.iteration) + Traced::splat(&recorder, 1.0);
            let stored = vec![store(iteration, places.iteration)];
            self.emit(recorder, stored, Activity::Unchanged, places.first);
        }
        self.assembler.count_down(Counter::Iterations, again);
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

    /// The iterations that the schedule takes by turns.
    fn items(&self, orbit: &OrbitTapes, places: &Places) -> Vec<Segment> {
        orbit.set.tapes[orbit.items..].iter().map(|item| self.item(orbit, item, places)).collect()
    }

    /// One iteration: the new state where lanes are active, and the end of those that escaped.
    fn item(&self, orbit: &OrbitTapes, item: &Tape, places: &Places) -> Segment {
        let recorder = self.recorder();
        let mut inputs = read_all(&recorder, &places.state);
        inputs.extend(read_all(&recorder, &places.frozen));
        inputs.push(recorder.read(places.iteration));
        let results = run_tape(&recorder, &orbit.set, item, &inputs);
        let (state, escaped) = (&results[..orbit.state], results[orbit.state].to_mask());
        let has_masks = self.assembler.set.has_masks();
        let store = |value: &Traced, place: &Place| match (has_masks, *place) {
            (true, Place::Register(register)) => (value.value, Target::ActiveRegister(register)),
            // What is stored in parts cannot be read back before it has reached the cache.
            _ => store(Traced::select(recorder.active(), *value, recorder.read(*place)), *place),
        };
        let mut outputs: Outputs = state.iter().zip(&places.state).map(|(value, place)| store(value, place)).collect();
        if places.counts {
            let n = recorder.read(places.n) + Traced::splat(&recorder, 1.0);
            outputs.push(store(&n, &places.n));
        }
        let activity = vec![Activity::Lose(escaped.value)];
        Segment { operations: recorder.finish(), outputs, activity }
    }
}

/// What an orbit's end state says: the outputs of `finish`, then where it is inside, and its iterations.
pub(super) fn finish<'a>(recorder: &'a Recorder, orbit: &OrbitTapes, places: &Places) -> Numbers<'a> {
    let n = recorder.read(places.n);
    let mut inputs = read_all(recorder, &places.state);
    inputs.extend(read_all(recorder, &places.frozen));
    inputs.push(n);
    let mut values = run_tape(recorder, &orbit.set, &orbit.set.tapes[1], &inputs);
    values.push(Traced::from_mask(recorder, recorder.active()));
    values.push(n);
    values
}
