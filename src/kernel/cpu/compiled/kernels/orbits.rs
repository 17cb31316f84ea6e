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

/// The lanes that an iteration is for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Lanes {
    /// Those that are active; the others keep their state.
    Active,
    /// All, whatever becomes of those that are not active.
    All,
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
        let items = self.items(orbit, &places, Lanes::Active);
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

    /// Iterates until no lane is active or `max_iterations` are done. `idle_is_unread` is whether nothing reads the results of
    /// lanes that were not active from the start.
    pub(super) fn iterate(&mut self, orbit: &OrbitTapes, places: &Places, idle_is_unread: bool) {
        if orbit.max_iterations == 0 {
            return;
        }
        let done = self.assembler.label();
        self.assembler.set_counter(Counter::Iterations, orbit.max_iterations);
        self.assembler.set_counter(Counter::Schedule, 0);
        let active = self.assembler.label();
        if !self.assembler.set.has_masks() {
            self.iterate_all(orbit, places, idle_is_unread, [active, done]);
        }
        self.assembler.place(active);
        self.assembler.jump_if_none_active(self.copies as u8, done);
        self.take_turns(orbit, places, Lanes::Active, None);
        self.count(places, Lanes::Active);
        self.assembler.count_down(Counter::Iterations, active);
        self.assembler.place(done);
    }

    /// Iterates all lanes until the first of them escapes: until then no old state has to be kept. Goes on behind it, or jumps: to
    /// `active` where not all of them count, to `done` where nothing is left to do.
    fn iterate_all(&mut self, orbit: &OrbitTapes, places: &Places, idle_is_unread: bool, [active, done]: [Label; 2]) {
        let copies = self.copies as u8;
        let [again, escaped] = [(); 2].map(|()| self.assembler.label());
        match idle_is_unread {
            true => self.assembler.jump_if_none_active(copies, done),
            false => self.assembler.jump_unless_all_active(copies, active),
        }
        self.assembler.place(again);
        self.take_turns(orbit, places, Lanes::All, Some(escaped));
        self.count(places, Lanes::All);
        self.assembler.count_down(Counter::Iterations, again);
        self.share_count(places);
        self.assembler.jump(done);
        self.assembler.place(escaped);
        self.assembler.deactivate_noted(copies);
        self.count(places, Lanes::All);
        self.share_count(places);
        self.assembler.count_down(Counter::Iterations, active);
        self.assembler.jump(done);
    }

    /// The schedule's next iteration. Jumps to `escaped` behind it when a lane escapes that was active.
    fn take_turns(&mut self, orbit: &OrbitTapes, places: &Places, lanes: Lanes, escaped: Option<Label>) {
        let items = self.items(orbit, places, lanes);
        let next = self.assembler.label();
        let labels = self.dispatch(orbit, items.len());
        for (i, item) in items.iter().enumerate() {
            self.assembler.place(labels[i]);
            self.emit_copies(item, places.limit);
            if let Some(escaped) = escaped {
                self.assembler.jump_if_any_noted(escaped);
            }
            if i + 1 < items.len() {
                self.assembler.jump(next);
            }
        }
        self.assembler.place(next);
    }

    /// Counts an iteration: for tapes that read its number, and where all lanes take it instead of the first copy's count.
    fn count(&mut self, places: &Places, lanes: Lanes) {
        let next = |recorder: &Recorder, place| vec![store(recorder.read(place) + Traced::splat(recorder, 1.0), place)];
        if places.numbered {
            let recorder = self.recorder();
            let stored = next(&recorder, places.iteration);
            self.emit(recorder, stored, Activity::Unchanged, places.first);
        }
        if lanes == Lanes::All && places.counts {
            let recorder = self.recorder();
            let stored = next(&recorder, places.n);
            self.emit_once(recorder, stored, places.first);
        }
    }

    /// Gives all copies the count of the first.
    fn share_count(&mut self, places: &Places) {
        if !places.counts {
            return;
        }
        for copy in 1..self.copies {
            let recorder = self.recorder();
            let count = recorder.read(places.n);
            let stored = vec![store(count, places.n.of_copy(copy))];
            self.emit_once(recorder, stored, places.first);
        }
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

    /// The iterations that the schedule alternates.
    fn items(&self, orbit: &OrbitTapes, places: &Places, lanes: Lanes) -> Vec<Segment> {
        orbit.set.tapes[orbit.items..].iter().map(|item| self.item(orbit, item, places, lanes)).collect()
    }

    /// One iteration: the new state of these lanes, and the end of those that escaped.
    fn item(&self, orbit: &OrbitTapes, item: &Tape, places: &Places, lanes: Lanes) -> Segment {
        let recorder = self.recorder();
        let mut inputs = read_all(&recorder, &places.state);
        inputs.extend(read_all(&recorder, &places.frozen));
        inputs.push(recorder.read(places.iteration));
        let results = run_tape(&recorder, &orbit.set, item, &inputs);
        let (state, escaped) = (&results[..orbit.state], results[orbit.state].to_mask());
        if lanes == Lanes::All {
            let outputs = store_all(state, &places.state);
            let activity = vec![Activity::Note(escaped.value)];
            return Segment { operations: recorder.finish(), outputs, activity };
        }
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
