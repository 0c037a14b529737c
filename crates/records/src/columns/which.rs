//! Which column of a file is meant by a name, and in which unit it is.

use super::{By, Column, Table, Wanted};
use crate::units::{CURRENT, OTHER_UNITS, TIME, bare, foreign, unit_of};
use pigtail_hal::Error;
use pigtail_hal::quantity::{Dimension, RATIO};

/// The column that is meant by a name: the one that is called so; else the only one that is but for capitals and the way to write a micro, or that is
/// so without the unit that it ends with. What is taken is printed with the result.
fn meant(table: &Table, text: &str) -> Option<usize> {
    let plain = |name: &str| {
        let micro = name.replace(['\u{b5}', '\u{3bc}'], "u");
        micro.trim().to_lowercase()
    };
    let only = |is_it: &dyn Fn(&str) -> bool| {
        let mut such = (0..table.names().len()).filter(|place| is_it(&table.names()[*place]));
        such.next().filter(|_| such.next().is_none())
    };
    let wanted = plain(text);
    let exact = table.names().iter().position(|name| name == text);
    exact
        .or_else(|| only(&|name| plain(name) == wanted))
        .or_else(|| only(&|name| bare(name).is_some_and(|name| plain(name) == wanted)))
}

/// The column that is wanted, without its values, and its place in the table.
pub(super) fn locate(table: &Table, want: &Wanted) -> Result<(usize, Column), Error> {
    let text = &want.named.name;
    let names = table.names();
    let with_unit = || {
        let (name, unit) = text.rsplit_once(':')?;
        Some((meant(table, name)?, Some(unit.trim())))
    };
    let found = meant(table, text).map(|place| (place, None));
    let Some((place, given)) = found.or_else(with_unit) else {
        let message = format!("no such column for {}; {}", want.option, table.there_are());
        return Err(table.error(&**text, message));
    };
    let name = &names[place];
    let alike = names.iter().filter(|n| *n == name).count();
    if alike > 1 {
        let message = format!(
            "stands over {alike} columns, and {} could be any of them; accepted is a name that one column has alone",
            want.option
        );
        return Err(table.error(&**name, message));
    }
    let accepted = || {
        let units = want.of.iter().flat_map(|dimension| dimension.units);
        let names: Vec<&str> = units.map(|(unit, _)| *unit).collect();
        names.join(", ")
    };
    // `encoder_A` is a channel, where no current is wanted; `i_A` is none.
    let stem = name.to_lowercase();
    let stem = stem.rsplit_once('_').map_or("", |(stem, _)| stem);
    let current = ["i", "iq", "id"].contains(&stem) || stem.contains("current");
    let suffix = table
        .own_unit(place)
        .or_else(|| called_after_unit(name, want.of))
        .filter(|(of, unit)| {
            let channel = *of == CURRENT && *unit == "A" && !name.ends_with([']', ')']) && !current;
            !channel || want.of.contains(of)
        });
    let (dimension, unit, by) = match (given, suffix) {
        (Some(given), _) => {
            let Some((dimension, unit)) = unit_of(want.of, given) else {
                let message = format!(
                    "{} cannot be in \"{given}\"; accepted is {}",
                    want.option,
                    accepted()
                );
                return Err(table.error(&**name, message));
            };
            if let Some((_, own)) = suffix.filter(|(of, own)| *own != unit && want.of.contains(of))
            {
                let message = format!(
                    "is said to be in {given}, but its name says {own}; accepted is one of both: give the unit \
                     that its name has, or rename the column"
                );
                return Err(table.error(&**name, message));
            }
            (dimension, unit, By::Option)
        }
        (None, Some((dimension, unit))) if want.of.contains(&dimension) => {
            (dimension, unit, By::Name)
        }
        // A magnitude may be of anything over anything.
        (None, Some(_)) if want.of.contains(&RATIO) => (RATIO, RATIO.si(), By::Name),
        (None, Some((_, unit))) => {
            let message = format!(
                "its name says {unit}, which is no unit for {}; accepted is a column in {}, or its unit as \
                 \"{name}:UNIT\"",
                want.option,
                accepted()
            );
            return Err(table.error(&**name, message));
        }
        (None, None) if table.is_moments(place) && want.of.contains(&TIME) => {
            (TIME, TIME.si(), By::Name)
        }
        (None, None)
            if let Some(foreign) =
                foreign(name, want.of).or_else(|| other_unit(table, place, want.of)) =>
        {
            let message = format!(
                "its name says {foreign}, which is no unit that is read here; accepted is a column in {}, or its unit \
                 as \"{name}:UNIT\" where the name means something else",
                accepted()
            );
            return Err(table.error(&**name, message));
        }
        (None, None) => (want.of[0], want.of[0].si(), By::Nothing),
    };
    let column = Column {
        name: name.clone(),
        unit,
        dimension,
        values: Vec::new(),
        by,
    };
    Ok((place, column))
}

/// The unit after which a column is called, as `ms`: of those that are asked for, and of more letters than one, which may be a symbol.
fn called_after_unit(name: &str, of: &[Dimension]) -> Option<(Dimension, &'static str)> {
    let name = name.trim();
    unit_of(of, name).filter(|_| name.chars().count() > 1)
}

/// A unit that a column's name or header says and that is of nothing that is asked for here: `%`, `rpm`. A single letter behind an
/// underscore is a channel's; of anything over anything is what has a ratio.
fn other_unit<'a>(table: &'a Table, place: usize, of: &[Dimension]) -> Option<&'a str> {
    let name = &table.names()[place];
    table.unit_text(place).filter(|unit| {
        let channel = unit.chars().count() == 1 && *unit != "%" && !name.ends_with([']', ')']);
        OTHER_UNITS.contains(unit) && !channel && !of.contains(&RATIO)
    })
}
