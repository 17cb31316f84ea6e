//! Kernels as machine code: their tapes as straight-line segments, and the loops between them.

use super::assemble::{Assembler, Counter};
use super::copies::COPIES;
use super::instructions::InstructionSet;
use super::kit::Kits;
use super::segment::{Activity, CallSlots, Segment, Slots, Target};
use super::trace::{Place, Recorder, Traced, TracedMask, Value};
use super::{Columns, Compiled};
use crate::kernel::cpu::Precision;
use crate::kernel::cpu::estimate::POINT;
use crate::kernel::cpu::interpret::interpret;
use crate::kernel::cpu::march::{COLUMNS, RAY, STATE, STATUS, STEPS};
use crate::kernel::cpu::tapes::{EstimatorTapes, MarchTapes, OrbitTapes, Program, TapeSet};
use crate::kernel::tape::Tape;
use crate::math::Real;

/// Compiles a kernel; `None` where the system allows no code to be made.
pub(in crate::kernel::cpu) fn compile(
    program: &Program,
    precision: Precision,
    set: InstructionSet,
) -> Option<Compiled> {
    let mut builder = Builder::new(set, precision, COPIES);
    builder.assembler.enter();
    let columns = match program {
        Program::Map(set) => builder.map(set),
        Program::Estimate(tapes) => builder.estimate(tapes),
        Program::March(tapes) => builder.march(tapes),
    };
    builder.assembler.leave();
    let slots = builder.slots.len();
    Some(Compiled { set, precision, copies: COPIES, code: builder.assembler.finish()?, slots, columns })
}

impl Columns {
    fn new(inputs: &[Place], outputs: &[Place], max_march_steps: Option<f64>) -> Columns {
        let first = |places: &[Place]| match places.first() {
            Some(Place::Slot(slot)) => usize::from(*slot),
            _ => 0,
        };
        Columns { inputs: first(inputs), outputs: first(outputs), max_march_steps }
    }
}

struct Builder {
    precision: Precision,
    /// Vectors in step.
    copies: usize,
    /// Vector registers.
    registers: u8,
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
    iteration: Place,
    /// First of the registers that are set aside.
    limit: u8,
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

/// A value and the target that overwrites a place.
fn store(value: Traced, place: Place) -> (Value, Target) {
    let target = match place {
        Place::Slot(slot) => Target::Slot(slot),
        Place::Register(register) => Target::Register(register),
        Place::Active(_) => unreachable!("masks are not outputs"),
    };
    (value.value, target)
}

fn store_all(values: &[Traced], places: &[Place]) -> Outputs {
    values.iter().zip(places).map(|(value, &place)| store(*value, place)).collect()
}

/// The same, where lanes are active; elsewhere the place keeps its value.
fn store_active<'a>(recorder: &'a Recorder, value: Traced<'a>, place: Place) -> (Value, Target) {
    match place {
        Place::Register(register) => (value.value, Target::ActiveRegister(register)),
        // What is stored in parts cannot be read back before it has reached the cache.
        _ => store(Traced::select(recorder.active(), value, recorder.read(place)), place),
    }
}

/// What a kernel does before and after its orbits.
trait Around {
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
struct AroundEstimate {
    inputs: Vec<Place>,
    outputs: Vec<Place>,
}

impl Around for AroundEstimate {
    fn begin<'a>(&self, recorder: &'a Recorder) -> (Numbers<'a>, TracedMask<'a>) {
        let point = read_all(recorder, &self.inputs);
        let hit_eps = point[point.len() - 1];
        (point, Traced::splat(recorder, 0.0).le(hit_eps))
    }

    fn end<'a>(&self, _: &'a Recorder, estimate: &[Traced<'a>], _: Traced<'a>, _: Traced<'a>) -> (Outputs, Activity) {
        (store_all(estimate, &self.outputs), Activity::Unchanged)
    }
}

/// One step of a march of rays in slots.
struct AroundMarch<'t> {
    tapes: &'t MarchTapes,
    columns: Vec<Place>,
}

impl AroundMarch<'_> {
    fn running<'a>(&self, recorder: &'a Recorder, status: Traced<'a>, steps: Traced<'a>) -> TracedMask<'a> {
        let limit = Traced::splat(recorder, f64::from(self.tapes.max_march_steps));
        Traced::mask_and(status.eq(Traced::splat(recorder, 0.0)), steps.lt(limit))
    }
}

impl Around for AroundMarch<'_> {
    fn begin<'a>(&self, recorder: &'a Recorder) -> (Numbers<'a>, TracedMask<'a>) {
        let ray = read_all(recorder, &self.columns[..RAY + STATE]);
        let set = &self.tapes.locate;
        let (status, steps) = (ray[STATUS], recorder.read(self.columns[STEPS]));
        (run_tape(recorder, set, &set.tapes[0], &ray), self.running(recorder, status, steps))
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
        let de = estimate[0];
        let nan = Traced::from_mask(recorder, Traced::mask_not(de.eq(de)));
        let counts = [Traced::splat(recorder, 1.0), iterations, nan];
        let counted =
            counts.into_iter().zip(&self.columns[STEPS..]).map(|(count, &place)| recorder.read(place) + count);
        let live = live.to_mask();
        let places = &self.columns[RAY..];
        let merged: Numbers = (state.into_iter().chain(counted).zip(places))
            .map(|(new, &place)| Traced::select(live, new, recorder.read(place)))
            .collect();
        let running = self.running(recorder, merged[STATUS - RAY], merged[STEPS - RAY]);
        (store_all(&merged, places), Activity::Become(running.value))
    }
}

impl Builder {
    fn new(set: InstructionSet, precision: Precision, copies: usize) -> Builder {
        let mut slots = Slots::default();
        let calls = CallSlots { first: slots.take_many(CallSlots::COUNT), kits: Kits { set, precision } };
        let assembler = Assembler::new(set, precision, calls.first_active());
        Builder { precision, copies, registers: set.registers(), assembler, slots, calls }
    }

    /// Slots for values of all copies: first those of one value, then those of the next.
    fn places(&mut self, count: usize) -> Vec<Place> {
        let first = self.slots.take_many(count * self.copies);
        (0..count).map(|i| Place::Slot(first + (i * self.copies) as u16)).collect()
    }

    fn recorder(&self) -> Recorder {
        Recorder::new(self.precision)
    }

    fn emit(&mut self, recorder: Recorder, outputs: Outputs, activity: Activity, limit: u8) {
        self.emit_copies(&Segment { operations: recorder.finish(), outputs, activity: vec![activity] }, limit);
    }

    fn emit_copies(&mut self, segment: &Segment, limit: u8) {
        segment.copies(self.copies).emit(&mut self.assembler, &mut self.slots, self.calls, limit);
    }

    fn map(&mut self, set: &TapeSet) -> Columns {
        let tape = &set.tapes[0];
        let (inputs, outputs) = (self.places(tape.inputs.len()), self.places(tape.outputs.len()));
        let recorder = self.recorder();
        let values = read_all(&recorder, &inputs);
        let results = run_tape(&recorder, set, tape, &values);
        let stored = store_all(&results, &outputs);
        self.emit(recorder, stored, Activity::Unchanged, self.registers);
        Columns::new(&inputs, &outputs, None)
    }

    fn estimate(&mut self, tapes: &EstimatorTapes) -> Columns {
        let (inputs, outputs) = (self.places(POINT), self.places(tapes.combine.tapes[0].outputs.len()));
        let around = AroundEstimate { inputs, outputs };
        self.estimator(tapes, &around);
        Columns::new(&around.inputs, &around.outputs, None)
    }

    fn march(&mut self, tapes: &MarchTapes) -> Columns {
        let around = AroundMarch { tapes, columns: self.places(COLUMNS) };
        let start = self.assembler.label();
        self.assembler.place(start);
        self.estimator(&tapes.estimator, &around);
        self.assembler.jump_if_enough_active(self.copies as u8, start);
        Columns::new(&around.columns, &around.columns[RAY..], Some(f64::from(tapes.max_march_steps)))
    }

    /// All orbits of an estimator, and what the kernel makes of them.
    fn estimator(&mut self, tapes: &EstimatorTapes, around: &impl Around) {
        let point = self.places(POINT);
        let live = self.places(1)[0];
        let mut results: Vec<Place> = Vec::new();
        let mut counts: Vec<Place> = Vec::new();
        let mut last = None;
        for (number, orbit) in tapes.orbits.iter().enumerate() {
            let places = self.place(orbit);
            self.begin(orbit, &places, around, &point, live, number == 0);
            self.iterate(orbit, &places);
            if number + 1 == tapes.orbits.len() {
                last = Some((orbit, places));
                break;
            }
            let made = orbit.set.tapes[1].outputs.len() + 2;
            let slots = self.places(made);
            let recorder = self.recorder();
            let values = finish(&recorder, orbit, &places);
            let stored = store_all(&values, &slots);
            self.emit(recorder, stored, Activity::Unchanged, places.limit);
            counts.push(slots[made - 1]);
            results.extend(slots);
        }
        let recorder = self.recorder();
        let mut inputs = match tapes.orbits.is_empty() {
            true => around.begin(&recorder).0,
            false => read_all(&recorder, &point),
        };
        let live = match tapes.orbits.is_empty() {
            true => Traced::from_mask(&recorder, around.begin(&recorder).1),
            false => recorder.read(live),
        };
        inputs.extend(read_all(&recorder, &results));
        let mut counts = read_all(&recorder, &counts);
        if let Some((orbit, places)) = &last {
            let values = finish(&recorder, orbit, places);
            counts.extend(values.last());
            inputs.extend(values);
        }
        let combined = run_tape(&recorder, &tapes.combine, &tapes.combine.tapes[0], &inputs);
        let zero = Traced::splat(&recorder, 0.0);
        let total = counts.into_iter().fold(zero, |sum, count| sum + count);
        let (outputs, activity) = around.end(&recorder, &combined, total, live);
        let limit = last.as_ref().map_or(self.registers, |(_, places)| places.limit);
        self.emit(recorder, outputs, activity, limit);
    }

    /// Decides where an orbit's values live: in registers, unless there are too many or a function takes them all.
    fn place(&mut self, orbit: &OrbitTapes) -> Places {
        let (frozen, iteration) = (self.places(orbit.frozen), self.places(1)[0]);
        let state = self.places(orbit.state + 1);
        let in_slots = |state: Vec<Place>| {
            let n = state[orbit.state];
            Places { state: state[..orbit.state].to_vec(), frozen: frozen.clone(), n, iteration, limit: self.registers }
        };
        let places = in_slots(state);
        let mut items = orbit.set.tapes[orbit.items..].iter();
        if (orbit.state + 1) * self.copies > self.assembler.set.most_set_aside()
            || items.any(|item| item_segment(self.recorder(), orbit, item, &places).has_calls())
        {
            return places;
        }
        let limit = self.registers - ((orbit.state + 1) * self.copies) as u8;
        let registers = (limit..self.registers).step_by(self.copies).map(Place::Register).collect();
        Places { limit, ..in_slots(registers) }
    }

    /// The orbit's start values; before the first orbit also the kernel's own beginning.
    fn begin(
        &mut self,
        orbit: &OrbitTapes,
        places: &Places,
        around: &impl Around,
        point: &[Place],
        live: Place,
        first: bool,
    ) {
        let recorder = self.recorder();
        let mut outputs = Vec::new();
        let (values, active) = match first {
            true => {
                let (values, active) = around.begin(&recorder);
                outputs.extend(store_all(&values, point));
                outputs.push(store(Traced::from_mask(&recorder, active), live));
                (values, active)
            }
            false => (read_all(&recorder, point), recorder.read(live).to_mask()),
        };
        let started = run_tape(&recorder, &orbit.set, &orbit.set.tapes[0], &values);
        let (state, frozen) = started.split_at(orbit.state);
        outputs.extend(store_all(state, &places.state));
        outputs.extend(store_all(frozen, &places.frozen));
        let zero = Traced::splat(&recorder, 0.0);
        outputs.extend([store(zero, places.n), store(zero, places.iteration)]);
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
        let counts = items.iter().any(|item| item.reads(places.iteration));
        let (again, done) = (self.assembler.label(), self.assembler.label());
        self.assembler.set_counter(Counter::Iterations, orbit.max_iterations);
        self.assembler.set_counter(Counter::Schedule, 0);
        self.assembler.place(again);
        self.assembler.jump_if_none_active(self.copies as u8, done);
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
            self.emit_copies(item, places.limit);
            if i + 1 < items.len() {
                self.assembler.jump(next);
            }
        }
        self.assembler.place(next);
        if counts {
            let recorder = self.recorder();
            let iteration = recorder.read(places.iteration) + Traced::splat(&recorder, 1.0);
            let stored = vec![store(iteration, places.iteration)];
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
    inputs.push(recorder.read(places.iteration));
    let results = run_tape(&recorder, &orbit.set, item, &inputs);
    let n = recorder.read(places.n) + Traced::splat(&recorder, 1.0);
    let new = results[..orbit.state].iter().zip(&places.state).chain([(&n, &places.n)]);
    let outputs = new.map(|(value, &place)| store_active(&recorder, *value, place)).collect();
    let escaped = results[orbit.state].to_mask().value;
    Segment { operations: recorder.finish(), outputs, activity: vec![Activity::Lose(escaped)] }
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
