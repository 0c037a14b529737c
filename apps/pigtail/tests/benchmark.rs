//! The benchmark counts by the truth: what an algorithm says of itself does not help it.

use pigtail_control::job::FiberReport;
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use pigtail_evaluate::benchmark::{ALGORITHMS, Algorithm, Measured, run};
use pigtail_hal::{FiberHandling, Side};
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;

const SEED: u64 = 61_000;

fn setup() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig")
}

fn measure(algorithms: &[Algorithm], devices: u64) -> Measured {
    run(&setup(), algorithms, SEED, devices, &|_| ()).expect("the plant can be built")
}

fn named(name: &str) -> Algorithm {
    let found = ALGORITHMS.iter().find(|algorithm| algorithm.name == name);
    *found.expect("it is entered")
}

fn entry(run: fn(&mut Station, &Recipe) -> Vec<FiberReport>) -> Algorithm {
    Algorithm {
        name: "mine",
        about: "",
        run,
    }
}

fn report(port: &'static str, outcome: Outcome) -> FiberReport {
    FiberReport {
        port,
        side: Side::Left,
        outcome,
        shaking: None,
        dynamics: None,
        spread: None,
        spot: None,
        strokes: None,
        gains: Vec::new(),
        rests: None,
        place: None,
        phases: Vec::new(),
    }
}

#[test]
fn the_same_seed_gives_the_same_document_on_any_number_of_threads() {
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let measured = pool
            .expect("threads")
            .install(|| measure(&[named("fast"), named("spiral-nelder-mead")], 3));
        serde_json::to_string(&measured.document).expect("JSON")
    };
    let once = on(1);
    assert_eq!(once, on(3));
    // Nothing in it comes from a clock on the wall: it can be compared between machines.
    assert!(!once.contains("wall"));
}

#[test]
fn every_fiber_is_counted_once_and_the_fast_one_beats_the_baselines() {
    let entries = ["fast", "spiral-nelder-mead", "spiral-nine-point"].map(named);
    let measured = measure(&entries, 4);
    let rows = &measured.document.algorithms;
    for row in rows {
        let counted = row.right + row.wrong + row.touched + row.faults + row.lost;
        assert_eq!(counted, 12, "{}", row.name);
        assert_eq!(row.outcomes.values().sum::<u64>(), 12, "{}", row.name);
        assert!(row.right <= rows[0].right, "{}: {}", row.name, row.right);
    }
    // Both move for no longer than either does, and all of it is no more than the machine's time.
    for (row, seconds) in rows.iter().zip(&measured.seconds) {
        let arms = row.arms.expect("light was sampled");
        let (moving, idle) = (arms.moving_percent, arms.idle_percent);
        for (moving, idle) in [(moving.left, idle.left), (moving.right, idle.right)] {
            assert!((moving + idle - 100.0).abs() < 0.02, "{}", row.name);
            assert!(arms.both_moving_percent <= moving + 0.02, "{}", row.name);
            assert!(moving > 1.0 && idle > 1.0, "{}", row.name);
        }
        assert!(
            arms.seconds <= seconds.iter().sum::<f64>() * 3.0 + 0.01,
            "{}",
            row.name
        );
    }
    let seconds = |k: usize| rows[k].seconds_per_right_fiber.expect("right fibers");
    assert!(seconds(0) < seconds(1) && seconds(0) < seconds(2));
    // A photodiode is read at 500 Hz: nobody can have looked at more.
    for (row, seconds) in rows.iter().zip(&measured.seconds) {
        let all: f64 = seconds.iter().sum::<f64>() * 3.0;
        let readings = row.readings_per_right_fiber.expect("right fibers") * row.right as f64;
        assert!(
            readings > 0.0 && readings < 500.0 * all + 12.0,
            "{}",
            row.name
        );
    }
}

#[test]
fn who_only_says_so_is_wrong() {
    let liar = entry(|_, _| {
        ["input", "output1", "output2"]
            .map(|port| report(port, Outcome::Aligned))
            .to_vec()
    });
    let row = &measure(&[liar], 2).document.algorithms[0];
    assert_eq!((row.right, row.wrong, row.lost), (0, 6, 0));
    assert_eq!(row.seconds_per_right_fiber, None);
    assert_eq!(row.replay["wrong"], [SEED, SEED + 1]);
}

#[test]
fn who_says_nothing_has_lost_and_pays_for_the_time() {
    let silent = entry(|station, _| {
        let _ = station.run(3.0);
        Vec::new()
    });
    let measured = measure(&[silent], 1);
    let row = &measured.document.algorithms[0];
    assert_eq!((row.right, row.lost), (0, 3));
    assert_eq!(row.outcomes["no_report"], 3);
    assert!(
        (measured.seconds[0][0] - 1.0).abs() < 0.01,
        "{:?}",
        measured.seconds
    );
}

#[test]
fn who_drives_at_the_chip_is_stopped_and_counted_apart() {
    let reckless = entry(|station, recipe| {
        let drive = |station: &mut Station| -> Result<(), Halt> {
            station.handle_fiber(Side::Left, FiberHandling::Load(0))?;
            let [x, y, z] = recipe.ports.input;
            let chip = station
                .kinematics(Side::Left)
                .macro_from_chip(pigtail_model::frames::Point::new(x, y - 300e-6, z + 500e-6));
            station.line(Side::Left, chip, None)
        };
        let outcome = drive(station).map_or_else(Outcome::from, |()| Outcome::Aligned);
        vec![report("input", outcome)]
    });
    let row = &measure(&[reckless], 2).document.algorithms[0];
    assert_eq!((row.right, row.wrong, row.touched), (0, 0, 0));
    assert_eq!((row.faults, row.lost), (2, 4), "{:?}", row.outcomes);
}
