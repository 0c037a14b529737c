//! Records as laboratories bring them, made by twins: what the commands that read records can be tried on.

use anyhow::Result;
use pigtail_control::characterize::record;
use pigtail_hal::{Axis, AxisName};
use pigtail_model::hysteresis::{Hysteresis, HysteresisParameters, HysteresisState};
use pigtail_model::optics::{Coupler, GaussianMode, Misalignment};
use pigtail_numerics::fourier::Complex64;
use pigtail_session::characterize::metres_per_count;
use pigtail_session::identify::scale;
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// A file and what is in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SampleFile {
    /// Its name.
    pub name: &'static str,
    /// What it is a record of, and how it is read.
    pub about: &'static str,
    /// Its content.
    pub content: String,
}

/// All of them, of the machine that a seed draws.
///
/// # Errors
///
/// A fault; bad input where the rig has no probes.
pub fn sample_data(setup: &Setup, seed: u64) -> Result<Vec<SampleFile>, Ended> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    Ok(vec![
        SampleFile {
            name: "servo.csv",
            about: "an axis along a line under its servo: reference, encoder, voltage",
            content: servo(setup, seed)?,
        },
        SampleFile {
            name: "two-encoders.csv",
            about: "a joint with an encoder on either side of its transmission",
            content: two_encoders(setup, seed)?,
        },
        SampleFile {
            name: "piezo.csv",
            about: "a piezo's displacement over its voltage",
            content: piezo(&mut rng),
        },
        SampleFile {
            name: "map.csv",
            about: "the light that a fiber gets at the places of a grid",
            content: map(&mut rng),
        },
        SampleFile {
            name: "friction.csv",
            about: "a contact's force over its displacement, to and fro, slowly",
            content: friction(&mut rng),
        },
        SampleFile {
            name: "response.csv",
            about: "a stage's frequency response, magnitude and phase",
            content: response(&mut rng),
        },
        SampleFile {
            name: "axes.toml",
            about: "what `simulate joint` takes: the rig's axes in the middle of their make",
            content: axes(setup)?,
        },
        SampleFile {
            name: "sled.csv",
            about: "a sled whose controller a record tells: reference, encoder, voltage",
            content: sled(),
        },
    ])
}

/// A contact that gives way by 12 um before it slides at 2 N (2.13), between turning points that come nearer and go apart
/// again.
fn friction(rng: &mut Pcg64Mcg) -> String {
    const TURNS: [f64; 14] = [
        0.0, 60.0, -60.0, 45.0, -30.0, 18.0, -10.0, 30.0, -45.0, 60.0, -38.0, 22.0, 8.0, 45.0,
    ];
    let (level, way) = (2.0, 12.0);
    let mut csv = "t_s,x_um,force_N\n".to_owned();
    let (mut time, mut deflection, mut last) = (0.0, 0.0_f64, 0.0);
    for turn in TURNS.windows(2) {
        let rows = (3.0 * (turn[1] - turn[0]).abs()) as u32;
        for row in 0..rows {
            let um = turn[0] + (turn[1] - turn[0]) * f64::from(row) / f64::from(rows);
            deflection = (deflection + um - last).clamp(-way, way);
            last = um;
            let newton = level * deflection / way + 0.02 * (rng.random::<f64>() - 0.5);
            let _ = writeln!(csv, "{time:.3},{um:.3},{newton:.5}");
            time += 0.01;
        }
    }
    csv
}

/// A stage with modes at 180 and 540 Hz, damped by 0.03 and 0.015, answered 0.3 ms late.
fn response(rng: &mut Pcg64Mcg) -> String {
    const ROWS: u32 = 500;
    let mode = |hertz: f64, natural: f64, damping: f64| {
        let x = hertz / natural;
        Complex64::new(1.0, 0.0) / Complex64::new(1.0 - x * x, 2.0 * damping * x)
    };
    let mut csv = "f_Hz,magnitude,phase_deg\n".to_owned();
    for row in 0..ROWS {
        // From 20 Hz to 1 kHz, evenly on a logarithmic scale.
        let hertz = 20.0 * 50_f64.powf(f64::from(row) / f64::from(ROWS - 1));
        let late = Complex64::from_polar(1.0, -TAU * hertz * 3e-4);
        let noise = 1.0 + 0.01 * (rng.random::<f64>() - 0.5);
        let answer = (mode(hertz, 180.0, 0.03) + 0.2 * mode(hertz, 540.0, 0.015)) * late * noise;
        let _ = writeln!(
            csv,
            "{hertz:.3},{:.6},{:.4}",
            answer.norm(),
            answer.arg().to_degrees()
        );
    }
    csv
}

/// Parameters of (2.1)-(2.13) of the rig's axes, as [`Parameters`](crate::simulate::Parameters) reads them.
fn axes(setup: &Setup) -> Result<String, Ended> {
    let (plant, rig) = (&setup.plant, &setup.rig);
    let gains = &rig.calibration.gains;
    let of = [
        ("fivebar", Axis::A, &plant.five_bar.joint, &gains.five_bar),
        ("z", Axis::Z, &plant.z_stage.joint, &gains.z),
    ];
    let mut toml =
        "# Letters are those of (2.1)-(2.13), units SI; counts are those of the motor's encoder.\n"
            .to_owned();
    for (name, axis, joint, gains) in of {
        let (drive, period) = (rig.spec.drive(axis), rig.spec.period());
        let (motor, load) = (&joint.motor_friction, &joint.load_friction);
        let _ = writeln!(toml, "\n[{name}]");
        for (key, value) in [
            ("Jm", joint.motor_inertia),
            ("Jl", joint.load_inertia),
            ("r", 1.0 / drive.gear_ratio),
            ("P", scale(rig, axis)?.metres_per_radian),
            ("km", joint.motor.torque_constant),
            ("kb", joint.motor.back_emf),
            ("R", joint.motor.resistance),
            ("ks", joint.transmission.linear),
            ("kh", joint.transmission.cubic),
            ("bm", motor.viscous()),
            ("bl", load.viscous()),
            ("fsm", motor.static_level()),
            ("fcm", motor.coulomb()),
            ("fsl", load.static_level()),
            ("fcl", load.coulomb()),
            ("qp", joint.presliding),
            ("Tp", joint.preload),
            ("Nenc", f64::from(drive.counts_per_turn)),
            ("Ts", period),
            ("Vmax", drive.voltage),
            ("Vint", gains.integral_limit),
            ("kp", gains.kp),
            ("ki", gains.ki),
            ("kd", gains.kd),
        ] {
            let _ = writeln!(toml, "{key} = {value:?}");
        }
    }
    Ok(toml)
}

/// Seconds of the servo's record.
const SERVO: f64 = 16.0;

/// A z-stage that is driven to and fro, slowly and fast.
fn servo(setup: &Setup, seed: u64) -> Result<String, Ended> {
    let at: AxisName = "left.z".parse().expect("an axis of every rig");
    let metres = metres_per_count(&setup.rig, at.axis)?;
    let counts = |metres_of: f64| metres_of / metres;
    let reference = |t: f64| {
        // Begins and ends at rest.
        let fade = (t.min(SERVO - t) / 0.5).clamp(0.0, 1.0);
        let way = 4e-4 * (TAU * 0.35 * t).sin()
            + 1e-4 * (TAU * 1.9 * t).sin()
            + 1e-5 * (TAU * 23.0 * t).sin();
        counts(fade * way)
    };
    let trace = setup.experiment(seed, |station| {
        Ok(record(station, at, SERVO, reference, |_| true)?)
    })?;
    let mut csv = "t_s,q_ref_m,q_m,u_V\n".to_owned();
    for (k, encoder) in trace.encoder.iter().enumerate() {
        let time = (k + 1) as f64 * trace.period;
        let _ = writeln!(
            csv,
            "{time:.4},{:.9},{:.9},{:.5}",
            trace.reference[k] * metres,
            encoder * metres,
            trace.voltage[k]
        );
    }
    Ok(csv)
}

/// A sled of 95 kg under a controller without an integral, which its record tells; friction gives way by 5 um (2.13).
fn sled() -> String {
    const SECONDS: f64 = 12.0;
    const PERIOD: f64 = 1e-3;
    // Steps of the integration in a period of the controller.
    const STEPS: u32 = 50;
    let (mass, viscous, coulomb, way) = (95.0, 200.0, 20.0, 5e-6);
    let (newton_per_volt, position_gain, velocity_gain, most) = (35.0, 160.0, 240.0, 10.0);
    let reference = |t: f64| {
        // Begins and ends at rest, where it was.
        let fade = (t.min(SECONDS - t) / 0.5).clamp(0.0, 1.0);
        let way = 0.1 * (TAU * 0.25 * t).sin()
            + 0.02 * (TAU * 0.75 * t).sin()
            + 0.002 * (TAU * 4.0 * t).sin();
        fade * way
    };
    let mut csv = "t_s,q_ref_m,q_m,u_V\n".to_owned();
    let (mut place, mut speed, mut deflection) = (0.0, 0.0, 0.0_f64);
    let mut before = [0.0; 2];
    for row in 0..(SECONDS / PERIOD) as u32 {
        let time = f64::from(row) * PERIOD;
        // As an encoder of 0.1 um reads it.
        let read = 1e-7 * (place / 1e-7_f64).round();
        let read_speed = (read - before[1]) / (2.0 * PERIOD);
        before = [read, before[0]];
        let volts = velocity_gain * (position_gain * (reference(time) - read) - read_speed);
        let volts = volts.clamp(-most, most);
        let _ = writeln!(csv, "{time:.3},{:.9},{read:.7},{volts:.5}", reference(time));
        let step = PERIOD / f64::from(STEPS);
        for _ in 0..STEPS {
            let friction = viscous * speed + coulomb * deflection / way;
            speed += step * (newton_per_volt * volts - friction) / mass;
            place += step * speed;
            deflection = (deflection + step * speed).clamp(-way, way);
        }
    }
    csv
}

/// Seconds of the record of two encoders.
const TWO_ENCODERS: f64 = 24.0;

/// A joint that goes to and fro at changing speed, further and less far: at one speed a time skew would look as a
/// windup does.
fn two_encoders(setup: &Setup, seed: u64) -> Result<String, Ended> {
    let at: AxisName = "left.a".parse().expect("an axis of every rig");
    let scale = scale(&setup.rig, at.axis)?;
    let reference = |t: f64| {
        // Begins and ends at rest.
        let fade = (t.min(TWO_ENCODERS - t) / 0.5).clamp(0.0, 1.0);
        let way = 1.8e-2 * (TAU * 0.21 * t).sin()
            + 4.8e-3 * (TAU * 0.8 * t).sin()
            + 9e-4 * (TAU * 2.7 * t).sin();
        fade * way / scale.radians_per_count
    };
    let trace = setup.experiment(seed, |station| {
        Ok(record(station, at, TWO_ENCODERS, reference, |_| true)?)
    })?;
    let mut csv = "t_s,motor_deg,load_deg\n".to_owned();
    // As a logger of 250 Hz.
    let every = ((4e-3 / trace.period).round() as usize).max(1);
    let sides = trace.encoder.iter().zip(&trace.output).enumerate();
    for (k, (motor, load)) in sides.step_by(every) {
        let time = (k + 1) as f64 * trace.period;
        let (motor, load) = (
            motor * scale.radians_per_count,
            load / scale.metres_per_radian,
        );
        let _ = writeln!(
            csv,
            "{time:.4},{:.6},{:.6}",
            motor.to_degrees(),
            load.to_degrees()
        );
    }
    Ok(csv)
}

/// Loops of a piezo between turning points that come nearer, and a triangle that is held back.
fn piezo(rng: &mut Pcg64Mcg) -> String {
    let parameters = HysteresisParameters {
        opening: 0.15,
        spread: 0.3,
        skew: 0.1,
        saturation: 0.05,
    };
    let model = Hysteresis::new(&parameters).expect("a piezo of the usual kind");
    let mut state = HysteresisState::default();
    let turns: [f64; 15] = [
        0.0, 10.0, 0.0, 9.0, 1.0, 8.0, 2.0, 7.0, 3.0, 6.0, 0.0, 10.0, 2.0, 8.0, 0.0,
    ];
    let mut csv = "t_s,u_V,x_um\n".to_owned();
    let mut time = 0.0;
    for turn in turns.windows(2) {
        let rows = (40.0 * (turn[1] - turn[0]).abs()) as u32;
        for row in 0..rows {
            let volts = turn[0] + (turn[1] - turn[0]) * f64::from(row) / f64::from(rows);
            let share = model.advance(&mut state, volts / 5.0 - 1.0);
            let um = 35.0 * (share + 1.0) + 0.01 * (rng.random::<f64>() - 0.5);
            let _ = writeln!(csv, "{time:.3},{volts:.4},{um:.4}");
            time += 0.01;
        }
    }
    csv
}

/// A fiber of a mode of 5 um before a guide of 3 um, 20 um away, on a grid of 2 um.
fn map(rng: &mut Pcg64Mcg) -> String {
    let mode = |radius: f64| GaussianMode {
        radius_x: radius,
        radius_y: radius,
    };
    let coupler = Coupler::new(mode(3e-6), mode(5e-6), 1.55e-6).expect("positive radii");
    let (peak_x, peak_y) = (17.2, 10.6);
    let mut csv = "x_um,y_um,power_V\n".to_owned();
    for row in 0..15_u32 {
        for column in 0..18_u32 {
            let (x, y) = (2.0 * f64::from(column), 2.0 * f64::from(row));
            let at = Misalignment {
                x: 1e-6 * (x - peak_x),
                y: 1e-6 * (y - peak_y),
                z: 20e-6,
                tilt_x: 0.0,
                tilt_y: 0.0,
            };
            // Two draws: near enough to a bell.
            let noise = 5e-3 * (rng.random::<f64>() + rng.random::<f64>() - 1.0);
            let volts = 0.02 + 3.5 * coupler.efficiency(&at) + noise;
            let _ = writeln!(csv, "{x},{y},{volts:.4}");
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_files() {
        let setup = Setup::load("afpm", "y-branch").unwrap();
        let files = sample_data(&setup, 3).unwrap();
        assert_eq!(files, sample_data(&setup, 3).unwrap());
        let records = files.iter().filter(|file| {
            std::path::Path::new(file.name)
                .extension()
                .is_some_and(|of| of == "csv")
        });
        assert!(records.clone().count() >= 7);
        assert!(
            records
                .into_iter()
                .all(|file| file.content.lines().count() > 200)
        );
    }
}
