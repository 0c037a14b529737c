//! The steps of commissioning: what each measures, and what it is failed for.

use super::acceptance::{DEVICES, judged};
use super::checks::{CheckAxes, Dark};
use super::{Bench, Found, NotDone};
use crate::align::Align;
use crate::calibrations::Change;
use crate::identify::MeasureWindup;
use crate::job::Ended;
use crate::piezos::{MeasureRatios, PiezoModel, SeePiezos, SwingTips, WatchTips};
use pigtail_control::beam::SpotSize;
use pigtail_control::calibration::Windups;
use pigtail_control::dynamics::{Dynamics, Swings};
use pigtail_control::fast::{Ratio, vision_knows};
use pigtail_control::gap_by_light::Spread;
use pigtail_control::job::FiberReport;
use pigtail_control::piezo::camera::{Seen, SeenMicro};
use pigtail_control::shaking::Measured;
use pigtail_hal::spec::{MICRO_AXES, SIDES};
use pigtail_hal::{AxisName, Error, Side};
use pigtail_numerics::rounded;
use pigtail_twin::Specimen;
use serde_json::{Map, Value, json};

/// Lengths along x and y (metres), standard deviations of their logarithms, and the correlation of these where it counts.
type Lengths = ([f64; 2], [f64; 2], Option<f64>);

/// How the first fiber ended that was not aligned, if there is one, to go on with after what that prevented.
fn ended(fibers: &[FiberReport]) -> String {
    let ended = fibers.iter().find(|fiber| !fiber.outcome.is_aligned());
    ended.map_or_else(String::new, |fiber| {
        format!(": {}, {}", fiber.port, fiber.outcome)
    })
}

/// No photodiode reads more than this share of its range without light.
pub(super) const MOST_DARK: f64 = 0.1;

/// For how long tips are watched whether they shake, in x and in y, seconds: a dim input's means over as long as a bond takes tell in so long how
/// far they scatter to a third.
const WATCH: f64 = 4.0;

/// However well it is seen, a tip shakes on another day and with another fiber by some tenth more or less: an estimate.
const ANOTHER: f64 = 0.1;

/// Camera and macro do not differ by more of a micro's way: some tens of micrometres, of which its model is known to one.
const SCALE: f64 = 0.06;

/// A model of windup that makes the gap less than so many times narrower is worth nothing. One that is worth little says by its
/// residual how little, and the acceptance test shows whether that is enough.
const LEAST_FACTOR: f64 = 1.2;

/// What the camera saw of both micros, how far each goes in y for a displacement in x, and how the fibers ended of the last
/// device that was to tell.
type PiezosFound = ([SeenMicro; SIDES], [Option<Ratio>; SIDES], Vec<FiberReport>);

impl Bench<'_, '_> {
    pub(super) fn axes(&mut self) -> Result<Found, NotDone> {
        let moved = self.run(&CheckAxes, self.seed)?;
        let mut values = Map::new();
        let mut why = String::new();
        for axis in moved {
            let name = axis.at.to_string();
            if why.is_empty() {
                why = axis
                    .wrong()
                    .map_or_else(String::new, |wrong| format!("{name} {wrong}"));
            }
            values.insert(
                name,
                json!({
                    "forward_V": rounded(axis.forward.volts, 1e-4),
                    "backward_V": rounded(axis.backward.volts, 1e-4),
                    "way_counts": [axis.forward.counts, axis.backward.counts],
                    "way_of_output_um": axis.forward.output.map(|way| rounded(1e6 * way, 1e-4)),
                }),
            );
        }
        Ok(Found { values, why })
    }

    pub(super) fn dark(&mut self) -> Result<Found, NotDone> {
        let levels = self.run(&Dark, self.seed)?;
        let spec = &self.setup.rig.spec.photodiode;
        let mut why = String::new();
        let mut values = Map::new();
        for (name, (mean, sigma)) in levels {
            if mean > MOST_DARK * spec.range {
                why = format!("the photodiode {name} reads {mean:.2} V without light");
            }
            values.insert(
                name.to_owned(),
                json!({"mean_V": rounded(mean, 1e-6), "noise_V": rounded(sigma, 1e-6)}),
            );
        }
        Ok(Found { values, why })
    }

    /// Of every joint of both five-bars: friction, which winds transmissions up, differs from one to the next.
    pub(super) fn windup(&mut self) -> Result<Found, NotDone> {
        let (mut values, mut why) = (Map::new(), String::new());
        for at in AxisName::joints() {
            let measured = self.run(&MeasureWindup { at }, self.seed)?;
            let [w_max, q, residual] = measured.in_um();
            let (without, with) = (measured.gap_without, measured.gap_with);
            values.insert(
                at.to_string(),
                json!({
                    "w_max_um": rounded(w_max, 1e-4),
                    "q_um": rounded(q, 1e-4),
                    "residual_um": rounded(residual, 1e-4),
                    "gap_without_um": rounded(without, 1e-4),
                    "gap_with_um": rounded(with, 1e-4),
                    "winds_up": measured.winds(),
                }),
            );
            let factor = without / with;
            if !measured.winds() {
                // A joint that rubs so little needs no model, and none that was believed of it or of its kind: all others have their own.
                self.disbelieve("windup.five_bar".to_owned())?;
                self.disbelieve(format!("windup.{at}"))?;
                // One whose output goes ahead of its motor is no joint: something is not as the datasheet has it.
                if w_max < -residual && why.is_empty() {
                    why = format!(
                        "{at}: its output goes ahead of its motor by {:.1} um where it turns; is its probe where the datasheet has it?",
                        -w_max
                    );
                }
                continue;
            }
            if factor < LEAST_FACTOR {
                if why.is_empty() {
                    why = format!("{at}: the model makes its gap {factor:.1} times narrower only");
                }
                continue;
            }
            let origin = self.origin(&format!("windup of {at}"));
            self.believe(Change {
                table: format!("windup.{at}"),
                values: measured.values(&self.plan.date, &origin),
                weights: None,
            })?;
        }
        Ok(Found { values, why })
    }

    /// By the camera first, then, with what that found, by the light of a device.
    pub(super) fn piezos(&mut self) -> Result<Found, NotDone> {
        let kind = self.setup.piezo_model;
        if kind == PiezoModel::None {
            return self.no_piezos();
        }
        // What is to be found, by this step and by those that follow, is not believed meanwhile.
        let calibration = &mut self.setup.rig.calibration;
        let believed = std::mem::take(&mut calibration.hysteresis);
        let (spot, shaking) = (
            std::mem::take(&mut calibration.spot),
            std::mem::take(&mut calibration.shaking),
        );
        let found = self.piezos_found();
        let calibration = &mut self.setup.rig.calibration;
        calibration.hysteresis = believed;
        (calibration.spot, calibration.shaking) = (spot, shaking);
        let (micros, ratios, fibers) = found?;
        let (mut values, mut why) = (Map::new(), String::new());
        let all = Side::ALL.into_iter().zip(&micros).zip(ratios);
        for ((side, micro), ratio) in all {
            let Some(ratio) = ratio else {
                if why.is_empty() {
                    let name = side.name();
                    why = format!("no light told how far {name} goes in y{}", ended(&fibers));
                }
                continue;
            };
            let nm =
                |of: fn(&Seen) -> f64| micro.piezos.each_ref().map(|p| rounded(1e9 * of(p), 1e-3));
            values.insert(
                side.name().to_owned(),
                json!({
                    "residual_nm": nm(|piezo| piezo.residual),
                    "known_nm": nm(|piezo| piezo.known),
                    "drift_nm_s": nm(|piezo| piezo.drift),
                    "ratio": rounded(ratio.ratio, 1e-5),
                    "ratio_deviation": rounded(ratio.deviation, 1e-5),
                    "scale_by_macro": rounded(ratio.scale, 1e-5),
                }),
            );
            if (ratio.scale - 1.0).abs() > SCALE && why.is_empty() {
                why = format!(
                    "{} goes {:.1} % farther by the macro than by the camera",
                    side.name(),
                    100.0 * (ratio.scale - 1.0)
                );
                continue;
            }
            let model = kind.of(micro, ratio.ratio).map_err(Ended::from)?;
            let Some(model) = model else { continue };
            let residual = micro.piezos.iter().map(|piezo| piezo.residual);
            let residual = residual.fold(0.0, f64::max);
            let text = serde_json::to_string_pretty(&model).map_err(|error| {
                NotDone::Unbelievable(Error::new("weights", "", error.to_string()))
            })?;
            let file = format!("weights-{}.json", side.name());
            let origin = self.origin(&format!("piezos by camera, {}", side.name()));
            self.believe(Change {
                table: format!("hysteresis.{}", side.name()),
                values: vec![
                    ("model", toml_edit::value(model.piezos[0].name())),
                    ("weights", toml_edit::value(&file)),
                    ("micro", toml_edit::Item::None),
                    (
                        "residual",
                        toml_edit::value(format!("{:.5} um", 1e6 * residual)),
                    ),
                    ("date", toml_edit::value(&self.plan.date)),
                    ("origin", toml_edit::value(origin)),
                ],
                weights: Some((file, text + "\n")),
            })?;
        }
        Ok(Found { values, why })
    }

    /// Where no model is wanted: none is believed, of those that were either.
    fn no_piezos(&mut self) -> Result<Found, NotDone> {
        for side in Side::ALL {
            self.disbelieve(format!("hysteresis.{}", side.name()))?;
        }
        let values = Map::from_iter([("model".to_owned(), json!(PiezoModel::None.to_string()))]);
        let why = String::new();
        Ok(Found { values, why })
    }

    /// What the camera saw of both micros, how far each goes in y for a displacement in x, and how the fibers ended of
    /// the device that told.
    fn piezos_found(&mut self) -> Result<PiezosFound, Ended> {
        /// Before light has told: as far as in x.
        const RATIO: f64 = 1.0;
        /// So many devices are tried with the model of windup.
        const WITH_WINDUP: usize = 2;
        let micros = self.run(&SeePiezos, self.seed)?;
        for (side, micro) in Side::ALL.into_iter().zip(&micros) {
            let model = self.setup.piezo_model.of(micro, RATIO)?;
            self.setup.rig.calibration.hysteresis.set(side, model);
        }
        let (mut ratios, mut fibers) = ([None; SIDES], Vec::new());
        for (k, device) in self.spare_devices().enumerate() {
            // A joint whose transmission is not like that of the one that was identified goes farther than it is told to. Probes say how far the
            // macro goes: it may as well go without a model.
            let believed = self.setup.rig.calibration.windup.clone();
            if k >= WITH_WINDUP {
                self.setup.rig.calibration.windup = Windups::default();
            }
            let measured = self.run(&MeasureRatios, device);
            self.setup.rig.calibration.windup = believed;
            let (found, ended) = measured?;
            for (ratio, found) in ratios.iter_mut().zip(found) {
                *ratio = ratio.or(found);
            }
            fibers = ended;
            if ratios.iter().all(Option::is_some) {
                break;
            }
        }
        Ok((micros, ratios, fibers))
    }

    /// Devices that are tried one after the other, until one has told what is to be known: nobody's production, and none
    /// of the acceptance test.
    pub(super) fn spare_devices(&self) -> impl Iterator<Item = u64> + use<> {
        /// So many.
        const TRIED: u64 = 5;
        let machine = Specimen::from(self.seed).machine();
        (1..=TRIED).map(move |k| Specimen::of(machine, DEVICES - k).seed())
    }

    /// Watches the tips of a device that hold their fibers at their peaks.
    pub(super) fn shaking(&mut self) -> Result<Found, NotDone> {
        let believed = &mut self.setup.rig.calibration;
        // What is to be found is not believed meanwhile.
        let before = std::mem::take(&mut believed.shaking);
        let spot = std::mem::take(&mut believed.spot);
        let fibers = self.watched();
        self.setup.rig.calibration.shaking = before;
        self.setup.rig.calibration.spot = spot;
        let fibers = fibers?;
        let (mut values, mut why) = (Map::new(), String::new());
        for side in Side::ALL {
            let of_side = fibers.iter().filter(|fiber| fiber.side == side);
            let watched = of_side.filter_map(|fiber| fiber.shaking);
            let watched = watched.map(|found| Measured {
                spread: found.spread.max(ANOTHER),
                ..found
            });
            let Some(found) = watched.min_by(|a, b| a.spread.total_cmp(&b.spread)) else {
                if why.is_empty() {
                    why = format!("no tip of {} was watched{}", side.name(), ended(&fibers));
                }
                continue;
            };
            values.insert(
                side.name().to_owned(),
                json!({
                    "deviation_nm": rounded(1e9 * found.deviation, 1e-3),
                    "spread": rounded(found.spread, 1e-3),
                    "left": rounded(found.left, 1e-4),
                    "left_spread": rounded(found.left_spread, 1e-4),
                }),
            );
            let origin = self.origin(&format!("shaking, {}", side.name()));
            self.believe(Change {
                table: format!("shaking.{}", side.name()),
                values: vec![
                    (
                        "deviation",
                        toml_edit::value(format!("{:.2} nm", 1e9 * found.deviation)),
                    ),
                    ("spread", toml_edit::value(rounded(found.spread, 1e-3))),
                    ("left", toml_edit::value(rounded(found.left, 1e-4))),
                    (
                        "left_spread",
                        toml_edit::value(rounded(found.left_spread, 1e-4)),
                    ),
                    ("date", toml_edit::value(&self.plan.date)),
                    ("origin", toml_edit::value(origin)),
                ],
                weights: None,
            })?;
        }
        Ok(Found { values, why })
    }

    /// Steps the tips of a device that hold their fibers at their peaks.
    pub(super) fn dynamics(&mut self) -> Result<Found, NotDone> {
        let rig = &self.setup.rig;
        let slowest = rig.recipe.fast.conical_scan.period.recip();
        let usual = rig.calibration.geometry.micro.settling;
        let usual = usual.unwrap_or(rig.spec.micro.settling);
        // One that comes to rest long before samples tell how is waited for long enough.
        let told = |axis: &Dynamics| axis.is_told() || axis.settling() < usual;
        let known = |axes: &[Dynamics; MICRO_AXES]| axes.iter().all(told);
        // What is to be found, and what circles tell by it, is not believed meanwhile.
        let believed = &mut self.setup.rig.calibration;
        let before = (
            std::mem::take(&mut believed.dynamics),
            std::mem::take(&mut believed.shaking),
            std::mem::take(&mut believed.spot),
        );
        let fibers = self.swung(known);
        let believed = &mut self.setup.rig.calibration;
        (believed.dynamics, believed.shaking, believed.spot) = before;
        let fibers = fibers?;
        let (mut values, mut why) = (Map::new(), String::new());
        for side in Side::ALL {
            let mut of_side = fibers.iter().filter(|fiber| fiber.side == side);
            let Some(axes) = of_side.find_map(|fiber| fiber.dynamics.filter(known)) else {
                if why.is_empty() {
                    let name = side.name();
                    why = format!("no light told how {name} swings{}", ended(&fibers));
                }
                continue;
            };
            let (found, change) = self.swings(side, &axes, slowest);
            values.insert(side.name().to_owned(), found);
            self.believe(change)?;
        }
        Ok(Found { values, why })
    }

    /// Fibers of devices that were held to step their tips, until those of both sides have told how they swing.
    fn swung(
        &mut self,
        known: impl Fn(&[Dynamics; MICRO_AXES]) -> bool,
    ) -> Result<Vec<FiberReport>, Ended> {
        let mut fibers: Vec<FiberReport> = Vec::new();
        for device in self.spare_devices() {
            fibers.extend(self.run(&SwingTips, device)?);
            let told = |side: Side| {
                let mut of_side = fibers.iter().filter(|fiber| fiber.side == side);
                of_side.any(|fiber| fiber.dynamics.as_ref().is_some_and(&known))
            };
            if Side::ALL.into_iter().all(told) {
                break;
            }
        }
        Ok(fibers)
    }

    /// How a micro swings by both of its axes, where circles are to go around at a rate (hertz): as it is told, and as it is believed.
    fn swings(&self, side: Side, axes: &[Dynamics; MICRO_AXES], rate: f64) -> (Value, Change) {
        let found = Swings::of(axes, rate);
        let each = |of: fn(&Dynamics) -> f64, step: f64| {
            axes.each_ref().map(|axis| rounded(of(axis), step))
        };
        let (resonance, damping) = (each(|a| a.resonance, 1e-2), each(|a| a.damping, 1e-4));
        let told = json!({
            "resonance_Hz": resonance,
            "damping": damping,
            "decay_deviation": each(|a| a.deviation, 1e-4),
            "misfit_percent": each(|a| 100.0 * a.misfit, 1e-3),
            "settling_ms": rounded(1e3 * found.settling, 1e-3),
            "lag_ms": rounded(1e3 * found.lag, 1e-4),
        });
        let ms = |seconds: f64, step: f64| {
            toml_edit::value(format!("{} ms", rounded(1e3 * seconds, step)))
        };
        let hertz = |at: f64| format!("{} Hz", rounded(at, 1e-2));
        let origin = self.origin(&format!("dynamics, {}", side.name()));
        let change = Change {
            table: format!("dynamics.{}", side.name()),
            values: vec![
                (
                    "resonance",
                    toml_edit::value(toml_edit::Array::from_iter(resonance.map(hertz))),
                ),
                (
                    "damping",
                    toml_edit::value(toml_edit::Array::from_iter(damping)),
                ),
                ("settling", ms(found.settling, 1e-2)),
                ("bandwidth", toml_edit::value(hertz(found.bandwidth))),
                ("lag", ms(found.lag, 1e-4)),
                ("lag_deviation", ms(found.lag_deviation, 1e-4)),
                ("date", toml_edit::value(&self.plan.date)),
                ("origin", toml_edit::value(origin)),
            ],
            weights: None,
        };
        (told, change)
    }

    /// Fibers of devices that were held to watch their tips, until tips of both sides were watched.
    fn watched(&mut self) -> Result<Vec<FiberReport>, Ended> {
        let mut fibers = Vec::new();
        for (k, device) in self.spare_devices().enumerate() {
            fibers.extend(self.run(&WatchTips { seconds: WATCH }, device)?);
            self.aligned = (fibers.clone(), k + 1);
            let watched = |side: Side| {
                let mut of_side = fibers.iter().filter(|fiber| fiber.side == side);
                of_side.any(|fiber| fiber.shaking.is_some())
            };
            if Side::ALL.into_iter().all(watched) {
                break;
            }
        }
        Ok(fibers)
    }

    /// Takes together how wide the spots of fibers were that are aligned, until the next one's is known or no device is left.
    pub(super) fn spot(&mut self) -> Result<Found, NotDone> {
        // What is to be found is not believed meanwhile.
        let before = std::mem::take(&mut self.setup.rig.calibration.spot);
        let told = self.until_known(|fiber| fiber.spot, SpotSize::of_all, SpotSize::is_known);
        self.setup.rig.calibration.spot = before;
        let found = told?.map(|found| found.map(|spot| (spot.radius, spot.deviation, None)));
        let why = |side: Side| format!("no spot of {} was seen", side.name());
        self.believe_lengths("spot", ("um", 1e6, 1e-4), found, Map::new(), why)
    }

    /// Takes together what spots have told of how light spreads, where the light is to tell the gap at all.
    pub(super) fn spread(&mut self) -> Result<Found, NotDone> {
        let known = vision_knows(&self.setup.rig.spec, &self.setup.rig.recipe);
        let mut values = Map::new();
        values.insert("vision_knows_the_gap".to_owned(), json!(known));
        if known {
            let why = String::new();
            return Ok(Found { values, why });
        }
        let before = std::mem::take(&mut self.setup.rig.calibration.spread);
        let told = self.until_known(|fiber| fiber.spread, Spread::of_all, Spread::is_well_known);
        self.setup.rig.calibration.spread = before;
        let lengths = |spread: Spread| (spread.length, spread.deviation, Some(spread.correlation));
        let found = told?.map(|found| found.map(lengths));
        let why = |side: Side| format!("no spot of {} told how light spreads", side.name());
        self.believe_lengths("spread", ("nm", 1e9, 1e-2), found, values, why)
    }

    /// What fibers of devices that are aligned tell together of both micros, until that is known or no device is left. Those that were aligned
    /// already tell too.
    fn until_known<T>(
        &mut self,
        told: impl Fn(&FiberReport) -> Option<T>,
        of_all: impl Fn(&[T]) -> Option<T>,
        known: impl Fn(&T) -> bool,
    ) -> Result<[Option<T>; SIDES], Ended> {
        // A device tells the same when it is asked again.
        let mut spare = self.spare_devices().skip(self.aligned.1);
        loop {
            let found = Side::ALL.map(|side| {
                let of_side = self.aligned.0.iter().filter(|fiber| fiber.side == side);
                of_all(&of_side.filter_map(&told).collect::<Vec<T>>())
            });
            let all = found.iter().all(|found| found.as_ref().is_some_and(&known));
            let Some(device) = spare.next().filter(|_| !all) else {
                return Ok(found);
            };
            let fibers = self.run(&Align::default(), device)?.fibers;
            self.aligned.0.extend(fibers);
            self.aligned.1 += 1;
        }
    }

    /// Believes what was found of both micros: lengths along x and y in the micro's own scale (metres), with the standard deviations of their
    /// logarithms and where that counts by how much these err alike; written in a unit, of which a metre has so many, to a step of it. `why` says what a
    /// side that told nothing lacks.
    fn believe_lengths(
        &mut self,
        table: &str,
        (unit, metre, step): (&str, f64, f64),
        found: [Option<Lengths>; SIDES],
        mut values: Map<String, Value>,
        why: impl Fn(Side) -> String,
    ) -> Result<Found, NotDone> {
        let mut failed = String::new();
        for (side, found) in Side::ALL.into_iter().zip(found) {
            let Some((lengths, deviations, correlation)) = found else {
                if failed.is_empty() {
                    failed = why(side) + &ended(&self.aligned.0);
                }
                continue;
            };
            let [x, y] = lengths.map(|length| rounded(metre * length, step));
            let [of_x, of_y] = deviations.map(|deviation| rounded(deviation, 1e-5));
            let mut told = Map::from_iter([
                (format!("x_{unit}"), json!(x)),
                (format!("y_{unit}"), json!(y)),
                ("deviation_x".to_owned(), json!(of_x)),
                ("deviation_y".to_owned(), json!(of_y)),
            ]);
            let origin = self.origin(&format!("{table}, {}", side.name()));
            let length = |value: f64| toml_edit::value(format!("{value} {unit}"));
            let mut believed = vec![
                ("x", length(x)),
                ("y", length(y)),
                ("deviation_x", toml_edit::value(of_x)),
                ("deviation_y", toml_edit::value(of_y)),
            ];
            if let Some(correlation) = correlation {
                let alike = rounded(correlation.clamp(0.0, 1.0), 1e-4);
                told.insert("correlation".to_owned(), json!(alike));
                believed.push(("correlation", toml_edit::value(alike)));
            }
            values.insert(side.name().to_owned(), Value::Object(told));
            believed.push(("date", toml_edit::value(&self.plan.date)));
            believed.push(("origin", toml_edit::value(origin)));
            self.believe(Change {
                table: format!("{table}.{}", side.name()),
                values: believed,
                weights: None,
            })?;
        }
        let why = failed;
        Ok(Found { values, why })
    }

    pub(super) fn acceptance(&mut self) -> Result<Found, NotDone> {
        let machine = Specimen::from(self.seed).machine();
        let mut devices = Vec::new();
        for k in 0..self.plan.devices {
            let device = Specimen::of(machine, DEVICES + k).seed();
            devices.push(self.run(&Align::default(), device)?.fibers);
        }
        Ok(judged(&devices, &self.setup.rig.recipe.accept))
    }
}
