//! A station is a bench: what is true of every bench is true of it, with a guard and a recorder around it too.

use pigtail_control::calibration::{Hystereses, Windups};
use pigtail_hal::Bench;
use pigtail_machines::bench::Guard;
use pigtail_machines::bench::conformance::CHECKS;
use pigtail_machines::bench::record::Recorder;
use pigtail_session::Setup;

#[test]
fn what_is_true_of_every_bench_is_true_of_a_station() {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    // Without its windup tables and models of piezos it is one as well.
    let mut bare = setup.clone();
    bare.rig.calibration.windup = Windups::default();
    bare.rig.calibration.hysteresis = Hystereses::default();
    for (of, setup) in [("shipped", &setup), ("bare", &bare)] {
        for (what, check) in CHECKS {
            for seed in 60..62 {
                println!("{of}, seed {seed}: {what}");
                let checked = setup.experiment(seed, |station| {
                    check(station);
                    Ok(())
                });
                // A port that it has not is a fault of the machine.
                assert!(checked.is_ok(), "{checked:?}");
                let guarded = setup.experiment(seed, |station| {
                    let bench: &mut dyn Bench = station;
                    check(&mut Recorder::new(Guard::new(bench), std::io::sink()));
                    Ok(())
                });
                assert!(guarded.is_ok(), "{guarded:?}");
            }
        }
    }
}
