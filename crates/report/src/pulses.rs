//! Reports of impulse control: one loop, and many.

use super::figure::{Axes, HALF, WHOLE, bars, curves, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_evaluate::impulse::run::{Campaign, CampaignRow, Document, Resolution};
use std::fmt::Write as _;

/// The report of one loop as one HTML text: from four `sides`, with each of some `gains`, and `steps`
/// without a loop.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn pulses(
    d: &Document,
    sides: &[Document],
    gains: &[Document],
    steps: &Resolution,
) -> Result<String> {
    let title = format!("{} by pulses, {} nm, seed {}", d.axis, d.target_nm, d.seed);
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    let settled = d.settled_s.map_or_else(
        || "<span class=\"bad\">not settled</span>".to_owned(),
        |s| format!("<span class=\"good\">settled after {s:.2} s</span>"),
    );
    let _ = writeln!(
        body,
        "<p>{} pulses, {:.1} nm off in truth, {settled} to {} nm. Estimator: {}; condition: {}; \
         k<sub>c</sub> = {}.</p>",
        d.pulses, d.error_nm, d.tolerance_nm, d.estimator, d.condition, d.gain
    );
    body.push_str(&over_pulses(
        WHOLE,
        &[("by the sensor", measured(d)), ("in truth", truth(d))],
        "error, nm",
        "The error after each pulse (Fig. 4.20).",
    )?);
    body.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>time<small>s</small></th><th>error by the sensor\
         <small>nm</small></th><th>in truth<small>nm</small></th><th>next a<sub>1</sub>\
         <small>fsm</small></th><th>expected to move<small>nm</small></th></tr>\n",
    );
    for step in &d.steps {
        let a1 = step
            .a1_fsm
            .map_or_else(|| "-".to_owned(), |a1| format!("{a1:.2}"));
        let _ = writeln!(
            body,
            "<tr><td>{:.3}</td><td>{:.1}</td><td>{:.1}</td><td>{a1}</td><td>{:.1}</td></tr>",
            step.time_s, step.measured_nm, step.error_nm, step.expected_nm
        );
    }
    body.push_str("</table></div>\n");
    from_sides(&mut body, sides)?;
    by_gain(&mut body, gains)?;
    without_loop(&mut body, steps)?;
    Ok(page(&title, &body))
}

fn from_sides(body: &mut String, sides: &[Document]) -> Result<()> {
    body.push_str("<h2>From four sides</h2>\n<div class=\"pair\">\n");
    for half in sides.chunks(4) {
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
        let series: Vec<(&str, Vec<(f64, f64)>)> = named
            .iter()
            .map(|(name, points)| (name.as_str(), points.clone()))
            .collect();
        body.push_str(&plot(
            HALF,
            &series,
            ("time, s", "error, nm"),
            &format!("Estimator: {estimator}; {verdict} (Fig. 4.22)."),
        )?);
    }
    body.push_str("</div>\n");
    Ok(())
}

fn by_gain(body: &mut String, gains: &[Document]) -> Result<()> {
    body.push_str("<h2>Stability</h2>\n<p>On a machine whose response was measured, with \
                   nothing uncertain. The loop is stable for k<sub>c</sub> between 0 and 2 (4.12).</p>\n<div class=\"pair\">\n");
    let name = |d: &Document| format!("k_c = {}", d.gain);
    for half in [&gains[..gains.len() - 2], &gains[gains.len() - 2..]] {
        let named: Vec<(String, Vec<(f64, f64)>)> =
            half.iter().map(|d| (name(d), truth(d))).collect();
        let series: Vec<(&str, Vec<(f64, f64)>)> = named
            .iter()
            .map(|(name, points)| (name.as_str(), points.clone()))
            .collect();
        let last: Vec<String> = half
            .iter()
            .map(|d| format!("{}: {:.1} nm at the end", d.gain, d.error_nm))
            .collect();
        body.push_str(&over_pulses(HALF, &series, "error, nm", &last.join("; "))?);
    }
    body.push_str("</div>\n");
    Ok(())
}

fn without_loop(body: &mut String, steps: &Resolution) -> Result<()> {
    let _ = writeln!(
        body,
        "<h2>Resolution</h2>\n<p>{} pulses forward without any loop, all alike, such as to move \
         the output by {} nm: mean {:.1} nm, deviation {:.1} nm, {:.1} to {:.1} nm.</p>",
        steps.position_nm.len() - 1,
        steps.step_nm,
        steps.mean_nm,
        steps.deviation_nm,
        steps.least_nm,
        steps.greatest_nm
    );
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
    body.push_str("<div class=\"pair\">\n");
    for (points, y, text) in [
        (position, "position, nm", "Position (Figs. 4.23, 4.24)."),
        (single, "displacement, nm", "Displacement by each pulse."),
    ] {
        body.push_str(&over_pulses(HALF, &[("output", points)], y, text)?);
    }
    body.push_str("</div>\n");
    Ok(())
}

fn measured(d: &Document) -> Vec<(f64, f64)> {
    let steps = d.steps.iter().enumerate();
    steps.map(|(k, s)| (k as f64, s.measured_nm)).collect()
}

fn truth(d: &Document) -> Vec<(f64, f64)> {
    let steps = d.steps.iter().enumerate();
    steps.map(|(k, s)| (k as f64, s.error_nm)).collect()
}

fn over_time(d: &Document) -> Vec<(f64, f64)> {
    d.steps.iter().map(|s| (s.time_s, s.error_nm)).collect()
}

fn over_pulses(
    width: u32,
    series: &[(&str, Vec<(f64, f64)>)],
    y: &str,
    caption: &str,
) -> Result<String> {
    plot(width, series, ("pulse", y), caption)
}

fn plot(
    width: u32,
    series: &[(&str, Vec<(f64, f64)>)],
    (x, y): (&str, &str),
    caption: &str,
) -> Result<String> {
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width,
        x: (range_of(all().map(|p| p.0), 0.1), x),
        y: (range_of(all().map(|p| p.1).chain([0.0]), 1.0), y),
    };
    Ok(figure(&curves(&axes, series)?, &escape(caption)))
}

/// The report of many loops as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn pulse_campaign(c: &Campaign, documents: &[Document]) -> Result<String> {
    let title = format!(
        "{} by pulses, {} nm, {} runs from seed {}",
        c.axis, c.target_nm, c.row.runs, c.seed
    );
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    let _ = writeln!(
        body,
        "<p>Estimator {}, condition {}, at most {} pulses: {:.1} % below 10 nm in truth, {:.1} % within \
         {} nm; error {:.1} nm in the median, {:.1} nm at the 90th percentile.</p>",
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
    body.push_str(&figure(
        &bars(
            WHOLE,
            &shown,
            &(-edge..edge),
            60,
            "true error in the end, nm",
            "runs",
        )?,
        &format!(
            "The true error in the end, of all runs; the tolerance is {} nm. What is beyond the figure \
             stands at its edge.",
            c.tolerance_nm
        ),
    ));
    body.push_str(
        "<h2>By estimator and condition</h2>\n<div class=\"scroll\"><table>\n<tr><th>condition</th>\
         <th>estimator</th><th>runs</th><th>below 10 nm<small>%</small></th><th>within tolerance\
         <small>%</small></th><th>error p50<small>nm</small></th><th>p90<small>nm</small></th>\
         <th>pulses p90</th><th>settled p90<small>s</small></th></tr>\n",
    );
    for row in &c.comparison {
        let CampaignRow {
            condition,
            estimator,
            runs,
            error_nm,
            pulses,
            ..
        } = row;
        let settled = row
            .settled_s
            .map_or_else(|| "-".to_owned(), |s| format!("{:.2}", s.p90));
        let _ = writeln!(
            body,
            "<tr><td>{condition}</td><td>{estimator}</td><td>{runs}</td><td>{:.1}</td><td>{:.1}</td>\
             <td>{:.1}</td><td>{:.1}</td><td>{:.0}</td><td>{settled}</td></tr>",
            row.below_10nm_percent,
            row.within_tolerance_percent,
            error_nm.p50,
            error_nm.p90,
            pulses.p90
        );
    }
    body.push_str("</table></div>\n");
    Ok(page(&title, &body))
}
