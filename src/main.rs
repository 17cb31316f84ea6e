//! The `bulbfold` program: turns the result of a command into an exit code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
