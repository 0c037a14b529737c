//! The report of a tuned axis.

use super::figure::{
    Axes, HALF, WHOLE, all as with_curves, curves, decades_of, over_count, range_of,
};
use super::html::{figure, page};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::characterize::Trace;
use pigtail_control::tune::{Gains, Search};
use pigtail_session::tune::Tuned;

/// The report of a tuned axis as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn tuning(tuned: &Tuned) -> Result<String> {
    let d = &tuned.document;
    let title = format!("Tuning of {}, seed {}", d.axis, d.seed);
    let found = format!(
        "Gains kp {} V/count, ki {} V/(count s), kd {} V s/count: rise {:.1} ms (10 to 90 %), settling \
         {:.1} ms (within one count), overshoot {:.1} %, cost {:.2} ms².",
        d.gains.kp, d.gains.ki, d.gains.kd, d.rise_ms, d.settling_ms, d.overshoot_percent, d.cost
    );
    let body = html! {
        p { (found) }
        @if let Some(specified) = &d.specified { p { "Specified: " (specified) "." } }
        (figure(
            &responses(tuned),
            "The larger step under the gains that were believed and under those found, in counts of the \
             motor's encoder."
        ))
        div.pair {
            @for (k, name) in [(0, "kp, V/count"), (2, "kd, V s/count")] {
                (figure(
                    &paths(&tuned.searches, k, name),
                    "Successful trials of the searches, each from a start of its own (thesis, Fig. 2.3)."
                ))
            }
        }
        (figure(
            &costs(&tuned.searches),
            "Best cost so far: ITAE over the size of the step, averaged over two sizes."
        ))
    };
    Ok(page(&title, &body))
}

fn responses(tuned: &Tuned) -> Markup {
    let curve = |trace: &Trace| -> Vec<(f64, f64)> {
        let at = |k: usize| (k + 1) as f64 * trace.period * 1e3;
        std::iter::once((0.0, 0.0))
            .chain(trace.encoder.iter().enumerate().map(|(k, c)| (at(k), *c)))
            .take_while(|(t, _)| *t <= 80.0)
            .collect()
    };
    let (before, after) = (curve(&tuned.before), curve(&tuned.after));
    let axes = Axes {
        width: WHOLE,
        x: (0.0..80.0, "time, ms"),
        y: (
            range_of(before.iter().chain(&after).map(|p| p.1), 1.0),
            "encoder, counts",
        ),
    };
    curves(&axes, &[("believed", before), ("found", after)])
}

const NAMES: [&str; 3] = ["start 1", "start 2", "start 3"];

fn paths(searches: &[Search], k: usize, name: &str) -> Markup {
    let both = |gains: Gains| (gains[1], gains[k]);
    let named: Vec<(&str, Vec<(f64, f64)>)> = searches
        .iter()
        .zip(NAMES)
        .map(|(search, name)| (name, search.path.iter().map(|p| both(p.gains)).collect()))
        .collect();
    let all = || named.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: HALF,
        x: (decades_of(all().map(|p| p.0)), "ki, V/(count s)"),
        y: (decades_of(all().map(|p| p.1)), name),
    };
    with_curves(Plot::new(&axes).log_x().log_y(), &named).draw()
}

fn costs(searches: &[Search]) -> Markup {
    let named: Vec<(&str, Vec<(f64, f64)>)> = searches
        .iter()
        .zip(NAMES)
        .map(|(search, name)| {
            let finite = search.path.iter().filter(|p| p.cost.is_finite());
            let mut points: Vec<(f64, f64)> = Vec::new();
            for p in finite {
                // A staircase: the best cost stays until it is beaten.
                if let Some(last) = points.last() {
                    points.push((f64::from(p.trial), last.1));
                }
                points.push((f64::from(p.trial), p.cost));
            }
            if let Some(last) = points.last() {
                points.push((f64::from(search.trials), last.1));
            }
            (name, points)
        })
        .collect();
    let most = searches.iter().map(|s| s.trials).max().unwrap_or(1);
    let costs = named
        .iter()
        .flat_map(|(_, points)| points.iter().map(|p| p.1));
    let axes = Axes {
        width: WHOLE,
        x: (0.0..f64::from(most), "trial"),
        y: (range_of(costs, 1.0), "cost, ms²"),
    };
    over_count(&axes, &named)
}
