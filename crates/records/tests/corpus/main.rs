//! Records as other people bring them: mangled, misnamed, half missing. Each is to be right, or refused in words
//! that help; none may be wrong and look right.
//!
//! Every record has a known truth: it is made here, or is a measured one whose published figures are known
//! (`../shared/data`, no part of this repository; where it is missing its cases are left out).

#![expect(
    clippy::needless_for_each,
    reason = "a case is what is done to each row, on one line"
)]

#[path = "coverage.rs"]
mod coverage;
#[path = "everywhere.rs"]
mod everywhere;
#[path = "forces.rs"]
mod forces;
#[path = "friction.rs"]
mod friction;
#[path = "late.rs"]
mod late;
#[path = "map.rs"]
mod map;
#[path = "piezo.rs"]
mod piezo;
#[path = "reader.rs"]
mod reader;
#[path = "renumbered.rs"]
mod renumbered;
#[path = "resonance.rs"]
mod resonance;
#[path = "servo.rs"]
mod servo;
#[path = "servo_cases.rs"]
mod servo_cases;
#[path = "windup.rs"]
mod windup;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// A normal number, nearly.
pub(crate) fn normal(rng: &mut Pcg64Mcg) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// What a case has to come to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Wanted {
    /// Answered, and right.
    Right,
    /// Refused.
    Refused,
    /// One or the other: what the record supports is for the program to say.
    Either,
}
