//! Cost of one piezo for one servo cycle while its voltage moves.

use criterion::{Criterion, criterion_group, criterion_main};
use pigtail_model::hysteresis::{
    Creep, CreepState, Hysteresis, HysteresisParameters, HysteresisState,
};
use std::hint::black_box;

fn piezo(c: &mut Criterion) {
    let hysteresis = Hysteresis::new(&HysteresisParameters {
        opening: 0.15,
        spread: 0.7,
        skew: 0.04,
        saturation: 0.03,
    })
    .expect("good parameters");
    let creep = Creep::new(0.02, 4e-4).expect("good parameters");
    let mut states = (HysteresisState::default(), CreepState::default());
    let mut k = 0_u32;
    c.bench_function("piezo cycle", |b| {
        b.iter(|| {
            k = k.wrapping_add(1);
            let input = f64::from(k % 1000) / 500.0 - 1.0;
            let applied = hysteresis.advance(&mut states.0, black_box(input));
            black_box(creep.advance(&mut states.1, applied))
        });
    });
    c.bench_function("a hysteresis made", |b| {
        let parameters = HysteresisParameters {
            opening: 0.15,
            spread: 0.7,
            skew: 0.04,
            saturation: 0.03,
        };
        b.iter(|| Hysteresis::new(black_box(&parameters)));
    });
}

criterion_group!(benches, piezo);
criterion_main!(benches);
