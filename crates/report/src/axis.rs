//! Reports of experiments on one axis.

use super::figure::{Axes, HALF, WHOLE, all, bars, curves, decades_of, range_of};
use super::html::{self, figure, fixed, page};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::characterize::{FrequencyResponse, Increments, Trace};
use pigtail_session::characterize::{
    FrequencyDocument, LoadDocument, OpenLoopDocument, OpenLoopRow, ResolutionRow, SineDocument,
    StepDocument,
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
        @if let Some(d) = &d.load {
            @let drawn = plot("load, um", &[named("load", &trace.output, 1e6)], Some(d.wanted_um))
                .mark_y("wanted", d.wanted_um, "limit");
            (load(d, &drawn.draw()))
        }
        (figure(&voltage.draw(), "The motor's voltage."))
    };
    Ok(page(&title, &body))
}

/// What the load did.
fn load(d: &LoadDocument, drawn: &Markup) -> Markup {
    let caption = format!(
        "The load, by the probe at the output. It came to rest at {:.3} um, {:+.3} um from the {:.3} um that the step is \
         without windup.",
        d.rest_um,
        d.rest_um - d.wanted_um,
        d.wanted_um
    );
    let header = ["within +-\num".to_owned(), "settled after\nms".to_owned()];
    let rows: Vec<Vec<String>> = d
        .settling
        .iter()
        .map(|row| vec![row.band_um.to_string(), html::number(row.settling_ms, 1)])
        .collect();
    html! {
        (figure(drawn, caption))
        (html::table(&header, &rows))
        p.soft {
            "From when on the load stays so near to where it comes to rest; a dash where it still moves by as much in the end."
        }
    }
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
                &bars(HALF, &um, &range, 60, "increment, um", "steps").draw(),
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
    let coherence = [
        ("encoder", Some(d.lowest_coherence)),
        ("output", d.output_lowest_coherence),
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
        (open_loop(&d.open_loop))
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

/// The margins of an open loop in a line each.
pub fn margins(d: &OpenLoopDocument) -> Vec<String> {
    let sigma = |sigma: Option<f64>, digits: usize| {
        sigma.map_or_else(|| "unsure".to_owned(), |s| format!("+- {s:.digits$}"))
    };
    let mut lines = Vec::new();
    lines.push(d.phase_margin.map_or_else(
        || "phase margin: the gain does not fall through one where the loop is known".to_owned(),
        |m| {
            format!(
                "phase margin {:.1} {} deg at {:.1} Hz",
                m.deg,
                sigma(m.sigma_deg, 1),
                m.hz
            )
        },
    ));
    lines.push(match (d.gain_margin, d.rows.last()) {
        (Some(m), _) => {
            format!("gain margin {:.1} {} dB at {:.1} Hz", m.db, sigma(m.sigma_db, 1), m.hz)
        }
        (None, Some(last)) => format!(
            "gain margin: the phase does not fall through -180 deg up to {:.0} Hz, as far as the loop is known",
            last.hz
        ),
        (None, None) => "gain margin: the loop is known nowhere".to_owned(),
    });
    lines.extend(d.sensitivity_peak.map(|m| {
        let sigma = sigma(m.sigma_ratio, 2);
        format!(
            "sensitivity at most {:.2} {sigma}, at {:.1} Hz",
            m.ratio, m.hz
        )
    }));
    lines
}

/// A number of an open loop.
type OfLoop = fn(&OpenLoopRow) -> f64;

fn open_loop(d: &OpenLoopDocument) -> Markup {
    let plots: [(&str, &str, OfLoop); 3] = [
        ("gain of the open loop, dB", "0 dB", |row| {
            20.0 * row.gain.max(1e-6).log10()
        }),
        ("phase of the open loop, degrees", "-180 degrees", |row| {
            row.phase_deg
        }),
        ("sensitivity, dB", "0 dB", |row| {
            20.0 * row.sensitivity.max(1e-6).log10()
        }),
    ];
    let across = [0.0, -180.0, 0.0];
    let draw = |name: &str, line: &str, at: f64, value: OfLoop| {
        let points: Vec<(f64, f64)> = d.rows.iter().map(|row| (row.hz, value(row))).collect();
        let axes = Axes {
            width: WHOLE,
            x: (decades_of(points.iter().map(|p| p.0)), "frequency, Hz"),
            y: (range_of(points.iter().map(|p| p.1).chain([at]), 0.1), name),
        };
        let mut plot = Plot::new(&axes)
            .log_x()
            .line(name, &points)
            .mark_y(line, at, "limit");
        if let Some(m) = d.phase_margin {
            plot = plot.mark_x("gain is one", m.hz, "soft");
        }
        if let Some(m) = d.gain_margin {
            plot = plot.mark_x("phase is -180", m.hz, "soft");
        }
        plot.draw()
    };
    html! {
        h2 { "Open loop" }
        ul { @for line in margins(d) { li { (line) } } }
        p.soft {
            "L = 1 / S - 1 of the sensitivity S from the reference to the error: the servo acts on the error alone, and sampling \
             and amplifier are in it. Deviations are those over eight parts of the record, one left out at a time. Where L is known worse than to \
             30 % it is not drawn, and no margin is read off. It belongs to motions of this size: smaller ones see more friction."
        }
        @if !d.rows.is_empty() {
            @for ((name, line, value), at) in plots.into_iter().zip(across) {
                (figure(&draw(name, line, at, value), html! {}))
            }
        }
    }
}
