//! What is to be done: the device's ports and the parameters of the procedure.

mod fast;
mod retry;

use crate::calibration::Calibration;
use crate::kinematics::Kinematics;
pub use fast::{ConicalScan, Fast, Mode, OverTop, Sweep};
use pigtail_hal::spec::OUTPUTS;
use pigtail_hal::{Error, Side, Spec, config, quantity};
use pigtail_model::frames::{Chip, Point};
pub use retry::{Pass, RasterPass, RasterRetry, Retry};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::PI;

/// The content of a recipe file.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The recipe's name.
    pub name: String,
    /// The device's ports in the chip's frame, by design.
    pub ports: Ports,
    /// Placement by vision.
    pub coarse: Coarse,
    /// Finding the chip's top with the sensing fiber.
    pub sensing: Sensing,
    /// The blind search.
    pub raster: Raster,
    /// The nine-point climb.
    pub climb: Climb,
    /// The way to the chip.
    pub approach: Approach,
    /// The last climb.
    #[serde(rename = "final")]
    pub last: Last,
    /// What counts as aligned.
    pub accept: Accept,
    /// The modes of fiber and guides, by design.
    #[serde(default)]
    pub mode: Mode,
    /// The fast procedure.
    #[serde(default)]
    pub fast: Fast,
}

/// The device's ports in the chip's frame, by design.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ports {
    /// The input, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub input: [f64; 3],
    /// The outputs, metres.
    #[serde(with = "quantity::Points::<OUTPUTS, 3>")]
    pub outputs: [[f64; 3]; OUTPUTS],
    /// Angle of the light outside the facets from the z axis towards x, by design, radians. What
    /// is really so is found by climbing.
    #[serde(with = "quantity::Angle")]
    pub exit_angle: f64,
}

impl Ports {
    /// By how much larger z is on the facet of the outputs for so much more in x, by design.
    pub fn slope(&self) -> f64 {
        let [[ax, _, az], [bx, _, bz]] = self.outputs;
        if ax == bx { 0.0 } else { (az - bz) / (ax - bx) }
    }
}

impl Recipe {
    /// Gap of the first look, metres: where a tip may stand farther out of its holder than usual, or farther aside, where
    /// an inclined facet stands out, from farther away.
    pub fn first_look(&self, spec: &Spec) -> f64 {
        /// What is left where a tip stands out, and aside, as far as it may, metres.
        const LEFT: f64 = 50e-6;
        let guard = &spec.guard;
        // Motors go beyond by what their transmissions hide, where that is made up for, and the guard believes that they may hide as much on either side.
        let slope = self.ports.slope();
        let aside = (slope.abs() + guard.steeper(slope)) * (guard.placement + 2.0 * guard.windup);
        self.coarse.far.max(guard.placement + aside + LEFT)
    }
}

/// Placement by vision (thesis 3.2.2).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Coarse {
    /// Gap at which a holder may move sideways, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub clearance: f64,
    /// Gap of the first look, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub far: f64,
    /// Vision frames averaged in a look.
    pub frames: u32,
    /// How near to its place across the chip a tip must be seen, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub tolerance: f64,
    /// How often a tip is looked at and brought nearer, at most.
    #[serde(default = "Coarse::usual_looks")]
    pub looks: u32,
    /// Way from below on every arrival, which leaves the transmissions wound up alike, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub run_up: f64,
}

impl Coarse {
    const fn usual_looks() -> u32 {
        4
    }
}

/// Finding the chip's top with the sensing fiber (thesis 3.2.2).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensing {
    /// How far below the top it starts, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub below: f64,
    /// Speed upward, m/s.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// Share of the brightest level below which the fiber has passed the top.
    #[serde(with = "quantity::Fraction")]
    pub threshold: f64,
    /// How far to either side to try again when no input light is found, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub sidestep: f64,
}

/// The blind search (thesis 3.2): the micro sweeps in x, the macro creeps in y.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Raster {
    /// Width of the area, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub x: f64,
    /// Height of the area, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub y: f64,
    /// Spacing of lines and of samples on them, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub mesh: f64,
    /// Frequency of the sweep, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub frequency: f64,
    /// How much further down to start, for what kinematics and compensation may err by, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub margin: f64,
    /// How much further up to go for what the transmissions hold back, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub overscan: f64,
    /// Gap between facet and tip, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub gap: f64,
    /// Standard deviations above the background that count as light.
    #[serde(with = "quantity::Positive")]
    pub significance: f64,
    /// What is tried again.
    #[serde(default)]
    pub retry: RasterRetry,
}

impl Raster {
    /// The whole height that is searched, metres.
    pub fn height(&self) -> f64 {
        self.margin + self.y + self.overscan
    }

    /// How far below a port it starts, metres.
    pub fn below(&self) -> f64 {
        0.5 * self.y + self.margin
    }
}

/// The nine-point climb (thesis 3.3).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Climb {
    /// Distance of neighbouring points, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub step: f64,
    /// Time at each point, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub dwell: f64,
    /// Time between patterns, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub pause: f64,
    /// Longest climb, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub timeout: f64,
    /// Largest distance of neighbouring points, metres: the distance doubles, up to this, after each pattern whose
    /// brightest point is not its middle, and halves, down to `step`, after each whose is (thesis 3.4). `step`
    /// throughout, if not given.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveLength>")]
    pub widest: Option<f64>,
}

/// The way to the chip (thesis 3.3).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Approach {
    /// Vision frames averaged to know the gap before it.
    pub frames: u32,
    /// Gap at its end, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub gap: f64,
    /// Speed, m/s.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
}

/// The last climb.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Last {
    /// Two looks around the last centre take as long as so many nine-point patterns of the climb.
    pub patterns: u32,
    /// How well the peak must be known, one standard deviation, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub accuracy: f64,
}

/// What counts as aligned.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Accept {
    /// Factor by which the light must have grown on approach.
    #[serde(with = "quantity::Positive")]
    pub growth: f64,
    /// How far the last gap may be from the one that is wanted, metres: a fiber of which that is not all but
    /// certain is not attached.
    #[serde(default = "Accept::usual_gap", with = "quantity::PositiveLength")]
    pub gap: f64,
    /// The same across the light, in x and in y, metres.
    #[serde(default = "Accept::usual_aside", with = "quantity::PositiveLength")]
    pub aside: f64,
}

impl Accept {
    const fn usual_gap() -> f64 {
        2e-6
    }

    const fn usual_aside() -> f64 {
        0.1e-6
    }
}

/// The error of a key that recipes once had says where it is now.
fn moved(mut error: Error) -> Error {
    if ["fast.sweep.lag", "fast.conical_scan.lag", "fast.orbit.lag"].contains(&error.key.as_str()) {
        error.message = String::from(
            "is no longer said by a recipe: how late a photodiode is behind a micro is belief about the machine; accepted is \
                         `geometry.micro.lag` in its `calibration.toml`, or a bench's `groups`",
        );
    }
    error
}

impl Recipe {
    /// Parses a recipe and checks it against the machine that is to run it; `file` is its name in
    /// errors.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range; a port lies outside the workspace; the
    /// raster is faster than the photodiode can follow; or the gaps are in no order.
    pub fn parse(
        file: &str,
        text: &str,
        spec: &Spec,
        calibration: &Calibration,
    ) -> Result<Self, Error> {
        let recipe: Self = config::parse(file, text).map_err(moved)?;
        let error = |key: &str, message: String| Error::new(file, key, message);
        for (key, count, most) in [
            ("coarse.frames", recipe.coarse.frames, 1000),
            ("coarse.looks", recipe.coarse.looks, 100),
            ("approach.frames", recipe.approach.frames, 1000),
            ("final.patterns", recipe.last.patterns, 1000),
        ] {
            if !(1..=most).contains(&count) {
                return Err(error(key, format!("is {count}; accepted is 1 to {most}")));
            }
        }
        let gaps = [
            recipe.approach.gap,
            recipe.raster.gap,
            recipe.coarse.far,
            recipe.coarse.clearance,
        ];
        let keys = [
            "approach.gap",
            "raster.gap",
            "coarse.far",
            "coarse.clearance",
        ];
        for i in 1..gaps.len() {
            if gaps[i - 1] >= gaps[i] {
                return Err(error(
                    keys[i - 1],
                    format!(
                        "{} um is not below `{}`, {} um; accepted is a smaller gap",
                        gaps[i - 1] * 1e6,
                        keys[i],
                        gaps[i] * 1e6
                    ),
                ));
            }
        }
        recipe
            .check_raster(spec)
            .map_err(|message| error("raster.frequency", message))?;
        let retry = recipe.raster.retry.check();
        retry.map_err(|(key, message)| error(key, message))?;
        recipe
            .fast
            .check(&recipe, spec)
            .map_err(|(key, message)| error(key, message))?;
        recipe
            .check_sizes(spec, calibration)
            .map_err(|(key, message)| error(key, message))?;
        recipe
            .check_times(spec)
            .map_err(|(key, message)| error(key, message))?;
        recipe
            .check_ports(spec, calibration)
            .map_err(|(key, message)| error(&key, message))?;
        Ok(recipe)
    }

    /// (3.1) and (3.2): `2 pi f A` may not exceed one mesh a photodiode sample. Two percent are
    /// granted, for the thesis rounds its 7.96 Hz to 8.
    fn check_raster(&self, spec: &Spec) -> Result<(), String> {
        let r = &self.raster;
        let fastest = r.mesh * spec.photodiode.rate / (PI * r.x);
        if r.frequency > 1.02 * fastest {
            return Err(format!(
                "{} Hz over {} um is faster than one sample every {} um; accepted is at most \
                 {fastest:.2} Hz with a photodiode read at {} Hz",
                r.frequency,
                r.x * 1e6,
                r.mesh * 1e6,
                spec.photodiode.rate
            ));
        }
        Ok(())
    }

    fn check_sizes(
        &self,
        spec: &Spec,
        calibration: &Calibration,
    ) -> Result<(), (&'static str, String)> {
        let reach = 2.0 * Kinematics::new(spec, calibration, Side::Left).micro_range_x();
        // The same two percent, for the thesis rounds its 99 um to 100.
        if self.raster.x > 1.02 * reach {
            return Err((
                "raster.x",
                format!(
                    "{} um is more than the micro sweeps; accepted is at most {:.1} um",
                    self.raster.x * 1e6,
                    reach * 1e6
                ),
            ));
        }
        // Vision must not be able to bring a fiber into the chip.
        let vision = &spec.vision;
        let noise = 4.0 * vision.sigma / f64::from(self.approach.frames).sqrt();
        let nearest = vision.accuracy_z + noise;
        if self.approach.gap <= nearest {
            return Err((
                "approach.gap",
                format!(
                    "{} um is within what vision may err by; accepted is more than {:.2} um",
                    self.approach.gap * 1e6,
                    nearest * 1e6
                ),
            ));
        }
        if self.climb.dwell < 1.0 / spec.photodiode.rate {
            return Err((
                "climb.dwell",
                format!(
                    "{} ms is shorter than a light sample takes; accepted is at least {} ms",
                    self.climb.dwell * 1e3,
                    1e3 / spec.photodiode.rate
                ),
            ));
        }
        if self.ports.exit_angle.abs() > PI / 3.0 {
            return Err((
                "ports.exit_angle",
                format!(
                    "{:.1} deg leads past the chip; accepted is -60 to 60 deg",
                    self.ports.exit_angle.to_degrees()
                ),
            ));
        }
        Ok(())
    }

    /// No part may take more than half an hour at the worst: what would was mistyped.
    fn check_times(&self, spec: &Spec) -> Result<(), (&'static str, String)> {
        const MOST: f64 = 1800.0;
        let (c, r, s) = (&self.climb, &self.raster, &self.sensing);
        let pattern = 9.0 * c.dwell + c.pause;
        let height = r.height();
        for (key, seconds) in [
            ("climb.timeout", c.timeout),
            ("climb.dwell", 9.0 * c.dwell * f64::from(self.last.patterns)),
            ("climb.pause", c.pause * f64::from(self.last.patterns)),
            ("final.patterns", pattern * f64::from(self.last.patterns)),
            (
                "coarse.frames",
                f64::from(self.coarse.looks * self.coarse.frames) / spec.vision.rate,
            ),
            (
                "approach.frames",
                f64::from(self.approach.frames) / spec.vision.rate,
            ),
            ("approach.speed", self.raster.gap / self.approach.speed),
            (
                "sensing.speed",
                (s.below + height + spec.sensing_fiber.core) / s.speed,
            ),
            ("raster.mesh", height / (r.mesh * r.frequency)),
        ] {
            if seconds > MOST {
                return Err((
                    key,
                    format!("takes up to {seconds:.0} s; accepted is at most {MOST} s"),
                ));
            }
        }
        Ok(())
    }

    fn check_ports(&self, spec: &Spec, calibration: &Calibration) -> Result<(), (String, String)> {
        let left = Kinematics::new(spec, calibration, Side::Left);
        let right = Kinematics::new(spec, calibration, Side::Right);
        let mut ports = vec![("ports.input".to_owned(), &left, self.ports.input, -1.0)];
        for (k, port) in self.ports.outputs.iter().enumerate() {
            ports.push((format!("ports.outputs[{k}]"), &right, *port, 1.0));
        }
        // What the search needs around a port; vision and fixture may ask for as much again in x.
        let (dx, below) = (
            self.raster.x,
            self.raster.y + self.raster.margin + self.coarse.run_up + self.sensing.below,
        );
        let above = self.raster.y + self.raster.overscan;
        for (key, kinematics, [x, y, z], outward) in ports {
            for (dx, dy, gap) in [
                (dx, above, 0.0),
                (-dx, above, self.coarse.clearance),
                (dx, -below, self.coarse.clearance),
                (-dx, -below, 0.0),
            ] {
                let p = kinematics.macro_from_chip(Point::<Chip>::new(
                    x + dx,
                    y + dy,
                    z + outward * gap,
                ));
                if !kinematics.contains(p) {
                    let half = 0.5e3 * spec.five_bar.workspace;
                    return Err((
                        key,
                        format!(
                            "[{} mm, {} mm, {} mm] with the search around it leaves the workspace: \
                             it would take the endpoint to {:.2}, {:.2}, {:.2} mm from home; \
                             accepted is within {half} mm in x and y and {} mm in z",
                            x * 1e3,
                            y * 1e3,
                            z * 1e3,
                            p.x * 1e3,
                            p.y * 1e3,
                            p.z * 1e3,
                            0.5e3 * spec.z_stage.travel
                        ),
                    ));
                }
            }
        }
        Ok(())
    }
}
