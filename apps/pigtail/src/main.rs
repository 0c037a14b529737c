//! The `pigtail` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    pigtail::main()
}
