//! How far a motion has come at each moment, from rest to rest.
//!
//! From rest to rest both profiles are closed forms, exact at the end and without a search; a
//! library that plans between any two states of motion solves a harder problem than there is here.

use serde::{Deserialize, Serialize};

/// Speed and its derivatives by time: limits of a motion, or what a motion has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// m/s.
    pub speed: f64,
    /// m/s^2.
    pub acceleration: f64,
    /// m/s^3.
    pub jerk: f64,
}

/// How far a motion has come, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Way covered, metres.
    pub way: f64,
    /// Its derivatives by time, with their signs.
    pub rates: Rates,
}

impl Progress {
    fn resting(way: f64) -> Self {
        let rates = Rates {
            speed: 0.0,
            acceleration: 0.0,
            jerk: 0.0,
        };
        Self { way, rates }
    }
}

/// The choice of a profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// Limited in speed and acceleration, as in the thesis.
    #[default]
    Trapezoid,
    /// Limited in jerk too.
    SCurve,
}

/// Way over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Profile {
    /// Limited in speed and acceleration.
    Trapezoid(Trapezoid),
    /// Limited in jerk too.
    SCurve(SCurve),
    /// Brought to rest before its end.
    Braking(Braking),
}

impl Profile {
    /// The fastest profile of this shape over `length` metres within `limits`, all positive.
    pub fn new(shape: Shape, length: f64, limits: &Rates) -> Self {
        match shape {
            Shape::Trapezoid => {
                Self::Trapezoid(Trapezoid::new(length, limits.speed, limits.acceleration))
            }
            Shape::SCurve => Self::SCurve(SCurve::new(length, limits)),
        }
    }

    /// Seconds from start to end.
    pub fn duration(&self) -> f64 {
        match self {
            Self::Trapezoid(profile) => profile.duration(),
            Self::SCurve(profile) => profile.duration(),
            Self::Braking(profile) => profile.duration(),
        }
    }

    /// Highest speed that is reached, m/s.
    pub fn top_speed(&self) -> f64 {
        match self {
            Self::Trapezoid(profile) => profile.speed,
            Self::SCurve(profile) => profile.speed,
            Self::Braking(profile) => profile.speed,
        }
    }

    /// Way covered `time` seconds after the start, metres. Exactly the length at the end.
    pub fn way(&self, time: f64) -> f64 {
        match self {
            Self::Trapezoid(profile) => profile.way(time),
            Self::SCurve(profile) => profile.at(time).way,
            Self::Braking(profile) => profile.at(time).way,
        }
    }

    /// Way and its derivatives `time` seconds after the start; at rest before it and from the
    /// end on.
    pub fn at(&self, time: f64) -> Progress {
        match self {
            Self::Trapezoid(profile) => profile.at(time),
            Self::SCurve(profile) => profile.at(time),
            Self::Braking(profile) => profile.at(time),
        }
    }
}

/// From a speed to rest at a constant rate: the end of a motion that is called off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Braking {
    from: f64,
    speed: f64,
    acceleration: f64,
}

impl Braking {
    /// Slows down from what `progress` has reached, at `acceleration` (m/s^2), above zero.
    pub fn new(progress: &Progress, acceleration: f64) -> Self {
        Self {
            from: progress.way,
            speed: progress.rates.speed.max(0.0),
            acceleration,
        }
    }

    /// Seconds until it rests.
    pub fn duration(&self) -> f64 {
        self.speed / self.acceleration
    }

    /// Way and its derivatives `time` seconds after the brake.
    pub fn at(&self, time: f64) -> Progress {
        let since = time.clamp(0.0, self.duration());
        let way = self.from + (self.speed - 0.5 * self.acceleration * since) * since;
        if time >= self.duration() {
            return Progress::resting(way);
        }
        let rates = Rates {
            speed: self.speed - self.acceleration * since,
            acceleration: -self.acceleration,
            jerk: 0.0,
        };
        Progress { way, rates }
    }
}

/// Speed rises at a constant rate, stays, and falls (thesis 3.1).
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

    /// Way and its derivatives `time` seconds after the start. The jerk is zero but for the
    /// corners, where it has no bound.
    pub fn at(&self, time: f64) -> Progress {
        let way = self.way(time);
        let (speed, acceleration) = if time <= 0.0 || time >= self.duration {
            return Progress::resting(way);
        } else if time < self.ramp {
            (self.acceleration * time, self.acceleration)
        } else if time > self.duration - self.ramp {
            (
                self.acceleration * (self.duration - time),
                -self.acceleration,
            )
        } else {
            (self.speed, 0.0)
        };
        let rates = Rates {
            speed,
            acceleration,
            jerk: 0.0,
        };
        Progress { way, rates }
    }
}

/// Acceleration is a trapezoid too: the fastest motion from rest to rest within speed,
/// acceleration and jerk.
///
/// Speeding up takes three segments: for `t_j` at the highest jerk, for `t_a` at the
/// acceleration reached by then, and for `t_j` at the opposite jerk. The fourth segment is at
/// constant speed, and the last three mirror the first. At every moment one of the three limits
/// holds: nothing is faster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SCurve {
    length: f64,
    jerk: f64,
    /// Highest acceleration that is reached; below the limit where the jerk has no time.
    acceleration: f64,
    /// Highest speed that is reached; below the limit on a short way.
    speed: f64,
    /// Time `t_j` at one jerk.
    bend: f64,
    /// Time until the highest speed, `2 t_j + t_a`.
    ramp: f64,
    duration: f64,
}

impl SCurve {
    /// A profile over `length` metres within `limits`, all positive. An infinite jerk gives a
    /// trapezoid.
    ///
    /// The highest speed `v` that the way `L` allows, with half of it to speed up in:
    ///
    /// ```text
    /// L = v (v/a + a/j)         where the acceleration a is reached, L >= 2 a^3/j^2
    /// L = 2 v sqrt(v/j)         where it is not
    /// ```
    pub fn new(length: f64, limits: &Rates) -> Self {
        let Rates {
            speed,
            acceleration,
            jerk,
        } = *limits;
        let longest = acceleration / jerk;
        let reached = if length >= 2.0 * acceleration * longest * longest {
            2.0 * length / (longest + (longest * longest + 4.0 * length / acceleration).sqrt())
        } else {
            (0.25 * length * length * jerk).cbrt()
        };
        let speed = speed.min(reached);
        if speed <= 0.0 || speed.is_nan() {
            return Self {
                length: 0.0,
                jerk,
                acceleration: 0.0,
                speed: 0.0,
                bend: 0.0,
                ramp: 0.0,
                duration: 0.0,
            };
        }
        let (bend, acceleration, ramp) = if speed >= acceleration * longest {
            (longest, acceleration, speed / acceleration + longest)
        } else {
            let bend = (speed / jerk).sqrt();
            (bend, speed / bend, 2.0 * bend)
        };
        Self {
            length,
            jerk,
            acceleration,
            speed,
            bend,
            ramp,
            // Where the highest speed lasts for no time, rounding must not make that negative.
            duration: ramp + (length / speed).max(ramp),
        }
    }

    /// Seconds from start to end.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Way and its derivatives `time` seconds after the start.
    pub fn at(&self, time: f64) -> Progress {
        let left = self.duration - time;
        if time <= 0.0 {
            Progress::resting(0.0)
        } else if left <= 0.0 {
            Progress::resting(self.length)
        } else if time < self.ramp {
            self.rise(time)
        } else if left < self.ramp {
            let Progress { way, rates } = self.rise(left);
            Progress {
                way: self.length - way,
                rates: Rates {
                    acceleration: -rates.acceleration,
                    ..rates
                },
            }
        } else {
            Progress {
                way: self.speed * (time - 0.5 * self.ramp),
                rates: Rates {
                    speed: self.speed,
                    acceleration: 0.0,
                    jerk: 0.0,
                },
            }
        }
    }

    /// While speeding up.
    fn rise(&self, time: f64) -> Progress {
        let (way, speed, acceleration, jerk);
        let left = self.ramp - time;
        if time < self.bend {
            (acceleration, jerk) = (self.jerk * time, self.jerk);
            speed = 0.5 * acceleration * time;
            way = speed * time / 3.0;
        } else if left < self.bend {
            (acceleration, jerk) = (self.jerk * left, -self.jerk);
            let lacking = 0.5 * acceleration * left;
            speed = self.speed - lacking;
            way = self.speed * (0.5 * self.ramp - left) + lacking * left / 3.0;
        } else {
            (acceleration, jerk) = (self.acceleration, 0.0);
            // As if the acceleration had been there from half of the bend on.
            let since = time - 0.5 * self.bend;
            speed = acceleration * since;
            way = 0.5 * acceleration * (since * since + self.bend * self.bend / 12.0);
        }
        Progress {
            way,
            rates: Rates {
                speed,
                acceleration,
                jerk,
            },
        }
    }
}
