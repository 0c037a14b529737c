//! A bench that is controlled by position, commissioned: axes, meters, what light tells of its groups, and devices.

use super::acceptance::{DEVICES, judged};
use super::steps::MOST_DARK;
use super::{CommissionDocument, Commissioned, Found, Plan, StepDocument, StepDone, StepName};
use crate::bench::{BenchCalibration, BenchSetup, guarded};
use crate::calibrations::{Belief, Change};
use crate::rig::{Named, belief};
use pigtail_control::align::{self, Known, MeasuredArm};
use pigtail_control::outcome::Halt;
use pigtail_control::station::Observer;
use pigtail_hal::Error;
use pigtail_hal::bench::spec::ARMS;
use pigtail_hal::bench::{Bench, Stage};
use pigtail_hal::quantity::{LENGTH, TIME};
use pigtail_numerics::rounded;
use pigtail_twin::Specimen;
use serde_json::{Map, Value, json};

/// What is not known of a bench however it was measured.
const UNKNOWN: [&str; 3] = [
    "where facets are along z: as far as that was taught; a fiber is as near to the chip as that is right",
    "how far coarse axes are from where they are told to stand over their whole travel: light shows some micrometres of it, and the \
     datasheet's repeatability is believed of the rest",
    "squareness and pitch of the arms: the peak is found again at every gap",
];

/// Standard deviations beyond which what was measured is not what the datasheet says.
const BEYOND: f64 = 3.0;

/// So many times the datasheet's backlash or repeatability are a worn screw, and no other specimen. A choice.
const WORN: f64 = 3.0;

/// Commissions the twin that a seed draws. `watch` is told of each step when it has been done.
///
/// # Errors
///
/// Bad input. A bench that fails is no error.
pub fn commission_bench(
    setup: &BenchSetup,
    seed: u64,
    plan: &Plan,
    observer: &mut dyn Observer,
    mut watch: impl FnMut(&StepDone),
) -> Result<Commissioned, Error> {
    let belief = belief(&Named {
        rig: &setup.rig.name,
        calibration: setup.rig.believing.as_deref(),
        ..Named::default()
    })?;
    let mut work = Work {
        setup: setup.clone(),
        belief,
        seed,
        plan,
        tables: Vec::new(),
        seconds: 0.0,
        observer,
    };
    let before = plan.taken_over(&StepName::OF_BENCHES);
    let mut steps: Vec<StepDocument> = before.iter().map(|done| done.step.clone()).collect();
    work.seconds = steps.iter().map(|step| step.seconds).sum();
    if let Some(last) = before.last() {
        (work.belief, work.tables) = (last.belief.clone(), last.tables.clone());
        work.take()?;
    }
    let wanted = StepName::OF_BENCHES
        .into_iter()
        .filter(|name| plan.steps.contains(name));
    for name in wanted.skip(before.len()) {
        let before = work.seconds;
        let found = match name {
            StepName::Axes => work.axes(),
            StepName::Dark => work.dark(),
            StepName::Groups => work.groups(),
            _ => work.acceptance(),
        }?;
        let step = StepDocument::of(name, work.seconds - before, found);
        let done = StepDone {
            step,
            belief: work.belief.clone(),
            tables: work.tables.clone(),
        };
        watch(&done);
        steps.push(done.step);
    }
    let document = CommissionDocument::of(
        (&setup.rig.name, crate::fleet::NOMINAL, seed),
        work.seconds,
        steps,
        UNKNOWN.to_vec(),
    );
    Ok(Commissioned {
        document,
        belief: work.belief,
        tables: work.tables,
    })
}

/// A bench on the way to being commissioned.
struct Work<'w> {
    setup: BenchSetup,
    belief: Belief,
    seed: u64,
    plan: &'w Plan,
    tables: Vec<String>,
    /// Bench time so far.
    seconds: f64,
    observer: &'w mut dyn Observer,
}

impl Work<'_> {
    /// Work on the bench with the device of a seed in place, guarded.
    fn run<T>(
        &mut self,
        seed: u64,
        work: impl FnOnce(&mut dyn Bench, &BenchSetup, &mut dyn Observer) -> T,
    ) -> Result<T, Error> {
        let twin = self.setup.twin(seed)?;
        let mut bench = guarded(&self.setup.rig, twin, &self.setup.options);
        let begin = bench.now();
        let result = work(&mut bench, &self.setup, self.observer);
        self.seconds += bench.now() - begin;
        Ok(result)
    }

    fn axes(&mut self) -> Result<Found, Error> {
        let moved = self.run(self.seed, |bench, _, observer| {
            align::move_axes(bench, observer)
        })?;
        let moved = match moved {
            Ok(moved) => moved,
            Err(halt) => return Ok(failed(&halt)),
        };
        let (mut values, mut why) = (Map::new(), String::new());
        for axis in moved {
            if why.is_empty() && !axis.is_well() {
                why = format!(
                    "{} was told to go {:.3} um and went {:.3} um by its own measure",
                    axis.name,
                    1e6 * axis.told,
                    1e6 * axis.went
                );
            }
            let value = json!({
                "told_um": rounded(1e6 * axis.told, 1e-4),
                "went_um": rounded(1e6 * axis.went, 1e-4),
                "seconds": rounded(axis.seconds, 1e-4),
            });
            values.insert(axis.name, value);
        }
        Ok(Found { values, why })
    }

    fn dark(&mut self) -> Result<Found, Error> {
        let meters = self.run(self.seed, |bench, _, observer| {
            align::measure_dark(bench, observer)
        })?;
        let meters = match meters {
            Ok(meters) => meters,
            Err(halt) => return Ok(failed(&halt)),
        };
        let (mut values, mut why) = (Map::new(), String::new());
        let caps = self.setup.rig.spec.caps();
        for (channel, dark) in caps.channels.iter().zip(meters) {
            if dark.level > MOST_DARK * channel.full_scale {
                let name = &channel.name;
                why = format!("the meter {name} reads {:.3} V without light", dark.level);
            }
            values.insert(
                channel.name.clone(),
                json!({"mean_V": rounded(dark.level, 1e-7), "noise_V": rounded(dark.noise, 1e-7)}),
            );
        }
        Ok(Found { values, why })
    }

    /// What light tells of the groups of both arms, which is believed from then on.
    fn groups(&mut self) -> Result<Found, Error> {
        let measured = self.run(self.seed, |bench, setup, observer| {
            align::measure(bench, &setup.rig.belief, &setup.rig.recipe, observer)
        })?;
        let arms = match measured {
            Ok(arms) => arms,
            Err(halt) => return Ok(failed(&halt)),
        };
        let (mut values, mut why) = (Map::new(), String::new());
        for ((index, name), arm) in ARMS.iter().enumerate().zip(&arms) {
            values.insert((*name).to_owned(), values_of(arm));
            if let Some(worn) = self.worn(index, arm) {
                why = format!("{name} arm: {worn}");
                continue;
            }
            let changes = self.changes_of(name, arm);
            self.believe(changes)?;
        }
        Ok(Found { values, why })
    }

    /// What is beyond what any specimen of this datasheet has.
    fn worn(&self, index: usize, arm: &MeasuredArm) -> Option<String> {
        let caps = self.setup.rig.spec.caps();
        let group = caps.group(index, Stage::Coarse)?;
        for (k, name) in ["x", "y", "z"].into_iter().enumerate() {
            let axis = caps.groups[group.0].axes[k]?;
            let least = axis.repeatability.max(axis.resolution);
            if let Some(Known { value, deviation }) = arm.backlash[k]
                && value - BEYOND * deviation > WORN * axis.backlash.max(least)
            {
                return Some(format!(
                    "its coarse {name} falls {:.2} um short when it turns back, by the datasheet {:.2} um",
                    1e6 * value,
                    1e6 * axis.backlash
                ));
            }
            if let Some(stands) = arm.stands.get(k)
                && *stands > WORN * least
            {
                return Some(format!(
                    "its coarse {name} stands {:.2} um (rms) from where it is told to, over {:.1} um; by the datasheet {:.2} um",
                    1e6 * stands,
                    1e6 * arm.over,
                    1e6 * axis.repeatability
                ));
            }
        }
        None
    }

    /// The tables that an arm's calibration gets.
    fn changes_of(&self, name: &str, arm: &MeasuredArm) -> [Change; 2] {
        /// What is kept of a time and of a length: a microsecond, and a nanometre.
        const FINE: f64 = 1e-6;
        const SHORT: f64 = 1e-9;
        let origin = format!("commission, groups, run {}", self.plan.run);
        // Sensors that are later than the light are believed to be as late as it, and known as much worse.
        let lag = |Known { value, deviation }: Known| {
            let deviation = deviation.hypot(value.min(0.0)).max(FINE);
            let text = |seconds| TIME.text(rounded(seconds, FINE));
            [
                ("lag", text(value.max(0.0))),
                ("lag_deviation", text(deviation)),
            ]
        };
        let keys = ["backlash_x", "backlash_y", "backlash_z"];
        let backlash = keys.into_iter().zip(arm.backlash);
        let backlash = backlash.filter_map(|(key, known)| {
            let metres = rounded(known?.value.max(0.0), SHORT);
            Some((key, LENGTH.text(metres)))
        });
        let change = |stage: &str, texts: Vec<(&'static str, String)>| {
            let said = [("date", self.plan.date.clone()), ("origin", origin.clone())];
            let values = texts.into_iter().chain(said);
            Change {
                table: format!("groups.{name}.{stage}"),
                values: values
                    .map(|(key, text)| (key, toml_edit::value(text)))
                    .collect(),
                weights: None,
            }
        };
        [
            change(
                "coarse",
                lag(arm.coarse_lag).into_iter().chain(backlash).collect(),
            ),
            change("fine", lag(arm.fine_lag).to_vec()),
        ]
    }

    /// Believes what was found from now on, as whoever takes its calibration will.
    fn believe(&mut self, changes: impl IntoIterator<Item = Change>) -> Result<(), Error> {
        for change in changes {
            self.belief.change(&change)?;
            self.tables.push(change.table);
        }
        self.take()
    }

    /// The rig as it is believed to be now.
    fn take(&mut self) -> Result<(), Error> {
        let rig = &mut self.setup.rig;
        (rig.belief, rig.groups) =
            BenchCalibration::parse("what was found", &self.belief.text, &rig.spec)?;
        Ok(())
    }

    fn acceptance(&mut self) -> Result<Found, Error> {
        let machine = Specimen::from(self.seed).machine();
        let mut devices = Vec::new();
        for k in 0..self.plan.devices {
            let device = Specimen::of(machine, DEVICES + k).seed();
            devices.push(self.run(device, |bench, setup, observer| {
                align::align(bench, &setup.rig.belief, &setup.rig.recipe, observer)
            })?);
        }
        Ok(judged(&devices, &self.setup.rig.recipe.accept))
    }
}

fn failed(halt: &Halt) -> Found {
    Found {
        values: Map::new(),
        why: halt.to_string(),
    }
}

/// What was measured of an arm, each value followed by its standard deviation.
fn values_of(arm: &MeasuredArm) -> Value {
    let pair = |known: Known, scale: f64| {
        [known.value, known.deviation].map(|value| rounded(scale * value, 1e-5))
    };
    let backlash = |k: usize| arm.backlash[k].map(|known| pair(known, 1e6));
    json!({
        "gap_um": rounded(1e6 * arm.gap, 1e-3),
        "light_V": rounded(arm.light, 1e-5),
        "noise_percent": rounded(100.0 * arm.noise, 1e-4),
        "fine_lag_ms": pair(arm.fine_lag, 1e3),
        "coarse_lag_ms": pair(arm.coarse_lag, 1e3),
        "backlash_x_um": backlash(0),
        "backlash_y_um": backlash(1),
        "backlash_z_um": backlash(2),
        "stands_nm": arm.stands.map(|metres| rounded(1e9 * metres, 1e-3)),
        "over_um": rounded(1e6 * arm.over, 1e-3),
        "spot_x_um": pair(arm.spot[0], 1e6),
        "spot_y_um": pair(arm.spot[1], 1e6),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commission::Verdict;
    use crate::rig::BENCH_RIG_NAME;
    use pigtail_control::station::Unobserved;

    fn commissioned(setup: &BenchSetup, seed: u64, steps: &[StepName]) -> Commissioned {
        let plan = Plan {
            steps: steps.to_vec(),
            devices: 1,
            date: "2026-01-01".to_owned(),
            run: "a-run".to_owned(),
            before: Vec::new(),
        };
        commission_bench(setup, seed, &plan, &mut Unobserved, |_| ()).expect("a bench")
    }

    /// Its meter sums light up over 5 ms before a sample, which is 2 ms on average, and its piezos' sensors are late by half a
    /// millisecond.
    #[test]
    fn light_tells_lag_and_backlash_as_well_as_it_says() {
        let setup = BenchSetup::load(BENCH_RIG_NAME, "y-branch").expect("it ships");
        let plant = &setup.plant;
        let spot = |k: usize| {
            let (guide, fiber) = (plant.device.mode_radius[k], plant.fiber.mode_radius);
            (0.5 * (guide * guide + fiber * fiber)).sqrt()
        };
        let truth = [
            ("fine_lag_ms", 2.0 - 1e3 * plant.fine.sensor_lag),
            ("coarse_lag_ms", 2.0),
            ("backlash_x_um", 1e6 * plant.coarse.backlash),
            ("backlash_y_um", 1e6 * plant.coarse.backlash),
            ("backlash_z_um", 1e6 * plant.coarse.backlash),
            // Across the chip light that leaves it at an angle is wider than across itself.
            (
                "spot_x_um",
                1e6 * spot(0) / setup.rig.recipe.ports.exit_angle.cos(),
            ),
            ("spot_y_um", 1e6 * spot(1)),
        ];
        let done = commissioned(&setup, 61, &[StepName::Groups]);
        let step = &done.document.steps[0];
        assert_eq!(step.verdict, Verdict::Passed, "{}", step.why);
        for arm in ARMS {
            for (key, truth) in truth {
                let known = |k: usize| step.values[arm][key][k].as_f64().expect("a number");
                let (value, deviation) = (known(0), known(1));
                assert!(
                    (value - truth).abs() < 4.0 * deviation && deviation < 0.25,
                    "{arm} {key}: {value} +- {deviation}, {truth}"
                );
            }
        }
        // Nothing was tried, so nothing is accepted; and what was found is a calibration of this rig.
        assert!(!done.document.accepted);
        assert_eq!(done.tables.len(), 4);
    }

    #[test]
    fn a_worn_screw_is_not_believed() {
        let mut setup = BenchSetup::load(BENCH_RIG_NAME, "y-branch").expect("it ships");
        setup.plant.coarse.backlash = 4e-6;
        let done = commissioned(&setup, 61, &[StepName::Groups]);
        let step = &done.document.steps[0];
        assert_eq!(step.verdict, Verdict::Failed);
        assert!(step.why.contains("when it turns back"), "{}", step.why);
        assert!(done.tables.is_empty());
    }

    #[test]
    fn the_shipped_bench_is_accepted() {
        let setup = BenchSetup::load(BENCH_RIG_NAME, "y-branch").expect("it ships");
        let done = commissioned(&setup, 62, &StepName::OF_BENCHES);
        assert!(done.document.accepted, "{:?}", done.document.steps);
    }
}
