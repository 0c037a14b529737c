//! How fine the networks of the thesis's model must be: the power spectrum of a displacement, and
//! the distance of functions that follows from it (4.2.2, Fig. 4.6).

use super::rbf::UNITS;
use super::{Range, Record};
use pigtail_numerics::fourier::{Complex64, Forward};

/// What may be left out, root mean square, as a share of the range: half of the hundredth to which
/// networks are to approximate.
const LEFT_OUT: f64 = 0.005;

/// Displacements that a spectrum is made of.
const POINTS: usize = 512;

/// Most and fewest functions along the range: the more, the longer a step of the inverse takes;
/// with fewer nothing is a curve.
const ALONG: [f64; 2] = [5.0, 20.0];

/// The power of a displacement by frequency along the voltage.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Frequency, periods a unit of voltage, and power, units squared. Without the mean.
    pub power: Vec<(f64, f64)>,
}

impl Spectrum {
    /// Of the way forward from the bottom of the range that turns nearest to its middle, and the
    /// way back; `None` where a record has no such way.
    pub fn of(record: &Record, input: &Range, output: &Range) -> Option<Self> {
        let volts = |k: usize| input.to_units(record.input[k], UNITS);
        let swings: Vec<_> = record.swings().collect();
        let (start, turn, end) = swings
            .windows(2)
            .filter(|pair| pair[0].rising && volts(pair[0].start) < 0.05 * UNITS)
            .map(|pair| (pair[0].start, pair[1].start, pair[1].end))
            .filter(|(_, _, end)| volts(end - 1) < 0.05 * UNITS)
            .min_by(|a, b| {
                let off = |turn: usize| (volts(turn) - 0.5 * UNITS).abs();
                off(a.1).total_cmp(&off(b.1))
            })?;
        let mut values: Vec<Complex64> = (0..POINTS)
            .map(|k| start + k * (end - start) / POINTS)
            .map(|k| Complex64::new(output.to_units(record.output[k], UNITS), 0.0))
            .collect();
        Forward::new(POINTS).process(&mut values);
        let way = 2.0 * (volts(turn) - volts(start));
        let power = (1..POINTS / 2)
            .map(|k| {
                // As much again lies at the negative frequency.
                let power = 2.0 * (values[k].norm() / POINTS as f64).powi(2);
                (k as f64 / way, power)
            })
            .collect();
        Some(Self { power })
    }

    /// The highest frequency that matters, periods a unit: what lies beyond may be left out. Noise
    /// is not what is left out; it is as strong at every frequency, and at the highest nothing else
    /// is.
    pub fn highest(&self) -> f64 {
        let upper = &self.power[self.power.len() / 2..];
        let noise = upper.iter().map(|p| p.1).sum::<f64>() / upper.len().max(1) as f64;
        let mut beyond = 0.0;
        self.power
            .iter()
            .rev()
            .find(|(_, power)| {
                beyond += power - noise;
                beyond > (LEFT_OUT * UNITS).powi(2)
            })
            .map_or(0.0, |(frequency, _)| *frequency)
    }

    /// Distance of neighbouring functions, units: half the period of the highest frequency that
    /// matters (Shannon), or little less, so that the range is a whole number of them.
    pub fn spacing(&self) -> f64 {
        let along = (2.0 * self.highest() * UNITS).round();
        UNITS / along.clamp(ALONG[0], ALONG[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forward from the bottom to `turns` and back, displacement by `shape` of the voltage.
    fn record(turns: &[f64], shape: impl Fn(f64) -> f64) -> Record {
        let mut input = vec![];
        for turn in turns {
            let up = (0..500).map(|k| turn * f64::from(k) / 500.0);
            let down = (0..500).map(|k| turn * (1.0 - f64::from(k) / 500.0));
            input.extend(up.chain(down));
        }
        input.push(0.0);
        let output = input.iter().map(|v| shape(*v)).collect();
        let time = (0..input.len()).map(|k| k as f64).collect();
        Record::new(time, input, output).unwrap()
    }

    fn spectrum(record: &Record) -> Spectrum {
        Spectrum::of(record, &record.input_range(), &record.output_range()).unwrap()
    }

    #[test]
    fn a_straight_way_to_the_middle_has_odd_harmonics() {
        let spectrum = spectrum(&record(&[10.0, 5.0, 2.0], |v| 1e-6 * v));
        let total: f64 = spectrum.power.iter().map(|p| p.1).sum();
        // A triangle of 5 units: power a twelfth of its square, first harmonic at a tenth a unit.
        assert!((total / (25.0 / 12.0) - 1.0).abs() < 1e-3, "{total}");
        let (first, power) = spectrum.power[0];
        assert!((first - 0.1).abs() < 1e-12);
        let amplitude = 8.0 / std::f64::consts::PI.powi(2) * 2.5;
        assert!((power / (0.5 * amplitude * amplitude) - 1.0).abs() < 1e-3);
        assert!(spectrum.power[1].1 < 1e-6 * power);
        // Beyond the fifth 0.4 % of the range are left, beyond the third 0.7 %.
        assert!((spectrum.highest() - 0.5).abs() < 1e-12);
        assert!((spectrum.spacing() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn noise_wants_no_functions() {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        let clean = record(&[10.0, 5.0], |v| 1e-6 * v);
        let noisy = clean
            .output
            .iter()
            .map(|x| x + 0.4e-6 * uniform())
            .collect();
        let noisy = Record::new(clean.time.clone(), clean.input.clone(), noisy).unwrap();
        // More than a percent of the range in all.
        assert!((spectrum(&noisy).highest() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn what_bends_more_wants_functions_closer_together() {
        let waves = |v: f64| 1e-6 * (v + 0.3 * (std::f64::consts::TAU * 0.8 * v).cos());
        let spectrum = spectrum(&record(&[10.0, 5.0], waves));
        assert!(
            (spectrum.highest() - 0.8).abs() < 1e-12,
            "{}",
            spectrum.highest()
        );
        assert!((spectrum.spacing() - 0.625).abs() < 1e-12);
    }
}
