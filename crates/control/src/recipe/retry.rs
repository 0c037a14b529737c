//! What is tried again, how often and how, before a fiber is given up: data of a recipe.

use pigtail_hal::quantity;
use schemars::JsonSchema;
use serde::Deserialize;

/// Whatever is tried again, it is not more often than that.
const MOST: u32 = 100;

/// What is tried again, and how often, before a fiber is given up.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Retry {
    /// The passes of a search, one after the other. An output, which no sensing fiber sees, has no passes that differ in where that
    /// stands.
    pub passes: Vec<Pass>,
    /// How long the passes of one fiber may have taken for another to begin, seconds: lines of micros that swing long take minutes.
    #[serde(with = "quantity::PositiveTime")]
    pub longest: f64,
    /// Bright places that were no peak, at most, until a pass ends.
    pub dismissed: u32,
    /// How often a peak that is not come to is circled once more...
    pub centre: u32,
    /// ...to be known so many times less well each time.
    #[serde(with = "quantity::Positive")]
    pub wider: f64,
    /// Radii of the circles on which light is looked for that was there and is not where it was to be, in widths of its peak: the first where
    /// it may have been a little aside, all of them where the macro has gone aside since, of which its transmissions hide some.
    pub around: Vec<f64>,
    /// How often the coarse group takes over at one gap what a fine group would not reach, on a bench without a camera.
    pub handed_over: u32,
    /// How often a micro's ways are measured once more that could not be.
    pub ratio: u32,
    /// How often a fiber whose place or gap was not sure at last is tried once more from its search on: it may have been a mishap, but what
    /// shakes will shake at every try. What vision does not know of a gap it never will; what light has told it may tell better.
    pub unsure: u32,
    /// How often the last turns are begun...
    pub last_turns: u32,
    /// ...how well the peak is to be known each time, of the time before, where that may make a fiber sure...
    #[serde(with = "quantity::Fraction")]
    pub better: f64,
    /// ...how often a gap is corrected before a look from near...
    pub gap: u32,
    /// ...how often once more where what is missing can be known better: a dim peak takes as long as it takes...
    pub patience: u32,
    /// ...and how often where only the light at rest is not what circles have foreseen.
    pub resting: u32,
}

/// One pass of a search.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Pass {
    /// How far to the side of where the light is expected, in widths of the area.
    pub aside: f64,
    /// Its own width, in widths of the area.
    #[serde(with = "quantity::Positive")]
    pub width: f64,
    /// Its height, in heights of the area.
    #[serde(with = "quantity::Positive")]
    pub height: f64,
    /// Its lines' distance, of the usual one.
    #[serde(with = "quantity::Positive")]
    pub spacing: f64,
    /// How many times slower than usual its lines are.
    #[serde(with = "quantity::Positive")]
    pub slow: f64,
    /// Where the sensing fiber stands meanwhile, in its sidesteps.
    pub sensing: f64,
}

/// The whole area, as fast as usual.
const WHOLE: Pass = Pass {
    aside: 0.0,
    width: 1.0,
    height: 1.0,
    spacing: 1.0,
    slow: 1.0,
    sensing: 0.0,
};

impl Default for Pass {
    fn default() -> Self {
        WHOLE
    }
}

/// What the first pass has missed is most likely at the edges of what vision can say, or too dim there: beside the sensing fiber, or
/// between two lines; or farther up or down than was believed, which no camera sees, or aside, where it is wrong; or more than one of these. After the last one the thesis's procedure has its turn.
impl Default for Retry {
    fn default() -> Self {
        let edge = |aside| Pass {
            aside,
            width: 0.5,
            ..WHOLE
        };
        let tall = |aside| Pass {
            aside,
            height: 2.5,
            ..WHOLE
        };
        let slow = |slow, sensing| Pass {
            spacing: 0.6,
            slow,
            sensing,
            ..WHOLE
        };
        let tall_and_slow = |aside, sensing| Pass {
            aside,
            height: 2.5,
            ..slow(8.0, sensing)
        };
        Self {
            passes: vec![
                WHOLE,
                edge(0.35),
                edge(-0.35),
                slow(1.5, 0.0),
                tall(0.0),
                slow(8.0, 0.0),
                tall(0.8),
                tall(-0.8),
                slow(8.0, 1.0),
                slow(8.0, -1.0),
                tall_and_slow(0.0, 0.0),
                tall_and_slow(0.0, 1.0),
                tall_and_slow(0.0, -1.0),
                tall_and_slow(0.6, 0.0),
                tall_and_slow(-0.6, 0.0),
            ],
            longest: 600.0,
            dismissed: 5,
            centre: 2,
            wider: 2.0,
            around: vec![1.5, 2.5, 3.5, 4.5],
            handed_over: 4,
            ratio: 2,
            unsure: 1,
            last_turns: 3,
            better: 0.6,
            gap: 3,
            patience: 8,
            resting: 6,
        }
    }
}

impl Retry {
    /// Whether it makes sense.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        for (key, count, least) in [
            ("fast.retry.last_turns", self.last_turns, 1),
            ("fast.retry.handed_over", self.handed_over, 1),
            ("fast.retry.centre", self.centre, 0),
            ("fast.retry.unsure", self.unsure, 0),
            ("fast.retry.gap", self.gap, 0),
            ("fast.retry.dismissed", self.dismissed, 0),
            ("fast.retry.ratio", self.ratio, 0),
            ("fast.retry.patience", self.patience, 0),
            ("fast.retry.resting", self.resting, 0),
        ] {
            if !(least..=MOST).contains(&count) {
                let why = format!("{count}; accepted are {least} to {MOST}");
                return Err((key, why));
            }
        }
        if !(0.05..=1.0).contains(&self.better) {
            let why = format!("{}; accepted are 0.05 to 1", self.better);
            return Err(("fast.retry.better", why));
        }
        if !(1.0..=10.0).contains(&self.wider) {
            let why = format!("{}; accepted are 1 to 10", self.wider);
            return Err(("fast.retry.wider", why));
        }
        let radius = |radius: &f64| (0.1..=10.0).contains(radius);
        if self.around.is_empty() || !self.around.iter().all(radius) {
            let why = format!(
                "{:?}; accepted are radii of 0.1 to 10 widths, one at least",
                self.around
            );
            return Err(("fast.retry.around", why));
        }
        let key = "fast.retry.passes";
        if self.passes.first().is_none_or(|first| first.sensing != 0.0) {
            let why = "has no first pass under a sensing fiber that stands straight; accepted is one \
                       with `sensing = 0`";
            return Err((key, why.to_owned()));
        }
        for (k, pass) in self.passes.iter().enumerate() {
            for (what, value, (least, most)) in [
                ("aside", pass.aside, (-1.0, 1.0)),
                ("width", pass.width, (0.05, 1.0)),
                ("height", pass.height, (0.05, 10.0)),
                ("spacing", pass.spacing, (0.05, 2.0)),
                ("slow", pass.slow, (0.1, 100.0)),
                ("sensing", pass.sensing, (-2.0, 2.0)),
            ] {
                if !(least..=most).contains(&value) {
                    let why = format!(
                        "pass {}, `{what}`: {value}; accepted are {least} to {most}",
                        k + 1
                    );
                    return Err((key, why));
                }
            }
        }
        Ok(())
    }
}

/// What of a raster is tried again before a fiber is given up (thesis 3.2).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RasterRetry {
    /// The passes, one after the other. An output, which no sensing fiber sees, has no passes that differ in where that stands.
    pub passes: Vec<RasterPass>,
    /// How much farther down all passes but the first begin, in meshes: between the lines of the first.
    #[serde(with = "quantity::Fraction")]
    pub between: f64,
    /// How far around a bright place light is looked for that has slipped away, in meshes, one after the other, before the place is
    /// dismissed.
    pub around: Vec<f64>,
    /// Bright places that did not bear a second look, at most: with more there is more scattered light than a search can live with.
    pub dismissed: u32,
}

/// One pass of a raster.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RasterPass {
    /// How far to the side of where the light is expected, in widths of the area.
    pub aside: f64,
    /// Where the sensing fiber stands meanwhile, in its sidesteps.
    pub sensing: f64,
}

/// The guided light may have passed beside the sensing fiber's core, to either side; or beside the area, for piezos without compensation do not
/// sweep as far as they are told.
impl Default for RasterRetry {
    fn default() -> Self {
        let pass = |sensing, aside| RasterPass { aside, sensing };
        Self {
            passes: vec![
                pass(0.0, 0.0),
                pass(1.0, 0.0),
                pass(-1.0, 0.0),
                pass(0.0, 0.25),
                pass(0.0, -0.25),
                pass(1.0, 0.25),
                pass(-1.0, -0.25),
            ],
            between: 0.5,
            around: vec![3.0, 6.0],
            dismissed: 5,
        }
    }
}

impl RasterRetry {
    /// Whether it makes sense.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        if self.dismissed > MOST {
            let why = format!("{}; accepted are 0 to {MOST}", self.dismissed);
            return Err(("raster.retry.dismissed", why));
        }
        let around = |meshes: &f64| (1.0..=100.0).contains(meshes);
        if self.around.is_empty() || !self.around.iter().all(around) {
            let why = format!(
                "{:?}; accepted are 1 to 100 meshes, one at least",
                self.around
            );
            return Err(("raster.retry.around", why));
        }
        let key = "raster.retry.passes";
        if self
            .passes
            .first()
            .is_none_or(|first| *first != RasterPass::default())
        {
            let why = "do not begin with the area as it is; accepted is a first pass with `aside = 0` and `sensing = 0`";
            return Err((key, why.to_owned()));
        }
        for (k, pass) in self.passes.iter().enumerate() {
            for (what, value, most) in [("aside", pass.aside, 1.0), ("sensing", pass.sensing, 2.0)]
            {
                if !(-most..=most).contains(&value) {
                    let why = format!(
                        "pass {}, `{what}`: {value}; accepted are -{most} to {most}",
                        k + 1
                    );
                    return Err((key, why));
                }
            }
        }
        Ok(())
    }
}
