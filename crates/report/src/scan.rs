//! The report of search and peak on a measured map.

use super::figure::{Axes, HALF, WHOLE};
use super::html::{figure, fixed, page, th, verdict};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_model::frames::Displacement;
use pigtail_records::map::{MapDocument, Trial};
use pigtail_sysid::map::{Reading, Scan, Shape};
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
    let units = (document.power_unit, document.place_unit);
    let body = html! {
        p.soft { "Read: " (document.read) "." }
        p {
            span class=(verdict(aligned)) {
                @if aligned { "peak found" }
                @else { (document.outcome) ": " (document.detail) }
            }
            @if !taken.is_empty() {
                "; " (document.readings_used) " of the map's " (document.readings) " readings were taken"
            }
            @if let Some(n) = document.readings_to_first_light {
                ", " (n) " of them until there was light"
            }
            "."
        }
        @if document.peak.is_some() || document.whole_map.is_some() { (table(document)) }
        @for note in notes(document) { p { (note) } }
        div.pair {
            (figure(
                &map(scan, whole.as_ref(), units),
                if whole.is_some() {
                    "The map as it was measured, from dark to bright, with the ellipse at 1/e of the peak's \
                     height by all of its readings."
                } else {
                    "The map as it was measured, from dark to bright."
                }
            ))
            @if !taken.is_empty() {
                (figure(
                    &way(scan, taken, peak.as_ref(), units),
                    "The readings that were taken, in order along the line: from the start outward, and \
                     after first light where a reading tells most about the peak's place. The ellipse is \
                     theirs."
                ))
            }
        }
        @if let Some(shape) = peak {
            (figure(
                &profile(scan, taken, &shape),
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
    /// Lines that differ by less, percent, are no more than shapes are unlike.
    const NOTICEABLE: f64 = 3.0;
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
    if let Some(by) = document.deviation_by_readings_um {
        let unit = document.place_unit;
        notes.push(format!(
            "By its readings alone the peak of the whole map is known to {by:.4} {unit}; what is said allows for light that changes by a quarter while \
             it is scanned, which no map tells from a peak elsewhere. Nor does a stage leave a mark that slips where it is dark: the peak is where it was \
             before, or since."
        ));
    }
    if let Some(late) = document.a_reading_late_um
        && late > 0.0
    {
        let unit = document.place_unit;
        notes.push(format!(
            "All of its lines go one way: were powers written a reading late, the peak would be {late:.3} {unit} elsewhere along them, and no such map \
             shows that. What is said does not allow for it; a map to and fro would tell."
        ));
    }
    if let Some(light) = document.unsteady_light_percent
        && light > NOTICEABLE
    {
        notes.push(format!(
            "Rows and columns do not fit each other: light differs by {light:.0} % from line to line, as a laser that wanders or a stage that slips \
             makes it; what is said allows for that."
        ));
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
    let place = document.place_unit;
    let rows = [
        ("search", document.readings_used, &document.peak),
        ("whole map", document.readings, &document.whole_map),
    ];
    html! {
        div.scroll { table {
            tr {
                th { "by" } th { "readings" }
                (th("x", place)) (th("y", place)) (th("known to", place))
                (th("width x", place)) (th("width y", place)) (th("radius x", place)) (th("radius y", place))
                (th("power", document.power_unit)) (th("dark", document.power_unit))
            }
            @for (name, readings, peak) in rows {
                @if let Some(p) = peak {
                    tr {
                        td { (name) } td { (readings) }
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

/// A plot of one scale around a scan, half a spacing beyond its readings, with the colours of its powers.
fn area(scan: &Scan, (unit, place): (&str, &str)) -> Plot {
    let (across, up) = (format!("x, {place}"), format!("y, {place}"));
    let Displacement { x, y } = scan.middle();
    let room = 0.6 * scan.spacing();
    let (w, h) = (scan.half().x + room, scan.half().y + room);
    let axes = Axes {
        width: HALF,
        x: ((x - w) * 1e6..(x + w) * 1e6, &across),
        y: ((y - h) * 1e6..(y + h) * 1e6, &up),
    };
    let (dark, bright) = scan
        .readings()
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(d, b), r| {
            (d.min(r.power), b.max(r.power))
        });
    Plot::new(&axes)
        .equal()
        .colour(dark, bright, &format!("power, {unit}"), false)
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

fn map(scan: &Scan, peak: Option<&Shape>, unit: (&str, &str)) -> Markup {
    let readings = scan.readings();
    let every = readings.len().div_ceil(POINTS);
    let half = 0.5e6 * scan.spacing() * (every as f64).sqrt();
    let cells: Vec<_> = readings
        .iter()
        .step_by(every)
        .map(|r| {
            let (x, y) = (r.at.x * 1e6, r.at.y * 1e6);
            ([(x - half, y - half), (x + half, y + half)], r.power)
        })
        .collect();
    with_ellipse(area(scan, unit).shaded_boxes("reading", &cells), peak).draw()
}

fn with_ellipse(plot: Plot, peak: Option<&Shape>) -> Plot {
    match peak {
        Some(shape) => plot.line_as("ellipse at 1/e", "limit", &ellipse(shape)),
        None => plot,
    }
}

fn way(scan: &Scan, taken: &[usize], peak: Option<&Shape>, unit: (&str, &str)) -> Markup {
    let readings = scan.readings();
    let places: Vec<(f64, f64)> = taken
        .iter()
        .map(|k| (readings[*k].at.x * 1e6, readings[*k].at.y * 1e6))
        .collect();
    let dots: Vec<_> = taken
        .iter()
        .zip(&places)
        .map(|(k, place)| (place.0, place.1, readings[*k].power))
        .collect();
    let plot = area(scan, unit)
        .line_as("their order", "faint thin", &places)
        .shaded_dots("readings taken", "large", &dots);
    with_ellipse(plot, peak).draw()
}

/// Readings against their distance from the peak in radii.
fn profile(scan: &Scan, taken: &[usize], shape: &Shape) -> Markup {
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
    Plot::new(&axes)
        .line_as("the shape fitted to those taken", "c1", &curve)
        .dots_as("taken", "c0 large", &used)
        .dots_as("all of the map", "ink small", &all)
        .draw()
}
