//! The report of the reproduced thesis: a section a chapter, every figure with its claims.

use super::accounts::{changes, drawn, summary};
use super::figure::{Axes, HALF, WHOLE, all as with_curves, bars, decades_of, range_of};
use super::html::{figure, page_with_style, prose, verdict};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_reproduce::claims::{Claim, Group};
use pigtail_reproduce::errata::Erratum;
use pigtail_reproduce::picture::{Content, Picture};
use pigtail_reproduce::{Figure, Reproduction, chapter};
use std::ops::Range;

/// Chapters and what they are about.
const CHAPTERS: [(&str, &str); 3] = [
    ("2", "Control of the macro manipulator"),
    ("3", "Path planning"),
    ("4", "Nonlinear control methods"),
];

/// Figures as wide as the page, tables as cards on a narrow one, and no page without its heading in
/// print.
const STYLE: &str = "
h3 { font-size: 1.05rem; margin: 2rem 0 .25rem; break-after: avoid; }
.claims { width: 100%; font-size: .92rem; table-layout: fixed; }
.claims th.number { width: 6.4em; } .claims th.tolerance { width: 8.6em; } .claims th.mark { width: 6.6em; }
.claims .soft { display: block; }
.claims a { color: var(--ink); }
.claims th, .claims td { white-space: normal; vertical-align: top; text-align: left; }
.claims td.number, .claims th.number { text-align: right; white-space: nowrap; }
.claims tr { break-inside: avoid; }
.claims q { color: var(--soft); font-style: italic; display: block; }
.claims .basis { display: block; font-size: .96em; color: var(--soft); }
.claims .basis b { color: var(--ink); font-weight: 600; }
.mark { white-space: nowrap; }
.accounts { margin: 1rem 0; } .accounts td:first-child { white-space: normal; max-width: 44rem; }
.accounts .part td:first-child { padding-left: 1.6rem; } .accounts tr.all td { border-top: 1px solid var(--ink); }
.accounts td { text-align: left; vertical-align: top; } .accounts td.number { text-align: right; white-space: nowrap; }
.accounts b { font-size: 1.15em; }
.claims th.when { width: 10.5em; } .claims th.what { width: 6em; } .claims th.result { width: 8.6em; }
nav { margin: 1rem 0; line-height: 1.9; }
nav a { color: var(--ink); margin-right: .35rem; }
dl.tolerances dt { font-weight: 600; } dl.tolerances dd { margin: 0 0 .4rem 1rem; }
@media screen and (max-width: 46rem) {
  .claims thead { display: none; }
  .claims, .claims tbody, .claims tr, .claims td { display: block; width: 100%; }
  .claims tr { border-bottom: 1px solid var(--line); padding: .5rem 0; }
  .claims td, .claims td.number { border: 0; padding: .1rem 0; text-align: left; white-space: normal; }
  .claims td[data-of]::before { content: attr(data-of) ': '; color: var(--soft); }
}
@media print {
  h2 { break-before: auto; } nav { display: none; }
  .pair { grid-template-columns: 1fr 1fr; } .claims { font-size: 8.5pt; break-inside: auto; }
}
";

/// The report as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn thesis(made: &Reproduction) -> Result<String> {
    let d = &made.document;
    let title = format!("The thesis on the twin, rig {}, seed {}", d.rig, d.seed);
    let of = |number: &str| -> Vec<&Figure> {
        made.figures
            .iter()
            .filter(|f| chapter(f.id) == number)
            .collect()
    };
    let chapters: Vec<Chapter> = CHAPTERS
        .into_iter()
        .map(|(number, name)| (number, name, of(number)))
        .filter(|(.., figures)| !figures.is_empty())
        .collect();
    let failed: Vec<&Claim> = d.claims.iter().filter(|c| !c.holds).collect();
    let body = html! {
        (summary(d))
        (contents(&chapters, d.accounts.changed.of > 0, d.specimens.is_some()))
        @if !failed.is_empty() {
            h2 { "What does not hold" }
            (table(&failed, true))
        }
        @if let Some(specimens) = &d.specimens { (drawn(specimens, &d.claims)) }
        @for (number, name, figures) in &chapters {
            h2 id={ "chapter" (number) } { (number) ". " (name) }
            @for f in figures { (one(f, &d.claims)) }
        }
        (changes(&d.accounts))
        (errata(&made.errata))
    };
    Ok(page_with_style(&title, STYLE, &body))
}

/// A chapter's number, what it is about, and its figures.
type Chapter<'a> = (&'static str, &'static str, Vec<&'a Figure>);

fn contents(chapters: &[Chapter], changed: bool, drawn: bool) -> Markup {
    html! {
        nav {
            @for (number, name, figures) in chapters {
                p {
                    a href={ "#chapter" (number) } { (number) ". " (name) }
                    br;
                    @for f in figures {
                        a href={ "#f" (f.id) } title=(f.title) { (f.id) } " "
                    }
                }
            }
            p {
                @if changed { a href="#changed" { "Changed after a result" } " · " }
                @if drawn { a href="#drawn" { "Drawn machines" } " · " }
                a href="#errata" { "Slips in the thesis" }
            }
        }
    }
}

pub(super) fn label(id: &str) -> &'static str {
    if id.contains('.') { "Fig. " } else { "" }
}

/// The figure to which a claim belongs.
fn figure_of(claim: &Claim) -> &str {
    claim.id.split('-').next().unwrap_or(claim.id)
}

/// A figure: pictures, what to say of them, claims.
fn one(f: &Figure, claims: &[Claim]) -> Markup {
    let claims: Vec<&Claim> = claims.iter().filter(|c| figure_of(c) == f.id).collect();
    // One curve alone has the whole page; a map and a path keep their form.
    let alone = matches!(&f.pictures[..], [one] if !one.equal && !matches!(one.content, Content::Cells(..)));
    let width = if alone { WHOLE } else { HALF };
    html! {
        h3 id={ "f" (f.id) } { (label(f.id)) (f.id) " " (f.title) }
        @if !f.pictures.is_empty() {
            div class=(if alone { "one" } else { "pair" }) {
                @for (k, picture) in f.pictures.iter().enumerate() {
                    (figure(&svg(picture, &printed(&claims, k), width), &picture.caption))
                }
            }
        }
        @if !f.remark.is_empty() { p { (prose(&f.remark)) } }
        @if !claims.is_empty() { (table(&claims, false)) }
    }
}

/// Claims beside results; `linked` where they do not stand below their figure.
fn table(claims: &[&Claim], linked: bool) -> Markup {
    html! {
        table.claims {
            thead { tr {
                th { "claim" }
                th.number { "thesis" }
                th.number { "ours" }
                th.tolerance { "tolerance" }
                th.mark {}
            } }
            tbody {
                @for c in claims { (row(c, linked)) }
            }
        }
    }
}

fn row(c: &Claim, linked: bool) -> Markup {
    let with_unit = |value: f64| {
        if c.unit.is_empty() {
            value.to_string()
        } else {
            format!("{value} {}", c.unit)
        }
    };
    let ours = c.ours.map_or_else(|| "-".to_owned(), with_unit);
    let mark = match (c.holds, c.explained) {
        (true, _) => "holds",
        (false, true) => "fails, explained",
        (false, false) => "fails",
    };
    html! {
        tr {
            td {
                @if linked {
                    @let id = figure_of(c);
                    a href={ "#f" (id) } { (label(id)) (id) } ": "
                }
                (c.quantity)
                @if !c.note.is_empty() { " " span.soft { (c.note) } }
                q { (c.quote) " (" (c.section) ")" }
                span.basis { (basis(c)) }
            }
            td.number data-of="thesis" { (c.tolerance_sign()) (with_unit(c.thesis)) }
            td.number data-of="ours" { (ours) }
            td data-of="tolerance" { (c.tolerance) }
            td.mark.(verdict(c.holds)) { (mark) }
        }
    }
}

/// What a claim rests on, and where it says what was changed of it.
fn basis(c: &Claim) -> Markup {
    html! {
        b { (c.basis.name()) }
        @if c.in_doubt { ", in doubt" }
        @if let Some(why) = c.fitted.or(c.by_construction) { ": " (why) }
        @if c.basis == Group::Prediction && c.changes.is_empty() { ", never changed" }
        @if !c.changes.is_empty() {
            " · " a href={ "#changed-" (c.id) } { "changed after a result was seen" }
        }
    }
}

fn errata(errata: &[Erratum]) -> Markup {
    html! {
        h2 #errata { "Slips in the thesis" }
        p { "Found by working through it." }
        @for e in errata {
            h3 { (e.title) }
            p { "Printed: " i { (e.printed) } }
            p { (e.argument) }
            @if !e.computed.is_empty() { p.soft { "Computed: " (e.computed) } }
        }
    }
}

/// Where a printed number has a place in a picture: its claim, which of the figure's pictures, the axis, and what it
/// is there. The picture's axis has the claim's unit.
const PRINTED: [(&str, usize, char, &str); 10] = [
    ("2.4-settling", 0, 'x', "settled"),
    ("2.5-settling", 0, 'x', "settled"),
    ("2.24-moves", 0, 'x', "mean"),
    ("2.25-resolution", 0, 'x', "largest"),
    ("2.26-resolution", 0, 'x', "largest"),
    ("4.6-first", 0, 'x', "largest"),
    ("4.6-highest", 0, 'x', "highest"),
    ("4.16-displacement", 0, 'y', "displacement"),
    ("4.17-second", 0, 'y', "no dead zone"),
    ("4.21-second", 0, 'y', "no dead zone"),
];

/// What the thesis prints of what the `k`th picture shows, by the claims of its figure.
fn printed(claims: &[&Claim], k: usize) -> Vec<(char, f64, String)> {
    let value = |id: &str| claims.iter().find(|c| c.id == id).map(|c| c.thesis);
    let of = PRINTED.iter().filter(|(_, picture, ..)| *picture == k);
    of.filter_map(|(id, _, axis, what)| {
        let value = value(id)?;
        Some((*axis, value, format!("thesis: {what} {value}")))
    })
    .collect()
}

/// A picture as SVG, with what is printed of it.
pub(crate) fn svg(picture: &Picture, printed: &[(char, f64, String)], width: u32) -> Markup {
    let all: Vec<(f64, f64)> = match &picture.content {
        Content::Curves(curves) => curves.iter().flat_map(|(_, p)| p.iter().copied()).collect(),
        Content::Bars(values, _) => values.iter().map(|v| (*v, 0.0)).collect(),
        Content::Cells(points, _) | Content::Dots(points) => {
            points.iter().map(|p| (p.0, p.1)).collect()
        }
    };
    let range = |ends: Option<(f64, f64)>, values: &mut dyn Iterator<Item = f64>| -> Range<f64> {
        ends.map_or_else(
            || {
                let range = range_of(values, 0.0);
                if range.start < range.end {
                    range
                } else {
                    range.start - 0.5..range.start + 0.5
                }
            },
            |(from, to)| from..to,
        )
    };
    let upward = |ends: Option<(f64, f64)>| {
        if picture.log_y && ends.is_none() {
            decades_of(all.iter().map(|p| p.1))
        } else {
            range(ends, &mut all.iter().map(|p| p.1))
        }
    };
    let axes = Axes {
        width,
        x: (
            range(picture.x.1, &mut all.iter().map(|p| p.0)),
            picture.x.0,
        ),
        y: (upward(picture.y.1), picture.y.0),
    };
    let plot = || {
        let plot = Plot::new(&axes).scaled(picture.log_y, printed);
        if picture.equal { plot.equal() } else { plot }
    };
    match &picture.content {
        Content::Curves(named) => {
            let named: Vec<(&str, Vec<(f64, f64)>)> = named
                .iter()
                .map(|(name, points)| (name.as_str(), points.clone()))
                .collect();
            with_curves(plot(), &named).draw()
        }
        Content::Bars(values, count) => {
            let bars = bars(width, values, &axes.x.0, *count, picture.x.0, picture.y.0);
            bars.scaled(picture.log_y, printed).draw()
        }
        Content::Cells(points, (width, height)) => {
            let boxes: Vec<_> = points
                .iter()
                .map(|&(x, y, v)| ([(x - width, y - height), (x, y)], v))
                .collect();
            plot()
                .colour(0.0, 1.0, picture.colour, false)
                .shaded_boxes("", &boxes)
                .draw()
        }
        Content::Dots(points) if picture.colour.is_empty() => {
            let places: Vec<_> = points.iter().map(|p| (p.0, p.1)).collect();
            plot().dots("", "", &places).draw()
        }
        Content::Dots(points) => plot()
            .colour(0.0, 1.0, picture.colour, false)
            .shaded_dots("", "small", points)
            .draw(),
    }
}
