//! The report of the reproduced thesis: a section a chapter, every figure with its claims.

use super::figure::{Axes, HALF, bars, cells, curves, dots, range_of};
use super::html::{escape, figure, page_with_style};
use anyhow::Result;
use pigtail_reproduce::claims::{Claim, Kind};
use pigtail_reproduce::errata::Erratum;
use pigtail_reproduce::picture::{Content, Picture};
use pigtail_reproduce::{Document, Figure, Reproduction, chapter};
use std::fmt::Write as _;
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
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    summary(&mut body, d);
    contents(&mut body, made);
    failures(&mut body, d);
    for (number, name) in CHAPTERS {
        let figures: Vec<&Figure> = made
            .figures
            .iter()
            .filter(|f| chapter(f.id) == number)
            .collect();
        if figures.is_empty() {
            continue;
        }
        let _ = writeln!(body, "<h2 id=\"chapter{number}\">{number}. {name}</h2>");
        for f in figures {
            one(&mut body, f, &d.claims)?;
        }
    }
    errata(&mut body, &made.errata);
    Ok(page_with_style(&title, STYLE, &body))
}

fn summary(body: &mut String, d: &Document) {
    let calibrated = d.of - d.of_predicted;
    let calibrated_held = d.held - d.predicted;
    let _ = writeln!(
        body,
        "<p><b>{} of {} claims hold</b>: {} of {} predictions, and {} of {} for which numbers of \
         the rig's plant or of an experiment were chosen and which therefore prove nothing (marked &loz;). {}Took {:.0} s.</p>\n\
         <p>{} Measured is what encoders, probes and photodiodes tell, by the control code of a real run. \
         No other number was fitted to the figure with which it is compared.</p>",
        d.held,
        d.of,
        d.predicted,
        d.of_predicted,
        calibrated_held,
        calibrated,
        if d.quick {
            "A quick run: fewer steps, devices and runs. "
        } else {
            ""
        },
        d.seconds,
        if d.specimen {
            "The machine is a specimen that the seed drew; what the thesis simulated is simulated on the \
             one in the middle."
        } else {
            "The machine is the thesis's, in the middle of its make: the rig's plant for what was simulated, \
             with what its measured.toml changes for what was measured; the \
             seed drew device, fixture and noise."
        }
    );
    body.push_str(
        "<details><summary>How near a result must come</summary>\n<p>Chosen before any result, by the \
         kind of the claim.</p>\n<dl class=\"tolerances\">\n",
    );
    for kind in Kind::ALL {
        let _ = writeln!(
            body,
            "<dt>{}</dt><dd>{}</dd>",
            kind.tolerance(),
            escape(kind.reason())
        );
    }
    body.push_str("</dl></details>\n");
}

fn contents(body: &mut String, made: &Reproduction) {
    body.push_str("<nav>\n");
    for (number, name) in CHAPTERS {
        let figures = || made.figures.iter().filter(|f| chapter(f.id) == number);
        if figures().next().is_none() {
            continue;
        }
        let _ = write!(
            body,
            "<p><a href=\"#chapter{number}\">{number}. {name}</a><br>"
        );
        for f in figures() {
            let _ = write!(
                body,
                "<a href=\"#f{0}\" title=\"{1}\">{0}</a> ",
                f.id,
                escape(f.title)
            );
        }
        body.push_str("</p>\n");
    }
    body.push_str("<p><a href=\"#errata\">Slips in the thesis</a></p>\n</nav>\n");
}

fn label(id: &str) -> &'static str {
    if id.contains('.') { "Fig. " } else { "" }
}

fn failures(body: &mut String, d: &Document) {
    let failed: Vec<&Claim> = d.claims.iter().filter(|c| !c.holds).collect();
    if failed.is_empty() {
        return;
    }
    body.push_str("<h2>What does not hold</h2>\n");
    table(body, failed.into_iter(), true);
}

/// A figure: pictures, what to say of them, claims.
fn one(body: &mut String, f: &Figure, claims: &[Claim]) -> Result<()> {
    let _ = writeln!(
        body,
        "<h3 id=\"f{0}\">{1}{0} {2}</h3>",
        f.id,
        label(f.id),
        escape(f.title)
    );
    let of: Vec<&Claim> = claims
        .iter()
        .filter(|c| c.id.split('-').next() == Some(f.id))
        .collect();
    if !f.pictures.is_empty() {
        body.push_str("<div class=\"pair\">\n");
        for picture in &f.pictures {
            body.push_str(&figure(&svg(picture)?, &escape(&picture.caption)));
        }
        body.push_str("</div>\n");
    }
    if !f.remark.is_empty() {
        let _ = writeln!(body, "<p>{}</p>", escape(&f.remark));
    }
    if !of.is_empty() {
        table(body, of.into_iter(), false);
    }
    Ok(())
}

/// Claims beside results; `linked` where they do not stand below their figure.
fn table<'a>(body: &mut String, claims: impl Iterator<Item = &'a Claim>, linked: bool) {
    body.push_str(
        "<table class=\"claims\"><thead><tr><th>claim</th><th class=\"number\">thesis</th>\
         <th class=\"number\">ours</th><th class=\"tolerance\">tolerance</th><th class=\"mark\"></th></tr></thead>\n<tbody>\n",
    );
    for c in claims {
        let unit = if c.unit.is_empty() {
            String::new()
        } else {
            format!(" {}", c.unit)
        };
        let sign = match c.kind {
            "below" => "&lt; ",
            "above" => "&gt; ",
            _ => "",
        };
        let ours = c
            .ours
            .map_or_else(|| "-".to_owned(), |v| format!("{v}{unit}"));
        let (class, mark) = if c.holds {
            ("good", "holds")
        } else if c.explained {
            ("bad", "fails, explained")
        } else {
            ("bad", "fails")
        };
        let calibrated = if c.calibrated { " &loz;" } else { "" };
        let note = if c.note.is_empty() {
            String::new()
        } else {
            format!(" <span class=\"soft\">{}</span>", escape(&c.note))
        };
        let figure = if linked {
            let id = c.id.split('-').next().unwrap_or(c.id);
            format!("<a href=\"#f{id}\">{}{id}</a>: ", label(id))
        } else {
            String::new()
        };
        let _ = writeln!(
            body,
            "<tr><td>{figure}{}{calibrated}{note}<q>{} ({})</q></td>\
             <td class=\"number\" data-of=\"thesis\">{sign}{}{unit}</td>\
             <td class=\"number\" data-of=\"ours\">{ours}</td><td data-of=\"tolerance\">{}</td>\
             <td class=\"{class} mark\">{mark}</td></tr>",
            escape(c.quantity),
            escape(c.quote),
            c.section,
            c.thesis,
            c.tolerance
        );
    }
    body.push_str("</tbody></table>\n");
}

fn errata(body: &mut String, errata: &[Erratum]) {
    body.push_str(
        "<h2 id=\"errata\">Slips in the thesis</h2>\n<p>Found by working through it.</p>\n",
    );
    for e in errata {
        let computed = if e.computed.is_empty() {
            String::new()
        } else {
            format!("<p class=\"soft\">Computed: {}</p>\n", escape(&e.computed))
        };
        let _ = writeln!(
            body,
            "<h3>{}</h3>\n<p>Printed: <i>{}</i></p>\n<p>{}</p>\n{computed}",
            escape(&e.title),
            escape(&e.printed),
            escape(&e.argument)
        );
    }
}

/// A picture as SVG.
pub(crate) fn svg(picture: &Picture) -> Result<String> {
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
