//! The same documents as text: tables for a terminal, or for whoever prints a result.

use crate::percent;
use comfy_table::{
    CellAlignment, ContentArrangement, ContentLineStyle, LineStyle, Table, TableStyle,
};
use pigtail_control::outcome::OutcomeCode;
use pigtail_evaluate::align::{AlignmentDocument, FiberRow, TOLERANCE_Z_UM};
use pigtail_evaluate::campaign::CampaignDocument;
use pigtail_numerics::statistics::Percentiles;
use pigtail_session::fleet::NOMINAL;
use pigtail_session::procedure::Procedure;
use std::fmt::Write as _;

/// Lines above and below the header and nothing else: numbers side by side need no grid.
const STYLE: TableStyle = TableStyle::new()
    .header_separator(LineStyle::none().fill('─').junction('─'))
    .content_lines(ContentLineStyle::none());

/// A header and its rows, columns of numbers to the right, and a line end. Where `room` columns of characters are too
/// few, rows become columns if that is enough; else the table is folded: the columns that have no room follow
/// below, beside the first one again. Nothing is left out. `None` is a room without end.
pub fn table(rows: &[Vec<String>], room: Option<usize>) -> String {
    let wide = drawn(rows);
    let Some(room) = room.filter(|room| width_of(&wide) > *room) else {
        return wide.trim_fmt() + "\n";
    };
    let turned: Vec<Vec<String>> = (0..rows[0].len())
        .map(|i| {
            let cell = |row: &Vec<String>| row.get(i).map_or(String::new(), |c| one_line(c));
            rows.iter().map(cell).collect()
        })
        .collect();
    let narrow = drawn(&turned);
    if width_of(&narrow) <= room {
        return narrow.trim_fmt() + "\n";
    }
    let mut text = String::new();
    let mut from = 1;
    while from < rows[0].len() {
        // As many columns as there is room for, and one at least.
        let part = |to: usize| -> Vec<Vec<String>> {
            let row = |row: &Vec<String>| {
                let rest = row.get(from..to.min(row.len())).unwrap_or_default();
                std::iter::once(row[0].clone())
                    .chain(rest.iter().cloned())
                    .collect()
            };
            rows.iter().map(row).collect()
        };
        let most = (from + 1..=rows[0].len())
            .take_while(|to| *to == from + 1 || width_of(&drawn(&part(*to))) <= room)
            .last()
            .unwrap_or(rows[0].len());
        let mut block = drawn(&part(most));
        if width_of(&block) > room {
            // Words that are too long for a line go on below.
            block
                .set_content_arrangement(ContentArrangement::Dynamic)
                .set_width(u16::try_from(room).unwrap_or(u16::MAX));
            for column in block.column_iter_mut().skip(1) {
                column.set_cell_alignment(CellAlignment::Left);
            }
        }
        if !text.is_empty() {
            text.push('\n');
        }
        text += &block.trim_fmt();
        text.push('\n');
        from = most;
    }
    text
}

/// Text in which no line is longer than `room`: words that are too many go on below, as far in as their line begins.
/// What has no gap stays whole, as does a command between backticks, so that it can be copied.
pub fn wrapped(text: &str, room: Option<usize>) -> String {
    let Some(room) = room else {
        return text.to_owned();
    };
    let mut out = String::with_capacity(text.len() + 64);
    for line in text.split_inclusive('\n') {
        if columns(line.trim_end_matches('\n')) <= room {
            out += line;
            continue;
        }
        let indent = line.len() - line.trim_start_matches(' ').len();
        let mut used = 0;
        for word in words(line.trim_end(), room - indent.min(room)) {
            if used > indent && used + columns(word.trim_end()) > room {
                while out.ends_with(' ') {
                    out.pop();
                }
                out.push('\n');
                out += &" ".repeat(indent);
                used = indent;
            }
            out += word;
            used += columns(word);
        }
        if line.ends_with('\n') {
            out.push('\n');
        }
    }
    out
}

/// How many characters of a terminal's line a text takes: what sets colours takes none.
fn columns(text: &str) -> usize {
    let mut coloured = false;
    let shown = |c: &char| {
        let was = coloured;
        coloured = *c == '\x1b' || was && *c != 'm';
        !coloured && !was
    };
    text.chars().filter(shown).count()
}

/// The words of a line with the gaps behind them. What is between backticks is one, where it fits on a line.
fn words(line: &str, room: usize) -> Vec<&str> {
    let mut words = Vec::new();
    let (mut from, mut quoted) = (0, false);
    for (at, c) in line.char_indices() {
        if c == '`' {
            let ahead = line[at + 1..].find('`');
            quoted = !quoted && ahead.is_some_and(|far| columns(&line[at..at + far + 2]) <= room);
        }
        if c == ' ' && !quoted {
            words.push(&line[from..=at]);
            from = at + 1;
        }
    }
    words.push(&line[from..]);
    words
}

/// How many characters a line of the terminal at standard output has; `None` where there is no terminal: another program
/// reads rows whole, whatever `COLUMNS` says to it (notebooks and test runners set it).
pub fn room() -> Option<usize> {
    Table::new().width().map(usize::from)
}

/// A header's lines as one; what was parted by a hyphen is one word again.
fn one_line(cell: &str) -> String {
    cell.replace("-\n", "").replace('\n', " ")
}

/// The 99.9th percentile; of fewer than 1000 it would be the greatest again.
pub(super) fn far(of: &Percentiles) -> Option<f64> {
    of.p999.filter(|p999| of.max.is_some_and(|max| max > *p999))
}

fn width_of(table: &Table) -> usize {
    table
        .lines()
        .map(|line| line.chars().count())
        .max()
        .unwrap_or(0)
}

fn drawn(rows: &[Vec<String>]) -> Table {
    let mut table = Table::new();
    table
        .load_style(STYLE)
        .set_content_arrangement(ContentArrangement::Disabled);
    table.set_header(&rows[0]);
    table.add_rows(&rows[1..]);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// What is said of axes that swing at rest under the gains of their calibration, and of micros that swing for longer than was believed.
pub(super) fn swings(document: &AlignmentDocument) -> impl Iterator<Item = String> {
    let last = document
        .fibers
        .iter()
        .rev()
        .map(|fiber| &fiber.gentler_gains);
    let axes = last.filter(|axes| !axes.is_empty()).take(1).flatten();
    let axes = axes.map(|(axis, share)| {
        format!(
            "{axis} swings at rest under the gains of its calibration: they were made {share:.2} times as large on the way. `pigtail commission` finds \
             such as it bears."
        )
    });
    let slow = |fiber: &FiberRow| Some((fiber.port, fiber.micro_settling_s?));
    let micros = document.fibers.iter().filter_map(slow).map(|(port, seconds)| {
        format!(
            "{port}: its micro swings for longer than is believed, so it was waited for {seconds:.1} s and its lines and circles were as slow. \
             `pigtail commission` measures how it swings."
        )
    });
    axes.chain(micros)
}

/// How a device was aligned: a row a fiber, what failed in a sentence, and the report if one was written.
pub fn alignment(document: &AlignmentDocument, room: Option<usize>) -> String {
    let mut text = table(&fibers(document), room);
    for fiber in &document.fibers {
        if fiber.outcome != OutcomeCode::Aligned {
            let _ = writeln!(text, "{}: {}", fiber.port, fiber.detail);
        }
    }
    if document.collision {
        text += "A fiber hit the chip.\n";
    }
    for said in swings(document) {
        let _ = writeln!(text, "{}", wrapped(&said, room));
    }
    let _ = writeln!(
        text,
        "\n{:.2} s of machine time a fiber. Offsets are the truth, from the twin of seed {}.",
        document.seconds_per_fiber, document.seed
    );
    if !document.report.is_empty() {
        let _ = writeln!(text, "Report: {}", document.report);
    }
    text
}

/// The header and a row a fiber.
fn fibers(document: &AlignmentDocument) -> Vec<Vec<String>> {
    let names = document.phase_names();
    let mut header = vec!["fiber".to_owned(), "outcome".to_owned()];
    header.extend(names.iter().map(|name| format!("{name}\ns")));
    header.extend(["in all\ns", "x\num", "y\num", "z\num", "loss\ndB"].map(str::to_owned));
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
    };
    let mut rows = vec![header];
    rows.extend(document.fibers.iter().map(|fiber| {
        let mut row = vec![fiber.port.to_owned(), fiber.verdict().to_string()];
        row.extend(names.iter().map(|name| number(fiber.seconds_in(name), 2)));
        let offset = fiber.offset_um;
        row.push(number(Some(fiber.seconds), 2));
        row.push(number(offset.map(|o| o.x), 3));
        row.push(number(offset.map(|o| o.y), 3));
        row.push(number(offset.map(|o| o.z), 2));
        row.push(number(fiber.coupling_loss_db, 2));
        row
    }));
    rows
}

/// What a campaign came to, of which so many devices were done just now.
pub fn campaign(document: &CampaignDocument, devices_now: u64, room: Option<usize>) -> String {
    let mut out = String::new();
    let sure = &document.confidence;
    let machines = document.machines.max(1);
    let on = match document.devices_each {
        1 => String::new(),
        _ => format!(" on {machines} machines"),
    };
    let fleet = match document.fleet.as_str() {
        NOMINAL => String::new(),
        fleet => format!(", fleet {fleet}"),
    };
    let _ = writeln!(
        out,
        "{} devices{on}, seeds {} to {}, by the {} procedure, {}{fleet}\n",
        document.devices,
        document.seed,
        document.seed + machines - 1,
        document.procedure,
        document.scenario
    );
    for (what, part, of, [low, high]) in [
        (
            "fibers aligned",
            document.aligned,
            document.fibers,
            sure.fibers_aligned,
        ),
        (
            "whole devices",
            document.devices_aligned,
            document.devices,
            sure.devices_aligned,
        ),
        (
            "wrongly \"aligned\"",
            document.wrong.count,
            document.fibers,
            sure.fibers_wrong,
        ),
    ] {
        let _ = writeln!(
            out,
            "{what:17}  {part} of {of}: {} (95 %: {} to {})",
            percent(part as f64 / of.max(1) as f64),
            percent(low),
            percent(high)
        );
    }
    let _ = writeln!(out);
    if document.faults != "none" {
        faults(&mut out, document, room);
    }
    let o = &document.offset_um;
    let header = ["", "mean", "p50", "p90", "p99", "p99.9", "max"]
        .map(str::to_owned)
        .to_vec();
    let rows = [
        ("time, s", &document.seconds_per_fiber, 2),
        ("x, um", &o.x, 3),
        ("y, um", &o.y, 3),
        ("z, um", &o.z, 3),
        ("loss, dB", &document.coupling_loss_db, 3),
    ]
    .into_iter()
    .map(|(name, of, digits)| {
        let number = |value: Option<f64>| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let mut row = vec![name.to_owned()];
        row.extend([of.mean, of.p50, of.p90, of.p99, far(of), of.max].map(number));
        row
    });
    out += &table(
        &std::iter::once(header).chain(rows).collect::<Vec<_>>(),
        room,
    );
    failed(&mut out, document);
    idle(&mut out, document);
    let _ = writeln!(
        out,
        "\nTime is machine time a fiber; x, y and z are the truth, from the twins, without sign.\n\
         Tolerance: {}, {} and {} um. {}",
        Procedure::tolerance_of(&document.procedure),
        Procedure::tolerance_of(&document.procedure),
        TOLERANCE_Z_UM,
        if devices_now == 0 {
            "Nothing was left to be done.".to_owned()
        } else {
            let seconds = document.wall_seconds;
            format!(
                "{seconds:.1} s here, {:.1} devices/s.",
                devices_now as f64 / seconds.max(1e-3)
            )
        }
    );
    let _ = writeln!(out, "Rows: {}", document.rows);
    let _ = writeln!(out, "Report: {}", document.report);
    out
}

/// How idle the manipulators were.
fn idle(out: &mut String, document: &CampaignDocument) {
    if let Some(arms) = &document.arms {
        let _ = writeln!(
            out,
            "\nThe left manipulator stands still for {:.1} % of the time, the right one for {:.1} %; both move for {:.1} %.",
            arms.idle_percent.left, arms.idle_percent.right, arms.both_moving_percent
        );
    }
}

/// Causes of failure, and seeds to replay them.
fn failed(out: &mut String, document: &CampaignDocument) {
    if !document.failed.is_empty() {
        let _ = writeln!(
            out,
            "\nNot aligned, and a seed to replay with `{}`:",
            document.replay_command()
        );
    }
    for (cause, count) in &document.failed {
        let seeds = document.replay.get(cause).map_or(&[][..], Vec::as_slice);
        let shown: Vec<_> = seeds.iter().take(5).map(u64::to_string).collect();
        let _ = writeln!(out, "  {count:5} {cause}: {}", shown.join(", "));
    }
}

/// How devices ended on which something was broken on purpose.
fn faults(out: &mut String, document: &CampaignDocument, room: Option<usize>) {
    let number = |n: u64| n.to_string();
    let header = [
        "broken", "devices", "stopped", "gave up", "aligned", "false", "touched", "failed",
    ]
    .map(str::to_owned)
    .to_vec();
    let rows = document.by_fault.iter().map(|(name, of)| {
        let mut row = vec![name.clone()];
        row.extend(
            [
                of.devices,
                of.tripped,
                of.given_up,
                of.aligned,
                of.false_aligned,
                of.collisions,
                of.broken,
            ]
            .map(number),
        );
        row
    });
    *out += &table(
        &std::iter::once(header).chain(rows).collect::<Vec<_>>(),
        room,
    );
    let _ = writeln!(out, "\nRules that stopped the machine:");
    for (rule, count) in &document.tripped {
        let _ = writeln!(out, "  {count:6} {rule}");
    }
    let _ = writeln!(out);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn widest(text: &str) -> usize {
        text.lines()
            .map(|line| line.chars().count())
            .max()
            .unwrap_or(0)
    }

    fn wide(columns: usize, rows: usize) -> Vec<Vec<String>> {
        let row = |r: usize| (0..columns).map(|c| format!("value {r}.{c}")).collect();
        (0..rows).map(row).collect()
    }

    #[test]
    fn a_table_that_is_too_wide_is_folded_and_loses_nothing() {
        for (columns, rows) in [(3, 3), (12, 3), (30, 20)] {
            let cells = wide(columns, rows);
            let text = table(&cells, Some(80));
            assert!(widest(&text) <= 80, "{text}");
            for cell in cells.iter().flatten() {
                assert!(text.contains(cell.as_str()), "{cell} in {text}");
            }
        }
    }

    #[test]
    fn words_that_are_too_long_for_a_line_go_on_below() {
        let long = "one word after the other ".repeat(12);
        let rows = [
            vec!["a".to_owned(), "b".to_owned()],
            vec!["x".to_owned(), long.clone()],
        ];
        let text = table(&rows, Some(80));
        assert!(widest(&text) <= 80, "{text}");
        assert_eq!(text.matches("other").count(), 12);
        let text = wrapped(&format!("  {long}\nshort\n"), Some(60));
        assert!(widest(&text) <= 60, "{text}");
        assert!(
            text.lines()
                .nth(1)
                .is_some_and(|line| line.starts_with("  ")),
            "{text}"
        );
        assert!(text.ends_with("\nshort\n"));
        assert_eq!(text.matches("other").count(), 12);
    }

    #[test]
    fn what_is_to_be_copied_is_not_split() {
        let command = "`pigtail tune left.z --rig my-rig --write`";
        let text = format!("note: gains are missing, which {command} finds in a minute or two\n");
        let folded = wrapped(&text, Some(60));
        assert!(widest(&folded) <= 60, "{folded}");
        assert!(folded.contains(command), "{folded}");
        // One that is longer than a line cannot but be.
        assert!(widest(&wrapped(&text, Some(30))) <= 30);
        let path = "/a/path/that/is/longer/than/forty/characters/calibration.toml";
        let folded = wrapped(&format!("error: {path}: cannot be read\n"), Some(40));
        assert_eq!(folded, format!("error:\n{path}:\ncannot be read\n"));
    }

    #[test]
    fn colours_take_no_room() {
        let text = "\x1b[1m\x1b[31merror:\x1b[0m invalid value for a key\n";
        assert_eq!(wrapped(text, Some(31)), text);
        assert!(wrapped(text, Some(20)).contains("value\nfor a key"));
    }
}
