//! A contour followed by both joints of a five-bar, with and without compensation and preload
//! (thesis 2.4.5, Figs. 2.21-2.23).

use pigtail_control::contour::{Contour, ContourErrors, ContourSample, errors, follow};
use pigtail_control::trajectory::Shape;
use pigtail_hal::{Axis, AxisName, Side};
use pigtail_model::windup::Windup;
use pigtail_numerics::rounded;
use pigtail_session::identify::{models, range, scale};
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use serde::Serialize;

/// What to follow, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// The contour.
    pub contour: Contour,
    /// Whose endpoint.
    pub side: Side,
    /// Side or diameter, metres.
    pub size: f64,
    /// Speed along it, m/s.
    pub speed: f64,
    /// The profile of each motion.
    pub shape: Shape,
    /// Friction in the bearings between the links, N m; the plant's where there is none.
    pub coupling: Option<f64>,
    /// Preload relative to the static friction of the load.
    pub preload: f64,
}

/// What `trace` prints as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContourDocument {
    /// `square` or `circle`.
    pub path: &'static str,
    /// Whose endpoint.
    pub side: &'static str,
    /// Side or diameter, micrometres.
    pub size_um: f64,
    /// Speed along it, micrometres a second.
    pub speed_um_s: f64,
    /// Friction in each bearing between the links, N m.
    pub coupling_nm: f64,
    /// Greatest distance from where the endpoint was wanted, but for a displacement of the whole,
    /// without compensation, micrometres.
    pub uncompensated_um: f64,
    /// With the model that remembers.
    pub compensated_um: f64,
    /// With it and the preload.
    pub preloaded_um: f64,
    /// Every machine and model.
    pub rows: Vec<Row>,
    /// The seed of the machine.
    pub seed: u64,
}

/// One machine and model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// `none`, `reversal` or `memory`.
    pub compensation: &'static str,
    /// Preload relative to the static friction of the load.
    pub preload: f64,
    /// Greatest distance from where the endpoint was wanted, micrometres.
    pub max_um: f64,
    /// Root mean square of it, micrometres.
    pub rms_um: f64,
    /// Mean displacement of the whole contour along x and y, of which the distances are free,
    /// micrometres.
    pub shift_um: [f64; 2],
}

/// A traced contour.
pub type Traced = (Row, Vec<ContourSample>);

/// Laps: the last one counts, and none differs from the one before by then.
const LAPS: u32 = 3;

/// Follows the contour without compensation and with either model, then the same on a machine with a
/// preload. Each machine's joints are identified one by one before.
///
/// # Errors
///
/// A fault; bad input where the contour leaves the workspace or the rig has no probes.
pub fn trace(
    setup: &Setup,
    plan: &Plan,
    seed: u64,
) -> Result<(ContourDocument, Vec<Traced>), Ended> {
    let mut traced = Vec::new();
    let mut setup = setup.clone();
    if let Some(friction) = plan.coupling {
        setup.plant.five_bar.bearings.friction = friction;
    }
    for preload in [0.0, plan.preload] {
        if preload > 0.0 {
            let joint = &mut setup.plant.five_bar.joint;
            joint.preload = preload * joint.load_friction.static_level();
        }
        let joints = [Axis::A, Axis::B].map(|axis| AxisName {
            side: plan.side,
            axis,
        });
        let mut fitted = Vec::with_capacity(joints.len());
        for at in joints {
            // A machine afresh for each: what one joint leaves behind is not the other's.
            let found = setup.experiment(seed, |station| {
                let scale = scale(&setup.rig, at.axis)?;
                let range = range(at.axis) / scale.metres_per_radian;
                models(station, at, &scale, range, 0.25 * range)
            })?;
            fitted.push((at, found));
        }
        for compensation in ["none", "reversal", "memory"] {
            let samples = setup.experiment(seed, |station| {
                for (at, found) in &fitted {
                    let model = match compensation {
                        "reversal" => Windup::Reversal(found.reversal.model),
                        "memory" => Windup::Memory(found.memory.model),
                        _ => Windup::None,
                    };
                    station.set_windup(*at, model);
                }
                station.set_shape(plan.shape);
                let (size, speed) = (plan.size, plan.speed);
                Ok(follow(station, plan.side, plan.contour, size, speed, LAPS)?)
            })?;
            let ContourErrors {
                shift: [x, y],
                greatest,
                rms,
            } = errors(&samples);
            let row = Row {
                compensation,
                preload,
                max_um: rounded(1e6 * greatest, 1e-3),
                rms_um: rounded(1e6 * rms, 1e-3),
                shift_um: [rounded(1e6 * x, 1e-3), rounded(1e6 * y, 1e-3)],
            };
            traced.push((row, samples));
        }
    }
    let most = |k: usize| traced[k].0.max_um;
    let document = ContourDocument {
        path: match plan.contour {
            Contour::Square => "square",
            Contour::Circle => "circle",
        },
        side: plan.side.name(),
        size_um: rounded(1e6 * plan.size, 1e-4),
        speed_um_s: rounded(1e6 * plan.speed, 1e-4),
        coupling_nm: setup.plant.five_bar.bearings.friction,
        uncompensated_um: most(0),
        compensated_um: most(2),
        preloaded_um: most(5),
        rows: traced.iter().map(|(row, _)| row.clone()).collect(),
        seed,
    };
    Ok((document, traced))
}
