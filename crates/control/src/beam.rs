//! What is known beforehand of the light between a fiber and a guide: two like Gaussian modes.

mod oblong;

use crate::recipe::Mode;
use crate::rise::Rise;
use crate::tuning::TUNING;
use nalgebra::{Matrix3, Vector2, Vector3};
pub use oblong::Oblong;
use pigtail_hal::quantity;
use pigtail_hal::spec::GuardSpec;
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::{Normal, Problem, Rules, minimise};
use pigtail_numerics::statistics::pooled;
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::PI;

/// By what angles ways across go along the light, too: stages stand askew.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Askew {
    /// Of ways in x and in y, radians: above zero where ways in a manipulator's x lead towards the chip's -z, as on one that is turned about y by so
    /// much, and where ways in y lead towards its z.
    #[serde(with = "quantity::Angles::<2>")]
    pub ways: [f64; 2],
    /// Standard deviation of both, radians.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub deviation: f64,
}

/// The coupling of a fiber to a guide of the same mode, by design. Only its shape is relied on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Radius at which the field has fallen to 1/e, metres.
    radius: f64,
    /// The same by design, metres.
    design: f64,
    /// Rayleigh length, metres.
    rayleigh: f64,
    /// Cosine of the light's angle to the z axis.
    cos: f64,
    /// By which share the inverse square of the width is more in x, and less in y: modes are not quite round.
    oblong: f64,
    /// What was known of that beforehand.
    known: Oblong,
    /// How steeply light may rise or fall with the gap beside that, of itself, 1/m.
    ripples: f64,
    askew: Askew,
}

/// How wide the spot of light is where a fiber and a guide touch, in x and in y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotSize {
    /// Distance from the peak at which the light has fallen to 1/e, metres of the micro's own scale.
    pub radius: [f64; 2],
    /// Standard deviations of their natural logarithms.
    pub deviation: [f64; 2],
}

impl SpotSize {
    /// What several fibers have told of one manipulator and one product, for another fiber of another device; `None` of none.
    pub fn of_all(told: &[Self]) -> Option<Self> {
        let axis = |i: usize| {
            let each = told
                .iter()
                .map(|one| (one.radius[i].ln(), one.deviation[i]));
            let (mean, deviation) = pooled(each);
            (mean.exp(), deviation.hypot(TUNING.beam.another))
        };
        let [x, y] = [axis(0), axis(1)];
        (!told.is_empty()).then_some(Self {
            radius: [x.0, y.0],
            deviation: [x.1, y.1],
        })
    }

    /// Whether it is known better than a design is.
    pub fn is_known(&self) -> bool {
        self.deviation
            .iter()
            .all(|deviation| *deviation < TUNING.beam.well)
    }
}

/// A reading of the light, and where the fiber was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Its place across.
    pub at: Displacement,
    /// The gap between facet and tip, metres.
    pub gap: f64,
    /// Light above the background, volts.
    pub volts: f64,
}

/// A peak through some readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Its place across.
    pub at: Displacement,
    /// Light of a fiber at the peak and without a gap, volts.
    pub full: f64,
    /// Standard deviation of `full` by the noise of the readings, volts.
    pub full_deviation: f64,
    /// Standard deviations of the place in x and in y by the noise, metres.
    pub deviations: [f64; 2],
}

impl Peak {
    /// The greater of the place's standard deviations, metres.
    pub fn deviation(&self) -> f64 {
        self.deviations[0].max(self.deviations[1])
    }
}

impl Beam {
    /// The coupling of the modes of a recipe, at an angle of `exit` radians to the z axis.
    pub fn new(mode: &Mode, exit: f64) -> Self {
        Self {
            radius: mode.radius,
            design: mode.radius,
            rayleigh: PI * mode.radius * mode.radius * mode.gap_index / mode.wavelength,
            cos: exit.cos(),
            oblong: 0.0,
            known: Oblong::default(),
            ripples: ripples(mode),
            askew: Askew {
                ways: [0.0; 2],
                deviation: GuardSpec::default().askew,
            },
        }
    }

    /// The same light on stages that stand so much askew.
    #[must_use]
    pub fn on_stages(self, askew: Askew) -> Self {
        Self { askew, ..self }
    }

    /// How far beside its peak a fiber may be where its light is brightest, for widths whose squares are these (square metres): standard
    /// deviations and bounds in x and in y, metres. Between facet and fiber's end light ripples with the gap, so that across stages that
    /// stand askew it rises to one side: its brightest place is `w^2/2` times as far aside as it rises, of itself, with a metre. Where
    /// in a ripple a fiber stands nobody knows, nor whether its faces are coated.
    pub fn aside(&self, squared: [f64; 2]) -> [(f64, f64); 2] {
        [0, 1].map(|i| {
            let aside = 0.5 * squared[i] * TUNING.beam.rippled * self.ripples;
            (
                aside * self.askew.deviation,
                aside * self.askew.ways[i].abs(),
            )
        })
    }

    /// The same where it was measured how steeply light rises along the chip's z: how far beside its peak it is brightest in a manipulator's x and y, metres,
    /// and how well that is known.
    pub fn aside_by(&self, rise: &Rise, squared: [f64; 2]) -> (Displacement, [(f64, f64); 2]) {
        let [x, y] = self.askew.ways;
        let along = [-x, y];
        let aside = |i: usize| 0.5 * squared[i] * rise.slope * along[i];
        let known = [0, 1].map(|i| {
            let slope = rise.deviation * along[i];
            let ways = rise.slope.hypot(rise.deviation) * self.askew.deviation;
            let deviation = 0.5 * squared[i] * slope.hypot(ways);
            (deviation.hypot(TUNING.rise.width * aside(i)), 0.0)
        });
        (Displacement::new(aside(0), aside(1)), known)
    }

    /// By how much more or less than by design light may fall with a gap (metres) beside ripples, of its own, 1/m.
    pub fn falls(&self, gap: f64) -> f64 {
        let reach = self.cos * self.rayleigh;
        let z = gap.max(0.0) / reach;
        TUNING.rise.falls * 2.0 * z.max(1.0) / (4.0 + z * z) / reach
    }

    /// The same light with a spot that is as wide as it was measured.
    #[must_use]
    pub fn as_measured(self, size: &SpotSize) -> Self {
        let [x, y] = size.radius.map(|radius| radius.powi(-2));
        let radius = (0.5 * (x + y)).sqrt().recip();
        let share = ((x - y) / (x + y)).clamp(-TUNING.beam.most_oblong, TUNING.beam.most_oblong);
        Self {
            radius,
            rayleigh: self.rayleigh * (radius / self.radius).powi(2),
            oblong: share,
            known: Oblong::known(share, size.deviation[0].hypot(size.deviation[1])),
            ..self
        }
    }

    /// The same light, which spreads over a gap by a `lambda / 2 pi` (metres) as it was measured in the micro's own scale: of a micro that goes farther
    /// than it is told, spots are wider than they seem, and light spreads more slowly.
    #[must_use]
    pub fn spreading(self, length: f64) -> Self {
        let rayleigh = 0.5 * self.radius * self.radius / (length * self.cos);
        Self { rayleigh, ..self }
    }

    /// Distance from the peak at which the light has fallen to 1/e without a gap by design, whatever was measured, metres.
    pub fn design(&self) -> f64 {
        self.design
    }

    /// How oblong the spot is known to be before anything is seen of it.
    pub fn known_oblong(&self) -> Oblong {
        self.known
    }

    /// How wide the spot is where fiber and guide touch, of squared widths at a gap (square metres; metres) and their standard deviations.
    /// `None` where no such spot is so narrow there.
    pub fn at_contact(&self, gap: f64, squared: [f64; 2], deviation: [f64; 2]) -> Option<SpotSize> {
        // `w^2 = S + s^2/S`, of which the larger root is that of a fiber within a Rayleigh length.
        let spreads = 0.5 * self.radius * self.radius * gap / (self.cos * self.rayleigh);
        let root = |w: f64| {
            let rest = w * w - 4.0 * spreads * spreads;
            (rest > 0.0).then(|| (0.5 * (w + rest.sqrt())).sqrt())
        };
        Some(SpotSize {
            radius: [root(squared[0])?, root(squared[1])?],
            deviation: [0, 1].map(|i| 0.5 * deviation[i] / squared[i]),
        })
    }

    /// How many times as wide as designed a spot is.
    pub fn times_design(&self, spot: &SpotSize) -> f64 {
        let [x, y] = spot.radius;
        (x * y).sqrt() / self.design
    }

    /// A spot of which the squares of the widths in x and in y are so many times those that are believed of a round one.
    pub fn widen(&mut self, times: [f64; 2]) -> Oblong {
        let [x, y] = times.map(f64::recip);
        self.radius *= (0.5 * (x + y)).sqrt().recip();
        self.oblong = ((x - y) / (x + y)).clamp(-TUNING.beam.most_oblong, TUNING.beam.most_oblong);
        Oblong::known(self.oblong, TUNING.beam.known)
    }

    /// A spot that is as oblong as was seen.
    pub fn set_oblong(&mut self, oblong: &Oblong) {
        self.oblong = oblong.share();
    }

    /// What readings around a peak tell of how oblong the spot is; `noise` is the standard deviation of a reading, volts.
    pub fn tell(&self, oblong: &mut Oblong, readings: &[Reading], peak: &Peak, noise: f64) {
        for r in readings {
            let off = r.at - peak.at;
            let across = (off.x * off.x - off.y * off.y) / self.width(r.gap).powi(2);
            let row = -peak.full * self.light(r, peak.at) * across / noise;
            let left = self.left(r, peak) / noise;
            oblong.told += row * row;
            oblong.sum += row * (left + row * self.oblong);
        }
    }

    /// What readings around a peak tell of a spot that is oblong along other axes, beside what it is in x and y: by which share the inverse square
    /// of its width is more along the first of them and less along the second, and the variance of that. Each axis is what a
    /// place's x and y make of it. `None` where the axes are x and y, or nearly so.
    pub fn oblong_along(
        &self,
        readings: &[Reading],
        peak: &Peak,
        noise: f64,
        axes: [Displacement; 2],
    ) -> Option<(f64, f64)> {
        let mut normal = Normal::<2>::default();
        for r in readings {
            let off = (r.at - peak.at) / self.width(r.gap);
            let [u, v] = axes.map(|axis| axis.x * off.x + axis.y * off.y);
            let across = Vector2::new(u * u - v * v, off.x * off.x - off.y * off.y);
            let steep = -peak.full * self.light(r, peak.at) / noise;
            normal.add(&(across * steep), self.left(r, peak) / noise);
        }
        let alone = normal.matrix[(0, 0)].recip();
        let [share, _] = normal.solve()?.into();
        let variance = normal.matrix.try_inverse()?[(0, 0)];
        (alone > TUNING.beam.apart * variance).then_some((share, variance))
    }

    /// The gap at which the spot is so many times as wide, squared, as at the chip, and one more, metres: one
    /// for twice the square.
    pub fn gap_of(&self, share: f64) -> f64 {
        2.0 * share.sqrt() * self.cos * self.rayleigh
    }

    /// Share of the light that crosses a gap (metres) at the peak: `4 / (4 + (z/z_R)^2)`, with
    /// `z` along the beam.
    pub fn share(&self, gap: f64) -> f64 {
        let z = gap.max(0.0) / (self.cos * self.rayleigh);
        4.0 / (4.0 + z * z)
    }

    /// Distance from the peak at which the light has fallen to 1/e, metres.
    pub fn width(&self, gap: f64) -> f64 {
        self.radius / self.share(gap).sqrt()
    }

    /// Squares of that distance in x and in y, square metres.
    pub fn squared_widths(&self, gap: f64) -> [f64; 2] {
        let squared = self.width(gap).powi(2);
        [1.0 + self.oblong, 1.0 - self.oblong].map(|steep| squared / steep)
    }

    /// The light that a reading would be, for a peak.
    fn light(&self, r: &Reading, peak: Displacement) -> f64 {
        let share = self.share(r.gap);
        let off = r.at - peak;
        let square = off.x * off.x * (1.0 + self.oblong) + off.y * off.y * (1.0 - self.oblong);
        share * (-square * share / (self.radius * self.radius)).exp()
    }

    /// What a peak leaves of a reading, volts.
    pub fn left(&self, reading: &Reading, peak: &Peak) -> f64 {
        reading.volts - peak.full * self.light(reading, peak.at)
    }

    /// Sum of squares of what a peak leaves of readings, square volts.
    pub fn misfit(&self, readings: &[Reading], peak: &Peak) -> f64 {
        let left = readings.iter().map(|r| self.left(r, peak));
        left.map(|left| left * left).sum()
    }

    /// The peak of known width that fits readings best, by least squares (Levenberg and
    /// Marquardt); `noise` is the standard deviation of a reading, volts. Where the readings leave
    /// it open, the peak is near the brightest of them: within about its width. `None` without
    /// readings, or where none is brighter than the noise.
    pub fn fit(&self, readings: &[Reading], noise: f64) -> Option<Peak> {
        const RULES: Rules = Rules {
            steps: 12,
            ridge: 0.0,
            gain: 1e-3,
            share: 0.0,
        };
        let brightest = readings
            .iter()
            .max_by(|a, b| a.volts.total_cmp(&b.volts))
            .filter(|r| r.volts > 2.0 * noise)?;
        let level = brightest.volts / self.share(brightest.gap);
        let scale = self.width(brightest.gap);
        let through = Through {
            beam: self,
            readings,
            noise,
            start: centroid(readings),
            scale,
            weight: level / noise,
        };
        let found = minimise(&through, Vector3::new(1.0, 0.0, 0.0), &RULES)?;
        let at = found.at;
        let covariance = found.information.try_inverse()?;
        Some(Peak {
            at: through.place(&at),
            full: at[0] * level,
            full_deviation: level * covariance[(0, 0)].sqrt(),
            deviations: [1, 2].map(|i| scale * covariance[(i, i)].sqrt()),
        })
    }
}

/// How steeply light may rise or fall with the gap, of itself, where facet and fiber's end reflect, 1/m: `4 pi n/lambda` times the amplitude
/// `2 R/(1 - R)^2` of an etalon between faces of glass, each of which reflects `R`.
fn ripples(mode: &Mode) -> f64 {
    let (glass, n) = (TUNING.beam.glass, mode.gap_index);
    let reflects = ((glass - n) / (glass + n)).powi(2);
    let amplitude = 2.0 * reflects / (1.0 - reflects).powi(2);
    amplitude * 4.0 * PI * n / mode.wavelength
}

/// A peak through readings. Its state is the peak's light and place in units of their own, so that the
/// numbers are about one.
struct Through<'a> {
    beam: &'a Beam,
    readings: &'a [Reading],
    noise: f64,
    start: Displacement,
    scale: f64,
    /// The unit of light over the noise.
    weight: f64,
}

impl Through<'_> {
    fn place(&self, at: &Vector3<f64>) -> Displacement {
        self.start + Displacement::new(at[1], at[2]) * self.scale
    }
}

impl Problem<3> for Through<'_> {
    type State = Vector3<f64>;

    fn cost(&self, at: &Vector3<f64>) -> f64 {
        if at[0] <= 0.0 {
            return f64::INFINITY;
        }
        let peak = self.place(at);
        let left =
            |r: &Reading| at[0] * self.beam.light(r, peak) * self.weight - r.volts / self.noise;
        let sum: f64 = self.readings.iter().map(|r| left(r).powi(2)).sum();
        sum + TUNING.beam.prior * (at[1] * at[1] + at[2] * at[2])
    }

    fn equations(&self, at: &Vector3<f64>) -> Normal<3> {
        let peak = self.place(at);
        let mut normal = Normal {
            matrix: Matrix3::from_diagonal(&Vector3::new(
                0.0,
                TUNING.beam.prior,
                TUNING.beam.prior,
            )),
            right: Vector3::new(0.0, -TUNING.beam.prior * at[1], -TUNING.beam.prior * at[2]),
        };
        for r in self.readings {
            let (light, off) = (self.beam.light(r, peak), r.at - peak);
            let steep = 2.0 * self.scale / self.beam.width(r.gap).powi(2);
            let row = self.weight
                * Vector3::new(
                    light,
                    at[0] * light * steep * off.x * (1.0 + self.beam.oblong),
                    at[0] * light * steep * off.y * (1.0 - self.beam.oblong),
                );
            normal.add(&row, r.volts / self.noise - at[0] * light * self.weight);
        }
        normal
    }

    fn step(&self, at: &Vector3<f64>, by: &Vector3<f64>) -> Vector3<f64> {
        at + by
    }
}

/// The middle of readings, the bright ones more.
fn centroid(readings: &[Reading]) -> Displacement {
    let (mut sum, mut weighted) = (0.0, Displacement::ZERO);
    for r in readings {
        let weight = r.volts.max(0.0).powi(2);
        sum += weight;
        weighted += r.at * weight;
    }
    weighted / sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_numerics::statistics::outside;

    fn beam() -> Beam {
        let mode = Mode {
            radius: 2.5e-6,
            wavelength: 1.3e-6,
            gap_index: 1.0,
        };
        Beam::new(&mode, 0.0)
    }

    #[test]
    fn on_stages_askew_the_brightest_place_is_beside_the_peak_and_that_is_said() {
        let askew = Askew {
            ways: [5e-3, 0.0],
            deviation: 0.1e-3,
        };
        let beam = beam().on_stages(askew);
        let squared = beam.squared_widths(5e-6);
        let [(sigma, bound), (_, in_y)] = beam.aside(squared);
        // Light of which a ripple of 4 pi/lambda has its steepest place here, as strong as glass makes it.
        let wave = 4.0 * PI / 1.3e-6;
        let light = |x: f64| {
            let ripple = 1.0 + beam.ripples / wave * (wave * 5e-3 * x).sin();
            ripple * (-x * x / squared[0]).exp()
        };
        let brightest = (-200..=200)
            .map(|k| f64::from(k) * 1e-9)
            .max_by(|a, b| light(*a).total_cmp(&light(*b)))
            .expect("places");
        let most = bound / TUNING.beam.rippled;
        assert!((brightest - most).abs() < 1.5e-9, "{brightest} {most}");
        assert!(
            bound > 10e-9 && sigma < 1e-9 && in_y == 0.0,
            "{bound} {sigma}"
        );
    }

    /// A manipulator that is turned about y by so much goes towards -z where it goes in x: light that rises along z is brighter towards -x.
    #[test]
    fn light_that_rises_along_z_is_brightest_beside_its_peak() {
        let askew = Askew {
            ways: [5e-3, 5e-3],
            deviation: 0.0,
        };
        let beam = beam().on_stages(askew);
        let rise = Rise {
            slope: 4e5,
            deviation: 0.0,
        };
        let (aside, known) = beam.aside_by(&rise, [7e-12; 2]);
        let expected = 0.5 * 7e-12 * 4e5 * 5e-3;
        assert!((aside.x + expected).abs() < 1e-15 && (aside.y - expected).abs() < 1e-15);
        assert!((known[0].0 - TUNING.rise.width * expected).abs() < 1e-15);
        // Whatever ripples there may be, no more is believed of it without a measurement.
        assert!(beam.aside([7e-12; 2])[0].1 > expected);
    }

    /// Ripples of any strength up to that of glass, at any place of them, beside a normal error: beyond a tolerance of 1 as often as is
    /// believed of an even error, but where that is nearly half of the tolerance.
    #[test]
    fn ripples_are_beyond_a_tolerance_as_often_as_is_believed() {
        for (most, sigma, least) in [(0.1, 0.254, 1.0), (0.3, 0.229, 1.0), (0.45, 0.196, 0.75)] {
            let steps = 200;
            let each = |k: usize| (k as f64 + 0.5) / steps as f64;
            let pairs = (0..steps).flat_map(|k| (0..steps).map(move |l| (k, l)));
            let outside_at = |(k, l)| {
                let off = most * each(k) * (0.5 * PI * each(l)).sin();
                outside(1.0, off, 0.0, sigma)
            };
            let truly = pairs.map(outside_at).sum::<f64>() / (steps * steps) as f64;
            let believed = outside(1.0, 0.0, TUNING.beam.rippled * most, sigma);
            assert!((0.9e-4..1.1e-4).contains(&truly), "{truly}");
            assert!(believed > least * truly, "{most}: {believed} {truly}");
        }
    }

    /// Readings on a circle around the origin, of a peak elsewhere.
    fn circle(beam: &Beam, radius: f64, gap: f64, peak: Displacement, full: f64) -> Vec<Reading> {
        (0..12)
            .map(|k| {
                let mut reading = Reading {
                    at: Displacement::polar(radius, std::f64::consts::TAU * f64::from(k) / 12.0),
                    gap,
                    volts: 0.0,
                };
                reading.volts = full * beam.light(&reading, peak);
                reading
            })
            .collect()
    }

    #[test]
    fn the_peak_of_readings_without_noise_is_found_where_it_is() {
        let beam = beam();
        for (gap, x, y) in [(5e-6, 0.7e-6, -1.1e-6), (80e-6, -6e-6, 4e-6)] {
            let at = Displacement::new(x, y);
            let radius = 0.55 * beam.width(gap);
            let peak = beam
                .fit(&circle(&beam, radius, gap, at, 3.0), 5e-3)
                .unwrap();
            let miss = (peak.at - at).norm();
            assert!(miss < 5e-9, "{miss}");
            assert!((peak.full - 3.0).abs() < 0.01, "{}", peak.full);
        }
    }

    #[test]
    fn the_deviation_is_that_of_repeated_fits() {
        let beam = beam();
        let mut state = 7_u64;
        let mut noise = || {
            (0..12).fold(-6.0, |sum, _| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                sum + (state >> 33) as f64 / f64::from(1_u32 << 31)
            })
        };
        let (at, sigma) = (Displacement::new(0.5e-6, 0.2e-6), 5e-3);
        let (mut squares, mut prediction, n) = (0.0, 0.0, 400);
        for _ in 0..n {
            let mut readings = circle(&beam, 1.4e-6, 5e-6, at, 2.0);
            for r in &mut readings {
                r.volts += sigma * noise();
            }
            let peak = beam.fit(&readings, sigma).unwrap();
            squares += (peak.at.x - at.x).powi(2);
            prediction += peak.deviation();
        }
        let (measured, prediction) = ((squares / f64::from(n)).sqrt(), prediction / f64::from(n));
        assert!(
            (0.6..1.2).contains(&(measured / prediction)),
            "{measured} {prediction}"
        );
    }

    /// Light falls along y by a twentieth of what it falls by along x: were that believed to be a ninth, the peak would be believed to be known
    /// along y more than twice as well as it is.
    #[test]
    fn a_spot_five_times_as_wide_one_way_as_the_other_is_believed_to_be_so() {
        let (share, mut told) = ((25.0 - 1.0) / (25.0 + 1.0), Oblong::default());
        let (mut truth, mut believed) = (beam(), beam());
        truth.oblong = share;
        let readings = circle(&truth, 1.4e-6, 0.0, Displacement::ZERO, 2.0);
        for _ in 0..20 {
            let peak = believed.fit(&readings, 5e-3).unwrap();
            believed.tell(&mut told, &readings, &peak, 5e-3);
            believed.set_oblong(&told);
        }
        let [narrow, wide] = believed.squared_widths(0.0);
        assert!((wide / narrow / 25.0 - 1.0).abs() < 0.2, "{wide} {narrow}");
        // What is usual is believed until light says otherwise.
        let vague = Oblong {
            told: 10.0,
            sum: 6.0,
        };
        assert!(vague.share() < 0.2, "{}", vague.share());
    }

    /// A spot that piezos at 45 degrees make oblong, for one goes farther; in x and y it is oblong too.
    #[test]
    fn how_oblong_a_spot_is_along_piezos_is_told_beside_how_oblong_it_is_in_x_and_y() {
        let (mut beam, share, half) = (beam(), 0.12, std::f64::consts::FRAC_1_SQRT_2);
        let axes = [
            Displacement::new(half, half),
            Displacement::new(-half, half),
        ];
        beam.oblong = 0.1;
        let mut readings = circle(&beam, 1.4e-6, 0.0, Displacement::ZERO, 2.0);
        beam.oblong = 0.0;
        for r in &mut readings {
            let off = r.at / beam.width(0.0);
            r.volts *= (-share * 2.0 * off.x * off.y).exp();
        }
        let peak = beam.fit(&readings, 5e-3).unwrap();
        let (told, variance) = beam.oblong_along(&readings, &peak, 5e-3, axes).unwrap();
        assert!((told - share).abs() < 0.02, "{told}");
        assert!(variance.sqrt() < 0.01, "{variance}");
        let along = [Displacement::new(1.0, 0.0), Displacement::new(0.0, 1.0)];
        assert_eq!(beam.oblong_along(&readings, &peak, 5e-3, along), None);
    }

    #[test]
    fn a_spot_as_measured_is_as_wide_at_every_gap_as_its_modes_make_it() {
        // Half the sum of the squared radii of a fiber and a guide, in x and in y.
        let s = [3.2e-6_f64, 2.1e-6].map(|guide| 0.5 * (guide * guide + 2.5e-6 * 2.5e-6));
        let gap = 5e-6;
        let squared = s.map(|s| s + (1.3e-6 * gap / std::f64::consts::TAU).powi(2) / s);
        let size = beam()
            .at_contact(gap, squared, squared.map(|w| 0.04 * w))
            .unwrap();
        for (radius, s) in size.radius.into_iter().zip(s) {
            assert!((radius.powi(2) / s - 1.0).abs() < 1e-9);
        }
        assert!(size.deviation.iter().all(|of| (of - 0.02).abs() < 1e-12));
        let measured = beam().as_measured(&size);
        for (found, s) in measured.squared_widths(0.0).into_iter().zip(s) {
            assert!((found / s - 1.0).abs() < 1e-9, "{found} {s}");
        }
        assert_eq!(measured.design(), beam().design());
        // By design light spreads as the recipe's does.
        let design = 1.3e-6 / std::f64::consts::TAU / beam().cos;
        let same = beam().spreading(design);
        assert!((same.share(gap) / beam().share(gap) - 1.0).abs() < 1e-9);
        assert!(beam().spreading(0.8 * design).share(gap) > beam().share(gap));
        // No spot of this light is so narrow at so wide a gap.
        assert_eq!(beam().at_contact(60e-6, squared, squared), None);
    }

    #[test]
    fn fibers_that_differ_by_more_than_they_say_make_the_next_one_less_known() {
        let told = |radius: f64| SpotSize {
            radius: [radius; 2],
            deviation: [0.01; 2],
        };
        assert_eq!(SpotSize::of_all(&[]), None);
        let alike = SpotSize::of_all(&[told(3e-6), told(3e-6)]).unwrap();
        assert!((alike.radius[0] - 3e-6).abs() < 1e-15 && alike.is_known());
        let unlike = SpotSize::of_all(&[told(2.5e-6), told(3.5e-6)]).unwrap();
        assert!(!unlike.is_known(), "{unlike:?}");
    }

    #[test]
    fn dark_has_no_peak() {
        let beam = beam();
        assert_eq!(beam.fit(&[], 5e-3), None);
        assert_eq!(
            beam.fit(&circle(&beam, 1e-6, 5e-6, Displacement::ZERO, 0.0), 5e-3),
            None
        );
    }
}
