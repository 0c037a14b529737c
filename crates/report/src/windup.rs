//! The report of an identified windup.

use super::figure::{Axes, HALF, WHOLE, curves, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_control::identify::WindupRecord;
use pigtail_model::windup::{Windup, WindupState};
use pigtail_session::identify::Identified;
use std::fmt::Write as _;

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
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    let _ = writeln!(
        body,
        "<p>W_max {:.3} um, Q {:.3} um. Over the full range of {:.0} um the forward and the backward \
         path lie {:.2} um apart without compensation and {:.2} um with it: {:.1} times better.</p>",
        d.w_max_um, d.q_um, d.range_um, d.uncompensated_um, d.compensated_um, d.factor
    );
    body.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>scan</th><th>none<small>um</small></th>\
         <th>reversal<small>um</small></th><th>memory<small>um</small></th></tr>\n",
    );
    for row in &d.scans {
        let [none, reversal, memory] = row.peak_to_peak_um;
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td></tr>\n\
             <tr><td>peak to peak</td><td>{none:.2}</td><td>{reversal:.2}</td><td>{memory:.2}</td></tr>",
            row.name, row.uncompensated_um, row.reversal_um, row.memory_um
        );
    }
    body.push_str("</table></div>\n");
    body.push_str(&figure(
        &loops(identified)?,
        "Windup against output over the identification scan (thesis, Figs. 2.14, 2.15): measured, \
         and by both models.",
    ));
    body.push_str("<div class=\"pair\">\n");
    for (record, text) in identified.before_and_after.iter().zip([
        "Without compensation: where the output was against where it was wanted (Fig. 2.8).",
        "With the model that remembers (Fig. 2.17).",
    ]) {
        body.push_str(&figure(&errors(record, identified.um_per_radian)?, text));
    }
    body.push_str("</div>\n");
    Ok(page(&title, &body))
}

fn loops(identified: &Identified) -> Result<String> {
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

fn errors(record: &WindupRecord, um: f64) -> Result<String> {
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
