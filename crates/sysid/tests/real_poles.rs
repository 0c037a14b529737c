//! Responses of two modes and a delay, with real poles and without: none is invented, none is missed.

use nalgebra::Complex;
use pigtail_sysid::resonance::{Identified, Record, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Creep and a filter: hertz and share.
type Poles = &'static [(f64, f64)];

fn normal(rng: &mut Pcg64Mcg) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// Frequency, damping, frequency, damping, delay of a stage, and its response from 20 Hz to 1 kHz with noise of 0.3 %, of the magnitude alone where `radial`.
fn made(seed: u64, points: usize, poles: Poles, radial: bool) -> ([f64; 5], Record) {
    let mut rng = Pcg64Mcg::seed_from_u64(91_000 + seed);
    let truth = [
        rng.random_range(120.0..260.0),
        rng.random_range(0.01..0.04),
        rng.random_range(420.0..700.0),
        rng.random_range(0.01..0.03),
        rng.random_range(5e-5..5e-4),
    ];
    let frequency: Vec<f64> = (0..points)
        .map(|k| 20.0 * 50f64.powf(k as f64 / (points - 1) as f64))
        .collect();
    let response: Vec<Complex<f64>> = frequency
        .iter()
        .map(|f| {
            let mode = |own: f64, zeta: f64| {
                Complex::new(1.0 - (f / own).powi(2), 2.0 * zeta * f / own).inv()
            };
            let mut h = mode(truth[0], truth[1]) + 0.2 * mode(truth[2], truth[3]);
            for (pole, share) in poles {
                h += share / Complex::new(1.0, f / pole);
            }
            let late = Complex::from_polar(1.0, -TAU * f * truth[4]);
            let (a, b) = (normal(&mut rng), normal(&mut rng));
            h * late
                * (Complex::new(1.0, 0.0) + 0.003 * Complex::new(a, if radial { 0.0 } else { b }))
        })
        .collect();
    (
        truth,
        Record::new(&frequency, &response, None).expect("points"),
    )
}

const NAMES: [&str; 5] = [
    "frequency_1",
    "damping_1",
    "frequency_2",
    "damping_2",
    "delay",
];

/// How far each parameter is off, in its deviations.
fn off(found: &Identified, truth: &[f64; 5]) -> Vec<f64> {
    let of = |(name, is): (&&str, &f64)| {
        let parameter = found.parameters.iter().find(|p| p.name == *name);
        let known = parameter.and_then(|p| p.known).expect("a value");
        (known.value - is) / known.std_correlated
    };
    NAMES.iter().zip(truth).map(of).collect()
}

#[test]
fn a_response_without_real_poles_gets_none() {
    for seed in 0..3 {
        let (_, record) = made(seed, 200, &[], true);
        let found = identify(&record).expect("modes");
        assert!(
            found.modes == 2 && found.real_poles.is_empty(),
            "{seed}: {:?}",
            found.real_poles
        );
    }
}

#[test]
fn creep_that_is_there_is_found() {
    let (_, record) = made(1, 200, &[(35.0, 0.3)], false);
    let found = identify(&record).expect("modes");
    assert!(
        found.modes == 2 && !found.real_poles.is_empty(),
        "{found:?}"
    );
    let near = |p: &f64| (p / 35.0 - 1.0).abs() < 0.2;
    assert!(found.real_poles.iter().any(near), "{:?}", found.real_poles);
}

mod acceptance {
    use super::*;

    #[test]
    #[ignore = "acceptance: thirty records of two lengths"]
    fn intervals_of_modes_and_delay_hold_the_truth() {
        // Seeds that were not looked at while the criterion was chosen: of 30 from 4000 on one had got a pole while residuals
        // that carry nothing were counted as points.
        const FIRST: u64 = 5000;
        const OF_EACH: u64 = 30;
        for points in [200, 500] {
            let (mut held, mut invented) = ([0; 5], 0);
            for seed in FIRST..FIRST + OF_EACH {
                let (truth, record) = made(seed, points, &[], true);
                let found = identify(&record).expect("modes");
                invented += found.real_poles.len();
                if !found.real_poles.is_empty() {
                    eprintln!("{points}, {seed}: invented {:?}", found.real_poles);
                }
                assert!(found.modes == 2 && found.unknown.is_empty(), "{found:?}");
                let off = off(&found, &truth);
                if off.iter().any(|z| z.abs() > 1.96) {
                    eprintln!("{points}, {seed}: {off:.2?}, poles {:?}", found.real_poles);
                }
                for (held, off) in held.iter_mut().zip(&off) {
                    *held += u64::from(off.abs() < 1.96);
                }
            }
            eprintln!("{points} points: {held:?} of {OF_EACH} held, {invented} poles invented");
            assert!(invented == 0, "{points}: {invented}");
            assert!(
                held.iter().all(|h| 10 * h >= 9 * OF_EACH),
                "{points}: {held:?}"
            );
        }
    }
}
