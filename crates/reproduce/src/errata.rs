//! Where the thesis slips: the page of the book, and what is computed to check it.

use pigtail_control::methods::{Method, Space};
use pigtail_hal::Axis;
use pigtail_session::setup::Setup;
use std::f64::consts::TAU;

/// The page of the book, from which the report takes its section.
const PAGE: &str = include_str!("../../../book/src/errata.md");

/// A slip.
#[derive(Debug, Clone, PartialEq)]
pub struct Erratum {
    /// Where, and what about.
    pub title: String,
    /// What is printed.
    pub printed: String,
    /// What is wrong with it.
    pub argument: String,
    /// What was computed to check it; empty where there is nothing to compute.
    pub computed: String,
}

/// All of them, checked with what a rig's datasheet and a recipe say.
pub fn all(setup: &Setup) -> Vec<Erratum> {
    PAGE.split("\n## ")
        .skip(1)
        .map(|section| one(section, setup))
        .collect()
}

/// A section of the page: its title, a check, a quotation, paragraphs.
fn one(section: &str, setup: &Setup) -> Erratum {
    let (title, rest) = section.split_once('\n').unwrap_or((section, ""));
    let (mut printed, mut argument, mut computed) = (Vec::new(), Vec::new(), String::new());
    for line in rest.lines() {
        let key = line
            .strip_prefix("<!-- check: ")
            .and_then(|key| key.strip_suffix(" -->"));
        if let Some(key) = key {
            computed = check(key, setup).unwrap_or_default();
        } else if let Some(quoted) = line.strip_prefix("> ") {
            printed.push(quoted);
        } else if !line.is_empty() {
            argument.push(line);
        }
    }
    Erratum {
        title: title.to_owned(),
        printed: printed.join(" "),
        argument: argument.join(" "),
        computed,
    }
}

/// What is computed for a slip; `None` for one that is not known.
fn check(key: &str, setup: &Setup) -> Option<String> {
    let rate = setup.rig.spec.photodiode.rate;
    let one = Space::new(Method::MacroRaster, &setup.rig.recipe);
    let coarse = Space {
        mesh: 2.0 * one.mesh,
        ..one
    };
    let three = Space::new(Method::Multimode, &setup.rig.recipe).closed_form();
    let initiation = three + three / 3.0;
    let minutes = |seconds: f64| seconds / 60.0;
    Some(match key {
        "order" => format!(
            "100 um over 15 um is {:.1}, 120 um over 30 um {:.1}, 120 um over 15 um {:.1}.",
            100.0 / 15.0,
            120.0 / 30.0,
            120.0 / 15.0
        ),
        "subscripts" => {
            // A load at 100 um, wound up by 50 um: the encoder says 150 um.
            let (load, windup) = (100.0, 50.0);
            let input = load + windup;
            format!(
                "A load at {load} um behind a windup of {windup} um has its input at {input} um; the \
                 printed form makes {} um of that load.",
                load - windup
            )
        }
        "twelve" => {
            let [a, b, c] = [125.0 / 10.0, 140.0 / 20.0, 140.0 / 10.0];
            format!("125/10 = {a:.1}, 140/20 = {b:.1}, 140/10 = {c:.1}.")
        }
        "placement" => {
            let wide = Space {
                method: Method::Multimode,
                x: 2.0 * one.x,
                ..one
            };
            format!(
                "By (3.5) at the photodiode's rate: {:.1} s for 100 um by 200 um, {:.1} s for 200 um by \
                 200 um.",
                Space {
                    method: Method::Multimode,
                    ..one
                }
                .photodiode_limited(rate),
                wide.photodiode_limited(rate)
            )
        }
        "forms" => format!(
            "At 5 um: {:.1} and {:.1} minutes. At 10 um: {:.1} and {:.1} minutes, the photodiode allowing \
             {:.1} Hz.",
            minutes(one.closed_form()),
            minutes(one.photodiode_limited(rate)),
            minutes(coarse.closed_form()),
            minutes(coarse.photodiode_limited(rate)),
            coarse.fastest(rate)
        ),
        "coupling" => format!("{three:.1} s + {three:.1} s / 3 = {initiation:.2} s."),
        "period" => {
            let [ten, nine] = [10.0, 9.0].map(|n| 1.0 / (n * 4e-3));
            format!("1/(10 x 4 ms) = {ten:.1} Hz, 1/(9 x 4 ms) = {nine:.1} Hz.")
        }
        "init" => {
            let better = three / 10.0 + three / 3.0;
            format!(
                "{three:.1} s / 10 + {three:.1} s / 3 = {better:.2} s, and with the 2.5 s of maximization \
                 {:.1} s.",
                better + 2.5
            )
        }
        "improvement" => {
            let times: f64 = 21.7 / 3.2;
            format!(
                "21.7/3.2 = {times:.2}: {:.0} % faster, {:.0} % less time.",
                100.0 * (times - 1.0),
                100.0 * (1.0 - 1.0 / times)
            )
        }
        "range" => format!(
            "70 um x sqrt(2) = {:.0} um, 50 um x sqrt(2) = {:.0} um.",
            70.0 * 2_f64.sqrt(),
            50.0 * 2_f64.sqrt()
        ),
        "spatial" => format!("1/(2 x 5 V) = {} a volt.", 1.0 / 10.0),
        "coulomb" => {
            let friction = &setup.plant.z_stage.joint.motor_friction;
            let ratio = friction.coulomb() / friction.static_level();
            format!("On this rig's z 12.5 fcm are {:.1} fsm.", 12.5 * ratio)
        }
        "count" => {
            let drive = setup.rig.spec.drive(Axis::Z);
            let count = drive.count();
            let um = 1e6 * count / drive.gear_ratio * setup.rig.calibration.geometry.z.lead / TAU;
            format!(
                "2 pi/2048 = {count:.2e} rad, {um:.3} um of z; a tenth is {:.2e} rad.",
                0.1 * count
            )
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};

    #[test]
    fn every_slip_has_what_is_printed_an_argument_and_the_check_that_it_names() {
        let setup = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig");
        let all = all(&setup);
        assert_eq!(all.len(), PAGE.matches("\n## ").count());
        assert!(all.len() >= 12);
        for e in &all {
            assert!(!e.printed.is_empty() && !e.argument.is_empty(), "{e:?}");
        }
        let checks = all.iter().filter(|e| !e.computed.is_empty()).count();
        assert_eq!(checks, PAGE.matches("<!-- check: ").count());
    }
}
