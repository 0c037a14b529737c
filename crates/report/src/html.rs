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
                @if body.0.contains("class=\"chart") { script { (PreEscaped(SCRIPT)) } }
            }
        }
    };
    page.into_string()
}

/// A figure with what it shows and what to see in it.
pub(super) fn figure(svg: &Markup, caption: impl Render) -> Markup {
    html! { figure { (svg) figcaption { (caption) } } }
}

/// A text with what stands between backticks as code.
pub(super) fn prose(text: &str) -> Markup {
    html! {
        @for (k, part) in text.split('`').enumerate() {
            @if k % 2 == 1 { code { (part) } } @else { (part) }
        }
    }
}

/// A cell of a table's header: a name, and below it the unit.
pub(super) fn th(name: impl Render, unit: &str) -> Markup {
    html! { th { (name) small { (unit) } } }
}

/// A table of texts; in its header a unit follows its name on a line of its own. Numbers of a column stand with
/// their points one below the other, words at the left.
pub(super) fn table(header: &[String], rows: &[Vec<String>]) -> Markup {
    let columns: Vec<Column> = (0..header.len())
        .map(|k| Column::of(rows.iter().filter_map(|row| row.get(k)).map(String::as_str)))
        .collect();
    // Many columns stand close together where there is little room.
    let dense = header.len() > 8;
    html! {
        div.scroll { table.dense[dense] {
            // Repeated on each sheet of paper.
            thead { tr {
                @for (cell, column) in header.iter().zip(&columns) {
                    @let class = column.class();
                    @if let Some((name, unit)) = cell.split_once('\n') {
                        th class=[class] { (name) small { (unit) } }
                    } @else { th class=[class] { (cell) } }
                }
            } }
            tbody {
                @for row in rows {
                    tr {
                        @for (cell, column) in row.iter().zip(&columns) {
                            td class=[column.class()] { (lines(&column.padded(cell))) }
                        }
                    }
                }
            }
        } }
    }
}

/// What stands in a column: words, or numbers with at most so many digits behind the point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Column {
    Words { long: bool },
    Numbers(usize),
}

impl Column {
    pub(super) fn of<'a>(cells: impl Iterator<Item = &'a str>) -> Self {
        let (mut most, mut numbers, mut longest) = (0, true, 0);
        let mut exponents = false;
        for cell in cells {
            longest = longest.max(cell.chars().count());
            match behind(cell) {
                Some(digits) => most = most.max(digits),
                // A number with an exponent is one too.
                None if cell.parse::<f64>().is_ok() => exponents = true,
                None => numbers &= matches!(cell, "" | "-"),
            }
        }
        if numbers {
            // Points stand below each other where all have one that means the same.
            Self::Numbers(if exponents { 0 } else { most })
        } else {
            Self::Words { long: longest > 40 }
        }
    }

    pub(super) fn class(self) -> Option<&'static str> {
        match self {
            Self::Words { long: true } => Some("text long"),
            Self::Words { long: false } => Some("text"),
            Self::Numbers(_) => None,
        }
    }

    /// A number with the room of the digits that it lacks.
    pub(super) fn padded(self, cell: &str) -> String {
        let (Self::Numbers(most), Some(digits)) = (self, behind(cell)) else {
            return cell.to_owned();
        };
        // The room of a point and of digits.
        let point = if digits == 0 && most > 0 {
            "\u{2008}"
        } else {
            ""
        };
        format!(
            "{cell}{point}{}",
            "\u{2007}".repeat(most.saturating_sub(digits))
        )
    }
}

/// How many digits a number, or a bound such as `< 5`, has behind its point; `None` for what is no plain number.
fn behind(cell: &str) -> Option<usize> {
    let cell = cell.strip_prefix(['<', '>']).map_or(cell, str::trim_start);
    let digits = cell.strip_prefix(['-', '+']).unwrap_or(cell);
    if !digits.starts_with(|c: char| c.is_ascii_digit())
        || !digits.chars().all(|c| c.is_ascii_digit() || c == '.')
    {
        return None;
    }
    Some(digits.split_once('.').map_or(0, |(_, rest)| rest.len()))
}

/// Whether a word is a serial number, a date or the like, which no line ends within, though a hyphen might end one.
/// A path is longer, and has to fold where there is little room.
fn is_whole(word: &str) -> bool {
    let parted = word.trim_start_matches('-').contains('-');
    parted && word.contains(|c: char| c.is_ascii_digit()) && word.len() <= 24
}

/// A text of some lines.
fn lines(text: &str) -> Markup {
    html! {
        @for (k, line) in text.lines().enumerate() {
            @if k > 0 { br; }
            @for word in line.split_inclusive(' ') {
                @if is_whole(word) { span.whole { (word) } } @else { (word) }
            }
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
                    tr { td { (file) } td.text { code { (hash) } } }
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

/// The style of every page, and what makes its charts answer.
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("chart.js");

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
    fn what_is_between_backticks_is_code() {
        let text = prose("see `a < b` and `c`").into_string();
        assert_eq!(text, "see <code>a &lt; b</code> and <code>c</code>");
    }

    #[test]
    fn a_unit_stands_below_its_name() {
        let header = ["time\ns".to_owned(), "name".to_owned()];
        let table = table(&header, &[]).into_string();
        assert!(table.contains("<th>time<small>s</small></th><th>name</th>"));
    }

    #[test]
    fn points_of_numbers_stand_one_below_the_other() {
        let rows = [["12.25", "a"], ["-3", "4"], ["0.5", ""], ["-", "b"]];
        let rows = rows.map(|row| row.map(str::to_owned).to_vec());
        let table = table(&["x".to_owned(), "y".to_owned()], &rows).into_string();
        let cells = [
            "<td>12.25</td>",
            "<td>-3\u{2008}\u{2007}\u{2007}</td>",
            "<td>0.5\u{2007}</td>",
            "<td>-</td>",
        ];
        for cell in cells {
            assert!(table.contains(cell), "{cell} in {table}");
        }
        assert!(table.contains("<td class=\"text\">4</td>"), "{table}");
        let serials = [vec!["T1-07 low-index".to_owned()]];
        let serials = super::table(&["x".to_owned()], &serials).into_string();
        let whole = "<span class=\"whole\">T1-07 </span>low-index";
        assert!(serials.contains(whole), "{serials}");
        let bounds = ["< 5", "6.7", "-"].map(|x| vec![x.to_owned()]);
        let bounds = super::table(&["x".to_owned()], &bounds).into_string();
        assert!(
            bounds.contains("<td>&lt; 5\u{2008}\u{2007}</td>"),
            "{bounds}"
        );
        let mixed = ["209.99", "2e-4", "1"].map(|x| vec![x.to_owned()]);
        let mixed = super::table(&["x".to_owned()], &mixed).into_string();
        assert!(!mixed.contains('\u{2007}'), "{mixed}");
    }
}
