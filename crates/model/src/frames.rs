//! Points that know the frame in which they are stated.
//!
//! The mistakes that matter here are not millimetres for metres but one frame for another, so the
//! frame is part of the type, and only a transform named for both frames leads across.

use std::marker::PhantomData;
use std::ops::{Add, AddAssign, Div, Mul, Sub, SubAssign};

/// The chip: x across it, y up out of its top face, z along the waveguide, origin at the nominal
/// input port. y = 0 is the top of the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chip {}

/// One manipulator's endpoint: zero at home, z along its approach to the chip, y up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Macro {}

/// A displacement across the light, or a place across it as one from an origin: in x and y of the frame of
/// whoever moves, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Displacement {
    /// Along x, metres.
    pub x: f64,
    /// Along y, metres.
    pub y: f64,
}

impl Displacement {
    /// None.
    pub const ZERO: Self = Self::new(0.0, 0.0);

    /// A displacement of so many metres.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    /// A displacement of so many metres at an angle from the x axis, radians.
    pub fn polar(length: f64, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self::new(length * cos, length * sin)
    }

    /// Its length, metres.
    pub fn norm(self) -> f64 {
        (self.x * self.x + self.y * self.y).sqrt()
    }

    /// The z component of its vector product with another, square metres: positive where the other lies to
    /// its left.
    pub fn cross(self, other: Self) -> f64 {
        self.x * other.y - self.y * other.x
    }

    /// The same turned by an angle of this sine and cosine; with the sine's sign changed, turned back.
    #[must_use]
    pub fn turned(self, sin: f64, cos: f64) -> Self {
        Self::new(cos * self.x - sin * self.y, sin * self.x + cos * self.y)
    }
}

impl Add for Displacement {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y)
    }
}

impl Sub for Displacement {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y)
    }
}

impl AddAssign for Displacement {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Displacement {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Mul<f64> for Displacement {
    type Output = Self;

    fn mul(self, times: f64) -> Self {
        Self::new(self.x * times, self.y * times)
    }
}

impl Div<f64> for Displacement {
    type Output = Self;

    fn div(self, by: f64) -> Self {
        Self::new(self.x / by, self.y / by)
    }
}

/// A point stated in frame `F`, metres.
#[derive(Debug, PartialEq)]
pub struct Point<F> {
    /// Coordinate along the frame's x, metres.
    pub x: f64,
    /// Coordinate along the frame's y, metres.
    pub y: f64,
    /// Coordinate along the frame's z, metres.
    pub z: f64,
    frame: PhantomData<F>,
}

impl<F> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Point<F> {}

impl<F> Point<F> {
    /// The point at these coordinates, metres.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self {
            x,
            y,
            z,
            frame: PhantomData,
        }
    }

    /// The frame's origin.
    pub const ORIGIN: Self = Self::new(0.0, 0.0, 0.0);

    /// The point that lies `(dx, dy, dz)` metres further along the axes of the same frame.
    #[must_use]
    pub fn shifted(self, dx: f64, dy: f64, dz: f64) -> Self {
        Self::new(self.x + dx, self.y + dy, self.z + dz)
    }

    /// Its place across.
    pub fn across(self) -> Displacement {
        Displacement::new(self.x, self.y)
    }

    /// The point that lies so far across.
    #[must_use]
    pub fn moved(self, by: Displacement) -> Self {
        self.shifted(by.x, by.y, 0.0)
    }

    /// Distance to another point of the same frame, metres.
    pub fn distance(self, other: Self) -> f64 {
        let (dx, dy, dz) = (self.x - other.x, self.y - other.y, self.z - other.z);
        (dx * dx + dy * dy + dz * dz).sqrt()
    }
}

/// Where a manipulator stands: its home in the chip's frame and its rotation about y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    home: Point<Chip>,
    cos: f64,
    sin: f64,
}

impl Placement {
    /// A manipulator whose home lies at `home` and that is turned by `yaw` radians about y: 0 for
    /// one that approaches along +z, pi for one that faces it.
    pub fn new(home: Point<Chip>, yaw: f64) -> Self {
        let (sin, cos) = yaw.sin_cos();
        Self { home, cos, sin }
    }

    /// A point of the manipulator's frame in the chip's.
    pub fn chip_from_macro(&self, p: Point<Macro>) -> Point<Chip> {
        self.home.shifted(
            self.cos * p.x + self.sin * p.z,
            p.y,
            self.cos * p.z - self.sin * p.x,
        )
    }

    /// A point of the chip's frame in the manipulator's.
    pub fn macro_from_chip(&self, p: Point<Chip>) -> Point<Macro> {
        let (dx, dz) = (p.x - self.home.x, p.z - self.home.z);
        Point::new(
            self.cos * dx - self.sin * dz,
            p.y - self.home.y,
            self.cos * dz + self.sin * dx,
        )
    }

    /// A direction of the manipulator's frame in the chip's.
    pub fn chip_direction(&self, x: f64, y: f64, z: f64) -> [f64; 3] {
        [self.cos * x + self.sin * z, y, self.cos * z - self.sin * x]
    }

    /// The same manipulator with its home moved by `(dx, dy, dz)` metres in the chip's frame.
    #[must_use]
    pub fn shifted(mut self, dx: f64, dy: f64, dz: f64) -> Self {
        self.home = self.home.shifted(dx, dy, dz);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_add_up() {
        let there = Displacement::new(3.0, -4.0);
        assert_eq!((there * 2.0 - there).norm(), 5.0);
        assert_eq!(there.turned(1.0, 0.0), Displacement::new(4.0, 3.0));
        assert_eq!(there.cross(there.turned(1.0, 0.0)), 25.0);
        let p = Point::<Chip>::ORIGIN.moved(there / 2.0 + Displacement::ZERO);
        assert_eq!(p, Point::new(1.5, -2.0, 0.0));
    }

    #[test]
    fn there_and_back() {
        let placement = Placement::new(Point::new(0.001, -0.002, 0.02), 3.0);
        let p = Point::<Macro>::new(0.003, 0.004, -0.005);
        let back = placement.macro_from_chip(placement.chip_from_macro(p));
        assert!(back.distance(p) < 1e-17);
    }

    #[test]
    fn a_manipulator_that_faces_plus_z_approaches_along_minus_z() {
        let right = Placement::new(Point::new(0.0, 0.0, 0.024), std::f64::consts::PI);
        let tip = right.chip_from_macro(Point::new(0.001, 0.0, 0.004));
        assert!(tip.distance(Point::new(-0.001, 0.0, 0.020)) < 1e-12);
    }
}
