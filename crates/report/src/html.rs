//! The frame around a report's figures, and what its tables share.
//!
//! Pages are written with `maud`: text that is spliced in is escaped, and only [`Markup`] is taken as it
//! is, which is either written here or a figure, whose texts the drawing library has escaped.

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

/// A whole page below its title.
pub(super) fn page(title: &str, body: &Markup) -> String {
    page_with_style(title, "", body)
}

/// A whole page below its title, with a style of its own.
pub(super) fn page_with_style(title: &str, style: &'static str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(style)) }
            }
            body {
                h1 { (title) }
                (body)
            }
        }
    };
    page.into_string()
}

/// A figure with what it shows and what to see in it.
pub(super) fn figure(svg: &Markup, caption: impl Render) -> Markup {
    html! { figure { (svg) figcaption { (caption) } } }
}

/// A cell of a table's header: a name, and below it the unit.
pub(super) fn th(name: impl Render, unit: &str) -> Markup {
    html! { th { (name) small { (unit) } } }
}

/// A table of texts; in its header a unit follows its name on a line of its own.
pub(super) fn table(header: &[String], rows: &[Vec<String>]) -> Markup {
    html! {
        div.scroll { table {
            tr {
                @for cell in header {
                    @if let Some((name, unit)) = cell.split_once('\n') { (th(name, unit)) }
                    @else { th { (cell) } }
                }
            }
            @for row in rows {
                tr { @for cell in row { td { (lines(cell)) } } }
            }
        } }
    }
}

/// A text of some lines.
fn lines(text: &str) -> Markup {
    html! {
        @for (k, line) in text.lines().enumerate() {
            @if k > 0 { br; }
            (line)
        }
    }
}

/// The files that a run was made with, and their hashes; `version` says with which program.
pub(super) fn configuration(files: &[(String, String)], version: impl Render) -> Markup {
    html! {
        details {
            summary { "Configuration" }
            table {
                @for (file, hash) in files {
                    tr { td { (file) } td { code { (hash) } } }
                }
            }
            p { "pigtail " (version) }
        }
    }
}

/// A number with so many digits behind the point.
pub(super) fn fixed(value: f64, digits: usize) -> String {
    format!("{value:.digits$}")
}

/// A number with so many digits behind the point, where there is one.
pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| fixed(value, digits))
}

/// How a result is shown that is as it should be, or is not.
pub(super) fn verdict(good: bool) -> &'static str {
    if good { "good" } else { "bad" }
}

const STYLE: &str = "
:root { --ink: #1b2733; --soft: #5b6b7a; --line: #d8dee4; --good: #1a7f4b; --bad: #b3261e; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: #fff;
       max-width: 1120px; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; margin: 0 0 .25rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 .5rem; border-top: 1px solid var(--line);
     padding-top: 1.5rem; }
p { margin: .4rem 0; max-width: 75ch; }
.soft { color: var(--soft); }
.good { color: var(--good); font-weight: 600; }
.bad { color: var(--bad); font-weight: 600; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 1rem 0; }
th, td { padding: .3rem .7rem; text-align: right; border-bottom: 1px solid var(--line);
         white-space: nowrap; }
th { font-weight: 600; vertical-align: bottom; }
th small { display: block; font-weight: 400; color: var(--soft); }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr));
        gap: 1rem; }
figure { margin: 1rem 0; }
figure { overflow-x: auto; }
figure svg { width: 100%; min-width: 32rem; height: auto; display: block; }
figcaption { color: var(--soft); font-size: .9rem; max-width: 75ch; }
details { margin-top: 2rem; }
code { font-size: .85em; overflow-wrap: anywhere; }
@media print { body { max-width: none; } h2 { break-before: page; } }
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_others_are_escaped() {
        let name = "<b> & \"c\"";
        let escaped = "&lt;b&gt; &amp; &quot;c&quot;";
        let cell = [format!("{name}\nsecond line")];
        let files = [(name.to_owned(), "hash".to_owned())];
        let body = html! {
            (figure(&html! { svg {} }, name))
            (table(&[name.to_owned()], &[cell.to_vec()]))
            (th(name, name))
            (configuration(&files, name))
        };
        let page = page(name, &body);
        assert!(!page.contains(name), "{page}");
        // Two for the title, one each for caption, header, cell, file and program, two for the unit.
        assert_eq!(page.matches(escaped).count(), 9, "{page}");
        assert!(page.contains("<br>second line"), "{page}");
    }

    #[test]
    fn a_unit_stands_below_its_name() {
        let header = ["time\ns".to_owned(), "name".to_owned()];
        let table = table(&header, &[]).into_string();
        assert!(table.contains("<th>time<small>s</small></th><th>name</th>"));
    }
}
