//! A hundred thousand random moves: lines and arcs, each with both profiles.

use pigtail_control::trajectory::{
    Arc, Limits, Line, Motion, Path, Profile, Progress, Rates, SCurve, Shape, Trapezoid,
};
use pigtail_model::frames::{Macro, Point};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// Moves of each kind of path with each profile.
const MOVES: u32 = 25_000;
/// Rounding of a product or two of measured limits.
const ROUNDING: f64 = 1e-9;

/// Evenly spread over the orders of magnitude.
fn decades(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.log10()..high.log10()).prop_map(|exponent| 10_f64.powf(exponent))
}

fn rates() -> impl Strategy<Value = Rates> {
    (decades(1e-4, 1.0), decades(1e-3, 1e2), decades(1e-2, 1e5)).prop_map(
        |(speed, acceleration, jerk)| Rates {
            speed,
            acceleration,
            jerk,
        },
    )
}

fn limits() -> impl Strategy<Value = Limits> {
    (rates(), rates()).prop_map(|(xy, z)| Limits { xy, z })
}

fn place() -> impl Strategy<Value = Point<Macro>> {
    let along = || -0.0125..0.0125_f64;
    (along(), along(), along()).prop_map(|(x, y, z)| Point::new(x, y, z))
}

/// Nothing, a nanometre, a metre and all between, to either side.
fn way() -> impl Strategy<Value = f64> {
    prop_oneof![
        1 => Just(0.0),
        1 => Just(1e-9),
        1 => Just(-1e-9),
        8 => (decades(1e-9, 1.0), any::<bool>())
            .prop_map(|(way, back)| if back { -way } else { way }),
    ]
}

fn line() -> impl Strategy<Value = Line> {
    (place(), way(), way(), way())
        .prop_map(|(from, x, y, z)| Line::new(from, from.shifted(x, y, z)))
}

fn about() -> impl Strategy<Value = Arc> {
    let angle = prop_oneof![
        1 => Just(0.0),
        1 => Just(TAU),
        4 => decades(1e-6, 4.0 * PI),
        4 => decades(1e-6, 4.0 * PI).prop_map(|angle| -angle),
    ];
    (place(), decades(1e-6, 0.1), -PI..PI, angle, way()).prop_map(
        |(from, radius, towards, angle, rise)| {
            let (sin, cos) = towards.sin_cos();
            let centre = [from.x + radius * cos, from.y + radius * sin];
            Arc::about(from, centre, angle, rise)
        },
    )
}

fn through() -> impl Strategy<Value = (Arc, Point<Macro>)> {
    (place(), place(), place()).prop_filter_map("on a line", |(from, via, to)| {
        Some((Arc::through(from, via, to).ok()?, to))
    })
}

fn asked() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![Just(None), decades(1e-5, 1.0).prop_map(Some)]
}

/// Parts of a motion's time at which it is looked at.
fn instants() -> impl Strategy<Value = [f64; 6]> {
    prop::array::uniform6(0.0..1.0_f64)
}

fn numbers(rates: &Rates) -> [f64; 3] {
    [rates.speed, rates.acceleration, rates.jerk]
}

/// Lengths of a vector in the x-y plane and along z.
fn parts(terms: &[(f64, Point<Macro>)], divisor: f64) -> [f64; 2] {
    let sum = |of: fn(&Point<Macro>) -> f64| {
        terms.iter().map(|(weight, p)| weight * of(p)).sum::<f64>() / divisor
    };
    [sum(|p| p.x).hypot(sum(|p| p.y)), sum(|p| p.z).abs()]
}

/// Differences of positions are means of the derivatives over the time between them, so they keep
/// the limits too; rounding alone, of at most `error` metres a position, can lead beyond.
fn differences_keep(
    motion: &Motion,
    shape: Shape,
    limits: &Limits,
    time: f64,
    h: f64,
    error: f64,
) -> Result<(), TestCaseError> {
    let at = |steps: f64| motion.at(time + steps * h);
    let first = parts(&[(1.0, at(0.5)), (-1.0, at(-0.5))], h);
    let second = parts(&[(1.0, at(1.0)), (-2.0, at(0.0)), (1.0, at(-1.0))], h * h);
    let third = parts(
        &[
            (1.0, at(1.5)),
            (-3.0, at(0.5)),
            (3.0, at(-0.5)),
            (-1.0, at(-1.5)),
        ],
        h * h * h,
    );
    for (i, limits) in [limits.xy, limits.z].iter().enumerate() {
        let keeps = |value: f64, limit: f64, error: f64| value <= limit * (1.0 + ROUNDING) + error;
        prop_assert!(keeps(first[i], limits.speed, 2.0 * error / h));
        prop_assert!(keeps(second[i], limits.acceleration, 4.0 * error / (h * h)));
        if shape == Shape::SCurve {
            prop_assert!(
                keeps(third[i], limits.jerk, 8.0 * error / (h * h * h)),
                "{} m/s3 for {}, {} of it for rounding",
                third[i],
                limits.jerk,
                8.0 * error / (h * h * h)
            );
        }
    }
    Ok(())
}

/// All that every motion owes.
fn is_good(
    path: Path,
    shape: Shape,
    limits: &Limits,
    speed: Option<f64>,
    instants: &[f64],
) -> Result<(), TestCaseError> {
    let motion = Motion::new(path, shape, limits, speed).expect("a speed above zero");
    let (duration, length) = (motion.duration(), path.length());
    prop_assert!(duration.is_finite() && duration >= 0.0);
    prop_assert_eq!(duration > 0.0, length > 0.0);

    // Starts and ends exactly, and stays there.
    prop_assert_eq!(motion.at(0.0), path.start());
    prop_assert_eq!(motion.at(-1.0), path.start());
    prop_assert_eq!(motion.at(duration), path.end());
    prop_assert_eq!(motion.at(duration + 1.0), path.end());
    prop_assert_eq!(motion.progress(duration).way, length);

    let [low, high] = path.bounds();
    let far = |p: Point<Macro>| p.distance(Point::ORIGIN);
    let error = 16.0 * f64::EPSILON * (far(path.start()) + far(path.end()) + length);
    // It does not jump to its end.
    let last = motion.at(duration * (1.0 - f64::EPSILON));
    prop_assert!(
        last.distance(path.end()) <= error,
        "{}",
        last.distance(path.end())
    );

    let mut before = 0.0;
    let mut instants = instants.to_vec();
    instants.sort_by(f64::total_cmp);
    for instant in instants {
        let time = instant * duration;
        let p = motion.at(time);
        prop_assert!(p.x >= low.x - error && p.x <= high.x + error);
        prop_assert!(p.y >= low.y - error && p.y <= high.y + error);
        prop_assert!(p.z >= low.z - error && p.z <= high.z + error);

        let Progress { way, rates } = motion.progress(time);
        prop_assert!(numbers(&rates).into_iter().all(f64::is_finite));
        prop_assert!(way >= before - 4.0 * f64::EPSILON * length && way <= length);
        prop_assert!(rates.speed >= 0.0);
        prop_assert!(speed.is_none_or(|most| rates.speed <= most * (1.0 + ROUNDING)));
        before = way;

        let has = motion.rates(time);
        for (has, may) in [(has.xy, limits.xy), (has.z, limits.z)] {
            prop_assert!(has.speed <= may.speed * (1.0 + ROUNDING));
            prop_assert!(has.acceleration <= may.acceleration * (1.0 + ROUNDING));
            if shape == Shape::SCurve {
                prop_assert!(has.jerk <= may.jerk * (1.0 + ROUNDING));
            }
        }
        if duration > 0.0 {
            differences_keep(&motion, shape, limits, time, duration / 64.0, error)?;
        }

        let mirrored = motion.progress(duration - time);
        prop_assert!((way + mirrored.way - length).abs() <= 16.0 * f64::EPSILON * length);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(MOVES))]

    #[test]
    fn a_line_by_trapezoid_is_good(
        line in line(), limits in limits(), asked in asked(), instants in instants(),
    ) {
        is_good(line.into(), Shape::Trapezoid, &limits, asked, &instants)?;
    }

    #[test]
    fn a_line_by_s_curve_is_good(
        line in line(), limits in limits(), asked in asked(), instants in instants(),
    ) {
        is_good(line.into(), Shape::SCurve, &limits, asked, &instants)?;
    }

    #[test]
    fn an_arc_by_trapezoid_is_good(
        arc in about(), limits in limits(), asked in asked(), instants in instants(),
    ) {
        is_good(arc.into(), Shape::Trapezoid, &limits, asked, &instants)?;
    }

    #[test]
    fn an_arc_by_s_curve_is_good(
        arc in about(), limits in limits(), asked in asked(), instants in instants(),
    ) {
        is_good(arc.into(), Shape::SCurve, &limits, asked, &instants)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    #[test]
    fn an_arc_through_points_is_good_and_ends_in_the_last(
        (arc, to) in through(), limits in limits(), instants in instants(),
    ) {
        prop_assert_eq!(Path::from(arc).end(), to);
        is_good(arc.into(), Shape::SCurve, &limits, None, &instants)?;
    }

    /// Three points of an arc are enough to find it again.
    #[test]
    fn an_arc_through_its_own_points_is_itself(
        from in place(), radius in decades(1e-4, 0.1), angle in 0.1..6.2_f64,
        left in any::<bool>(), via in 0.1..0.9_f64, share in 0.0..1.0_f64,
    ) {
        let angle = if left { angle } else { -angle };
        let arc = Path::from(Arc::about(from, [from.x, from.y - radius], angle, 1e-3));
        let length = arc.length();
        let again = Path::from(Arc::through(from, arc.at(via * length), arc.end()).expect("an arc"));
        let off = again.at(share * again.length()).distance(arc.at(share * length));
        // 10 mm of coordinates' rounding on a tenth of the smallest chord, seen from the far side.
        prop_assert!(off < 1e-9 * radius, "{} m", off);
    }

    /// At every moment a limit holds: (Pontryagin) nothing from rest to rest is faster.
    #[test]
    fn an_s_curve_always_is_at_a_limit(
        length in decades(1e-9, 1.0), limits in rates(), instant in 1e-3..0.999_f64,
    ) {
        let profile = SCurve::new(length, &limits);
        let Rates { speed, acceleration, jerk } = profile.at(instant * profile.duration()).rates;
        let full = |has: f64, may: f64| has.abs() >= may * (1.0 - ROUNDING);
        prop_assert!(
            full(jerk, limits.jerk)
                || full(acceleration, limits.acceleration)
                || full(speed, limits.speed)
        );
    }

    /// The known duration of each kind of S-curve.
    #[test]
    fn an_s_curve_takes_no_longer_than_it_must(length in decades(1e-9, 1.0), limits in rates()) {
        let Rates { speed: v, acceleration: a, jerk: j } = limits;
        let duration = SCurve::new(length, &limits).duration();
        let by_jerk_alone = (32.0 * length / j).cbrt();
        let expected = if v * j >= a * a {
            if length >= v * (v / a + a / j) {
                length / v + v / a + a / j
            } else if length >= 2.0 * a.powi(3) / j.powi(2) {
                a / j + (a * a / (j * j) + 4.0 * length / a).sqrt()
            } else {
                by_jerk_alone
            }
        } else if length >= 2.0 * v * (v / j).sqrt() {
            length / v + 2.0 * (v / j).sqrt()
        } else {
            by_jerk_alone
        };
        prop_assert!((duration / expected - 1.0).abs() < ROUNDING, "{} {}", duration, expected);
    }

    /// What is called speed, acceleration and jerk is the derivative of what stands before it.
    #[test]
    fn an_s_curve_is_its_own_integral(
        length in decades(1e-9, 1.0), limits in rates(), instant in 0.0..1.0_f64,
    ) {
        let profile = SCurve::new(length, &limits);
        let time = instant * profile.duration();
        let h = 1e-3 * profile.duration();
        let (a, b, c) = (profile.at(time - h), profile.at(time), profile.at(time + h));
        // Taylor's remainders with the jerk's bound, and rounding.
        let (e, j) = (8.0 * f64::EPSILON, limits.jerk * (1.0 + ROUNDING));
        let speed = (c.way - a.way) / (2.0 * h);
        prop_assert!((speed - b.rates.speed).abs() <= j * h * h / 6.0 + e * length / h);
        let acceleration = (c.rates.speed - a.rates.speed) / (2.0 * h);
        prop_assert!(
            (acceleration - b.rates.acceleration).abs() <= 0.5 * j * h + e * length / (h * h)
        );
        // Within one segment: those of one jerk follow one another only over the middle.
        let same = [a, b].iter().all(|p| p.rates.jerk == c.rates.jerk && c.rates.jerk != 0.0);
        let middle = 0.5 * profile.duration();
        if same && (time + h < middle || time - h > middle) {
            let jerk = (c.rates.acceleration - a.rates.acceleration) / (2.0 * h);
            prop_assert!((jerk - b.rates.jerk).abs() <= 1e-6 * j, "{} {}", jerk, b.rates.jerk);
        }
    }

    #[test]
    fn an_s_curve_of_any_jerk_is_a_trapezoid(
        length in decades(1e-9, 1.0), limits in rates(), instant in 0.0..1.0_f64,
    ) {
        let limits = Rates { jerk: f64::INFINITY, ..limits };
        let curve = SCurve::new(length, &limits);
        let trapezoid = Trapezoid::new(length, limits.speed, limits.acceleration);
        prop_assert!((curve.duration() / trapezoid.duration() - 1.0).abs() < 1e-14);
        let time = instant * curve.duration();
        let (a, b) = (curve.at(time), trapezoid.at(time));
        prop_assert!((a.way - b.way).abs() <= 1e-14 * length);
        prop_assert!((a.rates.speed - b.rates.speed).abs() <= 1e-13 * limits.speed);
    }

    /// A box around an arc leaves no room: each of its sides is touched.
    #[test]
    fn an_arc_touches_the_sides_of_its_box(arc in about()) {
        const STEPS: i32 = 400;
        let path = Path::from(arc);
        let [low, high] = path.bounds();
        let points: Vec<_> = (0..=STEPS)
            .map(|k| path.at(path.length() * f64::from(k) / f64::from(STEPS)))
            .collect();
        // A side is missed by at most the height of the arc over one step.
        let (across, _) = path.shares();
        let size = (high.x - low.x).max(high.y - low.y);
        let step = across * path.length() / f64::from(STEPS);
        let slack = if size > 0.0 { step * step / size } else { 0.0 } + 1e-15;
        let most = |of: fn(&Point<Macro>) -> f64| points.iter().map(of).fold(f64::MIN, f64::max);
        prop_assert!(high.x - most(|p| p.x) <= slack && high.y - most(|p| p.y) <= slack);
        prop_assert!(-low.x - most(|p| -p.x) <= slack && -low.y - most(|p| -p.y) <= slack);
    }
}

const LIMITS: Limits = Limits {
    xy: Rates {
        speed: 0.02,
        acceleration: 0.5,
        jerk: 50.0,
    },
    z: Rates {
        speed: 0.005,
        acceleration: 0.2,
        jerk: 20.0,
    },
};

fn s_curve(path: impl Into<Path>) -> Motion {
    Motion::new(path, Shape::SCurve, &LIMITS, None).expect("a motion")
}

#[test]
fn no_way_takes_no_time() {
    let here = Point::new(1e-3, 2e-3, 3e-3);
    for path in [
        Path::from(Line::new(here, here)),
        Arc::about(here, [0.0, 0.0], 0.0, 0.0).into(),
        Arc::about(here, [here.x, here.y], 1.0, 0.0).into(),
    ] {
        for shape in [Shape::Trapezoid, Shape::SCurve] {
            let motion = Motion::new(path, shape, &LIMITS, None).expect("a motion");
            assert_eq!(motion.duration(), 0.0);
            assert_eq!(motion.at(0.0), here);
            assert_eq!(motion.top_speeds(), (0.0, 0.0));
        }
    }
}

#[test]
fn an_arc_about_nothing_rises_straight() {
    let here = Point::new(1e-3, 2e-3, 3e-3);
    let rise = s_curve(Arc::about(here, [here.x, here.y], 1.0, 1e-3));
    let line = s_curve(Line::new(here, here.shifted(0.0, 0.0, 1e-3)));
    assert_eq!(rise.duration(), line.duration());
    assert_eq!(rise.at(0.1), line.at(0.1));
}

#[test]
fn a_quarter_turn_goes_where_it_is_drawn() {
    let from = Point::new(1e-3, 0.0, 0.0);
    let left = Path::from(Arc::about(from, [0.0, 0.0], 0.5 * PI, 0.0));
    assert!(left.end().distance(Point::new(0.0, 1e-3, 0.0)) < 1e-18);
    let right = Path::from(Arc::about(from, [0.0, 0.0], -0.5 * PI, 2e-3));
    assert!(right.end().distance(Point::new(0.0, -1e-3, 2e-3)) < 1e-18);
    let half = right.at(0.5 * right.length());
    let diagonal = 1e-3 * 0.5_f64.sqrt();
    assert!(half.distance(Point::new(diagonal, -diagonal, 1e-3)) < 1e-18);
}

#[test]
fn points_on_a_line_make_no_arc() {
    let p = |x: f64, y: f64| Point::new(x, y, 0.0);
    for (via, to) in [
        (p(1e-3, 1e-3), p(2e-3, 2e-3)),
        (p(2e-3, 2e-3), p(1e-3, 1e-3)),
        (p(0.0, 0.0), p(1e-3, 1e-3)),
        (p(1e-3, 0.0), p(1e-3, 0.0)),
        (p(1e-3, 0.0), p(0.0, 0.0)),
        (p(f64::NAN, 0.0), p(1e-3, 0.0)),
        (p(f64::INFINITY, 0.0), p(1e-3, 1e-3)),
    ] {
        assert!(
            Arc::through(p(0.0, 0.0), via, to).is_err(),
            "{via:?} {to:?}"
        );
    }
}

#[test]
fn a_small_circle_is_slower_than_a_large_one() {
    let top = |radius: f64, angle: f64| {
        let from = Point::new(radius, 0.0, 0.0);
        s_curve(Arc::about(from, [0.0, 0.0], angle, 0.0))
            .top_speeds()
            .0
    };
    assert!(
        (top(0.01, TAU) - 0.02).abs() < 1e-15,
        "the speed is the limit"
    );
    let v = top(1e-4, TAU);
    assert!(
        v < 0.01 && v * v / 1e-4 < 0.5 && v.powi(3) / 1e-8 < 50.0,
        "{v}"
    );
    assert!(top(1e-5, TAU) < v);
}

#[test]
fn a_speed_of_nothing_is_refused() {
    let line = Line::new(Point::ORIGIN, Point::new(1e-3, 0.0, 0.0));
    for speed in [0.0, -1.0, f64::NAN] {
        let why = Motion::new(line, Shape::SCurve, &LIMITS, Some(speed)).unwrap_err();
        assert!(why.to_string().contains("above zero"), "{why}");
    }
}

#[test]
fn the_profiles_say_what_they_are() {
    let limits = LIMITS.xy;
    for shape in [Shape::Trapezoid, Shape::SCurve] {
        let profile = Profile::new(shape, 0.01, &limits);
        let middle = profile.at(0.5 * profile.duration());
        assert_eq!(middle.rates.speed, 0.02);
        assert_eq!(middle.way, profile.way(0.5 * profile.duration()));
        assert!((middle.way - 0.005).abs() < 1e-17);
        assert_eq!(profile.top_speed(), 0.02);
    }
}
