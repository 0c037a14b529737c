//! The axes' servos.

use super::topic;

topic! {
    /// Axes that swing.
    pub struct AxisSwing in "swing", shown [Fast, Thesis] {
        /// How far beyond its reference an axis must go for a swing: farther than one goes that hunts about its count.
        beyond: u32 = 4, "counts", Choice;
        /// So many ways from one side to the other are no ringing that dies away: one that makes them beyond four counts and had begun at forty
        /// is damped by less than 0.09.
        often: u32 = 8, "ways", Choice;
        /// A way to the other side that takes longer is none of a loop that swings: something else has pushed the axis.
        within: f64 = 0.05, "s", Choice;
        /// By what its gains are made less then, as in commissioning.
        gentler: f64 = 0.8, "1", Choice;
        /// Gains that are less than this share of what they were are not made less: it is not they.
        least: f64 = 0.1, "1", Choice;
        /// An endpoint that turns back by less does not jerk, whatever its encoders' counts make of it: two of them.
        jerks: f64 = 2.6e-6, "m", Choice;
        /// Nor one that takes longer from turn to turn: that is led.
        jerk: f64 = 0.01, "s", Choice;
    }
}
