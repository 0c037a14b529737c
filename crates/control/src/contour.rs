//! Closed contours in the plane of a five-bar: how truly both joints together keep to a path
//! (thesis 2.4.5, Figs. 2.21-2.23).

use crate::outcome::{Halt, Lack, Outcome};
use crate::station::{Station, VoltageMachine};
use crate::trajectory::Arc;
use pigtail_hal::Side;
use pigtail_model::frames::{Macro, Point};
use serde::{Deserialize, Serialize};

/// A contour around home.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contour {
    /// With its sides along x and y.
    Square,
    /// By one arc.
    Circle,
}

/// Where the endpoint was wanted and where its output probes saw it, in one servo cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourSample {
    /// Where it was wanted.
    pub wanted: Point<Macro>,
    /// Where the probes saw it.
    pub measured: Point<Macro>,
}

/// Follows a contour of side or diameter `size` (m) at `speed` (m/s), `laps` times without a pause,
/// and notes the last lap. The first laps bring the transmissions into the state in which they stay.
///
/// # Errors
///
/// A fault; [`Outcome::Refused`] when it leaves the workspace; [`Outcome::Lacking`] on a rig without
/// probes.
pub fn follow(
    station: &mut Station,
    side: Side,
    contour: Contour,
    size: f64,
    speed: f64,
    laps: u32,
) -> Result<Vec<ContourSample>, Halt> {
    let half = 0.5 * size;
    let start = match contour {
        Contour::Square => Point::new(-half, -half, 0.0),
        Contour::Circle => Point::new(half, 0.0, 0.0),
    };
    station.line(side, start, Some(speed))?;
    let mut samples = Vec::new();
    for lap in 1..=laps {
        let mut log = |station: &mut Station| -> Result<(), Halt> {
            while station.moving(side) {
                station.cycle()?;
                if lap == laps {
                    let measured = station
                        .probed_endpoint(side)
                        .ok_or(Outcome::Lacking(Lack::Probes))?;
                    let wanted = station.wanted(side);
                    samples.push(ContourSample { wanted, measured });
                }
            }
            Ok(())
        };
        match contour {
            Contour::Square => {
                for (x, y) in [(half, -half), (half, half), (-half, half), (-half, -half)] {
                    station.start_line(side, Point::new(x, y, 0.0), Some(speed))?;
                    log(station)?;
                }
            }
            Contour::Circle => {
                let arc = Arc::about(station.wanted(side), [0.0, 0.0], std::f64::consts::TAU, 0.0);
                station.start_arc(side, arc, Some(speed))?;
                log(station)?;
            }
        }
    }
    Ok(samples)
}

/// A raster around home by the macro alone, as method 1 is printed (thesis 3.2.1): lines across of `width` (m), back and
/// forth at `speed` (m/s), each `rise` (m) above the last, up to `height` (m), twice; the second is noted.
///
/// # Errors
///
/// As [`follow`].
pub fn raster(
    station: &mut Station,
    side: Side,
    [width, height, rise]: [f64; 3],
    speed: f64,
) -> Result<Vec<ContourSample>, Halt> {
    let (across, up) = (0.5 * width, 0.5 * height);
    let mut samples = Vec::new();
    for noted in [false, true] {
        station.line(side, Point::new(-across, -up, 0.0), Some(speed))?;
        let lines = (height / rise).round() as usize;
        for line in 1..=lines {
            let x = if line % 2 == 1 { across } else { -across };
            let y = rise * line as f64 - up;
            station.start_line(side, Point::new(x, y, 0.0), Some(speed))?;
            while station.moving(side) {
                station.cycle()?;
                if noted {
                    let measured = station
                        .probed_endpoint(side)
                        .ok_or(Outcome::Lacking(Lack::Probes))?;
                    let wanted = station.wanted(side);
                    samples.push(ContourSample { wanted, measured });
                }
            }
        }
    }
    Ok(samples)
}

/// How far a contour was from where it was wanted, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContourErrors {
    /// Mean displacement of the whole contour along x and y.
    pub shift: [f64; 2],
    /// Greatest distance from where the endpoint was wanted, that displacement apart.
    pub greatest: f64,
    /// Root mean square of that distance.
    pub rms: f64,
}

/// How truly a contour was followed. A displacement of the whole is told apart: where home is, is
/// not for a transmission to know.
pub fn errors(samples: &[ContourSample]) -> ContourErrors {
    let n = samples.len().max(1) as f64;
    let off = |s: &ContourSample| [s.measured.x - s.wanted.x, s.measured.y - s.wanted.y];
    let mut shift = [0.0; 2];
    for s in samples {
        let [x, y] = off(s);
        shift = [shift[0] + x / n, shift[1] + y / n];
    }
    let distances = samples.iter().map(|s| {
        let [x, y] = off(s);
        (x - shift[0]).hypot(y - shift[1])
    });
    let (greatest, squares) = distances.fold((0.0_f64, 0.0), |(most, squares), d| {
        (most.max(d), squares + d * d)
    });
    ContourErrors {
        shift,
        greatest,
        rms: (squares / n).sqrt(),
    }
}
