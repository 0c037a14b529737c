//! Axes whose force has more in it than inertia and friction, that rest between their moves, or that change meanwhile.

use crate::Wanted;
use crate::servo::{MADE, PERIOD, Rows, SLED, answer, judge, read_at, text, there_and_back};
use pigtail_sysid::servo::Axis;
use std::f64::consts::TAU;

/// An axis, its reference over time, and a force (N) over place, velocity and time that holds it beside.
struct Case {
    name: &'static str,
    wanted: Wanted,
    reference: fn(f64) -> f64,
    beside: fn(f64, f64, f64) -> f64,
    axis: fn(f64) -> Axis,
}

const SECONDS: f64 = 12.0;

fn waves(t: f64) -> f64 {
    0.08 * (1.9 * t + 0.4).sin() + 0.03 * (5.3 * t + 2.0).sin() + 0.004 * (17.0 * t + 4.0).sin()
}

/// To and fro by 100 mm in half a second, then a rest of one and a half.
fn moves(t: f64) -> f64 {
    let (turn, s) = ((t / 2.0) as u32, ((t % 2.0) / 0.5).min(1.0));
    let way = s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
    0.1 * if turn.is_multiple_of(2) {
        way
    } else {
        1.0 - way
    }
}

fn same(_: f64) -> Axis {
    SLED
}

fn heavier(by: f64) -> Axis {
    Axis {
        inertia: SLED.inertia + by,
        ..SLED
    }
}

fn made(case: &Case) -> Rows {
    let fine = 10;
    let h = PERIOD / f64::from(fine);
    let n = (SECONDS / PERIOD) as u32;
    let start = (case.reference)(0.0);
    let mut state = (start, 0.0);
    let (mut last, mut voltage) = (start, 0.0);
    let dense: Vec<[f64; 4]> = (0..n * fine)
        .map(|k| {
            let t = f64::from(k) * h;
            let r = (case.reference)(t);
            if k.is_multiple_of(fine) {
                let velocity = (state.0 - last) / PERIOD;
                voltage = (243.0 * (160.0 * (r - state.0) - velocity)).clamp(-10.0, 10.0);
                last = state.0;
            }
            let row = [t, r, state.0, voltage];
            let beside = (case.beside)(state.0, state.1, t) / SLED.force_per_volt;
            state = (case.axis)(t).advance(state, voltage - beside, h);
            row
        })
        .collect();
    let times: Vec<f64> = (0..n).map(|k| f64::from(k) * PERIOD).collect();
    read_at(&dense, &times, &times, 17)
}

const CASES: &[Case] = &[
    Case {
        name: "a weight on a lever",
        wanted: Wanted::Right,
        reference: waves,
        beside: |x, _, _| 30.0 * (x / 0.05).sin(),
        axis: same,
    },
    Case {
        name: "a spring",
        wanted: Wanted::Right,
        reference: waves,
        beside: |x, _, _| 300.0 * x,
        axis: same,
    },
    Case {
        name: "a motor's cogging at every 10 mm",
        wanted: Wanted::Right,
        reference: waves,
        beside: |x, _, _| 15.0 * (TAU * x / 0.01).sin(),
        axis: same,
    },
    Case {
        name: "a spring, on the same move there and back, again and again",
        wanted: Wanted::Right,
        reference: |t| there_and_back(t, 2.6),
        beside: |x, _, _| 1000.0 * x,
        axis: same,
    },
    Case {
        name: "cogging at every 20 mm, on such a move",
        wanted: Wanted::Right,
        reference: |t| there_and_back(t, 2.4),
        beside: |x, _, _| 3.0 * (TAU * x / 0.02).sin(),
        axis: same,
    },
    Case {
        name: "a weight",
        wanted: Wanted::Right,
        reference: waves,
        beside: |_, _, _| 60.0,
        axis: same,
    },
    Case {
        name: "friction that is higher at low speed",
        wanted: Wanted::Right,
        reference: waves,
        beside: |_, v, _| 25.0 * (-(v / 0.02).powi(2)).exp() * (v / 2e-4).tanh(),
        axis: same,
    },
    Case {
        name: "moves with rests between them",
        wanted: Wanted::Right,
        reference: moves,
        beside: |_, _, _| 0.0,
        axis: same,
    },
    Case {
        name: "moves one way with rests between them",
        wanted: Wanted::Refused,
        reference: |t| moves(t % 2.0) + 0.1 * (t / 2.0).floor(),
        beside: |_, _, _| 0.0,
        axis: same,
    },
    Case {
        name: "40 kg more from the middle on",
        wanted: Wanted::Refused,
        reference: waves,
        beside: |_, _, _| 0.0,
        axis: |t| heavier(if t < 0.5 * SECONDS { 0.0 } else { 40.0 }),
    },
    Case {
        name: "40 kg more at the end",
        wanted: Wanted::Either,
        reference: waves,
        beside: |_, _, _| 0.0,
        axis: |t| heavier(if t < 0.85 * SECONDS { 0.0 } else { 40.0 }),
    },
    Case {
        name: "a load that comes and goes",
        wanted: Wanted::Refused,
        reference: waves,
        beside: |_, _, _| 0.0,
        axis: |t| {
            heavier(if ((t / 3.0) as u32).is_multiple_of(2) {
                0.0
            } else {
                40.0
            })
        },
    },
];

#[test]
fn no_force_beside_inertia_and_friction_is_taken_for_them() {
    let mut wrong = Vec::new();
    for case in CASES {
        let rows = made(case);
        judge(
            case.name,
            case.wanted,
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
