//! What stands in one field of a file: a number, a moment, or that there is none.

use std::borrow::Cow;

/// A line's fields, without blanks and quotes around them.
pub(crate) fn split(line: &str, delimiter: u8) -> Vec<Cow<'_, str>> {
    let mut fields = Vec::new();
    split_into(line, delimiter, &mut fields);
    fields
}

/// The same in the place of what is there.
pub(crate) fn split_into<'t>(line: &'t str, delimiter: u8, fields: &mut Vec<Cow<'t, str>>) {
    fields.clear();
    let bare = |field: &str| field.trim().trim_matches('"').trim().to_owned();
    if delimiter == b' ' {
        fields.extend(line.split_whitespace().map(|f| Cow::Owned(bare(f))));
        return;
    }
    if !line.contains('"') {
        // By bytes: of a long record a search for characters is a tenth of the whole work.
        let mut from = 0;
        for (at, _) in line.bytes().enumerate().filter(|(_, b)| *b == delimiter) {
            fields.push(Cow::Borrowed(line[from..at].trim()));
            from = at + 1;
        }
        fields.push(Cow::Borrowed(line[from..].trim()));
        return;
    }
    let (mut field, mut quoted) = (String::new(), false);
    for c in line.chars() {
        match c {
            '"' => quoted = !quoted,
            c if c == char::from(delimiter) && !quoted => {
                fields.push(Cow::Owned(bare(&std::mem::take(&mut field))));
            }
            c => field.push(c),
        }
    }
    fields.push(Cow::Owned(bare(&field)));
}

/// What a field without a value may say.
pub(crate) fn is_missing(text: &str) -> bool {
    [
        "",
        "nan",
        "na",
        "n/a",
        "null",
        "none",
        "-",
        "-nan",
        "nan(ind)",
        "-nan(ind)",
        "#n/a",
        "?",
    ]
    .iter()
    .any(|m| text.eq_ignore_ascii_case(m))
}

/// A number as a file writes it.
pub(crate) fn number(text: &str, decimal_comma: bool) -> Option<f64> {
    if decimal_comma {
        // One that has a point too would be another number by the other habit.
        if text.contains('.') {
            return None;
        }
        if text.contains(',') {
            return plain(&text.replacen(',', ".", 1));
        }
    }
    plain(text)
}

pub(crate) fn plain(text: &str) -> Option<f64> {
    // Nearly all are written so; the words that are numbers, too, begin with a letter.
    let first = text.strip_prefix('-').unwrap_or(text).as_bytes().first();
    if first.is_some_and(u8::is_ascii_digit)
        && let Ok(value) = text.parse()
    {
        return Some(value);
    }
    // A minus as typesetters and spreadsheets write it.
    if let Some(positive) = text.strip_prefix('\u{2212}') {
        return plain(positive)
            .filter(|_| !positive.starts_with(['+', '-']))
            .map(|v| -v);
    }
    if text.contains('\u{2212}') {
        return plain(&text.replace('\u{2212}', "-"));
    }
    // `inf`, `nan` and the like are words; `1d-3` is how Fortran writes.
    let first = text.trim_start_matches(['+', '-']).chars().next()?;
    if !(first.is_ascii_digit() || first == '.') {
        return None;
    }
    let fortran = text
        .contains(['d', 'D'])
        .then(|| text.replace(['d', 'D'], "e"));
    fortran.as_deref().unwrap_or(text).parse().ok()
}

/// Nanoseconds of a date, a time of day or both, as ISO 8601 writes them or nearly.
pub(crate) fn moment(text: &str) -> Option<i128> {
    let text = text.trim().trim_end_matches('Z');
    if !text.contains(':') || text.len() < 7 {
        return None;
    }
    let (day, time) = match text.split_once(['T', ' ']) {
        Some((day, time)) => (days(day)?, time),
        None => (0, text),
    };
    let (time, zone) = match time.rfind(['+', '-']) {
        Some(at) => {
            let (hours, minutes) = time[at + 1..]
                .split_once(':')
                .unwrap_or((&time[at + 1..], "0"));
            let minutes = 60 * hours.parse::<i128>().ok()? + minutes.parse::<i128>().ok()?;
            (
                &time[..at],
                if time.as_bytes()[at] == b'+' {
                    minutes
                } else {
                    -minutes
                },
            )
        }
        None => (time, 0),
    };
    let mut parts = time.trim().splitn(3, ':');
    let hours: i128 = parts.next()?.parse().ok()?;
    let minutes: i128 = parts.next()?.parse().ok()?;
    let seconds = parts.next().unwrap_or("0");
    let (whole, fraction) = seconds.split_once(['.', ',']).unwrap_or((seconds, ""));
    if fraction.len() > 18 || !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let digits: String = fraction
        .chars()
        .chain("000000000".chars())
        .take(9)
        .collect();
    let nanos: i128 = digits.parse().ok()?;
    let all = ((24 * day + hours) * 60 + minutes - zone) * 60 + whole.parse::<i128>().ok()?;
    Some(all * 1_000_000_000 + nanos)
}

/// Days since 1970 of `2024-05-03`, `2024/05/03` or `03.05.2024`.
fn days(text: &str) -> Option<i128> {
    let parts: Vec<&str> = text.split(['-', '/', '.']).collect();
    let [a, b, c] = parts[..] else { return None };
    let (year, month, day) = if a.len() == 4 { (a, b, c) } else { (c, b, a) };
    let (mut year, month, day): (i128, i128, i128) =
        (year.parse().ok()?, month.parse().ok()?, day.parse().ok()?);
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || year < 1900 {
        return None;
    }
    // The civil calendar, years beginning in March.
    year -= i128::from(month <= 2);
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let of_year = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + day - 1;
    Some(era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468)
}

pub(crate) fn is_value(field: &str, decimal_comma: bool) -> bool {
    is_missing(field)
        || number(field, decimal_comma).is_some()
        || moment(field).is_some()
        || days(field).is_some()
        || ["inf", "-inf", "+inf", "infinity"]
            .iter()
            .any(|w| field.eq_ignore_ascii_case(w))
}
