//! Gains that every axis of a kind comes to rest under, and how fast all of them go.

use super::checks::swings;
use super::{Bench, Found, NotDone};
use crate::calibrations::Change;
use crate::characterize::Step;
use crate::job::Ended;
use crate::tune::{GainsRow, Method, Tune, step_of};
use pigtail_control::characterize::Trace;
use pigtail_hal::{Axis, AxisName, Side};
use pigtail_numerics::rounded;
use serde_json::{Map, Value, json};
use std::f64::consts::TAU;

/// Gains as one axis has them.
struct Tuned {
    /// What makes them those of its kind.
    change: Change,
    /// The axis that they were found on.
    at: AxisName,
    /// How all axes of its kind answer.
    answers: Answers,
}

/// How axes answer to steps.
#[derive(Clone, Copy, Default)]
struct Answers {
    /// One that does not come to rest.
    wrong: Option<AxisName>,
    /// The one that hunts most, and how often it goes to and fro: between counts its derivative alone is more than what moves it, or its integral
    /// comes too late, so that it swings about where it is to stand, until chance ends that.
    hunts: Option<(AxisName, usize)>,
    /// How fast the slowest goes that goes no faster however long it is driven, encoder counts a second.
    slowest: Option<f64>,
}

/// The speed that an axis has come to that is driven with all its voltage through a step, counts a second; `None` where it was still gathering
/// speed as it came near.
fn levelled(trace: &Trace) -> Option<f64> {
    /// Of the voltage: all of it.
    const ALL: f64 = 0.99;
    /// From the third quarter to the last: one that gathers speed steadily is 1.4 times as fast.
    const GATHERS: f64 = 1.1;
    let first = trace.voltage.first()?.abs();
    let driven = trace
        .voltage
        .iter()
        .take_while(|volts| volts.abs() >= ALL * first);
    let quarter = driven.count().saturating_sub(1) / 4;
    if quarter < 2 {
        return None;
    }
    let at = |k: usize| trace.encoder[k * quarter];
    let speed = |from: usize| (at(from + 1) - at(from)) / (quarter as f64 * trace.period);
    let (third, last) = (speed(2).abs(), speed(3).abs());
    (last < GATHERS * third).then_some(0.5 * (third + last))
}

impl Tuned {
    /// An axis to tune on instead, where one does not come to rest or hunts.
    fn another(&self) -> Option<AxisName> {
        let Answers { wrong, hunts, .. } = self.answers;
        let at = wrong.or(hunts.map(|(at, _)| at))?;
        let side = match at.side {
            _ if at != self.at => at.side,
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        };
        Some(AxisName { side, ..at })
    }

    fn is_no_worse_than(&self, other: &Self) -> bool {
        let rank = |answers: &Answers| {
            let swings = answers.hunts.map_or(0, |(_, swings)| swings);
            (answers.wrong.is_some(), swings)
        };
        rank(&self.answers) <= rank(&other.answers)
    }
}

impl Bench<'_, '_> {
    /// Tunes an axis of each kind, and steps all of them: gains that one of them does not bear are made less, or found on that one.
    pub(super) fn gains(&mut self) -> Result<Found, NotDone> {
        let mut values = Map::new();
        let mut why = String::new();
        for (kind, table) in [(Axis::A, "five_bar"), (Axis::Z, "z")] {
            let at = AxisName {
                side: Side::Left,
                axis: kind,
            };
            let mut found = self.tuned_on(at, table, &mut values)?;
            if let Some(other) = found.another() {
                // One that friction holds otherwise may need gains of its own, which suit all.
                let (first, noted) = (found, values.clone());
                found = self.tuned_on(other, table, &mut values)?;
                if first.is_no_worse_than(&found) {
                    (found, values) = (first, noted);
                }
            }
            if let Some(wrong) = found.answers.wrong.filter(|_| why.is_empty()) {
                why = format!("{wrong} does not come to rest under the gains that were found");
            }
            self.believe(found.change)?;
        }
        Ok(Found { values, why })
    }

    /// Tunes on one axis, and makes the gains gentler until all axes of its kind come to rest under them. Notes them under the table's name.
    fn tuned_on(
        &mut self,
        at: AxisName,
        table: &'static str,
        values: &mut Map<String, Value>,
    ) -> Result<Tuned, NotDone> {
        /// How often, and by what, before it is given up.
        const GENTLER: usize = 4;
        const BY: f64 = 0.8;
        let method = Method::Simplex;
        let tune = Tune {
            at,
            method,
            trials: method.usual_trials(),
            step: step_of(&self.setup.rig, at.axis),
            one_size: false,
            seed: self.seed,
        };
        let tuned = self.run(&tune, self.seed)?.document;
        let mut gains = tuned.gains;
        let mut gentler = 0;
        let mut limit = None;
        let change = |bench: &Self, gains: &GainsRow, limit: Option<f64>, speed: Option<f64>| {
            let origin = bench.origin(&format!("tune {at}"));
            let mut values = gains.values(&bench.plan.date, &origin);
            let volts = |limit: f64| toml_edit::value(format!("{} V", rounded(limit, 1e-3)));
            values.extend(limit.map(|limit| ("integral_limit", volts(limit))));
            let metres =
                |speed: f64| toml_edit::value(format!("{} mm/s", rounded(1e3 * speed, 1e-3)));
            // Of one that goes as fast as it should nothing is said, whatever was before.
            values.push(("speed", speed.map_or(toml_edit::Item::None, metres)));
            Change {
                table: format!("gains.{table}"),
                values,
                weights: None,
            }
        };
        let answers = loop {
            self.try_out(&change(self, &gains, limit, None))?;
            let answers = self.step_all(at.axis, values)?;
            if answers.wrong.is_none() && (answers.hunts.is_none() || gentler == GENTLER) {
                break answers;
            }
            if gentler < GENTLER {
                gains = gains.times(BY);
                gentler += 1;
                continue;
            }
            // Or the integral is kept from doing what makes the axis move that sticks most.
            let start = self.setup.rig.spec.drive(at.axis).start();
            let believed = &self.setup.rig.calibration.gains;
            let believed = if at.axis == Axis::Z {
                believed.z.integral_limit
            } else {
                believed.five_bar.integral_limit
            };
            if limit.is_some() || start <= believed {
                break answers;
            }
            (gains, gentler, limit) = (tuned.gains, 0, Some(start));
        };
        let specified = tuned.specified.map(|specified| specified.met);
        let speed = self.too_slow(at.axis, answers.slowest);
        values.insert(
            table.to_owned(),
            json!({
                "kp_V_per_count": gains.kp,
                "ki_V_per_count_s": gains.ki,
                "kd_V_s_per_count": gains.kd,
                "tuned_on": at.to_string(),
                "times_gentler": gentler,
                "rise_ms": tuned.rise_ms,
                "settling_ms": tuned.settling_ms,
                "specified_met": specified,
                "speed_mm_s": speed.map(|speed| rounded(1e3 * speed, 1e-3)),
            }),
        );
        Ok(Tuned {
            change: change(self, &gains, limit, speed),
            at,
            answers,
        })
    }

    /// How fast an axis of a kind can be led, metres a second at its output, of which the slowest goes so many counts a second; `None` where the
    /// datasheet's speed will do.
    fn too_slow(&self, kind: Axis, slowest: Option<f64>) -> Option<f64> {
        /// A servo needs voltage beyond that of the way.
        const LED: f64 = 0.8;
        /// Of the datasheet's speed: what comes nearer follows it over ways as short as those of a macro.
        const NEARLY: f64 = 0.75;
        let rig = &self.setup.rig;
        let drive = rig.spec.drive(kind);
        let counts = slowest? * drive.count() / drive.gear_ratio;
        let geometry = &rig.calibration.geometry;
        let (speed, specified) = if kind == Axis::Z {
            (geometry.z.lead / TAU * counts, rig.spec.z_stage.speed)
        } else {
            (geometry.five_bar.proximal * counts, rig.spec.five_bar.speed)
        };
        (speed < NEARLY * specified).then_some(LED * speed)
    }

    /// Steps all axes of a kind, far and a little, and notes how they answer to the former.
    fn step_all(&mut self, kind: Axis, values: &mut Map<String, Value>) -> Result<Answers, Ended> {
        /// Of the usual step.
        const LITTLE: i64 = 10;
        /// A step that does not hunt goes to and fro so often at most.
        const SWINGS: usize = 6;
        let mut answers = Answers::default();
        let alike = |axis: &Axis| (*axis == Axis::Z) == (kind == Axis::Z);
        for side in Side::ALL {
            for axis in Axis::ALL.into_iter().filter(alike) {
                let at = AxisName { side, axis };
                let step = Step {
                    at,
                    size: step_of(&self.setup.rig, axis),
                };
                let (response, trace) = self.run(&step, self.seed)?;
                let little = Step {
                    size: (step.size / LITTLE).max(1),
                    ..step
                };
                let (_, small) = self.run(&little, self.seed)?;
                if !response.settled {
                    answers.wrong = answers.wrong.or(Some(at));
                }
                let swings = swings(&trace.encoder, step.size as f64)
                    .max(swings(&small.encoder, little.size as f64));
                if let Some(speed) = levelled(&trace) {
                    let slowest = answers.slowest.unwrap_or(f64::INFINITY);
                    answers.slowest = Some(slowest.min(speed));
                }
                let most = answers.hunts.map_or(SWINGS, |(_, most)| most);
                if swings > most {
                    answers.hunts = Some((at, swings));
                }
                values.insert(
                    at.to_string(),
                    json!({
                        "rise_ms": response.rise_ms,
                        "settling_ms": response.settling_ms,
                        "overshoot_percent": response.overshoot_percent,
                        "settled": response.settled,
                        "swings": swings,
                    }),
                );
            }
        }
        Ok(answers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of 1,300 counts, driven with all voltage up to there, by where it is after so many seconds.
    fn driven(at: impl Fn(f64) -> f64) -> Trace {
        let period = 4e-4;
        let encoder: Vec<_> = (1..=200_u32).map(|k| at(f64::from(k) * period)).collect();
        Trace {
            period,
            reference: vec![1300.0; encoder.len()],
            output: Vec::new(),
            voltage: encoder
                .iter()
                .map(|at| if *at < 1300.0 { 24.0 } else { -3.0 })
                .collect(),
            encoder,
        }
    }

    #[test]
    fn a_speed_that_no_longer_grows_is_seen() {
        // Rubbed so much that it comes to 27,000 counts a second within a millisecond.
        let rubbed = driven(|time| 27e3 * (time - 1e-3 * (1.0 - (-time / 1e-3).exp())));
        let speed = levelled(&rubbed).unwrap();
        assert!((speed / 27e3 - 1.0).abs() < 0.02, "{speed}");
        // One that gathers speed to the end.
        assert_eq!(levelled(&driven(|time| 3.5e6 * time * time)), None);
        // One that was never driven with all its voltage for long.
        assert_eq!(levelled(&driven(|time| 1e6 * time)), None);
    }
}
