//! What devices came to that a machine was tried on.

use super::Found;
use pigtail_control::belief::Place;
use pigtail_control::job::FiberReport;
use pigtail_control::outcome::Outcome;
use pigtail_control::recipe::Accept;
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::Sorted;
use serde_json::{Map, json};

/// The first device of the acceptance test: nobody's production comes so far.
pub(super) const DEVICES: u64 = 900_000;

/// Of the fibers that were attempted so many are to be aligned: of those that are not it is known, and they are tried with another
/// fiber. A choice.
const YIELD: f64 = 0.9;

/// How the fibers of some devices ended, and whether that will do.
pub(super) fn judged(devices: &[Vec<FiberReport>], accept: &Accept) -> Found {
    let (mut aligned, mut fibers, mut why) = (0_u64, 0_u64, String::new());
    let mut stopped = false;
    let mut seconds = Vec::new();
    let mut places = Vec::new();
    for (k, device) in devices.iter().enumerate() {
        for fiber in device {
            fibers += 1;
            if fiber.outcome == Outcome::NotAttempted {
                continue;
            }
            seconds.push(fiber.seconds());
            stopped |= fiber.outcome.fault().is_some();
            if fiber.outcome.is_aligned() {
                aligned += 1;
                places.extend(fiber.place);
            } else if why.is_empty() {
                why = format!("device {}, {}: {}", k + 1, fiber.port, fiber.outcome);
            }
        }
    }
    let attempted = seconds.len() as f64;
    if !stopped && attempted > 0.0 && aligned as f64 >= YIELD * attempted {
        why.clear();
    }
    let seconds = Sorted::new(seconds);
    let mut values = Map::new();
    if let Some(capability) = capability(&places, accept) {
        let [x, y, z] = capability.map(|cpk| rounded(cpk, 1e-3));
        let least = if z < x.min(y) { "z" } else { "x and y" };
        values.insert("cpk".to_owned(), json!({"x": x, "y": y, "z": z}));
        values.insert("limited_by".to_owned(), json!(least));
    }
    values.insert("devices".to_owned(), json!(devices.len()));
    values.insert("attempted".to_owned(), json!(attempted));
    values.insert("fibers".to_owned(), json!(fibers));
    values.insert("aligned".to_owned(), json!(aligned));
    for (name, share) in [("seconds_p50", 0.5), ("seconds_max", 1.0)] {
        let value = seconds.percentile(share).map(|value| rounded(value, 1e-4));
        values.insert(name.to_owned(), json!(value));
    }
    Found { values, why }
}

/// Process capability, Cpk, in x, y and z by control's own belief of where fibers are: the tolerance, less what they are believed to be
/// off, over half the width that holds 99.73 % (three standard deviations of a normal error). The median fiber's; `None` of none.
fn capability(places: &[Place], accept: &Accept) -> Option<[f64; 3]> {
    /// What three standard deviations to either side hold.
    const HELD: f64 = 0.9973;
    let of = |place: &Place| {
        let [x, y, z] = place.half_widths(HELD);
        [
            accept.aside / x,
            accept.aside / y,
            (accept.gap - place.off.abs()) / z,
        ]
    };
    let all: Vec<[f64; 3]> = places.iter().map(of).collect();
    let median = |i: usize| Sorted::new(all.iter().map(|cpk| cpk[i]).collect()).percentile(0.5);
    Some([median(0)?, median(1)?, median(2)?])
}
