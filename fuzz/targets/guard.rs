//! Commands of all kinds to a guarded twin: nothing may touch the chip.

#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use pigtail_session::guarded::guarded;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::{Command, FiberHandling, Machine};
use pigtail_twin::Twin;
use std::sync::LazyLock;

static SETUP: LazyLock<Setup> = LazyLock::new(|| {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is well")
});

/// A command, held for some cycles.
#[derive(Debug, Arbitrary)]
struct Held {
    cycles: u16,
    /// In 32767ths of twice what the datasheet allows...
    motors: [i16; 6],
    /// ...or, where a bit is set, this.
    wild: (u8, f64),
    micro: [u8; 4],
    references: [Option<i32>; 6],
    fiber: [Option<Handling>; 2],
    laser: bool,
    /// Whether a person clears what it has come to.
    clear: bool,
}

#[derive(Debug, Clone, Copy, Arbitrary)]
enum Handling {
    Load(u8),
    Unload,
    Attach,
}

fuzz_target!(|input: (u16, Vec<Held>)| {
    let (seed, commands) = input;
    let (spec, plant) = (SETUP.spec.clone(), &SETUP.plant);
    let twin = Twin::new(spec, plant, u64::from(seed)).expect("a good plant");
    let mut machine = guarded(twin, &SETUP);
    // Some seconds of machine time.
    let mut left = 20_000_u32;
    for held in commands.into_iter().take(64) {
        let volts = [12.0, 12.0, 24.0];
        let mut command = Command {
            laser: held.laser,
            ..Command::IDLE
        };
        for i in 0..6 {
            let (side, axis) = (i / 3, i % 3);
            let share = f64::from(held.motors[i]) / f64::from(i16::MAX);
            let wild = held.wild.0 >> i & 1 == 1 && held.wild.0 >> 6 == 3;
            command.motors[side][axis] = Volts(if wild {
                held.wild.1
            } else {
                (2.0 * share * volts[axis]).clamp(-volts[axis], volts[axis])
            });
            command.references[side][axis] = held.references[i].map(|c| Counts(c.into()));
        }
        for (i, step) in held.micro.into_iter().enumerate() {
            command.micro[i / 2][i % 2] = Volts(f64::from(step) / 25.5);
        }
        command.fiber = held.fiber.map(|handling| {
            Some(match handling? {
                Handling::Load(port) => FiberHandling::Load(port % 3),
                Handling::Unload => FiberHandling::Unload,
                Handling::Attach => FiberHandling::Attach,
            })
        });
        for _ in 0..u32::from(held.cycles % 2000).min(left) {
            left -= 1;
            if machine.exchange(&command).is_err() {
                break;
            }
            command.fiber = [None; 2];
        }
        if held.clear {
            machine.clear();
        }
    }
    let gap = machine.inner().truth().smallest_gap;
    assert!(gap > 0.0, "{gap}");
});
