//! A motor axis under the law of load friction that its rig has chosen.

use super::TwinError;
use super::plant::{JointPlant, LoadLaw, Variation};
use pigtail_model::Invalid;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::presliding::{ElementState, MaxwellSlip};
use rand::RngExt;

/// More integration steps in a servo cycle than this are not a stiff joint but a mistyped one.
const MOST_STEPS: f64 = 100.0;

/// A joint, its state, and the motor angle at which its encoder was set to zero.
///
/// An axis is homed with its preload on: the transmission carries it, so that friction is at rest.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    joint: AnyJoint,
    home: f64,
}

/// A joint and its state.
#[expect(
    clippy::large_enum_variant,
    reason = "the common one is stepped every cycle, and must not be behind a pointer"
)]
#[derive(Debug, Clone)]
enum AnyJoint {
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
        let home = parameters.transmission.twist(-parameters.load_torque) / ratio;
        let joint = match nominal.friction {
            LoadLaw::CoulombPresliding => {
                let joint = Joint::new(parameters, step(&parameters, 0.0)?)?;
                let state = JointState {
                    motor_angle: home,
                    ..JointState::default()
                };
                AnyJoint::CoulombPresliding(joint, state)
            }
            LoadLaw::MaxwellSlip => {
                let contact =
                    MaxwellSlip::new(parameters.load_friction.coulomb(), parameters.presliding)?
                        .initial_stiffness();
                // Two steps where one would do: the elements' kinks are not smooth.
                let step = 0.5 * step(&parameters, contact)?;
                let joint = Joint::maxwell_slip(parameters, step)?;
                let state = JointState {
                    motor_angle: home,
                    ..JointState::default()
                };
                AnyJoint::MaxwellSlip(Box::new((joint, state)))
            }
        };
        Ok(Self { joint, home })
    }

    /// One cycle under a held voltage and a torque on the load from outside, N m.
    #[inline]
    pub(super) fn advance(&mut self, voltage: f64, load_torque: f64, period: f64) {
        match &mut self.joint {
            AnyJoint::CoulombPresliding(joint, state) => {
                state.load_torque = load_torque;
                joint.advance(state, voltage, period);
            }
            AnyJoint::MaxwellSlip(drive) => {
                let (joint, state) = &mut **drive;
                state.load_torque = load_torque;
                joint.advance(state, voltage, period);
            }
        }
    }

    /// Angle of the motor from home, radians.
    pub(super) fn motor_angle(&self) -> f64 {
        let angle = match &self.joint {
            AnyJoint::CoulombPresliding(_, state) => state.motor_angle,
            AnyJoint::MaxwellSlip(drive) => drive.1.motor_angle,
        };
        angle - self.home
    }

    /// Angle of the output, (2.12), radians.
    pub(super) fn output(&self) -> f64 {
        match &self.joint {
            AnyJoint::CoulombPresliding(joint, state) => joint.output(state),
            AnyJoint::MaxwellSlip(drive) => drive.0.output(&drive.1),
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
