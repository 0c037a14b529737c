//! The report of a contour.

use super::figure::{Axes, HALF, range_of};
use super::html::{figure, fixed, page, th};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::contour::{ContourDocument, Traced};

/// Points of a curve: more would show no more.
const POINTS: usize = 1500;

/// The report of a contour as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn contour(d: &ContourDocument, traced: &[Traced]) -> Result<String> {
    let name = if d.path == "square" {
        "Square"
    } else {
        "Circle"
    };
    let title = format!(
        "{name} of {:.0} um, {} five-bar, seed {}",
        d.size_um, d.side, d.seed
    );
    let body = html! {
        p {
            "At " (fixed(d.speed_um_s, 0)) " um/s, with a friction of " (d.coupling_nm)
            " N m in each bearing between the links. The endpoint as the probes at both joints see it; \
             distances are from where it was wanted, but for a displacement of the whole."
        }
        div.scroll { table {
            tr {
                th { "model" } th { "preload" }
                (th("greatest", "um")) (th("rms", "um")) (th("shift in x, y", "um"))
            }
            @for row in &d.rows {
                tr {
                    td { (row.compensation) }
                    td { (row.preload) }
                    td { (fixed(row.max_um, 2)) }
                    td { (fixed(row.rms_um, 2)) }
                    td { (fixed(row.shift_um[0], 2)) ", " (fixed(row.shift_um[1], 2)) }
                }
            }
        } }
        div.pair {
            @for traced in traced { (figure(&path(traced), caption(traced))) }
        }
    };
    Ok(page(&title, &body))
}

/// Where the endpoint was, and where it was wanted.
fn path((_, samples): &Traced) -> Markup {
    let every = samples.len().div_ceil(POINTS).max(1);
    let thin = |of: &dyn Fn(usize) -> (f64, f64)| -> Vec<(f64, f64)> {
        (0..samples.len()).step_by(every).map(of).collect()
    };
    let um = |x: f64, y: f64| (1e6 * x, 1e6 * y);
    let wanted = thin(&|k| um(samples[k].wanted.x, samples[k].wanted.y));
    let measured = thin(&|k| um(samples[k].measured.x, samples[k].measured.y));
    let all = || wanted.iter().chain(&measured);
    let axes = Axes {
        width: HALF,
        x: (range_of(all().map(|p| p.0), 0.1), "x, um"),
        y: (range_of(all().map(|p| p.1), 0.1), "y, um"),
    };
    // Angles are what they are.
    let plot = Plot::new(&axes).equal();
    // Where both are the same, neither hides the other.
    let plot = plot.line_as("wanted", "c1 broad", &wanted);
    plot.line_as("measured", "c0", &measured).draw()
}

fn caption((row, _): &Traced) -> String {
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
    format!(
        "Compensation: {}{preload}{number}. Greatest error {:.1} um.",
        row.compensation, row.max_um
    )
}
