//! A machine for tests and benches that answers at once, and a calibration with everything in it.

#![allow(dead_code, reason = "no user of this module uses all of it")]

pub(crate) mod foreign;

use pigtail_control::calibration::{Calibration, WindupBelief, WindupModel};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, CHANNELS, SIDES};
use pigtail_hal::{Command, Fault, LightSample, Machine, Measurement, Spec};
use pigtail_model::windup::ELEMENTS;

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm/");

/// A file of the default rig.
pub(crate) fn read(file: &str) -> String {
    std::fs::read_to_string(format!("{RIG}{file}")).expect("the default rig is there")
}

/// The default rig's datasheet.
pub(crate) fn spec() -> Spec {
    Spec::parse("machine.toml", &read("machine.toml")).expect("a good datasheet")
}

/// The default rig's calibration, with windup by all elements on every axis.
pub(crate) fn calibration(spec: &Spec) -> Calibration {
    let mut calibration = Calibration::parse("calibration.toml", &read("calibration.toml"), spec)
        .expect("it is good");
    let belief = WindupBelief {
        model: WindupModel::Memory,
        w_max: 1e-3,
        q: 4e-3,
        hardening: [1e-3, 0.0, -1e-4, 0.0, 0.0],
        elements: (1..=ELEMENTS)
            .map(|i| [1e-4 * i as f64, 1.0 / ELEMENTS as f64])
            .collect(),
        residual: 0.0,
        date: String::new(),
        origin: String::new(),
    };
    calibration.windup.five_bar = Some(belief.clone());
    calibration.windup.z = Some(belief);
    calibration
}

/// Motors whose speed is their voltage, and light that never changes.
pub(crate) struct Obedient {
    spec: Spec,
    cycles: u32,
    cycles_per_sample: u32,
    encoders: [[f64; AXES]; SIDES],
}

impl Obedient {
    /// At home.
    pub(crate) fn new(spec: Spec) -> Self {
        Self {
            cycles: 0,
            cycles_per_sample: (spec.servo.rate / spec.photodiode.rate).round() as u32,
            encoders: [[0.0; AXES]; SIDES],
            spec,
        }
    }
}

impl Machine for Obedient {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        const COUNTS_PER_VOLT: f64 = 0.2;
        for (encoders, motors) in self.encoders.iter_mut().zip(&command.motors) {
            for (encoder, Volts(volts)) in encoders.iter_mut().zip(motors) {
                *encoder += COUNTS_PER_VOLT * volts;
            }
        }
        self.cycles += 1;
        let time = f64::from(self.cycles) * self.spec.period();
        Ok(Measurement {
            time,
            encoders: self.encoders.map(|axes| axes.map(|at| Counts(at as i64))),
            light: self
                .cycles
                .is_multiple_of(self.cycles_per_sample)
                .then_some(LightSample {
                    time,
                    volts: [Volts(1.0); CHANNELS],
                }),
            vision: None,
            probes: None,
            handled: [None; 2],
            stop: false,
        })
    }

    fn stop(&mut self) {}
}

/// The recipe that ships, for the default rig.
pub(crate) fn recipe() -> pigtail_control::recipe::Recipe {
    let text = concat!(env!("CARGO_MANIFEST_DIR"), "/../../recipes/y-branch.toml");
    let text = std::fs::read_to_string(text).expect("the recipe is there");
    let (spec, rig) = (spec(), read("calibration.toml"));
    let calibration = Calibration::parse("calibration.toml", &rig, &spec).expect("it is good");
    pigtail_control::recipe::Recipe::parse("recipe", &text, &spec, &calibration)
        .expect("it is good")
}
