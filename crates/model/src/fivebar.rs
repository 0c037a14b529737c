//! Kinematics of the planar five-bar mechanism (thesis 2.1).
//!
//! Two proximal links of equal length turn about bases on the x axis, at `-base/2` (joint A) and
//! `+base/2` (joint B). A distal link hangs on each, and the two meet at the endpoint. Timing belts
//! keep the endpoint's orientation, so only its position is of interest.
//!
//! The mechanism is used in one working mode: both elbows outward (A's to the left, B's to the
//! right), the endpoint above the line through the elbows.

#![expect(
    clippy::inline_always,
    clippy::needless_bitwise_bool,
    reason = "what is not inlined does not get the instructions of its caller, and a short cut is a branch"
)]

use crate::Invalid;
use crate::each::Each;
use crate::frames::Displacement;

/// An output angle of a five-bar joint, radians from the x axis. Not to be mistaken for a motor
/// angle, which is the gear ratio times as large and counted from home.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct JointAngle(pub f64);

/// Sine and cosine of an angle that is asked for again and again while it changes little: turned on from where
/// they were last worked out in full, to the last bit or two.
///
/// ```
/// # use pigtail_model::fivebar::Turning;
/// let mut turning = Turning::default();
/// for k in 0..1000 {
///     let angle = 1.0 + 1e-4 * f64::from(k);
///     let (sin, cos) = turning.sin_cos(angle);
///     assert!((sin - angle.sin()).abs() < 3e-16 && (cos - angle.cos()).abs() < 3e-16);
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turning {
    at: f64,
    sin: f64,
    cos: f64,
}

impl Default for Turning {
    fn default() -> Self {
        Self {
            at: 0.0,
            sin: 0.0,
            cos: 1.0,
        }
    }
}

impl Turning {
    /// Farther on than this the series below would not do, radians.
    const NEAR: f64 = 1.0 / 128.0;

    fn begin(&mut self, angle: f64) {
        let (sin, cos) = angle.sin_cos();
        *self = Self {
            at: angle,
            sin,
            cos,
        };
    }

    /// Angle of a direction that is `length` long, radians: [`f64::atan2`] to 1e-15 rad.
    #[inline(always)]
    fn angle_of(&mut self, direction: Displacement, length: f64) -> f64 {
        let Displacement { x, y } = direction;
        let sin = (y * self.cos - x * self.sin) / length;
        let is_near = sin.abs() <= Self::NEAR && x * self.cos + y * self.sin > 0.0;
        if !is_near {
            let angle = y.atan2(x);
            self.begin(angle);
            return angle;
        }
        let square = sin * sin;
        let more = square * (1.0 / 6.0 + square * (3.0 / 40.0 + square * (5.0 / 112.0)));
        self.at + (sin + sin * more)
    }

    /// Sine and cosine of `angle`, radians.
    #[inline(always)]
    pub fn sin_cos(&mut self, angle: f64) -> (f64, f64) {
        let by = angle - self.at;
        let is_near = by.abs() <= Self::NEAR;
        if !is_near {
            self.begin(angle);
            return (self.sin, self.cos);
        }
        let square = by * by;
        let sin = by * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0)));
        // Less one.
        let cos = -square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)));
        (
            self.sin + (self.sin * cos + self.cos * sin),
            self.cos + (self.cos * cos - self.sin * sin),
        )
    }
}

/// Five-bars side by side, whose joint angles change little from one call to the next.
///
/// ```
/// # use pigtail_model::each::Each;
/// # use pigtail_model::fivebar::{FiveBar, FiveBars, JointAngle};
/// let five_bar = FiveBar::new(0.04, 0.045, 0.0725)?;
/// let mut five_bars = FiveBars::new([five_bar; 2]);
/// for k in 0..1000 {
///     let (a, b) = (2.0 + 1e-3 * f64::from(k), 1.2 - 5e-4 * f64::from(k));
///     let (x, y) = five_bars.forward([Each([a, 2.1]), Each([b, 1.1])]);
///     for (k, angles) in [[a, b], [2.1, 1.1]].into_iter().enumerate() {
///         let anew = five_bar.forward(angles.map(JointAngle))?;
///         assert!((x[k] - anew.0).abs() < 1e-16 && (y[k] - anew.1).abs() < 1e-16);
///     }
/// }
/// // Elbows that are too far apart for distal links that are shorter.
/// let mut short = FiveBars::new([FiveBar::new(0.04, 0.045, 0.06)?; 2]);
/// assert!(short.forward([Each([3.1; 2]), Each([0.0; 2])]).0[0].is_nan());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiveBars<const N: usize> {
    base: Each<N>,
    proximal: Each<N>,
    /// Squares of the lengths of the distal links, square metres.
    distal: Each<N>,
    turning: [Turnings<N>; 2],
}

impl<const N: usize> FiveBars<N> {
    /// These.
    pub fn new(of: [FiveBar; N]) -> Self {
        Self {
            base: Each(of.map(|bar| bar.base)),
            proximal: Each(of.map(|bar| bar.proximal)),
            distal: Each(of.map(|bar| bar.distal * bar.distal)),
            turning: [Turnings::default(); 2],
        }
    }

    /// Endpoints x and y, metres, at these angles of the joints A and B, radians; no numbers where distal links cannot meet. As
    /// [`FiveBar::forward_from`], all of them at once.
    #[inline(always)]
    pub fn forward(&mut self, [a, b]: [Each<N>; 2]) -> (Each<N>, Each<N>) {
        let [of_a, of_b] = &mut self.turning;
        let ((sin_a, cos_a), (sin_b, cos_b)) = (of_a.sin_cos(a), of_b.sin_cos(b));
        let half = 0.5 * self.base;
        let (ax, ay) = (self.proximal * cos_a - half, self.proximal * sin_a);
        let (bx, by) = (self.proximal * cos_b + half, self.proximal * sin_b);
        let (apart_x, apart_y) = (bx - ax, by - ay);
        let square = apart_x * apart_x + apart_y * apart_y;
        // Of what is below zero there is no root.
        let scale = ((self.distal - 0.25 * square) / square).sqrt();
        (
            0.5 * (ax + bx) - scale * apart_y,
            0.5 * (ay + by) + scale * apart_x,
        )
    }
}

/// The [`Turning`] of each of some angles.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turnings<const N: usize> {
    at: Each<N>,
    sin: Each<N>,
    cos: Each<N>,
}

impl<const N: usize> Default for Turnings<N> {
    fn default() -> Self {
        let Turning { at, sin, cos } = Turning::default();
        Self {
            at: Each([at; N]),
            sin: Each([sin; N]),
            cos: Each([cos; N]),
        }
    }
}

impl<const N: usize> Turnings<N> {
    #[cold]
    fn begin(&mut self, angles: &Each<N>) {
        for k in 0..N {
            let is_near = (angles[k] - self.at[k]).abs() <= Turning::NEAR;
            if !is_near {
                let mut turning = Turning::default();
                turning.begin(angles[k]);
                (self.at[k], self.sin[k], self.cos[k]) = (turning.at, turning.sin, turning.cos);
            }
        }
    }

    #[inline(always)]
    fn sin_cos(&mut self, angles: Each<N>) -> (Each<N>, Each<N>) {
        // What is no number is not near either.
        let by = (angles - self.at).abs();
        if !(0..N).fold(true, |all, k| all & (by[k] <= Turning::NEAR)) {
            self.begin(&angles);
        }
        let by = angles - self.at;
        let square = by * by;
        let one = Each([1.0; N]);
        let sin = by * (one - square * (Each([1.0 / 6.0; N]) - (1.0 / 120.0) * square));
        // Less one.
        let cos = -square * (0.5 * one - square * (Each([1.0 / 24.0; N]) - (1.0 / 720.0) * square));
        (
            self.sin + (self.sin * cos + self.cos * sin),
            self.cos + (self.cos * cos - self.sin * sin),
        )
    }
}

/// The legs of a five-bar to its endpoint, of A and of B.
#[derive(Debug, Clone, Copy)]
struct Legs {
    /// The directions of the proximal links, as long as `reach`.
    along: (Each<2>, Each<2>),
    /// From the bases to the endpoint, metres.
    reach: Each<2>,
}

impl Legs {
    /// The direction of a proximal link.
    #[inline(always)]
    fn along(&self, leg: usize) -> Displacement {
        Displacement::new(self.along.0[leg], self.along.1[leg])
    }
}

/// A five-bar mechanism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiveBar {
    base: f64,
    proximal: f64,
    distal: f64,
}

/// Why a five-bar cannot be where it was asked to be.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// The endpoint is too far from, or too near to, a base for its two links.
    #[error("the endpoint ({x:.6} m, {y:.6} m) is out of reach of a leg of the five-bar")]
    OutOfReach {
        /// Endpoint x, metres.
        x: f64,
        /// Endpoint y, metres.
        y: f64,
    },
    /// The elbows are so far apart, or so near, that the distal links cannot meet.
    #[error("the five-bar cannot be assembled at joint angles {a:.6} rad and {b:.6} rad")]
    NotAssembled {
        /// Joint A, radians.
        a: f64,
        /// Joint B, radians.
        b: f64,
    },
    /// A leg is stretched or folded, or the distal links lie in one line: the endpoint cannot be
    /// moved, or not be held, in some direction.
    #[error("the five-bar is singular, or in another working mode, at ({x:.6} m, {y:.6} m)")]
    Singular {
        /// Endpoint x, metres.
        x: f64,
        /// Endpoint y, metres.
        y: f64,
    },
}

/// Sine of the smallest angle between two links at which they still count as not in line.
const SINGULAR: f64 = 1e-6;

/// Angles of elbow A, elbow B and tip, and the rate of each with the joints A and B.
pub type BearingAngles = ([f64; 3], [[f64; 2]; 3]);

impl FiveBar {
    /// A five-bar from the distance of its bases and the lengths of its proximal and distal
    /// links, metres.
    ///
    /// # Errors
    ///
    /// When a length is not positive, or the mechanism cannot be assembled anywhere above its
    /// bases.
    pub fn new(base: f64, proximal: f64, distal: f64) -> Result<Self, Invalid> {
        Invalid::non_negative("base", base)?;
        Invalid::positive("proximal", proximal)?;
        Invalid::positive("distal", distal)?;
        if base >= 2.0 * (proximal + distal) {
            return Err(Invalid::new(
                "base",
                base,
                "less than twice the length of a leg",
            ));
        }
        Ok(Self {
            base,
            proximal,
            distal,
        })
    }

    fn base_x(&self, outward: f64) -> f64 {
        0.5 * outward * self.base
    }

    /// Joint angles `[A, B]` that put the endpoint at `(x, y)` metres, elbows outward.
    ///
    /// # Errors
    ///
    /// When the point is out of reach, or the mechanism would be singular there or in another
    /// working mode.
    pub fn inverse(&self, x: f64, y: f64) -> Result<[JointAngle; 2], Unreachable> {
        let legs = self.legs(x, y)?;
        Ok([0, 1].map(|leg| {
            let along = legs.along(leg);
            JointAngle(along.y.atan2(along.x))
        }))
    }

    /// The same of points that move little from one call to the next.
    ///
    /// # Errors
    ///
    /// As [`Self::inverse`].
    ///
    /// ```
    /// # use pigtail_model::fivebar::{FiveBar, Turning};
    /// let five_bar = FiveBar::new(0.04, 0.045, 0.0725)?;
    /// let mut turning = [Turning::default(); 2];
    /// for k in 0..1000 {
    ///     let (x, y) = (1e-5 * f64::from(k) - 5e-3, 0.095 - 1e-5 * f64::from(k));
    ///     let (carried, anew) = (five_bar.inverse_from(&mut turning, x, y), five_bar.inverse(x, y));
    ///     for (carried, anew) in carried?.iter().zip(anew?) {
    ///         assert!((carried.0 - anew.0).abs() < 2e-15);
    ///     }
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[inline(always)]
    pub fn inverse_from(
        &self,
        turning: &mut [Turning; 2],
        x: f64,
        y: f64,
    ) -> Result<[JointAngle; 2], Unreachable> {
        let legs = self.legs(x, y)?;
        let [of_a, of_b] = turning;
        let a = of_a.angle_of(legs.along(0), legs.reach[0]);
        let b = of_b.angle_of(legs.along(1), legs.reach[1]);
        Ok([JointAngle(a), JointAngle(b)])
    }

    /// The legs to a point, both at once.
    #[inline(always)]
    fn legs(&self, x: f64, y: f64) -> Result<Legs, Unreachable> {
        // Beyond the x axis the same elbows belong to the mirrored working mode.
        if y <= 0.0 {
            return Err(Unreachable::OutOfReach { x, y });
        }
        let (p, d) = (self.proximal, self.distal);
        let outward = Each([-1.0, 1.0]);
        let base = Each([self.base_x(-1.0), self.base_x(1.0)]);
        let (x_of, y_of) = (Each([x; 2]), Each([y; 2]));
        let dx = x_of - base;
        let square = dx * dx + y_of * y_of;
        let reach = square.sqrt();
        let cosine = (square + Each([p * p; 2]) - Each([d * d; 2])) / (2.0 * reach * Each([p; 2]));
        let sine = (Each([1.0; 2]) - cosine * cosine).sqrt();
        for leg in 0..2 {
            if cosine[leg].is_nan() || cosine[leg].abs() > 1.0 {
                return Err(Unreachable::OutOfReach { x, y });
            }
            if sine[leg] < SINGULAR {
                return Err(Unreachable::Singular { x, y });
            }
        }
        // A proximal link's direction is the line to the endpoint turned outward.
        let along = (
            dx * cosine + outward * y_of * sine,
            y_of * cosine + -outward * dx * sine,
        );
        let share = Each([p; 2]) / reach;
        let (u, v) = (x_of - (along.0 * share + base), y_of - along.1 * share);
        // The endpoint lies above the line through the elbows exactly when the distal links
        // cross in this sense.
        if u[0] * v[1] - v[0] * u[1] < SINGULAR * d * d {
            return Err(Unreachable::Singular { x, y });
        }
        Ok(Legs { along, reach })
    }

    /// Vectors from the elbows of A and B to the endpoint.
    fn distals(&self, tip: Displacement, angles: [JointAngle; 2]) -> [Displacement; 2] {
        self.elbows(angles).map(|elbow| tip - elbow)
    }

    fn elbows(&self, [a, b]: [JointAngle; 2]) -> [Displacement; 2] {
        let elbow = |angle: f64, outward: f64| {
            let mut elbow = Displacement::polar(self.proximal, angle);
            elbow.x += self.base_x(outward);
            elbow
        };
        [elbow(a.0, -1.0), elbow(b.0, 1.0)]
    }

    /// Endpoint `(x, y)` in metres at joint angles `[A, B]`, above the line through the elbows.
    ///
    /// # Errors
    ///
    /// When the distal links cannot meet, or lie in one line.
    #[inline(always)]
    pub fn forward(&self, angles: [JointAngle; 2]) -> Result<(f64, f64), Unreachable> {
        self.meet(self.elbows(angles), angles)
    }

    /// The same as [`Self::forward`] of angles that change little from one call to the next, to 1e-16 of the
    /// links' lengths.
    ///
    /// # Errors
    ///
    /// As [`Self::forward`].
    #[inline(always)]
    pub fn forward_from(
        &self,
        turning: &mut [Turning; 2],
        angles: [JointAngle; 2],
    ) -> Result<(f64, f64), Unreachable> {
        // One by one: a closure that is called twice may be left a call, which gets none of its caller's instructions.
        let [a, b] = turning;
        let (sin_a, cos_a) = a.sin_cos(angles[0].0);
        let (sin_b, cos_b) = b.sin_cos(angles[1].0);
        let elbows = [
            Displacement::new(
                self.proximal * cos_a + self.base_x(-1.0),
                self.proximal * sin_a,
            ),
            Displacement::new(
                self.proximal * cos_b + self.base_x(1.0),
                self.proximal * sin_b,
            ),
        ];
        self.meet(elbows, angles)
    }

    /// Where distal links from these elbows meet.
    #[inline(always)]
    fn meet(
        &self,
        [a, b]: [Displacement; 2],
        angles: [JointAngle; 2],
    ) -> Result<(f64, f64), Unreachable> {
        let apart = b - a;
        let square = apart.x * apart.x + apart.y * apart.y;
        let height_square = self.distal * self.distal - 0.25 * square;
        if !(height_square > 0.0 && square > 0.0) {
            return Err(Unreachable::NotAssembled {
                a: angles[0].0,
                b: angles[1].0,
            });
        }
        let scale = (height_square / square).sqrt();
        Ok((
            0.5 * (a.x + b.x) - scale * apart.y,
            0.5 * (a.y + b.y) + scale * apart.x,
        ))
    }

    /// Length of the proximal links, metres: about how far the endpoint goes for a radian of a joint.
    pub fn proximal(&self) -> f64 {
        self.proximal
    }

    /// Angles of the bearings between the links, radians, and their rates with the joints A and B:
    /// elbow A, elbow B (distal link against proximal), tip (one distal link against the other).
    ///
    /// # Errors
    ///
    /// As [`Self::forward`].
    pub fn bearings(&self, angles: [JointAngle; 2]) -> Result<BearingAngles, Unreachable> {
        let (x, y) = self.forward(angles)?;
        let links = self.distals(Displacement::new(x, y), angles);
        let [[xa, xb], [ya, yb]] = self.jacobian(angles)?;
        let rates = [Displacement::new(xa, ya), Displacement::new(xb, yb)];
        let [JointAngle(a), JointAngle(b)] = angles;
        let directions = links.map(|link| link.y.atan2(link.x));
        // A distal link turns as its ends move apart across it: (u x u') / |u|^2.
        let square = self.distal * self.distal;
        let turn = |link: Displacement, rate: Displacement| link.cross(rate) / square;
        let elbow = |angle: f64| {
            Displacement::new(-self.proximal * angle.sin(), self.proximal * angle.cos())
        };
        let of_a = [
            turn(links[0], rates[0] - elbow(a)),
            turn(links[0], rates[1]),
        ];
        let of_b = [
            turn(links[1], rates[0]),
            turn(links[1], rates[1] - elbow(b)),
        ];
        Ok((
            [
                directions[0] - a,
                directions[1] - b,
                directions[0] - directions[1],
            ],
            [
                [of_a[0] - 1.0, of_a[1]],
                [of_b[0], of_b[1] - 1.0],
                [of_a[0] - of_b[0], of_a[1] - of_b[1]],
            ],
        ))
    }

    /// Endpoint velocity for joint velocities: `[[dx/dA, dx/dB], [dy/dA, dy/dB]]`, metres a
    /// radian.
    ///
    /// # Errors
    ///
    /// As [`Self::forward`].
    pub fn jacobian(&self, angles: [JointAngle; 2]) -> Result<[[f64; 2]; 2], Unreachable> {
        let (x, y) = self.forward(angles)?;
        let [u, v] = self.distals(Displacement::new(x, y), angles);
        let cross = u.cross(v);
        if cross.abs() < SINGULAR * self.distal * self.distal {
            return Err(Unreachable::Singular { x, y });
        }
        // Each distal link keeps its length: u . p' = u . (elbow A)', v . p' = v . (elbow B)'.
        let elbow_rate = |angle: JointAngle, link: Displacement| {
            self.proximal * (link.y * angle.0.cos() - link.x * angle.0.sin())
        };
        let (ra, rb) = (elbow_rate(angles[0], u), elbow_rate(angles[1], v));
        Ok([
            [ra * v.y / cross, -rb * u.y / cross],
            [-ra * v.x / cross, rb * u.x / cross],
        ])
    }

    /// Most that the joints `[A, B]` turn for a way of the endpoint, anywhere in the box between
    /// `low` and `high`: radians a metre, infinite where a leg is stretched
    /// or folded within the box or does not reach all of it.
    ///
    /// The distal link keeps its length, so with `d` the angle between the links of a leg
    ///
    /// ```text
    /// |dq/dp| = 1 / (proximal sin d),    reach^2 = proximal^2 + distal^2 + 2 proximal distal cos d
    /// ```
    ///
    /// and over a range of reaches `sin d` is least at one of its ends.
    pub fn most_rate(&self, low: Displacement, high: Displacement) -> [f64; 2] {
        [-1.0, 1.0].map(|outward| {
            let base = self.base_x(outward);
            let near = |low: f64, high: f64| low.max(-high).max(0.0);
            let far = |low: f64, high: f64| low.abs().max(high.abs());
            let (x, y) = ((low.x - base, high.x - base), (low.y, high.y));
            let least_sine = [
                near(x.0, x.1).hypot(near(y.0, y.1)),
                far(x.0, x.1).hypot(far(y.0, y.1)),
            ]
            .map(|reach| {
                let (p, d) = (self.proximal, self.distal);
                let cosine = (reach * reach - p * p - d * d) / (2.0 * p * d);
                (1.0 - cosine * cosine).max(0.0).sqrt()
            })
            .into_iter()
            .fold(1.0, f64::min);
            1.0 / (self.proximal * least_sine)
        })
    }
}
