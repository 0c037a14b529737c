//! A rig that is controlled by position: its files, read and checked, and a device aligned on it.
//!
//! Its datasheet says `kind = "bench"`. What it does not have (volts, vision, a sensing fiber) no file of it speaks of:
//! its calibration has poses that were taught.
//!
//! ```
//! use pigtail_control::station::Unobserved;
//! use pigtail_session::bench::{BenchSetup, align};
//! use pigtail_session::session::Options;
//!
//! let setup = BenchSetup::load("bench-piezo", "y-branch")?;
//! let mut bench = setup.twin(7)?;
//! let fibers = align(&setup.rig, &mut bench, &Options::default(), &mut Unobserved);
//! assert_eq!(fibers.len(), 3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::align::LONGEST;
use crate::calibrations::newest_date;
use crate::rig::{FILES, Named, Source, recipe_file, rig_file};
#[cfg(feature = "twin")]
use crate::rig::{Role, no_twin};
use crate::session::Options;
use pigtail_control::align::{Belief, Taught};
use pigtail_control::job::FiberReport;
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Observer;
use pigtail_hal::bench::spec::{ARMS, BenchSpec};
use pigtail_hal::bench::{Bench, Caps, GroupCaps, Meter, Pose};
use pigtail_hal::digest::hash;
use pigtail_hal::spec::OUTPUTS;
use pigtail_hal::{Error, config, quantity};
use pigtail_machines::bench::{Guard, Plane};
#[cfg(feature = "twin")]
use pigtail_twin::bench::{BenchPlant, BenchTwin};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::PI;
use std::path::PathBuf;

/// The content of a bench's `calibration.toml`.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchCalibration {
    /// Poses that were taught: one for each port.
    pub taught: Vec<TaughtPose>,
    /// Which meters measure the light of the outputs.
    pub meters: Meters,
    /// What was measured of its groups of axes, in place of what the datasheet says.
    #[serde(default)]
    pub groups: Arms,
}

/// What was measured of the groups of both arms.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Arms {
    /// The input's arm.
    #[serde(default)]
    pub left: ArmGroups,
    /// The outputs' arm.
    #[serde(default)]
    pub right: ArmGroups,
}

impl Arms {
    /// The groups by their names.
    fn all(&self) -> [(&'static str, &MeasuredGroup); 4] {
        let (left, right) = (&self.left, &self.right);
        [
            ("left.coarse", &left.coarse),
            ("left.fine", &left.fine),
            ("right.coarse", &right.coarse),
            ("right.fine", &right.fine),
        ]
    }

    /// Puts it in place of what a bench says of its groups of these names.
    pub fn put(&self, caps: &mut Caps) {
        for (name, measured) in self.all() {
            if let Some(group) = caps.groups.iter_mut().find(|group| group.name == name) {
                measured.put(group);
            }
        }
    }
}

/// What was measured of the groups of an arm.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ArmGroups {
    /// The group that goes far.
    #[serde(default)]
    pub coarse: MeasuredGroup,
    /// The one that goes exactly.
    #[serde(default)]
    pub fine: MeasuredGroup,
}

/// What was measured of a group: what is left out is as the datasheet says.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeasuredGroup {
    /// By how much a sample of light is later than the pose that it is of, as the group's own sensors have it, seconds.
    #[serde(default, with = "quantity::Optional::<quantity::NonNegativeTime>")]
    pub lag: Option<f64>,
    /// Standard deviation of that, seconds; goes with it.
    #[serde(default, with = "quantity::Optional::<quantity::NonNegativeTime>")]
    pub lag_deviation: Option<f64>,
    /// How far its axes fall short when they turn back, metres: x...
    #[serde(default, with = "quantity::Optional::<quantity::NonNegativeLength>")]
    pub backlash_x: Option<f64>,
    /// ...y...
    #[serde(default, with = "quantity::Optional::<quantity::NonNegativeLength>")]
    pub backlash_y: Option<f64>,
    /// ...and z.
    #[serde(default, with = "quantity::Optional::<quantity::NonNegativeLength>")]
    pub backlash_z: Option<f64>,
    /// When that was measured.
    #[serde(default)]
    pub date: Option<String>,
    /// By what.
    #[serde(default)]
    pub origin: Option<String>,
}

impl MeasuredGroup {
    /// Puts it in place of what the datasheet says of the group.
    fn put(&self, caps: &mut GroupCaps) {
        if let Some(lag) = self.lag.zip(self.lag_deviation) {
            caps.lag = lag;
        }
        let measured = [self.backlash_x, self.backlash_y, self.backlash_z];
        for (axis, backlash) in caps.axes.iter_mut().zip(measured) {
            if let Some((axis, backlash)) = axis.as_mut().zip(backlash) {
                axis.backlash = backlash;
            }
        }
    }
}

/// A pose that was taught: the coarse group stands at it, each axis having come from below, the fine group in its middle,
/// and the tip of a fiber touches the facet at the port's peak.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TaughtPose {
    /// The arm, by its name.
    pub arm: String,
    /// The port on the arm's side of the chip, from zero.
    pub port: usize,
    /// The coarse group's pose in x, y and z of the arm's frame, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub pose: [f64; 3],
    /// Standard deviation of where the peak is, in x and in y, metres: of chip, fiber and teaching together.
    #[serde(with = "quantity::PositiveLength")]
    pub across: f64,
    /// Standard deviation of where the facet is along z, metres...
    #[serde(with = "quantity::PositiveLength")]
    pub deviation_z: f64,
    /// ...and how far off it is at the most.
    #[serde(with = "quantity::PositiveLength")]
    pub bound_z: f64,
    /// When it was taught.
    #[serde(default)]
    pub date: Option<String>,
    /// By what.
    #[serde(default)]
    pub origin: Option<String>,
}

/// Which meters measure the light of the outputs.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Meters {
    /// The meter of each output, by its name.
    pub outputs: [String; OUTPUTS],
    /// When that was found.
    #[serde(default)]
    pub date: Option<String>,
    /// By what.
    #[serde(default)]
    pub origin: Option<String>,
}

impl BenchCalibration {
    /// Parses the content of a `calibration.toml` and checks it against the datasheet; `file` is its name in errors. What is believed, and
    /// what was measured of its groups.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range; a port was not taught, or twice; or there is no such arm or meter.
    pub fn parse(file: &str, text: &str, spec: &BenchSpec) -> Result<(Belief, Arms), Error> {
        let read: Self = config::parse(file, text)?;
        let error = |key: String, message: String| Error::new(file, key, message);
        let caps = spec.caps();
        let mut taught: Vec<Taught> = Vec::new();
        for (index, pose) in read.taught.iter().enumerate() {
            let key = |key: &str| format!("taught[{index}].{key}");
            let arm = ARMS.iter().position(|name| *name == pose.arm);
            let arm = arm.ok_or_else(|| {
                let message = format!("is \"{}\"; accepted is one of {ARMS:?}", pose.arm);
                error(key("arm"), message)
            })?;
            let ports = if arm == 0 { 1 } else { OUTPUTS };
            if pose.port >= ports {
                let message = format!("is {}; accepted is 0 to {}", pose.port, ports - 1);
                return Err(error(key("port"), message));
            }
            if taught
                .iter()
                .any(|of| (of.arm, of.port) == (arm, pose.port))
            {
                let message = format!("is {} once more; accepted is each port once", pose.port);
                return Err(error(key("port"), message));
            }
            let half = 0.5 * spec.coarse.travel;
            if let Some(far) = pose.pose.iter().find(|at| at.abs() > half) {
                let message = format!(
                    "{} mm is out of the coarse group's range; accepted is {} to {} mm",
                    1e3 * far,
                    -1e3 * half,
                    1e3 * half
                );
                return Err(error(key("pose"), message));
            }
            if pose.deviation_z > pose.bound_z {
                let message = format!(
                    "{} um is more than `bound_z`, {} um; accepted is no more",
                    1e6 * pose.deviation_z,
                    1e6 * pose.bound_z
                );
                return Err(error(key("deviation_z"), message));
            }
            let [x, y, z] = pose.pose;
            taught.push(Taught {
                arm,
                port: pose.port,
                pose: Pose::at(x, y, z),
                across: pose.across,
                bound_z: pose.bound_z,
                sigma_z: pose.deviation_z,
            });
        }
        for (arm, ports) in [(0, 1), (1, OUTPUTS)] {
            for port in 0..ports {
                if !taught.iter().any(|of| (of.arm, of.port) == (arm, port)) {
                    let message = format!(
                        "lacks port {port} of the {} arm; accepted is a pose for each port",
                        ARMS[arm]
                    );
                    return Err(error("taught".to_owned(), message));
                }
            }
        }
        let meters = read.meters.outputs.iter().map(|name| {
            let meter = caps.channels.iter().position(|of| of.name == *name);
            meter.map(Meter).ok_or_else(|| {
                let names: Vec<_> = caps.channels.iter().map(|of| &of.name).collect();
                let message = format!("has \"{name}\"; accepted is one of {names:?}");
                error("meters.outputs".to_owned(), message)
            })
        });
        let meters = meters.collect::<Result<_, _>>()?;
        for (name, measured) in read.groups.all() {
            if measured.lag.is_some() != measured.lag_deviation.is_some() {
                let message =
                    "comes without the other; accepted are `lag` and `lag_deviation`, or neither";
                return Err(error(format!("groups.{name}.lag"), message.to_owned()));
            }
        }
        Ok((Belief { taught, meters }, read.groups))
    }
}

/// Whether the rig of a name is one that is controlled by position.
///
/// # Errors
///
/// When there is no such rig, or its datasheet names a kind that is none.
pub fn is_bench(rig: &str) -> Result<bool, Error> {
    let named = Named {
        rig,
        ..Named::default()
    };
    let machine = rig_file(&named, 0)?;
    machine.map_or(Ok(false), |file| BenchSpec::is_of(&file.name, &file.text))
}

/// What is known of a bench beforehand, and what is to be done on it: read and checked. It knows of no truth.
#[derive(Debug, Clone)]
pub struct BenchRig {
    /// The rig as the user named it.
    pub name: String,
    /// The recipe as the user named it.
    pub recipe_name: String,
    /// The datasheet.
    pub spec: BenchSpec,
    /// What was measured of its groups, in place of what the datasheet says.
    pub groups: Arms,
    /// The belief, for control.
    pub belief: Belief,
    /// What is to be done.
    pub recipe: Recipe,
    /// The newest date in the calibration's file.
    pub calibration_date: Option<String>,
    /// The calibration that was named in place of the rig's own.
    pub believing: Option<PathBuf>,
    /// Name and SHA-256 of each file that was read, in the order of reading.
    pub hashes: Vec<(String, String)>,
    /// Which of these is the calibration.
    pub(crate) calibration: usize,
    /// The truth, if it has one.
    #[cfg(feature = "twin")]
    truth: Option<Source>,
}

impl BenchRig {
    /// Loads the rig and the recipe that the user named; see [`Rig::load_named`](crate::Rig::load_named).
    ///
    /// # Errors
    ///
    /// The first mistake found, with file, key, value and what would be accepted.
    pub fn load_named(named: &Named) -> Result<Self, Error> {
        let missing = |file: &str| Error::new(named.rig, file, "is not there".to_owned());
        let file = |index: usize| rig_file(named, index);
        let machine = file(0)?.ok_or_else(|| missing(FILES[0]))?;
        let spec = BenchSpec::parse(&machine.name, &machine.text)?;
        let truth = file(1)?;
        let calibration = file(2)?.ok_or_else(|| missing(FILES[2]))?;
        let (belief, groups) =
            BenchCalibration::parse(&calibration.name, &calibration.text, &spec)?;
        let source = recipe_file(named.recipe)?;
        let recipe: Recipe = config::parse(&source.name, &source.text)?;
        check(&recipe, &belief).map_err(|(key, why)| Error::new(&source.name, key, why))?;
        let hashed = |source: &Source| (source.name.clone(), hash(&source.text));
        let read = [
            Some(&machine),
            truth.as_ref(),
            Some(&calibration),
            Some(&source),
        ];
        Ok(Self {
            name: named.rig.to_owned(),
            recipe_name: named.recipe.to_owned(),
            spec,
            groups,
            belief,
            recipe,
            calibration_date: newest_date(&calibration.text),
            believing: named.calibration.map(PathBuf::from),
            hashes: read.into_iter().flatten().map(hashed).collect(),
            calibration: 1 + usize::from(truth.is_some()),
            #[cfg(feature = "twin")]
            truth: truth.map(|source| Source {
                role: Some(Role::Plant),
                ..source
            }),
        })
    }

    /// Whether a twin can be drawn.
    #[cfg(feature = "twin")]
    pub fn has_twin(&self) -> bool {
        self.truth.is_some()
    }

    /// Planes that no tip passes: where facets are at the nearest.
    pub fn planes(&self) -> Vec<Plane> {
        let plane = |of: &Taught| Plane::of(of.arm, of.port, &of.pose, of.bound_z);
        self.belief.taught.iter().map(plane).collect()
    }
}

/// What a bench without vision makes use of in a recipe.
fn check(recipe: &Recipe, belief: &Belief) -> Result<(), (&'static str, String)> {
    let nearest = belief
        .taught
        .iter()
        .map(|of| of.bound_z)
        .fold(0.0, f64::max);
    let um = 1e6;
    for (key, value, low, high, unit, scale) in [
        (
            "approach.gap",
            recipe.approach.gap,
            2.0 * nearest,
            1e-4,
            "um",
            um,
        ),
        ("final.accuracy", recipe.last.accuracy, 1e-9, 1e-6, "um", um),
        ("fast.accuracy", recipe.fast.accuracy, 1e-9, 1e-6, "um", um),
        ("mode.radius", recipe.mode.radius, 1e-7, 1e-4, "um", um),
        (
            "mode.wavelength",
            recipe.mode.wavelength,
            1e-7,
            2e-5,
            "um",
            um,
        ),
        (
            "fast.conical_scan.radius",
            recipe.fast.conical_scan.radius,
            0.05,
            2.0,
            "widths",
            1.0,
        ),
        (
            "ports.exit_angle",
            recipe.ports.exit_angle,
            -PI / 3.0,
            PI / 3.0,
            "deg",
            180.0 / PI,
        ),
    ] {
        if !(low..=high).contains(&value) {
            let message = format!(
                "{} {unit} is out of range; accepted is {} to {} {unit}",
                value * scale,
                low * scale,
                high * scale
            );
            return Err((key, message));
        }
    }
    Ok(())
}

/// Aligns a device on any bench of this rig, guarded: a twin, or hardware of one's own. A fault of the bench is how the
/// fiber ended to which it happened.
pub fn align(
    rig: &BenchRig,
    bench: &mut dyn Bench,
    options: &Options,
    observer: &mut dyn Observer,
) -> Vec<FiberReport> {
    let mut guard = guarded(rig, bench, options);
    pigtail_control::align::align(&mut guard, &rig.belief, &rig.recipe, observer)
}

/// A bench of this rig behind its guard.
pub fn guarded<B: Bench>(rig: &BenchRig, bench: B, options: &Options) -> Guard<B> {
    let mut caps = bench.caps().clone();
    rig.groups.put(&mut caps);
    Guard::new(bench)
        .with_caps(caps)
        .with_planes(rig.planes())
        .with_stop(options.stop.clone())
        .with_longest(LONGEST.min(options.longest))
}

/// A bench and its truth: all that it takes to draw twins.
#[cfg(feature = "twin")]
#[derive(Debug, Clone)]
pub struct BenchSetup {
    /// What control may know.
    pub rig: BenchRig,
    /// The truth, for twins alone.
    pub plant: BenchPlant,
    /// How benches are treated.
    pub options: Options,
}

#[cfg(feature = "twin")]
impl BenchSetup {
    /// Loads a rig that has a twin, and a recipe.
    ///
    /// # Errors
    ///
    /// The first mistake found, with file, key, value and what would be accepted; a rig without a twin.
    pub fn load(rig: &str, recipe: &str) -> Result<Self, Error> {
        Self::load_named(&Named {
            rig,
            recipe,
            ..Named::default()
        })
    }

    /// The same, believing another calibration.
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn load_named(named: &Named) -> Result<Self, Error> {
        Self::of(BenchRig::load_named(named)?)
    }

    /// A bench with the truth that was read with it.
    ///
    /// # Errors
    ///
    /// When it has none, or it is no plant.
    pub fn of(rig: BenchRig) -> Result<Self, Error> {
        let truth = rig.truth.as_ref().ok_or_else(|| no_twin(&rig.name))?;
        Ok(Self {
            plant: BenchPlant::parse(&truth.name, &truth.text)?,
            rig,
            options: Options::default(),
        })
    }

    /// The twin that a seed draws.
    ///
    /// # Errors
    ///
    /// When the plant makes no bench.
    pub fn twin(&self, seed: u64) -> Result<BenchTwin, Error> {
        BenchTwin::new(self.rig.spec.clone(), &self.plant, seed).map_err(|why| {
            let file = self
                .rig
                .truth
                .as_ref()
                .map_or(&self.rig.name, |of| &of.name);
            Error::new(file, "", why.to_string())
        })
    }
}

#[cfg(all(test, feature = "twin"))]
mod tests {
    use super::*;
    use crate::rig::BENCH_RIG_NAME;

    const CALIBRATION: &str = include_str!("../../../rigs/bench-piezo/calibration.toml");

    #[test]
    fn the_shipped_bench_is_known_for_one_and_well() {
        assert_eq!(is_bench(BENCH_RIG_NAME), Ok(true));
        assert_eq!(is_bench("afpm"), Ok(false));
        assert!(is_bench("nowhere").is_err());
        let setup = BenchSetup::load(BENCH_RIG_NAME, "y-branch").expect("it ships");
        assert_eq!(setup.rig.belief.taught.len(), 3);
        assert_eq!(setup.rig.hashes.len(), 4);
        let error = crate::Rig::load(BENCH_RIG_NAME, "y-branch").unwrap_err();
        assert!(error.to_string().contains("`kind`"), "{error}");
    }

    #[test]
    fn mistakes_of_a_calibration_are_explained() {
        let spec = include_str!("../../../rigs/bench-piezo/machine.toml");
        let spec = BenchSpec::parse("machine.toml", spec).expect("it ships");
        for (from, to, parts) in [
            ("arm = \"left\"", "arm = \"top\"", ["taught[0].arm", "left"]),
            ("port = 1", "port = 0", ["taught[2].port", "once"]),
            ("port = 1", "port = 7", ["taught[2].port", "0 to 1"]),
            ("\"1.2 mm\"]", "\"9 mm\"]", ["taught[0].pose", "-2 to 2 mm"]),
            ("\"0.15 um\"", "\"3 um\"", ["deviation_z", "0.5 um"]),
            (
                "[\"power\", \"power\"]",
                "[\"power\", \"weight\"]",
                ["meters.outputs", "weight"],
            ),
        ] {
            let text = CALIBRATION.replacen(from, to, 1);
            let error = BenchCalibration::parse("calibration.toml", &text, &spec).unwrap_err();
            for part in parts {
                assert!(error.to_string().contains(part), "{error}");
            }
        }
        let half = format!("{CALIBRATION}\n[groups.left.fine]\nlag = \"2 ms\"\n");
        let error = BenchCalibration::parse("calibration.toml", &half, &spec).unwrap_err();
        assert!(
            error.to_string().contains("groups.left.fine.lag"),
            "{error}"
        );
        let whole = format!(
            "{half}lag_deviation = \"0.1 ms\"\n[groups.right.coarse]\nbacklash_z = \"0.7 um\"\n"
        );
        let (_, groups) =
            BenchCalibration::parse("calibration.toml", &whole, &spec).expect("whole");
        let mut caps = spec.caps();
        groups.put(&mut caps);
        assert_eq!(caps.groups[1].lag, (2e-3, 0.1e-3));
        assert_eq!(caps.groups[3].lag, (1.5e-3, 0.3e-3));
        let backlash = caps.groups[2]
            .axes
            .map(|axis| axis.map(|axis| axis.backlash));
        assert_eq!(backlash[..3], [Some(1e-6), Some(1e-6), Some(0.7e-6)]);
        let cut = CALIBRATION
            .find("[[taught]]\narm = \"right\"")
            .expect("it is there");
        let rest = CALIBRATION.find("[meters]").expect("it is there");
        let text = format!("{}{}", &CALIBRATION[..cut], &CALIBRATION[rest..]);
        let error = BenchCalibration::parse("calibration.toml", &text, &spec).unwrap_err();
        assert!(error.to_string().contains("lacks port 0"), "{error}");
    }
}
