//! Where endpoints are by angles that are read anew in every cycle and change little from one to the next.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::Arm;
use pigtail_hal::spec::SIDES;
use pigtail_model::each::Each;
use pigtail_model::fivebar::FiveBars;

/// The endpoints of both manipulators, by their encoders and by their probes.
const ALL: usize = 2 * SIDES;

/// Works out where endpoints are: all of them at once, for each waits for a division and a root.
#[derive(Debug, Clone, Copy)]
pub(super) struct Across {
    five_bars: FiveBars<ALL>,
    /// Angles of the joints A and B at home, radians, and the endpoint there, metres.
    home_angles: [Each<ALL>; 2],
    home: [Each<ALL>; 2],
}

impl Across {
    pub(super) fn new([left, right]: &[Arm; SIDES]) -> Self {
        let arms = [left, right, left, right];
        let angle = |joint: usize| Each(arms.map(|arm| arm.home_angles[joint].0));
        let home = |axis: usize| Each(arms.map(|arm| arm.home[axis]));
        Self {
            five_bars: FiveBars::new(arms.map(|arm| arm.five_bar)),
            home_angles: [angle(0), angle(1)],
            home: [home(0), home(1)],
        }
    }

    /// [`Arm::across`] of the angles from home (radians) that encoders tell, and of those that probes do, of each side; no numbers where no
    /// mechanism has these angles.
    #[inline(always)]
    pub(super) fn of(
        &mut self,
        encoders: [[f64; 2]; SIDES],
        probes: [[f64; 2]; SIDES],
    ) -> [[(f64, f64); SIDES]; 2] {
        let ([[la, lb], [ra, rb]], [[pa, pb], [qa, qb]]) = (encoders, probes);
        let [home_a, home_b] = self.home_angles;
        let angles = [
            home_a + Each([la, ra, pa, qa]),
            home_b + Each([lb, rb, pb, qb]),
        ];
        let (x, y) = self.five_bars.forward(angles);
        let (x, y) = (x - self.home[0], y - self.home[1]);
        let at = |k: usize| (x[k], y[k]);
        [[at(0), at(1)], [at(2), at(3)]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_model::fivebar::FiveBar;
    use pigtail_model::frames::{Placement, Point};
    use pigtail_model::leadscrew::LeadScrew;

    #[test]
    fn endpoints_are_where_each_would_be_found_by_itself() {
        let five_bar = FiveBar::new(0.04, 0.045, 0.0725).expect("it stands");
        let placement = Placement::new(Point::ORIGIN, 0.0);
        let screw = LeadScrew::from_lead(1e-3);
        let arm = |home| Arm::new(five_bar, home, screw, placement, 7e-6).expect("it reaches home");
        let arms = [arm([0.0, 0.09]), arm([1e-3, 0.088])];
        let mut across = Across::new(&arms);
        for k in 0..20_000 {
            // To the ends of the workspace, and at each place to and fro.
            let (far, t) = (f64::from(k / 100) / 200.0, f64::from(k));
            let [a, b] = [0.3 * far, -0.3 * far];
            let angles = [a + 1.5e-6 * (0.7 * t).sin(), b + 1.5e-6 * (1.1 * t).cos()];
            let others = [-angles[1], 0.1 * angles[0]];
            let [encoders, probes] = across.of([angles, others], [others, angles]);
            for (i, arm) in arms.iter().enumerate() {
                for ((x, y), angles) in [
                    (encoders[i], [angles, others][i]),
                    (probes[i], [others, angles][i]),
                ] {
                    let (exact_x, exact_y) = arm.across(angles).expect("it is reached");
                    assert!((x - exact_x).hypot(y - exact_y) < 1e-15, "{k}: {x} {y}");
                }
            }
        }
    }
}
