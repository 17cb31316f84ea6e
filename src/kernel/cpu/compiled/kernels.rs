//! Kernels as machine code: their tapes as straight-line segments, and the loops between them.

use super::Compiled;
use super::assemble::{Assembler, Counter};
use super::emit::REGISTERS;
use super::kit::Kits;
use super::segment::{Activity, CallSlots, Segment, Slots, Target};
use super::trace::{Place, Recorder, Traced, TracedMask, Value};
use crate::kernel::cpu::Precision;
use crate::kernel::cpu::estimate::POINT;
use crate::kernel::cpu::interpret::interpret;
use crate::kernel::cpu::march::{COLUMNS, RAY, STATE, STATUS, STEPS};
use crate::kernel::cpu::tapes::{EstimatorTapes, MarchTapes, OrbitTapes, Program, TapeSet};
use crate::kernel::tape::Tape;
use crate::math::Real;

/// Most registers that an orbit's state may keep through its iterations.
const MOST_SET_ASIDE: usize = 14;

/// Compiles a kernel; `None` where the system allows no code to be made.
pub(in crate::kernel::cpu) fn compile(program: &Program, precision: Precision) -> Option<Compiled> {
    let mut builder = Builder::new(precision);
    builder.assembler.enter();
    let (inputs, outputs, max_march_steps) = match program {
        Program::Map(set) => builder.map(set),
        Program::Estimate(tapes) => builder.estimate(tapes),
        Program::March(tapes) => builder.march(tapes),
    };
    builder.assembler.leave();
    let slots = builder.slots.len();
    Some(Compiled { precision, code: builder.assembler.finish()?, slots, inputs, outputs, max_march_steps })
}

struct Builder {
    precision: Precision,
    assembler: Assembler,
    slots: Slots,
    calls: CallSlots,
}

/// Values of a segment.
type Numbers<'a> = Vec<Traced<'a>>;
/// Values and where they go.
type Outputs = Vec<(Value, Target)>;

/// Where an orbit's values live through its iterations.
struct Places {
    state: Vec<Place>,
    frozen: Vec<Place>,
    /// Iterations done, by lane.
    n: Place,
    /// The iteration's number, the same in all lanes.
    iteration: u16,
    /// First of the registers that are set aside.
    limit: u8,
}

fn slots_from(first: u16, count: usize) -> Vec<Place> {
    (0..count as u16).map(|i| Place::Slot(first + i)).collect()
}

fn read_all<'a>(recorder: &'a Recorder, places: &[Place]) -> Numbers<'a> {
    places.iter().map(|&place| recorder.read(place)).collect()
}

fn run_tape<'a>(recorder: &'a Recorder, set: &TapeSet, tape: &Tape, inputs: &[Traced<'a>]) -> Numbers<'a> {
    let mut registers = set.register_file::<Traced, 1>(recorder);
    for (number, register) in set.constants.uniforms() {
        registers[register as usize] = [recorder.uniform(number)];
    }
    for (value, &register) in inputs.iter().zip(&tape.inputs) {
        registers[register as usize] = [*value];
    }
    interpret::<Traced, 1>(recorder, tape, &mut registers);
    tape.outputs.iter().map(|&register| registers[register as usize][0]).collect()
}

/// The target that overwrites a place, in active lanes only if `active`.
fn target(place: Place, active: bool) -> Target {
    match (place, active) {
        (Place::Slot(slot), false) => Target::Slot(slot),
        (Place::Slot(slot), true) => Target::ActiveSlot(slot),
        (Place::Register(register), false) => Target::Register(register),
        (Place::Register(register), true) => Target::ActiveRegister(register),
        (Place::Active, _) => unreachable!("masks are not outputs"),
    }
}

fn store_all(values: &[Traced], places: &[Place], active: bool) -> Outputs {
    values.iter().zip(places).map(|(value, &place)| (value.value, target(place, active))).collect()
}

/// What a kernel does before and after its orbits.
trait Frame {
    /// The point to estimate at, and the lanes where that is wanted.
    fn begin<'a>(&self, recorder: &'a Recorder) -> (Numbers<'a>, TracedMask<'a>);
    /// What becomes of the estimator's outputs and the number of iterations.
    fn end<'a>(
        &self,
        recorder: &'a Recorder,
        estimate: &[Traced<'a>],
        iterations: Traced<'a>,
        live: Traced<'a>,
    ) -> (Outputs, Activity);
}

/// An estimate of points in slots.
struct EstimateFrame {
    inputs: Vec<Place>,
    outputs: Vec<Place>,
}

impl Frame for EstimateFrame {
    fn begin<'a>(&self, recorder: &'a Recorder) -> (Numbers<'a>, TracedMask<'a>) {
        let point = read_all(recorder, &self.inputs);
        let hit_eps = point[point.len() - 1];
        (point, Traced::splat(recorder, 0.0).le(hit_eps))
    }

    fn end<'a>(&self, _: &'a Recorder, estimate: &[Traced<'a>], _: Traced<'a>, _: Traced<'a>) -> (Outputs, Activity) {
        (store_all(estimate, &self.outputs, false), Activity::Unchanged)
    }
}

/// One step of a march of rays in slots.
struct MarchFrame<'t> {
    tapes: &'t MarchTapes,
    columns: Vec<Place>,
}

impl MarchFrame<'_> {
    fn running<'a>(&self, recorder: &'a Recorder) -> TracedMask<'a> {
        let (status, steps) = (recorder.read(self.columns[STATUS]), recorder.read(self.columns[STEPS]));
        let limit = Traced::splat(recorder, f64::from(self.tapes.max_march_steps));
        Traced::mask_and(status.eq(Traced::splat(recorder, 0.0)), steps.lt(limit))
    }
}

impl Frame for MarchFrame<'_> {
    fn begin<'a>(&self, recorder: &'a Recorder) -> (Numbers<'a>, TracedMask<'a>) {
        let ray = read_all(recorder, &self.columns[..RAY + STATE]);
        let set = &self.tapes.locate;
        (run_tape(recorder, set, &set.tapes[0], &ray), self.running(recorder))
    }

    fn end<'a>(
        &self,
        recorder: &'a Recorder,
        estimate: &[Traced<'a>],
        iterations: Traced<'a>,
        live: Traced<'a>,
    ) -> (Outputs, Activity) {
        let mut inputs = read_all(recorder, &self.columns[..RAY + STATE]);
        inputs.extend(&estimate[..2]);
        let set = &self.tapes.advance;
        let state = run_tape(recorder, set, &set.tapes[0], &inputs);
        let mut outputs = store_all(&state, &self.columns[RAY..RAY + STATE], true);
        let de = estimate[0];
        let nan = Traced::from_mask(recorder, Traced::mask_not(de.eq(de)));
        let counts = [Traced::splat(recorder, 1.0), iterations, nan];
        for (count, &place) in counts.into_iter().zip(&self.columns[STEPS..]) {
            outputs.push(((recorder.read(place) + count).value, target(place, true)));
        }
        (outputs, Activity::Become(live.to_mask().value))
    }
}

impl Builder {
    fn new(precision: Precision) -> Builder {
        let mut slots = Slots::default();
        let calls = CallSlots { first: slots.take_many(CallSlots::COUNT), kits: Kits { precision } };
        Builder { precision, assembler: Assembler::new(precision), slots, calls }
    }

    fn recorder(&self) -> Recorder {
        Recorder::new(self.precision)
    }

    fn emit(&mut self, recorder: Recorder, outputs: Outputs, activity: Activity, limit: u8) {
        let segment = Segment { operations: recorder.finish(), outputs, activity };
        segment.emit(&mut self.assembler, &mut self.slots, self.calls, limit);
    }

    fn map(&mut self, set: &TapeSet) -> (u16, u16, Option<f64>) {
        let tape = &set.tapes[0];
        let (inputs, outputs) = (self.slots.take_many(tape.inputs.len()), self.slots.take_many(tape.outputs.len()));
        let recorder = self.recorder();
        let values = read_all(&recorder, &slots_from(inputs, tape.inputs.len()));
        let results = run_tape(&recorder, set, tape, &values);
        let stored = store_all(&results, &slots_from(outputs, tape.outputs.len()), false);
        self.emit(recorder, stored, Activity::Unchanged, REGISTERS);
        (inputs, outputs, None)
    }

    fn estimate(&mut self, tapes: &EstimatorTapes) -> (u16, u16, Option<f64>) {
        let counts = (POINT, tapes.combine.tapes[0].outputs.len());
        let (inputs, outputs) = (self.slots.take_many(counts.0), self.slots.take_many(counts.1));
        let frame = EstimateFrame { inputs: slots_from(inputs, counts.0), outputs: slots_from(outputs, counts.1) };
        self.estimator(tapes, &frame);
        (inputs, outputs, None)
    }

    fn march(&mut self, tapes: &MarchTapes) -> (u16, u16, Option<f64>) {
        let columns = self.slots.take_many(COLUMNS);
        let frame = MarchFrame { tapes, columns: slots_from(columns, COLUMNS) };
        let start = self.assembler.label();
        self.assembler.place(start);
        self.estimator(&tapes.estimator, &frame);
        let recorder = self.recorder();
        let running = frame.running(&recorder).value;
        self.emit(recorder, Vec::new(), Activity::Become(running), REGISTERS);
        self.assembler.jump_if_enough_active(start);
        (columns, columns + RAY as u16, Some(f64::from(tapes.max_march_steps)))
    }

    /// All orbits of an estimator, and what the kernel makes of them.
    fn estimator(&mut self, tapes: &EstimatorTapes, frame: &impl Frame) {
        let point = slots_from(self.slots.take_many(POINT), POINT);
        let live = Place::Slot(self.slots.take_many(1));
        let mut results: Vec<Place> = Vec::new();
        let mut counts: Vec<Place> = Vec::new();
        for (number, orbit) in tapes.orbits.iter().enumerate() {
            let places = self.place(orbit);
            self.begin(orbit, &places, frame, &point, live, number == 0);
            self.iterate(orbit, &places);
            let made = orbit.set.tapes[1].outputs.len() + 2;
            let slots = slots_from(self.slots.take_many(made), made);
            let recorder = self.recorder();
            let values = finish(&recorder, orbit, &places);
            let stored = store_all(&values, &slots, false);
            self.emit(recorder, stored, Activity::Unchanged, places.limit);
            counts.push(slots[made - 1]);
            results.extend(slots);
        }
        let recorder = self.recorder();
        let mut inputs = match tapes.orbits.is_empty() {
            true => frame.begin(&recorder).0,
            false => read_all(&recorder, &point),
        };
        let live = match tapes.orbits.is_empty() {
            true => Traced::from_mask(&recorder, frame.begin(&recorder).1),
            false => recorder.read(live),
        };
        inputs.extend(read_all(&recorder, &results));
        let combined = run_tape(&recorder, &tapes.combine, &tapes.combine.tapes[0], &inputs);
        let zero = Traced::splat(&recorder, 0.0);
        let total = counts.iter().fold(zero, |sum, &count| sum + recorder.read(count));
        let (outputs, activity) = frame.end(&recorder, &combined, total, live);
        self.emit(recorder, outputs, activity, REGISTERS);
    }

    /// Decides where an orbit's values live: in registers, unless there are too many or a function takes them all.
    fn place(&mut self, orbit: &OrbitTapes) -> Places {
        let frozen = slots_from(self.slots.take_many(orbit.frozen), orbit.frozen);
        let iteration = self.slots.take_many(1);
        let state = slots_from(self.slots.take_many(orbit.state + 1), orbit.state + 1);
        let in_slots = |state: Vec<Place>| {
            let n = state[orbit.state];
            Places { state: state[..orbit.state].to_vec(), frozen: frozen.clone(), n, iteration, limit: REGISTERS }
        };
        let places = in_slots(state);
        let mut items = orbit.set.tapes[orbit.items..].iter();
        if orbit.state + 1 > MOST_SET_ASIDE
            || items.any(|item| item_segment(self.recorder(), orbit, item, &places).has_calls())
        {
            return places;
        }
        let limit = REGISTERS - (orbit.state + 1) as u8;
        let registers = (limit..REGISTERS).map(Place::Register).collect();
        Places { limit, ..in_slots(registers) }
    }

    /// The orbit's start values; before the first orbit also the kernel's own beginning.
    fn begin(
        &mut self,
        orbit: &OrbitTapes,
        places: &Places,
        frame: &impl Frame,
        point: &[Place],
        live: Place,
        first: bool,
    ) {
        let recorder = self.recorder();
        let mut outputs = Vec::new();
        let (values, active) = match first {
            true => {
                let (values, active) = frame.begin(&recorder);
                outputs.extend(store_all(&values, point, false));
                outputs.push((Traced::from_mask(&recorder, active).value, target(live, false)));
                (values, active)
            }
            false => (read_all(&recorder, point), recorder.read(live).to_mask()),
        };
        let started = run_tape(&recorder, &orbit.set, &orbit.set.tapes[0], &values);
        let (state, frozen) = started.split_at(orbit.state);
        outputs.extend(store_all(state, &places.state, false));
        outputs.extend(store_all(frozen, &places.frozen, false));
        let zero = Traced::splat(&recorder, 0.0).value;
        outputs.push((zero, target(places.n, false)));
        outputs.push((zero, Target::Slot(places.iteration)));
        let active = active.value;
        self.emit(recorder, outputs, Activity::Become(active), places.limit);
    }

    /// Iterates until no lane is active or `max_iterations` are done.
    fn iterate(&mut self, orbit: &OrbitTapes, places: &Places) {
        if orbit.max_iterations == 0 {
            return;
        }
        let items: Vec<Segment> = orbit.set.tapes[orbit.items..]
            .iter()
            .map(|item| item_segment(self.recorder(), orbit, item, places))
            .collect();
        let counts = items.iter().any(|item| item.reads(Place::Slot(places.iteration)));
        let (again, done) = (self.assembler.label(), self.assembler.label());
        self.assembler.set_counter(Counter::Iterations, orbit.max_iterations);
        self.assembler.set_counter(Counter::Schedule, 0);
        self.assembler.place(again);
        self.assembler.jump_if_none_active(done);
        let labels: Vec<_> = items.iter().map(|_| self.assembler.label()).collect();
        if items.len() > 1 {
            let schedule = &orbit.schedule;
            let all = schedule.prefix.iter().chain(&schedule.cycle).map(|&item| item as u32);
            let table = self.assembler.table(all);
            let (prefix, cycle) = (schedule.prefix.len() as u32, schedule.cycle.len() as u32);
            self.assembler.dispatch(table, prefix, prefix + cycle, &labels);
        }
        let next = self.assembler.label();
        for (i, item) in items.iter().enumerate() {
            self.assembler.place(labels[i]);
            item.emit(&mut self.assembler, &mut self.slots, self.calls, places.limit);
            if i + 1 < items.len() {
                self.assembler.jump(next);
            }
        }
        self.assembler.place(next);
        if counts {
            let recorder = self.recorder();
            let iteration = recorder.read(Place::Slot(places.iteration)) + Traced::splat(&recorder, 1.0);
            let stored = vec![(iteration.value, Target::Slot(places.iteration))];
            self.emit(recorder, stored, Activity::Unchanged, places.limit);
        }
        self.assembler.count_down(Counter::Iterations, again);
        self.assembler.place(done);
    }
}

/// One iteration: the new state where lanes are active, and the end of those that escaped.
fn item_segment(recorder: Recorder, orbit: &OrbitTapes, item: &Tape, places: &Places) -> Segment {
    let mut inputs = read_all(&recorder, &places.state);
    inputs.extend(read_all(&recorder, &places.frozen));
    inputs.push(recorder.read(Place::Slot(places.iteration)));
    let results = run_tape(&recorder, &orbit.set, item, &inputs);
    let mut outputs = store_all(&results[..orbit.state], &places.state, true);
    let n = recorder.read(places.n) + Traced::splat(&recorder, 1.0);
    outputs.push((n.value, target(places.n, true)));
    let escaped = results[orbit.state].to_mask().value;
    Segment { operations: recorder.finish(), outputs, activity: Activity::Lose(escaped) }
}

/// What an orbit's end state says: the outputs of `finish`, then where it is inside, and its iterations.
fn finish<'a>(recorder: &'a Recorder, orbit: &OrbitTapes, places: &Places) -> Numbers<'a> {
    let n = recorder.read(places.n);
    let mut inputs = read_all(recorder, &places.state);
    inputs.extend(read_all(recorder, &places.frozen));
    inputs.push(n);
    let mut values = run_tape(recorder, &orbit.set, &orbit.set.tapes[1], &inputs);
    values.push(Traced::from_mask(recorder, recorder.active()));
    values.push(n);
    values
}
