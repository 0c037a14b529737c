//! A motor axis under the law of load friction that its rig has chosen.

use super::TwinError;
use super::plant::{JointPlant, LoadLaw, Variation};
use pigtail_model::Invalid;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::presliding::{ElementState, MaxwellSlip};
use rand::RngExt;

/// More integration steps in a servo cycle than this are not a stiff joint but a mistyped one.
const MOST_STEPS: f64 = 100.0;

/// A joint and its state.
#[expect(
    clippy::large_enum_variant,
    reason = "the common one is stepped every cycle, and must not be behind a pointer"
)]
#[derive(Debug, Clone)]
pub(super) enum Drive {
    /// After the thesis: (2.7), (2.8), (2.12), (2.13).
    CoulombPresliding(Joint, JointState),
    /// Maxwell-slip elements; boxed, as their memory is many times larger.
    MaxwellSlip(Box<(Joint<MaxwellSlip>, JointState<ElementState>)>),
}

impl Drive {
    /// A specimen of a joint behind a gear of `ratio` output turns a motor turn, integrated in
    /// steps that divide `period` (seconds). `name` is for errors.
    pub(super) fn draw(
        nominal: &JointPlant,
        name: &'static str,
        ratio: f64,
        period: f64,
        variation: &Variation,
        rng: &mut impl RngExt,
    ) -> Result<Self, TwinError> {
        let parameters = nominal.draw(ratio, variation, rng)?;
        let step = |p: &JointParameters, contact: f64| {
            let steps = (period / p.coarsest_step(contact)).ceil().max(1.0);
            if steps > MOST_STEPS {
                return Err(TwinError::Stiff { axis: name, steps });
            }
            Ok(period / steps)
        };
        Ok(match nominal.friction {
            LoadLaw::CoulombPresliding => {
                let joint = Joint::new(parameters, step(&parameters, 0.0)?)?;
                Self::CoulombPresliding(joint, JointState::default())
            }
            LoadLaw::MaxwellSlip => {
                let contact =
                    MaxwellSlip::new(parameters.load_friction.coulomb(), parameters.presliding)?
                        .initial_stiffness();
                // Two steps where one would do: the elements' kinks are not smooth.
                let step = 0.5 * step(&parameters, contact)?;
                let joint = Joint::maxwell_slip(parameters, step)?;
                Self::MaxwellSlip(Box::new((joint, JointState::default())))
            }
        })
    }

    /// One cycle under a held voltage and a torque on the load from outside, N m.
    #[inline]
    pub(super) fn advance(&mut self, voltage: f64, load_torque: f64, period: f64) {
        match self {
            Self::CoulombPresliding(joint, state) => {
                state.load_torque = load_torque;
                joint.advance(state, voltage, period);
            }
            Self::MaxwellSlip(drive) => {
                let (joint, state) = &mut **drive;
                state.load_torque = load_torque;
                joint.advance(state, voltage, period);
            }
        }
    }

    /// Angle of the motor, radians.
    pub(super) fn motor_angle(&self) -> f64 {
        match self {
            Self::CoulombPresliding(_, state) => state.motor_angle,
            Self::MaxwellSlip(drive) => drive.1.motor_angle,
        }
    }

    /// Angle of the output, (2.12), radians.
    pub(super) fn output(&self) -> f64 {
        match self {
            Self::CoulombPresliding(joint, state) => joint.output(state),
            Self::MaxwellSlip(drive) => drive.0.output(&drive.1),
        }
    }
}

/// Friction that holds two or more outputs together: a bearing between links.
#[derive(Debug, Clone)]
pub(super) struct Bearing {
    law: MaxwellSlip,
    state: ElementState,
    angle: f64,
    direction: f64,
}

impl Bearing {
    /// A bearing that slides at `level` (N m) after giving way over some `way` (rad).
    pub(super) fn new(level: f64, way: f64) -> Result<Self, Invalid> {
        Ok(Self {
            law: MaxwellSlip::new(level, way)?,
            state: ElementState::default(),
            angle: 0.0,
            direction: 0.0,
        })
    }

    /// Its torque against the motion that brought it to `angle`, N m.
    pub(super) fn torque_at(&mut self, angle: f64) -> f64 {
        use pigtail_model::presliding::Presliding as _;
        let step = angle - self.angle;
        if step * self.direction < 0.0 {
            self.law.turn(&mut self.state, self.angle);
        }
        if step != 0.0 {
            self.direction = step;
            self.angle = angle;
        }
        self.law.torque(&self.state, angle)
    }
}
