//! How the rays of a march are dealt out to threads: what the shader says, worked out by the meaning of its validated text.

use std::collections::HashMap;

use naga::{BinaryOperator as Op, Expression, Function, Handle, Literal, MathFunction, Module, Statement};

use super::pipeline;
use crate::kernel::wgsl::{HANDS, STACK, validate, write};
use crate::render::{RenderSettings, Role};

/// A straight-line function of whole numbers, and what it has called so far.
struct Call<'a> {
    module: &'a Module,
    function: &'a Function,
    arguments: Vec<u32>,
    results: HashMap<Handle<Expression>, u32>,
}

fn call(module: &Module, function: &Function, arguments: Vec<u32>) -> u32 {
    let mut call = Call { module, function, arguments, results: HashMap::new() };
    for statement in &function.body {
        match statement {
            Statement::Emit(_) => {}
            Statement::Call { function, arguments, result: Some(result) } => {
                call.results.insert(*result, call.inner(*function, arguments));
            }
            Statement::Return { value: Some(value) } => return call.value(*value),
            other => panic!("{other:?} is not straight-line"),
        }
    }
    panic!("it gives nothing")
}

impl Call<'_> {
    fn inner(&self, function: Handle<Function>, arguments: &[Handle<Expression>]) -> u32 {
        let arguments = arguments.iter().map(|&argument| self.value(argument)).collect();
        call(self.module, &self.module.functions[function], arguments)
    }

    /// A number; 1 is true and 0 is false.
    fn value(&self, expression: Handle<Expression>) -> u32 {
        match self.function.expressions[expression] {
            Expression::Literal(Literal::U32(number)) => number,
            Expression::FunctionArgument(number) => self.arguments[number as usize],
            Expression::CallResult(_) => self.results[&expression],
            Expression::Select { condition, accept, reject } => {
                self.value(if self.value(condition) == 1 { accept } else { reject })
            }
            Expression::Math { fun: MathFunction::Max, arg, arg1: Some(other), .. } => {
                self.value(arg).max(self.value(other))
            }
            Expression::Binary { op, left, right } => {
                let (a, b) = (self.value(left), self.value(right));
                match op {
                    Op::Add => a + b,
                    Op::Subtract => a - b,
                    Op::Multiply => a * b,
                    Op::Divide => a / b,
                    Op::Modulo => a % b,
                    Op::Less => u32::from(a < b),
                    _ => panic!("{op:?} is not known here"),
                }
            }
            ref other => panic!("{other:?} is no whole number"),
        }
    }
}

/// The module of a march.
fn march() -> Module {
    let (arena, pipeline) = pipeline("mandelbulb", &RenderSettings::default());
    validate(&write(&arena, pipeline.kernel(Role::March))).expect("it is legal").0
}

fn function<'a>(module: &'a Module, name: &str) -> &'a Function {
    let mut functions = module.functions.iter().map(|(_, function)| function);
    functions.find(|function| function.name.as_deref() == Some(name)).expect("the march has it")
}

#[test]
fn every_ray_is_taken_once_and_neighbours_stay_together() {
    let module = march();
    let taken = function(&module, "taken");
    for rays in [1, 63, STACK - 1, STACK, 5 * STACK + 7, HANDS * STACK, 61 * STACK + 1] {
        let all: Vec<u32> = (0..rays).map(|place| call(&module, taken, vec![place, rays])).collect();
        let mut sorted = all.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..rays), "{rays} rays");
        let stacks = all.chunks(STACK as usize);
        assert!(stacks.map(|stack| stack.windows(2)).all(|mut pairs| pairs.all(|pair| pair[1] == pair[0] + 1)));
    }
}

/// Drivers that give each thread one run of workgroups: of any 29 neighbouring stacks each thread has its share, within two.
/// Without dealing one thread would have them all.
#[test]
fn each_thread_gets_its_share_of_any_part_of_a_picture() {
    const PART: u32 = 29;
    let module = march();
    let taken = function(&module, "taken");
    for rays in [320 * 240, 640 * 480, 1 << 16, 1 << 18] {
        let stacks = rays / STACK;
        for threads in [2, 3, 4, 8, 16] {
            let mut thread_of = vec![0; stacks as usize];
            for place in 0..stacks {
                let stack = call(&module, taken, vec![place * STACK, rays]) / STACK;
                thread_of[stack as usize] = place * threads / stacks;
            }
            let share = f64::from(PART) / f64::from(threads);
            for part in thread_of.windows(PART as usize) {
                for thread in 0..threads {
                    let got = part.iter().filter(|&&other| other == thread).count() as f64;
                    assert!((got - share).abs() < 2.0, "{rays} rays: {got} of {PART} for one of {threads} threads");
                }
            }
        }
    }
}

#[test]
fn marches_take_rays_as_they_are_dealt() {
    let module = march();
    let calls_it = |statement: &Statement| match statement {
        Statement::Call { function, .. } => module.functions[*function].name.as_deref() == Some("taken"),
        _ => false,
    };
    assert!(module.entry_points[0].function.body.iter().any(calls_it));
}
