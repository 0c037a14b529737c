//! The report of an identified windup.

use super::figure::{Axes, HALF, WHOLE, all as with_curves, range_of};
use super::html::{figure, fixed, page, th};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::identify::WindupRecord;
use pigtail_model::windup::{Windup, WindupState};
use pigtail_session::identify::Identified;

/// Points of a curve: more would show no more.
const POINTS: usize = 3000;

/// The report of an identified windup as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn windup(identified: &Identified) -> Result<String> {
    let d = &identified.document;
    let title = format!("Windup of {}, seed {}", d.axis, d.seed);
    let text = format!(
        "W_max {:.3} um, Q {:.3} um. Over the full range of {:.0} um the forward and the backward path lie \
         {:.2} um apart without compensation and {:.2} um with it: {:.1} times better.",
        d.w_max_um, d.q_um, d.range_um, d.uncompensated_um, d.compensated_um, d.factor
    );
    let row = |name: &str, values: [f64; 3]| {
        html! {
            tr {
                td { (name) }
                @for um in values { td { (fixed(um, 2)) } }
            }
        }
    };
    let texts = [
        "Without compensation (Fig. 2.8).",
        "With the model that remembers (Fig. 2.17).",
    ];
    let body = html! {
        p { (text) }
        div.scroll { table {
            tr { th { "scan" } (th("none", "um")) (th("reversal", "um")) (th("memory", "um")) }
            @for scan in &d.scans {
                (row(scan.name, [scan.uncompensated_um, scan.reversal_um, scan.memory_um]))
                (row(&format!("{}, peak to peak", scan.name), scan.peak_to_peak_um))
            }
        } }
        (figure(
            &loops(identified),
            "Windup against output over the identification scan (thesis, Figs. 2.14, 2.15): measured, and \
             by both models."
        ))
        div.pair {
            @for (record, text) in identified.before_and_after.iter().zip(texts) {
                @let (picture, mean) = errors(record, identified.um_per_radian);
                (figure(
                    &picture,
                    format!(
                        "{text} How far the output was from where it was wanted, less the mean of {mean:.2} um: the \
                         gap between its two ways is what stands in the table."
                    )
                ))
            }
        }
    };
    Ok(page(&title, &body))
}

fn loops(identified: &Identified) -> Markup {
    let (record, um) = (&identified.record, identified.um_per_radian);
    let every = record.output.len().div_ceil(POINTS);
    let thin = |w: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        (0..record.output.len())
            .step_by(every)
            .map(|k| (um * record.output[k], um * w(k)))
            .collect()
    };
    let play = |model: Windup| {
        let mut state = WindupState::default();
        let windups: Vec<f64> = record
            .output
            .iter()
            .map(|output| model.next(&mut state, *output))
            .collect();
        windups
    };
    let (reversal, memory) = (
        play(Windup::Reversal(identified.reversal)),
        play(Windup::Memory(identified.memory)),
    );
    // What was measured lies broad below the models.
    let series = [
        ("measured", thin(&|k| record.input[k] - record.output[k])),
        ("reversal (2.20)", thin(&|k| reversal[k])),
        ("memory", thin(&|k| memory[k])),
    ];
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: WHOLE,
        x: (range_of(all().map(|p| p.0), 0.1), "output, um"),
        y: (range_of(all().map(|p| p.1), 0.01), "windup, um"),
    };
    let [measured, models @ ..] = &series;
    let plot = Plot::new(&axes).line_as(measured.0, "c0 broad", &measured.1);
    with_curves(plot, models).draw()
}

/// The first sample behind the second turn of a path: until then the transmission remembers what was before.
fn second_turn(wanted: &[f64]) -> usize {
    let (mut way, mut turns) = (0.0, 0);
    for (k, pair) in wanted.windows(2).enumerate() {
        let step = pair[1] - pair[0];
        if step == 0.0 {
            continue;
        }
        if step * way < 0.0 {
            turns += 1;
            if turns == 2 {
                return k;
            }
        }
        way = step;
    }
    0
}

/// The error of an output on a scan without its mean from the second turn on, and that mean, micrometres.
fn errors(record: &WindupRecord, um: f64) -> (Markup, f64) {
    let count = record.output.len();
    let every = count.div_ceil(POINTS).max(1);
    let error = |k: usize| um * (record.output[k] - record.wanted[k]);
    let from = second_turn(&record.wanted);
    let mean = (from..count).map(error).sum::<f64>() / (count - from).max(1) as f64;
    let part = |range: std::ops::Range<usize>| -> Vec<(f64, f64)> {
        let point = |k: usize| (um * record.wanted[k], error(k) - mean);
        range.step_by(every).map(point).collect()
    };
    let (before, after) = (part(0..from), part(from..count));
    let axes = Axes {
        width: HALF,
        x: (
            range_of(after.iter().map(|p| p.0), 0.1),
            "wanted output, um",
        ),
        y: (
            range_of(after.iter().map(|p| p.1), 0.01),
            "output less wanted, less the mean, um",
        ),
    };
    let plot = Plot::new(&axes).line("from the second turn on", &after);
    let plot = if before.is_empty() {
        plot
    } else {
        plot.line_as("before", "faint thin", &before)
    };
    (plot.draw(), mean)
}
