//! Method 1 as printed: the macro's own raster at 8 Hz, with and without compensation of windup, which links chapters 2
//! and 3.

use super::super::Bench;
use super::super::picture::{Points, thin};
use pigtail_control::contour::{ContourSample, errors, raster};
use pigtail_control::identify::Path;
use pigtail_control::station::Unobserved;
use pigtail_hal::{Axis, AxisName, Side};
use pigtail_model::windup::Windup;
use pigtail_session::identify::{Models, ScanWindup, range, scale};
use pigtail_session::job::Ended;

/// Mesh of 3.2, metres.
const MESH: f64 = 5e-6;
/// Half of the area's height: what a quarter of a pass shows the whole does.
const AREA: [f64; 2] = [100e-6, 100e-6];

/// Speed along the lines with which they go back and forth 8 times a second, as printed, m/s. A sine of 8 Hz is as fast as
/// the photodiode allows, 2.5 mm/s, in its middle alone.
const SPEED: f64 = 1.71e-3;

/// What a raster of the macro covered.
pub(super) struct Covered {
    /// Share of the mesh's points near which a light sample was taken.
    pub share: f64,
    /// Lines back and forth in a second.
    pub hertz: f64,
    /// Greatest distance from where it was wanted, micrometres.
    pub error: f64,
    /// Where the endpoint was, micrometres.
    pub path: Points,
}

/// By the macro alone: without compensation, with (2.20)-(2.26), and with the model that remembers.
pub(super) fn covered(bench: &Bench) -> Result<[Covered; 3], Ended> {
    let setup = &bench.machine;
    let side = Side::Left;
    let joints = [Axis::A, Axis::B].map(|axis| AxisName { side, axis });
    let mut models = Vec::new();
    for at in joints {
        let range = range(at.axis) / scale(&setup.rig, at.axis)?.metres_per_radian;
        let speed = 0.25 * range;
        let path = Path::identification(range, speed);
        let record = setup.run(&ScanWindup { at, path }, bench.seed, &mut Unobserved)?;
        models.push(Models::fit(record, range, speed));
    }
    let rate = setup.rig.spec.photodiode.rate;
    let run = |windup: &dyn Fn(&Models) -> Windup| -> Result<Covered, Ended> {
        let samples = setup.experiment(bench.seed, |station| {
            for (at, found) in joints.into_iter().zip(&models) {
                station.set_windup(at, windup(found));
            }
            Ok(raster(
                station,
                side,
                [AREA[0], AREA[1], 0.5 * MESH],
                SPEED,
            )?)
        })?;
        let seconds = samples.len() as f64 / setup.rig.spec.servo.rate;
        let lines = AREA[1] / (0.5 * MESH);
        let every = (setup.rig.spec.servo.rate / rate).round() as usize;
        Ok(Covered {
            share: share(&samples, every),
            hertz: 0.5 * lines / seconds,
            error: 1e6 * errors(&samples).greatest,
            path: thin(
                samples
                    .iter()
                    .map(|s| (1e6 * s.measured.x, 1e6 * s.measured.y)),
            ),
        })
    };
    Ok([
        run(&|_| Windup::None)?,
        run(&|found| Windup::Reversal(found.reversal.model))?,
        run(&|found| Windup::Memory(found.memory.model))?,
    ])
}

/// Share of the mesh's points that have a light sample within a mesh of them. A displacement of the whole is no fault of the
/// raster.
fn share(samples: &[ContourSample], every: usize) -> f64 {
    let [dx, dy] = errors(samples).shift;
    let read: Vec<(f64, f64)> = samples
        .iter()
        .step_by(every.max(1))
        .map(|s| (s.measured.x - dx, s.measured.y - dy))
        .collect();
    let [nx, ny] = AREA.map(|way| (way / MESH) as usize);
    let seen = (0..nx * ny)
        .filter(|k| {
            let middle = |k: usize, way: f64| (k as f64 + 0.5) * MESH - 0.5 * way;
            let (x, y) = (middle(k % nx, AREA[0]), middle(k / nx, AREA[1]));
            read.iter().any(|p| (p.0 - x).hypot(p.1 - y) < MESH)
        })
        .count();
    seen as f64 / (nx * ny) as f64
}
