//! Experiments on one axis, and the documents that say what came of them.

use crate::job::{Ended, Job, Order, STEP, Work};
use crate::rig::Rig;
use pigtail_control::characterize::{
    FrequencyResponse, Increments, LoadSettling, Margin, OpenLoop, StepResponse, Trace,
    frequency_response, increments, record, sine, step_response,
};
use pigtail_control::station::Station;
use pigtail_hal::quantity::Counts;
use pigtail_hal::{Axis, AxisName, Error, Rule};
use pigtail_numerics::rounded;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

/// Output of an axis for one encoder count, metres: what a probe sees of it.
///
/// # Errors
///
/// When the rig has no probes.
pub fn metres_per_count(rig: &Rig, axis: Axis) -> Result<f64, Error> {
    let drive = rig.spec.drive(axis);
    let radians = drive.count() / drive.gear_ratio;
    match axis {
        Axis::A | Axis::B => {
            let probe = rig.spec.probe.as_ref().ok_or_else(|| no_probe(rig))?;
            Ok(radians * probe.arm)
        }
        Axis::Z => Ok(radians * rig.calibration.geometry.z.lead / std::f64::consts::TAU),
    }
}

/// The error of asking for what only a probe can tell.
pub fn no_probe(rig: &Rig) -> Error {
    Error::new(
        format!("{}/machine.toml", rig.name),
        "probe",
        "the rig has no probes at its outputs; accepted is a rig whose datasheet lists them",
    )
}

/// A step response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepDocument {
    /// The axis.
    pub axis: String,
    /// Size of the step, counts.
    pub step: i64,
    /// From 10 to 90 %, milliseconds.
    pub rise_ms: f64,
    /// Until the encoder stays within one count, milliseconds.
    pub settling_ms: f64,
    /// Whether it did settle while it was watched.
    pub settled: bool,
    /// Overshoot, percent of the step.
    pub overshoot_percent: f64,
    /// What the load did, by the probe at the output; `null` without one.
    pub load: Option<LoadDocument>,
}

/// What a load did in a step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoadDocument {
    /// How far it was to go: the step, without windup, micrometres.
    pub wanted_um: f64,
    /// Where it came to rest, micrometres.
    pub rest_um: f64,
    /// How long it took to stay within each band around where it came to rest.
    pub settling: Vec<LoadRow>,
}

/// One band.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LoadRow {
    /// Half of its width, micrometres.
    pub band_um: f64,
    /// From the step on, milliseconds; `null` where it still moves by as much in the end.
    pub settling_ms: Option<f64>,
}

/// Bands in which a load is to settle, metres.
const BANDS: [f64; 5] = [5e-6, 2e-6, 1e-6, 5e-7, 2e-7];

fn load(rig: &Rig, at: AxisName, size: i64, trace: &Trace) -> Option<LoadDocument> {
    let settling = LoadSettling::of(trace)?;
    let um = |metres: f64| rounded(metres * 1e6, 1e-4);
    let row = |band: f64| LoadRow {
        band_um: um(band),
        settling_ms: settling.within(trace, band).map(|s| rounded(s * 1e3, 1e-3)),
    };
    Some(LoadDocument {
        wanted_um: um(size as f64 * metres_per_count(rig, at.axis).ok()?),
        rest_um: um(settling.rest),
        settling: BANDS.into_iter().map(row).collect(),
    })
}

/// Steps an axis by `size` counts and back.
///
/// # Errors
///
/// A fault.
pub fn step(
    station: &mut Station,
    rig: &Rig,
    at: AxisName,
    size: i64,
) -> Result<(StepDocument, Trace), Ended> {
    const SECONDS: f64 = 0.2;
    let Counts(home) = station.encoder(at);
    let trace = record(station, at, SECONDS, |_| size as f64, |_| true)?;
    station.reference(at, Counts(home));
    station.run(SECONDS)?;
    let StepResponse {
        rise,
        settling,
        overshoot,
        settled,
    } = step_response(&trace, size as f64);
    Ok((
        StepDocument {
            axis: at.to_string(),
            step: size,
            rise_ms: rounded(rise * 1e3, 1e-3),
            settling_ms: rounded(settling * 1e3, 1e-3),
            settled,
            overshoot_percent: rounded(overshoot * 100.0, 1e-3),
            load: load(rig, at, size, &trace),
        },
        trace,
    ))
}

/// The answer to a sine.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SineDocument {
    /// The axis.
    pub axis: String,
    /// Frequency, hertz.
    pub frequency_hz: f64,
    /// Amplitude, counts.
    pub amplitude: f64,
    /// Gain at the motor's encoder.
    pub encoder_gain: f64,
    /// Phase at the motor's encoder, degrees, negative for a lag.
    pub encoder_phase_deg: f64,
    /// Gain at the output; `null` without a probe.
    pub output_gain: Option<f64>,
    /// Phase at the output, degrees; `null` without a probe.
    pub output_phase_deg: Option<f64>,
}

/// Follows a sine.
///
/// # Errors
///
/// A fault.
pub fn follow_sine(
    station: &mut Station,
    rig: &Rig,
    at: AxisName,
    frequency: f64,
    amplitude: f64,
) -> Result<(SineDocument, Trace), Ended> {
    let scale = metres_per_count(rig, at.axis).unwrap_or(1.0);
    let (response, trace) = sine(station, at, amplitude, frequency, 10, scale)?;
    let degrees = |radians: f64| rounded(radians.to_degrees(), 1e-3);
    Ok((
        SineDocument {
            axis: at.to_string(),
            frequency_hz: frequency,
            amplitude,
            encoder_gain: rounded(response.encoder_gain, 1e-4),
            encoder_phase_deg: degrees(response.encoder_phase),
            output_gain: response.output.map(|(gain, _)| rounded(gain, 1e-4)),
            output_phase_deg: response.output.map(|(_, phase)| degrees(phase)),
        },
        trace,
    ))
}

/// One step size of a resolution test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResolutionRow {
    /// The axis.
    pub axis: String,
    /// Steps that count.
    pub steps: u32,
    /// Size of each, counts.
    pub counts_per_step: u32,
    /// Mean increment of the output, micrometres.
    pub mean_um: f64,
    /// Standard deviation of the increments, micrometres.
    pub std_um: f64,
    /// Largest increment, micrometres.
    pub max_um: f64,
    /// Share of the steps in which the output moved by less than half the mean.
    pub stuck_share: f64,
    /// The resolution: the largest increment of consistent steps, micrometres; `null` where the
    /// steps are not consistent.
    pub resolution_um: Option<f64>,
}

/// The resolution test of 2.5: steps of one count, then of one more, until they are consistent.
///
/// # Errors
///
/// A fault; bad input where the rig has no probes.
pub fn resolution(
    station: &mut Station,
    rig: &Rig,
    at: AxisName,
    steps: u32,
) -> Result<Vec<(ResolutionRow, Increments)>, Ended> {
    const MOST: u32 = 10;
    /// Enough to wind up a transmission whatever its state.
    const LEAD: u32 = 150;
    const DWELL: f64 = 0.05;
    if rig.spec.probe.is_none() {
        return Err(no_probe(rig).into());
    }
    let mut rows = Vec::new();
    for counts in 1..=MOST {
        let test = increments(station, at, counts, steps, LEAD, DWELL)?;
        let um = |metres: f64| rounded(metres * 1e6, 1e-6);
        let consistent = test.is_consistent();
        let half = 0.5 * test.mean();
        let stuck = test.increments.iter().filter(|d| **d < half).count();
        rows.push((
            ResolutionRow {
                axis: at.to_string(),
                steps,
                counts_per_step: counts,
                mean_um: um(test.mean()),
                std_um: um(test.deviation()),
                max_um: um(test.largest()),
                stuck_share: rounded(stuck as f64 / f64::from(steps), 1e-4),
                resolution_um: consistent.then(|| um(test.largest())),
            },
            test,
        ));
        if consistent {
            break;
        }
    }
    Ok(rows)
}

/// A frequency response in figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrequencyDocument {
    /// The axis.
    pub axis: String,
    /// Where the gain at the encoder has fallen by 3 dB, hertz.
    pub bandwidth_hz: Option<f64>,
    /// Where the gain at the output has; `null` without a probe.
    pub output_bandwidth_hz: Option<f64>,
    /// Lowest coherence at the encoder below the bandwidth.
    pub lowest_coherence: f64,
    /// Lowest coherence at the output below its bandwidth; `null` without a probe.
    pub output_lowest_coherence: Option<f64>,
    /// The open loop, from what the closed one does.
    pub open_loop: OpenLoopDocument,
    /// The response at the encoder.
    pub encoder: Vec<FrequencyRow>,
    /// The response at the output; empty without a probe.
    pub output: Vec<FrequencyRow>,
}

/// One frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrequencyRow {
    /// Hertz.
    pub hz: f64,
    /// Gain.
    pub gain: f64,
    /// Degrees, negative for a lag.
    pub phase_deg: f64,
    /// Coherence, 0 to 1.
    pub coherence: f64,
}

/// The open loop of an axis's servo, `L = 1 / S - 1` of the sensitivity `S` from reference to error. Numbers with `sigma` before
/// their unit are standard deviations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OpenLoopDocument {
    /// Where its gain falls through one, and the phase above -180 degrees there.
    pub phase_margin: Option<PhaseMargin>,
    /// Where its phase falls through -180 degrees, and by how much the gain may grow there; `null` where the phase does
    /// not come there as far as the loop is known.
    pub gain_margin: Option<GainMargin>,
    /// The greatest sensitivity `|1 / (1 + L)|`.
    pub sensitivity_peak: Option<SensitivityPeak>,
    /// The open loop where it is known.
    pub rows: Vec<OpenLoopRow>,
}

/// A phase margin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PhaseMargin {
    /// Degrees.
    pub deg: f64,
    /// Its standard deviation; `null` where parts of the record have no such margin.
    pub sigma_deg: Option<f64>,
    /// The frequency, hertz.
    pub hz: f64,
    /// Its standard deviation.
    pub sigma_hz: Option<f64>,
}

/// A gain margin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GainMargin {
    /// Decibels.
    pub db: f64,
    /// Its standard deviation; `null` where parts of the record have no such margin.
    pub sigma_db: Option<f64>,
    /// The frequency, hertz.
    pub hz: f64,
    /// Its standard deviation.
    pub sigma_hz: Option<f64>,
}

/// A sensitivity peak.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SensitivityPeak {
    /// A ratio.
    pub ratio: f64,
    /// Its standard deviation.
    pub sigma_ratio: Option<f64>,
    /// The frequency, hertz.
    pub hz: f64,
    /// Its standard deviation.
    pub sigma_hz: Option<f64>,
}

/// The open loop at one frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OpenLoopRow {
    /// Hertz.
    pub hz: f64,
    /// Gain.
    pub gain: f64,
    /// Degrees, negative for a lag.
    pub phase_deg: f64,
    /// Sensitivity.
    pub sensitivity: f64,
    /// Standard deviation of the open loop, as a share of its gain.
    pub unsure: f64,
}

impl OpenLoopDocument {
    fn of(open: &OpenLoop) -> Self {
        let sigma = |sigma: f64, to: f64| sigma.is_finite().then(|| rounded(sigma, to));
        let hz = |m: &Margin| (rounded(m.hertz.value, 1e-2), sigma(m.hertz.sigma, 1e-3));
        Self {
            phase_margin: open.phase_margin.map(|m| PhaseMargin {
                deg: rounded(m.margin.value.to_degrees(), 1e-2),
                sigma_deg: sigma(m.margin.sigma.to_degrees(), 1e-3),
                hz: hz(&m).0,
                sigma_hz: hz(&m).1,
            }),
            gain_margin: open.gain_margin.map(|m| GainMargin {
                db: rounded(20.0 * m.margin.value.log10(), 1e-2),
                // d(20 log10 g) = 20 / ln 10 dg / g.
                sigma_db: sigma(
                    20.0 / std::f64::consts::LN_10 * m.margin.sigma / m.margin.value,
                    1e-3,
                ),
                hz: hz(&m).0,
                sigma_hz: hz(&m).1,
            }),
            sensitivity_peak: open.sensitivity_peak.map(|m| SensitivityPeak {
                ratio: rounded(m.margin.value, 1e-3),
                sigma_ratio: sigma(m.margin.sigma, 1e-4),
                hz: hz(&m).0,
                sigma_hz: hz(&m).1,
            }),
            rows: open
                .points
                .iter()
                .map(|p| OpenLoopRow {
                    hz: rounded(p.hertz, 1e-3),
                    gain: rounded(p.open.norm(), 1e-4),
                    phase_deg: rounded(p.phase.to_degrees(), 1e-2),
                    sensitivity: rounded(p.sensitivity(), 1e-4),
                    unsure: rounded(p.unsure, 1e-4),
                })
                .collect(),
        }
    }
}

/// The frequency response of an axis to a random reference for 40 s: noise of `amplitude` counts
/// rms that falls off above 30 Hz, or the motor would do nothing but saturate.
///
/// # Errors
///
/// A fault.
pub fn frequency(
    station: &mut Station,
    rig: &Rig,
    at: AxisName,
    amplitude: f64,
    seed: u64,
) -> Result<(FrequencyDocument, [FrequencyResponse; 2], Trace), Ended> {
    const SECONDS: f64 = 40.0;
    const HIGHEST: f64 = 300.0;
    const CORNER: f64 = 30.0;
    const WINDOW: usize = 4096;
    let period = rig.spec.period();
    let reference = noise(amplitude, CORNER, period, SECONDS, seed);
    let trace = record(
        station,
        at,
        SECONDS,
        |t| reference[((t / period).round() as usize).min(reference.len() - 1)],
        |_| true,
    )?;
    let at_encoder = frequency_response(&trace.reference, &trace.encoder, period, WINDOW, HIGHEST);
    let at_output = if trace.output.is_empty() {
        FrequencyResponse::default()
    } else {
        let scale = metres_per_count(rig, at.axis)?;
        let counts: Vec<f64> = trace.output.iter().map(|metres| metres / scale).collect();
        frequency_response(&trace.reference, &counts, period, WINDOW, HIGHEST)
    };
    let rows = |r: &FrequencyResponse| -> Vec<FrequencyRow> {
        (0..r.frequency.len())
            .map(|k| FrequencyRow {
                hz: rounded(r.frequency[k], 1e-3),
                gain: rounded(r.gain[k], 1e-4),
                phase_deg: rounded(r.phase[k].to_degrees(), 1e-2),
                coherence: rounded(r.coherence[k], 1e-4),
            })
            .collect()
    };
    let down = std::f64::consts::FRAC_1_SQRT_2;
    let bandwidth = at_encoder.bandwidth(down);
    let output_bandwidth = at_output.bandwidth(down);
    let lowest = |response: &FrequencyResponse, bandwidth: Option<f64>| {
        let lowest = response.lowest_coherence(bandwidth.unwrap_or(HIGHEST));
        rounded(lowest, 1e-4)
    };
    // The phase comes through -180 degrees, if at all, far beyond the bandwidth.
    let highest = 0.4 / period;
    let open = OpenLoop::of(&trace.reference, &trace.encoder, period, WINDOW, highest);
    Ok((
        FrequencyDocument {
            axis: at.to_string(),
            bandwidth_hz: bandwidth.map(|f| rounded(f, 1e-2)),
            output_bandwidth_hz: output_bandwidth.map(|f| rounded(f, 1e-2)),
            lowest_coherence: lowest(&at_encoder, bandwidth),
            output_lowest_coherence: (!at_output.frequency.is_empty())
                .then(|| lowest(&at_output, output_bandwidth)),
            open_loop: OpenLoopDocument::of(&open),
            encoder: rows(&at_encoder),
            output: rows(&at_output),
        },
        [at_encoder, at_output],
        trace,
    ))
}

/// Random numbers through two first-order low passes at `corner` hertz, scaled to an rms.
fn noise(rms: f64, corner: f64, period: f64, seconds: f64, seed: u64) -> Vec<f64> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let decay = (-std::f64::consts::TAU * corner * period).exp();
    let (mut a, mut b) = (0.0, 0.0);
    let series: Vec<f64> = (0..(seconds / period).round() as usize)
        .map(|_| {
            let white = 2.0 * rng.random::<f64>() - 1.0;
            a = decay * a + (1.0 - decay) * white;
            b = decay * b + (1.0 - decay) * a;
            b
        })
        .collect();
    let power = series.iter().map(|v| v * v).sum::<f64>() / series.len() as f64;
    let scale = rms / power.sqrt();
    series.into_iter().map(|v| scale * v).collect()
}

/// A step response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Step {
    /// The axis.
    pub at: AxisName,
    /// Size of the step, counts.
    pub size: i64,
}

impl Job for Step {
    type Output = (StepDocument, Trace);

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let rig = work.rig();
        step(&mut work.station()?, rig, self.at, self.size)
    }

    fn order(&self) -> Order {
        Order::Step(*self)
    }

    fn breaks(&self) -> &'static [Rule] {
        STEP
    }
}

/// The answer to a sine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sine {
    /// The axis.
    pub at: AxisName,
    /// Frequency, hertz.
    pub frequency: f64,
    /// Amplitude, counts.
    pub amplitude: f64,
}

impl Job for Sine {
    type Output = (SineDocument, Trace);

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let rig = work.rig();
        let mut station = work.station()?;
        follow_sine(&mut station, rig, self.at, self.frequency, self.amplitude)
    }

    fn order(&self) -> Order {
        Order::Sine(*self)
    }
}

/// The resolution test of 2.5.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resolution {
    /// The axis.
    pub at: AxisName,
    /// Steps that count.
    pub steps: u32,
}

impl Job for Resolution {
    type Output = Vec<(ResolutionRow, Increments)>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let rig = work.rig();
        resolution(&mut work.station()?, rig, self.at, self.steps)
    }

    fn order(&self) -> Order {
        Order::Resolution(*self)
    }
}

/// A frequency response.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frequency {
    /// The axis.
    pub at: AxisName,
    /// Amplitude of the reference, counts rms.
    pub amplitude: f64,
    /// What the reference is drawn by.
    pub seed: u64,
}

impl Job for Frequency {
    type Output = (FrequencyDocument, [FrequencyResponse; 2], Trace);

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let rig = work.rig();
        let mut station = work.station()?;
        frequency(&mut station, rig, self.at, self.amplitude, self.seed)
    }

    fn order(&self) -> Order {
        Order::Frequency(*self)
    }

    /// Shaken, an axis leaves its output behind.
    fn breaks(&self) -> &'static [Rule] {
        &[Rule::OutputFollowing]
    }
}
