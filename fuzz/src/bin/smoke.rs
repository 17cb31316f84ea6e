//! Runs inputs through the targets, each target in a process of its own, and fails for a panic, an abort, and whatever takes
//! more than 10 s of processor time or 1 GB, or waits.
//!
//! Input number N of a seed is always the same, so that one that ends the process is made again by its number.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use bulbfold::check::Random;
use bulbfold::memory::{Counted, with_deep_stack};
use bulbfold_fuzz::meter::{self, Metered};
use bulbfold_fuzz::{Corpus, TARGETS, Target, target};

#[global_allocator]
static ALLOCATOR: Counted<Metered<mimalloc::MiMalloc>> = Counted(Metered(mimalloc::MiMalloc));

/// Most processor time of an input, in seconds.
const SECONDS: f64 = 10.0;
/// Most time by the clock without any work, for what waits.
const WAITING: Duration = Duration::from_secs(30);
/// Most bytes that the process may hold while an input runs.
const BYTES: usize = 1 << 30;
/// Failures after which a target is left.
const FAILURES: usize = 10;

const USAGE: &str = "\
usage: smoke [--inputs N | --seconds S] [--seed N] [--target NAME]...
       smoke --target NAME FILE...

  --inputs N     so many inputs of all targets together [default: 20000]
  --seconds S    about so many seconds of processor time instead
  --seed N       another row of inputs [default: 1]
  --target NAME  this target alone; with files, they are its inputs

Inputs that fail are kept in fuzz/artifacts/NAME/.";

/// The command line.
#[derive(Default)]
struct Arguments {
    inputs: Option<u64>,
    seconds: Option<f64>,
    seed: Option<u64>,
    targets: Vec<&'static Target>,
    files: Vec<PathBuf>,
    /// First input and end of a child's inputs, and the file that it writes their numbers to.
    child: Option<(u64, u64, PathBuf)>,
}

fn parse() -> Result<Arguments, String> {
    let mut parsed = Arguments::default();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{argument} needs a value"));
        let number = |text: String| text.parse::<u64>().map_err(|error| format!("{text}: {error}"));
        match argument.as_str() {
            "--inputs" => parsed.inputs = Some(number(value()?)?),
            "--seconds" => parsed.seconds = Some(value()?.parse().map_err(|error| format!("--seconds: {error}"))?),
            "--seed" => parsed.seed = Some(number(value()?)?),
            "--target" => {
                let name = value()?;
                parsed.targets.push(target(&name).ok_or_else(|| format!("there is no target {name}"))?);
            }
            "--child" => parsed.child = Some((number(value()?)?, number(value()?)?, value()?.into())),
            other if other.starts_with('-') => return Err(format!("there is no {other}\n{USAGE}")),
            file => parsed.files.push(file.into()),
        }
    }
    Ok(parsed)
}

fn main() -> ExitCode {
    let arguments = match parse() {
        Ok(arguments) => arguments,
        Err(message) => {
            eprintln!("{message}");
            return ExitCode::from(2);
        }
    };
    match (&arguments.child, arguments.targets.first()) {
        (Some((from, to, at)), Some(target)) => {
            run_inputs(target, seed(&arguments), (*from, *to), at);
            ExitCode::SUCCESS
        }
        (None, Some(target)) if !arguments.files.is_empty() => run_files(target, &arguments.files),
        _ => run_all(&arguments),
    }
}

fn seed(arguments: &Arguments) -> u64 {
    arguments.seed.unwrap_or(1)
}

/// An input by its number.
fn input(target: &Target, seed: u64, number: u64, corpus: &Corpus) -> Vec<u8> {
    let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number.wrapping_mul(0xd134_2543_de82_ef95));
    (target.make)(&mut random, corpus)
}

/// Ends the process where the input that runs takes too much. `running` is its number and 1, and 0 between inputs.
fn watch(running: &'static AtomicU64) {
    // The input, the processor time at its start, and when it last did any work.
    let mut last = (0, 0.0);
    let mut worked = (0.0, Instant::now());
    loop {
        std::thread::sleep(Duration::from_millis(50));
        let now = running.load(Ordering::Relaxed);
        let processor = meter::processor_seconds(false);
        if processor - worked.0 > 0.05 || now == 0 {
            worked = (processor, Instant::now());
        }
        if now != last.0 {
            last = (now, processor);
        } else if now != 0 && (processor - last.1 > SECONDS || worked.1.elapsed() > WAITING) {
            eprintln!("takes more than {SECONDS} s of processor time, or waits for {WAITING:?}");
            std::process::abort();
        }
    }
}

/// Runs one input and measures it.
fn run_one(run: fn(&[u8]), input: &[u8]) {
    meter::start();
    run(input);
    let most = meter::most_bytes();
    assert!(most <= BYTES, "takes {} MB", most >> 20);
}

/// Runs the inputs of a child.
fn run_inputs(target: &'static Target, seed: u64, (from, to): (u64, u64), at: &Path) {
    static RUNNING: AtomicU64 = AtomicU64::new(0);
    std::thread::spawn(move || watch(&RUNNING));
    with_deep_stack(|| {
        let corpus = Corpus::load(target.name);
        let mut place = File::create(at).expect("the parent's folder can be written to");
        for number in from..to {
            place.rewind().and_then(|()| place.write_all(&number.to_le_bytes())).expect("the number can be written");
            let input = input(target, seed, number, &corpus);
            RUNNING.store(number + 1, Ordering::Relaxed);
            run_one(target.run, &input);
            RUNNING.store(0, Ordering::Relaxed);
        }
    });
}

/// Runs files as inputs.
fn run_files(target: &'static Target, files: &[PathBuf]) -> ExitCode {
    with_deep_stack(|| {
        for file in files {
            let Ok(bytes) = std::fs::read(file) else {
                eprintln!("cannot read {}", file.display());
                return ExitCode::from(2);
            };
            let before = meter::processor_seconds(false);
            run_one(target.run, &bytes);
            let took = meter::processor_seconds(false) - before;
            println!("{}: {took:.3} s, {} MB", file.display(), meter::most_bytes() >> 20);
        }
        ExitCode::SUCCESS
    })
}

/// What became of a target's inputs.
struct Tally {
    inputs: u64,
    failures: Vec<String>,
    seconds: f64,
}

/// Runs all targets, or those that are asked for.
fn run_all(arguments: &Arguments) -> ExitCode {
    let targets: Vec<&'static Target> = match arguments.targets.is_empty() {
        true => TARGETS.iter().collect(),
        false => arguments.targets.clone(),
    };
    let weights: u64 = targets.iter().map(|target| target.weight).sum();
    let mut all = Tally { inputs: 0, failures: Vec::new(), seconds: 0.0 };
    println!("{:<16}{:>12}{:>12}{:>12}{:>10}", "target", "inputs", "seconds", "inputs/s", "failures");
    for target in &targets {
        let tally = match arguments.seconds {
            Some(seconds) => run_target(target, seed(arguments), u64::MAX, seconds / targets.len() as f64),
            None => {
                let inputs = arguments.inputs.unwrap_or(20_000) * target.weight / weights;
                run_target(target, seed(arguments), inputs.max(1), f64::INFINITY)
            }
        };
        let rate = tally.inputs as f64 / tally.seconds.max(1e-3);
        let failures = tally.failures.len();
        println!("{:<16}{:>12}{:>12.1}{:>12.0}{:>10}", target.name, tally.inputs, tally.seconds, rate, failures);
        all.inputs += tally.inputs;
        all.seconds += tally.seconds;
        all.failures.extend(tally.failures);
    }
    println!("{:<16}{:>12}{:>12.1}{:>12}{:>10}", "all", all.inputs, all.seconds, "", all.failures.len());
    all.failures.iter().for_each(|failure| println!("\n{failure}"));
    if all.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs a target's inputs in processes of so many inputs each.
fn run_target(target: &'static Target, seed: u64, inputs: u64, seconds: f64) -> Tally {
    let mut tally = Tally { inputs: 0, failures: Vec::new(), seconds: 0.0 };
    let at = std::env::temp_dir().join(format!("bulbfold-smoke-{}", std::process::id()));
    let start = meter::processor_seconds(true);
    let mut portion = 200;
    while tally.inputs < inputs && tally.seconds < seconds && tally.failures.len() < FAILURES {
        let end = inputs.min(tally.inputs + portion);
        let before = tally.inputs;
        match run_child(target, seed, (tally.inputs, end), &at) {
            Ok(()) => tally.inputs = end,
            Err((number, said)) => {
                let file = keep(target, &input(target, seed, number, &Corpus::load(target.name)), number, seed);
                tally.failures.push(format!("{}, input {number}: {}\n{said}", target.name, file.display()));
                tally.inputs = number + 1;
            }
        }
        let begun = tally.seconds;
        tally.seconds = meter::processor_seconds(true) - start;
        // Some ten seconds a process, so that what it keeps stays small.
        let rate = (tally.inputs - before) as f64 / (tally.seconds - begun).max(1e-3);
        portion = ((rate * 10.0_f64.min(seconds / 4.0)) as u64).clamp(50, 200_000);
    }
    let _ = std::fs::remove_file(&at);
    tally
}

/// Runs a child; the number of the input that ended it and what it said, where it did not reach the end.
fn run_child(target: &Target, seed: u64, (from, to): (u64, u64), at: &Path) -> Result<(), (u64, String)> {
    let broken = |said: String| (from, said);
    let program = std::env::current_exe().map_err(|error| broken(error.to_string()))?;
    let mut command = Command::new(program);
    command.args(["--target", target.name, "--seed", &seed.to_string(), "--child"]);
    command.args([from.to_string(), to.to_string()]).arg(at).env("RAYON_NUM_THREADS", "1");
    let output = command.output().map_err(|error| broken(error.to_string()))?;
    if output.status.success() {
        return Ok(());
    }
    let mut number = [0; 8];
    let read = File::open(at).and_then(|mut file| file.read_exact(&mut number));
    let number = if read.is_ok() { u64::from_le_bytes(number) } else { from };
    let said = String::from_utf8_lossy(&output.stderr);
    let said: String = said.chars().take(2_000).collect();
    Err((number, format!("{}: {}", output.status, said.trim())))
}

/// Keeps an input that fails.
fn keep(target: &Target, input: &[u8], number: u64, seed: u64) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("artifacts").join(target.name);
    let file = folder.join(format!("seed-{seed}-input-{number}"));
    if let Err(error) = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&file, input)) {
        eprintln!("cannot keep {}: {error}", file.display());
    }
    file
}
