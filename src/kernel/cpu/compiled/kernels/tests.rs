//! What the code of real kernels looks like. It is written, not run, so any processor of the family can tell.

use std::ops::Range;

use iced_x86::{Code, Instruction};

use super::Builder;
use crate::graph::{EstimateSettings, Method};
use crate::kernel::cpu::compiled::assemble::Counter;
use crate::kernel::cpu::compiled::instructions::{Form, InstructionSet};
use crate::kernel::cpu::tapes::{OrbitTapes, Program};
use crate::kernel::wgsl::tests::pipeline;
use crate::math::Precision;
use crate::render::{RenderSettings, Role};

/// The march of a built-in fractal with an estimate of this method.
fn march(name: &str, method: Method) -> Program {
    let estimate = EstimateSettings { method: Some(method), ..Default::default() };
    let (arena, pipeline) = pipeline(name, &RenderSettings { estimate, ..Default::default() });
    Program::new(&arena, pipeline.kernel(Role::March))
}

/// The orbit of a march that has one.
fn orbit(program: &Program) -> &OrbitTapes {
    match program {
        Program::March(tapes) if tapes.estimator.orbits.len() == 1 => &tapes.estimator.orbits[0],
        _ => panic!("a march of one orbit"),
    }
}

/// Loops that count iterations down: from the first instruction of each to the jump back to it.
fn loops(instructions: &[Instruction]) -> Vec<Range<usize>> {
    let counts_down =
        |i: &Instruction| i.code() == Code::Dec_rm64 && i.op0_register() == Counter::Iterations.register();
    let ends = (1..instructions.len()).filter(|&at| counts_down(&instructions[at - 1]));
    // A label is the address of the instruction that it stands before.
    let start = |end: usize| instructions[..end].iter().position(|i| i.ip() == instructions[end].near_branch64());
    ends.filter_map(|end| Some(start(end)?..end)).collect()
}

/// Until the first lane escapes no old state is kept: that loop has no choice between old and new, and it is entered first.
#[test]
fn avx2_iterates_all_lanes_before_it_chooses_among_them() {
    for (name, method) in
        [("mandelbulb", Method::Scalar), ("mandelbox", Method::Scalar), ("box_bulb", Method::Gradient)]
    {
        let program = march(name, method);
        for precision in [Precision::F32, Precision::F64] {
            let (builder, _) = Builder::written(&program, precision, InstructionSet::Avx2);
            let code = &builder.assembler.instructions;
            let [all, active] = &loops(code)[..] else {
                panic!("{name}: a loop of all lanes, and one of those active")
            };
            assert!(all.end < active.start, "{name}: one behind the other");
            let blend = builder.assembler.code(Form::Blend);
            let choices = |part: &Range<usize>| code[part.clone()].iter().filter(|i| i.code() == blend).count();
            // Each number of the state, and the count of iterations, in each item of the schedule.
            let orbit = orbit(&program);
            let items = orbit.set.tapes.len() - orbit.items;
            let kept = (orbit.state + 1) * builder.copies * items;
            assert_eq!(choices(active), choices(all) + kept, "{name}: choices of the two loops");
            let before = &code[all.start - 1];
            let into = before.near_branch64();
            let is_conditional = matches!(before.code(), Code::Je_rel32_64 | Code::Jne_rel32_64);
            assert!(is_conditional, "{name}: {:?} does not go on into the first loop", before.code());
            assert!(code[active.start..].iter().any(|i| i.ip() == into), "{name}: what skips it ends behind it");
        }
    }
}

/// Masked moves keep the state of idle lanes for nothing.
#[test]
fn avx512_needs_one_loop() {
    let program = march("mandelbox", Method::Scalar);
    let (builder, _) = Builder::written(&program, Precision::F32, InstructionSet::Avx512);
    assert_eq!(loops(&builder.assembler.instructions).len(), 1);
}

/// Three vectors with AVX2 where the state is small and an iteration waits for a quotient or a root, else two: the doc of
/// `MORE_COPIES` says what was measured.
#[test]
fn vectors_in_step_follow_state_and_waits() {
    const CASES: [(&str, Method, usize); 6] = [
        // Four numbers and a quotient: that of the sphere fold, or of the power.
        ("mandelbox", Method::Scalar, 3),
        ("mandelbulb", Method::Scalar, 3),
        // No quotient, whatever the state.
        ("menger", Method::Scalar, 2),
        ("menger", Method::Jacobian, 2),
        // A Jacobian is nine numbers more.
        ("mandelbox", Method::Jacobian, 2),
        ("mandelbulb", Method::Gradient, 2),
    ];
    for (name, method, expected) in CASES {
        let program = march(name, method);
        for (set, expected) in [(InstructionSet::Avx2, expected), (InstructionSet::Avx512, 2)] {
            let (builder, _) = Builder::written(&program, Precision::F32, set);
            let state = orbit(&program).state;
            assert_eq!(builder.copies, expected, "{name}, {method:?}, {set:?}, a state of {state} numbers");
        }
    }
    let (arena, pipeline) = pipeline("mandelbox", &RenderSettings::default());
    let camera = Program::new(&arena, pipeline.kernel(Role::Camera));
    assert_eq!(Builder::written(&camera, Precision::F32, InstructionSet::Avx2).0.copies, 2, "no orbit waits");
}
