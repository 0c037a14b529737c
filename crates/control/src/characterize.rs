//! Experiments on one axis (thesis 2.3.2, 2.5): step, sine, frequency response, resolution.

mod open_loop;
mod spectra;

use crate::outcome::{Halt, Lack, Outcome};
use crate::station::Station;
pub use open_loop::{Figure, LoopPoint, Margin, OpenLoop};
use pigtail_hal::quantity::Counts;
use pigtail_hal::{AxisName, Fault};
use spectra::Spectra;
use std::f64::consts::TAU;

/// What an axis did in each servo cycle of an experiment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Time between cycles, seconds.
    pub period: f64,
    /// The reference, counts from where the experiment began.
    pub reference: Vec<f64>,
    /// The encoder, counts from where the experiment began.
    pub encoder: Vec<f64>,
    /// The probe at the output, metres from where the experiment began; empty without one.
    pub output: Vec<f64>,
    /// The voltage, volts.
    pub voltage: Vec<f64>,
}

/// Moves one axis's reference along `reference` (counts from where it stands, a function of
/// seconds) for `seconds` and notes what comes of it. Stops early where `keep_on` says so.
///
/// # Errors
///
/// The machine's fault.
pub fn record(
    station: &mut Station,
    at: AxisName,
    seconds: f64,
    reference: impl Fn(f64) -> f64,
    keep_on: impl Fn(&Trace) -> bool,
) -> Result<Trace, Fault> {
    let start = station.encoder(at).0;
    let origin = station.probe(at);
    let period = station.spec().period();
    let cycles = (seconds / period).round() as usize;
    let mut trace = Trace {
        period,
        ..Trace::default()
    };
    for series in [
        &mut trace.reference,
        &mut trace.encoder,
        &mut trace.output,
        &mut trace.voltage,
    ] {
        series.reserve(cycles);
    }
    for k in 0..cycles {
        let wanted = (reference(k as f64 * period) + 0.5).floor();
        station.reference(at, Counts(start + wanted as i64));
        station.cycle()?;
        trace.reference.push(wanted);
        trace.encoder.push((station.encoder(at).0 - start) as f64);
        trace.voltage.push(station.voltage(at));
        if let (Some(origin), Some(now)) = (origin, station.probe(at)) {
            trace.output.push(now - origin);
        }
        if !keep_on(&trace) {
            break;
        }
    }
    Ok(trace)
}

/// A step response in the usual figures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepResponse {
    /// From 10 to 90 % of the step, seconds.
    pub rise: f64,
    /// Until the encoder stays within one count of the step, seconds.
    pub settling: f64,
    /// Highest position beyond the step, relative to it.
    pub overshoot: f64,
    /// Whether it did settle while it was watched.
    pub settled: bool,
}

/// The figures of a step of `size` counts.
pub fn step_response(trace: &Trace, size: f64) -> StepResponse {
    let share: Vec<f64> = trace.encoder.iter().map(|count| count / size).collect();
    let crossing = |level: f64| {
        let i = share.iter().position(|s| *s >= level)?;
        // Between the cycles before and after.
        let before = if i == 0 { 0.0 } else { share[i - 1] };
        let part = (level - before) / (share[i] - before);
        Some((i as f64 + part) * trace.period)
    };
    let rise = match (crossing(0.1), crossing(0.9)) {
        (Some(low), Some(high)) => high - low,
        _ => f64::INFINITY,
    };
    let last_out = trace
        .encoder
        .iter()
        .rposition(|count| (count - size).abs() > 1.0);
    let settled = last_out.is_none_or(|i| i + 1 < trace.encoder.len());
    StepResponse {
        rise,
        settling: last_out.map_or(0.0, |i| (i + 1) as f64 * trace.period),
        overshoot: share.iter().fold(0.0, |high: f64, s| high.max(s - 1.0)),
        settled,
    }
}

/// Where a load comes to rest, and when it stays near there.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadSettling {
    /// Where it rests: the mean of the last quarter of the record, metres.
    pub rest: f64,
    /// How far it still moves there, to and fro, metres: what is no larger than that is no settling.
    pub moves: f64,
}

impl LoadSettling {
    /// Of a record of the load; `None` without a probe.
    pub fn of(trace: &Trace) -> Option<Self> {
        let last = &trace.output[trace.output.len() - trace.output.len() / 4..];
        let rest = last.iter().sum::<f64>() / last.len() as f64;
        let moves = last
            .iter()
            .fold(0.0, |most: f64, m| most.max((m - rest).abs()));
        rest.is_finite().then_some(Self { rest, moves })
    }

    /// From when on the load stays within `band` metres of where it rests, seconds; `None` where it still moves by as much at
    /// the record's end.
    pub fn within(&self, trace: &Trace, band: f64) -> Option<f64> {
        if self.moves > band {
            return None;
        }
        let outside = |metres: &f64| (metres - self.rest).abs() > band;
        let last_out = trace.output.iter().rposition(outside);
        Some(last_out.map_or(0.0, |i| (i + 1) as f64 * trace.period))
    }
}

/// Gain and phase of a series against `sin(2 pi f t)` of an amplitude, by correlation over whole
/// periods. Phase in radians, negative for a lag.
pub fn gain_and_phase(series: &[f64], period: f64, frequency: f64, amplitude: f64) -> (f64, f64) {
    let whole = (series.len() as f64 * period * frequency).floor();
    let n = (whole / (frequency * period)).round() as usize;
    let (mut in_phase, mut quadrature) = (0.0, 0.0);
    // A value is measured at the end of its cycle.
    for (k, value) in series.iter().take(n).enumerate() {
        let phase = TAU * frequency * (k as f64 + 1.0) * period;
        in_phase += value * phase.sin();
        quadrature += value * phase.cos();
    }
    let scale = 2.0 / n as f64;
    (
        scale * in_phase.hypot(quadrature) / amplitude,
        quadrature.atan2(in_phase),
    )
}

/// The answer of an axis to a sinusoidal reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SineResponse {
    /// Gain at the encoder.
    pub encoder_gain: f64,
    /// Phase at the encoder, radians, negative for a lag.
    pub encoder_phase: f64,
    /// Gain and phase at the output, relative to the reference; `None` without a probe.
    pub output: Option<(f64, f64)>,
}

/// A sine of `amplitude` counts at `frequency` hertz: some periods to get going, then `periods`
/// that count. `metres_per_count` scales the probe.
///
/// # Errors
///
/// The machine's fault.
pub fn sine(
    station: &mut Station,
    at: AxisName,
    amplitude: f64,
    frequency: f64,
    periods: u32,
    metres_per_count: f64,
) -> Result<(SineResponse, Trace), Fault> {
    const LEAD: u32 = 2;
    let seconds = f64::from(LEAD + periods) / frequency;
    let mut trace = record(
        station,
        at,
        seconds,
        |t| amplitude * (TAU * frequency * t).sin(),
        |_| true,
    )?;
    let lead = (f64::from(LEAD) / (frequency * trace.period)).round() as usize;
    for series in [
        &mut trace.reference,
        &mut trace.encoder,
        &mut trace.output,
        &mut trace.voltage,
    ] {
        series.drain(..lead.min(series.len()));
    }
    let (encoder_gain, encoder_phase) =
        gain_and_phase(&trace.encoder, trace.period, frequency, amplitude);
    let output = (!trace.output.is_empty()).then(|| {
        gain_and_phase(
            &trace.output,
            trace.period,
            frequency,
            amplitude * metres_per_count,
        )
    });
    Ok((
        SineResponse {
            encoder_gain,
            encoder_phase,
            output,
        },
        trace,
    ))
}

/// A frequency response, estimated from a record by Welch's method.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrequencyResponse {
    /// Frequencies, hertz.
    pub frequency: Vec<f64>,
    /// Gain of the output over the input.
    pub gain: Vec<f64>,
    /// Phase, radians, negative for a lag, unwrapped from the lowest frequency on.
    pub phase: Vec<f64>,
    /// Coherence, 0 to 1: the share of the output that a linear answer to the input explains.
    pub coherence: Vec<f64>,
}

/// The response from `input` to `output` up to `highest` hertz: cross spectrum over input
/// spectrum, Hann windows of `window` samples that overlap by half. An output that belongs to the
/// end of its cycle is taken as such.
pub fn frequency_response(
    input: &[f64],
    output: &[f64],
    period: f64,
    window: usize,
    highest: f64,
) -> FrequencyResponse {
    let spectra = Spectra::of(input, output, period, window, highest);
    let mut response = FrequencyResponse::default();
    let mut turns = 0.0;
    for (k, (xx, yy, xy)) in spectra.sums(None).into_iter().enumerate().skip(1) {
        let frequency = spectra.hertz(k);
        let mut phase = xy.arg() - spectra.turn(k) + turns;
        if let Some(last) = response.phase.last() {
            let jump = ((phase - last) / TAU).round() * TAU;
            phase -= jump;
            turns -= jump;
        }
        response.frequency.push(frequency);
        response.gain.push(xy.norm() / xx.max(f64::MIN_POSITIVE));
        response.phase.push(phase);
        response
            .coherence
            .push(xy.norm_sqr() / (xx * yy).max(f64::MIN_POSITIVE));
    }
    response
}

impl FrequencyResponse {
    /// The lowest frequency at which the gain has fallen to `gain`, hertz.
    pub fn bandwidth(&self, gain: f64) -> Option<f64> {
        let k = self.gain.iter().position(|g| *g < gain)?;
        Some(self.frequency[k])
    }

    /// The lowest coherence below `hertz`.
    pub fn lowest_coherence(&self, hertz: f64) -> f64 {
        let below = self.frequency.iter().zip(&self.coherence);
        below
            .filter(|(f, _)| **f < hertz)
            .fold(1.0, |low: f64, (_, c)| low.min(*c))
    }
}

/// The increments of a resolution test at one step size (thesis 2.5).
#[derive(Debug, Clone, PartialEq)]
pub struct Increments {
    /// Step size, counts.
    pub counts: u32,
    /// Displacement of the output in each step, metres.
    pub increments: Vec<f64>,
}

impl Increments {
    /// Mean, metres.
    pub fn mean(&self) -> f64 {
        self.increments.iter().sum::<f64>() / self.increments.len() as f64
    }

    /// Standard deviation, metres.
    pub fn deviation(&self) -> f64 {
        let mean = self.mean();
        let squares: f64 = self.increments.iter().map(|d| (d - mean).powi(2)).sum();
        (squares / (self.increments.len() as f64 - 1.0)).sqrt()
    }

    /// Largest increment, metres.
    pub fn largest(&self) -> f64 {
        self.increments
            .iter()
            .fold(0.0, |high: f64, d| high.max(*d))
    }

    /// Whether the axis moves consistently: all but 1 % of the steps move the output forward by
    /// more than half of the mean. An axis that moves every second time does not.
    pub fn is_consistent(&self) -> bool {
        let half = 0.5 * self.mean();
        let stuck = self.increments.iter().filter(|d| **d < half).count();
        (stuck as f64) < 0.01 * self.increments.len() as f64
    }
}

/// Steps in one direction, as many as `steps`, of `counts` each, `dwell` seconds apart. The first
/// ones, over which the transmission winds up, do not count: `lead` of them.
///
/// # Errors
///
/// A fault; [`Outcome::Lacking`] on a rig without probes.
pub fn increments(
    station: &mut Station,
    at: AxisName,
    counts: u32,
    steps: u32,
    lead: u32,
    dwell: f64,
) -> Result<Increments, Halt> {
    const AVERAGED: u32 = 16;
    let start = station.encoder(at).0;
    let mut increments = Vec::with_capacity(steps as usize);
    let mut before = None;
    for k in 1..=lead + steps {
        station.reference(at, Counts(start + i64::from(k) * i64::from(counts)));
        station.run(dwell)?;
        let mut sum = 0.0;
        for _ in 0..AVERAGED {
            station.cycle()?;
            sum += station.probe(at).ok_or(Outcome::Lacking(Lack::Probe(at)))?;
        }
        let now = sum / f64::from(AVERAGED);
        if let Some(before) = before.replace(now)
            && k > lead
        {
            increments.push(now - before);
        }
    }
    Ok(Increments { counts, increments })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_numerics::fourier::Complex64;

    #[test]
    fn a_load_settles_within_each_band_later_than_within_a_wider_one() {
        let (period, tau) = (1e-4, 5e-3);
        let output = (1..2000)
            .map(|k| 1e-5 * (1.0 - (-f64::from(k) * period / tau).exp()))
            .collect();
        let trace = Trace {
            period,
            output,
            ..Trace::default()
        };
        let load = LoadSettling::of(&trace).unwrap();
        assert!((load.rest - 1e-5).abs() < 1e-12);
        for band in [1e-6, 1e-7, 1e-8] {
            let settled = load.within(&trace, band).unwrap();
            let exact = tau * (1e-5 / band).ln();
            assert!((settled - exact).abs() < 2e-4, "{band}: {settled}");
        }
        assert_eq!(load.within(&trace, 0.0), None);
        assert_eq!(LoadSettling::of(&Trace::default()), None);
    }

    #[test]
    fn the_figures_of_a_first_order_step() {
        let (period, tau) = (1e-4, 5e-3);
        let encoder = (1..2000)
            .map(|k| 1000.0 * (1.0 - (-f64::from(k) * period / tau).exp()))
            .collect();
        let trace = Trace {
            period,
            encoder,
            ..Trace::default()
        };
        let r = step_response(&trace, 1000.0);
        assert!((r.rise - tau * 9.0_f64.ln()).abs() < 1e-5, "{}", r.rise);
        assert!(
            (r.settling - tau * 1000.0_f64.ln()).abs() < 2e-4,
            "{}",
            r.settling
        );
        assert_eq!(r.overshoot, 0.0);
        assert!(r.settled);
    }

    #[test]
    fn gain_and_phase_of_a_sine_are_found() {
        let (period, f) = (4e-4, 10.0);
        let series: Vec<f64> = (1..=2500)
            .map(|k| 3.0 * (TAU * f * f64::from(k) * period - 0.2).sin() + 7.0)
            .collect();
        let (gain, phase) = gain_and_phase(&series, period, f, 2.0);
        assert!(
            (gain - 1.5).abs() < 1e-9 && (phase + 0.2).abs() < 1e-9,
            "{gain} {phase}"
        );
    }

    #[test]
    fn the_frequency_response_of_a_delayed_low_pass_is_found() {
        let (period, decay) = (4e-4, 0.9);
        let mut state = 1_u64;
        let (mut y, mut input, mut output) = (0.0, Vec::new(), Vec::new());
        for _ in 0..100_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let x = (state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0;
            y = decay * y + (1.0 - decay) * x;
            input.push(x);
            // Measured at the end of the cycle in which the input acted.
            output.push(y);
        }
        let r = frequency_response(&input, &output, period, 4096, 200.0);
        for (k, f) in r.frequency.iter().enumerate().step_by(20) {
            let z = Complex64::from_polar(1.0, -TAU * f * period);
            let exact = (1.0 - decay) / (Complex64::new(1.0, 0.0) - decay * z) * z;
            assert!(
                (r.gain[k] / exact.norm() - 1.0).abs() < 0.03,
                "{f} Hz: {}",
                r.gain[k]
            );
            assert!((r.phase[k] - exact.arg()).abs() < 0.03, "{f} Hz");
            assert!(r.coherence[k] > 0.99);
        }
    }

    #[test]
    fn steps_that_move_every_second_time_are_not_consistent() {
        let of = |increments: Vec<f64>| Increments {
            counts: 1,
            increments,
        };
        assert!(!of((0..100).map(|k| f64::from(k % 2)).collect()).is_consistent());
        assert!(of((0..100).map(|k| 1.0 + 0.1 * f64::from(k % 2)).collect()).is_consistent());
    }
}
