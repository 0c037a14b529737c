//! The fast procedure, scored against the truth, on machines that nothing was tuned with.

use pigtail_control::calibration::{Hystereses, Windups};
use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::Unobserved;
use pigtail_evaluate::align::{AlignmentDocument, align};
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::scenario::Scenario;
use pigtail_session::setup::Setup;

fn setup() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is well")
}

fn run(setup: &Setup, seed: u64) -> AlignmentDocument {
    align(setup, Procedure::Fast, seed, &mut Unobserved).expect("no fault")
}

/// Of every fiber its seconds; none is lost, none wrong.
fn all_are_aligned(seeds: std::ops::Range<u64>) -> Vec<f64> {
    let setup = setup();
    let mut seconds = Vec::new();
    for seed in seeds {
        let document = run(&setup, seed);
        assert!(document.is_success(), "seed {seed}: {document:#?}");
        seconds.extend(document.fibers.iter().map(|fiber| fiber.seconds));
    }
    seconds
}

#[test]
fn ten_devices_are_aligned() {
    assert_eq!(all_are_aligned(910_000..910_010).len(), 30);
}

/// Half of the fibers of two hundred devices within a second, nearly all of them with the first pass
/// of a search.
#[test]
#[ignore = "long: 200 devices"]
fn two_hundred_devices_are_aligned_in_a_second_a_fiber() {
    let mut seconds = all_are_aligned(910_000..910_200);
    seconds.sort_by(f64::total_cmp);
    let part = |share: f64| seconds[(share * seconds.len() as f64) as usize];
    let (median, nearly_all) = (part(0.5), part(0.995));
    // It was 2.7 until more was believed to be hidden of the way to the small circle.
    assert!(median < 0.9 && nearly_all < 3.3, "{median} {nearly_all}");
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let setup = setup();
    let text = |seed| serde_json::to_string(&run(&setup, seed)).expect("JSON");
    assert_eq!(text(42), text(42));
    assert_ne!(text(42), text(43));
}

/// Whatever is spoilt, a fiber is aligned or said not to be: never wrongly believed.
fn is_honest(spoil: impl Fn(&mut Setup), seeds: std::ops::Range<u64>) -> Vec<&'static str> {
    let mut setup = setup();
    spoil(&mut setup);
    let mut outcomes = Vec::new();
    for seed in seeds {
        let document = run(&setup, seed);
        assert!(!document.collision, "seed {seed}: {document:#?}");
        for fiber in &document.fibers {
            let believed = fiber.outcome == OutcomeCode::Aligned;
            assert!(
                !believed || fiber.within_tolerance == Some(true),
                "seed {seed}: {fiber:#?}"
            );
            outcomes.push(fiber.outcome.name());
        }
    }
    outcomes
}

#[test]
fn a_dark_laser_is_an_honest_no_light() {
    let outcomes = is_honest(|setup| setup.plant.light.full = 1e-9, 5..6);
    assert_eq!(outcomes, ["no_light", "not_attempted", "not_attempted"]);
}

#[test]
fn light_beyond_what_a_photodiode_reads_is_lowered() {
    const BRIGHT: f64 = 25.0;
    let mut lowered = setup();
    lowered.plant.light.full = BRIGHT;
    for seed in 5..8 {
        let document = run(&lowered, seed);
        assert!(document.is_success(), "seed {seed}: {document:#?}");
    }
    // A laser that is on or off cannot be: the guard stops before a peak without a top is believed.
    let outcomes = is_honest(
        |setup| {
            setup.plant.light.full = BRIGHT;
            setup.rig.spec.laser = pigtail_hal::spec::LaserSpec::default();
        },
        5..7,
    );
    assert!(outcomes.contains(&"fault"), "{outcomes:?}");
}

#[test]
fn an_output_that_is_not_there_does_not_keep_the_other_from_being_aligned() {
    let outcomes = is_honest(|setup| setup.plant.device.outputs[1][1] -= 600e-6, 11..12);
    assert_eq!(outcomes, ["aligned", "aligned", "no_light"]);
}

#[test]
fn three_times_the_noise_is_measured_and_lived_with() {
    let outcomes = is_honest(|setup| setup.plant.light.noise *= 3.0, 911_000..911_010);
    // Whether a tip shakes such light tells less well: every third input may stay unsure, and with it its device.
    let aligned = outcomes
        .iter()
        .filter(|outcome| **outcome == "aligned")
        .count();
    assert!(aligned >= 15, "{outcomes:?}");
}

/// Without a model of the piezos the circles do not close: then the thesis's way is left.
#[test]
fn a_rig_that_was_never_calibrated_is_aligned_all_the_same() {
    let spoil = |setup: &mut Setup| {
        setup.rig.calibration.hysteresis = Hystereses::default();
        setup.rig.calibration.windup = Windups::default();
    };
    let outcomes = is_honest(spoil, 912_000..912_003);
    // One input of ten is not surely where it should be, and with it its device is not: of 120 fibers from here on 108 are aligned.
    let aligned = outcomes
        .iter()
        .filter(|outcome| **outcome == "aligned")
        .count();
    assert!(aligned >= 6, "{outcomes:?}");
}

/// Devices that were once hit while a fiber was changed, its holder aside where the facet stands out;
/// and one that was left too far away by what vision only came to know at the end.
#[test]
fn what_once_went_wrong_goes_well() {
    let scenario = |scenario: Scenario| move |setup: &mut Setup| scenario.apply(setup);
    is_honest(scenario(Scenario::Uncertain), 881_124..881_125);
    is_honest(scenario(Scenario::Turn), 880_496..880_497);
}

/// Where a device lets through a tenth of the light the sensing fiber sees too little of it: a fiber took 30 to 230 s by that, and six of ten were
/// lost. By the light of an output's fiber, which comes meanwhile, an input is aligned in 11 to 17 s.
#[test]
fn a_dim_input_waits_for_the_light_of_an_output() {
    let mut setup = setup();
    Scenario::Weak.apply(&mut setup);
    let documents: Vec<_> = (42_001..42_006).map(|seed| run(&setup, seed)).collect();
    let mut waited = 0;
    for document in &documents {
        assert!(document.is_success(), "{document:#?}");
        let input = &document.fibers[0];
        // Near the chip it waits, and then goes on.
        let ways = input.phases.iter().filter(|phase| phase.name == "approach");
        waited += u32::from(ways.count() == 2 && input.seconds < 25.0);
    }
    // Of 150 such inputs one in four is not found on lines, or is lost.
    assert!(waited >= 4, "{documents:#?}");
}

/// A side lobe is a peak too, and a dim one: by no light is it taken for the other.
#[test]
fn a_side_lobe_of_little_light_is_not_believed() {
    let dim = |setup: &mut Setup| {
        Scenario::Weak.apply(setup);
        Scenario::SideLobe.apply(setup);
    };
    let outcomes = is_honest(dim, 42_001..42_007);
    let aligned = outcomes.iter().filter(|o| **o == "aligned").count();
    assert!(aligned >= 9, "{outcomes:?}");
}

/// What no camera sees may be off by more than a search goes up and down at first, and what one sees by more than a micro reaches.
#[test]
fn light_is_found_beyond_where_it_was_believed_to_be() {
    let outcomes = is_honest(|setup| Scenario::Uncertain.apply(setup), 43_000..43_006);
    let aligned = outcomes.iter().filter(|o| **o == "aligned").count();
    assert!(aligned >= 9, "{outcomes:?}");
}

/// A truth that labs have, and that nobody told control of.
type Truth = (&'static str, fn(&mut Setup));

/// With the belief as it ships: what is different is slower, swings on, winds up more, stands elsewhere, or
/// comes with light that fluctuates. A home that is 100 um off is not among them: the guard stops every tenth of
/// such machines, since a camera that is wrong looks the same.
const TRUTHS: [Truth; 9] = [
    ("a slow micro", |setup| setup.plant.micro.resonance = 100.0),
    ("a micro that swings", |setup| {
        setup.plant.micro.damping = 0.05;
    }),
    ("one that swings on", |setup| {
        setup.plant.micro.damping = 0.02;
    }),
    ("tips that shake", |setup| setup.plant.micro.noise = 10e-9),
    ("friction", |setup| setup.plant.variation.friction = 0.3),
    ("links", |setup| setup.plant.variation.links = 0.005),
    ("home", |setup| setup.plant.misplacement.home = 60e-6),
    ("scattered light", |setup| {
        setup.plant.scatter.fluctuation = 0.3;
    }),
    ("several at once", |setup| {
        setup.plant.micro.resonance = 130.0;
        setup.plant.micro.damping = 0.1;
        setup.plant.micro.noise = 8e-9;
        setup.plant.variation.friction = 0.2;
        setup.plant.variation.links = 0.003;
        setup.plant.misplacement.home = 50e-6;
        setup.plant.scatter.fluctuation = 0.2;
    }),
];

/// None is wrongly believed, none touched; and so many in a hundred are aligned.
fn other_truths(devices: u64, least: usize) {
    for (k, (name, truth)) in TRUTHS.iter().enumerate() {
        let from = 920_000 + 10_000 * k as u64;
        let outcomes = is_honest(truth, from..from + devices);
        let aligned = outcomes.iter().filter(|name| **name == "aligned").count();
        assert!(
            100 * aligned >= least * outcomes.len(),
            "{name}: {aligned} of {}: {outcomes:?}",
            outcomes.len()
        );
    }
}

#[test]
fn a_machine_that_is_not_as_believed_is_not_believed_wrongly() {
    // Twelve fibers a truth: an input that is unsure takes three of them away.
    other_truths(4, 60);
}

#[test]
#[ignore = "long: 540 devices"]
fn many_machines_that_are_not_as_believed_are_not_believed_wrongly() {
    other_truths(60, 90);
}

/// Where vision's bound is as wide as the tolerance, the light tells the gap...
#[test]
fn a_gap_that_vision_does_not_know_is_told_by_light() {
    let outcomes = is_honest(|setup| setup.rig.spec.vision.accuracy_z = 2e-6, 5..9);
    let aligned = outcomes
        .iter()
        .filter(|outcome| **outcome == "aligned")
        .count();
    assert!(aligned >= 9, "{outcomes:?}");
}

/// ...and where that is too dim for it, nobody does.
#[test]
fn a_gap_that_nobody_knows_is_unsure() {
    let dim = |setup: &mut Setup| {
        setup.rig.spec.vision.accuracy_z = 2e-6;
        setup.plant.light.full = 0.15;
    };
    let outcomes = is_honest(dim, 5..8);
    assert!(outcomes.contains(&"unsure"), "{outcomes:?}");
}

/// A tip that shakes so much that where it is attached is left to chance is not attached: by a bond that freezes in an
/// instant.
#[test]
fn a_tip_that_shakes_too_much_is_unsure() {
    let shakes = |setup: &mut Setup| {
        setup.plant.micro.noise = 40e-9;
        setup.plant.bond.time = 0.0;
        setup.rig.spec.bond.time = 0.0;
    };
    let outcomes = is_honest(shakes, 930_000..930_006);
    assert!(
        outcomes.iter().all(|outcome| *outcome != "aligned"),
        "{outcomes:?}"
    );
}

/// Over as long as a bond takes to set, such shaking averages out.
#[test]
fn what_shakes_faster_than_a_bond_sets_is_no_matter() {
    let outcomes = is_honest(|setup| setup.plant.micro.noise = 30e-9, 930_000..930_006);
    let aligned = outcomes.iter().filter(|o| **o == "aligned").count();
    assert!(aligned >= 15, "{outcomes:?}");
}

/// Piezos that differ from what is believed of them by up to 30 %, each by itself: a circle is an ellipse along them then, which was
/// taken for a peak of another shape and refused. The light on the circles teaches their strokes.
#[test]
fn piezos_of_other_strokes_are_learned_while_they_align() {
    let learns = |learn: bool| {
        let mut setup = setup();
        setup.plant.variation.micro_gain = 0.3;
        setup.rig.recipe.fast.conical_scan.learn = learn;
        let documents = (935_000..935_008).map(move |seed| run(&setup, seed));
        documents.collect::<Vec<_>>()
    };
    let documents = learns(true);
    let fibers = || documents.iter().flat_map(|document| &document.fibers);
    assert!(documents.iter().all(AlignmentDocument::is_success));
    assert!(fibers().any(|fiber| fiber.micro_strokes.is_some()));
    let seconds = fibers().map(|fiber| fiber.seconds);
    let without: f64 = learns(false)
        .iter()
        .flat_map(|document| &document.fibers)
        .map(|fiber| fiber.seconds)
        .sum();
    let with: f64 = seconds.sum();
    assert!(with < 0.3 * without, "{with} s and {without} s");
}
