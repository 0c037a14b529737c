//! The report of light throughput maximization.

use super::figure::{Axes, WHOLE, curves, envelope};
use super::html::{self, figure, fixed, number, page};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::maximize::{CIRCLES, MaximizationDocument, Measured, Tracking};

/// A table for a terminal or a page: a title, a header and rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    /// What it is about.
    pub title: &'static str,
    /// The header, units below names, and the rows.
    pub rows: Vec<Vec<String>>,
}

/// The tables of a document.
pub fn tables(document: &MaximizationDocument) -> Vec<Table> {
    let header = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let mut tracking = vec![header(&[
        "means",
        "step\num",
        "dwell\nms",
        "pause\nms",
        "by formula\num/s",
        "followed\num/s",
        "lost\num/s",
    ])];
    tracking.extend(document.tracking.iter().map(|t| {
        vec![
            t.means.to_owned(),
            number(t.step_um, 2),
            number(t.dwell_ms, 1),
            number(t.pause_ms, 1),
            number(t.closed_form_um_s, 2),
            number(Some(t.limit_um_s), 2),
            number(t.lost_um_s, 2),
        ]
    }));
    let mut rejection = vec![header(&[
        "moves",
        "means",
        "by\num",
        "within\ns",
        "at the end off\num",
        "light then\n%",
        "on average\n%",
    ])];
    rejection.extend(document.rejection.iter().map(|r| {
        vec![
            r.disturbance.to_owned(),
            r.means.to_owned(),
            number(Some(r.disturbance_um), 0),
            number(Some(r.seconds), 0),
            number(r.offset_um, 3),
            number(Some(r.light_percent), 1),
            number(Some(r.mean_light_percent), 1),
        ]
    }));
    let mut timing = vec![header(&["part", "printed\ns", "thesis\ns", "fast\ns"])];
    timing.extend(document.timing.iter().map(|t| {
        vec![
            t.part.to_owned(),
            t.printed.unwrap_or("-").to_owned(),
            number(Some(t.thesis), 2),
            number(Some(t.fast), 2),
        ]
    }));
    vec![
        Table {
            title: "How fast a peak may drift",
            rows: tracking,
        },
        Table {
            title: "What is left of other motion",
            rows: rejection,
        },
        Table {
            title: "Seconds a fiber (3.4)",
            rows: timing,
        },
    ]
}

/// The report as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn maximize(measured: &Measured) -> Result<String> {
    let document = &measured.document;
    let title = format!("Maximization on {}, seed {}", document.rig, document.seed);
    let pictures = html! {
        (figure(
            &lag(&document.tracking),
            "How far the fiber trails a peak that drifts, in truth, against the drift's speed as a share \
             of what the means should follow (circles: of what was tried). Curves end where it no longer \
             trails steadily."
        ))
        (figure(
            &light(measured),
            "Light while the peak drifts, nine-point patterns of the first row following it: every pattern \
             looks around, so the light is never steady; beyond a step a pattern it is lost."
        ))
    };
    let body = html! {
        @for (k, table) in tables(document).iter().enumerate() {
            h2 { (table.title) }
            @if let Some((header, rows)) = table.rows.split_first() { (html::table(header, rows)) }
            @if k == 0 { (pictures) }
        }
        @if let Some(a) = document.approach {
            h2 { "The way in z" }
            p {
                "The gap closed by " (fixed(a.way_um, 1)) " um in " (fixed(a.seconds, 2))
                " s; meanwhile the peak walked " (fixed(a.walk_um, 2))
                " um aside, for light leaves the inclined facet at an angle (" (fixed(a.expected_um, 2))
                " um by design), at " (fixed(a.walk_um_s, 2)) " um/s, and the climb went with it."
            }
        }
        p.soft {
            "Times are means over " (document.devices) " devices, inputs and outputs together."
        }
    };
    Ok(page(&title, &body))
}

fn lag(tracking: &[Tracking]) -> Markup {
    let named: Vec<(String, Vec<(f64, f64)>)> = tracking
        .iter()
        .map(|t| {
            let about = t.closed_form_um_s.unwrap_or(CIRCLES * 1e6);
            let name = t.step_um.map_or_else(
                || t.means.to_owned(),
                |step| format!("{} {step} um", t.means),
            );
            let points = t
                .trials
                .iter()
                .take_while(|d| d.followed)
                .filter_map(|d| Some((d.speed_um_s / about, d.lag_um?)))
                .collect();
            (name, points)
        })
        .collect();
    let all = || named.iter().flat_map(|(_, points)| points);
    let top = all().fold(0.5, |top: f64, p| top.max(p.1));
    let fastest = all().fold(1.0, |fastest: f64, p| fastest.max(p.0));
    let axes = Axes {
        width: WHOLE,
        x: (
            0.0..1.05 * fastest,
            "drift, share of what should be followed",
        ),
        y: (0.0..1.1 * top, "lag, um"),
    };
    let all: Vec<(&str, Vec<(f64, f64)>)> = named
        .iter()
        .map(|(name, points)| (name.as_str(), points.clone()))
        .collect();
    curves(&axes, &all)
}

fn light(measured: &Measured) -> Markup {
    let all: Vec<(&str, Vec<(f64, f64)>)> = measured
        .curves
        .iter()
        .map(|(name, points)| (name.as_str(), envelope(points, 400)))
        .collect();
    let end = all
        .iter()
        .filter_map(|(_, points)| points.last())
        .fold(1.0, |end: f64, p| end.max(p.0));
    let axes = Axes {
        width: WHOLE,
        x: (0.0..end, "time since the peak began to drift, s"),
        y: (0.0..110.0, "light, % of before"),
    };
    curves(&axes, &all)
}
