//! The report of which pulse is best.

use super::figure::{Axes, HALF, curves, range_of};
use super::html::{figure, fixed, number, page, th};
use super::impulse::a;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::impulse::contest::ShapesDocument;
use pigtail_evaluate::impulse::shapes::{Judged, Study};
use pigtail_evaluate::impulse::waveform::Family;

/// The report of a study of shapes as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn shapes(d: &ShapesDocument, study: &Study) -> Result<String> {
    let title = format!("Shapes of pulses on {}, seed {}", d.axis, d.seed);
    let sines = |judged: &&Judged| judged.wave.family == Family::Sines;
    let (ours, others): (Vec<&Judged>, Vec<&Judged>) = study.shapes.iter().partition(sines);
    let caption = |text: &str| {
        let nm = d.at_nm[1];
        format!("{text}, each such as to move the nominal joint by {nm:.0} nm.")
    };
    let body = html! {
        p {
            "All shapes peak at " (fixed(d.peak_fsm, 2)) " fsm with their highest " (a(1)) ". What each may \
             choose was chosen on joints of the plant as it is written, with friction of motor and load \
             (10 %) and the motor's place at rest (a tenth of a count) drawn, in both directions; what \
             stands here is by other draws. Spread is from the 10th to the 90th percentile; nine of ten \
             machines are better than dead zone, least motion, vibration and time to rest. The loops are \
             on " (d.runs) " specimens, with the shape measured through the probe on another; an \
             amplifier that knows sums of sines plays no others."
        }
        (merits(d))
        (loops(d))
        h2 { "The pulses" }
        div.pair {
            (figure(&voltages(&ours, study.unit), caption("Sums of sines")))
            (figure(&voltages(&others, study.unit), caption("Other families")))
        }
    };
    Ok(page(&title, &body))
}

/// Pulses of a group over time.
fn voltages(group: &[&Judged], unit: f64) -> Markup {
    let series: Vec<(&str, Vec<(f64, f64)>)> = group
        .iter()
        .map(|judged| (judged.name, over_time(judged, unit)))
        .collect();
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: HALF,
        x: (range_of(all().map(|p| p.0), 0.1), "time, ms"),
        y: (range_of(all().map(|p| p.1), 1.0), "voltage, fsm"),
    };
    curves(&axes, &series)
}

/// A pulse at the middle displacement: milliseconds, and its voltage over the unit.
fn over_time(judged: &Judged, unit: f64) -> Vec<(f64, f64)> {
    let played = judged.played(200);
    played
        .map(|(time, volts)| (1e3 * time, volts / unit))
        .collect()
}

/// What each shape is and does.
fn merits(d: &ShapesDocument) -> Markup {
    let [low, middle, high] = d.at_nm;
    let three =
        |[a, b, c]: [f64; 3], digits| [a, b, c].map(|value| fixed(value, digits)).join(", ");
    html! {
        div.scroll { table {
            tr {
                th { "shape" }
                (th(html! { (a(2)) ", " (a(3)) ", " (a(4)) }, "fsm"))
                (th("T", "ms"))
                (th(format!("spread at {low:.0}, {middle:.0}, {high:.0} nm"), "nm"))
                (th("over that", "%")) (th("dead zone", "fsm")) (th("least", "nm"))
                (th("vibration", "nm")) (th("at rest", "ms"))
            }
            @for s in &d.shapes {
                tr {
                    td { (s.shape) }
                    td { (three([s.a2_fsm, s.a3_fsm, s.a4_fsm], 2)) }
                    td { (fixed(s.period_ms, 2)) }
                    td { (three(s.spread_nm, 1)) }
                    td { (fixed(s.spread_percent, 0)) }
                    td { (fixed(s.dead_zone_fsm, 2)) }
                    td { (fixed(s.least_nm, 1)) }
                    td { (fixed(s.vibration_nm, 1)) }
                    td { (fixed(s.rest_ms, 1)) }
                }
            }
        } }
    }
}

/// How well each shape closes a loop.
fn loops(d: &ShapesDocument) -> Markup {
    html! {
        h2 { "Loops of " (fixed(d.target_nm, 0)) " nm" }
        p {
            "How many end within tolerance by the curve as it was measured, and with one that every pulse \
             corrects, of which pulses and time are."
        }
        div.scroll { table {
            tr {
                th { "shape" } (th("reach", "nm")) (th("as measured", "%")) (th("corrected", "%"))
                th { "pulses p90" } (th("settled p90", "s"))
            }
            @for s in &d.shapes {
                tr {
                    td { (s.shape) }
                    td { (fixed(s.reach_nm, 0)) }
                    @if let Some(l) = &s.loops {
                        td { (fixed(l.fixed_within_percent, 1)) }
                        td { (fixed(l.within_tolerance_percent, 1)) }
                        td { (fixed(l.pulses_p90, 0)) }
                        td { (number(l.settled_p90_s, 2)) }
                    } @else {
                        @for _ in 0..4 { td { "-" } }
                    }
                }
            }
        } }
    }
}
