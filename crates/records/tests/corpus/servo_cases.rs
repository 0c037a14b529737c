//! What may be done to a record of a servo, and what has to come of it.

use crate::servo::Rows;
use crate::{Wanted, normal};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

pub(crate) type Mangle = fn(&mut Rows, &mut Pcg64Mcg);

pub(crate) const MANGLED: &[(&str, Wanted, Mangle)] = &[
    ("as it is", Wanted::Right, |_, _| {}),
    (
        "a position of another scale than its reference",
        Wanted::Refused,
        |rows, _| rows.iter_mut().for_each(|r| r[2] *= 1.1),
    ),
    (
        "a reference of another scale than its position",
        Wanted::Either,
        |rows, _| rows.iter_mut().for_each(|r| r[1] *= 0.95),
    ),
    ("a voltage that was low-passed", Wanted::Right, |rows, _| {
        let mut last = rows[0][3];
        for row in rows {
            last += 0.4 * (row[3] - last);
            row[3] = last;
        }
    }),
    (
        "a voltage that is a moving average",
        Wanted::Right,
        |rows, _| {
            let old: Vec<f64> = rows.iter().map(|r| r[3]).collect();
            for (k, row) in rows.iter_mut().enumerate() {
                let from = k.saturating_sub(4);
                row[3] = old[from..=k].iter().sum::<f64>() / (k + 1 - from) as f64;
            }
        },
    ),
    (
        "1 % stamped late, to 0.8 periods",
        Wanted::Right,
        |rows, rng| {
            let h = rows[1][0] - rows[0][0];
            for row in rows {
                if rng.random::<f64>() < 0.01 {
                    row[0] += 0.8 * h * rng.random::<f64>();
                }
            }
        },
    ),
    (
        "5 % stamped late, to 0.95 periods",
        Wanted::Right,
        |rows, rng| {
            let h = rows[1][0] - rows[0][0];
            for row in rows {
                if rng.random::<f64>() < 0.05 {
                    row[0] += 0.95 * h * rng.random::<f64>();
                }
            }
        },
    ),
    ("stamps jitter 0.32 periods", Wanted::Right, |rows, rng| {
        let h = rows[1][0] - rows[0][0];
        for row in rows {
            row[0] += h * rng.random_range(-0.32..0.32);
        }
    }),
    ("stamps jitter 0.45 periods", Wanted::Right, |rows, rng| {
        let h = rows[1][0] - rows[0][0];
        for row in rows {
            row[0] += h * rng.random_range(-0.45..0.45);
        }
    }),
    (
        "stamps late by milliseconds at times, as by a busy computer",
        Wanted::Either,
        |rows, rng| {
            let h = rows[1][0] - rows[0][0];
            let mut until = 0.0;
            for row in rows {
                if rng.random::<f64>() < 0.001 {
                    until = row[0] + 4.0 * h;
                }
                if row[0] < until {
                    row[0] = until + 0.01 * (row[0] - until + 4.0 * h);
                }
            }
        },
    ),
    ("2 % of rows lost", Wanted::Right, |rows, rng| {
        rows.retain(|_| rng.random::<f64>() > 0.02);
    }),
    (
        "10 % of rows lost, stamps jitter",
        Wanted::Right,
        |rows, rng| {
            let h = rows[1][0] - rows[0][0];
            for row in rows.iter_mut() {
                row[0] += h * rng.random_range(-0.2..0.2);
            }
            rows.retain(|_| rng.random::<f64>() > 0.1);
        },
    ),
    (
        "rows lost and no stamp shows it",
        Wanted::Either,
        |rows, rng| {
            let h = rows[1][0] - rows[0][0];
            rows.retain(|_| rng.random::<f64>() > 0.01);
            for (k, row) in rows.iter_mut().enumerate() {
                row[0] = h * k as f64;
            }
        },
    ),
    ("rows twice", Wanted::Right, |rows, rng| {
        let old = std::mem::take(rows);
        for row in old {
            rows.push(row);
            if rng.random::<f64>() < 0.01 {
                rows.push(row);
            }
        }
    }),
    ("stamps of whole 4 ms", Wanted::Right, |rows, _| {
        for row in rows {
            row[0] = (row[0] / 4e-3 + 1e-6).floor() * 4e-3;
        }
    }),
    ("stamps of whole 0.7 periods", Wanted::Right, |rows, _| {
        for row in rows {
            row[0] = (row[0] / 7e-4 + 1e-6).floor() * 7e-4;
        }
    }),
    (
        "voltage clipped in the record",
        Wanted::Either,
        |rows, _| {
            let most = rows.iter().fold(0.0_f64, |m, r| m.max(r[3].abs()));
            for row in rows {
                row[3] = row[3].clamp(-0.6 * most, 0.6 * most);
            }
        },
    ),
    ("voltage clipped on one side", Wanted::Either, |rows, _| {
        let most = rows.iter().fold(0.0_f64, |m, r| m.max(r[3].abs()));
        for row in rows {
            row[3] = row[3].min(0.5 * most);
        }
    }),
    (
        "voltage nearly clipped: a plateau with noise",
        Wanted::Either,
        |rows, rng| {
            let most = rows.iter().fold(0.0_f64, |m, r| m.max(r[3].abs()));
            for row in rows {
                let noise = 0.003 * most * normal(rng);
                row[3] = row[3].clamp(-0.6 * most, 0.6 * most) + noise;
            }
        },
    ),
    ("voltage softly clipped", Wanted::Either, |rows, _| {
        let most = rows.iter().fold(0.0_f64, |m, r| m.max(r[3].abs()));
        for row in rows {
            let x = row[3] / (0.6 * most);
            row[3] = 0.6 * most * x / (1.0 + x.abs().powi(6)).powf(1.0 / 6.0);
        }
    }),
    ("position clipped", Wanted::Either, |rows, _| {
        let top = rows.iter().fold(f64::MIN, |m, r| m.max(r[2]));
        for row in rows {
            row[2] = row[2].min(0.8 * top);
        }
    }),
    ("a spike of 1 mm", Wanted::Right, |rows, _| {
        rows[7000][2] += 1e-3;
    }),
    ("ten spikes of 0.2 to 5 mm", Wanted::Right, |rows, rng| {
        for _ in 0..10 {
            let k = rng.random_range(100..rows.len() - 100);
            rows[k][2] += rng.random_range(2e-4..5e-3) * if rng.random() { 1.0 } else { -1.0 };
        }
    }),
    (
        "position drops to zero for five samples",
        Wanted::Right,
        |rows, rng| {
            for _ in 0..5 {
                let k = rng.random_range(100..rows.len() - 100);
                for row in &mut rows[k..k + 5] {
                    row[2] = 0.0;
                }
            }
        },
    ),
    (
        "position of -999 where none was read",
        Wanted::Right,
        |rows, rng| {
            for _ in 0..30 {
                let k = rng.random_range(100..rows.len() - 100);
                rows[k][2] = -999.0;
            }
        },
    ),
    (
        "spikes of 5 V in the voltage",
        Wanted::Right,
        |rows, rng| {
            for _ in 0..40 {
                let k = rng.random_range(100..rows.len() - 100);
                rows[k][3] += 5.0 * if rng.random() { 1.0 } else { -1.0 };
            }
        },
    ),
    ("the encoder slips by 0.3 mm", Wanted::Either, |rows, _| {
        for row in &mut rows[9000..] {
            row[2] += 3e-4;
        }
    }),
    (
        "position frozen for 20 samples at times",
        Wanted::Either,
        |rows, rng| {
            for _ in 0..20 {
                let k = rng.random_range(100..rows.len() - 100);
                for i in k + 1..k + 20 {
                    rows[i][2] = rows[k][2];
                }
            }
        },
    ),
    ("position a sample late", Wanted::Right, |rows, _| {
        shift(rows, 2, 1.0);
    }),
    ("position a sample early", Wanted::Right, |rows, _| {
        shift(rows, 2, -1.0);
    }),
    ("position 3.4 samples late", Wanted::Right, |rows, _| {
        shift(rows, 2, 3.4);
    }),
    ("position 8 samples early", Wanted::Either, |rows, _| {
        shift(rows, 2, -8.0);
    }),
    ("position 40 samples late", Wanted::Either, |rows, _| {
        shift(rows, 2, 40.0);
    }),
    (
        "the voltage's clock drifts by 0.02 %",
        Wanted::Either,
        |rows, _| {
            let old = rows.clone();
            for (k, row) in rows.iter_mut().enumerate() {
                row[3] = between(&old, 3, k as f64 * 1.0002);
            }
        },
    ),
    ("voltage negated", Wanted::Refused, |rows, _| {
        rows.iter_mut().for_each(|r| r[3] = -r[3]);
    }),
    ("position negated", Wanted::Refused, |rows, _| {
        rows.iter_mut().for_each(|r| r[2] = -r[2]);
    }),
    (
        "position and voltage swapped",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r.swap(2, 3));
        },
    ),
    (
        "reference and position swapped",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r.swap(1, 2));
        },
    ),
    (
        "reference and voltage swapped",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r.swap(1, 3));
        },
    ),
    (
        "the reference in the place of the position",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[2] = r[1]);
        },
    ),
    (
        "millimetres said to be metres",
        Wanted::Refused,
        |rows, _| {
            for r in rows {
                r[1] *= 1e3;
                r[2] *= 1e3;
            }
        },
    ),
    ("position in counts", Wanted::Refused, |rows, _| {
        for r in rows {
            r[1] = (r[1] / 1e-6).round();
            r[2] = (r[2] / 1e-6).round();
        }
    }),
    (
        "position in counts, the reference not",
        Wanted::Refused,
        |rows, _| {
            for r in rows {
                r[2] = (r[2] / 1e-6).round();
            }
        },
    ),
    (
        "time in milliseconds said to be seconds",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[0] *= 1e3);
        },
    ),
    ("voltage is noise", Wanted::Refused, |rows, rng| {
        rows.iter_mut().for_each(|r| r[3] = normal(rng));
    }),
    ("voltage from another day", Wanted::Refused, |rows, _| {
        let n = rows.len();
        let old: Vec<f64> = rows.iter().map(|r| r[3]).collect();
        for (k, r) in rows.iter_mut().enumerate() {
            r[3] = old[(k + n / 3) % n];
        }
    }),
    ("voltage quantised to 0.2 V", Wanted::Right, |rows, _| {
        rows.iter_mut()
            .for_each(|r| r[3] = (r[3] / 0.2).round() * 0.2);
    }),
    ("position quantised to 20 um", Wanted::Either, |rows, _| {
        rows.iter_mut()
            .for_each(|r| r[2] = (r[2] / 2e-5).round() * 2e-5);
    }),
    (
        "position with 10 um of noise",
        Wanted::Either,
        |rows, rng| {
            rows.iter_mut().for_each(|r| r[2] += 1e-5 * normal(rng));
        },
    ),
    ("half of it NaN", Wanted::Either, |rows, rng| {
        for r in rows {
            if rng.random::<f64>() < 0.15 {
                r[2] = f64::NAN;
            }
        }
    }),
    (
        "position read every fourth row",
        Wanted::Refused,
        |rows, _| {
            let old = rows.clone();
            for (k, row) in rows.iter_mut().enumerate() {
                row[2] = old[k - k % 4][2];
            }
        },
    ),
    ("every fifth sample only", Wanted::Either, |rows, _| {
        let old = std::mem::take(rows);
        rows.extend(old.into_iter().step_by(5));
    }),
    ("backwards in time", Wanted::Refused, |rows, _| {
        rows.reverse();
    }),
    (
        "backwards in time, restamped",
        Wanted::Refused,
        |rows, _| {
            let times: Vec<f64> = rows.iter().map(|r| r[0]).collect();
            rows.reverse();
            for (row, t) in rows.iter_mut().zip(times) {
                row[0] = t;
            }
        },
    ),
    (
        "its middle backwards in time, restamped",
        Wanted::Refused,
        |rows, _| {
            let n = rows.len();
            let times: Vec<f64> = rows.iter().map(|r| r[0]).collect();
            rows[n / 3..2 * n / 3].reverse();
            for (row, t) in rows.iter_mut().zip(times) {
                row[0] = t;
            }
        },
    ),
    (
        "voltage negated in its middle",
        Wanted::Refused,
        |rows, _| {
            let n = rows.len();
            rows[n / 3..2 * n / 3].iter_mut().for_each(|r| r[3] = -r[3]);
        },
    ),
    (
        "position negated in its middle",
        Wanted::Refused,
        |rows, _| {
            let n = rows.len();
            rows[n / 3..2 * n / 3].iter_mut().for_each(|r| r[2] = -r[2]);
        },
    ),
    (
        "voltage of half the gain behind its middle",
        Wanted::Refused,
        |rows, _| {
            let n = rows.len();
            rows[n / 2..].iter_mut().for_each(|r| r[3] *= 0.4);
        },
    ),
    (
        "voltage's size without its sign",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[3] = r[3].abs());
        },
    ),
    (
        "a velocity in the place of the position",
        Wanted::Refused,
        |rows, _| {
            let old = rows.clone();
            for k in 1..old.len() {
                rows[k][2] = (old[k][2] - old[k - 1][2]) / (old[k][0] - old[k - 1][0]);
            }
        },
    ),
    (
        "position that begins anew at every 30 mm",
        Wanted::Refused,
        |rows, _| {
            rows.iter_mut().for_each(|r| r[2] = r[2].rem_euclid(0.03));
        },
    ),
    ("voltage with 5 V of offset", Wanted::Right, |rows, _| {
        rows.iter_mut().for_each(|r| r[3] += 5.0);
    }),
    ("all of it negated", Wanted::Right, |rows, _| {
        for r in rows {
            for value in &mut r[1..] {
                *value = -*value;
            }
        }
    }),
    (
        "position held for five samples",
        Wanted::Either,
        |rows, _| {
            let old = rows.clone();
            for (k, row) in rows.iter_mut().enumerate() {
                row[2] = old[k / 5 * 5][2];
            }
        },
    ),
    (
        "voltage held for five samples",
        Wanted::Either,
        |rows, _| {
            let old = rows.clone();
            for (k, row) in rows.iter_mut().enumerate() {
                row[3] = old[k / 5 * 5][3];
            }
        },
    ),
    (
        "voltage through a filter of 20 ms",
        Wanted::Either,
        |rows, _| {
            let mut slow = rows[0][3];
            for row in rows {
                slow += 0.05 * (row[3] - slow);
                row[3] = slow;
            }
        },
    ),
    ("one way only", Wanted::Refused, |rows, _| {
        let old = std::mem::take(rows);
        let mut last = f64::MIN;
        rows.extend(old.into_iter().filter(|r| {
            let up = r[2] > last;
            last = r[2];
            up
        }));
    }),
    (
        "a voltage that is written smaller at its peaks",
        Wanted::Either,
        |rows, _| peaked(rows, 1.0),
    ),
    (
        "a voltage that is written a little smaller at its peaks",
        Wanted::Either,
        |rows, _| peaked(rows, 1.67),
    ),
    (
        "a voltage that is written hardly smaller at its peaks",
        Wanted::Either,
        |rows, _| peaked(rows, 2.5),
    ),
    (
        "2 % of the voltages with the other sign",
        Wanted::Right,
        |rows, rng| some(rows, rng, 0.02, |u| -u),
    ),
    (
        "5 % of the voltages with the other sign",
        Wanted::Either,
        |rows, rng| some(rows, rng, 0.05, |u| -u),
    ),
    (
        "voltages lost in 30 runs of 3 to 20 rows, written as 0 V",
        Wanted::Right,
        |rows, rng| {
            for _ in 0..30 {
                let n = rng.random_range(3..=20);
                let k = rng.random_range(100..rows.len() - 100);
                rows[k..k + n].iter_mut().for_each(|r| r[3] = 0.0);
            }
        },
    ),
    (
        "30 runs of 3 to 20 rows of another channel's noise for the voltage",
        Wanted::Right,
        |rows, rng| {
            for _ in 0..30 {
                let n = rng.random_range(3..=20);
                let k = rng.random_range(100..rows.len() - 100);
                for row in &mut rows[k..k + n] {
                    row[3] = 0.01 * normal(rng);
                }
            }
        },
    ),
    (
        "position and voltage through one filter of 30 ms",
        Wanted::Either,
        |rows, _| {
            let by = 1.0 - (-(rows[1][0] - rows[0][0]) / 0.03).exp();
            for column in [2, 3] {
                let mut last = rows[0][column];
                for row in rows.iter_mut() {
                    last += by * (row[column] - last);
                    row[column] = last;
                }
            }
        },
    ),
    ("3 % of the voltages lost", Wanted::Right, |rows, rng| {
        some(rows, rng, 0.03, |_| 0.0);
    }),
    (
        "a position that is the mean of 81 rows",
        Wanted::Either,
        |rows, _| mean(rows, 2, 81),
    ),
    (
        "a position that is the mean of 41 rows, and flipped voltages",
        Wanted::Either,
        |rows, rng| {
            mean(rows, 2, 41);
            some(rows, rng, 0.02, |u| -u);
        },
    ),
    (
        "a voltage that is the mean of 81 rows",
        Wanted::Either,
        |rows, _| mean(rows, 3, 81),
    ),
];

/// What becomes of some of the voltages.
fn some(rows: &mut Rows, rng: &mut Pcg64Mcg, share: f64, of: fn(f64) -> f64) {
    for row in rows {
        if rng.random::<f64>() < share {
            row[3] = of(row[3]);
        }
    }
}

/// Means over an odd number of rows about each.
fn mean(rows: &mut Rows, column: usize, over: usize) {
    let old: Vec<f64> = rows.iter().map(|r| r[column]).collect();
    for (k, row) in rows.iter_mut().enumerate() {
        let near = &old[k.saturating_sub(over / 2)..(k + over / 2 + 1).min(old.len())];
        row[column] = near.iter().sum::<f64>() / near.len() as f64;
    }
}

/// Compressed, as by a stage that bends: linear where it is small, and at its highest what `tanh(1 / level)` makes of it.
fn peaked(rows: &mut Rows, level: f64) {
    let most = level * rows.iter().map(|r| r[3].abs()).fold(0.0, f64::max);
    rows.iter_mut()
        .for_each(|r| r[3] = most * (r[3] / most).tanh());
}

pub(crate) fn between(rows: &Rows, column: usize, place: f64) -> f64 {
    let place = place.clamp(0.0, rows.len() as f64 - 1.001);
    let k = place as usize;
    let f = place - k as f64;
    rows[k][column] * (1.0 - f) + rows[k + 1][column] * f
}

/// A column read by so many samples too late.
pub(crate) fn shift(rows: &mut Rows, column: usize, samples: f64) {
    let old = rows.clone();
    for (k, row) in rows.iter_mut().enumerate() {
        row[column] = between(&old, column, k as f64 - samples);
    }
}
