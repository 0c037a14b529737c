//! Windup loops of an axis on machines that differ in load friction, preload and law of friction
//! (thesis 2.4.1, 2.4.2): the same specimen each time but for what is varied.

use pigtail_control::identify::{Fit, Path, WindupRecord, fit_reversal};
use pigtail_control::station::Unobserved;
use pigtail_hal::{Axis, AxisName};
use pigtail_model::windup::Reversal;
use pigtail_numerics::rounded;
use pigtail_session::identify::{ScanWindup, range, scale};
use pigtail_session::job::{Ended, Labelled};
use pigtail_session::setup::{Setup, unfit};
use pigtail_twin::plant::{JointPlant, LoadLaw};
use serde::Serialize;

/// What `characterize AXIS windup` prints as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoopsDocument {
    /// The axis.
    pub axis: String,
    /// Range of the scan, forward and back, micrometres at the output.
    pub range_um: f64,
    /// The seed of the machine.
    pub seed: u64,
    /// The machines.
    pub cases: Vec<Case>,
}

/// One machine.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// The thesis's figure that it answers to.
    pub figure: &'static str,
    /// What is different.
    pub name: String,
    /// Law of load friction.
    pub law: &'static str,
    /// Load friction, relative to the rig's.
    pub load_friction: f64,
    /// Preload, relative to the static friction of the load.
    pub preload: f64,
    /// Windup on the way forward less that on the way back, micrometres at the output.
    pub windup_um: f64,
    /// `W_max` of (2.20) fitted to it, micrometres; `null` where there is too little windup to fit.
    pub w_max_um: Option<f64>,
    /// `Q` of (2.20), micrometres.
    pub q_um: Option<f64>,
    /// Root mean square of what (2.20) leaves, micrometres.
    pub residual_um: Option<f64>,
    /// Most of it, micrometres.
    pub largest_residual_um: Option<f64>,
}

impl LoopsDocument {
    /// Which law of load friction gives the curve (2.20) that the thesis measured, and which the straight
    /// transition of its model, by what (2.20) leaves of each as a share of `W_max`. `None` where nothing
    /// winds up.
    pub fn laws(&self) -> Option<String> {
        let mut shares: Vec<(&str, f64)> = self
            .cases
            .iter()
            .filter(|c| c.figure == "2.14, 2.15")
            .filter_map(|c| Some((c.name.as_str(), 100.0 * c.residual_um? / c.w_max_um?)))
            .filter(|(_, share)| share.is_finite())
            .collect();
        shares.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (nearest, _) = shares.first()?;
        let each: Vec<String> = shares
            .iter()
            .map(|(name, share)| format!("{share:.1} % of W_max under {name}"))
            .collect();
        Some(format!(
            "Nearest the curve (2.20) of Figs. 2.8 and 2.14 comes {nearest}: it leaves {}",
            each.join(", ")
        ))
    }
}

/// A machine's loop.
#[derive(Debug, Clone)]
pub struct Loop {
    /// In figures.
    pub case: Case,
    /// What was measured.
    pub record: WindupRecord,
    /// (2.20) fitted to it.
    pub fit: Option<Fit<Reversal>>,
    /// Micrometres at the output for a radian.
    pub um_per_radian: f64,
}

/// A way to change a joint.
#[derive(Debug, Clone, Copy)]
struct Change {
    figure: &'static str,
    load_friction: f64,
    preload: f64,
    law: Option<LoadLaw>,
}

impl Change {
    const fn none(figure: &'static str) -> Self {
        Self {
            figure,
            load_friction: 1.0,
            preload: 0.0,
            law: None,
        }
    }

    const fn friction(figure: &'static str, load_friction: f64) -> Self {
        Self {
            load_friction,
            ..Self::none(figure)
        }
    }

    const fn preload(preload: f64) -> Self {
        Self {
            preload,
            ..Self::none("2.12, 2.13")
        }
    }

    const fn law(law: LoadLaw) -> Self {
        Self {
            law: Some(law),
            ..Self::none("2.14, 2.15")
        }
    }

    fn apply(self, joint: &mut JointPlant) -> Result<(), Ended> {
        let level = joint.load_friction.static_level();
        joint.load_friction = joint
            .load_friction
            .times(self.load_friction)
            .map_err(unfit)?;
        // The contact is as stiff as before (2.13): with less friction it gives way less far.
        joint.presliding *= self.load_friction;
        if self.preload > 0.0 {
            joint.preload = self.preload * level;
        }
        if let Some(law) = self.law {
            joint.friction = law;
        }
        if self.load_friction == 0.0 {
            // Without friction there is no contact that could give way, by whatever law.
            joint.friction = LoadLaw::CoulombPresliding;
        }
        Ok(())
    }

    fn name(self, joint: &JointPlant) -> String {
        if let Some(law) = self.law {
            return law_name(law).to_owned();
        }
        if self.preload > 0.0 {
            return format!("preload of {} x static friction", self.preload);
        }
        match self.load_friction {
            0.0 => "no load friction".to_owned(),
            1.0 if joint.preload == 0.0 => "as it is, no preload".to_owned(),
            1.0 => "as it is".to_owned(),
            share => format!("{share} x load friction"),
        }
    }
}

fn law_name(law: LoadLaw) -> &'static str {
    match law {
        LoadLaw::CoulombPresliding => "coulomb-presliding",
        LoadLaw::MaxwellSlip => "maxwell-slip",
        LoadLaw::LuGre => "lugre",
    }
}

/// Windup on the way forward less windup on the way back, each in the mean over the middle third of
/// the last two ways, radians: away from the turns, where inertia has its part.
pub fn middle_windup(record: &WindupRecord) -> f64 {
    let way = record.input.len() / 4;
    let mean = |start: usize| {
        let middle = start + way / 3..start + 2 * way / 3;
        let n = middle.len() as f64;
        middle
            .map(|k| record.input[k] - record.output[k])
            .sum::<f64>()
            / n
    };
    mean(2 * way) - mean(3 * way)
}

/// Scans the axis forward and back on each machine.
///
/// # Errors
///
/// A fault; bad input where the rig has no probes.
pub fn windup(setup: &Setup, at: AxisName, seed: u64) -> Result<(LoopsDocument, Vec<Loop>), Ended> {
    let joint = |setup: &Setup| match at.axis {
        Axis::A | Axis::B => setup.plant.five_bar.joint,
        Axis::Z => setup.plant.z_stage.joint,
    };
    let first = if at.axis == Axis::Z { "2.11" } else { "2.8" };
    let mut changes = vec![
        Change::none(first),
        Change::friction("2.9", 0.5),
        Change::friction("2.9", 0.05),
        Change::friction("2.10", 0.0),
        Change::preload(0.6),
        Change::preload(1.2),
        Change::preload(2.4),
    ];
    // Elements need some way to give way over.
    if joint(setup).presliding > 0.0 {
        changes.push(Change::law(LoadLaw::CoulombPresliding));
        changes.push(Change::law(LoadLaw::MaxwellSlip));
        changes.push(Change::law(LoadLaw::LuGre));
    }
    let scale = scale(&setup.rig, at.axis)?;
    let um = 1e6 * scale.metres_per_radian;
    let range = range(at.axis) / scale.metres_per_radian;
    let path = Path {
        turns: [0.0, 1.0, 0.0, 1.0, 0.0].map(|t| t * range).to_vec(),
        speed: 0.25 * range,
    };
    let mut loops = Vec::with_capacity(changes.len());
    for change in changes {
        let mut setup = setup.clone();
        let joint = match at.axis {
            Axis::A | Axis::B => &mut setup.plant.five_bar.joint,
            Axis::Z => &mut setup.plant.z_stage.joint,
        };
        let name = change.name(joint);
        change.apply(joint)?;
        let law = joint.friction;
        let preload = joint.preload / joint.load_friction.static_level().max(f64::MIN_POSITIVE);
        let job = Labelled {
            label: format!("machine-{}", loops.len() + 1),
            job: ScanWindup {
                at,
                path: path.clone(),
            },
        };
        let record = setup.run(&job, seed, &mut Unobserved)?;
        let lead = record.input.len() / 4;
        let windup = middle_windup(&record);
        // With less than a count from side to side there is nothing to fit.
        let fit = (windup > scale.radians_per_count)
            .then(|| fit_reversal(&record, lead..record.input.len()));
        let of = |value: fn(&Fit<Reversal>) -> f64| {
            fit.as_ref().map(|fit| rounded(um * value(fit), 1e-4))
        };
        loops.push(Loop {
            case: Case {
                figure: change.figure,
                name,
                law: law_name(law),
                load_friction: change.load_friction,
                preload: rounded(
                    if change.load_friction > 0.0 {
                        preload
                    } else {
                        0.0
                    },
                    1e-4,
                ),
                windup_um: rounded(um * windup, 1e-4),
                w_max_um: of(|fit| fit.model.maximum),
                q_um: of(|fit| fit.model.way),
                residual_um: of(|fit| fit.residual),
                largest_residual_um: of(|fit| fit.largest),
            },
            record,
            fit,
            um_per_radian: um,
        });
    }
    let document = LoopsDocument {
        axis: at.to_string(),
        range_um: rounded(um * range, 1e-4),
        seed,
        cases: loops.iter().map(|l| l.case.clone()).collect(),
    };
    Ok((document, loops))
}
