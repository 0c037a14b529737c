//! A contour followed by both joints of a five-bar, with and without compensation and preload
//! (thesis 2.4.5, Figs. 2.21-2.23).

use pigtail_control::contour::{Contour, ContourErrors, ContourSample, errors};
use pigtail_control::identify::Path;
use pigtail_control::station::Unobserved;
use pigtail_control::trajectory::Shape;
use pigtail_hal::{AxisName, Side};
use pigtail_model::windup::Windup;
use pigtail_numerics::rounded;
use pigtail_session::contour::{FollowContour, JOINTS};
use pigtail_session::identify::{Models, ScanWindup, range, scale};
use pigtail_session::job::{Ended, Labelled};
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
    for (machine, preload) in [("free", 0.0), ("preloaded", plan.preload)] {
        if preload > 0.0 {
            let joint = &mut setup.plant.five_bar.joint;
            joint.preload = preload * joint.load_friction.static_level();
        }
        let mut fitted = Vec::with_capacity(JOINTS.len());
        for axis in JOINTS {
            let at = AxisName {
                side: plan.side,
                axis,
            };
            let range = range(axis) / scale(&setup.rig, axis)?.metres_per_radian;
            let speed = 0.25 * range;
            // A machine afresh for each: what one joint leaves behind is not the other's.
            let job = Labelled {
                label: format!("{machine}-{}", axis.name()),
                job: ScanWindup {
                    at,
                    path: Path::identification(range, speed),
                },
            };
            let record = setup.run(&job, seed, &mut Unobserved)?;
            fitted.push(Models::fit(record, range, speed));
        }
        for compensation in ["none", "reversal", "memory"] {
            let windup = |found: &Models| match compensation {
                "reversal" => Windup::Reversal(found.reversal.model),
                "memory" => Windup::Memory(found.memory.model),
                _ => Windup::None,
            };
            let job = Labelled {
                label: format!("{machine}-{compensation}"),
                job: FollowContour {
                    side: plan.side,
                    contour: plan.contour,
                    size: plan.size,
                    speed: plan.speed,
                    shape: plan.shape,
                    laps: LAPS,
                    windup: [windup(&fitted[0]), windup(&fitted[1])],
                },
            };
            let samples = setup.run(&job, seed, &mut Unobserved)?;
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
