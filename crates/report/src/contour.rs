//! The report of a contour.

use super::figure::{Axes, HALF, curves, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_evaluate::contour::{Document, Traced};
use std::fmt::Write as _;

/// Points of a curve: more would show no more.
const POINTS: usize = 1500;

/// The report of a contour as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn contour(d: &Document, traced: &[Traced]) -> Result<String> {
    let name = if d.path == "square" {
        "Square"
    } else {
        "Circle"
    };
    let title = format!(
        "{name} of {:.0} um, {} five-bar, seed {}",
        d.size_um, d.side, d.seed
    );
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    let _ = writeln!(
        body,
        "<p>At {:.0} um/s, with a friction of {} N m in each bearing between the links. The endpoint \
         as the probes at both joints see it; distances are from where it was wanted, but for a displacement of the whole.</p>",
        d.speed_um_s, d.coupling_nm
    );
    body.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>model</th><th>preload</th>\
         <th>greatest<small>um</small></th><th>rms<small>um</small></th>\
         <th>shift in x, y<small>um</small></th></tr>\n",
    );
    for row in &d.rows {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}, {:.2}</td></tr>",
            row.compensation, row.preload, row.max_um, row.rms_um, row.shift_um[0], row.shift_um[1]
        );
    }
    body.push_str("</table></div>\n<div class=\"pair\">\n");
    for (row, samples) in traced {
        let every = samples.len().div_ceil(POINTS).max(1);
        let thin = |of: &dyn Fn(usize) -> (f64, f64)| -> Vec<(f64, f64)> {
            (0..samples.len()).step_by(every).map(of).collect()
        };
        let um = |x: f64, y: f64| (1e6 * x, 1e6 * y);
        let series = [
            (
                "measured",
                thin(&|k| um(samples[k].measured.x, samples[k].measured.y)),
            ),
            (
                "wanted",
                thin(&|k| um(samples[k].wanted.x, samples[k].wanted.y)),
            ),
        ];
        let all = || series.iter().flat_map(|(_, points)| points.iter());
        let axes = Axes {
            width: HALF,
            x: (range_of(all().map(|p| p.0), 0.1), "x, um"),
            y: (range_of(all().map(|p| p.1), 0.1), "y, um"),
        };
        let preload = if row.preload > 0.0 {
            format!(", preload of {} x static friction", row.preload)
        } else {
            String::new()
        };
        let number = match (row.compensation, row.preload > 0.0) {
            ("none", false) => " (thesis, Fig. 2.21)",
            ("reversal", false) => " (Fig. 2.22)",
            ("reversal", true) => " (Fig. 2.23)",
            _ => "",
        };
        let text = format!(
            "Compensation: {}{preload}{number}. Greatest error {:.1} um.",
            row.compensation, row.max_um
        );
        body.push_str(&figure(&curves(&axes, &series)?, &escape(&text)));
    }
    body.push_str("</div>\n");
    Ok(page(&title, &body))
}
