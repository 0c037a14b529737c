//! What lies on a tray: `trays/*.toml`.

use pigtail_hal::{Error, config, quantity};
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The content of a tray's file.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tray {
    /// The tray's name.
    pub name: String,
    /// The production recipe of its devices, by name or file.
    pub recipe: String,
    /// Where the tips of both manipulators get adhesive.
    pub dispenser: Dispenser,
    /// The devices, in the order in which they come.
    pub devices: Vec<Device>,
    /// The fibers.
    pub fibers: Vec<Fiber>,
    /// The places of fibers, by name.
    pub places: BTreeMap<String, Place>,
}

/// Where tips get adhesive, in the frame of a chip by design. One needle serves both manipulators, one at a time.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Dispenser {
    /// The left one's tip, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub left: [f64; 3],
    /// The right one's tip, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub right: [f64; 3],
}

/// A device of a tray.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Device {
    /// Its serial number.
    pub serial: String,
    /// Its place on the tray.
    pub place: String,
    /// Its production recipe, where that is not the tray's.
    #[serde(default)]
    pub recipe: Option<String>,
    /// Place of the fiber for each of its ports.
    pub fibers: BTreeMap<String, String>,
}

/// A fiber of a tray.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fiber {
    /// Its serial number.
    pub serial: String,
    /// The place where it lies.
    pub place: String,
}

/// A place of a fiber.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Where its tip is gripped, in the frame of a chip by design, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub at: [f64; 3],
}

impl Tray {
    /// Reads a tray, `text` of `file`.
    ///
    /// # Errors
    ///
    /// When it is no TOML, or a key is unknown, missing or out of its range.
    pub fn parse(file: &str, text: &str) -> Result<Self, Error> {
        config::parse(file, text)
    }

    /// The production recipe of a device.
    pub fn recipe_of<'t>(&'t self, device: &'t Device) -> &'t str {
        device.recipe.as_deref().unwrap_or(&self.recipe)
    }

    /// All production recipes that it names, each once.
    pub fn recipes(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.devices.iter().map(|d| self.recipe_of(d)).collect();
        all.push(&self.recipe);
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Has it come so many times, one right after the other and filled anew each time: all serial numbers and places of the second and
    /// those behind it end with which one they are of, `YB-0001/2`.
    pub fn refill(&mut self, times: u32) {
        let (devices, fibers) = (self.devices.clone(), self.fibers.clone());
        let places = self.places.clone();
        for which in 2..=times {
            let of = |name: &str| format!("{name}/{which}");
            self.devices.extend(devices.iter().map(|device| {
                Device {
                    serial: of(&device.serial),
                    place: of(&device.place),
                    recipe: device.recipe.clone(),
                    fibers: device
                        .fibers
                        .iter()
                        .map(|(port, place)| (port.clone(), of(place)))
                        .collect(),
                }
            }));
            self.fibers.extend(fibers.iter().map(|fiber| Fiber {
                serial: of(&fiber.serial),
                place: of(&fiber.place),
            }));
            self.places
                .extend(places.iter().map(|(name, place)| (of(name), *place)));
        }
    }

    /// Serial number of the fiber at a place.
    pub fn fiber_at(&self, place: &str) -> Option<&str> {
        let at = |fiber: &&Fiber| fiber.place == place;
        self.fibers.iter().find(at).map(|f| f.serial.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::mistakes;
    use crate::recipe::Production;

    #[test]
    fn a_tray_that_comes_again_has_devices_fibers_and_places_of_its_own() {
        let text = include_str!("../../../trays/four.toml");
        let once = Tray::parse("four.toml", text).unwrap();
        let mut tray = once.clone();
        tray.refill(1);
        assert_eq!(tray, once);
        tray.refill(3);
        assert_eq!(tray.devices.len(), 3 * once.devices.len());
        let last = tray.devices.last().unwrap();
        assert_eq!(
            (last.serial.as_str(), last.place.as_str()),
            ("YB-0004/3", "D4/3")
        );
        assert_eq!(tray.fiber_at(&last.fibers["input"]), Some("F-0004/3"));
        assert_eq!(tray.places["L4/3"], once.places["L4"]);
        let recipe = include_str!("../../../recipes/produce-fast.toml");
        let production = Production::parse("produce-fast.toml", recipe).unwrap();
        let recipes = BTreeMap::from([("produce-fast".to_owned(), production)]);
        assert_eq!(mistakes("four.toml", &tray, &recipes, &|_, _| true), []);
    }
}
