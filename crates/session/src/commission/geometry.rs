//! Where both stages stand and how their axes lie, by the camera.

use super::{Bench, Found, NotDone};
use crate::calibrations::Change;
use crate::job::{Ended, Job, Order, Work};
use pigtail_control::stages::{SeenStage, see_stages};
use pigtail_hal::Side;
use pigtail_hal::spec::SIDES;
use pigtail_numerics::rounded;
use serde_json::{Map, json};

/// Chips and fibers that are looked at, each placed anew: home is where they stand on average.
const TRIED: u64 = 4;

/// Look at both stages.
struct SeeStages {
    axes: bool,
}

impl Job for SeeStages {
    type Output = [SeenStage; SIDES];

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        Ok(see_stages(&mut work.station()?, self.axes)?)
    }

    fn order(&self) -> Order {
        Order::Other
    }
}

impl Bench<'_, '_> {
    /// Home in x and z and the direction of the axis along the light are believed; how the others lie is told.
    pub(super) fn geometry(&mut self) -> Result<Found, NotDone> {
        let mut seen = Vec::with_capacity(TRIED as usize);
        for device in self.spare_devices().take(TRIED as usize) {
            let axes = seen.is_empty();
            seen.push(self.run(&SeeStages { axes }, device)?);
        }
        let mut values = Map::new();
        for side in Side::ALL {
            let stages: Vec<SeenStage> = seen.iter().map(|both| both[side.index()]).collect();
            let Some(axes) = stages[0].axes else {
                continue;
            };
            let n = stages.len() as f64;
            let of = |i: usize| {
                let mean = stages.iter().map(|seen| seen.off[i]).sum::<f64>() / n;
                let squares = stages.iter().map(|seen| (seen.off[i] - mean).powi(2));
                (mean, (squares.sum::<f64>() / (n - 1.0) / n).sqrt())
            };
            let off = [of(0), of(1)];
            let in_steps = |(value, deviation): (f64, f64), unit: f64, step: f64| {
                [value, deviation].map(|value| rounded(unit * value, step))
            };
            let um = |value| in_steps(value, 1e6, 1e-2);
            let degrees = |value| in_steps(value, 1f64.to_degrees(), 1e-5);
            let percent = |value| in_steps(value, 100.0, 1e-4);
            let (along, across) = (axes.along, axes.across);
            let square = (across.0 - along.0, across.1.hypot(along.1));
            values.insert(
                side.name().to_owned(),
                json!({
                    "home_x_um": um(off[0]),
                    "home_z_um": um(off[1]),
                    "yaw_deg": degrees(along),
                    "squareness_deg": degrees(square),
                    "roll_deg": degrees(axes.tilt[0]),
                    "pitch_deg": degrees(axes.tilt[1]),
                    "farther_x_percent": percent(axes.scale[0]),
                    "farther_z_percent": percent(axes.scale[1]),
                }),
            );
            let believed = self.setup.rig.calibration.geometry.of(side);
            let [x, y, z] = believed.home;
            let home = [x + off[0].0, y, z + off[1].0];
            let yaw = believed.yaw + axes.along.0;
            let home = home.map(|at| format!("{} mm", rounded(1e3 * at, 1e-5)));
            // Ways in x lie as the frame was believed to, and by what was seen beside that.
            let ways = [(believed.yaw + across.0).sin(), axes.tilt[1].0];
            let degrees = |angle: f64| format!("{} deg", rounded(angle.to_degrees(), 1e-5));
            let mut askew = toml_edit::InlineTable::new();
            askew.insert(
                "ways",
                toml_edit::Array::from_iter(ways.map(degrees)).into(),
            );
            let known = across.1.max(axes.tilt[1].1);
            askew.insert("deviation", degrees(known).into());
            let origin = self.origin(&format!("geometry, {}", side.name()));
            self.believe(Change {
                table: format!("geometry.{}", side.name()),
                values: vec![
                    ("home", toml_edit::value(toml_edit::Array::from_iter(home))),
                    ("yaw", toml_edit::value(degrees(yaw))),
                    ("askew", toml_edit::value(askew)),
                    ("date", toml_edit::value(&self.plan.date)),
                    ("origin", toml_edit::value(origin)),
                ],
                weights: None,
            })?;
        }
        let why = String::new();
        Ok(Found { values, why })
    }
}
