//! The ways to align a device, by the names that a user gives them.

use pigtail_control::procedure::{self, FiberReport};
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use strum::VariantArray;

/// A way to align a device. To add one: a variant here, and its entry below.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
    serde::Serialize,
    serde::Deserialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum Procedure {
    /// Raster, nine-point climb and stepwise approach, one fiber after the other
    Thesis,
    /// Vision on the way, lines at constant speed, circles through the approach
    #[default]
    Fast,
    /// Without any micro: columns of the macro, then pulses by light alone, to 0.2 um
    MacroOnly,
}

/// Tolerance of an aligned fiber in x and y (thesis 3.1), micrometres.
pub const TOLERANCE_XY_UM: f64 = 0.1;

/// See [`Procedure::tolerance_xy_um`]: that of the thesis (3.1) needs a micro.
const MACRO_TOLERANCE_XY_UM: f64 = 0.2;

/// What the program has to know of a procedure.
struct Entry {
    run: fn(&mut Station, &Recipe) -> Vec<FiberReport>,
    phases: &'static [&'static str],
    /// About how long a device takes, seconds.
    seconds: f64,
    /// How near to the peak in x and y a fiber must be in truth to count as aligned, micrometres.
    tolerance_xy_um: f64,
}

impl Procedure {
    fn entry(self) -> Entry {
        match self {
            Self::Thesis => Entry {
                run: procedure::thesis,
                phases: &["coarse", "sensing", "raster", "climb", "approach", "final"],
                seconds: 75.0,
                tolerance_xy_um: TOLERANCE_XY_UM,
            },
            Self::Fast => Entry {
                run: pigtail_control::fast::fast,
                phases: &["coarse", "sensing", "search", "centre", "approach", "final"],
                seconds: 3.0,
                tolerance_xy_um: TOLERANCE_XY_UM,
            },
            Self::MacroOnly => Entry {
                run: pigtail_control::nudge::macro_only,
                phases: &["coarse", "sensing", "search", "centre", "approach", "final"],
                seconds: 70.0,
                tolerance_xy_um: MACRO_TOLERANCE_XY_UM,
            },
        }
    }

    /// How near to the peak in x and y a fiber must be in truth to count as aligned, micrometres.
    pub fn tolerance_xy_um(self) -> f64 {
        self.entry().tolerance_xy_um
    }

    /// About how long a device takes, seconds of machine time: when a fault may come.
    pub fn seconds(self) -> f64 {
        self.entry().seconds
    }

    /// The tolerance of the procedure of a name, as documents have it; the thesis's for others.
    pub fn tolerance_of(name: &str) -> f64 {
        Self::VARIANTS
            .iter()
            .find(|procedure| procedure.name() == name)
            .map_or(TOLERANCE_XY_UM, |procedure| procedure.tolerance_xy_um())
    }

    /// Its name in options and documents.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The phases that a campaign's rows give a column each. What a procedure spends elsewhere
    /// is summed in one more.
    pub fn phases(self) -> &'static [&'static str] {
        self.entry().phases
    }

    /// Aligns a device. The machine's fault is the outcome of the fiber that it happened to.
    pub fn run(self, station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
        (self.entry().run)(station, recipe)
    }
}
