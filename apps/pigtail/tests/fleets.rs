//! Fleets and commissioning as a user meets them.

mod made;

use made::{answer, number, pigtail};
use std::fs;
use tempfile::TempDir;

#[test]
fn the_first_steps_of_commissioning_are_told() {
    let folder = TempDir::new().expect("a folder");
    let (json, code) = answer(folder.path(), &["commission", "--steps", "axes,dark"]);
    assert_eq!(code, 0, "{json}");
    assert_eq!(json["rig"], "afpm");
    assert_eq!(json["fleet"], "nominal");
    assert_eq!(json["seed"], 0);
    assert!(number(&json, "seconds_machine") > 1.0);
    let steps = json["steps"].as_array().expect("steps");
    let names: Vec<_> = steps.iter().map(|step| &step["name"]).collect();
    assert_eq!(names, ["axes", "dark"]);
    for step in steps {
        assert!(number(step, "seconds") > 0.0);
        assert_eq!(
            (&step["verdict"], &step["why"]),
            (&"passed".into(), &"".into())
        );
        assert!(
            step["values"]
                .as_object()
                .is_some_and(|values| values.len() >= 3)
        );
    }
    // No device was tried, and nothing was found that could be written.
    assert_eq!(json["accepted"], false);
    assert_eq!(json["calibration"], "");
    assert!(!json["unknown"].as_array().expect("words").is_empty());
    let report = json["report"].as_str().expect("a path");
    let html = fs::read_to_string(folder.path().join(report)).expect("a report");
    assert!(html.contains("axes") && html.contains("dark"));

    let (code, out, _) = pigtail(folder.path(), &["commission", "--steps", "dark"]);
    assert_eq!(code, Some(0));
    assert!(out.contains("Not tried on devices"), "{out}");
    let (code, _, error) = pigtail(folder.path(), &["commission", "--steps", "axis"]);
    assert_eq!(code, Some(2));
    assert!(
        error.contains(
            "axes, dark, gains, windup, geometry, piezos, dynamics, shaking, spread, spot, groups, acceptance"
        ),
        "{error}"
    );
}

/// The sensing fiber sees so little of this machine's dim laser that 8 nm of the left tip are lost in a photodiode's noise: by its light
/// alone nothing was told of it. By the light through both fibers it is. In truth micros make 15.6 nm of noise there, which the floor makes
/// 15.8 along x and 17.7 along y.
#[test]
fn a_pair_of_fibers_tells_how_both_tips_of_a_dim_machine_shake() {
    let folder = TempDir::new().expect("a folder");
    let arguments = [
        "commission",
        "--steps",
        "shaking",
        "--fleet",
        "workshop",
        "--seed",
        "107011",
    ];
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0, "{json}");
    let values = &json["steps"][0]["values"];
    for side in ["left", "right"] {
        let deviation = number(&values[side], "deviation_nm");
        assert!((12.0..22.0).contains(&deviation), "{values}");
        assert!(number(&values[side], "spread") < 0.15, "{values}");
        // What is left of means over a bond's time: nearly white.
        assert!(number(&values[side], "left") < 0.5, "{values}");
    }
}

/// On this machine what is scattered below the chip is more than the sensing fiber's photodiode sees at the laser's full power: the guard
/// stopped it at each device.
#[test]
fn a_laser_that_is_too_bright_for_the_sensing_fiber_is_lowered() {
    let folder = TempDir::new().expect("a folder");
    let arguments = [
        "commission",
        "--steps",
        "gains,shaking",
        "--fleet",
        "workshop",
    ];
    let (json, code) = answer(
        folder.path(),
        &[&arguments[..], &["--seed", "110058"]].concat(),
    );
    assert_eq!(code, 0, "{json}");
}

/// The stages of this machine stand askew by 0.6 and 0.9 degrees: what goes across goes so much along, which the guard took for a camera that
/// is wrong before anybody had measured it.
#[test]
fn a_stage_that_stands_askew_is_measured_and_not_stopped() {
    let folder = TempDir::new().expect("a folder");
    let arguments = [
        "commission",
        "--steps",
        "geometry",
        "--fleet",
        "harsh",
        "--seed",
        "8850010",
    ];
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0, "{json}");
    let yaw = &json["steps"][0]["values"]["left"]["yaw_deg"];
    assert!(yaw[0].as_f64().is_some_and(|yaw| yaw.abs() > 0.3), "{json}");
}

/// The left z-stage of this machine bears stiffer gains than the right one: under those that were found on it the other swung to and fro for
/// ever, however much gentler they were made, and all that came after failed. Those that are found on the right one suit both.
#[test]
fn gains_are_found_on_the_axis_that_does_not_come_to_rest() {
    let folder = TempDir::new().expect("a folder");
    let arguments = ["commission", "--steps", "gains", "--fleet", "workshop"];
    let (json, code) = answer(
        folder.path(),
        &[&arguments[..], &["--seed", "180097"]].concat(),
    );
    assert_eq!(code, 0, "{json}");
    let values = &json["steps"][0]["values"];
    assert_eq!(values["z"]["tuned_on"], "right.z", "{values}");
    for axis in ["left.z", "right.z"] {
        assert_eq!(values[axis]["settled"], true, "{values}");
        assert!(number(&values[axis], "swings") <= 6.0, "{values}");
    }
}

/// The micros of this machine swing at 49 to 56 Hz, circles go around at 42: a peak was seen a quarter of a turn askew and run after for ever.
/// Nobody could measure how they swing.
#[test]
#[ignore = "long: a machine commissioned"]
fn a_micro_that_swings_near_the_rate_of_circles_is_commissioned() {
    let (json, code) = commissioned("180095", "3");
    assert_eq!((code, &json["aligned"]), (0, &9.into()), "{json}");
}

/// A machine of `workshop`, commissioned, and so many devices on it.
fn commissioned(seed: &str, devices: &str) -> (serde_json::Value, i32) {
    let folder = TempDir::new().expect("a folder");
    let drawn = ["--fleet", "workshop", "--seed", seed, "--machines", "1"];
    let campaign = ["campaign", "--devices", devices, "--commissioned"];
    answer(folder.path(), &[&campaign[..], &drawn].concat())
}

/// A fiber whose macro goes 25 um aside before an inclined facet, with its micro as far back: what the piezos keep to themselves of that looked like a
/// way towards where the facet stands out, and the guard stopped it 21 um before the chip.
#[test]
#[ignore = "long: a machine commissioned"]
fn a_macro_that_goes_aside_before_an_inclined_facet_is_not_stopped() {
    let (json, code) = commissioned("117021", "3");
    assert_eq!((code, &json["aligned"]), (0, &9.into()), "{json}");
}

/// Vision sees this fiber 70 um beside the light that leads it, which is as far as it may be: on a circle of a micrometre it was in the light in one cycle
/// and before a facet that stands out in the next, and the guard stopped it 19 um before the chip.
#[test]
#[ignore = "long: a machine commissioned"]
fn a_fiber_at_the_edge_of_where_light_may_be_is_not_stopped_on_its_circle() {
    let (json, code) = commissioned("128012", "3");
    assert_eq!((code, &json["aligned"]), (0, &9.into()), "{json}");
}

/// A micro that is damped by 0.06, after a macro went 15 um with its load hidden by half of that: what was taken for the background was looked at
/// where the spot was not, with the tip swinging, and a twentieth of the spot's own light was in it. Widths were 4 % too small, and a gap was 2.3 um
/// off that was known to 0.3.
#[test]
#[ignore = "long: a machine commissioned"]
fn the_background_is_looked_at_beside_the_spot_and_at_rest() {
    let (json, code) = commissioned("130156", "2");
    assert_eq!((code, &json["aligned"]), (0, &6.into()), "{json}");
    let off = number(&json["offset_um"], "z_max");
    assert!(off < 1.0, "{off}");
}

/// Micros of 83 to 87 Hz, which swing along on circles of 42, and modes that are twice as wide in y as in x: each turn saw the peak twice as far away as
/// it was, went there, and saw it as far away on the other side, until it was given up after ten seconds.
#[test]
#[ignore = "long: a machine commissioned"]
fn a_circle_that_is_larger_than_told_learns_it() {
    let (json, code) = commissioned("130115", "3");
    assert_eq!((code, &json["aligned"]), (0, &9.into()), "{json}");
    assert_eq!(json["false_aligned"], 0);
}

/// Stages 0.5 degrees askew, modes of 6 um and ripples of 0.35 dB: where it is brightest lies 30 nm beside the peak, rms, and could be 60. What may be is
/// too much for a fiber to be believed; what is, is measured.
#[test]
#[ignore = "long: machines commissioned"]
fn what_ripples_do_on_stages_askew_is_measured_where_it_matters() {
    let folder = TempDir::new().expect("a folder");
    let fleet = r#"
        about = "stages askew, wide modes, ripples"
        [datasheet.guard]
        placement = "700 um"
        askew = "0.6 deg"
        [machine.placement.left]
        yaw = "0.5 deg"
        pitch = "0.5 deg"
        [machine.placement.right]
        yaw = "180.5 deg"
        pitch = "0.5 deg"
        [machine.device]
        mode_radius = ["6 um", "6 um"]
        [device.device]
        ripple_db = 0.35
    "#;
    fs::write(folder.path().join("askew.toml"), fleet).expect("a fleet");
    let drawn = ["--fleet", "askew.toml", "--seed", "7000", "--machines", "2"];
    let mut arguments = vec!["campaign", "--devices", "6", "--commissioned"];
    arguments.extend(drawn);
    let (json, _) = answer(folder.path(), &arguments);
    assert_eq!(json["false_aligned"], 0);
    let aligned = json["aligned"].as_u64().expect("a number");
    assert!(aligned >= 30, "{json}");
    // Where the light is brightest one of ten would be 0.05 um off.
    for axis in ["x_p90", "y_p90"] {
        let off = number(&json["offset_um"], axis);
        assert!(off < 0.04, "{axis}: {off}");
    }
}

/// With the camera of the thesis, which is good to 2 um, five gaps take up to two minutes a fiber; once it is known how light
/// spreads, two of them tell.
#[test]
#[ignore = "long: machines commissioned, ten thousand seconds of machine time"]
fn light_tells_the_gap_in_seconds_once_it_is_known_how_it_spreads() {
    let folder = TempDir::new().expect("a folder");
    let drawn = ["--fleet", "thesis", "--seed", "81000", "--machines", "3"];
    let mut arguments = vec!["campaign", "--devices", "3", "--commissioned"];
    arguments.extend(drawn);
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0, "{json}");
    assert_eq!(
        (&json["accepted"], &json["aligned"]),
        (&3.into(), &27.into())
    );
    let slowest = number(&json["seconds_per_fiber"], "max");
    assert!(slowest < 15.0, "{slowest}");
    // What was found is kept beside the runs: its calibration says how light spreads.
    let kept = folder.path().join("runs/commissioned");
    let mut found = 0;
    for machines in fs::read_dir(kept).expect("a folder").flatten() {
        for machine in fs::read_dir(machines.path()).expect("a folder").flatten() {
            let file = machine.path().join("calibration.toml");
            let text = fs::read_to_string(file).expect("a calibration");
            assert!(text.contains("[spread.left]") && text.contains("[spread.right]"));
            found += 1;
        }
    }
    assert_eq!(found, 3);
}

#[test]
fn a_campaign_has_machines_and_devices_of_a_fleet() {
    let folder = TempDir::new().expect("a folder");
    let of_fleet = ["--fleet", "thesis", "--machines", "2", "--devices", "2"];
    let mut arguments = vec!["campaign", "--seed", "70000"];
    arguments.extend(of_fleet);
    let (json, code) = answer(folder.path(), &arguments);
    assert!([0, 1].contains(&code), "{json}");
    assert_eq!(json["fleet"], "thesis");
    assert_eq!(
        (&json["machines"], &json["devices"]),
        (&2.into(), &4.into())
    );
    assert_eq!(json["fibers"], 12);
    assert_eq!(json["wrong"]["count"], 0);

    // A row of it again, by machine and device.
    let again = [
        "align", "--fleet", "thesis", "--seed", "70001", "--device", "1",
    ];
    let (by_device, _) = answer(folder.path(), &again);
    let (by_seed, _) = answer(
        folder.path(),
        &["align", "--fleet", "thesis", "--seed", "1000000070001"],
    );
    assert_eq!(by_device["seed"], 1_000_000_070_001_u64);
    assert_eq!(by_device["fibers"], by_seed["fibers"]);
}

#[test]
fn a_peak_that_moves_while_a_micro_comes_to_rest_is_followed() {
    let folder = TempDir::new().expect("a folder");
    // A micro of 121 Hz that rings, on a macro that still creeps by 1 um/s.
    let device = ["align", "--fleet", "workshop", "--seed", "4000000036083"];
    let (json, _) = answer(folder.path(), &device);
    for fiber in json["fibers"].as_array().expect("fibers") {
        let believed = fiber["outcome"] == "aligned";
        assert!(!believed || fiber["within_tolerance"] == true, "{fiber}");
    }
}

/// Micros of 63 and 70 Hz of which nobody has measured when they come to rest: at their resonance's side they go half as far again on a circle of 45 Hz as
/// they are told to, and 25 ms after it they swung by 0.1 um yet, which in so dim a light is not seen. Both fibers were attached 0.12 um off that were believed
/// to be within 0.04.
#[test]
fn a_micro_that_may_swing_unseen_is_waited_for() {
    let folder = TempDir::new().expect("a folder");
    for seed in ["80004851", "81000900"] {
        let device = ["align", "--fleet", "workshop", "--seed", seed];
        let (json, _) = answer(folder.path(), &device);
        for fiber in json["fibers"].as_array().expect("fibers") {
            let believed = fiber["outcome"] == "aligned";
            assert!(!believed || fiber["within_tolerance"] == true, "{fiber}");
        }
    }
}

/// Z-stages that the gains of the shipped rig set swinging by 2 um, as they do half of the machines of this fleet: the guard stopped both devices before the
/// chip, from which neither was nearer than 20 um.
#[test]
fn an_axis_that_swings_at_rest_is_held_by_gentler_gains_and_that_is_said() {
    let folder = TempDir::new().expect("a folder");
    for (seed, device) in [("912003", "0"), ("912006", "1")] {
        let device = [
            "align", "--fleet", "workshop", "--seed", seed, "--device", device,
        ];
        let (json, _) = answer(folder.path(), &device);
        assert_eq!(json["fault"], serde_json::Value::Null, "{json}");
        for axis in ["left.z", "right.z"] {
            let share = json["fibers"][0]["gentler_gains"][axis].as_f64();
            let share = share.expect("a share");
            assert!((0.1..1.0).contains(&share), "{axis} of {seed}: {share}");
        }
        let (_, text, _) = pigtail(folder.path(), &device);
        let said = "left.z swings at rest under the gains of its calibration";
        assert!(text.contains(said), "{text}");
    }
    let (json, _) = answer(folder.path(), &["align", "--seed", "912003"]);
    assert_eq!(json["fibers"][0].get("gentler_gains"), None);
}

/// Micros that the lines of a search have swing by more than a tenth of a millimetre, by 27 ms as they come: the input fibers hit the inclined facet, or the
/// guard stopped the machine, within the first lines.
#[test]
fn a_micro_that_swings_is_seen_from_afar_and_that_is_said() {
    let folder = TempDir::new().expect("a folder");
    let fleet = "about = \"micros that hardly come to rest\"\n\n\
                 [machine.micro]\nresonance = \"38 Hz\"\ndamping = 0.03\n";
    fs::write(folder.path().join("swings.toml"), fleet).expect("a fleet");
    let device = ["align", "--fleet", "swings.toml", "--seed", "7100"];
    let (json, _) = answer(folder.path(), &device);
    assert_eq!(json["fault"], serde_json::Value::Null, "{json}");
    assert_eq!(json["collision"], false);
    let input = &json["fibers"][0];
    assert_eq!(input["outcome"], "aligned", "{input}");
    assert_eq!(input["within_tolerance"], true, "{input}");
    let rests = input["micro_settling_s"].as_f64().expect("seconds");
    // Four time constants of it are 0.45 s.
    assert!((0.3..4.1).contains(&rests), "{rests}");
    let (_, text, _) = pigtail(folder.path(), &device);
    let said = "input: its micro swings for longer than is believed";
    assert!(text.contains(said), "{text}");
    let (json, _) = answer(folder.path(), &["align", "--seed", "7100"]);
    assert_eq!(json["fibers"][0].get("micro_settling_s"), None);
}

#[test]
fn a_fleet_that_is_not_there_is_refused_with_those_that_are() {
    let folder = TempDir::new().expect("a folder");
    for command in [
        &["align"][..],
        &["commission"],
        &["campaign", "--devices", "1"],
    ] {
        let mut arguments = command.to_vec();
        arguments.extend(["--fleet", "nosuch"]);
        let (code, out, error) = pigtail(folder.path(), &arguments);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{command:?}");
        for name in ["nosuch", "nominal", "thesis", "workshop", "harsh", "shift"] {
            assert!(error.contains(name), "no {name} in: {error}");
        }
        let left = fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(left, 0, "{command:?} leaves something behind");
    }
}
