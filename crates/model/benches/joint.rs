//! Cost of one joint for one servo cycle, its PID included: in a slow triangle scan, where it
//! sticks and slips all the time, and in a fast sine, where it always slides; and of a joint of a machine
//! of four five-bar joints and two z-stages that all do the same.

#[path = "../tests/joint/parameters.rs"]
mod parameters;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use parameters::{Pid, five_bar, joint, round_up, z_stage};
use pigtail_model::group::{Group, States};
use pigtail_model::joint::{JointParameters, JointState};
use std::hint::black_box;

const CYCLE: f64 = 4e-4;
const CYCLES: usize = 5000;
const JOINTS: usize = 6;

/// A kind of joint, and its PID.
type Kind = (JointParameters, fn() -> Pid);

/// Joints stepped together. The reference is a table, so that only joints are timed.
fn run<const N: usize>(kind: Kind, group: &Group<N>, reference: &[i64]) -> States<N> {
    let mut pids: [Pid; N] = std::array::from_fn(|_| kind.1());
    let mut states = States::new([JointState::default(); N]);
    for k in 0..CYCLES {
        // Each joint at its own point of the path, or their events would coincide.
        let voltages = std::array::from_fn(|i| {
            pids[i].voltage(reference[k + 1000 * i], states.motor_angle(i))
        });
        group.advance(&mut states, voltages);
    }
    states
}

fn group<const N: usize>(kind: Kind) -> Group<N> {
    Group::new([joint(kind.0); N], CYCLE)
}

/// The same one by one.
fn run_each(
    parameters: JointParameters,
    pid: fn() -> Pid,
    reference: &[i64],
) -> [JointState; JOINTS] {
    let joints = [joint(parameters); JOINTS];
    let mut pids: [Pid; JOINTS] = std::array::from_fn(|_| pid());
    let mut states = [JointState::default(); JOINTS];
    for k in 0..CYCLES {
        for (i, ((joint, pid), state)) in joints.iter().zip(&mut pids).zip(&mut states).enumerate()
        {
            let voltage = pid.voltage(reference[k + 1000 * i], state.motor_angle);
            joint.advance(state, voltage, CYCLE);
        }
    }
    states
}

fn table(reference: impl Fn(f64) -> f64) -> Vec<i64> {
    (0..CYCLES + 1000 * JOINTS)
        .map(|k| round_up(reference(k as f64 * 4e-4)))
        .collect()
}

fn joint_cycle(c: &mut Criterion) {
    let mut bench = c.benchmark_group("joint cycle");
    bench.throughput(Throughput::Elements((CYCLES * JOINTS) as u64));
    // 0.4 mm/s on the five-bar: it sticks and slips all the time.
    let triangle = table(|t| 200.0 * (1.0 - 4.0 * ((0.5 * t + 0.25).fract() - 0.5).abs()));
    let sine = table(|t| 200.0 * (50.0 * t).sin());
    let hold = table(|_| 100.0);
    let motions = [
        ("slow triangle", &triangle),
        ("8 Hz sine", &sine),
        ("holding", &hold),
    ];
    for (name, parameters, pid) in [
        ("five-bar", five_bar(), Pid::five_bar as fn() -> Pid),
        ("z-stage", z_stage(), Pid::z_stage),
    ] {
        let kind = (parameters, pid);
        for (motion, reference) in motions {
            let joints = group::<JOINTS>(kind);
            bench.bench_function(format!("{name}, {motion}"), |b| {
                b.iter(|| run(kind, black_box(&joints), reference));
            });
            bench.bench_function(format!("{name}, {motion}, one by one"), |b| {
                b.iter(|| run_each(black_box(parameters), pid, reference));
            });
        }
    }
    for (motion, reference) in motions {
        let kinds: [Kind; 2] = [(five_bar(), Pid::five_bar), (z_stage(), Pid::z_stage)];
        let (five_bars, z_stages) = (group::<4>(kinds[0]), group::<2>(kinds[1]));
        bench.bench_function(format!("machine, {motion}"), |b| {
            b.iter(|| {
                (
                    run(kinds[0], black_box(&five_bars), reference),
                    run(kinds[1], black_box(&z_stages), reference),
                )
            });
        });
    }
    bench.finish();
}

criterion_group!(benches, joint_cycle);
criterion_main!(benches);
