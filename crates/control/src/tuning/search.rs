//! From the dark to first light and to a peak that is within reach.

use super::topic;

/// How carefully a peak is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Care {
    /// Time of a reading of the light, seconds.
    pub seconds: f64,
    /// Radius of the pattern in widths of the light.
    pub radius: f64,
    /// How far a peak may be from where it was, metres...
    pub near: f64,
    /// ...and share of the brightest light so far that must be there.
    pub bright: f64,
    /// Patterns at least...
    pub least: u32,
    /// ...and whether it is an end not to have found it after the most patterns.
    pub must: bool,
}

topic! {
    /// Searches for light.
    pub struct Search in "search", shown [Fast, Thesis] {
        /// How long a line stays at either end.
        held: f64 = 0.5, "samples", Choice;
        /// Places on a way back that the micro goes straight between.
        back: u32 = 10, "1", Choice;
        /// So many more than there is height for are told to the micro: the macro sets out slowly.
        more_lines: f64 = 8.0, "lines", Choice;
        /// A way over which a spot is seen; at the usual speed that is two samples at most.
        wide: f64 = 12e-6, "m", Choice;
        /// What stands out by this share of what counts as light may be some: of a few hundred samples none does by chance, nineteen
        /// times of twenty.
        perhaps: f64 = 0.75, "1", Equation;
        /// Height of the band around it that is swept once more...
        band: f64 = 24e-6, "m", Choice;
        /// ...with so many lines more...
        few_lines: f64 = 2.0, "lines", Choice;
        /// ...so many times more slowly.
        closely: f64 = 3.0, "1", Choice;
        /// Over which the background is followed.
        followed: f64 = 50.0, "samples", Choice;
        /// Share of what a micro gets to that a line uses.
        sure: f64 = 0.99, "1", Choice;
        /// Share of the gap that it may come nearer by where it swings along an inclined facet...
        nearer: f64 = 0.7, "1", Choice;
        /// ...and of how far a holder may have it from where it should be: who guards the machine compares frames.
        swings: f64 = 0.2, "1", Choice;
        /// How far beyond the end of a line a peak is expected whose light was brightest there.
        beyond: f64 = 0.5, "widths", Choice;
        /// Light of less than so many times what counts as light is looked at once more on the approach.
        doubtful: f64 = 2.5, "1", Choice;
        /// As is light of less than so many times the scattered light around it, which fluctuates.
        scattered: f64 = 5.0, "1", Choice;
        /// For so long, in which it does not by chance stay as bright as a peak would.
        doubting: u64 = 3, "turns", Choice;
        /// So much less light is asked for where nobody has measured how light spreads: modes twice as wide, squared, come near to
        /// it. What does not grow is an eighth of what it seemed to be.
        unlike: f64 = 0.5, "1", Choice;
        /// Places of a sinusoid that a micro goes straight between, each period.
        knots: f64 = 32.0, "1", Choice;
        /// How long a micro takes that is sent aside with nothing to be seen there yet: over many periods of any resonance, so that it
        /// does not ring, however little it is damped. The macro takes longer to come there.
        glide: f64 = 4.0, "settlings of the datasheet", Choice;
        /// Places that it goes straight between.
        glides: f64 = 40.0, "1", Choice;
        /// Share of the light that was found which must still be there after a climb.
        still_there: f64 = 0.5, "1", Choice;
        /// How long light that was found is looked at, and what is beside it.
        contrast: f64 = 0.1, "s", Choice;
        /// How often each: the background wanders.
        contrast_looks: u32 = 2, "1", Choice;
        /// Of the small raster around light that has slipped away.
        frequency: f64 = 20.0, "Hz", Choice;
        /// Light whose mean is taken on the way over the chip's top: scattered light fluctuates.
        edge: usize = 5, "samples", Choice;
        /// For how long the sensing fiber goes across the light that comes out of the chip.
        centring: f64 = 0.8, "s", Choice;
        /// What is averaged on that way.
        centring_window: usize = 15, "samples", Choice;
    }
}

topic! {
    /// What photodiodes say in the dark, and at the chip's top.
    pub struct DarkLook in "dark", shown [Fast, Bench] {
        /// About which what wanders slowly is as good as a straight line.
        straight: usize = 50, "samples", Choice;
        /// A mean and a spread are taken from so many, at least.
        least: usize = 4, "samples", Equation;
        /// For how long what measures light remembers the laser.
        forgotten: u32 = 10, "samples", Choice;
        /// What is looked at together on the way over the top.
        together: usize = 3, "samples", Choice;
        /// Share of the light that is as good as none: of a core's disc that is all but above the edge.
        none: f64 = 0.05, "1", Choice;
        /// On top, for noise.
        noise: f64 = 3.0, "sigma", Choice;
        /// A short look sees this share of a slow fluctuation, about.
        short: f64 = 0.67, "1", Choice;
        /// In which photodiodes forget what the laser gave before: the last is all of what it gives now.
        forgets_power: u32 = 2, "turns", Choice;
        /// Light of more than this share of a photodiode's range has the laser lowered: a laser wanders, and a peak is not known
        /// well from afar.
        bright: f64 = 0.7, "1", Choice;
        /// To this share.
        dimmed: f64 = 0.5, "1", Choice;
        /// How fast a sensing fiber goes down to look for the chip's top: so slowly that its light does not lag behind.
        down: f64 = 200e-6, "m/s", Choice;
        /// Longest wait for vision to see a tip well.
        patience: f64 = 1.0, "s", Choice;
    }
}

topic! {
    /// Peaks that a micro does not reach, and how far it goes.
    pub struct Reach in "reach", shown [Fast] {
        /// Steps in which a macro that has not gone where it was told to takes over what the micro would not reach, at most.
        steps: usize = 12, "1", Choice;
        /// How long they are.
        step: f64 = 0.7, "widths", Choice;
        /// Share of its range that a micro can be relied on to have.
        sure: f64 = 0.93, "1", Choice;
        /// For the servo to come to rest.
        rest: f64 = 0.02, "s", Choice;
        /// How far the macro goes aside while a micro's ways are measured: the farther, the better they are known, of which there
        /// are some tens of micrometres.
        way: f64 = 16e-6, "m", Choice;
        /// In so many steps: what its transmissions hide of them the circles have to follow.
        way_steps: u32 = 4, "1", Choice;
        /// How often it goes around.
        rounds: usize = 4, "1", Choice;
        /// At each place that count.
        turns: usize = 4, "turns", Choice;
        /// Share of the light that was seen in passing which a peak has at least: a fluctuation is gone by then.
        seen: f64 = 0.6, "1", Choice;
    }
}

topic! {
    /// Both fibers of a guide, held at their peaks while a machine is commissioned.
    pub struct Pair in "pair", shown [Commissioned] {
        /// How well one turn at the chip has to know the input's peak, standard deviation, by its light at the gap of a search, for the
        /// sensing fiber to see enough of it: where no turn knows it as well as the last ones are to, they take ever longer.
        dim: f64 = 1.0, "accuracies", Choice;
        /// The same where light is to tell the gap, too: widths take more of it.
        dim_for_gap: f64 = 0.5, "accuracies", Choice;
        /// Tolerances are so many times as wide where nothing is attached: light is to be bright and steep, not known to be at its best.
        roughly: f64 = 5.0, "1", Choice;
        /// Tips are watched for so many times as long as wanted, at most, and gaps looked at so often, while what they are to tell is not known.
        times: usize = 6, "1", Choice;
        /// A tip that rests while another one is looked at by the light of both comes back to its peak after so long: machines that warm take it a tenth of
        /// a micrometre away by then.
        rests: f64 = 1.0, "s", Choice;
    }
}

topic! {
    /// The thesis's nine-point climb.
    pub struct NinePointClimb in "climb", shown [Thesis] {
        /// Patterns whose centres are averaged to judge whether a climb still gets anywhere.
        window: usize = 10, "patterns", Choice;
        /// After so many times as long as the recipe's patterns take an average that is not sure yet begins again.
        restart: f64 = 8.0, "1", Choice;
        /// So many deviations of its noise beside what it should be a curvature is another one: what bends it was seen too early.
        otherwise: f64 = 3.0, "1", Choice;
        /// How long a micro of which it was measured by when it comes to rest is left to itself at a point of the last patterns, of that time: a seventh
        /// of a step is left then.
        rests: f64 = 0.4, "1", Choice;
        /// How much of what the two ways around differ by from their middle is left of it where both count as much: mirrored patterns leave a
        /// tip as far aside on either side, but for what bends the more the farther it is.
        mirrored: f64 = 0.25, "1", Choice;
    }
}

topic! {
    /// Alignment without a micro.
    pub struct Nudge in "nudge", shown [MacroOnly] {
        /// Distance of the search's columns, in widths of the light at the search's gap.
        pitch: f64 = 1.6, "widths", Choice;
        /// Speed along a column.
        speed: f64 = 3e-3, "m/s", Choice;
        /// Speed of the second look.
        slow: f64 = 0.4e-3, "m/s", Choice;
        /// A second look goes so far to both sides of where light was seen.
        around: f64 = 40e-6, "m", Choice;
        /// How far an endpoint moves back, at most, until its transmissions are relaxed.
        most_back: f64 = 60e-6, "m", Choice;
        /// The same at first.
        first_back: f64 = 20e-6, "m", Choice;
        /// Steps of the approach.
        step: f64 = 6e-6, "m", Choice;
        /// What a fit looks back on at most.
        recent: usize = 13, "readings", Choice;
        /// Time of a reading of the light.
        look: f64 = 0.016, "s", Choice;
        /// Share of the brightest light that is still asked for a pattern later.
        fade: f64 = 0.9996, "1", Choice;
        /// In one place, at most.
        patterns: u32 = 60, "patterns", Choice;
        /// Share of what pulses went less far back than forth that is believed.
        learned: f64 = 0.3, "1", Choice;
        /// The most that they may differ by.
        most_lean: f64 = 0.4, "1", Choice;
        /// How carefully a peak is looked for at the gap of the search.
        first: Care = Care { seconds: 0.016, radius: 0.35, near: 0.8e-6, bright: 0.8, least: 1, must: false }, "Care", Choice;
        /// On the way to the chip.
        approach: Care = Care { seconds: 0.016, radius: 0.3, near: 0.5e-6, bright: 0.9, least: 1, must: false }, "Care", Choice;
        /// At the chip. The pattern is small: what pulses do forward and backward differs by up to a quarter, and a fit takes a
        /// quarter of its radius for a way of the peak. The light's noise would allow half of it.
        last: Care = Care { seconds: 0.04, radius: 0.15, near: 0.12e-6, bright: 0.9982, least: 8, must: true }, "Care", Choice;
    }
}
