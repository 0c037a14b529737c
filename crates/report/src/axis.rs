//! Reports of experiments on one axis.

use super::figure::{Axes, HALF, WHOLE, all, bars, curves, decades_of, range_of};
use super::html::{figure, fixed, page};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::characterize::{FrequencyResponse, Increments, Trace};
use pigtail_session::characterize::{
    FrequencyDocument, FrequencyRow, ResolutionRow, SineDocument, StepDocument,
};

fn over_time(trace: &Trace, series: &[f64], until: f64) -> Vec<(f64, f64)> {
    series
        .iter()
        .enumerate()
        .map(|(k, value)| ((k + 1) as f64 * trace.period * 1e3, *value))
        .take_while(|(t, _)| *t <= until * 1e3)
        .collect()
}

/// The report of a step.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn step(d: &StepDocument, trace: &Trace) -> Result<String> {
    const UNTIL: f64 = 0.08;
    let title = format!("Step of {} counts, {}", d.step, d.axis);
    let text = format!(
        "Rise {:.1} ms (10 to 90 %), settling {:.1} ms (until the encoder stays within one count), \
         overshoot {:.1} %.",
        d.rise_ms, d.settling_ms, d.overshoot_percent
    );
    let named = |name: &'static str, values: &[f64], factor: f64| {
        let scaled: Vec<f64> = values.iter().map(|v| factor * v).collect();
        (name, over_time(trace, &scaled, UNTIL))
    };
    let plot = |y: &str, series: &[(&str, Vec<(f64, f64)>)], origin: Option<f64>| {
        let values = series
            .iter()
            .flat_map(|(_, points)| points.iter().map(|p| p.1));
        let axes = Axes {
            width: WHOLE,
            x: (0.0..UNTIL * 1e3, "time, ms"),
            y: (range_of(values.chain(origin), 1.0), y),
        };
        all(Plot::new(&axes), series)
    };
    let mut moved = vec![
        named("encoder", &trace.encoder, 1.0),
        named("reference", &trace.reference, 1.0),
    ];
    let origin = (0.0, 0.0);
    moved[0].1.insert(0, origin);
    let mut encoder = plot("position, counts", &moved, Some(0.0));
    if d.settled {
        encoder = encoder.mark_x("settled", d.settling_ms, "soft");
    }
    let error: Vec<f64> = trace
        .encoder
        .iter()
        .zip(&trace.reference)
        .map(|(is, wanted)| is - wanted)
        .collect();
    let axes = Axes {
        width: WHOLE,
        x: (0.0..UNTIL * 1e3, "time, ms"),
        y: (-10.0..10.0, "encoder less reference, counts"),
    };
    let close = Plot::new(&axes)
        .mark_y("one count", 1.0, "limit")
        .mark_y("", -1.0, "limit")
        .line("error", &over_time(trace, &error, UNTIL));
    let voltage = plot("voltage, V", &[named("voltage", &trace.voltage, 1.0)], None);
    let body = html! {
        p { (text) }
        (figure(&encoder.draw(), "The motor's encoder and where it was wanted."))
        (figure(
            &close.draw(),
            "The last ten counts of the way, with the band in which it counts as settled."
        ))
        @if !trace.output.is_empty() {
            (figure(
                &plot("load, um", &[named("load", &trace.output, 1e6)], Some(0.0)).draw(),
                "The load, by the probe at the output: what it lacks is the windup of the transmission."
            ))
        }
        (figure(&voltage.draw(), "The motor's voltage."))
    };
    Ok(page(&title, &body))
}

/// The report of a sine; `scale` is metres a count at the output, where there is a probe.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn sine(d: &SineDocument, trace: &Trace, scale: Option<f64>) -> Result<String> {
    let title = format!("Sine of {} Hz, {}", d.frequency_hz, d.axis);
    let until = 2.0 / d.frequency_hz;
    let mut series = vec![
        ("reference", over_time(trace, &trace.reference, until)),
        ("encoder", over_time(trace, &trace.encoder, until)),
    ];
    if let Some(scale) = scale.filter(|_| !trace.output.is_empty()) {
        let counts: Vec<f64> = trace.output.iter().map(|metres| metres / scale).collect();
        series.push(("output", over_time(trace, &counts, until)));
    }
    let values = series
        .iter()
        .flat_map(|(_, points)| points.iter().map(|p| p.1));
    let axes = Axes {
        width: WHOLE,
        x: (0.0..until * 1e3, "time, ms"),
        y: (range_of(values, 1.0), "position, counts"),
    };
    let body = html! {
        p {
            "Gain " (fixed(d.encoder_gain, 4)) " and phase " (fixed(d.encoder_phase_deg, 2))
            " degrees at the encoder"
            @if let (Some(gain), Some(phase)) = (d.output_gain, d.output_phase_deg) {
                ", " (fixed(gain, 4)) " and " (fixed(phase, 2)) " degrees at the output"
            }
            "."
        }
        (figure(
            &curves(&axes, &series),
            html! {
                "Two periods."
                @if series.len() > 2 {
                    " What the output lacks after each reversal is the windup of the transmission."
                }
            }
        ))
    };
    Ok(page(&title, &body))
}

/// The report of a resolution test.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn resolution(rows: &[(ResolutionRow, Increments)]) -> Result<String> {
    let axis = rows.first().map_or("", |(row, _)| row.axis.as_str());
    let body = html! {
        p {
            "Steps in one direction and how far the output moved in each. Consistent: at most 1 % of the \
             steps move it by less than half the mean."
        }
        @for (row, test) in rows {
            (steps(row, test))
        }
    };
    Ok(page(&format!("Resolution of {axis}"), &body))
}

/// Steps of one size.
fn steps(row: &ResolutionRow, test: &Increments) -> Markup {
    let um: Vec<f64> = test.increments.iter().map(|metres| metres * 1e6).collect();
    let range = range_of(um.iter().copied().chain([0.0]), 0.01);
    let mut position = 0.0;
    let mut stairs = Vec::new();
    for (k, d) in um.iter().take(30).enumerate() {
        stairs.push((k as f64, position));
        position += d;
        stairs.push((k as f64, position));
    }
    let axes = Axes {
        width: HALF,
        x: (0.0..30.0, "step"),
        y: (range_of(stairs.iter().map(|p| p.1), 0.01), "output, um"),
    };
    let plural = if row.counts_per_step == 1 { "" } else { "s" };
    let text = format!(
        "Mean {:.4} um, standard deviation {:.4} um, largest {:.4} um; {:.1} % of the steps stuck.",
        row.mean_um,
        row.std_um,
        row.max_um,
        100.0 * row.stuck_share
    );
    html! {
        h2 { (row.counts_per_step) " count" (plural) " a step" }
        p {
            (text)
            @if let Some(resolution) = row.resolution_um {
                " Consistent: the resolution is " (fixed(resolution, 3)) " um."
            }
        }
        div.pair {
            (figure(
                &bars(HALF, &um, &range, 60, "increment, um", "steps"),
                "How many steps moved the output how far."
            ))
            (figure(
                &super::figure::over_count(&axes, &[("output", stairs)]),
                "The output over the first thirty of them."
            ))
        }
    }
}

/// A number of a frequency response at one of its frequencies.
type Value = fn(&FrequencyResponse, usize) -> f64;

/// The report of a frequency response.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn frequency(d: &FrequencyDocument, responses: &[FrequencyResponse; 2]) -> Result<String> {
    let title = format!("Frequency response of {}", d.axis);
    let hertz = |f: Option<f64>| f.map_or_else(|| "-".to_owned(), |f| format!("{f:.1} Hz"));
    // Where each of them is followed: below its own bandwidth, or everywhere where that is not reached.
    let lowest = |rows: &[FrequencyRow], bandwidth: Option<f64>| {
        let inside = rows
            .iter()
            .filter(|row| bandwidth.is_none_or(|b| row.hz <= b));
        inside.map(|row| row.coherence).reduce(f64::min)
    };
    let coherence = [
        ("encoder", lowest(&d.encoder, d.bandwidth_hz)),
        ("output", lowest(&d.output, d.output_bandwidth_hz)),
    ];
    let coherence: Vec<String> = coherence
        .iter()
        .filter_map(|(name, lowest)| Some(format!("{:.3} at the {name}", (*lowest)?)))
        .collect();
    let text = format!(
        "Bandwidth (-3 dB) {} at the encoder, {} at the output. Lowest coherence below the bandwidth: {}. The \
         response is that to a random reference of this size; an axis with friction answers differently to others, \
         and the coherence says how much of it is not linear.",
        hertz(d.bandwidth_hz),
        hertz(d.output_bandwidth_hz),
        coherence.join(", ")
    );
    let plots: [(&str, Value); 3] = [
        ("gain, dB", |r, k| 20.0 * r.gain[k].max(1e-6).log10()),
        ("phase, degrees", |r, k| r.phase[k].to_degrees()),
        ("coherence", |r, k| r.coherence[k]),
    ];
    let body = html! {
        p { (text) }
        @for (name, value) in plots {
            (figure(&over_frequency(responses, name, value), html! {}))
        }
    };
    Ok(page(&title, &body))
}

fn over_frequency(responses: &[FrequencyResponse; 2], name: &str, value: Value) -> Markup {
    let series: Vec<(&str, Vec<(f64, f64)>)> = ["encoder", "output"]
        .into_iter()
        .zip(responses)
        .filter(|(_, r)| !r.frequency.is_empty())
        .map(|(name, r)| {
            let points = (0..r.frequency.len())
                // Nought has no place on a logarithmic axis.
                .filter(|k| r.frequency[*k] > 0.0)
                .map(|k| (r.frequency[k], value(r, k)))
                .collect();
            (name, points)
        })
        .collect();
    let every = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: WHOLE,
        x: (decades_of(every().map(|p| p.0)), "frequency, Hz"),
        y: (range_of(every().map(|p| p.1), 0.1), name),
    };
    all(Plot::new(&axes).log_x(), &series).draw()
}
