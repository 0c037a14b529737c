//! Windup loops and contours against what the thesis found (2.4), on machines that nothing was tuned
//! with.

use pigtail_control::contour::Contour;
use pigtail_control::trajectory::Shape;
use pigtail_evaluate::contour::{Plan, trace};
use pigtail_evaluate::loops;
use pigtail_hal::Side;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;

fn setup() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is well")
}

/// Figs. 2.8-2.10 and 2.13: 100 um of windup, less with less friction, ten times less with none,
/// half with a preload above the load's friction. Friction varies by a tenth from machine to
/// machine.
#[test]
#[ignore = "long: fourteen machines"]
fn windup_goes_with_load_friction_and_against_preload() {
    let at = "fivebar".parse().expect("an axis");
    for seed in 760..762 {
        let (d, _) = loops::windup(&setup(), at, seed).expect("no fault");
        let of = |name: &str| {
            let case = d.cases.iter().find(|case| case.name.contains(name));
            case.unwrap_or_else(|| panic!("no {name}"))
        };
        let plain = of("as it is").windup_um;
        assert!((80.0..125.0).contains(&plain), "{plain}");
        let half = of("0.5 x load friction").windup_um;
        assert!(
            half < 0.8 * plain && half > 0.4 * plain,
            "{half} of {plain}"
        );
        assert!(of("0.05 x load friction").windup_um < 0.15 * plain);
        assert!(of("no load friction").windup_um.abs() < 0.1 * plain);
        let share = of("preload of 1.2").windup_um / plain;
        assert!((0.35..0.65).contains(&share), "{share}");
        // (2.20) is the curve of one law and not of the other; the thesis's fit stayed within
        // 10 um.
        let curved = of("maxwell-slip").largest_residual_um.expect("a fit");
        let straight = of("coulomb-presliding").largest_residual_um.expect("a fit");
        assert!(
            curved < 12.0 && curved < 0.7 * straight,
            "{curved} {straight}"
        );
        let bristle = of("lugre").largest_residual_um.expect("a fit");
        assert!(
            bristle < 12.0 && bristle < 0.7 * straight,
            "{bristle} {straight}"
        );
    }
}

fn square(coupling: f64) -> Plan {
    Plan {
        contour: Contour::Square,
        side: Side::Right,
        size: 300e-6,
        speed: 200e-6,
        shape: Shape::Trapezoid,
        coupling: Some(coupling),
        preload: 2.4,
    }
}

#[test]
#[ignore = "long: two machines"]
fn a_square_is_square_with_compensation() {
    for seed in 770..772 {
        let (d, _) = trace(&setup(), &square(0.0), seed).expect("no fault");
        assert!(d.uncompensated_um > 50.0, "{}", d.uncompensated_um);
        assert!(d.compensated_um < 5.0, "{}", d.compensated_um);
    }
}

/// Figs. 2.21-2.23: 120 um, 30 um, and less with a preload. What the bearings between the links
/// couple is in no joint's model of windup.
#[test]
#[ignore = "long: two machines"]
fn friction_between_the_links_spoils_what_compensation_gains() {
    for seed in 773..775 {
        let (d, _) = trace(&setup(), &square(0.03), seed).expect("no fault");
        assert!(
            (70.0..130.0).contains(&d.uncompensated_um),
            "{}",
            d.uncompensated_um
        );
        assert!(
            (10.0..45.0).contains(&d.compensated_um),
            "{}",
            d.compensated_um
        );
        assert!(d.preloaded_um < d.compensated_um, "{d:?}");
    }
}

#[test]
fn a_circle_is_round_with_compensation() {
    let plan = Plan {
        contour: Contour::Circle,
        size: 1e-3,
        speed: 1e-3,
        shape: Shape::SCurve,
        ..square(0.0)
    };
    let (d, _) = trace(&setup(), &plan, 780).expect("no fault");
    assert!(d.uncompensated_um > 5.0 * d.compensated_um, "{d:?}");
}
