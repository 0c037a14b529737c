//! Cost of the models of hysteresis: one step of compensation (at most 1 us is wanted with 75
//! functions), training 75 functions with 2,000 points (at most 50 ms), learning one more point.

use criterion::{Criterion, criterion_group, criterion_main};
use pigtail_control::compensation::hysteresis::{
    Memory, Model, Network, RIDGE, Range, Rbf, Recursive, SPACING, Sample, UNITS,
};
use std::hint::black_box;

const VOLTS: Range = Range {
    low: 0.0,
    high: 10.0,
};

fn samples() -> Vec<Sample> {
    (0..2000)
        .map(|k| {
            let turn = 1.0 + 9.0 * f64::from(k % 40) / 40.0;
            let at = [turn, turn * f64::from(k / 40) / 50.0];
            (at, at[1] + 0.1 * at[1] * (turn - at[1]))
        })
        .collect()
}

fn step(c: &mut Criterion, name: &str, model: &Model) {
    let mut state = model.switched_on();
    let mut k = 0_u32;
    c.bench_function(name, |b| {
        b.iter(|| {
            k = k.wrapping_add(1);
            let wanted = f64::from(k % 1000) / 100.0;
            model.voltage(&mut state, black_box(wanted), 4e-4, &VOLTS)
        });
    });
}

fn hysteresis(c: &mut Criterion) {
    let samples = samples();
    let mut network = Network::new(Network::lattice(SPACING), Network::rule(SPACING))
        .expect("a lattice is there");
    network.train(&samples, RIDGE);
    let rbf = Rbf::new(VOLTS, VOLTS, VOLTS, network.clone(), network.clone());
    let rbf = Model::Rbf(rbf.expect("a network over a range"));
    step(c, "a step of 75 functions", &rbf);
    let slack = Memory::usual_slack();
    let memory = Model::Memory(Memory {
        input: VOLTS,
        output: VOLTS,
        slack,
        weights: slack.map(|r| if r == 0.0 { 0.7 } else { 0.015 }),
        offset: 0.0,
        curve: [0.04, 0.02],
        constants: std::array::from_fn(|i| 0.02 * 10.0_f64.powf(0.5 * i as f64)),
        shares: [0.01; 12],
        lag: 0.0,
    });
    step(c, "a step with memory", &memory);

    c.bench_function("75 functions trained with 2000 points", |b| {
        b.iter(|| network.train(black_box(&samples), RIDGE));
    });
    let mut learner = Recursive::new(&network, 1.0, 0.999).expect("good numbers");
    c.bench_function("75 functions learn a point", |b| {
        b.iter(|| learner.learn(&mut network, black_box(([UNITS, 3.0], 3.1))));
    });
}

criterion_group!(benches, hysteresis);
criterion_main!(benches);
