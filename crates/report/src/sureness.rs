//! How often the truth lies within control's own intervals, in the report of a campaign.

use super::figure::{Axes, HALF, all};
use super::html::{figure, number};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::campaign::{CampaignDocument, Shares, Store, Sureness, reliability};

/// Steps of a reliability diagram.
const STEPS: usize = 100;

/// The tails are looked at from there on: shares outside of a thousandth at least.
const TAIL: f64 = 1e-3;

/// What control says it knows beside what is true; nothing where no fiber has a belief.
///
/// # Errors
///
/// When the rows cannot be read.
pub(super) fn sureness(store: &Store, document: &CampaignDocument) -> Result<Markup> {
    let Some(sure) = &document.sureness else {
        return Ok(Markup::default());
    };
    let rows = store.rows()?;
    let even: Vec<f64> = (0..=STEPS).map(|k| k as f64 / STEPS as f64).collect();
    let tails: Vec<f64> = (0..=STEPS)
        .map(|k| 1.0 - TAIL.powf(k as f64 / STEPS as f64))
        .collect();
    let [whole, tail] = [reliability(&rows, &even)?, reliability(&rows, &tails)?];
    Ok(html! {
        h2 { "How sure it is, and how often it is right" }
        (table(sure))
        p.soft {
            "Of " (sure.fibers) " fibers with a belief: the share whose true place lies within the interval that control stated \
             with so many percent. Control expects " (number(Some(sure.stated_wrong), 4)) " fibers out of tolerance by its own \
             probabilities. Below each share, where it is known: an interval of 99 % over machines, of which "
            (document.machines) " there are; where all fibers are within, exact for so many."
        }
        div.pair {
            (figure(&diagram(&whole), "Share of fibers whose true place lies within control's interval, against what was stated. Below the \
                dashed line control is surer than right, above it it could say more."))
            (figure(&outside(&tail), "The same in the tails: the share of fibers outside, against the share that was stated to be outside. \
                Above the dashed line more are outside than stated."))
        }
    })
}

/// In x, y and z.
fn each(shares: &Shares) -> [f64; 3] {
    [shares.x, shares.y, shares.z]
}

fn table(sure: &Sureness) -> Markup {
    let shares = [
        &sure.within_50_percent,
        &sure.within_80_percent,
        &sure.within_95_percent,
        &sure.within_99_percent,
    ];
    let between = |of: Option<[f64; 2]>| {
        of.map_or_else(String::new, |[low, high]| {
            format!("{:.1} to {:.1}", 100.0 * low, 100.0 * high)
        })
    };
    html! {
        div.scroll { table {
            tr {
                th { "within, % of fibers" }
                @for known in &sure.known { th { "of " (number(Some(known.percent), 0)) " %" } }
            }
            @for (i, name) in ["x", "y", "z"].iter().enumerate() {
                tr {
                    td { (name) }
                    @for shares in shares { td { (format!("{:.1}", 100.0 * each(shares)[i])) } }
                }
                tr.soft {
                    td { "known to be" }
                    @for known in &sure.known { td { (between([known.x, known.y, known.z][i])) } }
                }
            }
        } }
    }
}

fn diagram(curves: &[Vec<(f64, f64)>; 3]) -> Markup {
    let axes = Axes {
        width: HALF,
        x: (0.0..1.0, "stated share"),
        y: (0.0..1.0, "share of fibers within"),
    };
    let plot = Plot::new(&axes).line_as("as stated", "ink dash", &[(0.0, 0.0), (1.0, 1.0)]);
    let [x, y, z] = curves.clone();
    all(plot, &[("x", x), ("y", y), ("z", z)]).draw()
}

fn outside(curves: &[Vec<(f64, f64)>; 3]) -> Markup {
    let axes = Axes {
        width: HALF,
        x: (TAIL..1.0, "stated share outside"),
        y: (TAIL..1.0, "share of fibers outside"),
    };
    let plot = Plot::new(&axes).log_x().log_y();
    let plot = plot.line_as("as stated", "ink dash", &[(TAIL, TAIL), (1.0, 1.0)]);
    // What nobody is outside of is not drawn by a logarithm.
    let turned = |curve: &Vec<(f64, f64)>| -> Vec<(f64, f64)> {
        let each = curve
            .iter()
            .map(|(stated, within)| (1.0 - stated, 1.0 - within));
        each.filter(|(stated, out)| *stated > 0.0 && *out > 0.0)
            .collect()
    };
    let [x, y, z] = [0, 1, 2].map(|i| turned(&curves[i]));
    all(plot, &[("x", x), ("y", y), ("z", z)]).draw()
}
