//! Jobs that are recorded, and done again from their records.

use pigtail_control::contour::Contour;
use pigtail_control::identify::Path;
use pigtail_control::impulse::{Impulses, Relax, Shape as PulseShape};
use pigtail_control::maximization::{Disturbance, Means, Trial};
use pigtail_control::station::Unobserved;
use pigtail_control::trajectory::Shape;
use pigtail_hal::{Axis, AxisName, Side};
use pigtail_model::windup::{Reversal, Windup};
use pigtail_session::Setup;
use pigtail_session::contour::FollowContour;
use pigtail_session::follow::Follow;
use pigtail_session::identify::ScanWindup;
use pigtail_session::job::{Ended, Job, Labelled};
use pigtail_session::pulses::{Amplitude, BreakAway, LeastPulse, PlayPulses};
use pigtail_session::records::{Records, records_in};
use pigtail_session::replay::replay;
use std::sync::Arc;

const Z: AxisName = AxisName {
    side: Side::Right,
    axis: Axis::Z,
};

fn run<J: Job>(setup: &Setup, label: &str, job: J) -> Result<J::Output, Ended> {
    let label = label.to_owned();
    setup.run(&Labelled { label, job }, 91, &mut Unobserved)
}

#[test]
fn what_experiments_are_made_of_is_done_again_from_its_record() -> Result<(), anyhow::Error> {
    let folder = tempfile::tempdir()?;
    let mut setup = Setup::load("afpm", "y-branch")?;
    setup.records = Some(Arc::new(Records::new(folder.path().to_owned())));
    // Numbers that no decimal ends: a record must keep their last bits.
    let third = 1.0 / 3.0;
    let unit = run(&setup, "break-away", BreakAway { at: Z, rest: 0.02 })?;
    let impulses = Impulses {
        at: Z,
        relax: Relax::Dither {
            amplitude: 4.5 * unit,
        },
        rest: 0.02,
        readings: 25,
    };
    let shape = PulseShape {
        fixed: [third * unit, 0.0, 0.0],
        period: 1e-3,
    };
    let pulses = (1..4).map(|k| shape.pulse(third * unit * f64::from(k), k % 2 == 0));
    let pulses = pulses.collect();
    run(&setup, "play", PlayPulses { impulses, pulses })?;
    let least = LeastPulse {
        impulses,
        shape,
        of: Amplitude::First,
        most: 5.0 * unit,
    };
    run(&setup, "least", least)?;
    let path = Path::identification(third * 1e-2, third * 1e-2);
    let at = AxisName { axis: Axis::A, ..Z };
    run(&setup, "scan", ScanWindup { at, path })?;
    let windup = Windup::Reversal(Reversal {
        maximum: third * 1e-5,
        way: third * 1e-4,
    });
    let contour = FollowContour {
        side: Side::Left,
        contour: Contour::Square,
        size: third * 1e-3,
        speed: 2e-3,
        shape: Shape::SCurve,
        laps: 2,
        windup: [windup, Windup::None],
    };
    run(&setup, "contour", contour)?;
    let trial = Trial {
        means: Means::NinePoint(setup.rig.recipe.climb),
        disturbance: Disturbance::Macro(third * 1e-6),
        begin: 90.0,
        seconds: third,
    };
    run(&setup, "follow", Follow { trial })?;
    setup.records.as_ref().expect("set above").wait()?;

    let records = records_in(folder.path());
    assert_eq!(records.len(), 6, "{records:?}");
    for record in records {
        let again = replay(&record)?;
        assert!(again.same && !again.cut, "{again:?}");
        assert!(again.exchanges > 100, "{again:?}");
    }
    Ok(())
}
