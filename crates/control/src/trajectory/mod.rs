//! Wanted motion: a path, and how far along it at each moment.
//!
//! One profile drives all coordinates of a path, so the axes start, move and arrive together.

mod check;
mod path;
mod profile;

pub use check::Refused;
pub use path::{Arc, Limits, Line, Path, Straight};
pub use profile::{Braking, Profile, Progress, Rates, SCurve, Shape, Trapezoid};

use pigtail_model::frames::{Macro, Point};

/// A path, followed in time from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    path: Path,
    profile: Profile,
}

impl Motion {
    /// A motion of this shape along `path` that keeps `limits` at each of its points, no faster
    /// than `speed` (m/s) along it: the fastest on a line, and nearly on an arc. A trapezoid does
    /// not ask for the limits of jerk.
    ///
    /// # Errors
    ///
    /// When `speed` is not above zero.
    pub fn new(
        path: impl Into<Path>,
        shape: Shape,
        limits: &Limits,
        speed: Option<f64>,
    ) -> Result<Self, Refused> {
        let path = path.into();
        let mut along = path.limits(&match shape {
            Shape::Trapezoid => limits.without_jerk(),
            Shape::SCurve => *limits,
        });
        if let Some(speed) = speed {
            if speed.is_nan() || speed <= 0.0 {
                return Err(Refused::Speed(speed));
            }
            along.speed = along.speed.min(speed);
        }
        let profile = Profile::new(shape, path.length(), &along);
        Ok(Self { path, profile })
    }

    /// Where it leads.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Seconds from start to end.
    pub fn duration(&self) -> f64 {
        self.profile.duration()
    }

    /// What is left of this motion when it is called off `time` seconds after its start: it slows
    /// down to rest at what `limits` allow.
    #[must_use]
    pub fn braked(&self, time: f64, limits: &Limits) -> Self {
        let along = self.path.limits(&limits.without_jerk());
        Self {
            path: self.path,
            profile: Profile::Braking(Braking::new(&self.profile.at(time), along.acceleration)),
        }
    }

    /// The point `time` seconds after the start. Exactly the path's end at the end, unless the
    /// motion was called off.
    pub fn at(&self, time: f64) -> Point<Macro> {
        let called_off = matches!(self.profile, Profile::Braking(_));
        if time >= self.profile.duration() && !called_off {
            return self.path.end();
        }
        self.path.at(self.profile.way(time))
    }

    /// Way and its derivatives `time` seconds after the start.
    pub fn progress(&self, time: f64) -> Progress {
        self.profile.at(time)
    }

    /// Lengths of the vectors of speed, acceleration and jerk `time` seconds after the start.
    pub fn rates(&self, time: f64) -> Limits {
        self.path.rates(&self.profile.at(time))
    }

    /// Highest speed in the x-y plane, and along z, m/s.
    pub fn top_speeds(&self) -> (f64, f64) {
        let (across, along) = self.path.shares();
        let top = self.profile.top_speed();
        // No way has no direction.
        if top > 0.0 {
            (top * across, top * along)
        } else {
            (0.0, 0.0)
        }
    }
}
