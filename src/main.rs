//! The `bulbfold` program: turns the result of a command into an exit code.

mod cli;

/// Tiles come and go by the thousand: an allocator that keeps its pages saves an eighth of a small picture's time.
/// It counts, so that scripts stop where they hold too much.
#[global_allocator]
static ALLOCATOR: bulbfold::memory::Counted<mimalloc::MiMalloc> = bulbfold::memory::Counted(mimalloc::MiMalloc);

fn main() -> std::process::ExitCode {
    silence_device_select();
    bulbfold::memory::with_deep_stack(cli::main)
}

/// Leaves out Mesa's device selection layer where there is no Wayland: it would only complain on stderr, once for each
/// instance, that `XDG_RUNTIME_DIR` is invalid. Who selects a device with it keeps it.
fn silence_device_select() {
    let has_runtime_dir =
        std::env::var_os("XDG_RUNTIME_DIR").is_some_and(|path| std::path::Path::new(&path).is_absolute());
    let is_wanted =
        ["NODEVICE_SELECT", "MESA_VK_DEVICE_SELECT", "DRI_PRIME"].iter().any(|name| std::env::var_os(name).is_some());
    if !has_runtime_dir && !is_wanted {
        // SAFETY: this is the first thing that the program does, so no other thread reads or writes the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
