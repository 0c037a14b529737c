//! What surrounds the mechanics while they move: a floor that vibrates, and voltages that come late.

use super::plant::FloorPlant;
use super::sensors::normal;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{AXES, MICRO_AXES, SIDES};
use pigtail_hal::{Command, Pulse};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Vibration of both holders: noise in a band between two corners of the first order.
#[derive(Debug, Clone)]
pub(super) struct Floor {
    /// What is left of the old after a cycle, of both corners.
    decay: [f64; 2],
    /// What white noise of one is to be multiplied with, metres.
    kick: [f64; 3],
    low: [[f64; 3]; SIDES],
    high: [[f64; 3]; SIDES],
    rng: Pcg64Mcg,
}

impl Floor {
    /// One that vibrates; `None` for one that stands still.
    pub(super) fn new(plant: &FloorPlant, period: f64, seed: u64) -> Option<Self> {
        if plant.rms == [0.0; 3] {
            return None;
        }
        let [a, b] = [plant.low, plant.high].map(|corner| (-TAU * corner * period).exp());
        // Variance of the difference of two first-order filters of one white noise.
        let variance = (1.0 - a) / (1.0 + a) + (1.0 - b) / (1.0 + b)
            - 2.0 * (1.0 - a) * (1.0 - b) / (1.0 - a * b);
        let scale = variance.sqrt().recip();
        Some(Self {
            decay: [a, b],
            kick: plant.rms.map(|rms| rms * scale),
            low: Default::default(),
            high: Default::default(),
            rng: Pcg64Mcg::seed_from_u64(seed),
        })
    }

    /// Where one cycle brings both holders, metres.
    pub(super) fn next(&mut self) -> [[f64; 3]; SIDES] {
        let [a, b] = self.decay;
        let mut at = [[0.0; 3]; SIDES];
        for (side, at) in at.iter_mut().enumerate() {
            for (axis, at) in at.iter_mut().enumerate() {
                let white = self.kick[axis] * normal(&mut self.rng);
                let (low, high) = (&mut self.low[side][axis], &mut self.high[side][axis]);
                *low = white + a * (*low - white);
                *high = white + b * (*high - white);
                *at = *high - *low;
            }
        }
        at
    }
}

/// Voltages of one cycle.
type Voltages = (
    [[Volts; AXES]; SIDES],
    [[Option<Pulse>; AXES]; SIDES],
    [[Volts; MICRO_AXES]; SIDES],
);

/// Voltages on their way to motors and piezos.
#[derive(Debug, Clone)]
pub(super) struct Late(VecDeque<Voltages>);

impl Late {
    /// By so many cycles; `None` by none.
    pub(super) fn new(cycles: usize) -> Option<Self> {
        let idle = || {
            let Command {
                motors,
                pulses,
                micro,
                ..
            } = Command::IDLE;
            (motors, pulses, micro)
        };
        (cycles > 0).then(|| Self((0..cycles).map(|_| idle()).collect()))
    }

    /// The command that arrives when this one is given.
    pub(super) fn arriving(&mut self, command: &Command) -> Command {
        let mut arriving = *command;
        let given = (command.motors, command.pulses, command.micro);
        self.0.push_back(given);
        if let Some((motors, pulses, micro)) = self.0.pop_front() {
            (arriving.motors, arriving.pulses, arriving.micro) = (motors, pulses, micro);
        }
        arriving
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_floor_vibrates_as_much_as_it_should_and_in_its_band() {
        let plant = FloorPlant {
            rms: [1e-7, 2e-7, 0.0],
            ..FloorPlant::default()
        };
        let mut floor = Floor::new(&plant, 4e-4, 3).expect("it vibrates");
        let path: Vec<_> = (0..250_000).map(|_| floor.next()[1]).collect();
        let rms = |axis: usize| {
            let squares: f64 = path.iter().map(|at| at[axis] * at[axis]).sum();
            (squares / path.len() as f64).sqrt()
        };
        assert!((rms(0) / 1e-7 - 1.0).abs() < 0.05, "{}", rms(0));
        assert!((rms(1) / 2e-7 - 1.0).abs() < 0.05, "{}", rms(1));
        assert_eq!(rms(2), 0.0);
        // Means over a second know nothing of what lies above 10 Hz.
        let slow: f64 = path
            .chunks(2500)
            .map(|second| (second.iter().map(|at| at[0]).sum::<f64>() / 2500.0).powi(2))
            .sum::<f64>()
            / 100.0;
        assert!(slow.sqrt() < 5e-9, "{}", slow.sqrt());
        assert!(Floor::new(&FloorPlant::default(), 4e-4, 3).is_none());
    }

    #[test]
    fn voltages_arrive_late_and_the_rest_at_once() {
        let mut late = Late::new(2).expect("by two cycles");
        let mut command = Command {
            laser: true,
            ..Command::IDLE
        };
        for k in 1..5 {
            command.motors[1][2] = Volts(f64::from(k));
            let arriving = late.arriving(&command);
            assert!(arriving.laser);
            assert_eq!(arriving.motors[1][2], Volts(f64::from((k - 2).max(0))));
        }
        assert!(Late::new(0).is_none());
    }
}
