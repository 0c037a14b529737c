//! Straight lines with a trapezoidal velocity (thesis 3.1).

use pigtail_model::frames::{Macro, Point};

/// Way covered along a path of given length: speed rises at a constant rate, stays, and falls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trapezoid {
    length: f64,
    acceleration: f64,
    /// Highest speed that is reached; below the limit on a short way.
    speed: f64,
    /// Time spent speeding up.
    ramp: f64,
    duration: f64,
}

impl Trapezoid {
    /// A profile over `length` metres within `speed` (m/s) and `acceleration` (m/s^2), both
    /// positive.
    pub fn new(length: f64, speed: f64, acceleration: f64) -> Self {
        let speed = speed.min((length * acceleration).sqrt());
        if speed <= 0.0 || speed.is_nan() {
            return Self {
                length: 0.0,
                acceleration,
                speed: 0.0,
                ramp: 0.0,
                duration: 0.0,
            };
        }
        let ramp = speed / acceleration;
        Self {
            length,
            acceleration,
            speed,
            ramp,
            duration: length / speed + ramp,
        }
    }

    /// Seconds from start to end.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Way covered `time` seconds after the start, metres.
    pub fn way(&self, time: f64) -> f64 {
        if time >= self.duration {
            self.length
        } else if time <= 0.0 {
            0.0
        } else if time < self.ramp {
            0.5 * self.acceleration * time * time
        } else if time > self.duration - self.ramp {
            let left = self.duration - time;
            self.length - 0.5 * self.acceleration * left * left
        } else {
            self.speed * (time - 0.5 * self.ramp)
        }
    }
}

/// Limits of an endpoint's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Speed in the x-y plane, m/s.
    pub speed_xy: f64,
    /// Acceleration in the x-y plane, m/s^2.
    pub acceleration_xy: f64,
    /// Speed along z, m/s.
    pub speed_z: f64,
    /// Acceleration along z, m/s^2.
    pub acceleration_z: f64,
}

/// A straight line, followed in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    from: Point<Macro>,
    to: Point<Macro>,
    profile: Trapezoid,
    /// Reciprocal of the length; zero for no length.
    scale: f64,
}

impl Line {
    /// The fastest line between two points within `limits`, no faster than `speed` along it.
    pub fn new(from: Point<Macro>, to: Point<Macro>, limits: &Limits, speed: Option<f64>) -> Self {
        let length = from.distance(to);
        let across = (to.x - from.x).hypot(to.y - from.y) / length;
        let along = (to.z - from.z).abs() / length;
        let within = |limit: f64, share: f64| if share > 0.0 { limit / share } else { f64::MAX };
        let fastest = within(limits.speed_xy, across)
            .min(within(limits.speed_z, along))
            .min(speed.unwrap_or(f64::MAX));
        let acceleration =
            within(limits.acceleration_xy, across).min(within(limits.acceleration_z, along));
        let profile = Trapezoid::new(length, fastest, acceleration);
        Self {
            from,
            to,
            profile,
            scale: if length > 0.0 { 1.0 / length } else { 0.0 },
        }
    }

    /// Seconds from start to end.
    pub fn duration(&self) -> f64 {
        self.profile.duration()
    }

    /// The point `time` seconds after the start.
    pub fn at(&self, time: f64) -> Point<Macro> {
        if time >= self.profile.duration() {
            return self.to;
        }
        let share = self.profile.way(time) * self.scale;
        self.from.shifted(
            share * (self.to.x - self.from.x),
            share * (self.to.y - self.from.y),
            share * (self.to.z - self.from.z),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_profile_keeps_its_limits_and_ends_exactly(
            length in 1e-9..0.1_f64, speed in 1e-6..0.1_f64, acceleration in 1e-3..10.0_f64,
        ) {
            let profile = Trapezoid::new(length, speed, acceleration);
            let (n, duration) = (500, profile.duration());
            let h = duration / f64::from(n);
            let mut before = (0.0, 0.0);
            for i in 1..=n {
                let way = profile.way(f64::from(i) * h);
                let v = (way - before.0) / h;
                prop_assert!(v >= -1e-12 && v <= speed * (1.0 + 1e-9));
                prop_assert!((v - before.1).abs() <= acceleration * h * (1.0 + 1e-6) + 1e-12);
                before = (way, v);
            }
            prop_assert_eq!(profile.way(duration), length);
            prop_assert_eq!(profile.way(-1.0), 0.0);
        }

        #[test]
        fn a_line_keeps_each_limit_and_ends_exactly(
            x in -0.01..0.01_f64, y in -0.01..0.01_f64, z in -0.01..0.01_f64,
        ) {
            let limits = Limits {
                speed_xy: 0.02, acceleration_xy: 0.5, speed_z: 0.005, acceleration_z: 0.2,
            };
            let to = Point::new(x, y, z);
            let line = Line::new(Point::ORIGIN, to, &limits, None);
            let h = 1e-4;
            let mut before = Point::ORIGIN;
            let mut t = 0.0;
            while t < line.duration() {
                t += h;
                let p = line.at(t);
                prop_assert!((p.x - before.x).hypot(p.y - before.y) <= 0.02 * h * (1.0 + 1e-9));
                prop_assert!((p.z - before.z).abs() <= 0.005 * h * (1.0 + 1e-9));
                before = p;
            }
            prop_assert_eq!(line.at(line.duration()), to);
        }
    }

    #[test]
    fn no_way_takes_no_time() {
        let limits = Limits {
            speed_xy: 1.0,
            acceleration_xy: 1.0,
            speed_z: 1.0,
            acceleration_z: 1.0,
        };
        let here = Point::new(1e-3, 2e-3, 3e-3);
        let line = Line::new(here, here, &limits, None);
        assert_eq!(line.duration(), 0.0);
        assert_eq!(line.at(0.0), here);
    }
}
