//! The motor axes of a machine, all stepped together, under the laws of load friction that its rig
//! has chosen.

use super::TwinError;
use super::plant::{JointPlant, LoadLaw, Plant};
use super::sensors::encode;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, SIDES};
use pigtail_hal::{Axis, Spec};
use pigtail_model::group::Group;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::lugre::{BristleState, LuGre};
use pigtail_model::presliding::{ElementState, MaxwellSlip};

/// More integration steps in a servo cycle than this are not a stiff joint but a mistyped one.
const MOST_STEPS: f64 = 100.0;

/// Steps a cycle with which a scanning five-bar joint errs by less than 1e-4 um (and by 5e-4 um after
/// a jolt of the full voltage); a z-stage needs one.
const STEPS: [f64; 2] = [2.0, 1.0];

/// All motor axes. An axis is homed with its preload on: the transmission carries it, so that
/// friction is at rest, and the encoder is zero there.
#[derive(Debug, Clone)]
pub(super) struct Drives {
    /// Left a and b, right a and b.
    five_bars: Joints<4>,
    /// Left, right.
    z_stages: Joints<2>,
    /// Motor angle at which each encoder was set to zero, radians.
    homes: [[f64; AXES]; SIDES],
    counts_per_radian: [f64; AXES],
    limits: [f64; AXES],
}

/// Joints of one kind.
#[derive(Debug, Clone)]
enum Joints<const N: usize> {
    /// After the thesis: (2.7), (2.8), (2.12), (2.13).
    CoulombPresliding(Group<N>, [JointState; N]),
    /// Maxwell-slip elements.
    MaxwellSlip(Vec<(Joint<MaxwellSlip>, JointState<ElementState>)>),
    /// LuGre.
    LuGre(Vec<(Joint<LuGre>, JointState<BristleState>)>),
}

impl Drives {
    /// The axes of a machine whose joints are these, left and right.
    pub(super) fn new(
        plant: &Plant,
        spec: &Spec,
        joints: &[[JointParameters; AXES]; SIDES],
    ) -> Result<Self, TwinError> {
        let [[la, lb, lz], [ra, rb, rz]] = *joints;
        let period = spec.period();
        let home = |p: &JointParameters| p.transmission.twist(-p.load_torque) / p.ratio;
        Ok(Self {
            five_bars: Joints::new(
                &plant.five_bar.joint,
                [la, lb, ra, rb],
                "of a five-bar",
                period,
                STEPS[0],
            )?,
            z_stages: Joints::new(
                &plant.z_stage.joint,
                [lz, rz],
                "of a z-stage",
                period,
                STEPS[1],
            )?,
            homes: joints.map(|side| side.map(|p| home(&p))),
            counts_per_radian: Axis::ALL.map(|axis| 1.0 / spec.drive(axis).count()),
            limits: Axis::ALL.map(|axis| spec.drive(axis).voltage),
        })
    }

    /// One cycle of `period` seconds under held voltages, and torques on the loads from outside
    /// (N m).
    pub(super) fn advance(
        &mut self,
        voltages: &[[Volts; AXES]; SIDES],
        torques: &[[f64; AXES]; SIDES],
        period: f64,
    ) {
        let volts = |side: usize, axis: usize| {
            voltages[side][axis]
                .0
                .clamp(-self.limits[axis], self.limits[axis])
        };
        self.five_bars.advance(
            [volts(0, 0), volts(0, 1), volts(1, 0), volts(1, 1)],
            [torques[0][0], torques[0][1], torques[1][0], torques[1][1]],
            period,
        );
        let (left, right) = (volts(0, 2), volts(1, 2));
        self.z_stages
            .advance([left, right], [torques[0][2], torques[1][2]], period);
    }

    /// Angles of a manipulator's outputs, (2.12), radians.
    pub(super) fn outputs(&self, side: usize) -> [f64; AXES] {
        [
            self.five_bars.output(2 * side),
            self.five_bars.output(2 * side + 1),
            self.z_stages.output(side),
        ]
    }

    /// What a manipulator's encoders read.
    pub(super) fn encoders(&self, side: usize) -> [Counts; AXES] {
        let angles = [
            self.five_bars.motor_angle(2 * side),
            self.five_bars.motor_angle(2 * side + 1),
            self.z_stages.motor_angle(side),
        ];
        std::array::from_fn(|i| encode(angles[i] - self.homes[side][i], self.counts_per_radian[i]))
    }
}

impl<const N: usize> Joints<N> {
    fn new(
        joint: &JointPlant,
        parameters: [JointParameters; N],
        name: &'static str,
        period: f64,
        least: f64,
    ) -> Result<Self, TwinError> {
        let step = |p: &JointParameters, contact: f64| {
            let steps = (period / p.coarsest_step(contact)).ceil().max(least);
            if steps > MOST_STEPS {
                return Err(TwinError::Stiff { axis: name, steps });
            }
            Ok(period / steps)
        };
        let homed = |p: &JointParameters| p.transmission.twist(-p.load_torque) / p.ratio;
        Ok(match joint.friction {
            LoadLaw::CoulombPresliding => {
                let mut joints = Vec::with_capacity(N);
                for p in parameters {
                    joints.push(Joint::new(p, step(&p, 0.0)?)?);
                }
                let states = std::array::from_fn(|i| JointState {
                    motor_angle: homed(&parameters[i]),
                    ..JointState::default()
                });
                Self::CoulombPresliding(Group::new(std::array::from_fn(|i| joints[i])), states)
            }
            LoadLaw::MaxwellSlip => {
                let mut joints = Vec::with_capacity(N);
                for p in parameters {
                    let elements = MaxwellSlip::new(p.load_friction.coulomb(), p.presliding)?;
                    // Two steps where one would do: the elements' kinks are not smooth.
                    let step = 0.5 * step(&p, elements.initial_stiffness())?;
                    let state = JointState {
                        motor_angle: homed(&p),
                        ..JointState::default()
                    };
                    joints.push((Joint::maxwell_slip(p, step)?, state));
                }
                Self::MaxwellSlip(joints)
            }
            LoadLaw::LuGre => {
                let mut joints = Vec::with_capacity(N);
                for p in parameters {
                    let bristle = LuGre::new(&p.load_friction, p.presliding, joint.stribeck)?;
                    let step = step(&p, bristle.initial_stiffness())?;
                    let state = JointState {
                        motor_angle: homed(&p),
                        ..JointState::default()
                    };
                    joints.push((Joint::lugre(p, joint.stribeck, step)?, state));
                }
                Self::LuGre(joints)
            }
        })
    }

    #[inline]
    fn advance(&mut self, voltages: [f64; N], torques: [f64; N], period: f64) {
        match self {
            Self::CoulombPresliding(group, states) => {
                for (state, torque) in states.iter_mut().zip(torques) {
                    state.load_torque = torque;
                }
                group.advance(states, voltages, period);
            }
            Self::MaxwellSlip(joints) => {
                for (i, (joint, state)) in joints.iter_mut().enumerate() {
                    state.load_torque = torques[i];
                    joint.advance(state, voltages[i], period);
                }
            }
            Self::LuGre(joints) => {
                for (i, (joint, state)) in joints.iter_mut().enumerate() {
                    state.load_torque = torques[i];
                    joint.advance(state, voltages[i], period);
                }
            }
        }
    }

    fn motor_angle(&self, i: usize) -> f64 {
        match self {
            Self::CoulombPresliding(_, states) => states[i].motor_angle,
            Self::MaxwellSlip(joints) => joints[i].1.motor_angle,
            Self::LuGre(joints) => joints[i].1.motor_angle,
        }
    }

    fn output(&self, i: usize) -> f64 {
        match self {
            Self::CoulombPresliding(group, states) => group.joints()[i].output(&states[i]),
            Self::MaxwellSlip(joints) => joints[i].0.output(&joints[i].1),
            Self::LuGre(joints) => joints[i].0.output(&joints[i].1),
        }
    }
}
