//! How much light passes from a fiber to a waveguide and back.
//!
//! Left out: reflection at the facets and with it the interference in the gap, and the fiber's own
//! diameter. A loss here is that of the two modes not matching. What fills the gap, air or adhesive, sets
//! by its index how fast the beam spreads ([`Coupler::new`]) and at what angle it leaves ([`exit_angle`]).
//!
//! # Source
//!
//! W. B. Joyce and B. C. DeLoach, "Alignment of Gaussian beams", Applied Optics 23, 4187 (1984).

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use crate::Invalid;
use crate::exponential::exp;
use libm::erfc;
use std::f64::consts::PI;

/// The fundamental mode of a fiber or waveguide, a Gaussian with its waist at the facet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianMode {
    /// Radius at which the field has fallen to 1/e in x, metres.
    pub radius_x: f64,
    /// The same in y, metres.
    pub radius_y: f64,
}

/// How a receiving mode sits in the frame of a beam: the beam leaves its waist at the origin
/// along z.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Misalignment {
    /// Lateral offset in x, metres.
    pub x: f64,
    /// Lateral offset in y, metres.
    pub y: f64,
    /// Distance of the two waists along the beam, metres.
    pub z: f64,
    /// Tilt of the receiver's axis in the x-z plane, radians: positive turns its far end to
    /// positive x.
    pub tilt_x: f64,
    /// Tilt of the receiver's axis in the y-z plane, radians.
    pub tilt_y: f64,
}

/// Coupling of two Gaussian modes at one wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupler {
    x: Plane,
    y: Plane,
}

/// One transverse plane of a [`Coupler`], with what does not depend on the misalignment.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Plane {
    /// Squares of the radii of source and receiver, square metres; their sum; four times their product.
    squares: (f64, f64),
    sum: f64,
    product: f64,
    /// Half of `1/w1^2 + 1/w2^2`, and `1/w1^2`.
    halves: f64,
    inverse: f64,
    /// `lambda / pi`, metres, and its inverse.
    wavelength: f64,
    inverse_wavelength: f64,
}

impl Plane {
    fn new(source: f64, receiver: f64, wavelength: f64) -> Self {
        let (w1, w2) = (source * source, receiver * receiver);
        Self {
            squares: (w1, w2),
            sum: w1 + w2,
            product: 4.0 * w1 * w2,
            halves: 0.5 * (w1 + w2) / (w1 * w2),
            inverse: 1.0 / w1,
            wavelength: wavelength / PI,
            inverse_wavelength: PI / wavelength,
        }
    }

    /// Power coupled in this plane (the two multiply), Joyce and `DeLoach` (1984):
    ///
    /// ```text
    /// k   = 4 w1^2 w2^2 / ((w1^2 + w2^2)^2 + (lambda z / pi)^2)
    /// eta = sqrt(k) exp(-k [ x^2 (1/w1^2 + 1/w2^2)/2
    ///                        + (pi tilt/lambda)^2 (w1(z)^2 + w2^2)/2
    ///                        - x tilt z/w1^2 ])
    /// ```
    #[inline(always)]
    fn log_and_root(&self, x: f64, z: f64, tilt: f64) -> (f64, f64) {
        let (w1, w2) = self.squares;
        let spread = self.wavelength * z;
        let spread = spread * spread;
        let k = self.product / (self.sum * self.sum + spread);
        let waist_at_z = w1 + spread * self.inverse;
        let angle = self.inverse_wavelength * tilt;
        let exponent = x * x * self.halves + 0.5 * angle * angle * (waist_at_z + w2)
            - x * tilt * z * self.inverse;
        (k, k * exponent)
    }

    /// Radius of the source's beam at distance `z`, metres.
    #[inline(always)]
    fn radius(&self, z: f64) -> f64 {
        let spread = self.wavelength * z;
        (self.squares.0 + spread * spread * self.inverse).sqrt()
    }
}

impl Coupler {
    /// Coupling between `source` and `receiver` at `wavelength` (metres) in what fills the gap: that in
    /// vacuum over its index.
    ///
    /// # Errors
    ///
    /// When a radius or the wavelength is not positive.
    pub fn new(
        source: GaussianMode,
        receiver: GaussianMode,
        wavelength: f64,
    ) -> Result<Self, Invalid> {
        Invalid::positive("wavelength", wavelength)?;
        for radius in [
            source.radius_x,
            source.radius_y,
            receiver.radius_x,
            receiver.radius_y,
        ] {
            Invalid::positive("mode radius", radius)?;
        }
        let plane = |source, receiver| Plane::new(source, receiver, wavelength);
        Ok(Self {
            x: plane(source.radius_x, receiver.radius_x),
            y: plane(source.radius_y, receiver.radius_y),
        })
    }

    /// Share of the source's power that enters the receiver, 0 to 1.
    #[inline(always)]
    pub fn efficiency(&self, at: &Misalignment) -> f64 {
        let (kx, ex) = self.x.log_and_root(at.x, at.z, at.tilt_x);
        let (ky, ey) = self.y.log_and_root(at.y, at.z, at.tilt_y);
        (kx * ky).sqrt() * exp(-(ex + ey))
    }

    /// Radius of the source's beam at distance `z`, the mean of its two planes, metres.
    #[inline(always)]
    pub fn beam_radius(&self, z: f64) -> f64 {
        0.5 * (self.x.radius(z) + self.y.radius(z))
    }
}

/// Angle in radians at which light from a guide of index `index` leaves a facet that is turned
/// by `facet` radians, measured from the guide's axis in a gap of index `gap` (Snell). Beyond total
/// reflection it stays at grazing.
///
/// The peak of the coupling therefore walks sideways by the tangent of this angle for each metre
/// of gap: the refraction of thesis 3.1 and 3.3.
pub fn exit_angle(facet: f64, index: f64, gap: f64) -> f64 {
    (index / gap * facet.sin()).clamp(-1.0, 1.0).asin() - facet
}

/// Share of a Gaussian beam of radius `beam` that falls into a round core of radius `core`
/// whose centre lies `offset` metres from the beam's.
///
/// A beam of up to a third of the core's radius sees its rim as straight, moved inward by the mean
/// of its curvature over the beam; that errs by less than 0.003. Wider beams are integrated ring by
/// ring: with `r` and `d` for the ring's radius and the offset,
///
/// ```text
/// P = int_0^core 4 r / beam^2 exp(-2 (r^2 + d^2) / beam^2) I_0(4 r d / beam^2) dr
/// ```
#[inline(always)]
pub fn core_capture(offset: f64, core: f64, beam: f64) -> f64 {
    if 3.0 * beam <= core {
        let rim = core - beam * beam / (8.0 * core);
        return 0.5 * erfc((offset - rim) * std::f64::consts::SQRT_2 / beam);
    }
    // Gauss-Legendre with ten points: the integrand is smooth over a third of its range at least.
    let scale = 2.0 / (beam * beam);
    let mut rings = [0.0; NODES.len()];
    for (value, (node, weight)) in rings.iter_mut().zip(NODES) {
        *value = weight * ring(0.5 * core * (1.0 + node), offset, scale);
    }
    0.5 * core * rings.iter().sum::<f64>()
}

/// Nodes of Gauss and Legendre with their weights; two that weigh nothing, so that four at once are worked out three times.
const NODES: [(f64, f64); 12] = [
    (-0.973_906_528_517_171_7, 0.066_671_344_308_688_1),
    (-0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (-0.679_409_568_299_024_4, 0.219_086_362_515_982),
    (-0.433_395_394_129_247_2, 0.269_266_719_309_996_3),
    (-0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
    (0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_3),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_1),
    (0.0, 0.0),
    (0.0, 0.0),
];

/// The integrand at `r`, with `scale` for `2 / beam^2`. (No closure: one may be left a call, which gets none of its
/// caller's instructions.)
#[inline(always)]
fn ring(r: f64, offset: f64, scale: f64) -> f64 {
    let gap = r - offset;
    2.0 * scale * r * bessel_i0_damped(2.0 * scale * r * offset, scale * gap * gap)
}

/// `exp(-x - y) I_0(x)` for `x >= 0`, to 3e-7 (Abramowitz and Stegun 9.8.1, 9.8.2), with one exponential in all and without a
/// branch.
#[inline(always)]
fn bessel_i0_damped(x: f64, y: f64) -> f64 {
    const NEAR: [f64; 7] = [
        1.0,
        3.515_622_9,
        3.089_942_4,
        1.206_749_2,
        0.265_973_2,
        0.036_076_8,
        0.004_581_3,
    ];
    const FAR: [f64; 9] = [
        0.398_942_28,
        0.013_285_92,
        0.002_253_19,
        -0.001_575_65,
        0.009_162_81,
        -0.020_577_06,
        0.026_355_37,
        -0.016_476_33,
        0.003_923_77,
    ];
    let (is_near, t) = (x < 3.75, x * (1.0 / 3.75));
    // Far, from where it is used on: nothing is divided by zero.
    let far = if is_near { 3.75 } else { x };
    let near = horner(t * t, NEAR);
    let far = horner(3.75 / far, FAR) / far.sqrt();
    let damping = if is_near { x + y } else { y };
    exp(-damping) * if is_near { near } else { far }
}

/// A polynomial with these coefficients, of the constant first.
#[inline(always)]
fn horner<const N: usize>(t: f64, coefficients: [f64; N]) -> f64 {
    let mut sum = 0.0;
    for c in coefficients.into_iter().rev() {
        sum = sum * t + c;
    }
    sum
}

/// Share of a disc of radius `radius` that lies below a straight horizontal edge, for a centre
/// `height` metres above the edge.
#[inline(always)]
pub fn disc_below_edge(height: f64, radius: f64) -> f64 {
    if height.abs() >= radius {
        return if height > 0.0 { 0.0 } else { 1.0 };
    }
    let h = height / radius;
    (h.acos() - h * (1.0 - h * h).sqrt()) / PI
}
