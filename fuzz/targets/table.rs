//! Tables that a person brings: a power map, and what `identify` reads; and a model of hysteresis. What is
//! read is identified too: a few rows of nonsense must come to an answer or to a refusal.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pigtail_records::hysteresis::ModelFile;
use pigtail_records::columns::Named;
use pigtail_records::{friction, input, resonance, servo, windup};
use pigtail_records::map::{self, Columns};
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    // Longer ones find nothing that short ones do not, and take their time.
    if data.len() > 4000 {
        return;
    }
    let path = std::env::temp_dir().join(format!("pigtail-fuzz-{}.csv", std::process::id()));
    std::fs::write(&path, data).expect("a place for it");
    read(&path);
});

fn read(path: &Path) {
    let named = |name: &str| Named::new(name);
    let _ = ModelFile::read(path);
    for names in [None, Some(["x", "y", "p"].map(str::to_owned))] {
        let columns = Columns {
            names,
            place: None,
            power: None,
            inverted: false,
            step: None,
        };
        let _ = map::read(path, &columns);
    }
    let roles = servo::Roles {
        rate: None,
        time: None,
        reference: None,
        position: named("x"),
        voltage: named("y"),
        injected: None,
    };
    let _ = roles.read(path);
    let roles = friction::Roles {
        rate: None,
        time: None,
        displacement: named("x"),
        force: named("y"),
    };
    if let Ok(record) = roles.read(path) {
        let _ = friction::friction(&record, None, 4, None);
    }
    let roles = windup::Roles {
        rate: None,
        time: None,
        motor: named("x"),
        load: named("y"),
        torque: None,
        ratio: 1.0,
    };
    if let Ok(record) = roles.read(path) {
        let _ = windup::windup(&record, None);
    }
    let roles = resonance::Roles {
        frequency: Some(named("t")),
        magnitude: Some(named("x")),
        phase: Some(named("y")),
        parts: None,
        coherence: None,
    };
    let _ = resonance::resonance(&roles, path);
    let _ = input::read(path, input::Kind::Reference, None);
}
