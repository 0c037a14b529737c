//! Where stages stand and how their axes lie, by the camera: each endpoint goes some way along its axes, and the camera sees where that took its
//! tip. It looks down on the chip, so that it tells nothing of y but how much of x and z there is in it.

use crate::outcome::{Halt, Outcome};
use crate::station::{Station, VoltageMachine};
use nalgebra::{SMatrix, SVector};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{FiberHandling, Side};
use pigtail_model::frames::{Chip, Macro, Point};
use pigtail_numerics::normal::Normal;

/// How far an endpoint goes along x, y and z, metres, within what the camera sees around home. Across the light no farther than so that stages which lean by
/// two degrees are not taken for a fiber that slips: encoders and camera then differ by some 16 um.
const ACROSS: f64 = 0.5e-3;
const UP: f64 = 0.3e-3;
const ALONG: f64 = 2e-3;

/// How fast, m/s: a camera that is later than it says by a tenth sees a fiber that hurries elsewhere than encoders have it.
const SPEED: f64 = 1e-3;

/// For how long it stands at each place before frames of it count, seconds: as a transmission comes to rest...
const REST: f64 = 0.1;

/// ...and how many do.
const FRAMES: usize = 20;

/// A place, and what an endpoint has gone along x, y and z.
const TERMS: usize = 4;

/// What the camera told of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenStage {
    /// How much farther than believed a tip is at home, in the chip's x and z, metres: where the stage stands, with how its chip and its fiber lie.
    pub off: [f64; 2],
    /// How its axes lie, if it went along them.
    pub axes: Option<Axes>,
}

/// How the axes of a stage lie beside where they are believed to be. Angles are of a rotation about y, from z to x, radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Of the axis along the light, with its standard deviation.
    pub along: (f64, f64),
    /// Of the one across it.
    pub across: (f64, f64),
    /// How much farther it goes along x and along z, of its way: as far as the camera knows lengths.
    pub scale: [(f64, f64); 2],
    /// How much it goes along x and along z of a way in y: roll and pitch.
    pub tilt: [(f64, f64); 2],
}

/// Looks at both stages, indexed by side, with a fiber in each holder: at home, and, if axes are asked for, along them.
///
/// # Errors
///
/// A fault; [`Outcome::BenchFailed`] where the camera does not see the tips.
pub fn see_stages(station: &mut Station, axes: bool) -> Result<[SeenStage; SIDES], Halt> {
    station.laser(false);
    for side in Side::ALL {
        station.handle_fiber(side, FiberHandling::Load(0))?;
    }
    let home = Side::ALL.map(|side| station.wanted(side));
    let (a, u, z) = (ACROSS, UP, ALONG);
    let all = [
        [0.0, 0.0, 0.0],
        [a, 0.0, 0.0],
        [a, 0.0, z],
        [0.0, u, z],
        [0.0, 0.0, z],
        [0.0, -u, z],
        [-a, 0.0, z],
        [-a, 0.0, 0.0],
        [0.0, -u, 0.0],
        [0.0, u, 0.0],
        [0.0, 0.0, 0.0],
    ];
    let places = if axes { &all[..] } else { &all[..1] };
    let mut seen: [Vec<Seen>; SIDES] = Default::default();
    for [x, y, z] in places {
        for side in Side::ALL {
            let to = home[side.index()].shifted(*x, *y, *z);
            station.start_line(side, to, Some(SPEED))?;
        }
        while Side::ALL.iter().any(|side| station.moving(*side)) {
            station.cycle()?;
        }
        look(station, &mut seen)?;
    }
    for side in Side::ALL {
        station.line(side, home[side.index()], Some(SPEED))?;
        station.handle_fiber(side, FiberHandling::Unload)?;
    }
    let told = |side: Side| told(&seen[side.index()], home[side.index()], axes);
    let all = [told(Side::Left), told(Side::Right)];
    let [Some(left), Some(right)] = all else {
        let why = "the camera does not see how far the tips go".to_owned();
        return Err(Outcome::BenchFailed { why }.into());
    };
    Ok([left, right])
}

/// A tip in a frame.
#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Where its endpoint was.
    endpoint: Point<Macro>,
    /// By how much more the camera has it than it was believed to be, in x and z, metres.
    more: [f64; 2],
    /// By how much a step of the endpoint in its x and z is one in the chip's x and z.
    turned: [[f64; 2]; 2],
}

/// Frames of both tips at rest.
fn look(station: &mut Station, seen: &mut [Vec<Seen>; SIDES]) -> Result<(), Halt> {
    station.run(REST)?;
    let begin = station.time();
    let mut frames = 0;
    while frames < FRAMES {
        let frame = station.next_frame()?;
        if frame.time < begin {
            continue;
        }
        frames += 1;
        for side in Side::ALL {
            let Some(tip) = frame.fiber[side.index()] else {
                continue;
            };
            // Probes see the outputs; without any, encoders and what is known of windup.
            let probed = station.probed_endpoint(side);
            let endpoint = probed.unwrap_or_else(|| station.endpoint(side));
            let placement = station.kinematics(side).placement();
            let believed: Point<Chip> = placement.chip_from_macro(endpoint);
            let [xx, _, xz] = placement.chip_direction(1.0, 0.0, 0.0);
            let [zx, _, zz] = placement.chip_direction(0.0, 0.0, 1.0);
            seen[side.index()].push(Seen {
                endpoint,
                more: [tip.x - believed.x, tip.z - believed.z],
                turned: [[xx, xz], [zx, zz]],
            });
        }
    }
    Ok(())
}

/// What frames of one tip tell; `None` where there are none, or too few ways.
fn told(seen: &[Seen], home: Point<Macro>, axes: bool) -> Option<SeenStage> {
    let n = seen.len() as f64;
    if !axes {
        let mean = |i: usize| seen.iter().map(|seen| seen.more[i]).sum::<f64>() / n;
        return (n > 0.0).then(|| SeenStage {
            off: [mean(0), mean(1)],
            axes: None,
        });
    }
    // In the chip's directions: x, y, z in millimetres, so that the equations are well scaled.
    let row = |seen: &Seen| {
        let (x, z) = (seen.endpoint.x - home.x, seen.endpoint.z - home.z);
        let [[xx, xz], [zx, zz]] = seen.turned;
        let y = seen.endpoint.y - home.y;
        SVector::from([1e-3, xx * x + zx * z, y, xz * x + zz * z])
    };
    let mut normal: [Normal<TERMS>; 2] = Default::default();
    for seen in seen {
        for (normal, more) in normal.iter_mut().zip(seen.more) {
            normal.add(&row(seen), more);
        }
    }
    let inverse: SMatrix<f64, TERMS, TERMS> = normal[0].matrix.try_inverse()?;
    let found = [normal[0].solve()?, normal[1].solve()?];
    let term = |of: usize, k: usize| {
        let left = seen.iter().map(|s| s.more[of] - row(s).dot(&found[of]));
        let variance = left.map(|left| left * left).sum::<f64>() / (n - TERMS as f64);
        (found[of][k], (variance * inverse[(k, k)]).sqrt())
    };
    let (x_of_z, z_of_x) = (term(0, 3), term(1, 1));
    Some(SeenStage {
        off: [1e-3 * found[0][0], 1e-3 * found[1][0]],
        axes: Some(Axes {
            along: x_of_z,
            across: (-z_of_x.0, z_of_x.1),
            scale: [term(0, 1), term(1, 3)],
            tilt: [term(0, 2), term(1, 2)],
        }),
    })
}
