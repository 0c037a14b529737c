//! The default rig, as a twin and with a guard around it.

// Each test binary uses a part of it.
#![allow(dead_code, reason = "each test binary uses a part of it")]

use pigtail_hal::quantity::Volts;
use pigtail_hal::{Command, Machine, Spec};
use pigtail_machines::Guard;
use pigtail_machines::guard::{Arm, Facet, Geometry};
use pigtail_model::fivebar::FiveBar;
use pigtail_model::frames::{Placement, Point};
use pigtail_model::leadscrew::LeadScrew;
use pigtail_twin::Plant;
use pigtail_twin::Twin;

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm/");

pub(crate) fn read(file: &str) -> String {
    std::fs::read_to_string(format!("{RIG}{file}")).expect("the default rig is there")
}

pub(crate) fn spec() -> Spec {
    Spec::parse("machine.toml", &read("machine.toml")).expect("a good datasheet")
}

pub(crate) fn twin(seed: u64) -> Twin {
    let plant = Plant::parse("plant.toml", &read("plant.toml")).expect("a good plant");
    Twin::new(spec(), &plant, seed).expect("a good plant")
}

/// What the drawings say, as a calibration would.
pub(crate) fn geometry() -> Geometry {
    let arm = |[x, y, z]: [f64; 3], yaw: f64| {
        Arm::new(
            FiveBar::new(40e-3, 45e-3, 72.5e-3).expect("good links"),
            [0.0, 82.5e-3],
            LeadScrew::from_lead(0.635e-3),
            Placement::new(Point::new(x, y, z), yaw),
            7e-6,
        )
        .expect("home is within reach")
    };
    let point = |[x, y, z]: [f64; 3]| Point::new(x, y, z);
    let ports = [
        vec![point([0.0; 3])],
        vec![
            point([200e-6, 0.0, 20.0353e-3]),
            point([-200e-6, 0.0, 19.9647e-3]),
        ],
    ];
    let [input, outputs] = ports;
    let facet = |ports, outward| Facet {
        ports,
        outward,
        stands_out: 10_f64.to_radians().tan(),
        exit: 12.5_f64.to_radians().tan(),
    };
    Geometry {
        arms: [
            arm([-1.5e-3, -2e-3, -4e-3], 0.0),
            arm([1e-3, -2e-3, 24e-3], std::f64::consts::PI),
        ],
        facets: [facet(input, -1.0), facet(outputs, 1.0)],
    }
}

pub(crate) fn guarded(seed: u64) -> Guard<Twin> {
    Guard::new(twin(seed), geometry())
}

/// Piezos at the middle of their range.
pub(crate) fn centred(machine: &dyn Machine) -> Command {
    let middle = Volts(0.5 * machine.spec().micro.voltage);
    Command {
        micro: [[middle; 2]; 2],
        ..Command::IDLE
    }
}
