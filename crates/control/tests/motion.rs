//! Motions as a station follows and refuses them.

mod common;

use common::{Obedient, calibration, spec};
use pigtail_control::kinematics::Kinematics;
use pigtail_control::outcome::Outcome;
use pigtail_control::station::{Station, Unobserved};
use pigtail_control::trajectory::{Arc, Limits, Line, Motion, Path, Rates, Shape};
use pigtail_hal::{Side, Spec};
use pigtail_model::frames::{Macro, Point};
use proptest::prelude::*;

fn with_station<T>(spec: &Spec, work: impl FnOnce(&mut Station) -> T) -> T {
    let calibration = calibration(spec);
    let mut machine = Obedient::new(spec.clone());
    let mut unobserved = Unobserved;
    let mut station = Station::new(&mut machine, &calibration, &mut unobserved).expect("no fault");
    work(&mut station)
}

/// The points that were wanted in each cycle until the motion was over.
fn follow(station: &mut Station, side: Side) -> Vec<Point<Macro>> {
    let mut wanted = vec![station.wanted(side)];
    while station.moving(side) {
        station.cycle().expect("no fault");
        wanted.push(station.wanted(side));
    }
    wanted
}

#[test]
fn an_arc_is_followed_to_its_exact_end() {
    let spec = spec();
    for shape in [Shape::Trapezoid, Shape::SCurve] {
        with_station(&spec, |station| {
            station.set_shape(shape);
            let arc = Arc::about(Point::ORIGIN, [3e-3, 0.0], 5.0, -2e-3);
            station.start_arc(Side::Right, arc, None).expect("it fits");
            let wanted = follow(station, Side::Right);
            assert!(wanted.len() > 1000);
            assert_eq!(wanted.last(), Some(&Path::from(arc).end()));
            for p in &wanted {
                assert!(((p.x - 3e-3).hypot(p.y) - 3e-3).abs() < 1e-15, "{p:?}");
            }
            assert_eq!(station.wanted(Side::Left), Point::ORIGIN);
        });
    }
}

/// The references as the servo gets them keep the limits of the datasheet.
#[test]
fn what_is_wanted_in_each_cycle_keeps_the_datasheet() {
    let spec = spec();
    let period = spec.period();
    with_station(&spec, |station| {
        let mut fastest = [0.0_f64; 2];
        for (shape, jerks) in [(Shape::Trapezoid, false), (Shape::SCurve, true)] {
            station.set_shape(shape);
            let here = station.wanted(Side::Left);
            let to = here.shifted(5e-3, -4e-3, 1e-4);
            station.start_line(Side::Left, to, None).expect("it fits");
            let p = follow(station, Side::Left);
            assert_eq!(p.last(), Some(&to));
            for p in p.windows(4) {
                let planar = |weights: [f64; 4]| {
                    let sum = |of: fn(&Point<Macro>) -> f64| -> f64 {
                        p.iter()
                            .zip(weights)
                            .map(|(p, weight)| weight * of(p))
                            .sum()
                    };
                    sum(|p| p.x).hypot(sum(|p| p.y))
                };
                let speed = planar([-1.0, 1.0, 0.0, 0.0]) / period;
                let acceleration = planar([1.0, -2.0, 1.0, 0.0]) / period.powi(2);
                let jerk = planar([-1.0, 3.0, -3.0, 1.0]) / period.powi(3);
                assert!(speed <= spec.five_bar.speed * (1.0 + 1e-9));
                assert!(acceleration <= spec.five_bar.acceleration * (1.0 + 1e-6));
                fastest[usize::from(jerks)] = fastest[usize::from(jerks)].max(jerk);
            }
        }
        // 1e-17 m of rounding over the period cubed is 0.2 m/s3.
        assert!(fastest[1] <= spec.five_bar.jerk + 1.0, "{fastest:?}");
        assert!(
            fastest[0] > 10.0 * spec.five_bar.jerk,
            "a trapezoid has corners: {fastest:?}"
        );
    });
}

#[test]
fn what_breaks_a_limit_is_refused_before_it_starts() {
    let spec = spec();
    let p = |x: f64, y: f64, z: f64| Point::<Macro>::new(x, y, z);
    let line = |to: Point<Macro>| Path::from(Line::new(Point::ORIGIN, to));
    let arc = |from: Point<Macro>, centre, angle| Path::from(Arc::about(from, centre, angle, 0.0));
    let mut slow = spec.clone();
    slow.five_bar.drive.speed = 1.0;
    let mut slow_z = spec.clone();
    slow_z.z_stage.drive.speed = 1.0;
    for (spec, path, speed, parts) in [
        (
            &spec,
            line(p(0.0, 0.0, -13e-3)),
            None,
            &["left", "z = -13.000 mm", "12.500"][..],
        ),
        (
            &spec,
            line(p(0.0, 12.6e-3, 0.0)),
            None,
            &["y = 12.600 mm", "-12.500 to 12.500"][..],
        ),
        (&spec, line(p(0.0, 0.0, f64::NAN)), None, &["z = NaN"][..]),
        (
            &spec,
            line(p(0.0, f64::INFINITY, 0.0)),
            None,
            &["y = inf"][..],
        ),
        (
            &spec,
            arc(Point::ORIGIN, [f64::NAN, 0.0], 7.0),
            None,
            &["NaN"][..],
        ),
        (
            &spec,
            arc(Point::ORIGIN, [1e-3, 0.0], f64::NAN),
            None,
            &["NaN"][..],
        ),
        (&spec, line(p(f64::NAN, 0.0, 0.0)), None, &["x = NaN"][..]),
        // Both ends are at home, and the way between leaves the workspace.
        (
            &spec,
            arc(Point::ORIGIN, [7e-3, 0.0], 7.0),
            None,
            &["x = 14.000 mm", "12.500"][..],
        ),
        (
            &spec,
            arc(p(1e-6, 0.0, 0.0), [0.0, 0.0], 1.0),
            None,
            &["start at 0.001, 0.000, 0.000 mm", "is at 0.000"][..],
        ),
        (
            &spec,
            line(p(1e-3, 0.0, 0.0)),
            Some(0.0),
            &["0 m/s", "above zero"][..],
        ),
        (
            &slow,
            line(p(1e-3, 0.0, 0.0)),
            None,
            &["motor a", "rpm", "at most 10 rpm", "mm from home"][..],
        ),
        (
            &slow_z,
            line(p(0.0, 0.0, 1e-3)),
            None,
            &["motor z", "at most 10 rpm"][..],
        ),
    ] {
        with_station(spec, |station| {
            let started = match path {
                Path::Line(_) => station.start_line(Side::Left, path.end(), speed),
                Path::Arc(arc) => station.start_arc(Side::Left, arc, speed),
            };
            let Err(outcome @ Outcome::Refused { .. }) = started else {
                panic!("{path:?} started: {started:?}");
            };
            let why = outcome.to_string();
            for part in parts {
                assert!(why.contains(part), "no \"{part}\" in: {why}");
            }
            assert!(!station.moving(Side::Left));
            station.cycle().expect("no fault");
            assert_eq!(station.wanted(Side::Left), Point::ORIGIN);
        });
    }
}

proptest! {
    /// The check lets pass just what keeps the motors' limits, found here by walking along the
    /// motion, whether the bound of the box decides or the cycles do.
    #[test]
    fn a_motor_speed_is_refused_exactly_when_it_is_too_high(
        x in -0.0125..0.0125_f64, y in -0.0125..0.0125_f64, z in -0.0125..0.0125_f64,
        limit in 1.0..60.0_f64, round in any::<bool>(),
    ) {
        let mut spec = spec();
        spec.five_bar.drive.speed = limit;
        let calibration = calibration(&spec);
        let kinematics = Kinematics::new(&spec, &calibration, Side::Left);
        let rates = |speed, acceleration, jerk| Rates { speed, acceleration, jerk };
        let limits = Limits { xy: rates(0.02, 0.5, 50.0), z: rates(0.005, 0.2, 20.0) };
        let path = if round {
            let centre = [0.5 * x, 0.5 * y];
            Path::from(Arc::about(Point::ORIGIN, centre, 2.0, z))
        } else {
            Line::new(Point::ORIGIN, Point::new(x, y, z)).into()
        };
        let motion = Motion::new(path, Shape::SCurve, &limits, None).expect("a motion");
        let [low, high] = path.bounds();
        prop_assume!(kinematics.contains(low) && kinematics.contains(high));
        let period = spec.period();
        let cycles = (motion.duration() / period).ceil() as u32;
        let angles: Vec<_> = (0..=cycles)
            .map(|k| kinematics.motor_angles_at(motion.at(f64::from(k) * period)).expect("inside"))
            .collect();
        let fastest = angles
            .windows(2)
            .flat_map(|pair| (0..2).map(|i| (pair[1][i] - pair[0][i]).abs() / period))
            .fold(0.0, f64::max);
        let (across, along) = motion.top_speeds();
        let bounds = kinematics.most_motor_speeds([low, high], across, along);
        prop_assert!(fastest <= bounds[0].max(bounds[1]) * (1.0 + 1e-6));
        prop_assert_eq!(motion.check(&kinematics, period).is_ok(), fastest <= limit);
    }
}
