//! The five-bar over its whole workspace, and at its edges.

use pigtail_model::fivebar::{FiveBar, JointAngle, Unreachable};
use pigtail_model::frames::Displacement;
use proptest::prelude::*;

fn five_bar() -> FiveBar {
    FiveBar::new(0.040, 0.045, 0.0725).expect("valid lengths")
}

proptest! {
    #[test]
    fn inverse_then_forward_is_where_we_were(x in -0.0125..0.0125_f64, y in 0.070..0.095_f64) {
        let mechanism = five_bar();
        let (u, v) = mechanism.forward(mechanism.inverse(x, y).unwrap()).unwrap();
        prop_assert!((u - x).hypot(v - y) < 1e-15 * 100.0, "{} {}", u - x, v - y);
    }

    #[test]
    fn forward_then_inverse_is_where_we_were(a in 1.6..2.6_f64, mirrored in 0.55..1.5_f64) {
        let mechanism = five_bar();
        let angles = [JointAngle(a), JointAngle(mirrored)];
        let (x, y) = mechanism.forward(angles).unwrap();
        // Some of these poses lie in another working mode: an elbow points inward there.
        if let Ok([back_a, back_b]) = mechanism.inverse(x, y) {
            let (bx, by) = mechanism.forward([back_a, back_b]).unwrap();
            prop_assert!((bx - x).hypot(by - y) < 1e-12);
        }
    }

    #[test]
    fn the_jacobian_is_the_slope_of_forward(x in -0.0125..0.0125_f64, y in 0.070..0.095_f64) {
        let mechanism = five_bar();
        let angles = mechanism.inverse(x, y).unwrap();
        let jacobian = mechanism.jacobian(angles).unwrap();
        let h = 1e-6;
        let [along_x, along_y] = jacobian;
        for (joint, (dx, dy)) in along_x.into_iter().zip(along_y).enumerate() {
            let at = |offset: f64| {
                let mut moved = angles;
                moved[joint].0 += offset;
                mechanism.forward(moved).unwrap()
            };
            let ((xa, ya), (xb, yb)) = (at(h), at(-h));
            prop_assert!((dx - (xa - xb) / (2.0 * h)).abs() < 1e-9);
            prop_assert!((dy - (ya - yb) / (2.0 * h)).abs() < 1e-9);
        }
    }

    /// The bound is kept everywhere in a box, and on a box of one point it is the slope itself.
    #[test]
    fn no_joint_turns_faster_than_the_bound_of_its_box(
        x in -0.0125..0.0125_f64, y in 0.070..0.095_f64,
        left in 0.0..0.01_f64, right in 0.0..0.01_f64, below in 0.0..0.01_f64, above in 0.0..0.01_f64,
    ) {
        let mechanism = five_bar();
        let [[a, b], [c, d]] = mechanism.jacobian(mechanism.inverse(x, y).unwrap()).unwrap();
        let determinant = a * d - b * c;
        let slopes = [(d / determinant).hypot(b / determinant), (c / determinant).hypot(a / determinant)];
        let bounds = mechanism.most_rate(Displacement::new(x - left, y - below), Displacement::new(x + right, y + above));
        let points = mechanism.most_rate(Displacement::new(x, y), Displacement::new(x, y));
        for i in 0..2 {
            prop_assert!(slopes[i] <= bounds[i] * (1.0 + 1e-9), "{} {}", slopes[i], bounds[i]);
            prop_assert!((slopes[i] / points[i] - 1.0).abs() < 1e-9, "{} {}", slopes[i], points[i]);
        }
    }

    #[test]
    fn the_rates_of_the_bearings_are_their_slopes(x in -0.0125..0.0125_f64, y in 0.070..0.095_f64) {
        let mechanism = five_bar();
        let angles = mechanism.inverse(x, y).unwrap();
        let (_, rates) = mechanism.bearings(angles).unwrap();
        let h = 1e-6;
        for joint in 0..2 {
            let at = |offset: f64| {
                let mut moved = angles;
                moved[joint].0 += offset;
                mechanism.bearings(moved).unwrap().0
            };
            let (after, before) = (at(h), at(-h));
            for bearing in 0..3 {
                let slope = (after[bearing] - before[bearing]) / (2.0 * h);
                prop_assert!((rates[bearing][joint] - slope).abs() < 1e-7, "{} {}", bearing, joint);
            }
        }
    }

    #[test]
    fn anywhere_at_all_is_an_answer_or_an_error(x in -0.3..0.3_f64, y in -0.3..0.3_f64) {
        if let Ok(angles) = five_bar().inverse(x, y) {
            let (u, v) = five_bar().forward(angles).unwrap();
            prop_assert!((u - x).hypot(v - y) < 1e-9);
        }
    }
}

#[test]
fn an_encoder_count_is_between_one_and_two_micrometres_over_the_workspace() {
    let mechanism = five_bar();
    let count = std::f64::consts::TAU / 2000.0 / 80.0;
    for ix in -10..=10 {
        for iy in -10..=10 {
            let (x, y) = (f64::from(ix) * 1.25e-3, 0.0825 + f64::from(iy) * 1.25e-3);
            let jacobian = mechanism
                .jacobian(mechanism.inverse(x, y).unwrap())
                .unwrap();
            for (dx, dy) in jacobian[0].into_iter().zip(jacobian[1]) {
                let step = dx.hypot(dy) * count;
                assert!((1e-6..2e-6).contains(&step), "{step} m at ({x}, {y})");
            }
        }
    }
}

#[test]
fn out_of_reach_and_singular_are_told_apart() {
    let mechanism = five_bar();
    assert!(matches!(
        mechanism.inverse(0.0, 0.2),
        Err(Unreachable::OutOfReach { .. })
    ));
    assert!(matches!(
        mechanism.inverse(0.0, -0.08),
        Err(Unreachable::OutOfReach { .. })
    ));
    assert!(matches!(
        mechanism.inverse(f64::NAN, 0.08),
        Err(Unreachable::OutOfReach { .. })
    ));
    // Both legs stretched to almost their full length.
    let reach = (0.045_f64 + 0.0725).powi(2) - 0.02_f64.powi(2);
    assert!(mechanism.inverse(0.0, reach.sqrt() - 1e-16).is_err());
    // Elbows too far apart for the distal links.
    let flat = [JointAngle(3.1), JointAngle(0.05)];
    let wide = FiveBar::new(0.080, 0.045, 0.0725).unwrap();
    assert!(matches!(
        wide.forward(flat),
        Err(Unreachable::NotAssembled { .. })
    ));
    assert!(FiveBar::new(0.3, 0.045, 0.0725).is_err());
    assert!(FiveBar::new(0.04, f64::NAN, 0.0725).is_err());
}

#[test]
fn a_box_that_a_leg_does_not_reach_has_no_bound() {
    let most = |low: [f64; 2], high: [f64; 2]| {
        let [low, high] = [low, high].map(|[x, y]| Displacement::new(x, y));
        five_bar().most_rate(low, high)
    };
    let [a, b] = most([0.0, 0.08], [0.09, 0.09]);
    assert!(a.is_infinite() && b.is_finite(), "{a} {b}");
    let [a, b] = most([-0.02, 0.0], [-0.02, 0.09]);
    assert!(a.is_infinite() && b.is_finite(), "{a} {b}");
}
