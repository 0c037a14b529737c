//! What light on the circle tells beside where the peak is: how wide the spot is, whether the micro swings, how the
//! tip shakes.

use super::known::shortest_bond;
use super::{ConicalScan, Gap};
use crate::beam::{Peak, Reading};
use crate::gap_by_light::{Circles, Rounds, Width};
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::shaking::{Scatter, Shaking};
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;
use pigtail_numerics::line::Line;
use std::f64::consts::TAU;

impl ConicalScan<'_> {
    /// How wide the spot is at a gap, by turns on two circles; `at` is the gap that the width is noted for. Turns until its square
    /// is known to a `share` of it, or for some seconds; `None` where there is too little light. All gaps are looked at on the
    /// same circles, so that it does not matter how far a piezo goes on them. Fewer turns do where it is known by how much their rounds differ, as
    /// seen `before`.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn width(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        at: f64,
        share: f64,
        before: Rounds,
    ) -> Result<Option<Width>, Halt> {
        let believed = self.beam.squared_widths(gap);
        let mut spot = Circles::default();
        let mut width = None;
        let least = match before.variance() {
            Some(_) => TUNING.watch.rounds_told,
            None => TUNING.watch.rounds,
        };
        for round in 1..=TUNING.watch.most_rounds {
            spot.begin_round();
            // To and fro, so that light which rises or falls steadily counts on both alike.
            for circle in [round % 2, 1 - round % 2].map(|i| TUNING.watch.widths[i as usize]) {
                let radius = circle * self.beam.design() / self.beam.width(gap);
                if radius != self.radius {
                    self.shrink(bench, gap, radius, TUNING.watch.over).await?;
                }
                self.turn(bench, gap).await?;
                for reading in &self.readings {
                    spot.add(reading.at - self.centre, reading.volts);
                }
            }
            if round >= least && round % 2 == 0 {
                width = spot.width(at, self.watch.noise, believed, before);
                if width.is_none_or(|width| width.is_known_to(share)) {
                    break;
                }
            }
        }
        self.shrink(bench, gap, self.shape.radius, TUNING.circle.shrink)
            .await?;
        self.turn(bench, gap).await?;
        Ok(width)
    }

    /// By how much the light of the last `share` of a turn differs from that of `peak`, rms, beside its noise, what a tip makes of it that shakes as it was
    /// measured to, and how unsteady it was by itself on the wide circle: that is not the shape of a peak. Of its light at `gap`.
    pub(super) fn misfit(&mut self, peak: &Peak, gap: f64, share: f64) -> f64 {
        let light = peak.full * self.beam.share(gap);
        let shakes = self.scatters(self.shaking.measured_before(), gap);
        let unsteady = self.unsteady_before(gap) * (-self.radius * self.radius).exp();
        let noise = self
            .swings_by_noise(light)
            .hypot(light * shakes.max(unsteady));
        let readings: &[Reading] = self.readings.make_contiguous();
        let n = (share * readings.len() as f64).round().max(2.0);
        let readings = &readings[readings.len().saturating_sub(n as usize)..];
        let most = noise * noise * (1.0 + 4.0 * (2.0 / n).sqrt());
        let rest = (self.beam.misfit(readings, peak) / n - most).max(0.0);
        rest.sqrt() / light
    }

    /// Variance of the last turn beside the harmonics that a circle makes of something of its readings, its square,
    /// and its degrees of freedom; none for readings too few.
    pub(super) fn left(&self, of: impl Fn(&Reading) -> f64) -> Option<(f64, f64)> {
        let n = self.readings.len();
        let volts = || self.readings.iter().map(&of).enumerate();
        let part = |harmonic: usize, of: fn(f64) -> f64| {
            let angle = |k: usize| TAU * (harmonic * k) as f64 / n as f64;
            let sum: f64 = volts().map(|(k, v)| v * of(angle(k))).sum();
            sum * sum * 2.0 / n as f64
        };
        let whole: f64 = volts().map(|(_, v)| v * v).sum();
        let mean: f64 = volts().map(|(_, v)| v).sum();
        let circle = part(1, f64::sin) + part(1, f64::cos) + part(2, f64::sin) + part(2, f64::cos);
        let free = n as f64 - 5.0;
        (free >= 1.0).then(|| ((whole - mean * mean / n as f64 - circle) / free, free))
    }

    /// By how much the micro swings beside its circle around a `peak`, metres: what the light of the last
    /// turn holds beside the harmonics that a circle makes, where that is two standard deviations more than its
    /// noise, or zero. On a circle of `r` widths `w` a swing `a` makes `r a/w` of the light, rms.
    pub(super) fn swing(&self, peak: &Peak, gap: f64) -> f64 {
        let Some((left, free)) = self.left(|reading| reading.volts) else {
            return f64::INFINITY;
        };
        let light = peak.full * self.beam.share(gap);
        let noise = self.swings_by_noise(light).powi(2);
        if left < noise * (1.0 + 2.0 * (2.0 / free).sqrt()) {
            return 0.0;
        }
        (left - noise).sqrt() * self.swings_for(gap, light)
    }

    /// What noise and a laser that flickers make of a reading of so much light, volts.
    fn swings_by_noise(&self, light: f64) -> f64 {
        self.watch.noise.hypot(self.flicker.deviation() * light)
    }

    /// Metres of a swing for a volt that it makes of so much light.
    fn swings_for(&self, gap: f64, light: f64) -> f64 {
        self.beam.width(gap) / (self.radius * light)
    }

    /// What may look like a swing now and then and is the noise of `free` degrees of freedom, metres.
    pub(super) fn no_swing(&self, peak: &Peak, gap: f64) -> f64 {
        let light = peak.full * self.beam.share(gap);
        self.passes_for_swing(self.swings_by_noise(light), gap, light)
    }

    /// The same where light itself is as unsteady as it was on the wide circle, whatever made it so there: a gap that shakes where light ripples with
    /// it does, several times within a turn.
    pub(super) fn no_swing_as_before(&self, peak: &Peak, gap: f64) -> f64 {
        let light = peak.full * self.beam.share(gap);
        let noise = self
            .swings_by_noise(light)
            .hypot(self.unsteady_before(gap) * light);
        self.passes_for_swing(noise, gap, light)
    }

    /// How unsteady light was on the wide circle, as a share of it: what a place makes of it that scatters by so much.
    pub(super) fn unsteady_before(&self, gap: f64) -> f64 {
        2.0 * self.shape.radius * self.shaking.on_wide() / self.beam.width(gap)
    }

    fn passes_for_swing(&self, noise: f64, gap: f64, light: f64) -> f64 {
        let free = (self.readings.len() as f64 - 5.0).max(1.0);
        let most = noise * (TUNING.watch.surely * (2.0 / free).sqrt()).sqrt();
        most * self.swings_for(gap, light)
    }

    /// By which share of a peak's light, rms, that on the circle scatters with a place that scatters by `shakes` metres along every
    /// direction: on a circle of `r` widths `w` by `2 r s/w` of the light there.
    fn scatters(&self, shakes: f64, gap: f64) -> f64 {
        let r = self.radius;
        2.0 * r * shakes / self.beam.width(gap) * (-r * r).exp()
    }

    /// How the tip shakes by the last turn around a `peak`. `None` where the circle's middle was on its way, and farther than
    /// a tip that shakes sends it by itself.
    pub(super) fn shakes(&self, peak: &Peak, gap: f64) -> Option<Scatter> {
        if self.moved > TUNING.watch.sent {
            return None;
        }
        let (left, free) = self.left(|reading| self.beam.left(reading, peak))?;
        let light = peak.full * self.beam.share(gap);
        let scale = (light * self.scatters(1.0, gap)).recip();
        Some(Scatter {
            variance: left * scale * scale,
            still: (self.watch.still * scale).powi(2),
            still_degrees: self.watch.still_degrees,
            degrees: free,
        })
    }

    /// How wide the spot is, by the last turn of the wide circle and that of the small one, if these tell.
    pub(super) fn width_here(&self, gap: f64) -> Option<Width> {
        let mut spot = Circles::default();
        for (at, volts) in &self.around {
            spot.add(*at, *volts);
        }
        for reading in &self.readings {
            spot.add(reading.at - self.centre, reading.volts);
        }
        let believed = self.beam.squared_widths(gap);
        let width = spot.width(gap, self.watch.still, believed, Rounds::default());
        width.filter(|width| width.is_known_to(TUNING.watch.known_roughly))
    }

    /// Of such a width: how much more than believed, squared, a tip moves at most for its light to say so, in x or in y;
    /// and how much wider, squared, the spot is in both than a round one that is as wide as believed.
    pub(super) fn wider_by(&self, gap: f64, width: &Width) -> (f64, [f64; 2]) {
        let believed = self.beam.squared_widths(gap);
        let [x, y] = [0, 1].map(|i| width.squared[i] / believed[i]);
        let round = self.beam.width(gap).powi(2);
        (
            x.max(y).max(1.0),
            width.squared.map(|squared| squared / round),
        )
    }

    /// Watches how the tip shakes: it is held beside the peak, in x and in y, where light is steep, for so many light
    /// samples each; and as long at the peak, where light tells what else it does. What a micro does that is sent about is
    /// none of it. Means over as long as a bond takes are looked at too: a fiber is fixed where its tip was on average. Ends
    /// at the peak.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn watch_shaking(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        samples: usize,
    ) -> Result<(), Halt> {
        let mut looks = self.looks.unwrap_or_else(|| Looks::before(self.shaking));
        let (width, peak) = (self.beam.width(gap), self.place(gap));
        // One that still swings after a short rest is watched again, after a longer one.
        let again = self.shaking.is_watched() || self.shaking.rings();
        let rest = if again {
            self.forgets
        } else {
            self.forgets.min(TUNING.watch.glance)
        } * bench.settling(self.watch.group);
        let rate = bench.caps().channels[self.watch.meter.0].rate;
        let bond = ((shortest_bond(bench) * rate).round() as usize).max(1);
        // Piezos creep meanwhile, ever more slowly.
        let straight = (TUNING.watch.straight * rate).round() as usize;
        let straight = straight.max(4 * bond);
        // A circle is no rest: what it makes of the light would pass for noise.
        self.glide_to(bench, gap, peak).await?;
        self.last_for(bench, Gap::Steady(gap), rest).await?;
        let at_peak = self.look(bench, samples).await?;
        let top = at_peak.iter().map(|(_, volts)| volts).sum::<f64>() / samples as f64;
        for (look, together) in looks.each.iter_mut().zip([1, bond]) {
            look.at_peak
                .add(Unrest::of(&at_peak, together, straight), (1.0, 1.0));
        }
        for direction in [Displacement::new(1.0, 0.0), Displacement::new(0.0, 1.0)] {
            self.glide_to(bench, gap, peak + direction * (TUNING.watch.steep * width))
                .await?;
            self.last_for(bench, Gap::Steady(gap), rest).await?;
            let beside = self.look(bench, samples).await?;
            let light = beside.iter().map(|(_, volts)| volts).sum::<f64>() / samples as f64;
            if light < TUNING.circle.significant * self.watch.noise {
                continue;
            }
            // How wide the spot is in this direction the light tells by itself; it is not much narrower than believed.
            let steep = TUNING.watch.steep;
            let most = 2.0 * steep * steep;
            let fallen = (top / light).ln().clamp(TUNING.watch.least_fall, most);
            let scale = steep * width / (2.0 * fallen * light);
            let fallen = (light / top).powi(2).min(1.0);
            for (look, together) in looks.each.iter_mut().zip([1, bond]) {
                let unrest = Unrest::of(&beside, together, straight);
                look.beside.add(unrest, (scale * scale, fallen));
            }
        }
        self.glide_to(bench, gap, peak).await?;
        let [samples, means] = &looks.each;
        if means.beside.degrees > 0.0 {
            let mut shaking = looks.before;
            shaking.add_sample(&self.scatter(samples, 1));
            shaking.add_wide(&self.scatter(means, bond));
            // What is slower than a turn is in it.
            shaking.set_slow([0.0; 2], [0.0; 2], means.beside.degrees);
            self.shaking = shaking;
        }
        self.looks = Some(looks);
        Ok(())
    }

    /// Watches how the tip shakes ([`Self::watch_shaking`]), longer and longer while it `helps`, until it was for as many light samples as are
    /// worth it: of these `watched` is the count.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn watch_while(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        watched: &mut usize,
        helps: impl Fn(&Shaking) -> bool,
    ) -> Result<(), Halt> {
        let mut samples = TUNING.watch.first;
        while *watched + samples <= TUNING.watch.most && helps(&self.shaking) {
            self.watch_shaking(bench, gap, samples).await?;
            *watched += samples;
            samples = *watched;
        }
        Ok(())
    }

    /// So many light samples from now on: their numbers, and the light, volts.
    async fn look(&self, bench: &Reactor<'_>, samples: usize) -> Result<Vec<(f64, f64)>, Halt> {
        let seen = bench.samples(self.watch.meter.0, samples).await?;
        let volts = seen.iter().map(|(_, volts)| volts - self.watch.background);
        Ok(volts.enumerate().map(|(k, v)| (k as f64, v)).collect())
    }

    /// What looks of means of so many samples `together` say of the tip's place, beside the light's unrest where no shaking makes any: that
    /// of the photodiode in the dark and of the peak, or where there is more of it at the peak than chance makes, what is in the dark and as great a
    /// share of the light as goes on at the peak: lasers wander, and tips at its other end shake. (Light that is scattered fluctuates as
    /// much everywhere: as much of it counts as the tip's.)
    fn scatter(&self, look: &Look, together: usize) -> Scatter {
        let (variance, degrees) = (self.watch.still.powi(2), self.watch.still_degrees);
        let dark = Unrest {
            variance: variance / together as f64,
            degrees,
        };
        let (mut still, beside) = (look.at_peak, &look.beside);
        let chance = TUNING.watch.chance * (2.0 / still.degrees).sqrt();
        let (still, known) = if still.mean() > dark.variance * (1.0 + chance) {
            let more = (still.mean() - dark.variance) * beside.share;
            (dark.variance * beside.scale + more, still.degrees)
        } else {
            // (Of a peak that nobody has looked at for long enough there is nothing.)
            still.add(Some(dark), (1.0, 1.0));
            (still.mean() * beside.scale, still.degrees)
        };
        Scatter {
            variance: beside.mean(),
            still: still / beside.degrees,
            still_degrees: known,
            degrees: beside.degrees,
        }
    }

    /// The micro goes straight to a displacement at a gap, without a jump of its speed, and rests there.
    pub(super) async fn glide_to(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        to: Displacement,
    ) -> Result<(), Halt> {
        let (centre, radius) = (self.centre, self.radius);
        self.centre = to - self.walk * gap;
        let glided = self.shrink(bench, gap, 0.0, TUNING.circle.shrink).await;
        (self.centre, self.radius) = (centre, radius);
        glided
    }
}

/// What was seen of a tip while it was watched: by samples, and by their means over as long as a bond takes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Looks {
    /// What is believed of it beforehand.
    before: Shaking,
    each: [Look; 2],
}

impl Looks {
    fn before(seen: Shaking) -> Self {
        Self {
            before: seen.to_watch(),
            each: Default::default(),
        }
    }
}

/// Where no shaking makes any unrest (square volts), and where it makes the most (square metres).
#[derive(Debug, Clone, Copy, Default)]
struct Look {
    at_peak: Squares,
    beside: Squares,
}

/// Squares of what scatters, each in a scale of its own.
#[derive(Debug, Clone, Copy, Default)]
struct Squares {
    sum: f64,
    degrees: f64,
    /// Sum of the scales, one for each degree of freedom...
    scale: f64,
    /// ...and of those times the share of the light, squared, that there is.
    share: f64,
}

impl Squares {
    fn add(&mut self, seen: Option<Unrest>, (scale, share): (f64, f64)) {
        if let Some(Unrest { variance, degrees }) = seen {
            self.sum += scale * variance * degrees;
            self.degrees += degrees;
            self.scale += scale * degrees;
            self.share += scale * share * degrees;
        }
    }

    fn mean(&self) -> f64 {
        self.sum / self.degrees
    }
}

/// How much the means of some light samples each scatter about straight lines in time.
#[derive(Debug, Clone, Copy)]
struct Unrest {
    /// Variance of a mean, square volts.
    variance: f64,
    degrees: f64,
}

impl Unrest {
    /// Of means of so many samples `together`, about lines through so many samples; `None` for too few. Many lines tell by how much they differ what
    /// their degrees of freedom are worth: what is slow, as a laser that wanders, has fewer than there are samples.
    fn of(seen: &[(f64, f64)], together: usize, straight: usize) -> Option<Self> {
        let n = together as f64;
        let each = seen.chunks(straight).filter_map(|seen| {
            let means = seen.chunks_exact(together).map(|each| {
                let sum = |of: fn(&(f64, f64)) -> f64| each.iter().map(of).sum::<f64>() / n;
                (sum(|each| each.0), sum(|each| each.1))
            });
            let free = means.len() as f64 - 2.0;
            let line = Line::through(means.clone());
            let squares = means.map(|(k, v)| line.left(k, v).powi(2)).sum::<f64>();
            (free >= 1.0).then_some((free, squares))
        });
        let each: Vec<_> = each.collect();
        let (free, squares) = each
            .iter()
            .fold((0.0, 0.0), |(free, sum), (f, s)| (free + f, sum + s));
        let (variance, lines) = (squares / free, each.len() as f64);
        // Of white noise they scatter by 2/free.
        let apart = each
            .iter()
            .map(|(free, squares)| free * (squares / free / variance - 1.0).powi(2));
        let apart = apart.sum::<f64>() / (lines - 1.0);
        let worth = if lines >= TUNING.watch.many {
            (2.0 / apart).min(1.0)
        } else {
            1.0
        };
        (free > 0.0).then_some(Self {
            variance,
            degrees: worth * free,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn what_is_slow_is_known_by_fewer_degrees_than_there_are_samples() {
        let (samples, straight) = (4000, 100);
        let mut rng = Pcg64Mcg::seed_from_u64(31);
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let white: Vec<_> = (0..samples).map(|k| (f64::from(k), normal())).collect();
        let known = Unrest::of(&white, 1, straight).expect("many samples");
        let free = f64::from(samples) * 0.98;
        assert!(
            known.degrees > 0.5 * free && known.degrees <= free,
            "{known:?}"
        );
        assert!((known.variance - 1.0).abs() < 0.1, "{known:?}");
        // A walk, of which each piece is one excursion or two.
        let mut at = 0.0;
        let slow: Vec<_> = (0..samples)
            .map(|k| {
                at += normal();
                (f64::from(k), at)
            })
            .collect();
        let known = Unrest::of(&slow, 1, straight).expect("many samples");
        assert!(known.degrees < 0.1 * free, "{known:?}");
        // Of one piece nobody can tell.
        let few = Unrest::of(&white[..40], 1, straight).expect("some samples");
        assert!((few.degrees - 38.0).abs() < 1e-9);
    }
}
