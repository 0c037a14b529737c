//! The report of windup loops on machines that differ.

use super::figure::{Axes, HALF, WHOLE, curves, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_evaluate::loops::{Document, Loop};
use pigtail_model::windup::{Windup, WindupState};
use std::fmt::Write as _;

/// Points of a curve: more would show no more.
const POINTS: usize = 2000;

/// The report of windup loops as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn loops(d: &Document, loops: &[Loop]) -> Result<String> {
    let title = format!("Windup of {}, seed {}", d.axis, d.seed);
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    let _ = writeln!(
        body,
        "<p>Forward and back over {:.0} um, on the same specimen but for what is varied. Input is \
         the motor's encoder behind the gear, output what the probe sees.</p>",
        d.range_um
    );
    body.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>figure</th><th>machine</th>\
         <th>windup<small>um</small></th><th>W_max<small>um</small></th><th>Q<small>um</small></th>\
         <th>(2.20) leaves<small>um rms</small></th><th>at most<small>um</small></th></tr>\n",
    );
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    for case in &d.cases {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td>{:.2}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            case.figure,
            escape(&case.name),
            case.windup_um,
            number(case.w_max_um),
            number(case.q_um),
            number(case.residual_um),
            number(case.largest_residual_um)
        );
    }
    body.push_str("</table></div>\n");
    let of = |figures: &[&str]| -> Vec<&Loop> {
        loops
            .iter()
            .filter(|l| figures.contains(&l.case.figure))
            .collect()
    };
    let plain = of(&["2.8", "2.11"]);
    let number = plain.first().map_or("", |l| l.case.figure);
    body.push_str(&figure(
        &over_input(&plain, WHOLE)?,
        &format!("Output against input as the machine is (thesis, Fig. {number})."),
    ));
    body.push_str("<div class=\"pair\">\n");
    for (figures, text) in [
        (
            ["2.8", "2.9"],
            "The more load friction, the more windup (Fig. 2.9).",
        ),
        (["2.10", "2.10"], "Without load friction (Fig. 2.10)."),
        (
            ["2.8", "2.12, 2.13"],
            "A preload stiffens the transmission (Figs. 2.12, 2.13).",
        ),
    ] {
        let mut chosen = of(&figures);
        if figures[0] == "2.8" {
            chosen = plain.iter().copied().chain(of(&figures[1..])).collect();
        }
        body.push_str(&figure(&over_input(&chosen, HALF)?, text));
    }
    body.push_str("</div>\n");
    let laws = of(&["2.14, 2.15"]);
    if !laws.is_empty() {
        body.push_str("<h2>Laws of load friction</h2>\n");
        if let Some(nearest) = d.laws() {
            let _ = writeln!(body, "<p>{}.</p>", escape(&nearest));
        }
        body.push_str("<div class=\"pair\">\n");
        for l in laws {
            let text = format!(
                "Windup against output under {}, beside (2.20) (Figs. 2.14, 2.15).",
                l.case.name
            );
            body.push_str(&figure(&over_output(l)?, &text));
        }
        body.push_str("</div>\n");
    }
    Ok(page(&title, &body))
}

/// Output against input, from the first turn on.
fn over_input(loops: &[&Loop], width: u32) -> Result<String> {
    let series: Vec<(&str, Vec<(f64, f64)>)> = loops
        .iter()
        .map(|l| {
            let um = l.um_per_radian;
            let (from, to) = (l.record.input.len() / 4, 3 * l.record.input.len() / 4);
            let every = (to - from).div_ceil(POINTS);
            let points = (from..to)
                .step_by(every)
                .map(|k| (um * l.record.input[k], um * l.record.output[k]))
                .collect();
            (l.case.name.as_str(), points)
        })
        .collect();
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width,
        x: (range_of(all().map(|p| p.0), 0.1), "input, um"),
        y: (range_of(all().map(|p| p.1), 0.1), "output, um"),
    };
    curves(&axes, &series)
}

/// Windup against output beside what (2.20) makes of it.
fn over_output(l: &Loop) -> Result<String> {
    let um = l.um_per_radian;
    let from = l.record.input.len() / 4;
    let every = (l.record.input.len() - from).div_ceil(POINTS);
    let thin = |w: &[f64]| -> Vec<(f64, f64)> {
        (from..w.len())
            .step_by(every)
            .map(|k| (um * l.record.output[k], um * w[k]))
            .collect()
    };
    let pairs = l.record.input.iter().zip(&l.record.output);
    let offset = l.fit.map_or(0.0, |fit| fit.offset);
    let measured: Vec<f64> = pairs.map(|(i, o)| i - o - offset).collect();
    let mut series = vec![("measured", thin(&measured))];
    if let Some(fit) = &l.fit {
        let model = Windup::Reversal(fit.model);
        let mut state = WindupState::default();
        let outputs = l.record.output.iter();
        let fitted: Vec<f64> = outputs.map(|o| model.next(&mut state, *o)).collect();
        series.push(("(2.20)", thin(&fitted)));
    }
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: HALF,
        x: (range_of(all().map(|p| p.0), 0.1), "output, um"),
        y: (range_of(all().map(|p| p.1), 0.01), "windup, um"),
    };
    curves(&axes, &series)
}
