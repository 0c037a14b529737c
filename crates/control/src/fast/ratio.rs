//! How far a micro goes in y for a displacement in x, which no camera sees: the macro goes aside and up by some
//! micrometres, circles follow the peak with the micro, and what the one has gone, the other has made up for.

use super::Shared;
use super::approach_moves::Aim;
use super::centre::hand_over;
use super::gap::to_middle;
use super::pair::roughly;
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::job::FiberReport;
use crate::outcome::{Halt, Outcome};
use crate::recipe::Recipe;
use crate::station::Station;
use crate::tuning::TUNING;
use nalgebra::SVector;
use pigtail_hal::Side;
use pigtail_hal::spec::SIDES;
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::Normal;

/// What was measured of a micro.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    /// Displacement in y for one in x.
    pub ratio: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// By how much farther it goes in x than its model says: by the macro, where the model is the camera's.
    pub scale: f64,
}

/// What was measured so far, indexed by side.
#[derive(Debug, Default)]
pub(super) struct Ratios([Option<Ratio>; SIDES]);

/// Aligns a device, and measures on the way how far both micros go in y for a displacement in x, indexed by side: what is
/// found is believed at once. `None` where light was not found, which the reports tell.
pub fn measure_ratios(
    station: &mut Station,
    recipe: &Recipe,
) -> ([Option<Ratio>; SIDES], Vec<FiberReport>) {
    let recipe = roughly(recipe);
    let mut shared = Shared::new(&recipe);
    shared.ratios = Some(Ratios::default());
    let cell = AlignmentCell::over(station);
    let reports = cell.run(shared.align(&cell));
    let Ratios(found) = shared.ratios.unwrap_or_default();
    (found, reports)
}

impl Ratios {
    /// Measures the micro of a side that circles its peak, if that has not been done.
    pub(super) async fn measure(
        &mut self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> Result<(), Halt> {
        let side = aim.side;
        let Self(known) = self;
        let known = &mut known[side.index()];
        let Some(believed) = cell
            .voltage(|machine| machine.micro_ratio(side))
            .flatten()
            .filter(|_| known.is_none())
        else {
            return Ok(());
        };
        // Where the micro goes as far as it can there is no room for another ratio.
        let gap = aim.gap(cell);
        to_middle(cell, aim, scan, gap).await?;
        let found = follow(cell, side, scan, gap, believed).await?;
        *known = Some(found);
        // The micro goes on from where it is.
        let at = scan.place(gap);
        let by = at.y * (1.0 - found.ratio / believed);
        cell.voltage(|machine| machine.set_micro_ratio(side, found.ratio));
        scan.hand_over(Displacement::new(0.0, by));
        let near = TUNING.circle.centred * scan.beam_width(gap);
        scan.centre(cell, gap, near, "ratio", 1).await?;
        Ok(())
    }
}

/// Where the macro stands, by probes at its outputs where there are some.
fn stands(cell: &AlignmentCell<'_>, side: Side) -> Displacement {
    let probed = cell.voltage(|machine| machine.probed_endpoint(side));
    let endpoint = probed.flatten().unwrap_or_else(|| cell.endpoint(side));
    endpoint.across()
}

async fn follow(
    cell: &AlignmentCell<'_>,
    side: Side,
    scan: &mut ConicalScan<'_>,
    gap: f64,
    believed: f64,
) -> Result<Ratio, Halt> {
    // So that the micro comes nearer to its middle.
    let at = scan.place(gap);
    let (x, y) = (
        TUNING.reach.way.copysign(at.x),
        TUNING.reach.way.copysign(at.y),
    );
    let around = [(0.0, y), (x, 0.0), (0.0, -y), (-x, 0.0)];
    // Where the micro has its peak: a place, a drift, and what it makes up for of each way of the macro.
    let mut normal: [Normal<4>; 2] = Default::default();
    let mut seen: Vec<(SVector<f64, 4>, Displacement)> =
        Vec::with_capacity(4 * TUNING.reach.rounds * TUNING.reach.turns);
    let near = TUNING.circle.centred * scan.beam_width(gap);
    let (begin, start) = (cell.now(), stands(cell, side));
    for _ in 0..TUNING.reach.rounds {
        for (x, y) in around {
            let step = Displacement::new(x, y) / f64::from(TUNING.reach.way_steps);
            for _ in 0..TUNING.reach.way_steps {
                hand_over(cell, scan, side, step, gap).await?;
                if let Some(peak) = scan.peak() {
                    scan.go_to(cell, &peak, gap)?;
                }
            }
            scan.centre(cell, gap, near, "ratio", 2).await?;
            for _ in 0..TUNING.reach.turns {
                scan.turn(cell, gap).await?;
                let Some(peak) = scan.peak() else {
                    continue;
                };
                let by = (stands(cell, side) - start) / TUNING.reach.way;
                let row = SVector::from([1.0, cell.now() - begin, by.x, by.y]);
                normal[0].add(&row, peak.at.x / TUNING.reach.way);
                normal[1].add(&row, peak.at.y / TUNING.reach.way);
                seen.push((row, peak.at / TUNING.reach.way));
                scan.go_to(cell, &peak, gap)?;
            }
        }
    }
    let unsure = |deviation| Outcome::Unsure {
        deviation,
        accuracy: near,
    };
    let (Some(in_x), Some(in_y)) = (normal[0].solve(), normal[1].solve()) else {
        return Err(unsure(f64::INFINITY).into());
    };
    let free = seen.len() as f64 - 4.0;
    let squares: f64 = seen
        .iter()
        .map(|(row, at)| (at.y - row.dot(&in_y)).powi(2))
        .sum();
    let inverse = normal[1].matrix.try_inverse();
    let deviation = inverse.map_or(f64::INFINITY, |inverse| {
        (squares / free * inverse[(3, 3)]).sqrt()
    });
    let (made_up_x, made_up_y) = (-in_x[2], -in_y[3]);
    let ratio = believed / made_up_y;
    if !(ratio > 0.5 && ratio < 2.0 && deviation.is_finite()) {
        return Err(unsure(TUNING.reach.way * deviation).into());
    }
    Ok(Ratio {
        ratio,
        deviation: ratio * deviation / made_up_y,
        scale: 1.0 / made_up_x,
    })
}
