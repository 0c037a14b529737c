//! Piezos by mangled records of displacement over voltage: a model from them, a model tried on them; and mangled files of
//! what drives a simulation.

use crate::{Wanted, normal};
use pigtail_control::compensation::hysteresis::{Memory, Model};
use pigtail_model::hysteresis::{Hysteresis, HysteresisParameters, HysteresisState};
use pigtail_records::hysteresis::{Columns, Data, Kind, Read, fit, tell};
use pigtail_records::input;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;
use std::fs;

/// Time (s), voltage (V), displacement (um).
type Rows = Vec<[f64; 3]>;

/// A model is right that tells the unmangled record to so much of its range, per cent; the best straight line is 5 off.
const RIGHT: f64 = 2.0;

fn made(seed: u64) -> Rows {
    made_at(seed, || 30.0)
}

/// So many samples a volt, way by way.
fn made_at(seed: u64, mut samples: impl FnMut() -> f64) -> Rows {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let parameters = HysteresisParameters {
        opening: 0.15,
        spread: 0.3,
        skew: 0.1,
        saturation: 0.05,
    };
    let model = Hysteresis::new(&parameters).expect("a piezo of the usual kind");
    let mut state = HysteresisState::default();
    let mut turns: Vec<f64> = vec![0.0, 10.0, 0.0, 9.0, 1.0, 8.0, 2.0, 7.0, 3.0, 6.0, 0.0, 10.0];
    turns.extend((0..10).map(|k| {
        if k % 2 == 0 {
            rng.random_range(0.0..4.0)
        } else {
            rng.random_range(6.0..10.0)
        }
    }));
    turns.push(0.0);
    let mut rows = Vec::new();
    for turn in turns.windows(2) {
        let steps = (samples() * (turn[1] - turn[0]).abs()) as u32;
        for step in 0..steps {
            // Slower near its turns, as a sine is.
            let share =
                0.5 - 0.5 * (std::f64::consts::PI * f64::from(step) / f64::from(steps)).cos();
            let volts = turn[0] + (turn[1] - turn[0]) * share;
            let um = 35.0 * (model.advance(&mut state, volts / 5.0 - 1.0) + 1.0);
            rows.push([
                0.01 * rows.len() as f64,
                volts,
                um + 0.02 * normal(&mut rng),
            ]);
        }
    }
    rows
}

fn text(rows: &Rows) -> String {
    let mut text = "t_s,u_V,x_um\n".to_owned();
    for row in rows {
        let fields: Vec<String> = row
            .iter()
            .map(|v| {
                if v.is_nan() {
                    String::new()
                } else {
                    format!("{v:.6}")
                }
            })
            .collect();
        let _ = writeln!(text, "{}", fields.join(","));
    }
    text
}

fn read(rows: &Rows) -> Result<Read, String> {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    fs::write(&path, text(rows)).expect("a file");
    let columns = Columns {
        input: "u_V".to_owned(),
        output: "x_um".to_owned(),
        time: None,
    };
    let data = Data::open(&path, None).map_err(|e| e.to_string())?;
    data.record(&columns, None).map_err(|e| e.to_string())
}

type Mangle = fn(&mut Rows, &mut Pcg64Mcg);

fn late(rows: &mut Rows, by: usize) {
    let old = rows.clone();
    for (row, before) in rows[by..].iter_mut().zip(&old) {
        row[2] = before[2];
    }
}

const CASES: &[(&str, Wanted, Mangle)] = &[
    ("as it is", Wanted::Right, |_, _| {}),
    ("spikes of the displacement", Wanted::Right, |rows, rng| {
        for _ in 0..8 {
            let k = rng.random_range(50..rows.len() - 50);
            rows[k][2] += 40.0;
        }
    }),
    ("dropouts to zero", Wanted::Right, |rows, rng| {
        for _ in 0..6 {
            let k = rng.random_range(50..rows.len() - 50);
            rows[k..k + 3].iter_mut().for_each(|r| r[2] = 0.0);
        }
    }),
    ("spikes of the voltage", Wanted::Right, |rows, rng| {
        for _ in 0..8 {
            let k = rng.random_range(50..rows.len() - 50);
            rows[k][1] += 8.0;
        }
    }),
    ("cells without a value", Wanted::Right, |rows, rng| {
        for row in rows.iter_mut() {
            if rng.random::<f64>() < 0.03 {
                row[2] = f64::NAN;
            }
        }
    }),
    ("stamps that jitter", Wanted::Right, |rows, rng| {
        rows.iter_mut()
            .for_each(|r| r[0] += 0.003 * rng.random::<f64>());
    }),
    ("rows lost", Wanted::Either, |rows, rng| {
        rows.retain(|_| rng.random::<f64>() > 0.03);
    }),
    ("a gap", Wanted::Either, |rows, _| {
        rows.drain(1200..1500);
    }),
    ("rows there twice", Wanted::Right, |rows, _| {
        let again = rows[100];
        rows.insert(100, again);
    }),
    (
        "the displacement a sample late",
        Wanted::Right,
        |rows, _| {
            late(rows, 1);
        },
    ),
    (
        "the displacement thirty samples late",
        Wanted::Either,
        |rows, _| late(rows, 30),
    ),
    ("the displacement negated", Wanted::Either, |rows, _| {
        rows.iter_mut().for_each(|r| r[2] = -r[2]);
    }),
    ("columns swapped", Wanted::Refused, |rows, _| {
        rows.iter_mut().for_each(|r| r.swap(1, 2));
    }),
    ("the displacement cut off", Wanted::Refused, |rows, _| {
        rows.iter_mut().for_each(|r| r[2] = r[2].min(45.0));
    }),
    ("the voltage cut off", Wanted::Refused, |rows, _| {
        rows.iter_mut().for_each(|r| r[1] = r[1].min(6.5));
    }),
    ("a plateau with noise", Wanted::Either, |rows, rng| {
        rows.iter_mut()
            .for_each(|r| r[2] = r[2].min(45.0) + 0.01 * normal(rng));
    }),
    ("a displacement of noise", Wanted::Refused, |rows, rng| {
        rows.iter_mut().for_each(|r| r[2] = 10.0 * normal(rng));
    }),
    ("of another record", Wanted::Refused, |rows, _| {
        let n = rows.len();
        let old = rows.clone();
        for (k, row) in rows.iter_mut().enumerate() {
            row[2] = old[(k + n / 3) % n][2];
        }
    }),
    (
        "a displacement that never moves",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[2] = 12.0);
        },
    ),
    (
        "time in nanoseconds said to be seconds",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[0] *= 1e9);
        },
    ),
    (
        "micrometres said to be metres",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[2] *= 1e6);
        },
    ),
    (
        "metres said to be micrometres",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[2] *= 1e-6);
        },
    ),
    ("five rows missing", Wanted::Right, |rows, rng| {
        for _ in 0..5 {
            let k = rng.random_range(50..rows.len() - 50);
            rows.remove(k);
        }
    }),
    ("backwards in time", Wanted::Refused, |rows, _| {
        rows.reverse();
    }),
    ("values backwards in time", Wanted::Refused, |rows, _| {
        let old = rows.clone();
        for (row, last) in rows.iter_mut().zip(old.iter().rev()) {
            (row[1], row[2]) = (last[1], last[2]);
        }
    }),
    ("a sensor that drifts", Wanted::Either, |rows, _| {
        let n = rows.len() as f64;
        for (k, row) in rows.iter_mut().enumerate() {
            row[2] += 15.0 * k as f64 / n;
        }
    }),
    ("a gain that changes half way", Wanted::Either, |rows, _| {
        let n = rows.len();
        rows[n / 2..].iter_mut().for_each(|r| r[2] *= 0.6);
    }),
    (
        "a gain of the voltage that changes half way",
        Wanted::Refused,
        |rows, _| {
            let n = rows.len();
            rows[n / 2..].iter_mut().for_each(|r| r[1] *= 0.8);
        },
    ),
    ("a gain that falls by a fifth", Wanted::Either, |rows, _| {
        let n = rows.len() as f64;
        for (k, row) in rows.iter_mut().enumerate() {
            row[2] *= 1.0 - 0.2 * k as f64 / n;
        }
    }),
    ("a small step half way", Wanted::Either, |rows, _| {
        let n = rows.len();
        rows[n / 2..].iter_mut().for_each(|r| r[2] += 1.5);
    }),
    ("a displacement that wraps", Wanted::Refused, |rows, _| {
        rows.iter_mut().for_each(|r| r[2] %= 15.0);
    }),
    // A model without a lag of its own tells such a record as well as any.
    (
        "four samples late, milliseconds said to be seconds",
        Wanted::Either,
        |rows, _| {
            for k in (4..rows.len()).rev() {
                rows[k][2] = rows[k - 4][2];
            }
            rows.drain(..4);
            rows.iter_mut().for_each(|r| r[0] *= 1e3);
        },
    ),
];

/// The model of a mangled record tells the good one, or is refused.
#[test]
fn no_model_of_a_mangled_record_of_a_piezo_is_wrong_and_looks_right() {
    let good = made(1);
    let clean = read(&good).expect("a record").record;
    let mut wrong = Vec::new();
    for (k, (name, wanted, mangle)) in CASES.iter().enumerate() {
        let mut rows = good.clone();
        mangle(&mut rows, &mut Pcg64Mcg::seed_from_u64(700 + k as u64));
        let fitted = read(&rows).and_then(|read| {
            let mut remarks = read.remarks;
            let mut tried = fit(read.record, Kind::Memory).map_err(|e| e.to_string())?;
            if read.timed {
                tried.doubt_lag();
            }
            remarks.extend(tried.document.remarks);
            let remarks = remarks.join(" | ");
            if tried.document.doubt.is_empty() {
                Ok((
                    tried.model,
                    remarks,
                    tried.document.percent_of_range,
                    tried.document.uncompensated_percent,
                ))
            } else {
                Err(tried.document.doubt)
            }
        });
        match fitted {
            Err(why) => {
                eprintln!("refused {name}: {why}");
                if *wanted == Wanted::Right {
                    wrong.push(format!("{name}: refused: {why}"));
                }
            }
            Ok((model, remarks, said, line)) => {
                let off = tell(&model, clean.clone()).document.percent_of_range;
                // A model of columns swapped under their units, or of the half with another gain that the record was
                // cut to, is right of what it was made of.
                let turned = *name == "columns swapped"
                    || remarks.contains("its gain changes")
                    || name.contains("a gain that changes") && remarks.contains("longest stretch");
                let bad = *wanted == Wanted::Refused || (!turned && off > RIGHT.max(2.0 * said));
                eprintln!(
                    "{} {name}: said {said:.2} % (line {line:.2}), is {off:.2} % off | {remarks}",
                    if bad { "WRONG  " } else { "right  " }
                );
                if bad {
                    wrong.push(format!("{name}: said {said:.2} %, is {off:.2} % off"));
                }
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// A displacement that was read late passes for one that lags: the model of the record is off the displacement itself by what is said to be open.
#[test]
fn a_displacement_that_is_read_late_is_known_no_better_than_its_lag() {
    let fine = |rows: &Rows, late: f64| -> Rows {
        let back = late.ceil() as usize;
        let share = back as f64 - late;
        let at = |k: usize| {
            let (a, b) = (rows[k - back][2], rows[(k - back + 1).min(k)][2]);
            a + share * (b - a)
        };
        let whole = (back..rows.len()).map(|k| [rows[k][0], rows[k][1], at(k)]);
        whole.collect()
    };
    for seed in [31, 32] {
        let good = made(seed);
        let clean = read(&good).expect("a record").record;
        for late in [0.0, 0.5, 1.0, 3.0, 8.0] {
            let rows = fine(&good, late);
            let tried = fit(read(&rows).expect("a record").record, Kind::Memory).expect("a model");
            let off = tell(&tried.model, clean.clone()).document.percent_of_range;
            let said = tried.document.percent_of_range;
            let open = tried
                .document
                .known_to_percent
                .expect("a model with memory");
            eprintln!("{seed}, {late}: off {off:.3} %, said {said:.3} %, open {open:.3} %");
            assert!(off < 1.5 * open, "{seed}, {late}: {off} % is not {open} %");
            assert!(
                late > 0.0 || open < 3.0 * said,
                "{seed}: {open} % of {said} %"
            );
        }
    }
}

/// A displacement that is read before the voltage of its row: no piezo leads, and a model without a lead is off by two to ten times what it says.
#[test]
fn a_displacement_that_is_read_early_is_told_for_what_it_is() {
    let good = made(5);
    let clean = read(&good).expect("a record").record;
    let mut straight = f64::NAN;
    for early in [0, 1, 3] {
        let mut rows = good.clone();
        for k in 0..rows.len() - early {
            rows[k][2] = good[k + early][2];
        }
        rows.truncate(good.len() - early);
        let tried = fit(read(&rows).expect("a record").record, Kind::Memory).expect("a model");
        let said = tried.document.remarks.join(" ");
        assert_eq!(
            said.contains("before the voltage"),
            early > 0,
            "{early}: {said}"
        );
        let Model::Memory(model) = tried.model else {
            panic!("{:?}", tried.model);
        };
        let own = Model::Memory(Memory { lag: 0.0, ..model });
        let off = tell(&own, clean.clone()).document.percent_of_range;
        if early == 0 {
            straight = off;
        }
        assert!(
            off < 1.5 * straight,
            "{early}: {off} %, of the record as it is {straight} %"
        );
    }
}

#[test]
fn a_voltage_that_goes_at_one_rate_is_said_to() {
    let remarks = |rows: &Rows| {
        let tried = fit(read(rows).expect("a record").record, Kind::Memory).expect("a model");
        tried.document.remarks.join(" ")
    };
    let said = remarks(&made(6));
    assert!(said.contains("one rate"), "{said}");
    let mut rng = Pcg64Mcg::seed_from_u64(77);
    let said = remarks(&made_at(6, || rng.random_range(10.0..80.0)));
    assert!(!said.contains("one rate"), "{said}");
}

/// A good model on a mangled record: what it says it is off by is what it is off by, or it is doubted.
#[test]
fn no_prediction_of_a_mangled_record_is_wrong_and_looks_right() {
    let model = fit(read(&made(1)).expect("a record").record, Kind::Memory)
        .expect("a model")
        .model;
    let good = made(2);
    let mut wrong = Vec::new();
    for (k, (name, wanted, mangle)) in CASES.iter().enumerate() {
        let mut rows = good.clone();
        mangle(&mut rows, &mut Pcg64Mcg::seed_from_u64(800 + k as u64));
        match read(&rows) {
            Err(why) => {
                eprintln!("refused {name}: {why}");
                if *wanted == Wanted::Right {
                    wrong.push(format!("{name}: refused: {why}"));
                }
            }
            Ok(read) => {
                let document = tell(&model, read.record).document;
                let doubted = !document.doubt.is_empty();
                eprintln!(
                    "{} {name}: {:.2} % {}",
                    if doubted { "doubted" } else { "told   " },
                    document.percent_of_range,
                    document.doubt
                );
                let bad = match wanted {
                    Wanted::Right => doubted || document.percent_of_range > RIGHT,
                    Wanted::Refused => !doubted,
                    Wanted::Either => false,
                };
                if bad {
                    wrong.push(format!(
                        "{name}: {:.2} % {}",
                        document.percent_of_range, document.doubt
                    ));
                }
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// A file, what it drives, and the values at 0, 1 and 2 s that it has to come to; none where it has to be refused.
type Driving = (&'static str, &'static str, input::Kind, Option<[f64; 3]>);

const DRIVING: &[Driving] = &[
    (
        "volts",
        "t_s,u_V\n0,1\n1,2\n2,3\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "millivolts",
        "t_s,u_mV\n0,1000\n1,2000\n2,3000\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "milliseconds",
        "t_ms,u_V\n0,1\n1000,2\n2000,3\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "values first",
        "u_V,t_s\n1,0\n2,1\n3,2\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "decimal commas",
        "t_s;u_V\n0,0;1,0\n1,0;2,0\n2,0;3,0\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "more columns",
        "t_s,x_um,u_V\n0,9,1\n1,9,2\n2,9,3\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "a missing value",
        "t_s,u_V\n0,1\n0.25,\n0.5,1\n0.75,1\n1,2\n1.5,2\n2,3\n",
        input::Kind::Voltage,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "two voltages",
        "t_s,u_V,voltage_V\n0,1,5\n1,2,5\n2,3,5\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "times that fall",
        "t_s,u_V\n0,1\n2,2\n1,3\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "times below zero",
        "t_s,u_V\n-1,1\n1,2\n2,3\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "a length for a voltage",
        "t_s,u_um\n0,1\n1,2\n2,3\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "a foreign unit",
        "t_s,u_counts\n0,1\n1,2\n2,3\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "words",
        "t_s,u_V\n0,on\n1,off\n2,on\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "infinity",
        "t_s,u_V\n0,1\n1,inf\n2,3\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "names again",
        "t_s,u_V\n0,1\n1,2\nt_s,u_V\n2,3\n",
        input::Kind::Voltage,
        None,
    ),
    (
        "a row too long",
        "t_s,u_V\n0,1\n1,2,7\n2,3\n",
        input::Kind::Voltage,
        None,
    ),
    ("nothing", "", input::Kind::Voltage, None),
    ("names alone", "t_s,u_V\n", input::Kind::Voltage, None),
    (
        "counts",
        "t_s,reference\n0,1\n1,2\n2,3\n",
        input::Kind::Reference,
        Some([1.0, 2.0, 3.0]),
    ),
    (
        "millimetres",
        "t_s,ref_mm\n0,1\n1,2\n2,3\n",
        input::Kind::Reference,
        Some([1e-3, 2e-3, 3e-3]),
    ),
    (
        "a voltage for a reference",
        "t_s,ref_V\n0,1\n1,2\n2,3\n",
        input::Kind::Reference,
        None,
    ),
    (
        "centimetres",
        "t_s,ref_cm\n0,1\n1,2\n2,3\n",
        input::Kind::Reference,
        None,
    ),
];

#[test]
fn what_drives_a_simulation_is_read_right_or_refused() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let mut wrong = Vec::new();
    for (name, content, kind, wanted) in DRIVING {
        fs::write(&path, content).expect("a file");
        match (input::read(&path, *kind, &input::Chosen::default()), wanted) {
            (Err(error), None) => eprintln!("refused {name}: {error}"),
            (Err(error), Some(_)) => wrong.push(format!("{name}: {error}")),
            (Ok(read), wanted) => {
                // Each value holds until the next one.
                let at = |t: f64| {
                    let mut before = read.rows.iter().filter(|r| r.0 <= t + 1e-9);
                    before.next_back().map_or(f64::NAN, |r| r.1)
                };
                let found = [0.0, 1.0, 2.0].map(at);
                let right =
                    wanted.is_some_and(|w| w.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-9));
                if !right {
                    wrong.push(format!("{name}: {found:?} for {wanted:?}"));
                }
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}
