//! Drivers of GPUs that crash or hang when they are opened: nobody asked for them, so the picture is made on the CPU.

use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Builds a Vulkan driver whose first function does this, and gives the file that names it.
fn fake_driver(folder: &Path, body: &str) -> std::path::PathBuf {
    let source = format!(
        "#include <stdlib.h>\n#include <unistd.h>\n\
         void *vk_icdGetInstanceProcAddr(void *instance, const char *name) {{ {body} return 0; }}\n\
         void *vk_icdGetPhysicalDeviceProcAddr(void *instance, const char *name) {{ {body} return 0; }}\n\
         int vk_icdNegotiateLoaderICDInterfaceVersion(unsigned *version) {{ {body} return 0; }}\n"
    );
    std::fs::write(folder.join("fake.c"), source).expect("a file");
    let compiler =
        Command::new("gcc").current_dir(folder).args(["-shared", "-fPIC", "-o", "libfake.so", "fake.c"]).status();
    assert!(compiler.expect("gcc starts").success(), "gcc makes a shared library");
    let library = folder.join("libfake.so").display().to_string();
    let manifest = format!(
        "{{\"file_format_version\": \"1.0.0\", \"ICD\": {{\"library_path\": {library:?}, \"api_version\": \"1.3.0\"}}}}"
    );
    let file = folder.join("fake.json");
    std::fs::write(&file, manifest).expect("a file");
    file
}

fn bulbfold(folder: &Path, driver: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bulbfold"));
    command.current_dir(folder).env("NODEVICE_SELECT", "1").env("BULBFOLD_CACHE", "").env("VK_DRIVER_FILES", driver);
    command.args(arguments).output().expect("the program starts")
}

const RENDER: [&str; 9] = ["render", "mandelbox", "--size", "8x6", "--samples", "1", "--calibrate", "off", "-oout.png"];

#[test]
fn a_crashing_driver_ends_no_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let driver = fake_driver(folder.path(), "abort();");
    let output = bulbfold(folder.path(), &driver, &RENDER);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && folder.path().join("out.png").exists(), "{:?}: {said}", output.status);
    assert!(said.contains("crashes") && said.contains("the CPU takes over"), "{said}");
    let output = bulbfold(folder.path(), &driver, &["doctor"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("FAIL     gpu") && said.contains("crashes") && said.contains("PASS     mandelbox"), "{said}");
}

#[test]
fn a_hanging_driver_is_left_after_a_while() {
    let folder = tempfile::tempdir().expect("a folder");
    let driver = fake_driver(folder.path(), "sleep(1000);");
    let begun = Instant::now();
    let output = bulbfold(folder.path(), &driver, &RENDER);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && folder.path().join("out.png").exists(), "{:?}: {said}", output.status);
    assert!(said.contains("does not answer") && said.contains("the CPU takes over"), "{said}");
    assert!(begun.elapsed() < Duration::from_secs(500), "the driver's sleep was waited for");
}
