//! The report of the reproduced thesis: a section a chapter, every figure with its claims.

use super::figure::{Axes, HALF, bars, cells, curves, dots, range_of};
use super::html::{figure, fixed, page_with_style, verdict};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_reproduce::claims::{Claim, Kind};
use pigtail_reproduce::errata::Erratum;
use pigtail_reproduce::picture::{Content, Picture};
use pigtail_reproduce::{Figure, Reproduction, ReproductionDocument, chapter};
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
figure { overflow: visible; break-inside: avoid; }
figure svg { min-width: 0; }
h3 { font-size: 1.05rem; margin: 2rem 0 .25rem; break-after: avoid; }
.claims { width: 100%; font-size: .92rem; table-layout: fixed; }
.claims th.number { width: 6.4em; } .claims th.tolerance { width: 8.6em; } .claims th.mark { width: 6.6em; }
.claims .soft { display: block; }
.claims a { color: var(--ink); }
.claims th, .claims td { white-space: normal; vertical-align: top; text-align: left; }
.claims td.number, .claims th.number { text-align: right; white-space: nowrap; }
.claims tr { break-inside: avoid; }
.claims q { color: var(--soft); font-style: italic; display: block; }
.mark { white-space: nowrap; }
nav { margin: 1rem 0; line-height: 1.9; }
nav a { color: var(--ink); margin-right: .35rem; }
.pair figure { max-width: 36rem; }
dl.tolerances dt { font-weight: 600; } dl.tolerances dd { margin: 0 0 .4rem 1rem; }
@media screen and (max-width: 46rem) {
  .claims thead { display: none; }
  .claims, .claims tbody, .claims tr, .claims td { display: block; width: 100%; }
  .claims tr { border-bottom: 1px solid var(--line); padding: .5rem 0; }
  .claims td, .claims td.number { border: 0; padding: .1rem 0; text-align: left; white-space: normal; }
  .claims td[data-of]::before { content: attr(data-of) ': '; color: var(--soft); }
  .pair svg text { font-size: 14px; }
}
@media print {
  body { font-size: 10pt; padding: 0; } h2 { break-before: page; } nav, details { display: none; }
  .pair { grid-template-columns: 1fr 1fr; } .claims { font-size: 8.5pt; }
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
        (contents(&chapters))
        @if !failed.is_empty() {
            h2 { "What does not hold" }
            (table(&failed, true))
        }
        @for (number, name, figures) in &chapters {
            h2 id={ "chapter" (number) } { (number) ". " (name) }
            @for f in figures { (one(f, &d.claims)?) }
        }
        (errata(&made.errata))
    };
    Ok(page_with_style(&title, STYLE, &body))
}

/// A chapter's number, what it is about, and its figures.
type Chapter<'a> = (&'static str, &'static str, Vec<&'a Figure>);

fn summary(d: &ReproductionDocument) -> Markup {
    html! {
        p {
            b { (d.held) " of " (d.of) " claims hold" }
            ": " (d.predicted) " of " (d.of_predicted) " predictions, and " (d.held - d.predicted) " of "
            (d.of - d.of_predicted) " for which numbers of the rig's plant or of an experiment were chosen \
            and which therefore prove nothing (marked ◊). "
            @if d.quick { "A quick run: fewer steps, devices and runs. " }
            "Took " (fixed(d.seconds, 0)) " s."
        }
        p {
            @if d.specimen {
                "The machine is a specimen that the seed drew; what the thesis simulated is simulated on \
                 the one in the middle."
            } @else {
                "The machine is the thesis's, in the middle of its make: the rig's plant for what was \
                 simulated, with what its measured.toml changes for what was measured; the seed drew \
                 device, fixture and noise."
            }
            " Measured is what encoders, probes and photodiodes tell, by the control code of a real run. \
             No other number was fitted to the figure with which it is compared."
        }
        details {
            summary { "How near a result must come" }
            p { "Chosen before any result, by the kind of the claim." }
            dl.tolerances {
                @for kind in Kind::ALL {
                    dt { (kind.tolerance()) } dd { (kind.reason()) }
                }
            }
        }
    }
}

fn contents(chapters: &[Chapter]) -> Markup {
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
            p { a href="#errata" { "Slips in the thesis" } }
        }
    }
}

fn label(id: &str) -> &'static str {
    if id.contains('.') { "Fig. " } else { "" }
}

/// The figure to which a claim belongs.
fn figure_of(claim: &Claim) -> &str {
    claim.id.split('-').next().unwrap_or(claim.id)
}

/// A figure: pictures, what to say of them, claims.
fn one(f: &Figure, claims: &[Claim]) -> Result<Markup> {
    let claims: Vec<&Claim> = claims.iter().filter(|c| figure_of(c) == f.id).collect();
    Ok(html! {
        h3 id={ "f" (f.id) } { (label(f.id)) (f.id) " " (f.title) }
        @if !f.pictures.is_empty() {
            div.pair {
                @for picture in &f.pictures { (figure(&svg(picture)?, &picture.caption)) }
            }
        }
        @if !f.remark.is_empty() { p { (f.remark) } }
        @if !claims.is_empty() { (table(&claims, false)) }
    })
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
    let sign = match c.kind {
        "below" => "< ",
        "above" => "> ",
        _ => "",
    };
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
                @if c.calibrated { " ◊" }
                @if !c.note.is_empty() { " " span.soft { (c.note) } }
                q { (c.quote) " (" (c.section) ")" }
            }
            td.number data-of="thesis" { (sign) (with_unit(c.thesis)) }
            td.number data-of="ours" { (ours) }
            td data-of="tolerance" { (c.tolerance) }
            td.mark.(verdict(c.holds)) { (mark) }
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

/// A picture as SVG.
pub(crate) fn svg(picture: &Picture) -> Result<Markup> {
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
    let axes = Axes {
        width: HALF,
        x: (
            range(picture.x.1, &mut all.iter().map(|p| p.0)),
            picture.x.0,
        ),
        y: (
            range(picture.y.1, &mut all.iter().map(|p| p.1)),
            picture.y.0,
        ),
    };
    match &picture.content {
        Content::Curves(named) => {
            let named: Vec<(&str, Vec<(f64, f64)>)> = named
                .iter()
                .map(|(name, points)| (name.as_str(), points.clone()))
                .collect();
            curves(&axes, &named)
        }
        Content::Bars(values, count) => {
            bars(HALF, values, &axes.x.0, *count, picture.x.0, picture.y.0)
        }
        Content::Cells(points, size) => cells(&axes, points, *size),
        Content::Dots(points) => dots(&axes, points),
    }
}
