//! The report of search and peak on a measured map.

use super::figure::{Axes, CURVES, HALF, INK, WHOLE, chart, draw, mesh};
use super::html::{figure, fixed, page, th, verdict};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_model::frames::Displacement;
use pigtail_records::map::{MapDocument, Trial};
use pigtail_sysid::map::{Reading, Scan, Shape};
use plotters::prelude::*;
use std::ops::Range;

/// Most readings that a picture shows one by one.
const POINTS: usize = 12_000;

/// The report as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn scan(scan: &Scan, trial: &Trial) -> Result<String> {
    let document = &trial.document;
    let title = format!("Search and peak on {}", document.map);
    let aligned = document.outcome == "aligned";
    let whole = trial.examined.as_ref().ok().map(|all| all.peak);
    let looked = trial.looked.as_ref();
    let taken = looked.map_or(&[][..], |l| &l.taken);
    let peak = looked.and_then(|l| l.peak);
    let body = html! {
        p {
            span class=(verdict(aligned)) {
                @if aligned { "peak found" }
                @else { (document.outcome) ": " (document.detail) }
            }
            "; " (document.readings_used) " of the map's " (document.readings) " readings were taken"
            @if let Some(n) = document.readings_to_first_light {
                ", " (n) " of them until there was light"
            }
            "."
        }
        (table(document))
        @for note in notes(document) { p { (note) } }
        div.pair {
            (figure(
                &map(scan, whole.as_ref())?,
                "The map as it was measured, from dark to bright, with the ellipse at 1/e of the peak's \
                 height by all of its readings."
            ))
            @if !taken.is_empty() {
                (figure(
                    &way(scan, taken, peak.as_ref())?,
                    "The readings that were taken, in order along the line: from the start outward, and \
                     after first light where a reading tells most about the peak's place. The ellipse is \
                     theirs."
                ))
            }
        }
        @if let Some(shape) = peak {
            (figure(
                &profile(scan, taken, &shape)?,
                "Readings against their distance from the peak, in radii of its ellipse in their \
                 direction: all of the map, and those that were taken (large). The curve is the shape \
                 fitted to the latter."
            ))
        }
    };
    Ok(page(&title, &body))
}

/// What a person should know of the readings.
pub fn notes(document: &MapDocument) -> Vec<String> {
    let mut notes = Vec::new();
    let level = document.fold_level.map_or_else(String::new, |level| {
        format!("{level} {}", document.power_unit)
    });
    let n = document.folded_readings;
    match document.fold {
        Some("clipped") => notes.push(format!(
            "The light is clipped at {level}: {n} readings only say that it was brighter."
        )),
        Some("wrapped") => notes.push(format!(
            "The light wraps around every {level}: {n} readings were unfolded."
        )),
        Some("mirrored_down") => notes.push(format!(
            "Light above {level} comes down again: {n} readings were unfolded."
        )),
        Some("mirrored_up") => notes.push(format!(
            "Light below {level} comes up again, as in a magnitude: {n} readings were unfolded."
        )),
        _ => {}
    }
    match document.readings_apart {
        0 => {}
        1 => notes.push("One reading stands apart from its neighbours and is left out.".to_owned()),
        n => notes.push(format!(
            "{n} readings stand apart from their neighbours and are left out."
        )),
    }
    if let (Some(false), Some(share)) = (document.only_noise_left, document.explained_percent) {
        notes.push(format!(
            "One peak explains {share:.0} % of the map's variance and leaves more than noise: the \
             light has another shape, or was folded unrecognised; its place and widths may be off by \
             more than is said."
        ));
    }
    notes
}

fn table(document: &MapDocument) -> Markup {
    let rows = [
        ("search", document.readings_used, &document.peak),
        ("whole map", document.readings, &document.whole_map),
    ];
    html! {
        div.scroll { table {
            tr {
                th { "by" } th {} th { "readings" }
                (th("x", "um")) (th("y", "um")) (th("known to", "um"))
                (th("width x", "um")) (th("width y", "um")) (th("radius x", "um")) (th("radius y", "um"))
                (th("power", document.power_unit)) (th("dark", document.power_unit))
            }
            @for (name, readings, peak) in rows {
                @if let Some(p) = peak {
                    tr {
                        td { (name) } td {} td { (readings) }
                        @for um in [
                            p.x_um,
                            p.y_um,
                            p.deviation_um,
                            p.widths_um.x,
                            p.widths_um.y,
                            p.radii_um.x,
                            p.radii_um.y,
                        ] {
                            td { (fixed(um, 3)) }
                        }
                        td { (p.power) } td { (p.background) }
                    }
                }
            }
        } }
        p.soft {
            "Widths are full ones at half of the height, radii are at 1/e of it; both along x and y through \
             the peak."
        }
    }
}

/// Axes of one scale around a scan, half a spacing beyond its readings.
fn area(scan: &Scan) -> Axes<'static> {
    let Displacement { x, y } = scan.middle();
    let room = 0.6 * scan.spacing();
    let (w, h) = (scan.half().x + room, scan.half().y + room);
    // The plot area of a half figure is wider than high.
    let aspect = 460.0 / 358.0;
    let half = h.max(w / aspect) * 1e6;
    Axes {
        width: HALF,
        x: (x * 1e6 - aspect * half..x * 1e6 + aspect * half, "x, um"),
        y: (y * 1e6 - half..y * 1e6 + half, "y, um"),
    }
}

/// From dark to bright, 0 to 1.
fn scale(readings: &[Reading]) -> impl Fn(f64) -> f64 {
    let (dark, bright) = readings
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(d, b), r| {
            (d.min(r.power), b.max(r.power))
        });
    move |power| (power - dark) / (bright - dark)
}

fn ellipse(shape: &Shape) -> Vec<(f64, f64)> {
    let (long, short, angle) = shape.ellipse();
    let (sin, cos) = angle.sin_cos();
    (0..=72)
        .map(|k| {
            let (s, c) = (f64::from(k) * 5.0_f64.to_radians()).sin_cos();
            let (u, v) = (long * c, short * s);
            (
                (shape.at.x + u * cos - v * sin) * 1e6,
                (shape.at.y + u * sin + v * cos) * 1e6,
            )
        })
        .collect()
}

const RED: RGBColor = RGBColor(200, 30, 30);

fn map(scan: &Scan, peak: Option<&Shape>) -> Result<Markup> {
    let axes = area(scan);
    let readings = scan.readings();
    let bright = scale(readings);
    let every = readings.len().div_ceil(POINTS);
    let half = 0.5e6 * scan.spacing() * (every as f64).sqrt();
    draw(&axes, |root| {
        let mut chart = chart(&axes, root)?;
        mesh(&axes, &mut chart)?;
        chart.draw_series(readings.iter().step_by(every).map(|r| {
            let (x, y) = (r.at.x * 1e6, r.at.y * 1e6);
            let colour = ViridisRGB.get_color(0.93 * bright(r.power));
            Rectangle::new(
                [(x - half, y - half), (x + half, y + half)],
                colour.filled(),
            )
        }))?;
        if let Some(shape) = peak {
            chart.draw_series(std::iter::once(PathElement::new(
                ellipse(shape),
                RED.stroke_width(2),
            )))?;
        }
        Ok(())
    })
}

fn way(scan: &Scan, taken: &[usize], peak: Option<&Shape>) -> Result<Markup> {
    let axes = area(scan);
    let readings = scan.readings();
    let bright = scale(readings);
    let places: Vec<(f64, f64)> = taken
        .iter()
        .map(|k| (readings[*k].at.x * 1e6, readings[*k].at.y * 1e6))
        .collect();
    draw(&axes, |root| {
        let mut chart = chart(&axes, root)?;
        mesh(&axes, &mut chart)?;
        chart.draw_series(std::iter::once(PathElement::new(
            places.clone(),
            INK.mix(0.25).stroke_width(1),
        )))?;
        chart.draw_series(taken.iter().zip(&places).map(|(k, place)| {
            let colour = ViridisRGB.get_color(0.93 * bright(readings[*k].power));
            Circle::new(*place, 4, colour.filled())
        }))?;
        if let Some(shape) = peak {
            chart.draw_series(std::iter::once(PathElement::new(
                ellipse(shape),
                RED.stroke_width(2),
            )))?;
        }
        Ok(())
    })
}

/// Readings against their distance from the peak in radii.
fn profile(scan: &Scan, taken: &[usize], shape: &Shape) -> Result<Markup> {
    const FAR: f64 = 4.0;
    let readings = scan.readings();
    let at = |r: &Reading| (-shape.share(r.at).ln()).sqrt();
    let every = readings.len().div_ceil(POINTS);
    let all: Vec<(f64, f64)> = readings
        .iter()
        .step_by(every)
        .map(|r| (at(r), r.power))
        .filter(|p| p.0 < FAR)
        .collect();
    let used: Vec<(f64, f64)> = taken
        .iter()
        .map(|k| (at(&readings[*k]), readings[*k].power))
        .filter(|p| p.0 < FAR)
        .collect();
    let curve: Vec<(f64, f64)> = (0..=200)
        .map(|k| FAR * f64::from(k) / 200.0)
        .map(|r| (r, shape.background + shape.height * (-r * r).exp()))
        .collect();
    let power: Range<f64> =
        super::figure::range_of(all.iter().chain(&curve).map(|p| p.1), f64::MIN_POSITIVE);
    let axes = Axes {
        width: WHOLE,
        x: (0.0..FAR, "distance from the peak, radii at 1/e"),
        y: (power, "power"),
    };
    draw(&axes, |root| {
        let mut chart = chart(&axes, root)?;
        mesh(&axes, &mut chart)?;
        let dots = |points: &[(f64, f64)], size: i32, style: ShapeStyle| {
            points
                .iter()
                .map(|p| Circle::new(*p, size, style))
                .collect::<Vec<_>>()
        };
        chart.draw_series(dots(&all, 2, INK.mix(0.3).filled()))?;
        chart.draw_series(dots(&used, 4, CURVES[0].filled()))?;
        chart.draw_series(std::iter::once(PathElement::new(
            curve,
            CURVES[1].stroke_width(2),
        )))?;
        Ok(())
    })
}
