//! Fig. 2.2: whether joints may be controlled as if each were alone.

use super::super::noted::{noted, since};
use super::super::picture::{Picture, Points, thin};
use super::super::{Bench, Figure};
use super::FIVE_BAR;
use pigtail_control::characterize::{Trace, record};
use pigtail_control::station::Station;
use pigtail_hal::quantity::Counts;
use pigtail_hal::{Axis, AxisName};
use pigtail_session::job::Ended;
use pigtail_session::tune::usual_step;

/// How long both joints are watched, seconds.
const SECONDS: f64 = 0.2;

/// A step of one joint while the other steps as well, and the other's motion while it is to stay where it is.
struct Stepped {
    own: Trace,
    other: Trace,
    /// Where the motor of the joint that steps really is at the end of each cycle of its step, counts: the encoder's whole counts
    /// would hide how little the other changes it.
    turned: Vec<f64>,
}

fn stepped(bench: &Bench, carried: f64) -> Result<Stepped, Ended> {
    let mut setup = bench.machine.clone();
    setup.plant.five_bar.carried = carried;
    let size = usual_step(FIVE_BAR.axis);
    let other = AxisName {
        axis: Axis::B,
        ..FIVE_BAR
    };
    let run = |station: &mut Station| {
        let Counts(home) = station.encoder(FIVE_BAR);
        let Counts(there) = station.encoder(other);
        station.reference(other, Counts(there + size));
        let begun = station.time();
        let own = record(station, FIVE_BAR, SECONDS, |_| size as f64, |_| true)?;
        station.reference(FIVE_BAR, Counts(home));
        station.reference(other, Counts(there));
        station.run(2.0 * SECONDS)?;
        station.reference(FIVE_BAR, Counts(home + size));
        let other = record(station, other, SECONDS, |_| 0.0, |_| true)?;
        Ok((own, other, begun))
    };
    let ((own, other, begun), cycles) = noted(&setup, bench.seed, FIVE_BAR, run)?;
    let count = setup.rig.spec.drive(FIVE_BAR.axis).count();
    let turned = since(&cycles, begun)
        .iter()
        .take(own.encoder.len())
        .map(|c| c.motor / count)
        .collect();
    Ok(Stepped { own, other, turned })
}

fn counts(trace: &Trace) -> Points {
    thin(
        trace
            .encoder
            .iter()
            .enumerate()
            .map(|(k, count)| ((k + 1) as f64 * trace.period * 1e3, *count)),
    )
}

pub(super) fn joints(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let (alone, coupled) = (stepped(bench, 0.0)?, stepped(bench, 1.0)?);
    let half = stepped(bench, 0.5)?;
    let size = usual_step(FIVE_BAR.axis) as f64;
    let most = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    let change = |with: &Stepped| {
        let pairs = alone.turned.iter().zip(&with.turned);
        most(&mut pairs.map(|(a, b)| a - b))
    };
    let changed = change(&coupled);
    let [before, after] = [&alone, &coupled].map(|s| most(&mut s.other.encoder.iter().copied()));
    Ok(vec![
        Figure::new("2.2", "Independent joint model")
            .picture(
                Picture::curves(
                    "time, ms",
                    "encoder of the joint that steps, counts",
                    [("alone", counts(&alone.own)), ("coupled", counts(&coupled.own))],
                )
                .x(0.0, 60.0)
                .caption("A step of one joint of the five-bar while the other steps as well, with and without the mass between them."),
            )
            .picture(
                Picture::curves(
                    "time, ms",
                    "encoder of the other joint, counts",
                    [
                        ("alone", counts(&alone.other)),
                        ("coupled", counts(&coupled.other)),
                    ],
                )
                .x(0.0, 60.0)
                .caption("The other joint, which is to stay where it is, meanwhile."),
            )
            .noted(
                "2.2-own",
                changed / size,
                format!(
                    "{changed:.2} counts of {size:.0} at most; {:.2} with half of that mass.",
                    change(&half)
                ),
            )
            .noted(
                "2.2-other",
                after / size,
                format!(
                    "{after:.0} counts; {before:.0} without any coupling. Friction holds a joint that rests."
                ),
            )
            .remark(
                "With all of the load's inertia as mass at the endpoint (`carried = 1`), where it couples most: \
                 what links and motors really weigh is not printed.",
            ),
    ])
}
