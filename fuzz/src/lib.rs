//! What the fuzz targets do, as plain functions of bytes.
//!
//! In come bytes, from libFuzzer (`cargo +nightly fuzz run TARGET`) or from the mutator in [`mutate`] (`smoke`, on stable Rust);
//! a target returns for whatever bytes, or it panics: then something of Bulbfold is wrong. Time and memory are bounded by who
//! calls: 10 s and 1 GB for an input.

pub mod corpus;
pub mod make;
pub mod meter;
pub mod mutate;
pub mod targets;

pub use corpus::Corpus;

use bulbfold::check::Random;

/// A reader, a writer, or a pair of back ends, with what makes inputs for it.
pub struct Target {
    /// Name on command lines, and of the folder in `fuzz/seeds` and `fuzz/corpus`.
    pub name: &'static str,
    /// Runs an input. Panics where it finds a mistake.
    pub run: fn(&[u8]),
    /// Makes an input: a pure function of the random numbers and the corpus.
    pub make: fn(&mut Random, &Corpus) -> Vec<u8>,
    /// Share of a run's inputs, about as fast as the target is.
    pub weight: u64,
}

/// All targets.
pub const TARGETS: &[Target] = &[
    Target { name: "ron", run: targets::readers::ron, make: make::graph, weight: 60 },
    Target { name: "script", run: targets::readers::script, make: make::script, weight: 20 },
    Target { name: "step", run: targets::readers::step, make: make::step, weight: 10 },
    Target { name: "tests", run: targets::readers::tests, make: make::tests, weight: 60 },
    Target { name: "set", run: targets::readers::set, make: make::set, weight: 40 },
    Target { name: "mandelbulber", run: targets::imports::mandelbulber, make: make::mandelbulber, weight: 40 },
    Target { name: "fragmentarium", run: targets::imports::fragmentarium, make: make::fragmentarium, weight: 4 },
    Target { name: "mandelbulb3d", run: targets::imports::mandelbulb3d, make: make::mandelbulb3d, weight: 200 },
    Target { name: "png", run: targets::film::png, make: make::png, weight: 300 },
    Target { name: "edit", run: targets::writers::edit, make: make::graph, weight: 2 },
    Target { name: "cache", run: targets::readers::cache, make: make::cache, weight: 300 },
    Target { name: "writers", run: targets::writers::writers, make: make::graph, weight: 2 },
    Target { name: "expressions", run: targets::machine::expressions, make: make::bytes, weight: 20 },
    Target { name: "graphs", run: targets::machine::graphs, make: make::graph, weight: 4 },
    Target { name: "film", run: targets::film::film, make: make::bytes, weight: 15 },
];

/// The target of a name.
pub fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}

/// A libFuzzer program for one target, with the mutator of the smoke run beside libFuzzer's own. Without cargo-fuzz it is empty.
#[macro_export]
macro_rules! libfuzzer_target {
    ($name:literal) => {
        #[cfg(not(fuzzing))]
        fn main() {
            eprintln!("cargo +nightly fuzz run {} runs this target, and `smoke` runs all of them", $name);
        }

        #[cfg(fuzzing)]
        mod libfuzzer {
            use std::sync::OnceLock;

            use bulbfold::check::Random;
            use bulbfold_fuzz::{Corpus, target};

            #[global_allocator]
            static ALLOCATOR: bulbfold::memory::Counted<std::alloc::System> =
                bulbfold::memory::Counted(std::alloc::System);

            libfuzzer_sys::fuzz_target!(|data: &[u8]| {
                let run = target($name).expect("the target has this name").run;
                bulbfold::memory::with_deep_stack(|| run(data));
            });

            libfuzzer_sys::fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
                static CORPUS: OnceLock<Corpus> = OnceLock::new();
                if seed % 4 == 0 {
                    return libfuzzer_sys::fuzzer_mutate(data, size, max_size);
                }
                let corpus = CORPUS.get_or_init(|| Corpus::load($name));
                let mut random = Random::new(u64::from(seed));
                let made = match seed % 4 {
                    1 => (target($name).expect("the target has this name").make)(&mut random, corpus),
                    _ => bulbfold_fuzz::mutate::mutate(&data[..size], &mut random, corpus),
                };
                let len = made.len().min(max_size);
                data[..len].copy_from_slice(&made[..len]);
                len
            });
        }
    };
}
