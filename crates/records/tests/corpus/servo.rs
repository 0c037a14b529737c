//! A servo axis by mangled records.

use crate::servo_cases::MANGLED;
use crate::{Wanted, normal};
use pigtail_records::columns::Named;
use pigtail_records::servo::{Roles, servo};
use pigtail_sysid::servo::{Axis, Friction, Settings};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// A record: time, reference, position, voltage.
pub(crate) type Rows = Vec<[f64; 4]>;

/// What is known of the axis that made it.
#[derive(Clone, Copy)]
pub(crate) struct Truth {
    force_per_volt: f64,
    /// Inertia, viscous and Coulomb friction.
    values: [f64; 3],
    /// What an answer may be off by, shares.
    tolerance: [f64; 3],
}

pub(crate) const SLED: Axis = Axis {
    force_per_volt: 35.0,
    inertia: 95.0,
    viscous: [205.0, 205.0],
    coulomb: [20.0, 20.0],
    offset: -3.0,
};

pub(crate) const PERIOD: f64 = 1e-3;

/// A sled under a cascade at 1 kHz, simulated ten times as finely: what it was at every tenth of a period.
pub(crate) fn sled(seed: u64, seconds: f64) -> Vec<[f64; 4]> {
    driven(seed, seconds, |_| 0.0)
}

/// The same with something added to the controller's voltage, V over time.
fn driven(seed: u64, seconds: f64, added: impl Fn(f64) -> f64) -> Vec<[f64; 4]> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let phase: Vec<f64> = (0..3).map(|_| rng.random_range(0.0..6.0)).collect();
    let reference = |t: f64| {
        0.08 * (1.9 * t + phase[0]).sin()
            + 0.03 * (5.3 * t + phase[1]).sin()
            + 0.004 * (17.0 * t + phase[2]).sin()
    };
    follows(&mut rng, seconds, reference, added)
}

/// A way of a tenth of a metre there in 0.35 of so many seconds, from rest to rest, and back after half of them.
pub(crate) fn there_and_back(t: f64, seconds: f64) -> f64 {
    let share = (t / seconds).rem_euclid(1.0);
    let way = |x: f64| {
        let x = x.clamp(0.0, 1.0);
        x.powi(3) * (10.0 - 15.0 * x + 6.0 * x * x)
    };
    0.1 * (way(share / 0.35) - way((share - 0.5) / 0.35))
}

pub(crate) fn follows(
    rng: &mut Pcg64Mcg,
    seconds: f64,
    reference: impl Fn(f64) -> f64,
    added: impl Fn(f64) -> f64,
) -> Vec<[f64; 4]> {
    let fine = 10;
    let n = (seconds / PERIOD) as usize;
    let mut state = (0.0, 0.0);
    let mut rows = Vec::new();
    let (mut last, mut voltage) = (0.0, 0.0);
    for k in 0..n * fine {
        let t = k as f64 * PERIOD / fine as f64;
        let r = reference(t);
        if k == 0 {
            state.0 = r;
            last = r;
        }
        if k % fine == 0 {
            let seen = state.0 + 5e-7 * normal(rng);
            let own = (243.0 * (160.0 * (r - seen) - (seen - last) / PERIOD)).clamp(-10.0, 10.0);
            voltage = own + added(t);
            last = seen;
        }
        rows.push([t, r, state.0, voltage]);
        state = SLED.advance(state, voltage, PERIOD / fine as f64);
    }
    rows
}

/// Read at these moments (seconds), stamped so.
pub(crate) fn read_at(dense: &[[f64; 4]], moments: &[f64], stamps: &[f64], seed: u64) -> Rows {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let at = |t: f64, column: usize| {
        // A moment of a voltage's own beginning belongs to it, whatever the quotient's last digit.
        let place = (t / (0.1 * PERIOD) + 1e-6).max(0.0);
        let k = (place as usize).min(dense.len() - 2);
        let f = if column == 3 { 0.0 } else { place - k as f64 };
        dense[k][column] + f * (dense[k + 1][column] - dense[k][column])
    };
    moments
        .iter()
        .zip(stamps)
        .map(|(t, stamp)| {
            let seen = at(*t, 2) + 5e-7 * normal(&mut rng);
            [*stamp, at(*t, 1), seen, at(*t, 3)]
        })
        .collect()
}

pub(crate) fn plain(seed: u64) -> Rows {
    let dense = sled(seed, 20.0);
    let times: Vec<f64> = (0..20_000).map(|k| f64::from(k) * PERIOD).collect();
    read_at(&dense, &times, &times, seed + 1)
}

pub(crate) fn text(rows: &Rows) -> String {
    let mut text = "t_s,r_m,q_m,u_V\n".to_owned();
    for [t, r, q, u] in rows {
        let _ = writeln!(text, "{t:.7},{r:.9},{q:.9},{u:.6}");
    }
    text
}

/// What came of it: the answer's error in tolerances, or the refusal.
#[derive(Debug)]
pub(crate) enum Came {
    Answered {
        worst: f64,
        told: String,
        remarks: String,
    },
    Refused(String),
}

pub(crate) fn answer(csv: &str, truth: &Truth, reference: bool) -> Came {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    fs::write(&path, csv).expect("a file");
    run(&path, truth, reference)
}

fn run(path: &Path, truth: &Truth, reference: bool) -> Came {
    let roles = Roles {
        time: None,
        rate: None,
        reference: reference.then(|| Named::new("r_m")),
        position: Named::new("q_m"),
        voltage: Named::new("u_V"),
        injected: None,
    };
    let read = match roles.read(path) {
        Ok(read) => read,
        Err(error) => return Came::Refused(error.to_string()),
    };
    let set = Settings::new(truth.force_per_volt);
    let found = servo(&read, None, &set, (Friction::Symmetric, None));
    if !found.answer.is_whole() {
        return Came::Refused(found.answer.verdict);
    }
    let mut worst = 0.0_f64;
    let mut told = String::new();
    for ((p, _), (is, tolerance)) in found
        .answer
        .parameters
        .iter()
        .zip(truth.values.iter().zip(truth.tolerance))
    {
        let known = p.known.expect("whole");
        let off = (known.value / is - 1.0).abs() / tolerance;
        worst = worst.max(off);
        let _ = write!(
            told,
            "{} {:.4} +- {:.2}({:.2}) ",
            p.name, known.value, known.std, known.std_correlated
        );
    }
    let _ = write!(
        told,
        "err {:.2}",
        found.answer.relative_error_percent.unwrap_or(0.0)
    );
    Came::Answered {
        worst,
        told,
        remarks: found.answer.remarks.join(" | "),
    }
}

pub(crate) const MADE: Truth = Truth {
    force_per_volt: 35.0,
    values: [95.0, 205.0, 20.0],
    tolerance: [0.02, 0.05, 0.05],
};

const EMPS: Truth = Truth {
    force_per_volt: 35.150_651_88,
    values: [95.1089, 203.5034, 20.3935],
    tolerance: [0.02, 0.05, 0.05],
};

/// Which column is which in records of the sled, and which says what was injected.
fn roles(injected: Option<&str>) -> Roles {
    Roles {
        time: None,
        rate: None,
        reference: Some(Named::new("r_m")),
        position: Named::new("q_m"),
        voltage: Named::new("u_V"),
        injected: injected.map(Named::new),
    }
}

/// Pulses that were added to the voltage: in the recorded one, or beside it, in volts or as a force.
#[test]
fn what_was_injected_is_told_and_replayed() {
    let added = |t: f64| {
        if (t % 2.0) < 0.05 && t > 1.0 {
            2.0
        } else {
            0.0
        }
    };
    let dense = driven(11, 20.0, added);
    let times: Vec<f64> = (0..20_000).map(|k| f64::from(k) * PERIOD).collect();
    let rows = read_at(&dense, &times, &times, 12);
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let replayed = |within: bool, column: Option<&str>| {
        let mut text = "t_s,r_m,q_m,u_V,added_V,added_N\n".to_owned();
        for [t, r, q, u] in &rows {
            let v = added(*t);
            let u = if within { *u } else { u - v };
            let _ = writeln!(text, "{t:.7},{r:.9},{q:.9},{u:.6},{v},{}", 35.0 * v);
        }
        fs::write(&path, text).expect("a file");
        let read = roles(column).read(&path).expect("a record");
        let found = servo(
            &read,
            None,
            &Settings::new(35.0),
            (Friction::Symmetric, None),
        );
        let inertia = found.answer.parameters[0]
            .0
            .known
            .map_or(f64::NAN, |k| k.value);
        // Without the column the controller may not be told at all, and then there is no replay.
        let replay = found
            .answer
            .more
            .get("replay")
            .map(|r| &r["velocity_error_percent"]);
        let replay = replay.and_then(serde_json::Value::as_f64);
        (inertia, replay.unwrap_or(f64::INFINITY))
    };
    let (_, without) = replayed(true, None);
    for within in [true, false] {
        for column in ["added_V", "added_N"] {
            let (inertia, with) = replayed(within, Some(column));
            eprintln!("{within} {column}: {inertia} kg, replay {with} %, without {without} %");
            assert!(
                (inertia / 95.0 - 1.0).abs() < 0.01,
                "{within} {column}: {inertia}"
            );
            assert!(
                with < 0.3 && with < 0.3 * without,
                "{within} {column}: {with} for {without}"
            );
        }
    }
}

/// Parameters that are told are off by no more than 2.6 of their deviations, which is chance once in a hundred times.
fn as_sure_as_said(name: &str, csv: &str, set: &Settings, injected: Option<&str>) -> String {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    fs::write(&path, csv).expect("a file");
    let read = roles(injected).read(&path).expect("a record");
    let answer = servo(&read, None, set, (Friction::Symmetric, None)).answer;
    for ((parameter, _), is) in answer.parameters.iter().zip(MADE.values) {
        if let Some(known) = parameter.known {
            let off = (known.value - is) / known.std_correlated;
            eprintln!("{name}: {} {known:?}, {off:.1} off", parameter.name);
            assert!(off.abs() < 2.6, "{name}: {} {known:?}", parameter.name);
        }
    }
    answer.remarks.join(" | ")
}

/// What is written beside a voltage as added to it came through a filter, late, or overshoots: the voltage lacks what is not told.
#[test]
fn what_was_injected_otherwise_than_it_is_written_makes_nothing_surely_wrong() {
    let added = |t: f64| if (1.7 * t).fract() < 0.5 { 0.6 } else { -0.6 };
    let dense = driven(21, 20.0, added);
    let times: Vec<f64> = (0..20_000).map(|k| f64::from(k) * PERIOD).collect();
    let rows = read_at(&dense, &times, &times, 22);
    let written = |next: &mut dyn FnMut(f64) -> f64| {
        let mut text = "t_s,r_m,q_m,u_V,added_V\n".to_owned();
        for [t, r, q, u] in &rows {
            let v = added(*t);
            let _ = writeln!(text, "{t:.7},{r:.9},{q:.9},{:.6},{:.6}", u - v, next(v));
        }
        text
    };
    let mut late = [0.0; 4];
    let two = written(&mut |v| {
        late.rotate_right(1);
        late[0] = v;
        late[2]
    });
    let otherwise = "what was injected moved the axis";
    let said = as_sure_as_said("two rows late", &two, &Settings::new(35.0), Some("added_V"));
    assert!(said.contains(otherwise), "two rows late: {said}");
    let mut held = 0.0;
    let pole = written(&mut |v| {
        held += (v - held) / 5.0;
        held
    });
    as_sure_as_said(
        "behind a pole",
        &pole,
        &Settings::new(35.0),
        Some("added_V"),
    );
    let [mut is, mut rate] = [0.0, 0.0];
    let overshoots = written(&mut |v| {
        rate += 0.33 * (0.33 * (v - is) - 0.7 * rate);
        is += rate;
        is
    });
    as_sure_as_said(
        "overshoots",
        &overshoots,
        &Settings::new(35.0),
        Some("added_V"),
    );
    let said = as_sure_as_said(
        "as it is",
        &written(&mut |v| v),
        &Settings::new(35.0),
        Some("added_V"),
    );
    assert!(!said.contains(otherwise), "as it is: {said}");
}

/// Where an axis makes short moves from rest to rest its columns tell each other, and what filters smear of its friction counts the more.
#[test]
fn short_moves_are_as_sure_as_they_say() {
    for seed in 31..35 {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let long = rng.random_range(1.9..3.0);
        let dense = follows(&mut rng, 19.0, |t| there_and_back(t, long), |_| 0.0);
        let times: Vec<f64> = (0..19_000).map(|k| f64::from(k) * PERIOD).collect();
        let csv = text(&read_at(&dense, &times, &times, seed + 10));
        for cutoff in [None, Some(50.0), Some(25.0)] {
            let set = Settings {
                cutoff,
                ..Settings::new(MADE.force_per_volt)
            };
            as_sure_as_said(
                &format!("moves of {long:.2} s, {cutoff:?}"),
                &csv,
                &set,
                None,
            );
        }
    }
}

pub(crate) fn judge(name: &str, wanted: Wanted, came: &Came, wrong: &mut Vec<String>) {
    match came {
        Came::Answered {
            worst,
            told,
            remarks,
        } => {
            let bad = *worst > 1.0 || wanted == Wanted::Refused;
            eprintln!(
                "{} {name}: {worst:.2} {told}\n        {remarks}",
                if bad { "WRONG  " } else { "right  " }
            );
            if bad {
                wrong.push(format!(
                    "{name}: answered, {worst:.2} tolerances off: {told}"
                ));
            }
        }
        Came::Refused(why) => {
            let bad = wanted == Wanted::Right;
            eprintln!("{} {name}: {why}", if bad { "REFUSED" } else { "refused" });
            if bad {
                wrong.push(format!("{name}: refused: {why}"));
            }
        }
    }
}

#[test]
fn no_mangled_record_of_a_servo_is_wrong_and_looks_right() {
    let mut wrong = Vec::new();
    let good = plain(1);
    for (k, (name, wanted, mangle)) in MANGLED.iter().enumerate() {
        let mut rows = good.clone();
        mangle(&mut rows, &mut Pcg64Mcg::seed_from_u64(100 + k as u64));
        judge(
            name,
            *wanted,
            &answer(&text(&rows), &MADE, true),
            &mut wrong,
        );
    }
    // Samples that were really taken at odd moments, and stamped right.
    let dense = sled(3, 20.0);
    for share in [0.1, 0.3, 0.45] {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let times: Vec<f64> = (0..20_000)
            .map(|k| PERIOD * (f64::from(k) + rng.random_range(-share..share)).max(0.0))
            .collect();
        let rows = read_at(&dense, &times, &times, 8);
        let name = format!("samples taken at odd moments, {share} periods");
        judge(
            &name,
            Wanted::Right,
            &answer(&text(&rows), &MADE, true),
            &mut wrong,
        );
    }
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// A record that was taken anew at a lower rate has a voltage that nothing held from one row to the next, and few rows from one turn
/// to the next. A voltage that was measured has noise that nothing moved by, in its differences too. What is fast is less in a position
/// that was smoothed, and a gain that drifts is another one in each part.
#[test]
fn a_record_that_was_thinned_smoothed_or_drifts_is_as_sure_as_it_says() {
    let good = plain(4);
    let thinned = |(step, from): (usize, usize)| -> (String, Rows) {
        let rows = good.iter().copied().skip(from).step_by(step).collect();
        (format!("every {step} from {from}"), rows)
    };
    let noisy = |volts: f64| -> (String, Rows) {
        let mut rng = Pcg64Mcg::seed_from_u64(11);
        let noise = |mut row: [f64; 4]| {
            row[3] += volts * normal(&mut rng);
            row
        };
        let rows = good.iter().copied().map(noise).collect();
        (format!("voltage with {volts} V of noise"), rows)
    };
    let mut cases: Vec<(String, Rows)> = [0.1, 0.5, 2.0].map(noisy).into();
    cases.extend([(4, 1), (5, 0), (7, 3), (10, 0), (10, 5)].map(thinned));
    // Positions that were smoothed, and a gain that drifts: by 3 % over the record, or at once.
    let smoothed = |width: usize| -> (String, Rows) {
        let mut rows = good.clone();
        for (k, row) in rows.iter_mut().enumerate() {
            let near = &good[k.saturating_sub(width / 2)..(k + width / 2 + 1).min(good.len())];
            row[2] = near.iter().map(|r| r[2]).sum::<f64>() / near.len() as f64;
        }
        (format!("position over {width} rows"), rows)
    };
    cases.extend([9, 21, 31, 41].map(smoothed));
    let gain = |(name, of): (&str, fn(f64) -> f64)| -> (String, Rows) {
        let mut rows = good.clone();
        let n = rows.len() as f64;
        for (k, row) in rows.iter_mut().enumerate() {
            row[3] *= 1.0 + 0.03 * of(k as f64 / n);
        }
        (format!("a gain that drifts {name}"), rows)
    };
    cases.push(gain(("evenly", |share| share)));
    cases.push(gain(("at once", |share| share.round())));
    for (name, rows) in cases {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("r.csv");
        fs::write(&path, text(&rows)).expect("a file");
        let read = roles(None).read(&path).expect("a record");
        let set = Settings::new(MADE.force_per_volt);
        let answer = servo(&read, None, &set, (Friction::Symmetric, None)).answer;
        for ((parameter, _), is) in answer.parameters.iter().zip(MADE.values) {
            if let Some(known) = parameter.known {
                let off = (known.value - is).abs() / known.std_correlated;
                assert!(off < 4.0, "{name}: {} {known:?}", parameter.name);
            }
        }
    }
}

#[test]
fn no_mangled_measured_record_is_wrong_and_looks_right() {
    let file =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/emps/emps_estimation.csv");
    let Ok(csv) = fs::read_to_string(file) else {
        return;
    };
    let good: Rows = csv
        .lines()
        .skip(1)
        .map(|line| {
            let v: Vec<f64> = line
                .split(',')
                .map(|f| f.parse().expect("a number"))
                .collect();
            [v[0], v[1], v[2], v[3]]
        })
        .collect();
    let mut wrong = Vec::new();
    for (k, (name, wanted, mangle)) in MANGLED.iter().enumerate() {
        let mut rows = good.clone();
        mangle(&mut rows, &mut Pcg64Mcg::seed_from_u64(200 + k as u64));
        judge(
            name,
            *wanted,
            &answer(&text(&rows), &EMPS, true),
            &mut wrong,
        );
    }
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// Those of its authors within one per cent, standard deviations too, and the replay better than theirs, of 0.229 %.
#[test]
fn the_published_figures_of_a_measured_axis_are_kept() {
    let file =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/emps/emps_estimation.csv");
    if !file.exists() {
        return;
    }
    let roles = Roles {
        time: None,
        rate: None,
        reference: Some(Named::new("q_ref_m")),
        position: Named::new("q_meas_m"),
        voltage: Named::new("u_V"),
        injected: None,
    };
    let read = roles.read(&file).expect("a record");
    let set = Settings::new(EMPS.force_per_volt);
    let answer = servo(&read, None, &set, (Friction::Symmetric, None)).answer;
    let near = |what: &str, found: f64, is: f64| {
        assert!((found / is - 1.0).abs() < 0.01, "{what}: {found} for {is}");
    };
    let published = [
        [95.1089, 0.1085],
        [203.5034, 1.1460],
        [20.3935, 0.1012],
        [-3.1648, 0.0444],
    ];
    for ((parameter, _), [is, std]) in answer.parameters.iter().zip(published) {
        let known = parameter.known.expect("known");
        eprintln!("{} {known:?}", parameter.name);
        near(parameter.name, known.value, is);
        near(parameter.name, known.std, std);
    }
    let error = answer.relative_error_percent.expect("an error");
    let replay = answer.more["replay"]["velocity_error_percent"].as_f64();
    eprintln!("{error} %, replayed {replay:?} %");
    near("error", error, 4.0834);
    assert!(replay.is_some_and(|r| r < 0.124), "{replay:?}");
}
