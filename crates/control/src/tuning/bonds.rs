//! The bond, and fibers that are held.

use super::topic;

topic! {
    /// The bond, and whether a fiber is believed.
    pub struct Bond in "bond", shown [Fast, Thesis, Bench] {
        /// Of being outside a tolerance, from which on a fiber is not believed.
        unsure: f64 = 1e-4, "probability", Choice;
        /// Share of the time for which a fiber has to be held by which a bond may have set: what is stated is the most, and what shakes averages
        /// out over as long as it really took.
        sooner: f64 = 0.5, "1", Choice;
        /// For how long light is looked at once a fiber is attached, at first.
        look: f64 = 0.008, "s", Choice;
        /// Share of its light that may be missing then, beside noise.
        less: f64 = 0.003, "1", Choice;
        /// So many times as much as it differs by from turn to turn the light may differ from one look to the other, over a bond's
        /// time: 4.5 standard deviations of a wandering laser.
        flicker: f64 = 7.0, "1", Equation;
        /// Standard deviations of a sample while a bond sets that are noise.
        bonded_noise: f64 = 6.0, "sigma", Choice;
        /// Standard deviations of what is missing that are noise.
        noise: f64 = 4.5, "sigma", Choice;
        /// Standard deviations by which light may be missing before it is looked at for longer.
        doubted: f64 = 3.0, "sigma", Choice;
        /// Up to so many times as long.
        longer: usize = 16, "1", Choice;
        /// On a bench without a camera, share of the light that may be missing once a fiber is attached, beside noise.
        taught_less: f64 = 0.01, "1", Choice;
    }
}

topic! {
    /// Fibers that are held at their peaks while adhesive cures.
    pub struct Hold in "hold", shown [Trays] {
        /// How fast a fiber drifts against its chip along an axis, standard deviation: each of both by 0.01 um/s, as a bracket does
        /// of 10 um/K at 0.1 K a minute.
        drifts: f64 = 0.014e-6, "m/s", Choice;
        /// With fewer places, what is seen is noise.
        turns: usize = 12, "turns", Choice;
        /// Radius of the circles, of that of the fast procedure: they only have to keep what is there.
        smaller: f64 = 0.6, "1", Choice;
        /// Share of the way to where a turn has seen the peak that is gone: turns are noisy, and there are many.
        gain: f64 = 0.3, "1", Choice;
        /// Until a circle goes on as it does from then on.
        begins: u32 = 5, "turns", Choice;
        /// Of the time of a turn, the other one of two that circle at once.
        slower: f64 = 1.5, "1", Choice;
        /// Parts of a look whose means are compared.
        parts: usize = 8, "1", Choice;
    }
}
