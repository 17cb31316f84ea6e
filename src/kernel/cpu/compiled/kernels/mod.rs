//! Kernels as machine code: their tapes as straight-line segments, and the loops between them.

mod orbits;
#[cfg(test)]
mod tests;

use std::collections::{BTreeSet, HashSet};
use std::ops::Range;

use self::orbits::{Start, finish};
use super::assemble::Assembler;
use super::blocks::ADDRESS;
use super::copies::{Order, copies_of};
use super::instructions::InstructionSet;
use super::kit::Kits;
use super::segment::{Activity, CallSlots, Segment, Slots, Target};
use super::trace::{Operation, Place, Recorder, Traced, TracedMask, Value};
use super::{ColumnPlaces, Compiled};
use crate::kernel::cpu::estimate::POINT;
use crate::kernel::cpu::interpret::interpret;
use crate::kernel::cpu::march::{COLUMNS, RAY, STATE, STATUS, STEPS};
use crate::kernel::cpu::tapes::{EstimatorTapes, MarchTapes, Program, TapeSet};
use crate::kernel::tape::Tape;
use crate::math::Precision;
use crate::math::Real;

/// Compiles a kernel; `None` where the system allows no code to be made.
pub(in crate::kernel::cpu) fn compile(
    program: &Program,
    precision: Precision,
    set: InstructionSet,
) -> Option<Compiled> {
    let (builder, columns) = Builder::written(program, precision, set);
    let (copies, slots) = (builder.copies, builder.slots.len());
    Some(Compiled { set, precision, copies, code: builder.assembler.finish()?, slots, columns })
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
    /// What segments read.
    reads: HashSet<Place>,
}

/// Values of a segment.
type Numbers<'a> = Vec<Traced<'a>>;
/// Values and where they go.
type Outputs = Vec<(Value, Target)>;

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
        Place::Column(column, copy) => Target::Column(column, copy),
        Place::Active(_) => unreachable!("masks are not outputs"),
    };
    (value.value, target)
}

fn store_all(values: &[Traced], places: &[Place]) -> Outputs {
    values.iter().zip(places).map(|(value, &place)| store(*value, place)).collect()
}

/// What a kernel does before and after its orbits.
trait Around {
    /// The point to estimate at, and the lanes where that is wanted.
    fn begin<'a>(&self, recorder: &'a Recorder) -> (Numbers<'a>, TracedMask<'a>);
    /// Whether the end needs the number of iterations and the lanes where an estimate was wanted; it takes nothing of others then.
    fn counts(&self) -> bool;
    /// What becomes of the estimator's outputs and the number of iterations.
    fn end<'a>(
        &self,
        recorder: &'a Recorder,
        estimate: &[Traced<'a>],
        iterations: Traced<'a>,
        live: Traced<'a>,
    ) -> (Outputs, Activity);
}

/// An estimate of points in columns.
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

    fn counts(&self) -> bool {
        false
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

    fn counts(&self) -> bool {
        true
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
        let (live, zero) = (live.to_mask(), Traced::splat(recorder, 0.0));
        let places = &self.columns[RAY..];
        let (states, counters) = places.split_at(STATE);
        let mut merged: Numbers =
            state.iter().zip(states).map(|(new, &place)| Traced::select(live, *new, recorder.read(place))).collect();
        let counts = [Traced::splat(recorder, 1.0), iterations, nan];
        let counted = counts.into_iter().zip(counters);
        merged.extend(counted.map(|(count, &place)| recorder.read(place) + Traced::select(live, count, zero)));
        let running = self.running(recorder, merged[STATUS - RAY], merged[STEPS - RAY]);
        (store_all(&merged, places), Activity::Become(running.value))
    }
}

impl Builder {
    /// A kernel in instructions, and where it finds its columns.
    fn written(program: &Program, precision: Precision, set: InstructionSet) -> (Builder, ColumnPlaces) {
        let mut builder = Builder::new(set, precision, copies_of(program, set));
        builder.assembler.enter();
        let columns = match program {
            Program::Map(set) => builder.map(set),
            Program::Estimate(tapes) => builder.estimate(tapes),
            Program::March(tapes) => builder.march(tapes),
        };
        builder.assembler.leave();
        (builder, columns)
    }

    fn new(set: InstructionSet, precision: Precision, copies: usize) -> Builder {
        let mut slots = Slots::default();
        let calls = CallSlots { first: slots.take_many(CallSlots::count(copies)), kits: Kits { set, precision } };
        let assembler = Assembler::new(set, precision, calls.first_active());
        Builder { precision, copies, registers: set.registers(), assembler, slots, calls, reads: HashSet::new() }
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

    /// Emits what is not there for each copy.
    fn emit_once(&mut self, recorder: Recorder, outputs: Outputs, limit: u8) {
        let segment = Segment { operations: recorder.finish(), outputs, activity: vec![Activity::Unchanged] };
        segment.emit(&mut self.assembler, &mut self.slots, self.calls, limit);
    }

    fn emit_copies(&mut self, segment: &Segment, limit: u8) {
        self.reads.extend(segment.operations.iter().zip(segment.needed()).filter_map(|(operation, needed)| {
            match operation {
                Operation::Read(place) if needed => Some(*place),
                _ => None,
            }
        }));
        let order = if segment.is_iteration() { Order::OneByOne } else { Order::ByTurns };
        segment.copies(self.copies, order).emit(&mut self.assembler, &mut self.slots, self.calls, limit);
    }

    fn map(&mut self, set: &TapeSet) -> ColumnPlaces {
        let tape = &set.tapes[0];
        self.over_columns(tape.inputs.len(), tape.outputs.len(), |builder, inputs, outputs| {
            let recorder = builder.recorder();
            let values = read_all(&recorder, &inputs);
            let results = run_tape(&recorder, set, tape, &values);
            let stored = store_all(&results, &outputs);
            builder.emit(recorder, stored, Activity::Unchanged, builder.registers);
        })
    }

    fn estimate(&mut self, tapes: &EstimatorTapes) -> ColumnPlaces {
        self.over_columns(POINT, tapes.combine.tapes[0].outputs.len(), |builder, inputs, outputs| {
            builder.estimator(tapes, &AroundEstimate { inputs, outputs });
        })
    }

    /// A kernel over so many columns of inputs and outputs, block by block.
    fn over_columns(
        &mut self,
        inputs: usize,
        outputs: usize,
        block: impl FnOnce(&mut Builder, Vec<Place>, Vec<Place>),
    ) -> ColumnPlaces {
        let columns = |range: Range<usize>| range.map(|i| Place::Column(i as u16, 0)).collect();
        let addresses = self.slots.take_many(((inputs + outputs) * ADDRESS).div_ceil(self.assembler.set.bytes()));
        self.assembler.first_address = addresses;
        let again = self.assembler.label();
        self.assembler.place(again);
        block(self, columns(0..inputs), columns(inputs..inputs + outputs));
        let is_used = |i: &usize| *i >= inputs || self.reads.contains(&Place::Column(*i as u16, 0));
        let used: Vec<u16> = (0..inputs + outputs).filter(is_used).map(|i| i as u16).collect();
        self.assembler.next_block(used.into_iter(), self.copies, again);
        ColumnPlaces { first: usize::from(addresses), max_march_steps: None }
    }

    fn march(&mut self, tapes: &MarchTapes) -> ColumnPlaces {
        let first = self.slots.len();
        let around = AroundMarch { tapes, columns: self.places(COLUMNS) };
        let start = self.assembler.label();
        self.assembler.place(start);
        self.estimator(&tapes.estimator, &around);
        self.assembler.jump_if_enough_active(self.copies as u8, start);
        ColumnPlaces { first, max_march_steps: Some(f64::from(tapes.max_march_steps)) }
    }

    /// All orbits of an estimator, and what the kernel makes of them.
    fn estimator(&mut self, tapes: &EstimatorTapes, around: &impl Around) {
        let reads = tapes.orbits.iter().skip(1).map(|orbit| &orbit.set.tapes[0]).chain([&tapes.combine.tapes[0]]);
        let read: BTreeSet<u16> = reads.flat_map(|tape| tape.read.iter().copied()).collect();
        let later = read.into_iter().filter(|&i| usize::from(i) < POINT).collect();
        let keeps_live = tapes.orbits.len() > 1 || around.counts();
        let start = Start { point: self.places(POINT), later, live: self.places(1)[0], keeps_live };
        let mut results: Vec<Place> = Vec::new();
        let mut counts: Vec<Place> = Vec::new();
        let mut last = None;
        let mut next = POINT;
        for (number, orbit) in tapes.orbits.iter().enumerate() {
            let made = orbit.set.tapes[1].outputs.len() + 2;
            next += made;
            let reads_n = orbit.reads_n() || tapes.combine.tapes[0].read.contains(&(next as u16 - 1));
            let places = self.place(orbit, reads_n || around.counts());
            self.begin(orbit, &places, around, &start, number == 0);
            self.iterate(orbit, &places, around.counts());
            if number + 1 == tapes.orbits.len() {
                last = Some((orbit, places));
                break;
            }
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
            false => read_all(&recorder, &start.point),
        };
        let live = match tapes.orbits.is_empty() {
            true => Traced::from_mask(&recorder, around.begin(&recorder).1),
            false => recorder.read(start.live),
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
}
