//! All that is wrong with a tray, found before anything moves.

use crate::recipe::Production;
use crate::tray::Tray;
use pigtail_control::job::PORTS;
use pigtail_hal::{Error, Side};
use std::collections::BTreeMap;

/// The side whose manipulator carries the fiber of a port.
pub fn side_of(port: &str) -> Side {
    if port == PORTS[0] {
        Side::Left
    } else {
        Side::Right
    }
}

/// Every mistake of a tray with its recipes, by their names; `reaches` says whether the manipulator of a side gets to a place
/// in the frame of a chip by design.
#[expect(clippy::too_many_lines, reason = "a list of mistakes")]
pub fn mistakes(
    file: &str,
    tray: &Tray,
    recipes: &BTreeMap<String, Production>,
    reaches: &dyn Fn(Side, [f64; 3]) -> bool,
) -> Vec<Error> {
    let mut all = Vec::new();
    let mut add = |key: String, message: String| all.push(Error::new(file, key, message));
    let known: Vec<&str> = tray.places.keys().map(String::as_str).collect();
    if tray.devices.is_empty() {
        add(
            "devices".to_owned(),
            "is empty; accepted is one device or more".to_owned(),
        );
    }
    for key in unnamed(tray) {
        let message = "is empty; accepted is what it is to be found by later";
        add(key, message.to_owned());
    }
    twice(
        tray.devices.iter().map(|d| d.place.as_str()),
        |i, place, first| {
            let (this, other) = (&tray.devices[i].serial, &tray.devices[first].serial);
            add(
                format!("devices[{i}].place"),
                format!("{place} is double-booked: by {other} and {this}"),
            );
        },
    );
    twice(
        tray.devices.iter().map(|d| d.serial.as_str()),
        |i, serial, _| {
            add(
                format!("devices[{i}].serial"),
                format!("{serial} is there twice"),
            );
        },
    );
    twice(
        tray.fibers.iter().map(|f| f.place.as_str()),
        |i, place, first| {
            let (this, other) = (&tray.fibers[i].serial, &tray.fibers[first].serial);
            add(
                format!("fibers[{i}].place"),
                format!("{place} is double-booked: by fibers {other} and {this}"),
            );
        },
    );
    twice(
        tray.fibers.iter().map(|f| f.serial.as_str()),
        |i, serial, _| {
            add(
                format!("fibers[{i}].serial"),
                format!("{serial} is there twice"),
            );
        },
    );
    for (i, fiber) in tray.fibers.iter().enumerate() {
        if !tray.places.contains_key(&fiber.place) {
            add(
                format!("fibers[{i}].place"),
                format!(
                    "{} is no place of this tray; accepted are {known:?}",
                    fiber.place
                ),
            );
        }
    }
    for (side, at) in [
        (Side::Left, tray.dispenser.left),
        (Side::Right, tray.dispenser.right),
    ] {
        if !reaches(side, at) {
            add(
                format!("dispenser.{}", side.name()),
                format!("the {} manipulator does not get there", side.name()),
            );
        }
    }
    let mut used: BTreeMap<&str, String> = BTreeMap::new();
    for (i, device) in tray.devices.iter().enumerate() {
        let key = |port: &str| format!("devices[{i}].fibers.{port}");
        let named = tray.recipe_of(device);
        // What is wrong with one that is not there is said once, by who has read it.
        for port in recipes.get(named).map_or(&[][..], |recipe| &recipe.ports) {
            if !PORTS.contains(&port.as_str()) {
                add(
                    format!("devices[{i}].recipe"),
                    format!(
                        "{named} names port {port}, which {} has not; it has {PORTS:?}",
                        device.serial
                    ),
                );
            } else if !device.fibers.contains_key(port) {
                add(
                    format!("devices[{i}].fibers"),
                    format!(
                        "{} has no fiber for {port}, which {named} attaches",
                        device.serial
                    ),
                );
            }
        }
        for (port, place) in &device.fibers {
            if !PORTS.contains(&port.as_str()) {
                add(
                    key(port),
                    format!("there is no port {port}; accepted are {PORTS:?}"),
                );
                continue;
            }
            let Some(at) = tray.places.get(place) else {
                add(
                    key(port),
                    format!("{place} is no place of this tray; accepted are {known:?}"),
                );
                continue;
            };
            if tray.fiber_at(place).is_none() {
                add(
                    key(port),
                    format!("place {place} is empty: no fiber is there"),
                );
            }
            let side = side_of(port);
            if !reaches(side, at.at) {
                add(
                    key(port),
                    format!("the {} manipulator does not get to {place}", side.name()),
                );
            }
            let this = format!("{} {port}", device.serial);
            if let Some(other) = used.insert(place, this.clone()) {
                add(
                    key(port),
                    format!("{place} is double-booked: for {other} and for {this}"),
                );
            }
        }
    }
    all
}

/// The keys of names that are empty.
fn unnamed(tray: &Tray) -> Vec<String> {
    let mut names = vec![("name".to_owned(), &tray.name)];
    for (i, device) in tray.devices.iter().enumerate() {
        names.push((format!("devices[{i}].serial"), &device.serial));
        names.push((format!("devices[{i}].place"), &device.place));
    }
    for (i, fiber) in tray.fibers.iter().enumerate() {
        names.push((format!("fibers[{i}].serial"), &fiber.serial));
    }
    let empty = names.into_iter().filter(|(_, name)| name.trim().is_empty());
    empty.map(|(key, _)| key).collect()
}

/// Tells of each value that was there before: its index, itself, and the index of the first.
fn twice<'t>(values: impl Iterator<Item = &'t str>, mut tell: impl FnMut(usize, &str, usize)) {
    let mut first: BTreeMap<&str, usize> = BTreeMap::new();
    for (i, value) in values.enumerate() {
        if let Some(before) = first.get(value) {
            tell(i, value, *before);
        } else {
            first.insert(value, i);
        }
    }
}
