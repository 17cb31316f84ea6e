//! Whether the GPU's driver can be used, tried in a process of its own: a driver that crashes or hangs ends that process alone.
//!
//! The child is this program with the hidden command `try-driver`. It says a line for each adapter, opens the best one and lets
//! it compute; its last line is [`DONE`].

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bulbfold::expr::{Arena, Function, Port, Type};
use bulbfold::kernel::gpu::{AdapterInfoLine, AdapterWanted, Gpu, adapters};
use bulbfold::kernel::{Backend, BackendError, Kernel};
use clap::{Args, ValueEnum};

use super::{Failure, Outcome, message};

/// Name of the hidden command.
pub const COMMAND: &str = "try-driver";
/// What a driver must open a device and compute within. Ten times what slow ones take.
const LIMIT: Duration = Duration::from_secs(20);
/// Time between two looks at the child.
const LOOK: Duration = Duration::from_millis(2);
/// The last line of a child whose adapter computed.
const DONE: &str = "done";

/// Arguments of `try-driver`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold try-driver any         what `bulbfold doctor` asks for
  bulbfold try-driver hardware    what `--backend auto` asks for")]
pub struct Arguments {
    /// Adapters that are wanted
    #[arg(value_enum)]
    kind: Kind,
}

/// Adapters that are wanted, as an argument.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum Kind {
    /// Graphics hardware alone
    Hardware,
    /// Software drivers too
    Any,
}

/// What is known of the machine's adapters.
pub struct Tried {
    /// Text of each adapter, and whether it is one in software.
    pub adapters: Vec<(String, bool)>,
    /// Why none can be used, where that is the driver's fault.
    pub error: Option<BackendError>,
}

/// The child: says what adapters there are, and whether one of the kind computes.
pub fn run(arguments: &Arguments, out: &mut dyn Write) -> Outcome {
    for adapter in adapters() {
        writeln!(out, "{} {}", if adapter.is_software { "software" } else { "hardware" }, line(&adapter))?;
        out.flush()?;
    }
    let wanted = if arguments.kind == Kind::Any { AdapterWanted::Any } else { AdapterWanted::Hardware };
    match Gpu::new(wanted).and_then(|gpu| compute(&gpu)) {
        Ok(()) => Ok(writeln!(out, "{DONE}")?),
        Err(error) => Err(Failure::Work(message(&error.to_string(), ""))),
    }
}

fn line(adapter: &AdapterInfoLine) -> String {
    format!("{} ({}, {}, {})", adapter.name, adapter.backend, adapter.device_type, adapter.driver)
}

/// A kernel that a driver must compile, and a result that it must get right.
fn compute(gpu: &Gpu) -> Result<(), BackendError> {
    let arena = Arena::default();
    let mut function = Function::new("double", vec![Port::new("x", Type::F)]);
    function.output("y", arena.input(0, Type::F) * 2.0);
    let kernel = gpu.prepare(&arena, &Kernel::Map(function))?;
    let input = gpu.upload(&[vec![1.0, 2.5]])?;
    let found = gpu.download(&gpu.run(&kernel, &[&input])?)?;
    match found == [vec![2.0, 5.0]] {
        true => Ok(()),
        false => Err(BackendError::DeviceLost("it computes wrong numbers".into())),
    }
}

/// Tries the hardware's driver. Nothing is started where there can be no hardware.
pub fn try_hardware() -> Tried {
    if may_have_hardware() { tried(Kind::Hardware) } else { Tried { adapters: Vec::new(), error: None } }
}

/// Tries whatever driver there is, also in software.
pub fn try_any() -> Tried {
    tried(Kind::Any)
}

impl Tried {
    /// True where an adapter in hardware was seen and nothing failed.
    pub fn has_hardware(&self) -> bool {
        self.error.is_none() && self.adapters.iter().any(|(_, is_software)| !is_software)
    }
}

/// False where no graphics hardware can be: its drivers of Linux need a device file, unless drivers are named outright.
fn may_have_hardware() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    const NAMED: [&str; 3] = ["VK_DRIVER_FILES", "VK_ADD_DRIVER_FILES", "VK_ICD_FILENAMES"];
    const FILES: [&str; 7] = ["nvidia", "dxg", "mali", "kgsl", "pvr", "galcore", "renderD"];
    let has_file = |folder: &str| {
        let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
        names.into_iter().any(|name| FILES.iter().any(|file| name.to_string_lossy().starts_with(file)))
    };
    NAMED.iter().any(|name| std::env::var_os(name).is_some()) || has_file("/dev/dri") || has_file("/dev")
}

fn tried(kind: Kind) -> Tried {
    // The file that runs, also where another one has its name by now.
    let own = PathBuf::from("/proc/self/exe");
    let program = if own.exists() { Ok(own) } else { std::env::current_exe() };
    let started = program.and_then(|program| {
        let mut command = Command::new(program);
        command.arg(COMMAND).arg(if kind == Kind::Any { "any" } else { "hardware" });
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()
    });
    match started {
        Ok(child) => outcome(child),
        Err(error) => failed(Vec::new(), format!("it could not be tried: {error}")),
    }
}

fn failed(adapters: Vec<(String, bool)>, text: String) -> Tried {
    Tried { adapters, error: Some(BackendError::NoAdapter(text)) }
}

/// Waits for a child, for [`LIMIT`] at most.
fn outcome(mut child: Child) -> Tried {
    let begun = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break Some(status),
            Ok(None) if begun.elapsed() < LIMIT => std::thread::sleep(LOOK),
            _ => break None,
        }
    };
    if status.is_none() {
        let _ = child.kill();
        let _ = child.wait();
    }
    let [said, complained] = [read(child.stdout.take()), read(child.stderr.take())];
    let adapters = said.lines().filter_map(|line| line.split_once(' '));
    let adapters: Vec<_> = adapters.map(|(kind, line)| (line.to_string(), kind == "software")).collect();
    let Some(status) = status else {
        return failed(adapters, format!("its driver does not answer within {} s", LIMIT.as_secs()));
    };
    if said.lines().any(|line| line == DONE) {
        return Tried { adapters, error: None };
    }
    match status.code() {
        // No adapter of the kind is no fault where there is none at all, or where software was not asked for.
        Some(1) if adapters.iter().all(|(_, is_software)| *is_software) && complained.contains("no GPU adapter") => {
            Tried { adapters, error: None }
        }
        Some(1) => failed(adapters, complained.trim_start_matches("error: ").trim().to_string()),
        _ => failed(adapters, format!("its driver crashes the process that tries it ({status})")),
    }
}

/// What a child has said: no more than a page, whatever its driver prints.
fn read(pipe: Option<impl Read>) -> String {
    let mut bytes = Vec::new();
    let _ = pipe.map(|pipe| pipe.take(1 << 14).read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).into_owned()
}
