//! Impulse control: what a pulse takes with the measurements around it, the map over both harmonics
//! (Fig. 4.17, 1600 pulses on all cores), a loop to its target (Fig. 4.20), and a shape's worth.

use criterion::{Criterion, criterion_group, criterion_main};
use pigtail_evaluate::impulse::response::map;
use pigtail_evaluate::impulse::run::{Task, run};
use pigtail_evaluate::impulse::shapes::{Effort, study};
use pigtail_session::impulse::believed;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use std::hint::black_box;

fn impulse(c: &mut Criterion) {
    let setup = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the rig is well");
    let at = "z".parse().expect("an axis");
    let belief = believed(&setup.rig, at).expect("the rig is calibrated");
    let mut group = c.benchmark_group("impulse");

    // Its readings and the dither make most of it.
    let impulses = belief.impulses(at, 25);
    let pulse = belief.shape().pulse(1.5 * belief.unit, true);
    setup
        .experiment(1, |station| {
            impulses.begin(station)?;
            group.bench_function("one pulse on z, measured and relaxed", |b| {
                b.iter(|| black_box(impulses.respond(station, pulse)).expect("no fault"));
            });
            Ok(())
        })
        .expect("no fault");

    group.sample_size(10);
    group.bench_function("map over both harmonics on z", |b| {
        b.iter(|| map(&setup, at, black_box(1), belief).expect("no fault"));
    });
    let task = Task::usual(at, 1e-7);
    group.bench_function("loop of 100 nm on z", |b| {
        b.iter(|| run(&setup, &task, black_box(1)).expect("no fault"));
    });
    let effort = Effort {
        machines: 16,
        judges: 16,
        generations: 0,
        members: 1,
    };
    group.bench_function("shapes without a search", |b| {
        b.iter(|| study(&setup, at, black_box(1), &effort).expect("no fault"));
    });
    group.finish();
}

criterion_group!(benches, impulse);
criterion_main!(benches);
