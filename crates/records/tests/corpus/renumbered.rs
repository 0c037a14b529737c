//! Frequency responses of which rows were lost, or written twice, before their frequencies were numbered anew.
//!
//! Everything is drawn anew for each record by its number. `RENUMBERED_FIRST` is the number of the first, for records that nobody has
//! seen, and `RENUMBERED_RECORDS` how many there are.

use crate::normal;
use nalgebra::Complex;
use pigtail_sysid::resonance::{Record, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// What was done to a response's rows, and each how often of eight.
const KINDS: [&str; 8] = [
    "as it is",
    "as it is",
    "as it is, noise that goes with its neighbours'",
    "lost here and there",
    "lost here and there",
    "lost here and there",
    "lost at few places",
    "written twice",
];

struct Drawn {
    kind: &'static str,
    frequency: Vec<f64>,
    response: Vec<Complex<f64>>,
    /// Frequency (Hz) and damping of each mode.
    modes: Vec<[f64; 2]>,
    delay: f64,
}

fn drawn(number: u64) -> Drawn {
    let mut rng = Pcg64Mcg::seed_from_u64(number);
    let kind = KINDS[(number % 8) as usize];
    let n = rng.random_range(200..900_usize);
    let (low, high): (f64, f64) = (
        rng.random_range(20.0..100.0),
        rng.random_range(500.0..2000.0),
    );
    let by_ratio = rng.random_bool(0.3);
    let count = rng.random_range(1..=3);
    let mut modes: Vec<[f64; 3]> = Vec::new();
    while modes.len() < count {
        let own = low * 1.3 * (0.65 * high / low).powf(rng.random::<f64>());
        let zeta = 0.005 * 12_f64.powf(rng.random::<f64>());
        let size = if modes.is_empty() {
            1.0
        } else {
            rng.random_range(0.2..1.0)
        };
        let apart = |m: &[f64; 3]| (own / m[0]).ln().abs() > 0.15 + 2.0 * (m[1] + zeta);
        if own < 0.85 * high && modes.iter().all(apart) {
            modes.push([own, zeta, size]);
        }
    }
    let delay = rng.random_range(0.0..0.3) / high;
    let noise = 0.001 * 20_f64.powf(rng.random::<f64>());
    let share = rng.random_range(0.02..0.1);
    // The true row of each row that is there.
    let mut rows: Vec<usize> = (0..n).collect();
    match kind {
        "lost here and there" => rows.retain(|_| !rng.random_bool(share)),
        "lost at few places" => {
            for _ in 0..rng.random_range(1..=4) {
                let (at, many) = (
                    rng.random_range(0..rows.len() - 30),
                    rng.random_range(1..15),
                );
                rows.drain(at..at + many);
            }
        }
        "written twice" => {
            for _ in 0..rng.random_range(1..=8) {
                let (at, many) = (rng.random_range(0..rows.len() - 30), rng.random_range(1..8));
                let again = rows[at..at + many].to_vec();
                rows.splice(at..at, again);
            }
        }
        _ => {}
    }
    let at = |row: f64| {
        let share = row / (n - 1) as f64;
        if by_ratio {
            low * (high / low).powf(share)
        } else {
            low + (high - low) * share
        }
    };
    // Numbered by the step that is known, or spread over the range.
    let spread = if rng.random_bool(0.5) {
        (n - 1) as f64 / (rows.len() - 1) as f64
    } else {
        1.0
    };
    let slow = kind.ends_with("neighbours'");
    let mut last = [0.0; 2];
    let mut noises: Vec<Complex<f64>> = Vec::new();
    for _ in 0..n {
        for part in &mut last {
            let new = normal(&mut rng);
            *part = if slow { 0.8 * *part + 0.6 * new } else { new };
        }
        noises.push(noise * Complex::new(last[0], last[1]));
    }
    let told = |row: &usize| {
        let f = at(*row as f64);
        let sum: Complex<f64> = modes
            .iter()
            .map(|[own, zeta, size]| {
                size / Complex::new(1.0 - (f / own).powi(2), 2.0 * zeta * f / own)
            })
            .sum();
        sum * Complex::from_polar(1.0, -TAU * f * delay) * (1.0 + noises[*row])
    };
    Drawn {
        kind,
        frequency: (0..rows.len()).map(|k| at(k as f64 * spread)).collect(),
        response: rows.iter().map(told).collect(),
        modes: modes.iter().map(|m| [m[0], m[1]]).collect(),
        delay,
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Verdict {
    Right,
    Wrong,
    Refused,
}

/// Wrong is what is off by more than 2.6 of its deviations, once in a hundred times chance, and by so much that it matters: a frequency by 0.3 %, a damping by
/// 5 %, a delay by a twentieth of a radian at the highest frequency.
fn judged(number: u64) -> (&'static str, Verdict, String) {
    let drawn = drawn(number);
    let record = Record::new(&drawn.frequency, &drawn.response, None);
    let found = match record.and_then(|r| identify(&r)) {
        Ok(found) => found,
        Err(why) => return (drawn.kind, Verdict::Refused, why.because),
    };
    if let Some(why) = found.unknown.first() {
        return (drawn.kind, Verdict::Refused, why.because.clone());
    }
    let mut off = Vec::new();
    let mut ask = |name: &str, truth: f64, matters: f64| {
        let known = found.parameters.iter().find(|p| p.name == name);
        let Some(known) = known.and_then(|p| p.known) else {
            return;
        };
        let far = (known.value - truth).abs();
        if far > 2.6 * known.std_correlated && far > matters {
            let (value, std) = (known.value, known.std_correlated);
            off.push(format!("{name} {value:.4e} +- {std:.1e} for {truth:.4e}"));
        }
    };
    for (k, [f, z]) in pigtail_sysid::resonance::NAMES.iter().enumerate() {
        let of = |p: &&pigtail_sysid::Parameter| p.name == *f;
        let Some(own) = found.parameters.iter().find(of).and_then(|p| p.known) else {
            continue;
        };
        let far = |m: &&[f64; 2]| (own.value - m[0]).abs();
        let nearest = drawn.modes.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
        let [frequency, damping] = nearest.expect("a mode");
        debug_assert!(k < 6);
        ask(f, *frequency, 0.003 * frequency);
        ask(z, *damping, 0.05 * damping);
    }
    ask(
        "delay",
        drawn.delay,
        0.05 / (TAU * drawn.frequency.last().expect("a row")),
    );
    let words = format!(
        "{} modes of {}: {}",
        found.modes,
        drawn.modes.len(),
        off.join(", ")
    );
    let verdict = if off.is_empty() {
        Verdict::Right
    } else {
        Verdict::Wrong
    };
    (drawn.kind, verdict, words)
}

#[test]
#[ignore = "long: seconds for each of many records"]
fn numbered_anew() {
    let from = |name: &str, usual: u64| {
        std::env::var(name).map_or(usual, |n| n.parse().expect("a number"))
    };
    let (first, count) = (
        from("RENUMBERED_FIRST", 1_000_000),
        from("RENUMBERED_RECORDS", 160),
    );
    let next = AtomicU64::new(first);
    let all: Mutex<BTreeMap<&str, BTreeMap<Verdict, u64>>> = Mutex::default();
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= first + count {
                        return;
                    }
                    let (kind, verdict, words) = judged(number);
                    eprintln!("{verdict:?} {number} {kind}: {words}");
                    let mut all = all.lock().expect("nobody panics with it");
                    *all.entry(kind).or_default().entry(verdict).or_default() += 1;
                }
            });
        }
    });
    let all = all.into_inner().expect("nobody panicked with it");
    for (kind, verdicts) in &all {
        eprintln!("{kind}: {verdicts:?}");
    }
    let of = |kind: &str, verdict: Verdict| -> u64 {
        let kinds = all.iter().filter(|(k, _)| k.starts_with(kind));
        kinds.filter_map(|(_, v)| v.get(&verdict)).sum()
    };
    // Of numbers that are as sure as said five of a response are off so far once in twenty times.
    assert!(20 * of("", Verdict::Wrong) <= count, "{all:?}");
    assert!(
        of("as it is", Verdict::Right) > of("as it is", Verdict::Refused),
        "{all:?}"
    );
}
