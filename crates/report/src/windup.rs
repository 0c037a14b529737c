//! The report of an identified windup.

use super::figure::{Axes, HALF, WHOLE, curves, range_of};
use super::html::{figure, fixed, page, th};
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
        "Without compensation: where the output was against where it was wanted (Fig. 2.8).",
        "With the model that remembers (Fig. 2.17).",
    ];
    let body = html! {
        p { (text) }
        div.scroll { table {
            tr { th { "scan" } (th("none", "um")) (th("reversal", "um")) (th("memory", "um")) }
            @for scan in &d.scans {
                (row(scan.name, [scan.uncompensated_um, scan.reversal_um, scan.memory_um]))
                (row("peak to peak", scan.peak_to_peak_um))
            }
        } }
        (figure(
            &loops(identified)?,
            "Windup against output over the identification scan (thesis, Figs. 2.14, 2.15): measured, and \
             by both models."
        ))
        div.pair {
            @for (record, text) in identified.before_and_after.iter().zip(texts) {
                (figure(&errors(record, identified.um_per_radian)?, text))
            }
        }
    };
    Ok(page(&title, &body))
}

fn loops(identified: &Identified) -> Result<Markup> {
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
    curves(&axes, &series)
}

fn errors(record: &WindupRecord, um: f64) -> Result<Markup> {
    let every = record.output.len().div_ceil(POINTS);
    let points: Vec<(f64, f64)> = (0..record.output.len())
        .step_by(every)
        .map(|k| {
            (
                um * record.wanted[k],
                um * (record.output[k] - record.wanted[k]),
            )
        })
        .collect();
    let axes = Axes {
        width: HALF,
        x: (
            range_of(points.iter().map(|p| p.0), 0.1),
            "wanted output, um",
        ),
        y: (range_of(points.iter().map(|p| p.1), 0.01), "error, um"),
    };
    curves(&axes, &[("output less wanted", points)])
}
