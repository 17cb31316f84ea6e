//! What `--stats` and `doctor` say where the system refuses executable memory, as service managers and sandboxes do.
#![cfg(all(target_os = "linux", target_arch = "x86_64"))]

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Output;

use super::SMALL;

use crate::support::{bulbfold, folder, pixels, program, stderr};

/// Runs the program with a filter that refuses to make memory executable.
fn refused(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = program(folder);
    let set = || {
        let step = |code, jt, jf, k| libc::sock_filter { code, jt, jf, k };
        let mprotect = libc::SYS_mprotect as u32;
        let mut steps = [
            step(0x20, 0, 0, 0),        // the call's number
            step(0x15, 0, 3, mprotect), // another call: go on
            step(0x20, 0, 0, 32),       // its third argument
            step(0x45, 0, 1, libc::PROT_EXEC as u32),
            step(0x06, 0, 0, libc::SECCOMP_RET_ERRNO | libc::EACCES as u32),
            step(0x06, 0, 0, libc::SECCOMP_RET_ALLOW),
        ];
        let filter = libc::sock_fprog { len: steps.len() as u16, filter: steps.as_mut_ptr() };
        // SAFETY: both calls set rights of this process alone; the filter lives as long as the call that copies it.
        let done = unsafe {
            libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
                && libc::prctl(libc::PR_SET_SECCOMP, 2, &raw const filter, 0, 0) == 0
        };
        if done { Ok(()) } else { Err(std::io::Error::last_os_error()) }
    };
    // SAFETY: what runs between fork and exec makes two system calls and no more.
    unsafe { command.pre_exec(set) };
    command.args(arguments).output().expect("a filter can be set")
}

#[test]
fn who_interprets_says_so() {
    let folder = folder();
    let picture = |name| [&["render", "mandelbulb", "--stats", "-o", name][..], &SMALL].concat();
    let free = bulbfold(folder.path(), picture("free.png"));
    if !stderr(&free).contains("machine code for") {
        eprintln!("this processor has no machine code to refuse");
        return;
    }
    let denied = refused(folder.path(), &picture("denied.png"));
    assert!(denied.status.success(), "{}", stderr(&denied));
    assert!(stderr(&denied).contains("interpreted"), "{}", stderr(&denied));
    assert!(stderr(&denied).contains("the system refuses machine code"), "{}", stderr(&denied));
    assert!(!stderr(&denied).contains("machine code for"), "{}", stderr(&denied));
    // The files differ in what they say of their back ends.
    let read = |name: &str| pixels(&folder.path().join(name));
    assert!(read("free.png") == read("denied.png"), "both give the same picture");
    let doctor = refused(folder.path(), &["doctor"]);
    assert!(doctor.status.success(), "{:?}: {}", doctor.status, stderr(&doctor));
    let doctor = String::from_utf8_lossy(&doctor.stdout).into_owned();
    assert!(doctor.contains("the system refuses machine code") && !doctor.contains("machine code for"), "{doctor}");
}

/// A software driver makes code too, and would end the process: it is left alone, whoever asks for it.
#[cfg(feature = "gpu")]
#[test]
fn software_drivers_are_left_alone() {
    let folder = folder();
    let adapters = bulbfold(folder.path(), ["doctor"]);
    let adapters = String::from_utf8_lossy(&adapters.stdout).into_owned();
    if !adapters.contains("in software") {
        assert!(std::env::var_os("BULBFOLD_REQUIRE_GPU").is_none(), "no software driver: {adapters}");
        eprintln!("there is no software driver that could crash");
        return;
    }
    let picture = [&["render", "mandelbulb", "-oa.png"][..], &SMALL].concat();
    let picture: Vec<&str> = picture.iter().map(|word| if *word == "cpu" { "gpu" } else { word }).collect();
    for arguments in [&picture[..], &["probe", "mandelbulb", "--point", "1,0,0", "--backend", "gpu"]] {
        let output = refused(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {:?} {}", output.status, stderr(&output));
        assert!(stderr(&output).contains("the system refuses the machine code"), "{}", stderr(&output));
    }
}
