//! What is believed of tips by what vision sees of them: each frame is held against what was known before.

use super::{Belief, Keepout, LATE, Tip, WHILE, hidden_by_piezos};
use pigtail_hal::measurement::TipFix;
use pigtail_hal::spec::GuardSpec;
use pigtail_hal::{Side, VisionFrame};
use pigtail_model::frames::{Chip, Point};

/// By what time a tip may lag behind its encoders, seconds.
const LAG: f64 = 2e-3;
/// Standard deviations, and metres beside them, by which a frame may differ from what was expected.
const SURPRISE: (f64, f64) = (8.0, 5e-6);
/// A frame that does not agree with the encoders.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Surprise {
    /// The tip and the direction: `left fiber, z`.
    pub(in super::super) what: String,
    /// By how much it does not, metres.
    pub(in super::super) by: f64,
    /// What would have been accepted, metres.
    pub(in super::super) accepted: f64,
}

impl Keepout {
    /// Takes in a frame that has arrived at `now`.
    pub(in super::super) fn see(&mut self, frame: &VisionFrame, now: f64) -> Result<(), Surprise> {
        let back = ((now - frame.time) * self.rate).round().max(0.0) as usize;
        if back + WHILE.max(LATE * self.settle) >= self.recent.len() || frame.time <= self.begun {
            return Ok(());
        }
        for side in Side::ALL {
            let i = side.index();
            if let Some(fix) = &frame.fiber[i]
                && self.held[i]
                && frame.time > self.since[i]
            {
                let near = self.is_in_field(Tip::Fiber(side), back);
                let belief = near.then(|| self.update(Tip::Fiber(side), fix, back));
                self.fibers[i] = belief.transpose()?;
            }
        }
        let near = self.is_in_field(Tip::Sensing, back);
        let belief = near.then(|| self.update(Tip::Sensing, &frame.sensing, back));
        self.sensing = belief.transpose()?;
        Ok(())
    }

    /// Whether a tip was where vision is to be believed, by the datasheet. From elsewhere, such as a tray, it is seen anew when
    /// it comes back.
    fn is_in_field(&self, tip: Tip, back: usize) -> bool {
        let facet = &self.geometry.facets[tip.side().index()];
        let at = self.nominal(tip, back);
        let [aside, away] = self.field;
        facet.gap(at.z) < away && (at.x - facet.ports[0].x).abs() < aside
    }

    fn update(&self, tip: Tip, fix: &TipFix, back: usize) -> Result<Belief, Surprise> {
        let side = tip.side().index();
        let stood = self.nominal(tip, back);
        let holder = *self.stand(side, back);
        let earlier = self.nominal(tip, back + WHILE);
        let arriving = self.arriving(side, back);
        let x_probed = self.probed_x(tip, &holder).map(|x| fix.x - x);
        let lag = |way: f64| LAG * way.abs() * self.rate / WHILE as f64;
        let seen = [fix.x - stood.x, fix.z - stood.z];
        let belief = match tip {
            Tip::Fiber(_) => self.fibers[side],
            Tip::Sensing => self.sensing,
        };
        let surprise = |direction: &str, by: f64, accepted: f64| {
            if by.abs() <= accepted {
                return Ok(());
            }
            let what = format!("{}, {direction}", tip.name());
            Err(Surprise { what, by, accepted })
        };
        let noise = fix.sigma * fix.sigma + lag(stood.z - earlier.z).powi(2);
        let (sigmas, metres) = SURPRISE;
        let Some(before) = belief else {
            surprise("z", seen[1], self.placement + self.accuracy[1])?;
            return Ok(Belief {
                z: seen[1],
                z_variance: noise,
                ahead: holder.ahead,
                stood,
                holder,
                x: seen[0],
                arriving,
                x_probed,
            });
        };
        // Where stages stand askew, and lead and links are not as believed, a way in one direction goes in the others too.
        let strays =
            |along: f64, [a, b]: [f64; 2]| (self.scale * along).hypot(self.askew * a.hypot(b));
        let way =
            |from: Point<Chip>, to: Point<Chip>| [to.x - from.x, to.y - from.y, to.z - from.z];
        let [x, y, z] = way(before.stood, stood);
        let strayed = strays(z, [x, y]);
        let variance = before.z_variance + strayed * strayed;
        let by = seen[1] - before.z;
        surprise("z", by, sigmas * (variance + noise).sqrt() + metres)?;
        let (by_x, hidden) = if let (Some(now), Some(then)) = (x_probed, before.x_probed) {
            // Outputs that are seen hide nothing, and lag behind nothing.
            (now - then, hidden_by_piezos(&holder, &before.holder))
        } else {
            let hidden = self.hidden(&holder, &before.holder);
            let lag = 2.0 * lag(stood.x - earlier.x);
            (seen[0] - before.x, hidden + lag)
        };
        let late = arriving + before.arriving;
        let [x, y, z] = way(before.holder.tip, holder.tip);
        let noise_x = fix.sigma.hypot(strays(x, [y, z]));
        surprise("x", by_x, sigmas * noise_x + 4.0 * metres + hidden + late)?;
        let share = variance / (variance + noise);
        let across = Belief {
            holder,
            x: seen[0],
            arriving,
            x_probed,
            ..before
        };
        // What a piezo on its way may excuse is not believed: frames are compared with what was known before.
        let across = if arriving > before.arriving.max(metres) {
            before
        } else {
            across
        };
        Ok(Belief {
            z: before.z + share * by,
            z_variance: ((1.0 - share) * variance).max(GuardSpec::FORGETS * fix.sigma * fix.sigma),
            ahead: before.ahead + share * (holder.ahead - before.ahead),
            stood,
            ..across
        })
    }
}
