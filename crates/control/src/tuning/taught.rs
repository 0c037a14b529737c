//! Benches without a camera.

use super::topic;

topic! {
    /// Alignment without a camera.
    pub struct TaughtBench in "taught", shown [Bench] {
        /// Width of the light that is searched for, in standard deviations of where it may be.
        wide: f64 = 2.5, "sigma", Choice;
        /// A look at the light.
        look: usize = 12, "samples", Choice;
        /// A look at how steady the light at its peak is.
        steady: usize = 40, "samples", Choice;
        /// A look at the dark.
        dark: usize = 50, "samples", Choice;
        /// Standard deviations of a mean above the dark that are light: by chance once in ten million looks.
        significant: f64 = 6.0, "sigma", Equation;
        /// A look at a place where light may be.
        first_look: usize = 4, "samples", Choice;
        /// Distance of the places that are looked at.
        pitch: f64 = 0.9, "widths", Choice;
        /// How far from where it was taught a peak is looked for.
        far: f64 = 3.3, "sigma", Choice;
        /// Share of its range to which a fine group is used before the coarse one helps.
        room: f64 = 0.5, "1", Choice;
        /// From one gap of the approach to the next.
        nearer: f64 = 0.6, "1", Choice;
        /// Share of a gap that is closed in one turn at most: the peak is found anew meanwhile.
        closing: f64 = 0.15, "1", Choice;
        /// Gap at which fibers are loaded.
        clear: f64 = 0.5e-3, "m", Choice;
        /// How well a peak is to be known, where the recipe's accuracy is finer.
        known: f64 = 0.03, "widths", Choice;
        /// Turns around the peak, at least: fewer do not tell how they scatter.
        turns: f64 = 8.0, "turns", Choice;
        /// For how long the light is watched at rest, at least.
        looked_at: usize = 4, "turns", Choice;
        /// What goes slowly around from turn to turn makes a line through as many turns as there are at least lead so much farther
        /// aside, two turns ahead, where it goes around at the worst rate.
        leads: f64 = 2.0, "1", Equation;
        /// Standard deviations that noise of one colour is above its mean by chance.
        chance: f64 = 2.0, "sigma", Choice;
        /// Share of a group's range that circles take.
        circle: f64 = 0.3, "1", Choice;
    }
}

topic! {
    /// What a bench's light tells of its groups.
    pub struct Lines in "lines", shown [Bench] {
        /// Light on a line over the peak.
        samples: f64 = 16.0, "samples", Choice;
        /// How far to either side of it a line goes.
        half: f64 = 1.1, "widths", Choice;
        /// How much farther: by then it goes evenly, and is not yet at rest.
        beyond: f64 = 0.1, "widths", Choice;
        /// Lines to and fro that lag and width are taken from.
        lines: usize = 12, "1", Choice;
        /// Those that a place is taken from.
        few: usize = 4, "1", Choice;
        /// Those of a coarse group, whose screw wanders.
        many: usize = 24, "1", Choice;
        /// From how far a place is come to, by the datasheet.
        run: f64 = 3.0, "backlashes", Choice;
        /// The same at least.
        least_run: f64 = 5e-6, "m", Choice;
        /// How often a peak is looked for that is beside where it was looked for.
        looks: usize = 4, "1", Choice;
        /// How often a backlash is measured.
        turned: usize = 6, "1", Choice;
        /// Places at which the coarse group stands, to either side.
        places: i32 = 3, "1", Choice;
        /// Share of the fine group's range to which the coarse one goes aside for it to follow.
        follows: f64 = 0.6, "1", Choice;
        /// Light below this share of the brightest tells next to nothing of a Gaussian's shape, and most of what is beside it.
        dim: f64 = 0.15, "1", Choice;
        /// Tangent of the angle of the light below which z does not move the peak enough to be told.
        steep: f64 = 0.05, "1", Choice;
        /// Share of its range that an axis goes forth and back.
        way: f64 = 0.1, "1", Choice;
    }
}
