//! The ways to align a device, by the names that a user gives them.

use crate::calibrations::Part;
use pigtail_control::job::FiberReport;
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use pigtail_control::{baselines, fast, nudge, procedure};
use strum::VariantArray;

/// An alignment algorithm: a function over a [`Station`]. It may use all that a station offers, and
/// reaches neither the twin nor its truth.
#[derive(Debug, Clone, Copy)]
pub struct Algorithm {
    /// Its name.
    pub name: &'static str,
    /// What it does, in a few words.
    pub about: &'static str,
    /// Aligns the three fibers of a device, input first, and reports on each.
    pub run: fn(&mut Station, &Recipe) -> Vec<FiberReport>,
}

const FAST: Algorithm = Algorithm {
    name: "fast",
    about: "vision on the way, lines at constant speed, circles through the approach",
    run: fast::fast,
};

const THESIS: Algorithm = Algorithm {
    name: "thesis",
    about: "raster, nine-point climb through a slow approach, paraboloid at the end",
    run: procedure::thesis,
};

const MACRO_ONLY: Algorithm = Algorithm {
    name: "macro-only",
    about: "without any micro: columns of the macro, then pulses; claims 0.2 um only",
    run: nudge::macro_only,
};

/// All algorithms, in no order of merit: the procedures, and baselines to compare them with. To enter
/// one's own there is one line to add.
pub const ALGORITHMS: &[Algorithm] = &[
    FAST,
    THESIS,
    Algorithm {
        name: "spiral-nelder-mead",
        about: "baseline: spiral, Nelder and Mead's simplex, stepwise approach",
        run: baselines::spiral_nelder_mead,
    },
    Algorithm {
        name: "spiral-nine-point",
        about: "baseline: spiral, brightest of nine points, stepwise approach",
        run: baselines::spiral_nine_point,
    },
    MACRO_ONLY,
];

/// A way to align devices in earnest: one of [`ALGORITHMS`]. To add one: a variant here, and its entry
/// below.
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
    algorithm: Algorithm,
    phases: &'static [&'static str],
    /// About how long a device takes, seconds.
    seconds: f64,
    /// How near to the peak in x and y a fiber must be in truth to count as aligned, micrometres.
    tolerance_xy_um: f64,
}

impl Procedure {
    /// What of a calibration it makes use of, beside gains and geometry.
    pub fn believes(self) -> &'static [Part] {
        match self {
            Self::Thesis | Self::Fast => Part::ALIGNMENT,
            Self::MacroOnly => &[Part::Windup, Part::Impulse],
        }
    }

    fn entry(self) -> Entry {
        match self {
            Self::Thesis => Entry {
                algorithm: THESIS,
                phases: &["coarse", "sensing", "raster", "climb", "approach", "final"],
                seconds: 75.0,
                tolerance_xy_um: TOLERANCE_XY_UM,
            },
            Self::Fast => Entry {
                algorithm: FAST,
                phases: &["coarse", "sensing", "search", "centre", "approach", "final"],
                seconds: 3.0,
                tolerance_xy_um: TOLERANCE_XY_UM,
            },
            Self::MacroOnly => Entry {
                algorithm: MACRO_ONLY,
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
        (self.entry().algorithm.run)(station, recipe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_procedure_is_the_algorithm_of_its_name() {
        for procedure in Procedure::VARIANTS {
            let algorithm = procedure.entry().algorithm;
            assert_eq!(procedure.name(), algorithm.name);
            assert!(ALGORITHMS.iter().any(|a| a.name == algorithm.name));
        }
    }
}
