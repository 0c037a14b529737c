//! What is told of a tray: its fibers, its devices, and what happens meanwhile.

use crate::cell::Bar;
use crate::spread::Seen;
use crate::steadiness::Wander;
use crate::teach::{Lesson, Told};
use pigtail_hal::Fault;
use pigtail_model::frames::Displacement;
use serde::{Deserialize, Serialize};

/// How a fiber's production went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pigtail {
    /// The device's serial number.
    pub device: String,
    /// The port.
    pub port: String,
    /// The fiber's serial number.
    pub fiber: String,
    /// Where it lay.
    pub place: String,
    /// Whether it passed.
    pub passed: bool,
    /// What was wrong with it; empty where it passed.
    pub cause: String,
    /// The same in a sentence.
    pub detail: String,
    /// From when it was begun until it was verified, seconds.
    pub seconds: f64,
    /// Time of its alignment, seconds.
    pub align_seconds: f64,
    /// What the cure has done to it; nothing where it did not come to that.
    pub cured: Option<Cured>,
}

/// What the cure of a fiber has done to it, as far as its light tells.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cured {
    /// Loss that the cure has added when the lamp went off, decibels.
    pub after_cure_db: f64,
    /// And once the fiber was let go, decibels: by its light, and by where it is.
    pub after_release_db: f64,
    /// Standard deviation of that, decibels.
    pub sigma_db: f64,
    /// What light alone tells of what it has lost, or all that were cured together, decibels, and the standard deviation.
    #[serde(default)]
    pub by_light_db: Option<[f64; 2]>,
    /// What its place beside the peak costs, decibels, and the standard deviation; nothing where that was not to be seen.
    #[serde(default)]
    pub by_place_db: Option<[f64; 2]>,
    /// How far the adhesive pulled it until it came to rest, x and y of the manipulator, micrometres; nothing where nobody
    /// followed.
    pub before_um: Option<[f64; 2]>,
    /// Where it came to rest, from its peak, micrometres.
    pub beyond_um: [f64; 2],
    /// Where it is expected to be in the end, from its peak, micrometres.
    pub expected_um: [f64; 2],
    /// Where it is in the end, from its peak, x and y of the manipulator, micrometres, as its holder bent it a little before it let go; and
    /// the standard deviations. Nothing where that was not to be seen.
    #[serde(default)]
    pub beside_um: Option<[[f64; 2]; 2]>,
    /// The square of the share of its holder's way that it then went along, and the standard deviation.
    #[serde(default)]
    pub share: Option<[f64; 2]>,
    /// How far it is from its peak in the end, by that or else by what light was lost, micrometres...
    pub off_um: f64,
    /// ...and how well that is known, one standard deviation.
    pub off_sigma_um: f64,
    /// The square of that by the light that was lost, square micrometres, below zero where it has more light than before; and how well that is known.
    pub squared_um2: [f64; 2],
    /// How far the adhesive has shifted it in all, micrometres.
    pub shift_um: f64,
    /// What it and another fiber that was cured with it have lost together, decibels. Where their places were not seen light tells no more, and
    /// what is said of this one alone is half of it, give or take as much as is not known.
    #[serde(default)]
    pub together_db: Option<f64>,
    /// Standard deviation of that, or of what one fiber alone has lost, decibels.
    #[serde(default)]
    pub light_sigma_db: f64,
    /// By how much light through fibers that were fixed before has changed meanwhile, relative; nothing where there was none.
    #[serde(default)]
    pub wander: Option<f64>,
    /// The same with how well it is known, and over what time; where none was fixed before, what its own light has changed by beyond what
    /// places cost.
    #[serde(default)]
    pub look: Option<Wander>,
    /// What light has changed by beyond what the places of all cost that were cured with it: what ripples of the gap have done, nepers.
    #[serde(default)]
    pub rippled: Option<Seen>,
}

impl Cured {
    /// What has to be accepted: what was lost by all fibers that were cured with it, and the standard deviation, decibels.
    pub(super) fn lost(&self) -> (f64, f64) {
        match self.together_db {
            Some(both) => (both, self.light_sigma_db),
            None => (self.after_release_db, self.sigma_db),
        }
    }

    /// What it has taught.
    pub(super) fn lesson(&self) -> Option<Lesson> {
        let metres = |[x, y]: [f64; 2]| Displacement::new(1e-6 * x, 1e-6 * y);
        let [squared, noise] = self.squared_um2;
        let told = match self.beside_um {
            Some([at, sigma]) => Told::Place(metres(at), sigma.map(|s| 1e-6 * s)),
            None => Told::Squared(1e-12 * squared, 1e-12 * noise),
        };
        Some(Lesson {
            before: metres(self.before_um?),
            beyond: metres(self.beyond_um),
            told,
        })
    }
}

/// How a device's production went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Produced {
    /// Its serial number.
    pub serial: String,
    /// Its place.
    pub place: String,
    /// Its production recipe.
    pub recipe: String,
    /// Why it is rejected; empty where it is not.
    pub rejected: String,
    /// From when it was begun until it was over, seconds of machine time.
    pub start: f64,
    /// When it was over.
    pub end: f64,
    /// Its fibers, in order.
    pub fibers: Vec<Pigtail>,
}

/// What happens on a tray.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event<'e> {
    /// A device begins.
    Begin {
        /// Its serial number.
        device: &'e str,
        /// Machine time, seconds.
        time: f64,
    },
    /// A manipulator is done with something.
    Did(&'e Bar),
    /// A fiber is done with.
    Fiber(&'e Pigtail),
    /// A device is done with.
    Device(&'e Produced),
}

/// What came of a tray.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Run {
    /// The devices that were begun.
    pub devices: Vec<Produced>,
    /// What each manipulator did.
    pub bars: Vec<Bar>,
    /// Machine time of it all, seconds.
    pub seconds: f64,
    /// Why the machine stopped by itself.
    pub fault: Option<Fault>,
    /// Whether a person is called.
    pub called: Option<String>,
}
