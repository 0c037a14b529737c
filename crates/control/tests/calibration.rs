//! What a calibration may say.

mod common;

use pigtail_control::calibration::Calibration;
use pigtail_hal::{Error, Side};

/// The default rig's calibration with a spread, and what that says of how alike its lengths err.
fn alike(says: &str) -> Result<f64, Error> {
    let spread = format!(
        "\n[spread.left]\nx = \"0.2 um\"\ny = \"0.2 um\"\ndeviation_x = 0.01\ndeviation_y = 0.01\n{says}date = \"\"\norigin = \"\"\n"
    );
    let text = common::read("calibration.toml") + &spread;
    let calibration = Calibration::parse("calibration.toml", &text, &common::spec())?;
    Ok(calibration
        .spread
        .of(Side::Left)
        .expect("it is there")
        .correlation)
}

#[test]
fn lengths_err_alike_wholly_at_most() {
    assert_eq!(alike(""), Ok(1.0));
    assert_eq!(alike("correlation = 0.2\n"), Ok(0.2));
    let wrong = alike("correlation = 2.0\n").expect_err("more than wholly");
    assert_eq!(wrong.key, "spread.left.correlation");
    assert!(wrong.message.contains("accepted is 0 to 1"), "{wrong}");
}
