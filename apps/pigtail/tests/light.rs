//! What the rig's light must be like for the thesis's account of it to hold.

use pigtail_model::optics::{Coupler, GaussianMode, Misalignment};
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;

fn coupler(setup: &Setup) -> Coupler {
    let [radius_x, radius_y] = setup.plant.device.mode_radius;
    let fiber = setup.plant.fiber.mode_radius;
    Coupler::new(
        GaussianMode { radius_x, radius_y },
        GaussianMode {
            radius_x: fiber,
            radius_y: fiber,
        },
        setup.plant.light.wavelength,
    )
    .expect("modes are positive")
}

/// Signal over noise of one photodiode sample, both fibers `radius` metres off at a gap of 50 um.
fn both_sides(setup: &Setup, radius: f64) -> f64 {
    let coupler = coupler(setup);
    let side = coupler.efficiency(&Misalignment {
        y: radius,
        z: 50e-6,
        ..Misalignment::default()
    });
    setup.plant.light.full * side * side / setup.plant.light.noise
}

/// Thesis 3.2: light throughput is available when both fibers are within 5 um, and not outside.
#[test]
fn with_both_fibers_50_um_away_light_is_seen_only_within_about_5_um() {
    let setup = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the rig is well");
    let significance = setup.rig.recipe.raster.significance;
    assert!(both_sides(&setup, 0.0) > 5.0 * significance);
    assert!(
        both_sides(&setup, 4.5e-6) > significance,
        "{}",
        both_sides(&setup, 4.5e-6)
    );
    assert!(
        both_sides(&setup, 6e-6) < significance,
        "{}",
        both_sides(&setup, 6e-6)
    );
}

/// Thesis 3.1: losses are acceptable, 11 %, within 0.1 um in x and y and 2 um in z.
#[test]
fn the_tolerances_keep_the_loss_below_11_percent() {
    let setup = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the rig is well");
    let coupler = coupler(&setup);
    let tilt = setup.plant.misplacement.tilt;
    let worst = coupler.efficiency(&Misalignment {
        x: 0.1e-6,
        y: 0.1e-6,
        z: setup.rig.recipe.approach.gap + 2e-6,
        tilt_x: tilt,
        tilt_y: tilt,
    });
    assert!(worst > 0.89, "{worst}");
}
