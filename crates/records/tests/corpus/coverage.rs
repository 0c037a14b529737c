//! Whether 95 % intervals hold the truth in 95 % of records of each kind that a model covers.
//!
//! What each record said is kept, a line each, in the file that `COVERAGE_ROWS` names, and a run that was interrupted
//! goes on from there. `COVERAGE_KINDS` names some of the kinds, `COVERAGE_FIRST` the number of the first record of each, for
//! records that nobody has seen.

use crate::normal;
use crate::servo::{PERIOD, Rows, SLED, follows, read_at, sled, there_and_back};
use nalgebra::Complex;
use pigtail_model::frames::Displacement;
use pigtail_model::windup::{Reversal, ReversalState};
use pigtail_numerics::signal::between;
use pigtail_numerics::statistics::exact;
use pigtail_sysid::servo::{Friction, Method, Record, Settings, identify};
use pigtail_sysid::{Known, friction, map, resonance, timeline, windup};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Records of a kind.
struct Kind {
    name: &'static str,
    /// What is asked of each.
    parameters: &'static [&'static str],
    said: fn(&str, u64) -> Said,
}

const SERVO: &[&str] = &["inertia", "viscous", "Coulomb"];
const FRICTION: &[&str] = &["static friction", "presliding", "offset"];
const WINDUP: &[&str] = &["skew", "w_max", "q", "compliance"];
const RESONANCE: &[&str] = &["frequency", "damping", "frequency", "damping", "delay"];

const fn kind(
    name: &'static str,
    parameters: &'static [&'static str],
    said: fn(&str, u64) -> Said,
) -> Kind {
    Kind {
        name,
        parameters,
        said,
    }
}

/// Of the whole map, then of the search's readings alone.
const MAP: &[&str] = &["x", "y", "x searched", "y searched"];

const KINDS: [Kind; 18] = [
    kind("plain", SERVO, servo),
    kind("jitter", SERVO, servo),
    kind("coloured", SERVO, servo),
    kind("skew", SERVO, servo),
    kind("drift", SERVO, servo),
    kind("held-drift", SERVO, servo),
    kind("noisy", SERVO, servo),
    kind("moves", SERVO, servo),
    kind("friction", FRICTION, friction),
    kind("friction-coloured", FRICTION, friction),
    kind("friction-skew", FRICTION, friction),
    kind("windup", WINDUP, windup),
    kind("windup-jitter", WINDUP, windup),
    kind("windup-coloured", WINDUP, windup),
    kind("resonance", RESONANCE, resonance),
    kind("resonance-coloured", RESONANCE, resonance),
    kind("map", MAP, power_map),
    kind("map-tilted", MAP, power_map),
];

/// Noise that forgets itself within a hundred samples, of about this size.
fn coloured(n: usize, size: f64, rng: &mut Pcg64Mcg) -> Vec<f64> {
    let mut slow = 0.0;
    (0..n)
        .map(|_| {
            slow = 0.99 * slow + 0.14 * size * normal(rng);
            slow
        })
        .collect()
}

/// A servo's record of a kind by its number.
fn of_kind(kind: &str, seed: u64) -> Rows {
    let mut rng = Pcg64Mcg::seed_from_u64(7000 + seed);
    let dense = if kind == "moves" {
        let long = rng.random_range(1.9..3.0);
        follows(&mut rng, 12.0, |t| there_and_back(t, long), |_| 0.0)
    } else {
        sled(20_000 + seed, 12.0)
    };
    let times: Vec<f64> = (0..12_000).map(|k| f64::from(k) * PERIOD).collect();
    let mut rows = read_at(&dense, &times, &times, seed);
    // A column as an instrument reads it that looks at other moments.
    let mut elsewhere = |column: usize, moment: &dyn Fn(f64) -> f64| {
        let moments: Vec<f64> = times.iter().map(|t| moment(*t)).collect();
        let other = read_at(&dense, &moments, &moments, seed);
        for (row, other) in rows.iter_mut().zip(other) {
            row[column] = other[column];
        }
    };
    match kind {
        "skew" => {
            let late = PERIOD * rng.random_range(-3.0..3.0);
            elsewhere(2, &|t| t - late);
        }
        "drift" => elsewhere(2, &|t| t * (1.0 - 1e-4)),
        "held-drift" => elsewhere(3, &|t| t * (1.0 - 1e-4)),
        "jitter" => {
            for row in &mut rows {
                row[0] += PERIOD * rng.random_range(-0.3..0.3);
            }
        }
        "coloured" => {
            for (row, slow) in rows.iter_mut().zip(coloured(12_000, 0.143, &mut rng)) {
                row[3] += slow;
            }
        }
        "noisy" => {
            for row in &mut rows {
                row[2] += 3e-6 * normal(&mut rng);
            }
        }
        _ => {}
    }
    rows
}

/// What a record said: its method or model, and of each parameter by how much it was off, its deviation, and the one that
/// white noise would have. None of one that was refused, or answered by another model than its own.
#[derive(Debug, Clone, Default)]
struct Said {
    method: String,
    of: Vec<[f64; 3]>,
}

/// What an answer is off by.
fn said(method: &str, known: impl IntoIterator<Item = (Option<Known>, f64)>) -> Said {
    let of = known.into_iter().filter_map(|(known, is)| {
        let known = known?;
        Some([known.value - is, known.std_correlated, known.std])
    });
    Said {
        method: method.to_owned(),
        of: of.collect(),
    }
}

fn servo(kind: &str, seed: u64) -> Said {
    let rows = of_kind(kind, seed);
    let column = |c: usize| -> Vec<f64> { rows.iter().map(|r| r[c]).collect() };
    let columns = [&column(2)[..], &column(3), &column(1)];
    let even = timeline::even(&column(0), &columns).expect("an even grid");
    let record = Record::new(even, true);
    let Ok(found) = identify(&record, None, &Settings::new(SLED.force_per_volt)) else {
        return Said::default();
    };
    let Some(variant) = found.variant(Friction::Symmetric, found.supported) else {
        return Said::default();
    };
    let truth = [SLED.inertia, SLED.viscous[0], SLED.coulomb[0]];
    let method = match variant.method {
        Method::Delayed => "delayed",
        _ => "plain",
    };
    said(
        method,
        variant.parameters.iter().map(|p| p.known).zip(truth),
    )
}

/// A contact that gives way evenly and slides, its force and displacement read with noise.
fn friction(kind: &str, seed: u64) -> Said {
    const N: usize = 4000;
    const PERIOD: f64 = 0.01;
    const TRUTH: [f64; 3] = [2.0, 1.4e-5, 0.1];
    let mut rng = Pcg64Mcg::seed_from_u64(31_000 + seed);
    let (phase, pace) = (rng.random_range(0.0..6.0), rng.random_range(0.8..1.4));
    let place =
        |t: f64| 6e-5 * (pace * t + phase + 0.8 * (0.31 * t).sin()).sin() + 2e-5 * (0.37 * t).sin();
    let fine = 10;
    let (mut contact, mut last) = (0.0_f64, place(0.0));
    let [level, way, offset] = TRUTH;
    let force: Vec<f64> = (0..N * fine)
        .map(|k| {
            let x = place(PERIOD * k as f64 / fine as f64);
            contact = (contact + x - last).clamp(-way, way);
            last = x;
            level * contact / way + offset
        })
        .collect();
    let late = match kind {
        "friction-skew" => rng.random_range(-5.0..5.0),
        _ => 0.0,
    };
    let time: Vec<f64> = (0..N).map(|k| PERIOD * k as f64).collect();
    let x: Vec<f64> = time
        .iter()
        .map(|t| place(*t) + 2e-8 * normal(&mut rng))
        .collect();
    let slow = match kind {
        "friction-coloured" => coloured(N, 0.03, &mut rng),
        _ => vec![0.0; N],
    };
    let read = |k: usize| {
        let at = ((k as f64 - late) * fine as f64).clamp(0.0, (N * fine - 2) as f64);
        let i = at as usize;
        force[i] + (at - i as f64) * (force[i + 1] - force[i])
    };
    let f: Vec<f64> = (0..N)
        .map(|k| read(k) + slow[k] + 0.01 * normal(&mut rng))
        .collect();
    let record = friction::Record::new(Some(&time), &x, &f);
    let Ok(found) = record.and_then(|r| friction::identify(&r, None, 3)) else {
        return Said::default();
    };
    let law = found.laws[found.best].law;
    if law != friction::Law::Presliding {
        return said(law.name(), None);
    }
    said(
        law.name(),
        found.parameters.iter().map(|p| p.known).zip(TRUTH),
    )
}

/// A transmission with the windup of (2.20), a compliance and a skew.
fn windup(kind: &str, seed: u64) -> Said {
    const N: usize = 4000;
    const PERIOD: f64 = 4e-3;
    const NOISE: f64 = 2e-6;
    let mut rng = Pcg64Mcg::seed_from_u64(47_000 + seed);
    let phase: [f64; 4] = std::array::from_fn(|_| rng.random_range(0.0..6.0));
    let skew = rng.random_range(-4e-3..4e-3);
    let truth = [skew, 2e-4, 0.03, 1.4e-5];
    let [_, maximum, way, compliance] = truth;
    let place = |t: f64| {
        0.35 * (1.1 * t + phase[0]).sin()
            + 0.1 * (2.9 * t + phase[1]).sin()
            + 0.026 * (7.0 * t + phase[2]).sin()
    };
    let pull = |t: f64| 12.0 * (1.3 * t + phase[3]).sin() + 6.0 * (4.1 * t).cos();
    let model = Reversal { maximum, way };
    let mut state = ReversalState::default();
    model.next(&mut state, 0.0);
    let fine = 8;
    let before = 8;
    let start = place(-PERIOD * before as f64);
    let dense: Vec<f64> = (0..(N + 2 * before) * fine)
        .map(|k| {
            let t = PERIOD * (k as f64 / fine as f64 - before as f64);
            let q = place(t);
            q - model.next(&mut state, q - start) - compliance * pull(t)
        })
        .collect();
    let slow = match kind {
        "windup-coloured" => coloured(N, 4.0 * NOISE, &mut rng),
        _ => vec![0.0; N],
    };
    let mut time: Vec<f64> = (0..N).map(|k| PERIOD * k as f64).collect();
    let motor: Vec<f64> = time
        .iter()
        .map(|t| place(*t) + NOISE * normal(&mut rng))
        .collect();
    let load: Vec<f64> = (0..N)
        .map(|k| {
            let at = (k + before) as f64 - skew / PERIOD;
            between(&dense, at * fine as f64) + slow[k] + NOISE * normal(&mut rng)
        })
        .collect();
    let torque: Vec<f64> = time.iter().map(|t| pull(*t)).collect();
    if kind == "windup-jitter" {
        for t in &mut time {
            *t += PERIOD * rng.random_range(-0.3..0.3);
        }
    }
    let even = timeline::even(&time, &[&motor, &load, &torque]).expect("an even grid");
    let Ok(found) = windup::identify(&windup::Record::new(even, true), None) else {
        return Said::default();
    };
    let parts = found.models[found.best].parts;
    let name = found.models[found.best].name.replace(", ", "+");
    if !parts.reversal || !parts.compliance {
        return said(&name, None);
    }
    let known = |name: &str| {
        let of = found.parameters.iter().find(|p| p.name == name);
        of.and_then(|p| p.known)
    };
    let names = ["time_skew", "w_max", "q", "compliance"];
    said(&name, names.map(known).into_iter().zip(truth))
}

/// Two modes and a delay.
fn resonance(kind: &str, seed: u64) -> Said {
    const N: usize = 160;
    let mut rng = Pcg64Mcg::seed_from_u64(59_000 + seed);
    let modes = [
        [
            rng.random_range(200.0..400.0),
            rng.random_range(0.01..0.03),
            1.0,
        ],
        [
            rng.random_range(600.0..900.0),
            rng.random_range(0.01..0.03),
            0.3,
        ],
    ];
    let delay = rng.random_range(2e-5..2e-4);
    let slow = |rng: &mut Pcg64Mcg| -> Vec<f64> {
        let mut last = 0.0;
        let next = |_| {
            last = 0.8 * last + 0.6 * normal(rng);
            last
        };
        (0..N).map(next).collect()
    };
    let noise = match kind {
        "resonance-coloured" => [slow(&mut rng), slow(&mut rng)],
        _ => [(); 2].map(|()| (0..N).map(|_| normal(&mut rng)).collect()),
    };
    let frequency: Vec<f64> = (0..N)
        .map(|k| 100.0 * 15f64.powf(k as f64 / (N - 1) as f64))
        .collect();
    let response: Vec<Complex<f64>> = frequency
        .iter()
        .enumerate()
        .map(|(k, f)| {
            let mut h = Complex::new(0.0, 0.0);
            for [own, zeta, size] in modes {
                h += size / Complex::new(1.0 - (f / own).powi(2), 2.0 * zeta * f / own);
            }
            h *= Complex::from_polar(1.0, -TAU * f * delay);
            h + 0.01 * h.norm() * Complex::new(noise[0][k], noise[1][k])
        })
        .collect();
    let record = resonance::Record::new(&frequency, &response, None);
    let Ok(found) = record.and_then(|r| resonance::identify(&r)) else {
        return Said::default();
    };
    if found.modes != 2 || !found.real_poles.is_empty() {
        return said(&format!("{}+{}", found.modes, found.real_poles.len()), None);
    }
    let truth = [modes[0][0], modes[0][1], modes[1][0], modes[1][1], delay];
    said("2", found.parameters.iter().map(|p| p.known).zip(truth))
}

/// A round peak, or an ellipse on a slope, on a grid of 21 by 21 places; by its readings, for what may have changed while they were
/// taken is a choice.
fn power_map(kind: &str, seed: u64) -> Said {
    const SIDE: u32 = 21;
    let mut rng = Pcg64Mcg::seed_from_u64(83_000 + seed);
    let tilted = kind == "map-tilted";
    let step = 1e-6;
    let middle = 0.5 * step * f64::from(SIDE - 1);
    let mut place = || middle + step * rng.random_range(-4.0..4.0);
    let peak = Displacement::new(place(), place());
    let (radius, noise) = (
        rng.random_range(2.5..5.0) * step,
        rng.random_range(0.003..0.03),
    );
    let long = if tilted {
        rng.random_range(1.1..2.0)
    } else {
        1.0
    };
    let (sin, cos) = if tilted {
        rng.random_range(0.0..TAU).sin_cos()
    } else {
        (0.0, 1.0)
    };
    let slope = if tilted {
        rng.random_range(-0.2..0.2)
    } else {
        0.0
    };
    let readings = (0..SIDE * SIDE).map(|k| {
        let at = Displacement::new(step * f64::from(k % SIDE), step * f64::from(k / SIDE));
        let off = at - peak;
        let (u, v) = (
            cos * off.x + sin * off.y,
            (cos * off.y - sin * off.x) / long,
        );
        let light = (-(u * u + v * v) / (radius * radius)).exp();
        let power = 0.1 + slope * at.x / middle + light + noise * normal(&mut rng);
        map::Reading { at, power }
    });
    let scan = map::Scan::new(readings.collect()).expect("readings over an area");
    let Ok(found) = map::examine(&scan) else {
        return Said::default();
    };
    let how = map::Look {
        start: scan.middle(),
        accuracy: None,
    };
    let looked = map::look(&scan, &found, &how);
    let Some(searched) = looked.peak else {
        return said("unsearched", None);
    };
    let known = |value, std| {
        Some(Known {
            value,
            std,
            std_correlated: std,
        })
    };
    let told = [
        (known(found.peak.at.x, found.deviation), peak.x),
        (known(found.peak.at.y, found.deviation), peak.y),
        (known(searched.at.x, looked.deviation), peak.x),
        (known(searched.at.y, looked.deviation), peak.y),
    ];
    said("peak", told)
}

impl Said {
    fn line(&self, kind: &str, seed: u64) -> String {
        let mut line = format!(
            "{kind} {seed} {}",
            if self.method.is_empty() {
                "refused"
            } else {
                &self.method
            }
        );
        for [off, std, white] in &self.of {
            let _ = write!(line, " {off:.6e} {std:.6e} {white:.6e}");
        }
        line
    }

    fn parse(line: &str) -> Option<((String, u64), Self)> {
        let mut words = line.split(' ');
        let (kind, seed, method) = (words.next()?, words.next()?.parse().ok()?, words.next()?);
        let numbers: Vec<f64> = words.map(str::parse).collect::<Result<_, _>>().ok()?;
        let of: Vec<[f64; 3]> = numbers.as_chunks().0.to_vec();
        let said = Self {
            method: method.to_owned(),
            of,
        };
        Some(((kind.to_owned(), seed), said))
    }
}

/// The kinds that `COVERAGE_KINDS` names, divided by commas, or all of which something is told.
fn chosen(told: fn(&Kind) -> bool) -> Vec<Kind> {
    let named = std::env::var("COVERAGE_KINDS").unwrap_or_default();
    let asked = |kind: &Kind| named.is_empty() || named.split(',').any(|n| n == kind.name);
    KINDS.into_iter().filter(told).filter(asked).collect()
}

/// What this many records of each kind said, kind by kind.
fn records(of_each: u64, chosen: &[Kind]) -> BTreeMap<&'static str, Vec<Said>> {
    let file = std::env::var_os("COVERAGE_ROWS").map(PathBuf::from);
    let text = file
        .as_ref()
        .and_then(|f| std::fs::read_to_string(f).ok())
        .unwrap_or_default();
    let before: BTreeMap<(String, u64), Said> = text.lines().filter_map(Said::parse).collect();
    let log = file.map(|file| {
        let file = OpenOptions::new().create(true).append(true).open(file);
        Mutex::new(file.expect("a file of rows"))
    });
    // All kinds side by side, so that what was interrupted tells as much of each.
    let next = AtomicU64::new(0);
    let kinds = chosen.len() as u64;
    let first = std::env::var("COVERAGE_FIRST").map_or(0, |n| n.parse().expect("a number"));
    let worker = || {
        let mut mine = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let (seed, kind) = (first + number / kinds, &chosen[(number % kinds) as usize]);
            if seed >= first + of_each {
                return mine;
            }
            let said = if let Some(said) = before.get(&(kind.name.to_owned(), seed)) {
                said.clone()
            } else {
                let said = (kind.said)(kind.name, seed);
                if let Some(log) = &log {
                    let mut log = log.lock().expect("nobody panics with it");
                    writeln!(log, "{}", said.line(kind.name, seed)).expect("a row");
                }
                said
            };
            mine.push((kind.name, said));
        }
    };
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let mut all: BTreeMap<&str, Vec<Said>> = BTreeMap::new();
    std::thread::scope(|scope| {
        let started: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        for (kind, said) in started
            .into_iter()
            .flat_map(|w| w.join().expect("a worker"))
        {
            all.entry(kind).or_default().push(said);
        }
    });
    all
}

/// Share of 95 % intervals, by the deviation that takes correlation into account, that hold the truth.
fn covered(of_each: u64, least: f64, told: fn(&Kind) -> bool) {
    let mut few = Vec::new();
    let chosen = chosen(told);
    let all = records(of_each, &chosen);
    for kind in &chosen {
        let said = &all[kind.name];
        let count = kind.parameters.len();
        let answered: Vec<&Said> = said.iter().filter(|s| s.of.len() == count).collect();
        let shares: Vec<f64> = (0..count)
            .map(|j| {
                let held = |s: &&&Said| s.of[j][0].abs() < 1.96 * s.of[j][1];
                answered.iter().filter(held).count() as f64 / answered.len().max(1) as f64
            })
            .collect();
        let of = answered.len() as u64;
        for (name, share) in kind.parameters.iter().zip(&shares) {
            let [low, high] = exact((share * of as f64).round() as u64, of);
            eprintln!(
                "{:<20} {name:<16} asked {of_each:>5}, refused or of another model {:>5}, holds {share:.3} ({low:.3}-{high:.3})",
                kind.name,
                said.len() as u64 - of
            );
        }
        if shares.iter().any(|s| *s < least) {
            few.push((kind.name, shares));
        }
    }
    assert!(few.is_empty(), "{few:?}");
}

#[test]
fn short_moves_have_no_clock_that_runs_apart() {
    // Of 1,064 such records these were told a voltage of 2 to 5 samples before or after its row that lost a whole sample on its way, and inertias off by
    // 4 to 7 deviations.
    for seed in [310_003, 310_290, 310_493, 310_647] {
        let said = servo("moves", seed).of;
        assert_eq!(said.len(), SERVO.len(), "{seed} is answered");
        for [off, known, _] in said {
            assert!(
                off.abs() < 3.0 * known,
                "{seed}: off by {off}, said {known}"
            );
        }
    }
}

#[test]
#[ignore = "long: hundreds of records"]
fn intervals_hold_the_truth() {
    // 60 records tell a share of 0.95 to 0.056, two standard deviations. Of an axis alone: the others take long, and too few of
    // them were seen to ask for anything.
    covered(60, 0.85, |kind| kind.parameters.contains(&"inertia"));
}

mod acceptance {
    /// 2,000 of each kind tell a share of 0.95 to 0.01.
    #[test]
    #[ignore = "acceptance: 2,000 records of each kind"]
    fn intervals_of_many_hold_the_truth() {
        super::covered(2000, 0.9, |_| true);
    }
}
