//! Where a motion goes, whatever its speed: straight lines and arcs.

use super::profile::{Progress, Rates};
use pigtail_model::frames::{Displacement, Macro, Point};
use std::f64::consts::{FRAC_PI_2, SQRT_2, TAU};

/// Limits of an endpoint's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Of the vectors in the x-y plane.
    pub xy: Rates,
    /// Along z.
    pub z: Rates,
}

impl Limits {
    /// The same limits with any jerk allowed.
    #[must_use]
    pub fn without_jerk(mut self) -> Self {
        self.xy.jerk = f64::INFINITY;
        self.z.jerk = f64::INFINITY;
        self
    }
}

/// The curve that an endpoint follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Path {
    /// A straight line.
    Line(Line),
    /// An arc or a helix.
    Arc(Arc),
}

/// A straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    from: Point<Macro>,
    to: Point<Macro>,
    length: f64,
    /// Reciprocal of the length; zero for no length.
    scale: f64,
}

/// An arc in the x-y plane; a helix where it also leads along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    from: Point<Macro>,
    to: Point<Macro>,
    /// From the start to the centre, metres in x and y.
    inward: Displacement,
    /// Angle from start to end, radians, counterclockwise seen against z.
    angle: f64,
    radius: f64,
    length: f64,
    /// Reciprocal of the length; zero for no length.
    scale: f64,
}

/// Three points through which no arc leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the three points lie on a straight line in x and y; accepted are points of an arc")]
pub struct Straight;

impl From<Line> for Path {
    fn from(line: Line) -> Self {
        Self::Line(line)
    }
}

impl From<Arc> for Path {
    fn from(arc: Arc) -> Self {
        Self::Arc(arc)
    }
}

/// A reciprocal, or zero for no length.
fn scale(length: f64) -> f64 {
    if length > 0.0 { 1.0 / length } else { 0.0 }
}

/// The limit along a path of which only a `share` counts.
fn within(limit: f64, share: f64) -> f64 {
    if share > 0.0 { limit / share } else { f64::MAX }
}

impl Line {
    /// The line between two points.
    pub fn new(from: Point<Macro>, to: Point<Macro>) -> Self {
        let length = from.distance(to);
        Self {
            from,
            to,
            length,
            scale: scale(length),
        }
    }

    /// Share of the way that leads through the x-y plane, and share along z.
    fn shares(&self) -> (f64, f64) {
        let (from, to) = (self.from, self.to);
        (
            (to.x - from.x).hypot(to.y - from.y) / self.length,
            (to.z - from.z).abs() / self.length,
        )
    }

    fn at(&self, way: f64) -> Point<Macro> {
        let share = way * self.scale;
        self.from.shifted(
            share * (self.to.x - self.from.x),
            share * (self.to.y - self.from.y),
            share * (self.to.z - self.from.z),
        )
    }

    fn limits(&self, limits: &Limits) -> Rates {
        let (across, along) = self.shares();
        let least = |xy: f64, z: f64| within(xy, across).min(within(z, along));
        Rates {
            speed: least(limits.xy.speed, limits.z.speed),
            acceleration: least(limits.xy.acceleration, limits.z.acceleration),
            jerk: least(limits.xy.jerk, limits.z.jerk),
        }
    }
}

impl Arc {
    /// From `from` about the centre `[x, y]` (metres) by `angle` (radians, counterclockwise seen
    /// against z, of any number of turns), rising evenly by `rise` metres along z.
    pub fn about(from: Point<Macro>, centre: [f64; 2], angle: f64, rise: f64) -> Self {
        let inward = Displacement::new(centre[0], centre[1]) - from.across();
        let mut arc = Self::with(from, inward, angle, rise);
        arc.to = arc.turned(angle, rise);
        arc
    }

    /// From `from` past `via` to `to`. In z it rises evenly from the first point to the last,
    /// wherever `via` lies.
    ///
    /// # Errors
    ///
    /// [`Straight`] when the points lie on a line in x and y, or two of them are one.
    pub fn through(
        from: Point<Macro>,
        via: Point<Macro>,
        to: Point<Macro>,
    ) -> Result<Self, Straight> {
        let (b, d) = (via.across() - from.across(), to.across() - via.across());
        // Along an arc a chord's direction turns by half of the arc.
        let half = b.cross(d).atan2(b.x * d.x + b.y * d.y);
        let (sin, cos) = half.sin_cos();
        if !b.norm().is_finite() || sin.is_nan() || sin.abs() < 1e-9 {
            return Err(Straight);
        }
        // The centre lies beside the middle of the chord from end to end, so that the arc ends
        // where it should however little the points tell of its radius.
        let c = (to.across() - from.across()) * 0.5;
        let inward = Displacement::new(c.x - c.y * cos / sin, c.y + c.x * cos / sin);
        let mut arc = Self::with(from, inward, 2.0 * half, to.z - from.z);
        arc.to = to;
        Ok(arc)
    }

    fn with(from: Point<Macro>, inward: Displacement, angle: f64, rise: f64) -> Self {
        let radius = inward.norm();
        let length = (radius * angle).hypot(rise);
        Self {
            from,
            to: from,
            inward,
            angle,
            radius,
            length,
            scale: scale(length),
        }
    }

    /// The point after turning by `angle` from the start and rising so far. The start itself is exact,
    /// and a short way along a large circle is not lost in the radius.
    fn turned(&self, angle: f64, rise: f64) -> Point<Macro> {
        let (sin, cos) = (0.5 * angle).sin_cos();
        let (along, inward) = (2.0 * sin * cos, 2.0 * sin * sin);
        let Displacement { x, y } = self.inward;
        let (dx, dy) = (along * y + inward * x, inward * y - along * x);
        self.from.shifted(dx, dy, rise)
    }

    fn at(&self, way: f64) -> Point<Macro> {
        let share = way * self.scale;
        self.turned(share * self.angle, share * (self.to.z - self.from.z))
    }

    /// Share of the way that leads through the x-y plane, and share along z.
    fn shares(&self) -> (f64, f64) {
        (
            (self.radius * self.angle).abs() * self.scale,
            (self.to.z - self.from.z).abs() * self.scale,
        )
    }

    /// On a circle of radius `r` a speed `v` in the plane, with its derivatives `v'` and `v''`,
    /// has tangential and normal parts
    ///
    /// ```text
    /// acceleration  v',            v^2/r
    /// jerk          v'' - v^3/r^2,  3 v v'/r
    /// ```
    ///
    /// Their vectors stay within the limits `A` and `J` when the highest speed, acceleration and
    /// jerk along the path do so together. The speed may take half of `A^2` and a quarter of `J`,
    /// and the acceleration what then is left, and half of `J^2`. This is a closed form and not the
    /// fastest: up to a whole turn within the rig's limits the best speed, acceleration and jerk
    /// take up to a sixth less time, on many turns of a small circle up to a third.
    fn limits(&self, limits: &Limits) -> Rates {
        let (across, along) = self.shares();
        let least = |xy: f64, z: f64| within(xy, across).min(within(z, along));
        let Rates {
            speed,
            acceleration,
            jerk,
        } = limits.xy;
        let mut top = least(speed, limits.z.speed);
        if across == 0.0 {
            return Rates {
                speed: top,
                acceleration: limits.z.acceleration,
                jerk: limits.z.jerk,
            };
        }
        // No profile of this length gets faster, so nothing need be kept for higher speeds.
        let (a, j) = (
            least(acceleration, limits.z.acceleration),
            least(jerk, limits.z.jerk),
        );
        top = top
            .min((self.length * a).sqrt())
            .min((0.25 * self.length * self.length * j).cbrt());
        let r = self.radius;
        let v = (across * top)
            .min((r * acceleration / SQRT_2).sqrt())
            .min((0.25 * r * r * jerk).cbrt());
        let normal = v * v / r;
        let tangential = (acceleration * acceleration - normal * normal)
            .sqrt()
            .min(jerk * r / (3.0 * SQRT_2 * v));
        let turning = 3.0 * v * tangential / r;
        let left = (jerk * jerk - turning * turning).sqrt() - v * normal / r;
        Rates {
            speed: v / across,
            acceleration: least(tangential, limits.z.acceleration),
            jerk: least(left, limits.z.jerk),
        }
    }

    /// Corners of the box around it: its ends, and where it turns back in x or y.
    fn bounds(&self) -> [Point<Macro>; 2] {
        let [mut low, mut high] = box_around(self.from, self.to);
        let Displacement { x, y } = self.inward;
        let start = (-y).atan2(-x);
        let (cx, cy) = (self.from.x + x, self.from.y + y);
        for quarter in 0..4_u8 {
            let on = self.angle.signum() * (f64::from(quarter) * FRAC_PI_2 - start);
            if on.rem_euclid(TAU) <= self.angle.abs() {
                match quarter {
                    0 => high.x = high.x.max(cx + self.radius),
                    1 => high.y = high.y.max(cy + self.radius),
                    2 => low.x = low.x.min(cx - self.radius),
                    _ => low.y = low.y.min(cy - self.radius),
                }
            }
        }
        [low, high]
    }
}

fn box_around(a: Point<Macro>, b: Point<Macro>) -> [Point<Macro>; 2] {
    [
        Point::new(a.x.min(b.x), a.y.min(b.y), a.z.min(b.z)),
        Point::new(a.x.max(b.x), a.y.max(b.y), a.z.max(b.z)),
    ]
}

impl Path {
    /// Where it starts.
    pub fn start(&self) -> Point<Macro> {
        match self {
            Self::Line(line) => line.from,
            Self::Arc(arc) => arc.from,
        }
    }

    /// Where it ends.
    pub fn end(&self) -> Point<Macro> {
        match self {
            Self::Line(line) => line.to,
            Self::Arc(arc) => arc.to,
        }
    }

    /// Metres from start to end.
    pub fn length(&self) -> f64 {
        match self {
            Self::Line(line) => line.length,
            Self::Arc(arc) => arc.length,
        }
    }

    /// The point `way` metres from the start; the end up to rounding.
    pub fn at(&self, way: f64) -> Point<Macro> {
        match self {
            Self::Line(line) => line.at(way),
            Self::Arc(arc) => arc.at(way),
        }
    }

    /// The rates along the path that keep `limits` at each of its points.
    pub fn limits(&self, limits: &Limits) -> Rates {
        match self {
            Self::Line(line) => line.limits(limits),
            Self::Arc(arc) => arc.limits(limits),
        }
    }

    /// Share of the way that leads through the x-y plane, and share along z: also the shares of
    /// the speed.
    pub fn shares(&self) -> (f64, f64) {
        match self {
            Self::Line(line) => line.shares(),
            Self::Arc(arc) => arc.shares(),
        }
    }

    /// Lowest and highest coordinates of its points.
    pub fn bounds(&self) -> [Point<Macro>; 2] {
        match self {
            Self::Line(line) => box_around(line.from, line.to),
            Self::Arc(arc) => arc.bounds(),
        }
    }

    /// Lengths of the vectors of speed, acceleration and jerk that progress along the path makes
    /// in the x-y plane and along z.
    pub fn rates(&self, progress: &Progress) -> Limits {
        let (across, along) = self.shares();
        let by = |share: f64| {
            // No way has no direction.
            let share = if share > 0.0 { share } else { 0.0 };
            Rates {
                speed: share * progress.rates.speed,
                acceleration: share * progress.rates.acceleration,
                jerk: share * progress.rates.jerk,
            }
        };
        let (xy, z) = (by(across), by(along));
        let normal = match self {
            Self::Arc(arc) if across > 0.0 => xy.speed / arc.radius,
            _ => 0.0,
        };
        Limits {
            xy: Rates {
                speed: xy.speed.abs(),
                acceleration: xy.acceleration.hypot(xy.speed * normal),
                jerk: (xy.jerk - xy.speed * normal * normal).hypot(3.0 * xy.acceleration * normal),
            },
            z: Rates {
                speed: z.speed.abs(),
                acceleration: z.acceleration.abs(),
                jerk: z.jerk.abs(),
            },
        }
    }
}
