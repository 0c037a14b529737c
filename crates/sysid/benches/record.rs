//! Cost of identifying a servo axis from 25,000 rows by all variants (at most 1 s is wanted).

use criterion::{Criterion, criterion_group, criterion_main};
use pigtail_sysid::servo::{Axis, Controller, Record, Settings, identify};
use pigtail_sysid::timeline::even;
use std::hint::black_box;

const ROWS: usize = 25_000;
const PERIOD: f64 = 1e-3;

fn servo(c: &mut Criterion) {
    let axis = Axis {
        force_per_volt: 35.0,
        inertia: 95.0,
        viscous: [200.0, 220.0],
        coulomb: [20.0, 22.0],
        offset: -3.0,
    };
    let time: Vec<f64> = (0..ROWS).map(|k| PERIOD * k as f64).collect();
    let reference: Vec<f64> = time
        .iter()
        .map(|t| 0.1 * (1.1 * t).sin() + 0.02 * (5.0 * t).sin())
        .collect();
    let (mut at, mut before) = ((0.0, 0.0), [0.0; 2]);
    let (mut position, mut volts) = (Vec::new(), Vec::new());
    for (k, r) in reference.iter().enumerate() {
        // A hundredth of a micrometre of noise, the same every time.
        let seen = at.0 + 1e-8 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0);
        let u = 243.0 * (160.0 * (r - seen) - (seen - before[1]) / (2.0 * PERIOD));
        before = [seen, before[0]];
        position.push(seen);
        volts.push(u.clamp(-10.0, 10.0));
        at = axis.advance(at, u.clamp(-10.0, 10.0), PERIOD);
    }
    let settings = Settings {
        controller: Some(Controller::cascade(160.0, 243.0, 10.0)),
        ..Settings::new(35.0)
    };
    c.bench_function("a servo from 25,000 rows", |b| {
        b.iter(|| {
            let grid = even(&time, &[&position, &volts, &reference]).expect("even");
            identify(&Record::new(grid, true), None, black_box(&settings))
        });
    });
}

criterion_group!(benches, servo);
criterion_main!(benches);
