//! How steeply light rises or falls with the gap where a fiber stands: between facet and fiber's end it ripples, and on stages that
//! stand askew a fiber that goes across goes along the ripple too, so that its light is brightest beside its peak.

use crate::procedure::outward;
use crate::tuning::TUNING;
use nalgebra::{Matrix4, Vector4};
use pigtail_hal::Side;
use pigtail_numerics::normal::Normal;

/// Light at a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The gap by encoders, metres.
    pub gap: f64,
    /// Natural logarithm of the light at its peak, beside what the gap makes of it by design.
    pub light: f64,
    /// Standard deviation of that.
    pub deviation: f64,
}

/// How steeply light rises along a way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rise {
    /// By which share of it, 1/m.
    pub slope: f64,
    /// Standard deviation of that, 1/m.
    pub deviation: f64,
}

impl Rise {
    /// The same along the chip's z instead of the gap of a fiber of a side, which is longer the farther out it stands.
    #[must_use]
    pub fn along_z(self, side: Side) -> Self {
        Self {
            slope: outward(side) * self.slope,
            ..self
        }
    }
}

/// Level, fall, and the ripple's two parts.
const UNKNOWNS: usize = 4;

/// How light ripples about a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ripple {
    /// Where that is, by encoders, metres.
    at: f64,
    /// Radians a metre.
    wave: f64,
    /// Level, fall in a radian, and the parts that go with cosine and sine of the radians from there; shares of the light.
    found: Vector4<f64>,
    covariance: Matrix4<f64>,
}

impl Ripple {
    /// About the last of some gaps, of light that ripples with so many radians a metre and may fall by so much a metre more or less than by design;
    /// `None` of gaps too few. Encoders tell all ways between them but for what a transmission may hide.
    ///
    /// ```
    /// # use pigtail_control::rise::{Ripple, Seen};
    /// # use std::f64::consts::TAU;
    /// let wave = TAU / 0.65e-6;
    /// let gaps = (0..7).map(|k| 10e-6 - f64::from(k) * 0.11e-6);
    /// let seen: Vec<_> = gaps
    ///     .map(|gap| Seen { gap, light: 0.7 + 0.03 * (wave * gap).sin(), deviation: 1e-3 })
    ///     .collect();
    /// let at = seen[6].gap;
    /// let rise = Ripple::of(&seen, wave, 1e3).unwrap().rise(at).unwrap();
    /// let expected = 0.03 * wave * (wave * at).cos();
    /// assert!((rise.slope - expected).abs() < 1e-3 * 0.03 * wave);
    /// ```
    pub fn of(seen: &[Seen], wave: f64, falls: f64) -> Option<Self> {
        let at = seen.last().filter(|_| seen.len() > UNKNOWNS)?.gap;
        let mut normal = Normal::<UNKNOWNS>::default();
        normal.add_weighted(&Vector4::y(), 0.0, (falls / wave).powi(-2));
        for each in seen {
            let row = level(wave * (each.gap - at));
            normal.add_weighted(&row, each.light, each.deviation.powi(-2));
        }
        let found = normal.solve()?;
        let covariance = normal.matrix.try_inverse()?;
        let left = seen.iter().map(|each| {
            let row = level(wave * (each.gap - at));
            ((each.light - row.dot(&found)) / each.deviation).powi(2)
        });
        let more = left.sum::<f64>() / (seen.len() - UNKNOWNS) as f64;
        Some(Self {
            at,
            wave,
            found,
            covariance: covariance * more.max(1.0),
        })
    }

    /// How steeply light rises at a gap by encoders, metres, for small ways across; `None` where that is too far from where it was seen.
    pub fn rise(&self, gap: f64) -> Option<Rise> {
        let way = gap - self.at;
        if way.abs() > TUNING.rise.near {
            return None;
        }
        let (sin, cos) = (self.wave * way).sin_cos();
        let steep = Vector4::new(0.0, 1.0, -sin, cos);
        // What a transmission keeps to itself turns the ripple.
        let hidden = if way.abs() > TUNING.rise.same {
            TUNING.width.hidden
        } else {
            TUNING.rise.hidden
        };
        let bends = cos * self.found[2] + sin * self.found[3];
        let known = (self.covariance * steep).dot(&steep).sqrt();
        Some(Rise {
            slope: self.wave * steep.dot(&self.found),
            deviation: self.wave * known.hypot(bends * self.wave * hidden),
        })
    }
}

/// What the light is so many radians of a ripple from where that is seen from.
fn level(turned: f64) -> Vector4<f64> {
    let (sin, cos) = turned.sin_cos();
    Vector4::new(1.0, turned, cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const WAVE: f64 = TAU / 0.65e-6;

    fn seen(noise: f64, phase: f64, mut normal: impl FnMut() -> f64) -> Vec<Seen> {
        (0..7)
            .map(|k| {
                let gap = 10e-6 - f64::from(k) * 0.65e-6 / 6.0;
                let light = 0.03 * (WAVE * gap + phase).sin() + 5e3 * gap;
                Seen {
                    gap,
                    light: light + noise * normal(),
                    deviation: noise,
                }
            })
            .collect()
    }

    #[test]
    fn it_is_as_far_off_as_it_says() {
        let mut state = 11_u64;
        let mut normal = || {
            (0..12).fold(-6.0, |sum, _| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                sum + (state >> 33) as f64 / f64::from(1_u32 << 31)
            })
        };
        let (mut off, n) = (0.0, 400);
        for k in 0..n {
            let phase = f64::from(k);
            let ripple = Ripple::of(&seen(3e-3, phase, &mut normal), WAVE, 1e4).expect("a ripple");
            let rise = ripple.rise(ripple.at).expect("a slope");
            // A transmission has kept a little of the way to itself.
            let at = ripple.at + TUNING.rise.hidden * normal();
            let truth = 0.03 * WAVE * (WAVE * at + phase).cos() + 5e3;
            off += ((rise.slope - truth) / rise.deviation).powi(2);
        }
        let off = (off / f64::from(n)).sqrt();
        assert!((0.7..1.15).contains(&off), "{off}");
    }

    #[test]
    fn few_gaps_tell_nothing() {
        assert_eq!(Ripple::of(&seen(1e-3, 0.0, || 0.0)[..4], WAVE, 1e4), None);
        // Nor do gaps far from another one.
        let ripple = Ripple::of(&seen(1e-3, 0.0, || 0.0), WAVE, 1e4).expect("a ripple");
        assert_eq!(ripple.rise(12e-6), None);
    }
}
