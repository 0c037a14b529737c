//! The gap, the light in it, and what sees it.

use super::topic;

topic! {
    /// The gap between fiber and chip.
    pub struct Gap in "gap", shown [Fast] {
        /// Standard deviation of the gap at which the last turns may end.
        sure: f64 = 0.7, "tolerances", Choice;
        /// Or after so long, whatever vision says.
        looking: f64 = 0.3, "s", Choice;
        /// Or that long, where it does not come to rest about a gap that is known as vaguely as that.
        doubting: f64 = 2.0, "s", Choice;
        /// What is as good as in doubt, of the probability that is accepted: vision may yet come to see it a little otherwise.
        spare: f64 = 0.1, "1", Choice;
        /// What a gap is corrected by at least where that is in doubt.
        finely: f64 = 0.2, "tolerances", Choice;
        /// So many times what transmissions may hide across is gone at once, at most, where joints turn back: before the gap that an inclined facet has left
        /// then a way goes straight back.
        turns_back: f64 = 1.5, "1", Choice;
        /// So often a tip that is too far aside to come in before an inclined facet goes sideways before that.
        sideways: u32 = 2, "1", Choice;
        /// What is left between a tip that goes upward on a search and where the guard stops it, at least, before it goes back to twice as much: frames of
        /// a camera are late, and a way of some hundred micrometres upward brings it nearer by less meanwhile.
        upward: f64 = 5e-6, "m", Choice;
        /// A fiber that waits is taken away from the chip where vision sees it so much nearer than it was...
        kept_off: f64 = 0.5e-6, "m", Choice;
        /// ...or where no more than this share is left of what it keeps off the gap at which the guard stops it...
        left: f64 = 0.5, "1", Choice;
        /// ...as often as this: vision is to have seen what came of the last time.
        kept_every: f64 = 1.0, "s", Choice;
        /// For how long vision may look at a tip at the chip where it could then know the gap: the light would take as long to tell
        /// it.
        looks: f64 = 0.8, "s", Measured;
        /// For how long the gap is to be known where there are more looks to be had: the last turns at a dim peak take as long.
        later: f64 = 5.0, "s", Choice;
        /// Until the macro stands still where it went aside: it may still come nearer by a count.
        still: u32 = 4, "turns", Choice;
        /// How near the peak the middle of the circles is to be: the light leaves at an angle, so that on one side of the peak the
        /// gap is longer. Half a width beside it, that makes the spot wider or narrower by 1 to 5 % (squared).
        centred: f64 = 0.05, "widths", Choice;
        /// Standard deviations by which light and vision may differ beside vision's bound.
        far_off: f64 = 4.0, "sigma", Choice;
        /// A way at speed ends before the chip by no less than this: on one of 60 machines of `workshop` that were commissioned an
        /// endpoint swung beyond by 2 um.
        beyond: f64 = 2.5e-6, "m", Choice;
        /// From so many times the gap at which the guard takes a fiber to be led by its light the macro may go aside: the guard
        /// takes off what vision does not know, and has it nearer than it is.
        aside: f64 = 1.2, "1", Choice;
        /// How fast the rest of the way to the chip is gone: who guards the machine counts the way that it would take to stop.
        nearly: f64 = 0.5e-3, "m/s", Choice;
        /// That fast where so much is left beyond what vision does not know: one of 4,440 devices of `workshop` was stopped without need
        /// by an output that was half as fast again as its motor and by frames of which the guard had fewer.
        roomy: f64 = 3e-6, "m", Choice;
        /// How fast a gap is corrected.
        slowly: f64 = 0.2e-3, "m/s", Choice;
        /// So many times as fast as told an axis may be on its way to rest, at most: 1.5 was seen on one of 40 machines of
        /// `workshop` that were commissioned.
        faster: f64 = 1.5, "1", Choice;
        /// No way to the chip is slower: it stands nearly still.
        least_speed: f64 = 0.2e-3, "m/s", Choice;
        /// What it takes to stop from the slow motions at the chip, and what way and lead may hide.
        stop: f64 = 0.8e-6, "m", Choice;
        /// How far beside the spot the background is looked at: the circle that is played there sees none of it.
        beside: f64 = 4.0, "widths", Equation;
        /// Until the micro is there, and for how long it looks.
        beside_turns: u32 = 2, "turns", Choice;
        /// How far the spot may have been from where it was believed to be while it was looked beside it.
        beside_moved: f64 = 0.5, "widths", Choice;
        /// Times that it is looked beside it, at most.
        beside_again: u32 = 4, "1", Choice;
        /// Looks at it, at most, of a micro of which nobody measured how long it swings.
        beside_looks: u32 = 8, "1", Choice;
        /// Standard deviations by which it is to have fallen from one look to the next for such a micro to swing still.
        beside_chance: f64 = 2.0, "sigma", Choice;
        /// What is kept off the chip more than the guard takes off, for its own frames are not quite the same.
        more_than_guard: f64 = 1.0, "sigma", Choice;
        /// Where it is known how light spreads, the spot is looked at where its squared width is so many times that at the chip,
        /// and one more; and at the chip. Light gets dimmer with the gap, and the way less sure without it; a third more is where
        /// both together leave least.
        quick_at: f64 = 1.0 / 3.0, "1", Equation;
        /// Until the square of its width is known to this share of it, the first time and the second. Half a percent of the square
        /// are a sixth of a micrometre there.
        quick_share: [f64; 2] = [8e-3, 4e-3], "1", Choice;
        /// The same at the chip, where a percent of the square is as much.
        quick_share_here: [f64; 2] = [12e-3, 6e-3], "1", Choice;
        /// Where it is not known how light spreads, the spot is looked at in so many places on the way.
        whole_at: [f64; 4] = [3.0, 1.8, 0.9, 0.3], "1", Choice;
        /// Until its square is known to this share of it there, and at the chip.
        whole_share: f64 = 4.5e-3, "1", Choice;
    }
}

topic! {
    /// How wide the spot is, and the gap by that.
    pub struct SpotWidth in "width", shown [Fast] {
        /// A round whose light is not so many times what noise makes of it tells of no spot.
        clear: f64 = 10.0, "1", Choice;
        /// What a width is taken from, at least.
        least: usize = 24, "samples", Choice;
        /// So many tell how much they differ, at least.
        rounds: usize = 3, "rounds", Choice;
        /// It is known by how much they differ from so many degrees of freedom on, of all looks so far: twice what one look of the usual rounds has.
        told: f64 = 6.0, "1", Choice;
        /// No width is known better than to this share of its square: to a thousandth of its way a piezo repeats its circles at
        /// another place of its range. What makers state of open loops.
        best: f64 = 2e-3, "1", Stated;
        /// A misfit of so many times its noise is of a spot that is no Gaussian.
        misshapen: f64 = 5.0, "1", Choice;
        /// By how much either way is turned that a micro goes on a circle, before that is seen, standard deviation: as a millisecond of lag turns a circle of
        /// 24 ms.
        turned: f64 = 0.3, "rad", Choice;
        /// How well it is known by design how light spreads, standard deviation of the logarithm: it counts where fewer gaps than
        /// three were looked at.
        vague: f64 = 0.2, "1", Choice;
        /// How well that must be known to count as known: 0.6 um of 20.
        well: f64 = 0.03, "1", Choice;
        /// How well it pays to know it: another fiber on another day adds half as much.
        very_well: f64 = 0.01, "1", Choice;
        /// Another fiber, on another day: a piezo does not go as far as it went. An estimate.
        another: f64 = 0.005, "1", Choice;
        /// What a contact is taken from, at least.
        gaps: usize = 2, "widths", Equation;
        /// What a transmission may keep to itself of a way along z, standard deviation: 0.2 um peak to peak are what the thesis
        /// finds of its z-stage (2.4.3).
        hidden: f64 = 0.07e-6, "m", Stated;
        /// The same as a share of what the datasheet says that it winds up, where that is more: 0.2 um of 4 peak to peak. Set after machines of `harsh`
        /// (10 um) had kept 0.2 to 0.4 um to themselves.
        of_windup: f64 = 0.0175, "1", Choice;
        /// How well the width at the chip is known before it is looked at, standard deviation of the logarithm of its square: as
        /// good as not at all.
        roughly: f64 = 0.5, "1", Choice;
        /// So far beyond what vision says contacts are tried, in its bound and standard deviations.
        beyond: f64 = 6.0, "sigma", Choice;
    }
}

topic! {
    /// The light between fiber and guide.
    pub struct LightBeam in "beam", shown [Fast, Bench] {
        /// What another fiber and another guide differ by, of a width: makers state a tenth of a micrometre or two for either
        /// radius, of 2 to 5. An estimate.
        another: f64 = 0.035, "1", Stated;
        /// How well a spot must be known to count as known: a fourth of what products differ by from what is usual.
        well: f64 = 0.05, "1", Choice;
        /// How oblong modes are before anything was seen: one standard deviation, of guides diffused by 20 % more or less in either
        /// direction.
        usual: f64 = 0.16, "1", Choice;
        /// No spot is more oblong: one that is seven times as wide one way as the other, of guides of 12 um by 1.2 um. (Three times, as of diode lasers,
        /// until a guide of `harsh` was 14 um by 2: what is believed to be narrower than it is, is believed to be known better.)
        most_oblong: f64 = 0.96, "1", Choice;
        /// A guide that is so many times as oblong as usual is none of the usual ones: what light tells of it counts alone.
        unusual: f64 = 3.0, "sigma", Choice;
        /// How well widths tell how oblong it is, one standard deviation.
        known: f64 = 0.03, "1", Choice;
        /// Least share of what readings tell that they do not tell of x and y as well.
        apart: f64 = 0.2, "1", Choice;
        /// Index of what facets and fibers' ends are of, at which light is reflected: glass.
        glass: f64 = 1.5, "1", Equation;
        /// Share of the most that a ripple does to a peak which is believed: ripples of any strength up to that of glass, at any place
        /// of them, are beyond a tolerance once in ten thousand times no more often than an even error within so much, where the most
        /// is a third of the tolerance, and a quarter more often where it is nearly half.
        rippled: f64 = 0.8, "1", Equation;
        /// How much it counts that the peak is near the middle of the readings.
        prior: f64 = 1.0, "1", Choice;
    }
}

topic! {
    /// How steeply light rises with the gap.
    pub struct LightRise in "rise", shown [Fast] {
        /// In so many steps a ripple is gone along: light at one more gap than that has two more than it takes to tell a ripple.
        steps: u32 = 6, "1", Choice;
        /// So many turns at each gap, beside one to come there.
        turns: u32 = 2, "turns", Choice;
        /// So many turns before the first one, in which a servo comes to rest whose axis goes back by some counts...
        waits: u32 = 4, "turns", Choice;
        /// ...and so far on from there: a servo was seen to go back by 0.25 um, of which its output went nothing.
        on: f64 = 0.3e-6, "m", Choice;
        /// An axis that goes back by more on its way along the ripple, of which a transmission hides all, tells nothing of it: a sixth of a ripple.
        back: f64 = 0.1e-6, "m", Choice;
        /// How much more or less light may fall with the gap than by design, as a share of that.
        falls: f64 = 0.5, "1", Choice;
        /// What a transmission may keep to itself of the small steps of an axis that goes on in one direction, standard deviation: on a machine of `harsh`
        /// it was 0.04 um, rms.
        hidden: f64 = 0.04e-6, "m", Choice;
        /// Within such a way nothing more is hidden: the axis has not been moved.
        same: f64 = 0.02e-6, "m", Choice;
        /// So far from where it was seen it is told, and no farther.
        near: f64 = 0.5e-6, "m", Choice;
        /// How well the square of a spot's width is known, of which the brightest place is beside the peak, standard deviation.
        width: f64 = 0.1, "1", Choice;
        /// It pays to measure it where a fiber would be outside with this share of the probability, at most, on stages that stand square.
        less: f64 = 0.5, "1", Choice;
        /// How often it is measured at most, for a fiber at the chip.
        often: u32 = 3, "1", Choice;
    }
}

topic! {
    /// What light teaches of piezos.
    pub struct Piezos in "piezos", shown [Fast] {
        /// What is believed of a piezo's stroke beside what its model says, before it is seen: one standard deviation of its
        /// natural logarithm. Of piezos that are aged or warm and not of those just calibrated: light soon knows better.
        usual: f64 = 0.2, "1", Choice;
        /// What was learned counts so many times as much as what comes next, whenever something comes.
        forgetting: f64 = 0.95, "1", Choice;
        /// No piezo goes farther or less far than so many times what is believed: it is broken then, which is not to be learned.
        bounds: [f64; 2] = [0.7, 1.43], "1", Choice;
        /// Piezos that differ by less, in the natural logarithm of their strokes, are left as they are: a circle is bent so little
        /// that light on it differs from a peak's by a hundredth and a half, less than half of what passes for one.
        worth: f64 = 0.1, "1", Choice;
        /// Standard deviations by which they must.
        surely: f64 = 3.0, "sigma", Choice;
    }
}

topic! {
    /// Where vision sees tips.
    pub struct Vision in "vision", shown [Fast] {
        /// How much farther or less far than believed a holder may go, in its way, for want of knowing lead and links better.
        /// Frames from far away say as much less of where the tip is here.
        scale: f64 = 2e-3, "1", Choice;
        /// How far chip and holders come apart within a second, by warmth; within more, as the root of it. No faster than 1 um in
        /// 20 s: frames older than some seconds say less of where the tip is now than newer ones.
        warms: f64 = 70e-9, "m/sqrt(s)", Choice;
        /// By what time a holder that moves may lag behind its encoders: its transmission gives way to its load. All frames on the
        /// way lag alike, so that they do not make up for each other.
        late: f64 = 2e-3, "s", Choice;
        /// Over how long a speed is seen.
        speed: f64 = 3.2e-3, "s", Choice;
        /// How near a tip is to come across by what is seen, in the recipe's tolerance: for as many looks as the recipe has each, one after the other.
        /// Axes that stick do not go by a few micrometres as told, and the search that follows covers a camera's own error of tens.
        arrives: [f64; 3] = [1.0, 2.0, 4.0], "1", Choice;
        /// What a camera states of its noise counts as much as so many frames.
        stated: f64 = 16.0, "frames", Choice;
        /// A frame lies on one side of what is believed from so far on: half of the least motion that is to be noticed...
        beside: f64 = 0.5, "sigma", Equation;
        /// ...and tips have moved where the sum of how far frames lie beyond that is more than this: where nothing moves, once in 140,000
        /// frames to either side, by the usual approximation of a mean run.
        moved: f64 = 10.0, "sigma", Choice;
    }
}
