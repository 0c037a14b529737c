//! Where an endpoint is by angles that are read anew in every cycle and change by little more than their noise.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::Arm;
use pigtail_model::fivebar::{Turning, Unreachable};

/// Within so much of where it was last worked out an endpoint is carried on along a straight line, radians. Links bend that
/// by less than a metre for a square radian: it errs by less than 1e-3 nm.
const NEAR: f64 = 1e-6;

/// An endpoint as it was last worked out.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Across {
    turning: [Turning; 2],
    /// Angles of the joints from home (radians), and the endpoint across (metres).
    known: Option<([f64; 2], (f64, f64))>,
    /// Metres a radian there, once they were needed.
    rates: Option<[[f64; 2]; 2]>,
}

impl Across {
    /// [`Arm::across`], to 1e-3 nm.
    #[inline(always)]
    pub(super) fn of(&mut self, arm: &Arm, angles: [f64; 2]) -> Result<(f64, f64), Unreachable> {
        if let Some((at, (x, y))) = self.known {
            let by = [angles[0] - at[0], angles[1] - at[1]];
            if by[0].abs() <= NEAR && by[1].abs() <= NEAR {
                let [along_x, along_y] = match self.rates {
                    Some(rates) => rates,
                    None => *self.rates.insert(arm.rates(at)?),
                };
                let way = |rates: [f64; 2]| rates[0] * by[0] + rates[1] * by[1];
                return Ok((x + way(along_x), y + way(along_y)));
            }
        }
        let to = arm.across_from(&mut self.turning, angles)?;
        (self.known, self.rates) = (Some((angles, to)), None);
        Ok(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_model::fivebar::FiveBar;
    use pigtail_model::frames::{Placement, Point};
    use pigtail_model::leadscrew::LeadScrew;

    #[test]
    fn an_endpoint_that_is_carried_on_is_where_it_would_be_found() {
        let five_bar = FiveBar::new(0.04, 0.045, 0.0725).expect("it stands");
        let placement = Placement::new(Point::ORIGIN, 0.0);
        let screw = LeadScrew::from_lead(1e-3);
        let arm = Arm::new(five_bar, [0.0, 0.09], screw, placement, 7e-6).expect("it reaches home");
        let mut across = Across::default();
        for k in 0..20_000 {
            // To the ends of the workspace, and at each place to and fro by more and less than what is near.
            let (far, t) = (f64::from(k / 100) / 200.0, f64::from(k));
            let [a, b] = [0.3 * far, -0.3 * far];
            let angles = [a + 1.5e-6 * (0.7 * t).sin(), b + 1.5e-6 * (1.1 * t).cos()];
            let (x, y) = across.of(&arm, angles).expect("it is reached");
            let (exact_x, exact_y) = arm.across(angles).expect("it is reached");
            assert!((x - exact_x).hypot(y - exact_y) < 1e-12, "{k}: {x} {y}");
        }
    }
}
