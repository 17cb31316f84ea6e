//! Kernels that are kept, against each one's own.

use std::sync::Arc;

use super::{Announced, Kept};
use crate::expr::{Arena, Function, Port, Type};
use crate::kernel::cpu::Cpu;
use crate::kernel::{Backend, Kernel};
use crate::math::Precision;

/// `x a + 0.25`, and a vector of three numbers times x.
fn map(a: f64, v: [f64; 3]) -> (Arc<Arena>, Kernel) {
    let arena = Arc::new(Arena::default());
    let mut f = Function::new("f", vec![Port::new("x", Type::F)]);
    let x = arena.input(0, Type::F);
    f.output("y", x * a + 0.25);
    f.output("v", (arena.v3(v) * x).xyz());
    (arena.clone(), Kernel::Map(f))
}

/// The results of all maps by one set of kept kernels, and how many were compiled.
fn run_all(cpu: &Cpu, announced: &Announced, maps: &[(f64, [f64; 3])]) -> (Vec<Vec<Vec<f64>>>, Kept<Cpu>) {
    let mut kept = Kept::keeping(announced);
    let mut run = |(a, v): &(f64, [f64; 3])| {
        let (arena, kernel) = map(*a, *v);
        let ready = kept.prepare(cpu, "f", &arena, &kernel).expect("maps compile");
        let columns = cpu.upload(&[vec![0.3, -7.0, 100.0]]).expect("columns fit");
        cpu.run(&ready, &[&columns]).and_then(|c| cpu.download(&c)).expect("maps run")
    };
    let results = maps.iter().map(&mut run).collect();
    (results, kept)
}

const FRAMES: [(f64, [f64; 3]); 3] = [(1.5, [3.0, 4.0, 5.0]), (1.75, [3.0, 4.5, 6.0]), (-2.0, [3.0, 9.0, 4.0])];

fn announced(maps: &[(f64, [f64; 3])]) -> Announced {
    let announced = Announced::default();
    for (a, v) in maps {
        let (arena, kernel) = map(*a, *v);
        announced.add("f", &arena, &kernel);
    }
    announced
}

#[test]
fn kernels_of_one_structure_are_one_and_keep_their_numbers() {
    for cpu in [Precision::F32, Precision::F64].map(Cpu::new).into_iter().flat_map(|cpu| [cpu, cpu.interpreted()]) {
        let own: Vec<Vec<Vec<f64>>> =
            FRAMES.iter().map(|frame| run_all(&cpu, &Announced::default(), &[*frame]).0.remove(0)).collect();
        for (told, compiled) in [(&FRAMES[2..], 1), (&[][..], 2)] {
            let (results, kept) = run_all(&cpu, &announced(told), &FRAMES);
            assert_eq!(results, own, "{}", cpu.description());
            assert_eq!((kept.compiled(), kept.structures()["f"]), (compiled, 1));
        }
    }
}

#[test]
fn what_changes_the_structure_is_another_kernel() {
    let maps = [2.0, 0.0, 1.0, 3.0, 0.0].map(|a| (a, [1.0, 2.0, 4.0]));
    let (_, kept) = run_all(&Cpu::new(Precision::F64), &announced(&maps), &maps);
    assert_eq!((kept.compiled(), kept.structures()["f"]), (3, 3), "a factor of 0 or 1 is folded away");
}
