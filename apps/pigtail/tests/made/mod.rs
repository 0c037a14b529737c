//! Records that are made, whose truth is known, and what tests of them have in common.

#![allow(dead_code, reason = "every file of tests takes what it needs")]

use assert_cmd::Command;
use rand::{RngExt, SeedableRng};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

pub(crate) fn pigtail(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

/// The JSON of a command, and its exit code.
pub(crate) fn answer(folder: &Path, arguments: &[&str]) -> (Value, i32) {
    let mut all = arguments.to_vec();
    all.push("--json");
    let (code, out, error) = pigtail(folder, &all);
    let json = serde_json::from_str(&out).unwrap_or_else(|_| panic!("no JSON: {out}{error}"));
    (json, code.expect("it ends by itself"))
}

pub(crate) fn value(json: &Value, name: &str) -> Option<f64> {
    json["parameters"][name]["value"].as_f64()
}

pub(crate) fn number(json: &Value, key: &str) -> f64 {
    json[key]
        .as_f64()
        .unwrap_or_else(|| panic!("no {key} in {json}"))
}

pub(crate) fn near(a: f64, b: f64, percent: f64) {
    assert!((a - b).abs() <= 0.01 * percent * b.abs(), "{a} for {b}");
}

/// A normal number, nearly.
pub(crate) fn normal(rng: &mut rand_pcg::Pcg64Mcg) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

pub(crate) fn csv(header: &str, rows: impl IntoIterator<Item = Vec<f64>>) -> String {
    let mut text = format!("{header}\n");
    for row in rows {
        let fields: Vec<String> = row.iter().map(|v| format!("{v:.9}")).collect();
        let _ = writeln!(text, "{}", fields.join(","));
    }
    text
}

/// A turning axis whose truth is known, under a cascade, at 2 kHz: inertia 0.02 kg m^2, friction
/// 0.15 N m s/rad and 0.4 N m forward, 0.25 N m s/rad and 0.5 N m backward.
pub(crate) fn turning(seed: u64, reference: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let (h, inner) = (5e-4, 10);
    let (mut q, mut v, mut last) = (0.0_f64, 0.0_f64, 0.0);
    (0..20_000)
        .map(|k| {
            let t = f64::from(k) * h;
            let r = reference(t);
            let seen = q + 2e-6 * normal(&mut rng);
            let u = (4.0 * (60.0 * (r - seen) - (seen - last) / h)).clamp(-12.0, 12.0);
            last = seen;
            let row = vec![t, r.to_degrees(), seen.to_degrees(), u];
            let torque = 0.5 * u;
            for _ in 0..inner {
                let free = torque - if v > 0.0 { 0.15 } else { 0.25 } * v;
                let held = if v > 0.0 || (v == 0.0 && free > 0.4) {
                    0.4
                } else if v < 0.0 || free < -0.5 {
                    -0.5
                } else {
                    free
                };
                let next = v + (free - held) / 0.02 * h / f64::from(inner);
                let next = if v * next < 0.0 { 0.0 } else { next };
                q += 0.5 * (v + next) * h / f64::from(inner);
                v = next;
            }
            row
        })
        .collect()
}

pub(crate) fn swinging(t: f64) -> f64 {
    0.8 * (2.0 * t).sin() + 0.3 * (7.3 * t).sin() + 0.05 * (19.0 * t).sin()
}

pub(crate) const TURNING: &str = "t_s,r_deg,q_deg,u_V";

/// What is done to the rows of a record, and what a verdict must then say.
pub(crate) type Rows = Vec<Vec<f64>>;

pub(crate) type Spoil = fn(&mut Rows);

pub(crate) type Case = (
    &'static str,
    Rows,
    Spoil,
    &'static [&'static str],
    &'static str,
);

pub(crate) fn identify_turning(record: &str, extra: &[&str]) -> (Value, i32) {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("r.csv"), record).expect("a file");
    let mut arguments = vec![
        "identify",
        "servo",
        "--data",
        "r.csv",
        "--reference",
        "r_deg",
        "--position",
        "q_deg",
        "--voltage",
        "u_V",
        "--force-per-volt",
        "0.5",
    ];
    arguments.extend(extra);
    answer(folder.path(), &arguments)
}

/// A carriage on a line whose truth is known.
pub(crate) struct Sled {
    /// kg
    pub(crate) inertia: f64,
    /// N s/m
    pub(crate) viscous: f64,
    /// N
    pub(crate) coulomb: f64,
    /// N/V
    pub(crate) gain: f64,
    /// m, m/s
    pub(crate) state: (f64, f64),
}

pub(crate) const SLED: Sled = Sled {
    inertia: 3.0,
    viscous: 25.0,
    coulomb: 4.0,
    gain: 8.0,
    state: (0.0, 0.0),
};

impl Sled {
    /// Under a held voltage, in small steps.
    pub(crate) fn advance(&mut self, voltage: f64, duration: f64) {
        const STEPS: u32 = 16;
        let h = duration / f64::from(STEPS);
        let (mut q, mut v) = self.state;
        for _ in 0..STEPS {
            let free = self.gain * voltage - self.viscous * v;
            let held = if v == 0.0 {
                free.clamp(-self.coulomb, self.coulomb)
            } else {
                self.coulomb.copysign(v)
            };
            let next = v + (free - held) / self.inertia * h;
            let next = if v * next < 0.0 { 0.0 } else { next };
            q += 0.5 * (v + next) * h;
            v = next;
        }
        self.state = (q, v);
    }
}

pub(crate) const SLIDING: &str = "t_s,r_mm,q_mm,u_V";

/// The sled under a cascade at 2 kHz, its position read with a noise of 30 nm.
pub(crate) fn sliding(seed: u64) -> Vec<Vec<f64>> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let mut sled = SLED;
    let (h, mut last) = (5e-4, 0.0);
    (0..16_000)
        .map(|k| {
            let t = f64::from(k) * h;
            let r = 8e-3 * (2.0 * t).sin() + 3e-3 * (7.3 * t).sin() + 5e-4 * (19.0 * t).sin();
            let seen = sled.state.0 + 3e-8 * normal(&mut rng);
            let u = (90.0 * (120.0 * (r - seen) - (seen - last) / h)).clamp(-12.0, 12.0);
            last = seen;
            sled.advance(u, h);
            vec![t, 1e3 * r, 1e3 * seen, u]
        })
        .collect()
}

/// Identifies a servo from a record in a folder; the folder of the run, which must have come to its end.
pub(crate) fn fragment_of(
    folder: &Path,
    header: &str,
    rows: Vec<Vec<f64>>,
    extra: &[&str],
) -> String {
    fs::write(folder.join("own.csv"), csv(header, rows)).expect("a file");
    let columns: Vec<&str> = header.split(',').collect();
    let mut arguments = vec!["identify", "servo", "--data", "own.csv"];
    for (option, column) in ["--time", "--reference", "--position", "--voltage"]
        .into_iter()
        .zip(columns)
    {
        arguments.extend([option, column]);
    }
    arguments.extend(extra);
    let (json, code) = answer(folder, &arguments);
    assert_eq!(code, 0, "{json}");
    let fragment = json["fragment"].as_str().expect("a fragment");
    let run = Path::new(fragment).parent().expect("a folder");
    run.display().to_string()
}
