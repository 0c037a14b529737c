//! Reports of impulse control: one loop, and many.

use super::figure::{Axes, HALF, WHOLE, all as all_of, bars, range_of};
use super::html::{figure, fixed, number, page, th};
use super::impulse::a;
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::impulse::run::{Campaign, PulseDocument, Resolution};

/// The report of one loop as one HTML text: from four `sides`, with each of some `gains`, and `steps`
/// without a loop.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn pulses(
    d: &PulseDocument,
    sides: &[PulseDocument],
    gains: &[PulseDocument],
    steps: &Resolution,
) -> Result<String> {
    let title = format!("{} by pulses, {} nm, seed {}", d.axis, d.target_nm, d.seed);
    let body = html! {
        p {
            (d.pulses) " pulses, " (fixed(d.error_nm, 1)) " nm off in truth, "
            @if let Some(seconds) = d.settled_s {
                span.good { "settled after " (fixed(seconds, 2)) " s" }
            } @else {
                span.bad { "not settled" }
            }
            " to " (d.tolerance_nm) " nm. Estimator: " (d.estimator) "; condition: " (d.condition) "; "
            (gain()) " = " (d.gain) "."
        }
        (over_pulses(
            WHOLE,
            &[("by the sensor", measured(d)), ("in truth", truth(d))],
            "error, nm",
            Some(d.tolerance_nm),
            "The error after each pulse (Fig. 4.20).",
        ))
        div.scroll { table {
            tr {
                (th("time", "s")) (th("error by the sensor", "nm")) (th("in truth", "nm"))
                (th(html! { "next " (a(1)) }, "fsm")) (th("expected to move", "nm"))
            }
            @for step in &d.steps {
                tr {
                    td { (fixed(step.time_s, 3)) }
                    td { (fixed(step.measured_nm, 1)) }
                    td { (fixed(step.error_nm, 1)) }
                    td { (number(step.a1_fsm, 2)) }
                    td { (fixed(step.expected_nm, 1)) }
                }
            }
        } }
        (from_sides(sides))
        (by_gain(gains))
        (without_loop(steps))
    };
    Ok(page(&title, &body))
}

/// The gain of the loop.
fn gain() -> Markup {
    html! { "k" sub { "c" } }
}

fn from_sides(sides: &[PulseDocument]) -> Markup {
    let section = |half: &[PulseDocument]| {
        let named: Vec<(String, Vec<(f64, f64)>)> = half
            .iter()
            .map(|d| (format!("{} nm", d.target_nm), over_time(d)))
            .collect();
        let rest = half.iter().filter_map(|d| d.settled_s).fold(0.0, f64::max);
        let all = half.iter().all(|d| d.settled_s.is_some());
        let verdict = if all {
            format!("settled after {rest:.2} s at the latest")
        } else {
            "not all of them settled".to_owned()
        };
        let estimator = half.first().map_or("", |d| d.estimator);
        plot(
            HALF,
            &borrowed(&named),
            ("time, s", "error, nm"),
            half.first().map(|d| d.tolerance_nm),
            &format!("Estimator: {estimator}; {verdict} (Fig. 4.22)."),
        )
    };
    html! {
        h2 { "From four sides" }
        div.pair {
            @for half in sides.chunks(4) { (section(half)) }
        }
    }
}

fn by_gain(gains: &[PulseDocument]) -> Markup {
    let section = |half: &[PulseDocument]| {
        let named: Vec<(String, Vec<(f64, f64)>)> = half
            .iter()
            .map(|d| (format!("k_c = {}", d.gain), truth(d)))
            .collect();
        let last: Vec<String> = half
            .iter()
            .map(|d| format!("{}: {:.1} nm at the end", d.gain, d.error_nm))
            .collect();
        let tolerance = half.first().map(|d| d.tolerance_nm);
        over_pulses(
            HALF,
            &borrowed(&named),
            "error, nm",
            tolerance,
            &last.join("; "),
        )
    };
    let (first, last) = gains.split_at(gains.len() - 2);
    html! {
        h2 { "Stability" }
        p {
            "On a machine whose response was measured, with nothing uncertain. The loop is stable for "
            (gain()) " between 0 and 2 (4.12)."
        }
        div.pair {
            (section(first))
            (section(last))
        }
    }
}

fn borrowed(named: &[(String, Vec<(f64, f64)>)]) -> Vec<(&str, Vec<(f64, f64)>)> {
    named
        .iter()
        .map(|(name, points)| (name.as_str(), points.clone()))
        .collect()
}

fn without_loop(steps: &Resolution) -> Markup {
    let position: Vec<(f64, f64)> = steps
        .position_nm
        .iter()
        .enumerate()
        .map(|(k, nm)| (k as f64, *nm))
        .collect();
    let single: Vec<(f64, f64)> = position
        .windows(2)
        .map(|pair| (pair[1].0, pair[1].1 - pair[0].1))
        .collect();
    let text = format!(
        "{} pulses forward without any loop, all alike, such as to move the output by {} nm: mean {:.1} \
         nm, deviation {:.1} nm, {:.1} to {:.1} nm.",
        steps.position_nm.len() - 1,
        steps.step_nm,
        steps.mean_nm,
        steps.deviation_nm,
        steps.least_nm,
        steps.greatest_nm
    );
    html! {
        h2 { "Resolution" }
        p { (text) }
        div.pair {
            (over_pulses(
                HALF,
                &[("output", position)],
                "position, nm",
                None,
                "Position (Figs. 4.23, 4.24).",
            ))
            (over_pulses(
                HALF,
                &[("output", single)],
                "displacement, nm",
                None,
                "Displacement by each pulse.",
            ))
        }
    }
}

fn measured(d: &PulseDocument) -> Vec<(f64, f64)> {
    let steps = d.steps.iter().enumerate();
    steps.map(|(k, s)| (k as f64, s.measured_nm)).collect()
}

fn truth(d: &PulseDocument) -> Vec<(f64, f64)> {
    let steps = d.steps.iter().enumerate();
    steps.map(|(k, s)| (k as f64, s.error_nm)).collect()
}

fn over_time(d: &PulseDocument) -> Vec<(f64, f64)> {
    d.steps.iter().map(|s| (s.time_s, s.error_nm)).collect()
}

fn over_pulses(
    width: u32,
    series: &[(&str, Vec<(f64, f64)>)],
    y: &str,
    tolerance: Option<f64>,
    caption: &str,
) -> Markup {
    plot(width, series, ("pulse", y), tolerance, caption)
}

fn plot(
    width: u32,
    series: &[(&str, Vec<(f64, f64)>)],
    (x, y): (&str, &str),
    tolerance: Option<f64>,
    caption: &str,
) -> Markup {
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width,
        x: (range_of(all().map(|p| p.0), 0.1), x),
        y: (range_of(all().map(|p| p.1).chain([0.0]), 1.0), y),
    };
    let mut drawn = all_of(Plot::new(&axes), series);
    if x == "pulse" {
        drawn = drawn.whole_x();
    }
    if let Some(nm) = tolerance {
        let name = format!("within {nm} nm");
        drawn = drawn.mark_y(&name, nm, "soft").mark_y("", -nm, "soft");
    }
    figure(&drawn.draw(), caption)
}

/// The report of many loops as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn pulse_campaign(c: &Campaign, documents: &[PulseDocument]) -> Result<String> {
    let title = format!(
        "{} by pulses, {} nm, {} runs from seed {}",
        c.axis, c.target_nm, c.row.runs, c.seed
    );
    let text = format!(
        "Estimator {}, condition {}, at most {} pulses: {:.1} % below 10 nm in truth, {:.1} % within {} \
         nm; error {:.1} nm in the median, {:.1} nm at the 90th percentile.",
        c.row.estimator,
        c.row.condition,
        c.most_pulses,
        c.row.below_10nm_percent,
        c.row.within_tolerance_percent,
        c.tolerance_nm,
        c.row.error_nm.p50,
        c.row.error_nm.p90
    );
    let errors: Vec<f64> = documents.iter().map(|d| d.error_nm).collect();
    // What failed lies far out, and would leave nothing of the rest.
    let edge = 3.0 * c.tolerance_nm;
    let shown: Vec<f64> = errors.iter().map(|e| e.clamp(-edge, edge)).collect();
    let ends = bars(
        WHOLE,
        &shown,
        &(-edge..edge),
        60,
        "true error in the end, nm",
        "runs",
    )
    .mark_x("", -c.tolerance_nm, "limit")
    .mark_x("tolerance", c.tolerance_nm, "limit");
    let body = html! {
        p { (text) }
        (figure(
            &ends.draw(),
            format!(
                "The true error in the end, of all runs; the tolerance is {} nm. What is beyond the \
                 figure stands at its edge.",
                c.tolerance_nm
            )
        ))
        h2 { "By estimator and condition" }
        div.scroll { table {
            tr {
                th { "condition" } th.text { "estimator" } th { "runs" }
                (th("below 10 nm", "%")) (th("within tolerance", "%"))
                (th("error p50", "nm")) (th("p90", "nm")) th { "pulses p90" } (th("settled p90", "s"))
            }
            @for row in &c.comparison {
                tr {
                    td { (row.condition) }
                    td.text { (row.estimator) }
                    td { (row.runs) }
                    td { (fixed(row.below_10nm_percent, 1)) }
                    td { (fixed(row.within_tolerance_percent, 1)) }
                    td { (fixed(row.error_nm.p50, 1)) }
                    td { (fixed(row.error_nm.p90, 1)) }
                    td { (fixed(row.pulses.p90, 0)) }
                    td { (number(row.settled_s.as_ref().map(|s| s.p90), 2)) }
                }
            }
        } }
    };
    Ok(page(&title, &body))
}
