//! Friction of contacts that are of no law that is fitted: what is said of them holds what they are, or is not said.

use pigtail_model::friction::Friction;
use pigtail_model::lugre::LuGre;
use pigtail_model::presliding::{MaxwellSlip, Presliding};
use pigtail_sysid::friction::{Record, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;

/// What a contact slides at, N.
const LEVEL: f64 = 2.0;

/// What a bristle with two levels breaks away at, N.
const FIXED: f64 = 2.8;

/// A contact: its force after a way, at a speed.
struct Contact {
    name: &'static str,
    /// Stiffness of a contact at rest, N/m.
    stiffness: f64,
    /// Mean way after which its elements slip, by their forces, m, where it has elements.
    way: Option<f64>,
    force: Box<dyn FnMut(f64, f64) -> f64>,
}

/// A law of the model, turned where the motion turns.
fn of_model<P: Presliding + 'static>(law: P) -> Force {
    let (mut state, mut angle, mut forward) = (P::State::default(), 0.0_f64, true);
    Box::new(move |way, speed| {
        if way != 0.0 && (way > 0.0) != forward {
            law.turn(&mut state, angle);
            forward = way > 0.0;
        }
        angle += way;
        law.torque(&state, angle, speed)
    })
}

type Force = Box<dyn FnMut(f64, f64) -> f64>;

/// Elements in parallel: stiffness and the way at which each slips.
fn elements(of: Vec<(f64, f64)>) -> (f64, Option<f64>, Force) {
    let level: f64 = of.iter().map(|(k, way)| k * way).sum();
    let mean = of.iter().map(|(k, way)| k * way * way).sum::<f64>() / level;
    let stiffness = of.iter().map(|(k, _)| k * LEVEL / level).sum();
    let mut deflections = vec![0.0_f64; of.len()];
    let force = move |way: f64, _: f64| {
        let each = deflections.iter_mut().zip(&of);
        let sum: f64 = each
            .map(|(d, (k, most))| {
                *d = (*d + way).clamp(-most, *most);
                k * *d
            })
            .sum();
        sum * LEVEL / level
    };
    (stiffness, Some(mean), Box::new(force))
}

const CONTACTS: usize = 10;

fn contact(k: usize, rng: &mut Pcg64Mcg) -> Contact {
    let way = rng.random_range(4e-6..12e-6);
    let some = |n: usize, rng: &mut Pcg64Mcg| {
        let each = (0..n).map(|_| {
            let slips = way * 10f64.powf(rng.random_range(-0.7..0.5));
            (rng.random_range(0.2..1.0) / slips, slips)
        });
        elements(each.collect())
    };
    let (name, (stiffness, mean, force)) = match k {
        0 => {
            let law = MaxwellSlip::new(LEVEL, way).expect("a law");
            (
                "the twin's elements",
                (law.initial_stiffness(), None, of_model(law)),
            )
        }
        1 => {
            let friction = Friction::new(LEVEL, LEVEL, 0.0).expect("friction");
            let law = LuGre::new(&friction, way, 1e-4).expect("a law");
            (
                "the twin's bristle",
                (law.initial_stiffness(), None, of_model(law)),
            )
        }
        2 => ("one element", elements(vec![(1.0, way)])),
        3 => ("two elements", some(2, rng)),
        4 => ("three elements", some(3, rng)),
        5 => ("five elements", some(5, rng)),
        6 => ("ten elements", some(10, rng)),
        7 => ("forty elements", some(40, rng)),
        8 => {
            // f (q / Q)^0.6 up to Q: many elements.
            let full = 3.0 * way;
            let at = |i: f64| full * i / 200.0;
            let curve = |q: f64| q.powf(0.6);
            let slope = |i: f64| (curve(at(i + 1.0)) - curve(at(i))) / at(1.0);
            let each = (0..200).map(|i| {
                let i = f64::from(i);
                let after = if i < 199.0 { slope(i + 1.0) } else { 0.0 };
                (slope(i) - after, at(i + 1.0))
            });
            ("a power of the way", elements(each.collect()))
        }
        _ => {
            // A bristle at one speed from sample to sample, with a static level far above.
            let (fixed, stribeck, stiff) = (FIXED, 4e-5, FIXED / way);
            let mut bristle = 0.0_f64;
            let force = move |way: f64, speed: f64| {
                let level = LEVEL + (fixed - LEVEL) * (-(speed / stribeck).powi(2)).exp();
                let end = way.signum() * level / stiff;
                if way != 0.0 {
                    bristle = end + (bristle - end) * (-stiff * way.abs() / level).exp();
                }
                stiff * bristle
            };
            (
                "a bristle with two levels",
                (stiff, None, Box::new(force) as _),
            )
        }
    };
    Contact {
        name,
        stiffness,
        way: mean,
        force,
    }
}

fn normal(rng: &mut Pcg64Mcg) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// How a record is disturbed.
#[derive(Debug, Clone, Copy)]
struct Disturbed {
    /// Of the force, N, white; and slow, with a memory of a hundred samples.
    noise: f64,
    slow: f64,
    /// Samples by which the force is late.
    late: f64,
    /// Of the displacement, m.
    shaken: f64,
}

const QUIET: Disturbed = Disturbed {
    noise: 0.006,
    slow: 0.0,
    late: 0.0,
    shaken: 0.0,
};

/// How a record moves.
#[derive(Debug, Clone, Copy)]
enum Motion {
    /// To and fro between turning points at one speed.
    Turns,
    /// Along a wave that never repeats.
    Wave,
    /// To and fro between turning points anywhere, each way at a speed of its own.
    Random,
}

/// A record of a contact.
fn record(
    contact: &mut Contact,
    motion: Motion,
    disturbed: Disturbed,
    rng: &mut Pcg64Mcg,
) -> Result<Record, String> {
    const FINE: usize = 20;
    const TURNS: [f64; 14] = [
        0.0, 60.0, -60.0, 45.0, -30.0, 18.0, -10.0, 30.0, -45.0, 60.0, -38.0, 22.0, 8.0, 45.0,
    ];
    let period = 0.01;
    let stretch = rng.random_range(0.8..1.2);
    let mut place = Vec::new();
    match motion {
        Motion::Wave => {
            let (phase, pace) = (rng.random_range(0.0..6.0), rng.random_range(0.8..1.4));
            for k in 0..4000 * FINE {
                let t = period / FINE as f64 * k as f64;
                place.push(
                    6e-5 * (pace * t + phase + 0.8 * (0.31 * t).sin()).sin()
                        + 2e-5 * (0.37 * t).sin(),
                );
            }
        }
        Motion::Turns => {
            for turn in TURNS.windows(2) {
                let rows = (3.0 * (turn[1] - turn[0]).abs()) as usize * FINE;
                let at = |r: usize| turn[0] + (turn[1] - turn[0]) * r as f64 / rows as f64;
                place.extend((0..rows).map(|r| 1e-6 * stretch * at(r)));
            }
        }
        Motion::Random => {
            let (mut from, mut up) = (0.0_f64, 1.0);
            while place.len() < 4000 * FINE {
                let to = up * rng.random_range(5.0..60.0);
                // Micrometres from one row to the next.
                let pace = 10f64.powf(rng.random_range(-1.2..-0.2));
                let rows = ((to - from).abs() / pace) as usize * FINE;
                place.extend(
                    (0..rows).map(|r| 1e-6 * (from + (to - from) * r as f64 / rows as f64)),
                );
                (from, up) = (to, -up);
            }
        }
    }
    let mut last = place[0];
    let force: Vec<f64> = place
        .iter()
        .map(|x| {
            let way = x - last;
            last = *x;
            (contact.force)(way, way * FINE as f64 / period)
        })
        .collect();
    let n = place.len() / FINE;
    let mut drift = 0.0;
    let (mut time, mut x, mut f) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..n {
        let keep: f64 = 0.99;
        drift = keep * drift + (1.0 - keep * keep).sqrt() * normal(rng);
        let at = (k as f64 - disturbed.late) * FINE as f64;
        let read = force[(at.max(0.0) as usize).min(force.len() - 1)];
        time.push(period * k as f64);
        x.push(place[k * FINE] + disturbed.shaken * normal(rng));
        f.push(read + 0.1 + disturbed.noise * normal(rng) + disturbed.slow * drift);
    }
    Record::new(Some(&time), &x, &f).map_err(|u| u.because)
}

/// What came of a record.
struct Said {
    /// By how many of the deviations stated, and by which share, each parameter that is known is off; none where it was refused.
    off: Vec<(&'static str, f64, f64)>,
    /// What of the force goes with the contact's state and is not in the law, per cent.
    misfit: f64,
    words: String,
}

fn said(k: usize, motion: Motion, disturbed: Disturbed, seed: u64) -> Said {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut contact = contact(k, &mut rng);
    let name = contact.name;
    let refused = |why: &str, misfit: f64| Said {
        off: Vec::new(),
        misfit,
        words: format!("{name}, {seed}: refused, {why}"),
    };
    let found = record(&mut contact, motion, disturbed, &mut rng)
        .and_then(|record| identify(&record, None, 4).map_err(|u| u.because));
    let found = match found {
        Ok(found) => found,
        Err(why) => return refused(&why, 0.0),
    };
    let best = &found.laws[found.best];
    let mut off = Vec::new();
    let mut words = format!(
        "{name}, {seed}: {} leaves {:.2} %, {:.2} % misfit",
        best.law.name(),
        best.relative_error_percent,
        best.misfit_percent
    );
    for parameter in &found.parameters {
        let Some(known) = parameter.known else {
            continue;
        };
        let truth = match parameter.name {
            // A law that knows no speed tells a bristle's level at those of the record, which is no truth of its own.
            "static_friction" | "coulomb_friction"
                if k == CONTACTS - 1 && !best.law.needs_time() =>
            {
                continue;
            }
            "static_friction" if k == CONTACTS - 1 => FIXED,
            "static_friction" | "coulomb_friction" => LEVEL,
            "stiffness" => contact.stiffness,
            "presliding" => match contact.way {
                Some(way) => way,
                None => continue,
            },
            _ => continue,
        };
        let by = known.value - truth;
        off.push((parameter.name, by / known.std_correlated, by / truth));
        let _ = write!(
            words,
            "; {} {:+.2} % +- {:.2} %",
            parameter.name,
            100.0 * by / truth,
            100.0 * known.std_correlated / truth
        );
    }
    for unknown in &found.unknown {
        let _ = write!(words, "; {:?} not", unknown.parameters);
    }
    Said {
        off,
        misfit: best.misfit_percent,
        words,
    }
}

#[test]
fn a_contact_of_another_law_is_not_told_too_surely() {
    for motion in [Motion::Turns, Motion::Wave] {
        let said = said(0, motion, QUIET, 71);
        eprintln!("{}", said.words);
        assert!(said.misfit > 1.0, "{}", said.words);
        let held = said.off.iter().all(|(_, off, _)| off.abs() < 1.96);
        assert!(held, "{}", said.words);
    }
}

#[test]
fn a_contact_of_a_law_is_told_as_surely_as_noise_allows() {
    let slow = Disturbed {
        slow: 0.03,
        ..QUIET
    };
    for disturbed in [QUIET, slow] {
        let said = said(2, Motion::Turns, disturbed, 72);
        eprintln!("{}", said.words);
        assert!(!said.off.is_empty(), "{}", said.words);
        // A tenth of the deviations that a misfit as large as the noise would ask for.
        let few = said.off.iter().all(|(_, _, share)| share.abs() < 5e-3);
        assert!(few && said.misfit < 0.3, "{}", said.words);
    }
}

mod acceptance {
    use super::*;

    #[test]
    #[ignore = "acceptance: every contact, disturbed in five ways, along three motions"]
    fn intervals_of_foreign_contacts_hold_the_truth() {
        let disturbances = [
            ("quiet", QUIET),
            (
                "noise",
                Disturbed {
                    noise: 0.04,
                    ..QUIET
                },
            ),
            (
                "slow noise",
                Disturbed {
                    slow: 0.03,
                    ..QUIET
                },
            ),
            ("skew", Disturbed { late: 3.3, ..QUIET }),
            (
                "shaken",
                Disturbed {
                    shaken: 5e-8,
                    ..QUIET
                },
            ),
        ];
        // From FOREIGN_FIRST on, so that a run that was interrupted goes on.
        let number = |name: &str, usual: u64| {
            std::env::var(name).map_or(usual, |s| s.parse().expect("a number"))
        };
        let (first, seeds) = (number("FOREIGN_FIRST", 1), number("FOREIGN_SEEDS", 10));
        let mut wrong = Vec::new();
        let (mut told, mut answered, mut all) = (0, 0, 0);
        for seed in first..first + seeds {
            for (name, disturbed) in disturbances {
                for k in 0..CONTACTS {
                    let motion = [Motion::Wave, Motion::Turns, Motion::Random]
                        [((seed + k as u64) % 3) as usize];
                    let said = said(k, motion, disturbed, 5000 + 100 * seed + k as u64);
                    eprintln!("{name}, {motion:?}: {}", said.words);
                    all += 1;
                    answered += u32::from(!said.off.is_empty());
                    told += said.off.len();
                    // An error below a thousandth misleads nobody.
                    let far = |o: &&(&str, f64, f64)| o.1.abs() > 1.96 && o.2.abs() > 1e-3;
                    if said.off.iter().any(|o| far(&o)) {
                        wrong.push(format!("{name}: {}", said.words));
                    }
                }
            }
        }
        eprintln!(
            "{answered} of {all} answered, {told} parameters, {} wrong",
            wrong.len()
        );
        assert!(answered > all / 4, "{answered} of {all}");
        assert!(wrong.len() * 20 <= told, "{}", wrong.join("\n"));
    }
}
