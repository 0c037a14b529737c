//! How a file of columns is written: its encoding, what stands between fields, where its names are.
//!
//! Nobody says so in the file. It is told from the rows themselves: whatever splits most lines into as many numbers
//! each is the delimiter; the line above them has the names, the one between, if all of it is units, the units.

use crate::cells::{is_value, moment, number, plain, split};
use std::borrow::Cow;
use std::fmt::Write as _;

/// How a file is written.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    /// What stands between fields; a blank for any number of blanks and tabs.
    pub(crate) delimiter: u8,
    /// Whether numbers have a decimal comma.
    pub(crate) decimal_comma: bool,
    /// Names of the columns.
    pub(crate) names: Vec<String>,
    /// Their units, where a row has them.
    pub(crate) units: Vec<Option<String>>,
    /// Where the rows begin, bytes.
    pub(crate) body: usize,
    /// The line in which they begin, from one.
    pub(crate) first_line: usize,
    /// Seconds between samples, where the lines above say so.
    pub(crate) period: Option<f64>,
    /// The line of names; `None` where no line has names.
    pub(crate) names_line: Option<usize>,
    /// Whether the last field of every row is empty.
    pub(crate) trailing: bool,
    /// The line above the rows and how many fields it has, where these are not the rows'.
    pub(crate) other: Option<(usize, usize)>,
    /// Whether the lines above say a factor or an offset of the numbers.
    scaled: bool,
    encoding: &'static str,
}

/// Lines that are looked at.
const LOOKED_AT: usize = 800;

/// A file's text, and how it was encoded.
pub(crate) fn decode(bytes: Vec<u8>) -> (String, &'static str) {
    let wide = |bytes: &[u8], of: fn([u8; 2]) -> u16| {
        let units = bytes.chunks_exact(2).map(|c| of([c[0], c[1]]));
        char::decode_utf16(units)
            .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect()
    };
    match &bytes[..] {
        [0xef, 0xbb, 0xbf, rest @ ..] => (
            String::from_utf8_lossy(rest).into_owned(),
            "UTF-8 with a byte-order mark",
        ),
        [0xff, 0xfe, rest @ ..] => (wide(rest, u16::from_le_bytes), "UTF-16"),
        [0xfe, 0xff, rest @ ..] => (wide(rest, u16::from_be_bytes), "UTF-16"),
        // Without a mark: text of mostly Latin letters has a zero in every second byte.
        [_, 0, _, 0, ..] => (wide(&bytes, u16::from_le_bytes), "UTF-16"),
        [0, _, 0, _, ..] => (wide(&bytes, u16::from_be_bytes), "UTF-16"),
        _ => match String::from_utf8(bytes) {
            Ok(text) => (text, "UTF-8"),
            Err(other) => {
                let bytes = other.as_bytes().iter();
                (bytes.map(|b| char::from(*b)).collect(), "Latin-1")
            }
        },
    }
}

struct Line<'t> {
    at: usize,
    number: usize,
    text: &'t str,
    comment: bool,
}

fn lines(text: &str) -> Vec<Line<'_>> {
    let mut at = 0;
    let mut all = Vec::new();
    for (k, line) in text.split_inclusive('\n').enumerate() {
        let bare = line.trim_end_matches(['\n', '\r']);
        if !bare.trim().is_empty() {
            let comment = bare.trim_start().starts_with(['#', '%']);
            all.push(Line {
                at,
                number: k + 1,
                text: bare,
                comment,
            });
        }
        at += line.len();
        if all.len() >= LOOKED_AT {
            break;
        }
    }
    all
}

/// Whether a row is one of data: all values, one of them a number.
fn is_data(fields: &[Cow<str>], decimal_comma: bool) -> bool {
    fields.iter().all(|f| is_value(f, decimal_comma))
        && fields.iter().any(|f| {
            number(f, decimal_comma).is_some()
                || moment(f).is_some()
                || f.eq_ignore_ascii_case("nan")
        })
}

/// Rows of numbers among the lines of a text.
struct Rows {
    count: usize,
    width: usize,
    delimiter: u8,
    decimal_comma: bool,
    /// The first of them, by its place among the lines.
    start: usize,
}

/// Ways to write columns; of two that split as many lines into as many numbers the first.
const WAYS: [(u8, bool); 9] = [
    (b',', false),
    (b';', false),
    (b'\t', false),
    (b'|', false),
    (b';', true),
    (b'\t', true),
    (b'|', true),
    (b' ', false),
    (b' ', true),
];

/// The longest run of lines that are rows of as many numbers each, in whatever way.
fn rows(all: &[Line]) -> Option<Rows> {
    let mut best: Option<Rows> = None;
    for (delimiter, decimal_comma) in WAYS {
        let (mut start, mut count, mut width) = (0, 0, 0);
        for (k, line) in all.iter().enumerate().filter(|(_, line)| !line.comment) {
            let fields = split(line.text, delimiter);
            let data = is_data(&fields, decimal_comma);
            if data && count > 0 && fields.len() == width {
                count += 1;
            } else {
                (start, count, width) = (k, usize::from(data), fields.len());
            }
            // Longer runs, then more fields.
            if count > 0
                && best
                    .as_ref()
                    .is_none_or(|b| (count, width) > (b.count, b.width))
            {
                best = Some(Rows {
                    count,
                    width,
                    delimiter,
                    decimal_comma,
                    start,
                });
            }
        }
    }
    best
}

/// Names and units above rows: the line of the names, and the units of a row between.
struct Above {
    line: Option<usize>,
    names: Option<Vec<String>>,
    units: Vec<Option<String>>,
}

fn texts(row: &[Cow<str>]) -> Vec<String> {
    row.iter().map(ToString::to_string).collect()
}

/// How a text is written; `None` where nothing in it is a row of numbers, or a line of names.
pub(crate) fn layout(
    text: &str,
    encoding: &'static str,
    is_unit: impl Fn(&str) -> bool,
) -> Option<Layout> {
    let all = lines(text);
    let Some(mut found) = rows(&all) else {
        return no_rows(&all, encoding);
    };
    let (delimiter, decimal_comma) = (found.delimiter, found.decimal_comma);
    let fields = |k: usize| split(all[k].text, delimiter);
    // A row with a word in it is a row: of what is above, lines of nearly only numbers.
    while let Some(above) = (0..found.start).rev().find(|k| !all[*k].comment) {
        let row = fields(above);
        let units = row.iter().all(|f| f.is_empty() || is_unit(f));
        let words = row.iter().filter(|f| !is_value(f, decimal_comma)).count();
        // One that begins with a word is more likely said of the rows: `SampleTime[ms];1`.
        let said = words > 0 && !is_value(&row[0], decimal_comma) && 2 * words >= found.width;
        if row.len() != found.width || units || said || words > 1 || 2 * words > found.width {
            break;
        }
        found.start = above;
    }
    let start = found.start;
    let last = (0..start).rev().find(|k| !all[*k].comment);
    // A delimiter behind every row's last field is no column, whether the line of names has it or not.
    let ends_empty = |k: usize| fields(k).last().is_some_and(|f| f.is_empty());
    let mut rows = (start..all.len()).filter(|k| !all[*k].comment);
    let trailing = found.width > 1
        && found.delimiter != b' '
        && rows.all(|k| fields(k).len() != found.width || ends_empty(k))
        && (0..start).all(|k| all[k].comment || fields(k).len() != found.width || ends_empty(k));
    let width = found.width - usize::from(trailing);
    let above = above(&all[..start], &found, width, is_unit);
    let mut names = above.names;
    let mut units = above.units;
    let mut period = None;
    for line in &all[..start] {
        period = period.or_else(|| told_period(line.text));
        channels(line.text, delimiter, width, &mut names);
        channel_units(line.text, delimiter, &mut units);
    }
    for (slot, unit) in units.iter_mut().zip(numbered(&all[..start], "UNIT", width)) {
        *slot = unit.or(slot.take());
    }
    names = recorder(&all[..start], width).or(names);
    // A line without anything that divides fields is prose above rows without names.
    let prose = |k: usize| !all[k].text.contains([',', ';', '\t', '|']) && delimiter != b' ';
    let other = last
        .filter(|k| names.is_none() && all[*k].number + 1 == all[start].number)
        .filter(|k| !prose(*k))
        .map(|k| (all[k].number, fields(k).len()))
        .filter(|(_, count)| *count > 1 || width > 1);
    Some(Layout {
        delimiter,
        decimal_comma,
        names: names.unwrap_or_else(|| (1..=width).map(|k| k.to_string()).collect()),
        units,
        body: all[start].at,
        first_line: all[start].number,
        period,
        names_line: above.line,
        trailing,
        other,
        scaled: all[..start].iter().any(|l| is_scaled(l.text, delimiter)),
        encoding,
    })
}

/// What stands above rows of a width.
fn above(lines: &[Line], rows: &Rows, width: usize, is_unit: impl Fn(&str) -> bool) -> Above {
    let bare = |line: &Line| {
        let mut row = texts(&split(line.text, rows.delimiter));
        while row.len() > width && row.last().is_some_and(String::is_empty) {
            row.pop();
        }
        row
    };
    let named =
        |row: &[String]| row.len() == width && row.iter().any(|f| !is_value(f, rows.decimal_comma));
    let mut found = Above {
        line: None,
        names: None,
        units: vec![None; width],
    };
    let mut plain = lines.iter().rev().filter(|l| !l.comment);
    if let Some(line) = plain.next().filter(|line| named(&bare(line))) {
        let row = bare(line);
        let inside = |f: &str| f.trim_matches(['[', ']', '(', ')']).trim().to_owned();
        // A ratio's unit is nothing, and nothing may stand in brackets: `[Hz],[],[deg]`.
        let nothing = |unit: &str| unit.is_empty() || unit == "-";
        let of_units = row
            .iter()
            .map(|f| inside(f))
            .all(|unit| nothing(&unit) || is_unit(&unit));
        let names = plain
            .next()
            .filter(|line| of_units && bare(line).len() == width);
        if names.is_some() {
            let unit = |f: &String| Some(inside(f)).filter(|unit| !nothing(unit));
            found.units = row.iter().map(unit).collect();
        }
        let line = names.unwrap_or(line);
        found.line = Some(line.number);
        found.names = Some(bare(line));
        return found;
    }
    // Names in a comment, as numpy and others write them.
    for line in lines.iter().rev().filter(|l| l.comment) {
        let text = line.text.trim_start().trim_start_matches(['#', '%']).trim();
        let row = texts(&split(text, rows.delimiter));
        if named(&row) && !text.contains('=') {
            found.line = Some(line.number);
            found.names = Some(row);
            break;
        }
    }
    found
}

/// A file of names and no rows.
fn no_rows(all: &[Line], encoding: &'static str) -> Option<Layout> {
    let line = all.iter().find(|l| !l.comment)?;
    let by = |d: &u8| split(line.text, *d).len();
    let delimiter = [b',', b';', b'\t']
        .into_iter()
        .max_by_key(|d| (by(d), u8::from(*d == b',')))?;
    let names = texts(&split(line.text, delimiter));
    Some(Layout {
        delimiter,
        decimal_comma: false,
        units: vec![None; names.len()],
        names,
        // What is left of that line is nothing.
        body: line.at + line.text.len(),
        first_line: line.number,
        period: None,
        names_line: Some(line.number),
        trailing: false,
        other: None,
        scaled: false,
        encoding,
    })
}

/// Seconds between samples in a line such as `SAMPLE_TIME = 0.0001` or `Sample rate: 1000 Hz`.
fn told_period(line: &str) -> Option<f64> {
    let low = line.to_lowercase().replace(['_', '-', '"'], " ");
    let has = |words: &[&str]| words.iter().any(|w| low.contains(w));
    let rate = has(&[
        "sample rate",
        "samplerate",
        "sampling rate",
        "sampling frequency",
        "sample frequency",
        "abtastrate",
    ]);
    let time = has(&[
        "sample time",
        "sampletime",
        "sampling time",
        "sampling interval",
        "sample interval",
        "abtastzeit",
    ]);
    if rate == time {
        return None;
    }
    let value = low
        .split(|c: char| c.is_whitespace() || ['=', ':', ';', ',', '[', ']', '(', ')'].contains(&c))
        .find_map(plain)
        .filter(|v| *v > 0.0 && v.is_finite())?;
    let word = |w: &str| {
        low.split(|c: char| !c.is_alphabetic())
            .any(|part| part == w)
    };
    Some(if rate {
        1.0 / (value * if word("khz") { 1e3 } else { 1.0 })
    } else if word("ms") {
        1e-3 * value
    } else if word("us") {
        1e-6 * value
    } else {
        value
    })
}

/// Names where each channel has a column of time of its own, as the scope of a controller (`TwinCAT`) writes them: `Name`, a name, in turns.
fn channels(line: &str, delimiter: u8, width: usize, names: &mut Option<Vec<String>>) {
    let row = split(line, delimiter);
    if width < 2 || row.len() < 2 || row.len() > width + 1 || !width.is_multiple_of(2) {
        return;
    }
    let row: Vec<&str> = row.iter().map(AsRef::as_ref).take(width).collect();
    let in_turns = row.len() == width
        && row
            .iter()
            .step_by(2)
            .all(|f| f.eq_ignore_ascii_case("name"));
    if in_turns {
        let own = |(k, f): (usize, &&str)| match k {
            0 => "time_ms".to_owned(),
            k if k % 2 == 0 => format!("time_ms {}", k / 2 + 1),
            _ => (*f).to_owned(),
        };
        *names = Some(row.iter().enumerate().map(own).collect());
    }
}

/// Whether a line says a factor or an offset that changes numbers, in turns with its word, as a scope does.
fn is_scaled(line: &str, delimiter: u8) -> bool {
    let row = split(line, delimiter);
    let values = || row.iter().skip(1).step_by(2);
    let other =
        |than: f64| values().any(|v| plain(&v.replace(',', ".")).is_some_and(|v| v != than));
    match row.first().map(|word| word.to_lowercase()).as_deref() {
        Some("scalefactor" | "scale-factor" | "scale factor") => other(1.0),
        Some("offset") => other(0.0),
        _ => false,
    }
}

/// Their units, in turns with the word `Unit`.
fn channel_units(line: &str, delimiter: u8, units: &mut [Option<String>]) {
    let row = split(line, delimiter);
    let is_word = |f: &Cow<str>| f.eq_ignore_ascii_case("unit");
    if units.len() < 2
        || row.len() < units.len()
        || !row.iter().step_by(2).take(units.len() / 2).all(is_word)
    {
        return;
    }
    for (k, unit) in row.iter().enumerate().take(units.len()).skip(1).step_by(2) {
        let unit = unit.trim_matches(['[', ']', '(', ')']).trim();
        if !unit.is_empty() && !unit.eq_ignore_ascii_case("none") {
            units[k] = Some(unit.to_owned());
        }
    }
}

/// Names of the tables of a PI data recorder (GCS array): `# NAME0 = Current Position of Axis AXIS:1`.
fn recorder(above: &[Line], width: usize) -> Option<Vec<String>> {
    numbered(above, "NAME", width).into_iter().collect()
}

/// Values of `# KEY0 = value`, `# KEY1 = value`.
fn numbered(above: &[Line], key: &str, width: usize) -> Vec<Option<String>> {
    let mut values = vec![None; width];
    for line in above {
        let text = line.text.trim_start_matches(['#', ' ']);
        let Some((own, value)) = text.split_once('=') else {
            continue;
        };
        let own = own.trim();
        let own = own.strip_prefix("DISP_").unwrap_or(own);
        let Some(number) = own.strip_prefix(key) else {
            continue;
        };
        if let Some(slot) = number.parse::<usize>().ok().and_then(|n| values.get_mut(n)) {
            *slot = Some(value.trim().to_owned());
        }
    }
    values
}

impl Layout {
    /// Of a file that is no text.
    pub(crate) fn of_arrays(names: Vec<String>, kind: &'static str, period: Option<f64>) -> Self {
        Self {
            delimiter: 0,
            decimal_comma: false,
            units: vec![None; names.len()],
            names,
            body: 0,
            first_line: 1,
            period,
            names_line: None,
            trailing: false,
            other: None,
            scaled: false,
            encoding: kind,
        }
    }

    /// What was understood, in words.
    pub(crate) fn understood(&self) -> String {
        if self.delimiter == 0 {
            let mut text = format!("{}, {} columns", self.encoding, self.names.len());
            if let Some(period) = self.period {
                let _ = write!(text, ", {:.6} Hz by its own number", 1.0 / period);
            }
            return text;
        }
        let between = match self.delimiter {
            b',' => "commas",
            b';' => "semicolons",
            b'\t' => "tabs",
            b'|' => "bars",
            _ => "blanks",
        };
        let mut text = format!("{between} between {} columns", self.names.len());
        if self.decimal_comma {
            text += ", decimal commas";
        }
        text += ", ";
        text += self.encoding;
        let _ = match self.names_line {
            Some(line) => write!(text, ", names in line {line}"),
            None => write!(
                text,
                ", no line of names: columns are called by their numbers"
            ),
        };
        if self.units.iter().any(Option::is_some) {
            text += ", units below them";
        }
        let _ = write!(text, ", rows from line {}", self.first_line);
        if let Some(period) = self.period {
            let _ = write!(text, ", {:.6} Hz by the lines above", 1.0 / period);
        }
        if self.scaled {
            text += ", numbers as they stand: a factor or an offset in the lines above is taken to be in them";
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Layout {
        layout(text, "UTF-8", |u| ["s", "mm", "V"].contains(&u)).expect("rows")
    }

    #[test]
    fn delimiters_decimals_names_and_units_are_told() {
        for (text, delimiter, comma, names, line) in [
            ("t,x\n0,1.5\n1,2\n", b',', false, vec!["t", "x"], 2),
            ("t;x\n0;1,5\n1;2,5\n", b';', true, vec!["t", "x"], 2),
            ("t\tx\n0,5\t1,5\n1,5\t2,5\n", b'\t', true, vec!["t", "x"], 2),
            (
                "Log of a day\nby someone; me\n\nt;x\ns;mm\n0;1.5\n1;2.5\n",
                b';',
                false,
                vec!["t", "x"],
                6,
            ),
            ("# t x\n0.0 1.5\n1.0  2.5\n", b' ', false, vec!["t", "x"], 2),
            ("0.0 1.5\n1.0  2.5\n", b' ', false, vec!["1", "2"], 1),
            ("t,x,\n0,1,\n1,2,\n", b',', false, vec!["t", "x"], 2),
            ("t,x,y\n0,1,\n1,2,\n", b',', false, vec!["t", "x", "y"], 2),
            ("0,1,\n1,2,\n", b',', false, vec!["1", "2"], 1),
            ("Log of a day\n0,1\n1,2\n", b',', false, vec!["1", "2"], 2),
            ("t,x\n0,1,\n1,2,\n", b',', false, vec!["t", "x"], 2),
            ("t,\"x, y\"\n0,1\n1,2\n", b',', false, vec!["t", "x, y"], 2),
            ("t,x\n0,one\n1,2\n2,3\n", b',', false, vec!["t", "x"], 2),
        ] {
            let found = of(text);
            assert_eq!(
                (found.delimiter, found.decimal_comma),
                (delimiter, comma),
                "{text}"
            );
            assert_eq!(found.names, names, "{text}");
            assert_eq!(found.first_line, line, "{text}");
        }
        assert_eq!(
            of("t;x\ns;mm\n0;1\n1;2\n").units,
            [Some("s".to_owned()), Some("mm".to_owned())]
        );
        assert_eq!(
            of("t,gain,u\n[s],[],[V]\n1,1,0\n2,1,0\n").units,
            [Some("s".to_owned()), None, Some("V".to_owned())]
        );
    }

    #[test]
    fn what_instruments_write_is_read() {
        let scope = "Name;Scope\nFile;C:\\a.csv\n\nName;Axis.pos;Name;Axis.u\nSampleTime[ms];1;SampleTime[ms];1\n\
                     Unit;mm;Unit;(None)\n\n0;1,5;0;2,5\n1;1,6;1;2,6\n";
        let found = of(scope);
        assert_eq!(found.units, [None, Some("mm".to_owned()), None, None]);
        assert_eq!(found.names, ["time_ms", "Axis.pos", "time_ms 2", "Axis.u"]);
        let recorder = "# REM\n#\n# TYPE = 1\n# SEPARATOR = 32\n# SAMPLE_TIME = 0.0005\n# NAME0 = Position\n\
                        # NAME1 = Voltage\n# END_HEADER\n1.0 2.0\n1.1 2.1\n";
        let found = of(recorder);
        assert_eq!(
            (found.names, found.period),
            (
                vec!["Position".to_owned(), "Voltage".to_owned()],
                Some(0.0005)
            )
        );
    }

    #[test]
    fn moments_are_counted_in_nanoseconds() {
        let at = |text: &str| moment(text).expect("a moment");
        assert_eq!(at("1970-01-02T00:00:00Z"), 86_400_000_000_000);
        assert_eq!(
            at("2024-03-01T00:00:00.001") - at("2024-02-28 23:59:59,999"),
            86_400_002_000_000
        );
        assert_eq!(at("12:00:00.5") - at("11:59:59.25"), 1_250_000_000);
        assert_eq!(at("2024-01-01T01:00:00+01:00"), at("2024-01-01T00:00:00Z"));
        assert_eq!(moment("1:2"), None);
    }

    #[test]
    fn encodings_are_told() {
        let wide: Vec<u8> = [0xff, 0xfe]
            .into_iter()
            .chain("t,µ\n".encode_utf16().flat_map(u16::to_le_bytes))
            .collect();
        assert_eq!(decode(wide).0, "t,µ\n");
        assert_eq!(
            decode(b"t,\xb5m\n".to_vec()),
            ("t,µm\n".to_owned(), "Latin-1")
        );
        assert_eq!(decode(b"\xef\xbb\xbft".to_vec()).0, "t");
    }
}
