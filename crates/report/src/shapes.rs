//! The report of which pulse is best.

use super::figure::{Axes, HALF, curves, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_evaluate::impulse::contest::Document;
use pigtail_evaluate::impulse::shapes::{Judged, Study};
use pigtail_evaluate::impulse::waveform::Family;
use std::fmt::Write as _;

/// The report of a study of shapes as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn shapes(d: &Document, study: &Study) -> Result<String> {
    let title = format!("Shapes of pulses on {}, seed {}", d.axis, d.seed);
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    let _ = writeln!(
        body,
        "<p>All shapes peak at {:.2} fsm with their highest a<sub>1</sub>. What each may choose was chosen \
         on joints of the plant as it is written, with friction of motor and load (10 %) and the motor's \
         place at rest (a tenth of a count) drawn, in both directions; what stands here is by other draws. \
         Spread is from the 10th to the 90th percentile; nine of ten machines are better than dead zone, \
         least motion, vibration and time to rest. The loops \
         are on {} specimens, with the shape measured through the probe on another; an amplifier that \
         knows sums of sines plays no others.</p>",
        d.peak_fsm, d.runs
    );
    table(&mut body, d);
    body.push_str("<h2>The pulses</h2>\n<div class=\"pair\">\n");
    let sines = |judged: &&Judged| judged.wave.family == Family::Sines;
    let (ours, others): (Vec<&Judged>, Vec<&Judged>) = study.shapes.iter().partition(sines);
    for (group, text) in [(ours, "Sums of sines"), (others, "Other families")] {
        let series: Vec<(&str, Vec<(f64, f64)>)> = group
            .iter()
            .map(|judged| (judged.name, over_time(judged, study.unit)))
            .collect();
        let all = || series.iter().flat_map(|(_, points)| points.iter());
        let axes = Axes {
            width: HALF,
            x: (range_of(all().map(|p| p.0), 0.1), "time, ms"),
            y: (range_of(all().map(|p| p.1), 1.0), "voltage, fsm"),
        };
        let caption = format!(
            "{text}, each such as to move the nominal joint by {:.0} nm.",
            d.at_nm[1]
        );
        body.push_str(&figure(&curves(&axes, &series)?, &caption));
    }
    body.push_str("</div>\n");
    Ok(page(&title, &body))
}

/// A pulse at the middle displacement: milliseconds, and its voltage over the unit.
fn over_time(judged: &Judged, unit: f64) -> Vec<(f64, f64)> {
    const POINTS: u32 = 200;
    let wave = judged.wave.with(judged.merit.amplitude);
    (0..=POINTS)
        .map(|k| {
            let time = wave.period * f64::from(k) / f64::from(POINTS);
            (1e3 * time, wave.voltage(time) / unit)
        })
        .collect()
}

fn table(body: &mut String, d: &Document) {
    let [low, middle, high] = d.at_nm;
    let _ = writeln!(
        body,
        "<div class=\"scroll\"><table>\n<tr><th>shape</th><th>a<sub>2</sub>, a<sub>3</sub>, \
         a<sub>4</sub><small>fsm</small></th><th>T<small>ms</small></th>\
         <th>spread at {low:.0}, {middle:.0}, {high:.0} nm<small>nm</small></th>\
         <th>over that<small>%</small></th><th>dead zone<small>fsm</small></th>\
         <th>least<small>nm</small></th><th>vibration<small>nm</small></th>\
         <th>at rest<small>ms</small></th></tr>"
    );
    for s in &d.shapes {
        let [a, b, c] = s.spread_nm;
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{:.2}, {:.2}, {:.2}</td><td>{:.2}</td><td>{a:.1}, {b:.1}, {c:.1}</td>\
             <td>{:.0}</td><td>{:.2}</td><td>{:.1}</td><td>{:.1}</td><td>{:.1}</td></tr>",
            s.shape,
            s.a2_fsm,
            s.a3_fsm,
            s.a4_fsm,
            s.period_ms,
            s.spread_percent,
            s.dead_zone_fsm,
            s.least_nm,
            s.vibration_nm,
            s.rest_ms
        );
    }
    body.push_str("</table></div>\n");
    let _ = writeln!(
        body,
        "<h2>Loops of {:.0} nm</h2>\n<p>How many end within tolerance by the curve as it was measured, \
         and with one that every pulse corrects, of which pulses and time are.</p>\n<div \
         class=\"scroll\"><table>\n<tr><th>shape</th><th>reach<small>nm</small></th>\
         <th>as measured<small>%</small></th><th>corrected<small>%</small></th><th>pulses p90</th>\
         <th>settled p90<small>s</small></th></tr>",
        d.target_nm
    );
    for s in &d.shapes {
        let loops = s.loops.map_or_else(
            || "<td>-</td><td>-</td><td>-</td><td>-</td>".to_owned(),
            |l| {
                let settled = l
                    .settled_p90_s
                    .map_or_else(|| "-".to_owned(), |s| format!("{s:.2}"));
                format!(
                    "<td>{:.1}</td><td>{:.1}</td><td>{:.0}</td><td>{settled}</td>",
                    l.fixed_within_percent, l.within_tolerance_percent, l.pulses_p90
                )
            },
        );
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td>{:.0}</td>{loops}</tr>",
            s.shape, s.reach_nm
        );
    }
    body.push_str("</table></div>\n");
}
