//! Cost of one servo cycle of control: trajectory, inverse kinematics, windup compensation by 16
//! elements on each axis and PID for the six motors, and the four piezos of the micros. The
//! machine answers at once, so nothing of the twin is in it.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Obedient, calibration, spec};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pigtail_control::station::{Station, Unobserved};
use pigtail_control::trajectory::{Arc, Path, Shape};
use pigtail_hal::Side;
use pigtail_model::frames::{Displacement, Point};
use std::f64::consts::TAU;
use std::hint::black_box;

/// Cycles in one iteration.
const CYCLES: u32 = 2500;
/// Turns of an arc that no bench sees the end of.
const ENDLESS: f64 = 1e6;

fn cycle(c: &mut Criterion) {
    let spec = spec();
    let calibration = calibration(&spec);
    let mut group = c.benchmark_group("servo cycle");
    group.throughput(Throughput::Elements(u64::from(CYCLES)));
    for shape in [Shape::Trapezoid, Shape::SCurve] {
        let mut machine = Obedient::new(spec.clone());
        let mut unobserved = Unobserved;
        let mut station =
            Station::new(&mut machine, &calibration, &mut unobserved).expect("no fault");
        station.set_shape(shape);
        for side in Side::ALL {
            // It rises a little all the time, so that the z-stage's compensation has work too.
            let arc = Arc::about(station.wanted(side), [5e-3, 0.0], TAU * ENDLESS, 10e-3);
            station.start_arc(side, arc, None).expect("it fits");
        }
        let mut k = 0_u32;
        group.bench_function(format!("both manipulators on helices, {shape:?}"), |b| {
            b.iter(|| {
                for _ in 0..CYCLES {
                    k = k.wrapping_add(1);
                    let way = 1e-8 * f64::from(k % 1000);
                    station.move_micro(Side::Left, Displacement::new(way, -way));
                    station.move_micro(Side::Right, Displacement::new(-way, way));
                    station.cycle().expect("no fault");
                }
                black_box(station.time())
            });
        });
        assert!(Side::ALL.into_iter().all(|side| station.moving(side)));
    }
    group.finish();
}

/// What the check before a motion costs, which alignment starts by the thousand.
fn start(c: &mut Criterion) {
    let spec = spec();
    let calibration = calibration(&spec);
    let mut machine = Obedient::new(spec);
    let mut unobserved = Unobserved;
    let mut station = Station::new(&mut machine, &calibration, &mut unobserved).expect("no fault");
    let mut group = c.benchmark_group("start of a motion");
    for shape in [Shape::Trapezoid, Shape::SCurve] {
        station.set_shape(shape);
        group.bench_function(format!("line, {shape:?}"), |b| {
            b.iter(|| station.start_line(Side::Left, black_box(Point::new(1e-6, 2e-6, 0.0)), None));
        });
        let arc = Arc::about(station.wanted(Side::Left), [5e-3, 0.0], TAU, 10e-3);
        assert!(Path::from(arc).length() > 0.0);
        group.bench_function(format!("arc, {shape:?}"), |b| {
            b.iter(|| station.start_arc(Side::Left, black_box(arc), None));
        });
    }
    group.finish();
}

criterion_group!(benches, cycle, start);
criterion_main!(benches);
