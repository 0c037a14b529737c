//! Two joints to test with, those of the trial set that reproduces the thesis, and their PID.

use pigtail_model::friction::Friction;
use pigtail_model::joint::{Joint, JointParameters};
use pigtail_model::motor::Motor;
use pigtail_model::transmission::Transmission;

pub(crate) fn z_stage() -> JointParameters {
    JointParameters {
        motor_inertia: 1e-6,
        load_inertia: 1.75e-5,
        ratio: 0.2,
        motor: Motor::new(0.02, 0.02, 5.53).expect("valid parameters"),
        transmission: Transmission::new(3.95, 0.0).expect("valid parameters"),
        motor_friction: Friction::new(2.58e-3, 2.09e-3, 1.71e-6).expect("valid parameters"),
        load_friction: Friction::new(3.06e-3, 2.94e-3, 5.7e-3).expect("valid parameters"),
        presliding: 0.0,
        load_torque: 0.0,
    }
}

pub(crate) fn five_bar() -> JointParameters {
    JointParameters {
        motor_inertia: 2.15e-6,
        load_inertia: 8.72e-5,
        ratio: 1.0 / 80.0,
        motor: Motor::new(0.0185, 0.0185, 7.88).expect("valid parameters"),
        transmission: Transmission::new(53.3, 8.94e6).expect("valid parameters"),
        motor_friction: Friction::new(3.27e-3, 3.15e-3, 3.46e-6).expect("valid parameters"),
        load_friction: Friction::new(0.12, 0.119, 0.211).expect("valid parameters"),
        presliding: 12.0 * std::f64::consts::TAU / 2000.0 * (1.0 / 80.0),
        load_torque: 0.0,
    }
}

pub(crate) fn joint(parameters: JointParameters) -> Joint {
    Joint::new(parameters, 4e-4).expect("valid parameters")
}

/// The PID of the reference trajectories, per 400 us cycle: gains in V/count, V/(count s) and
/// V s/count, limits in volts.
pub(crate) struct Pid {
    pub(crate) gains: [f64; 3],
    pub(crate) integral_clamp: f64,
    pub(crate) limit: f64,
    pub(crate) counts_per_radian: f64,
    integral: f64,
    last: Option<f64>,
}

impl Pid {
    pub(crate) fn five_bar() -> Self {
        Self {
            gains: [0.64, 90.7, 1.85e-3],
            integral_clamp: 1.75 / 90.7,
            limit: 12.0,
            counts_per_radian: 2000.0 / std::f64::consts::TAU,
            integral: 0.0,
            last: None,
        }
    }

    pub(crate) fn z_stage() -> Self {
        Self {
            gains: [0.834, 72.8, 3.97e-4],
            integral_clamp: 3.55 / 72.8,
            limit: 24.0,
            counts_per_radian: 2048.0 / std::f64::consts::TAU,
            ..Self::five_bar()
        }
    }

    /// The voltage of this cycle for a reference in whole counts.
    pub(crate) fn voltage(&mut self, reference: i64, motor_angle: f64) -> f64 {
        let [kp, ki, kd] = self.gains;
        let error = (reference - round_up(motor_angle * self.counts_per_radian)) as f64;
        let clamp = self.integral_clamp;
        self.integral = (self.integral + error * 4e-4).clamp(-clamp, clamp);
        let rate = self.last.map_or(0.0, |last| (error - last) * 2500.0);
        self.last = Some(error);
        (kp * error + ki * self.integral + kd * rate).clamp(-self.limit, self.limit)
    }
}

/// `floor(x + 0.5)`; the method `floor` is a call into the C library on most targets.
pub(crate) fn round_up(x: f64) -> i64 {
    let x = x + 0.5;
    let truncated = x as i64;
    truncated - i64::from(truncated as f64 > x)
}
