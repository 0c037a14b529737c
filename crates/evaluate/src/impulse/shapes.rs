//! Which pulse is best (thesis 4.3.4): families of pulses at equal peak voltage, each with what it may
//! choose chosen over the whole uncertainty.
//!
//! A design study. It plays pulses on joints of the rig's *plant* as it is written, whose friction and
//! state at rest are drawn as the thesis assumes them; no machine could be asked so many times. What
//! it finds are shapes, nothing that control believes: what a shape does on a machine is measured
//! there, through the probe ([`super::contest`]).

use super::response::joint_plant;
use super::waveform::{Family, Waveform};
use pigtail_control::impulse::experiment::MOVES;
use pigtail_hal::{Axis, AxisName, Error};
use pigtail_model::Invalid;
use pigtail_model::friction::Mode;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_numerics::bisection::onset;
use pigtail_numerics::statistics::Sorted;
use pigtail_session::characterize::no_probe;
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use pigtail_session::setup::unfit;
use pigtail_twin::plant::{JointPlant, LoadLaw};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// The highest `a_1` of the thesis's Fig. 4.17, in units of the motor's static friction, and the
/// length of its pulses, seconds.
const THESIS_MOST: f64 = 5.0;
const THESIS_PERIOD: f64 = 1e-3;
/// The longest that is tried, seconds.
const LONGEST: f64 = 3e-3;

/// Relative standard deviation of the friction of motor and load, each; share of an encoder count by
/// which the motor is displaced at rest (4.3.2).
const FRICTION: f64 = 0.1;
const STATE: f64 = 0.1;
/// Displacements at which shapes are compared, as shares of the most that the thesis's pulse does.
const COMPARED: [f64; 3] = [0.05, 1.0 / 6.0, 0.5];
/// Amplitudes at which it is looked whether a response rises.
const GRID: usize = 16;
/// A joint is watched for so long after a pulse, in steps of so much, seconds.
const WATCHED: f64 = 0.03;
const STEP: f64 = 5e-5;
/// Steps of the pulse itself, seconds.
const FINE: f64 = 2.5e-5;

/// Weights of what a shape is judged by beside spread and dead zone: what it moves at least, over the smallest displacement of [`COMPARED`], and its vibration, over the middle one.
const LEAST: f64 = 0.5;
const VIBRATION: f64 = 0.25;
/// What a shape is worth that cannot reach the displacements.
const OUT_OF_REACH: f64 = 1e3;

/// How much work goes into a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Machines to choose by; each plays in both directions.
    pub machines: usize,
    /// Other machines to judge by.
    pub judges: usize,
    /// Generations of a search.
    pub generations: usize,
    /// Its members for each number that is chosen.
    pub members: usize,
}

impl Effort {
    /// Enough for searches of other seeds to find shapes that are as good.
    pub const FULL: Self = Self {
        machines: 16,
        judges: 150,
        generations: 24,
        members: 6,
    };
}

/// A shape and what it is worth, by machines that it was not chosen by.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// What it is called.
    pub name: &'static str,
    /// All of it but `a_1`; volts of the nominal joint.
    pub wave: Waveform,
    /// The `a_1` that moves the nominal joint as far as the thesis's pulse does at most, or the highest
    /// at the peak voltage, volts.
    pub most: f64,
    /// What it is worth.
    pub merit: Merit,
}

impl Judged {
    /// The pulse at the middle displacement, in so many steps: seconds and volts.
    pub fn played(&self, steps: u32) -> impl Iterator<Item = (f64, f64)> {
        let wave = self.wave.with(self.merit.amplitude);
        (0..=steps).map(move |k| {
            let time = wave.period * f64::from(k) / f64::from(steps);
            (time, wave.voltage(time))
        })
    }
}

/// What a shape is worth; lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Merit {
    /// The `a_1` that moves the nominal joint by the middle of the compared displacements, volts.
    pub amplitude: f64,
    /// From the 10th to the 90th percentile of the displacements over the machines, where the nominal
    /// one is displaced by each of the compared displacements.
    pub spread: [f64; 3],
    /// `a_1` with which nine of ten machines move, volts.
    pub dead_zone: f64,
    /// Displacement without any `a_1`, which none of nine tenths of the machines exceeds.
    pub least: f64,
    /// How far the transmission swings after the pulse once it has come to the twist that it keeps, as
    /// a way of the output: nine tenths of the machines swing less, at the middle displacement. The
    /// output itself, held by friction, does not swing back.
    pub vibration: f64,
    /// Until motor and load are at rest from the pulse's beginning, likewise, seconds.
    pub rest: f64,
    /// Displacement of the nominal machine by the highest `a_1`.
    pub reach: f64,
    /// The sum that is made small: spread over displacement, dead zone over the `a_1` of the middle
    /// displacement, least and vibration over displacement by their weights.
    pub cost: f64,
}

/// A study of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The motor's static friction as a voltage, volts.
    pub unit: f64,
    /// The voltage that all shapes peak at, volts.
    pub peak: f64,
    /// The displacements at which they are compared, metres.
    pub compared: [f64; 3],
    /// The shapes, the thesis's first.
    pub shapes: Vec<Judged>,
}

/// What one search may choose: a family and how many of its harmonics, `a_2` among them.
struct Search {
    name: &'static str,
    family: Family,
    /// Harmonics beside the first.
    harmonics: usize,
    /// Shortest length for an amplifier's bandwidth, seconds times hertz.
    turns: f64,
}

/// Rectangles and bumps contain all frequencies, and are given as much time as the two sines.
const SEARCHES: [Search; 6] = [
    Search {
        name: "two sines",
        family: Family::Sines,
        harmonics: 1,
        turns: 1.0,
    },
    Search {
        name: "three sines",
        family: Family::Sines,
        harmonics: 2,
        turns: 1.5,
    },
    Search {
        name: "four sines",
        family: Family::Sines,
        harmonics: 3,
        turns: 2.0,
    },
    Search {
        name: "rectangles",
        family: Family::Rectangles,
        harmonics: 1,
        turns: 1.0,
    },
    Search {
        name: "raised cosines",
        family: Family::Bumps,
        harmonics: 1,
        turns: 1.0,
    },
    Search {
        name: "radial basis functions",
        family: Family::Gaussians,
        harmonics: 3,
        turns: 1.0,
    },
];

/// Compares shapes on an axis. The same seed finds the same, whatever the number of threads.
///
/// # Errors
///
/// A rig without probes, or whose plant has a law of load friction that the study does not know.
pub fn study(setup: &Setup, at: AxisName, seed: u64, effort: &Effort) -> Result<Study, Ended> {
    let nominal = Bench::nominal(setup, at.axis)?;
    let unit = nominal.unit;
    let thesis = Waveform {
        family: Family::Sines,
        amplitudes: [0.0, nominal.without_dead_zone(), 0.0, 0.0],
        period: THESIS_PERIOD,
    };
    let peak = thesis.with(THESIS_MOST * unit).peak();
    let most = nominal.middle.play(&thesis.with(THESIS_MOST * unit)).moved;
    let compared = COMPARED.map(|share| share * most);
    let bandwidth = setup
        .rig
        .spec
        .drive(at.axis)
        .pulse
        .map_or(f64::INFINITY, |p| p.bandwidth);
    // Those that judge are others than those by which was chosen.
    let jury = nominal.drawn(effort.judges, seed ^ 0x5eed)?;
    let choosing = nominal.drawn(effort.machines, seed)?;
    let judged = |name, wave: Waveform| {
        let merit = nominal.merit(&jury, &wave, peak, &compared);
        Judged {
            name,
            wave,
            most: nominal.extent(&wave, peak, most),
            merit,
        }
    };
    let mut shapes = vec![judged("thesis", thesis)];
    for (k, search) in SEARCHES.iter().enumerate() {
        let shortest = search.turns / bandwidth;
        let of = |numbers: &[f64]| search.wave(numbers, peak, shortest);
        let begin = search.numbers(&thesis, peak, shortest);
        let cost = |numbers: &[f64]| nominal.merit(&choosing, &of(numbers), peak, &compared).cost;
        let mut rng = Pcg64Mcg::seed_from_u64(seed.wrapping_add(1 + k as u64));
        let best = evolve(&begin, effort, &mut rng, &cost);
        shapes.push(judged(search.name, of(&best)));
    }
    Ok(Study {
        unit,
        peak,
        compared,
        shapes,
    })
}

impl Search {
    /// A shape from numbers between 0 and 1: `a_2` as a share of the peak, the length between its
    /// bounds on a logarithmic scale, the other harmonics as shares of `a_2`.
    fn wave(&self, numbers: &[f64], peak: f64, shortest: f64) -> Waveform {
        let a2 = peak * numbers[0];
        let mut amplitudes = [0.0, a2, 0.0, 0.0];
        for (amplitude, number) in amplitudes[2..].iter_mut().zip(&numbers[2..]) {
            *amplitude = a2 * (2.0 * number - 1.0);
        }
        Waveform {
            family: self.family,
            amplitudes,
            period: shortest * (LONGEST / shortest).powf(numbers[1]),
        }
    }

    /// The thesis's shape as such numbers.
    fn numbers(&self, thesis: &Waveform, peak: f64, shortest: f64) -> Vec<f64> {
        let length = (THESIS_PERIOD / shortest).ln() / (LONGEST / shortest).ln();
        let mut numbers = vec![0.5; 1 + self.harmonics];
        numbers[0] = (thesis.amplitudes[1] / peak).clamp(0.0, 1.0);
        numbers[1] = length.clamp(0.0, 1.0);
        numbers
    }
}

/// Differential evolution (Storn and Price 1997, best/1/bin) of numbers between 0 and 1, from what is
/// known to begin with. Members are judged at once, in an order that threads do not change.
fn evolve(
    begin: &[f64],
    effort: &Effort,
    rng: &mut Pcg64Mcg,
    cost: &(impl Fn(&[f64]) -> f64 + Sync),
) -> Vec<f64> {
    const SCALE: f64 = 0.6;
    const CROSSED: f64 = 0.8;
    let n = begin.len();
    let size = (effort.members * n).max(4);
    let mut members: Vec<Vec<f64>> = vec![begin.to_vec()];
    members.extend((1..size).map(|_| (0..n).map(|_| rng.random::<f64>()).collect()));
    let mut costs: Vec<f64> = members.par_iter().map(|m| cost(m)).collect();
    let best_of = |costs: &[f64]| {
        (0..costs.len())
            .min_by(|&a, &b| costs[a].total_cmp(&costs[b]))
            .unwrap_or(0)
    };
    for _ in 0..effort.generations {
        let best = best_of(&costs);
        let trials: Vec<Vec<f64>> = (0..size)
            .map(|i| {
                let [a, b] = [rng.random_range(0..size), rng.random_range(0..size)];
                let always = rng.random_range(0..n);
                (0..n)
                    .map(|j| {
                        let crossed = rng.random::<f64>() < CROSSED || j == always;
                        let value = if crossed {
                            members[best][j] + SCALE * (members[a][j] - members[b][j])
                        } else {
                            members[i][j]
                        };
                        // Beyond a bound it comes back as from a mirror.
                        let folded = value.rem_euclid(2.0);
                        if folded > 1.0 { 2.0 - folded } else { folded }
                    })
                    .collect()
            })
            .collect();
        let tried: Vec<f64> = trials.par_iter().map(|m| cost(m)).collect();
        for (i, (trial, new)) in trials.into_iter().zip(tried).enumerate() {
            if new <= costs[i] {
                (members[i], costs[i]) = (trial, new);
            }
        }
    }
    members.swap_remove(best_of(&costs))
}

/// A joint in one direction, at rest but for what is not known.
#[derive(Debug, Clone, Copy)]
struct Machine {
    during: Joint,
    after: Joint,
    start: JointState,
    forward: bool,
    /// Metres of the output for a radian.
    arm: f64,
}

/// What a pulse did.
#[derive(Debug, Clone, Copy, Default)]
struct Played {
    /// Displacement in the direction of the pulse, metres.
    moved: f64,
    vibration: f64,
    rest: f64,
}

impl Machine {
    fn new(p: JointParameters, displaced: f64, forward: bool, arm: f64) -> Result<Self, Invalid> {
        let after = Joint::new(p, STEP.min(p.coarsest_step(0.0)))?;
        Ok(Self {
            during: Joint::new(p, FINE.min(p.coarsest_step(0.0)))?,
            after,
            start: JointState {
                motor_angle: p.transmission.twist(-p.load_torque) / p.ratio + displaced,
                ..JointState::default()
            },
            forward,
            arm,
        })
    }

    /// A pulse, and what follows until all is at rest.
    fn play(&self, wave: &Waveform) -> Played {
        let mut state = self.start;
        let wave = if self.forward { *wave } else { wave.reversed() };
        let sign = if self.forward { self.arm } else { -self.arm };
        // What it is displaced by acts before the pulse.
        self.after.resolve(&mut state, 0.0);
        let home = self.after.output(&state);
        wave.play(&self.during, &mut state);
        let mut time = wave.period;
        let mut seen = vec![self.after.twist(&state)];
        let end = time + WATCHED;
        while time < end && (state.motor_mode, state.load_mode) != (Mode::Stuck, Mode::Stuck) {
            self.after.advance(&mut state, 0.0, STEP);
            time += STEP;
            seen.push(self.after.twist(&state));
        }
        let last = self.after.twist(&state);
        let side = (last - seen[0]).signum();
        let there = seen.iter().position(|x| side * (last - x) <= 0.0);
        let swing = seen[there.unwrap_or(0)..]
            .iter()
            .fold((last, last), |(l, h), x| (f64::min(l, *x), f64::max(h, *x)));
        Played {
            moved: sign * (self.after.output(&state) - home),
            vibration: self.arm * (swing.1 - swing.0),
            rest: time,
        }
    }
}

/// The rig's joint, and machines drawn around it.
struct Bench {
    middle: Machine,
    plant: JointPlant,
    ratio: f64,
    arm: f64,
    /// An encoder count at the motor, radians.
    count: f64,
    unit: f64,
}

impl Bench {
    fn nominal(setup: &Setup, axis: Axis) -> Result<Self, Ended> {
        let mut copy = setup.clone();
        let plant = *joint_plant(&mut copy, axis);
        if plant.friction != LoadLaw::CoulombPresliding {
            let key = match axis {
                Axis::A | Axis::B => "five_bar.joint.friction",
                Axis::Z => "z_stage.joint.friction",
            };
            let message = "the study of shapes does not know this law; accepted is \
                           \"coulomb-presliding\"";
            return Err(Error::new(format!("{}/plant.toml", setup.rig.name), key, message).into());
        }
        let arm = match axis {
            Axis::A | Axis::B => {
                setup
                    .rig
                    .spec
                    .probe
                    .as_ref()
                    .ok_or_else(|| no_probe(&setup.rig))?
                    .arm
            }
            Axis::Z => setup.plant.z_stage.lead / TAU,
        };
        let drive = setup.rig.spec.drive(axis);
        let ratio = 1.0 / drive.gear_ratio;
        let parameters = plant.nominal(ratio).map_err(bad)?;
        Ok(Self {
            middle: Machine::new(parameters, 0.0, true, arm).map_err(bad)?,
            unit: parameters.motor_friction.static_level() * plant.motor.resistance
                / plant.motor.torque_constant,
            plant,
            ratio,
            arm,
            count: drive.count(),
        })
    }

    /// The least second harmonic that leaves the nominal joint no dead zone, volts.
    fn without_dead_zone(&self) -> f64 {
        /// Of any that Fig. 4.17 shows.
        const MOST: f64 = 20.0;
        const HALVINGS: u32 = 12;
        let moves = |a2: f64| {
            let wave = Waveform {
                family: Family::Sines,
                amplitudes: [0.0, a2, 0.0, 0.0],
                period: THESIS_PERIOD,
            };
            self.middle.play(&wave).moved > MOVES
        };
        onset((0.0, MOST * self.unit), HALVINGS, moves).1
    }

    /// The `a_1` that moves the nominal joint by `wanted` metres, or the highest at a peak, volts.
    fn extent(&self, wave: &Waveform, peak: f64, wanted: f64) -> f64 {
        const HALVINGS: u32 = 16;
        let most = wave.most(peak).unwrap_or(0.0);
        let far = |a1: f64| self.middle.play(&wave.with(a1)).moved > wanted;
        onset((0.0, most), HALVINGS, far).1
    }

    /// So many machines, each in both directions.
    fn drawn(&self, count: usize, seed: u64) -> Result<Vec<Machine>, Ended> {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut machines = Vec::with_capacity(2 * count);
        for _ in 0..count {
            let [load, motor, state] = [normal(), normal(), normal()];
            let factor = |draw: f64| (1.0 + FRICTION * draw).max(0.1);
            let mut plant = self.plant;
            plant.load_friction = plant.load_friction.times(factor(load)).map_err(bad)?;
            plant.motor_friction = plant.motor_friction.times(factor(motor)).map_err(bad)?;
            let parameters = plant.nominal(self.ratio).map_err(bad)?;
            let displaced = STATE * self.count * state;
            for forward in [true, false] {
                machines.push(Machine::new(parameters, displaced, forward, self.arm).map_err(bad)?);
            }
        }
        Ok(machines)
    }

    /// What a shape is worth on machines.
    fn merit(
        &self,
        machines: &[Machine],
        wave: &Waveform,
        peak: f64,
        compared: &[f64; 3],
    ) -> Merit {
        let out = |reach: f64, lack: f64| Merit {
            amplitude: 0.0,
            spread: [0.0; 3],
            dead_zone: 0.0,
            least: 0.0,
            vibration: 0.0,
            rest: 0.0,
            reach,
            cost: OUT_OF_REACH * (1.0 + lack),
        };
        let Some(most) = wave.most(peak) else {
            return out(0.0, wave.with(0.0).peak() / peak);
        };
        // Denser where pulses are small.
        let grid: Vec<f64> = (0..GRID)
            .map(|k| most * (k as f64 / (GRID - 1) as f64).powf(1.5))
            .collect();
        let nominal: Vec<f64> = grid
            .iter()
            .map(|a1| self.middle.play(&wave.with(*a1)).moved)
            .collect();
        let reach = nominal.iter().copied().fold(0.0, f64::max);
        if nominal[0] >= compared[0] {
            return out(reach, nominal[0] / compared[0]);
        }
        if reach < compared[2] {
            return out(reach, 1.0 - reach / compared[2]);
        }
        let [low, middle, high] = compared.map(|d| self.extent(wave, peak, d));
        let percentile = |mut of: Vec<f64>, share: f64| {
            of.retain(|x| x.is_finite());
            Sorted::new(of).percentile(share).unwrap_or(0.0)
        };
        let at = |a1: f64| -> Vec<Played> {
            let wave = wave.with(a1);
            machines.iter().map(|m| m.play(&wave)).collect()
        };
        let mut spread = [0.0; 3];
        let mut vibration = (0.0, 0.0);
        for (k, a1) in [low, middle, high].into_iter().enumerate() {
            let played = at(a1);
            let moved = || played.iter().map(|p| p.moved).collect::<Vec<f64>>();
            spread[k] = percentile(moved(), 0.9) - percentile(moved(), 0.1);
            if k == 1 {
                let swings = played.iter().map(|p| p.vibration).collect();
                let rests = played.iter().map(|p| p.rest).collect();
                vibration = (percentile(swings, 0.9), percentile(rests, 0.9));
            }
        }
        let least = percentile(at(0.0).iter().map(|p| p.moved.abs()).collect(), 0.9);
        let zones = machines.iter().map(|m| m.dead_zone(wave, most)).collect();
        let dead_zone = percentile(zones, 0.9);
        let relative: f64 = spread.iter().zip(compared).map(|(s, d)| s / d).sum::<f64>() / 3.0;
        // A response that falls again cannot be inverted.
        let fall = falls(&nominal) / compared[2];
        Merit {
            amplitude: middle,
            spread,
            dead_zone,
            least,
            vibration: vibration.0,
            rest: vibration.1,
            reach,
            cost: relative
                + dead_zone / middle
                + LEAST * least / compared[0]
                + VIBRATION * vibration.0 / compared[1]
                + fall,
        }
    }
}

impl Machine {
    /// The least `a_1` that moves the output, volts, to a five-hundredth of `most`.
    fn dead_zone(&self, wave: &Waveform, most: f64) -> f64 {
        const HALVINGS: u32 = 9;
        let moves = |a1: f64| self.play(&wave.with(a1)).moved > MOVES;
        if moves(0.0) {
            return 0.0;
        }
        onset((0.0, most), HALVINGS, moves).1
    }
}

/// By how much a response falls below what it was before.
fn falls(moved: &[f64]) -> f64 {
    let mut highest = f64::NEG_INFINITY;
    moved.iter().fold(0.0, |most: f64, d| {
        highest = highest.max(*d);
        most.max(highest - d)
    })
}

fn bad(invalid: Invalid) -> Ended {
    unfit(invalid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_finds_a_minimum_and_the_same_again() {
        let effort = Effort {
            machines: 0,
            judges: 0,
            generations: 40,
            members: 6,
        };
        let cost = |x: &[f64]| (x[0] - 0.73).powi(2) + 3.0 * (x[1] - 0.2).powi(2);
        let find = || evolve(&[0.5, 0.5], &effort, &mut Pcg64Mcg::seed_from_u64(3), &cost);
        let best = find();
        assert!(
            (best[0] - 0.73).abs() < 1e-3 && (best[1] - 0.2).abs() < 1e-3,
            "{best:?}"
        );
        assert_eq!(best, find());
    }

    #[test]
    fn a_response_that_falls_is_told_by_how_much() {
        assert_eq!(falls(&[0.0, 3.0, 2.0, 4.0]), 1.0);
        assert_eq!(falls(&[0.0, 1.0, 1.0]), 0.0);
    }
}
