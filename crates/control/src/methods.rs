//! The three ways to get first light through a device that the thesis compares (3.2.1): searches
//! of the whole space that really run on a machine, beside the closed forms of their times.
//!
//! The first two move both fibers and watch the output fiber's photodiode, where light comes only
//! while both are near: the product of two couplings, a search in four dimensions. The third lets
//! the sensing fiber stand in for the output, which leaves two.
//!
//! All sweep across with the micro and creep upward with the macro, as
//! [`Searcher::raster`](crate::search::Searcher::raster) does and for the same reason: a macro that
//! swept 100 um back and forth would spend it winding up its transmissions.

use crate::cell::{AlignmentCell, Reach};
use crate::job::Job;
use crate::outcome::Halt;
use crate::recipe::Recipe;
use crate::search::{Hit, Searcher};
use crate::station::{Station, fine};
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use pigtail_hal::{Channel, Side, Spec};
use pigtail_model::frames::{Chip, Displacement, Macro, Point};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A way to get first light through a device (thesis 3.2.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Method 1: a raster of the input for each point of a grid of the output.
    MacroRaster,
    /// Method 2: the micros scan `Xin`-`Xout` for each `Yin`-`Yout` of the macros.
    MicroRaster,
    /// Method 3: the sensing fiber stands in for the output; a raster of each fiber alone.
    Multimode,
}

impl Method {
    /// All of them, by the thesis's numbers.
    pub const ALL: [Self; 3] = [Self::MacroRaster, Self::MicroRaster, Self::Multimode];

    /// The name that options and documents use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::MacroRaster => "macro-raster",
            Self::MicroRaster => "micro-raster",
            Self::Multimode => "multimode",
        }
    }

    /// Whether one search serves all fibers of a device, rather than each needing its own.
    pub const fn once_a_device(self) -> bool {
        !matches!(self, Self::Multimode)
    }
}

/// Highest frequency at which the micro may sweep, hertz (thesis 3.2).
pub const MICRO_BANDWIDTH: f64 = 100.0;

/// A search may take so long by its closed form, seconds: what would take longer was mistyped.
const LONGEST: f64 = 4.0 * 3600.0;

/// After so many bright places that did not bear a second look, no more are looked at.
const MOST_DISMISSED: usize = 20;

/// What a method is to cover, and how.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Space {
    /// The method.
    pub method: Method,
    /// Width of each fiber's area, `X`, metres.
    pub x: f64,
    /// Height of each fiber's area, `Y`, metres.
    pub y: f64,
    /// Grid spacing, `Delta`, metres.
    pub mesh: f64,
    /// Frequency of the sweep across, `f`, hertz.
    pub frequency: f64,
}

/// Why a machine cannot search a space.
#[derive(Debug, Clone, PartialEq)]
pub enum Unfit {
    /// A key of its datasheet is in the way.
    Machine {
        /// The key.
        key: &'static str,
        /// The value, and what is accepted.
        message: String,
    },
    /// What was asked for is.
    Asked {
        /// `mesh` or `scan-rate`.
        what: &'static str,
        /// The value, and what is accepted.
        message: String,
    },
}

impl Space {
    /// The area and mesh of a recipe's raster, at its scan rate; method 2 at the micro's.
    pub fn new(method: Method, recipe: &Recipe) -> Self {
        let raster = &recipe.raster;
        Self {
            method,
            x: raster.x,
            y: raster.y,
            mesh: raster.mesh,
            frequency: match method {
                Method::MicroRaster => MICRO_BANDWIDTH,
                Method::MacroRaster | Method::Multimode => raster.frequency,
            },
        }
    }

    /// Time to cover the space by its scan rate, seconds: `X Y^2 / (f D^3)` of (3.3) and (3.4),
    /// `Y / (f D)` of (3.5), a fiber.
    pub fn closed_form(&self) -> f64 {
        let raster = self.y / (self.frequency * self.mesh);
        match self.method {
            Method::MacroRaster | Method::MicroRaster => {
                raster * (self.x / self.mesh) * (self.y / self.mesh)
            }
            Method::Multimode => raster,
        }
    }

    /// The same where the photodiode, read `rate` times a second, sets the scan rate, seconds:
    /// `pi T_p X^2 Y^2 / D^4` of (3.3), `pi T_p X Y / D^2` of (3.5).
    pub fn photodiode_limited(&self, rate: f64) -> f64 {
        Self {
            frequency: self.fastest(rate),
            ..*self
        }
        .closed_form()
    }

    /// The scan rate at which a photodiode read `rate` times a second takes one sample a mesh
    /// where the sweep is fastest, hertz: (3.1) and (3.2).
    pub fn fastest(&self, rate: f64) -> f64 {
        self.mesh * rate / (PI * self.x)
    }

    /// The slowest photodiode that can follow the sweep, samples a second. Two percent are
    /// granted, for the thesis rounds: 6283 Hz to 6250, 7.96 Hz to 8.
    pub fn photodiode_rate(&self) -> f64 {
        PI * self.x * self.frequency / (1.02 * self.mesh)
    }

    /// Whether a machine can do it.
    ///
    /// # Errors
    ///
    /// What is in the way, and what would be accepted.
    pub fn check(&self, spec: &Spec) -> Result<(), Unfit> {
        let asked = |what, message| Err(Unfit::Asked { what, message });
        let most = self.x.min(self.y);
        if self.mesh > most {
            return asked(
                "mesh",
                format!(
                    "{} um is wider than the area; accepted is at most {} um",
                    self.mesh * 1e6,
                    most * 1e6
                ),
            );
        }
        if self.frequency > MICRO_BANDWIDTH {
            return asked(
                "scan-rate",
                format!(
                    "{} Hz is more than the micro's bandwidth; accepted is at most \
                     {MICRO_BANDWIDTH} Hz",
                    self.frequency
                ),
            );
        }
        let seconds = self.closed_form();
        if seconds > LONGEST {
            return asked(
                "mesh",
                format!(
                    "{} um at {} Hz would take {:.1} hours; accepted is what takes at most {} hours",
                    self.mesh * 1e6,
                    self.frequency,
                    seconds / 3600.0,
                    LONGEST / 3600.0
                ),
            );
        }
        let (rate, needed) = (spec.photodiode.rate, self.photodiode_rate());
        if rate < needed {
            return Err(Unfit::Machine {
                key: "photodiode.rate",
                message: format!(
                    "{rate} Hz is too slow for {}: {} Hz over {} um would pass more than one mesh \
                     of {} um between two samples; accepted is at least {needed:.0} Hz, which \
                     `servo.rate` ({} Hz) has to be a multiple of",
                    self.method.name(),
                    self.frequency,
                    self.x * 1e6,
                    self.mesh * 1e6,
                    spec.servo.rate
                ),
            });
        }
        Ok(())
    }

    /// Lines across, and up: points of the grid.
    fn points(&self) -> (usize, usize) {
        let points = |way: f64| (way / self.mesh).round().max(1.0) as usize;
        (points(self.x), points(self.y))
    }
}

/// What covering a space came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// Machine time from the start of the search to the last point of the space, the second looks
    /// at bright places apart, seconds.
    pub seconds: f64,
    /// Machine time before it: both fibers placed by vision, seconds.
    pub coarse_seconds: f64,
    /// Machine time in which the sensing fiber found the chip's top, seconds; method 3 only.
    pub sensing_seconds: Option<f64>,
    /// Light samples taken in the search.
    pub samples: usize,
    /// How often the space was covered until light was found: method 3 covers it again with the
    /// sensing fiber aside. More often than once is no part of `seconds`.
    pub passes: u32,
    /// Bright places that did not bear a second look.
    pub dismissed: usize,
    /// What counted as light, volts.
    pub threshold: f64,
    /// The brightest that was seen, volts.
    pub brightest: f64,
    /// Light that bore a second look.
    pub found: Option<Light>,
}

/// Where first light was, and when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// From the start of the search to the light, and the second look that confirmed it, seconds.
    pub seconds: f64,
    /// Its level above the background, volts.
    pub level: f64,
    /// The input fiber from the middle of its area, x and y in the chip's frame, metres.
    pub input: [f64; 2],
    /// The output fiber from the middle of its area; `None` where there was no output fiber.
    pub output: Option<[f64; 2]>,
}

/// Covers a space on a machine that stands at home without fibers: loads them, places them by
/// vision as the recipe says, and searches. Light that is found is looked at twice, and the search
/// goes on to its end, so that both its times are known: until first light, and at the worst.
///
/// [`Space::check`] is to be asked before.
///
/// # Errors
///
/// The machine's fault, or why a fiber could not be placed.
pub fn cover(station: &mut Station, recipe: &Recipe, space: &Space) -> Result<Coverage, Halt> {
    let cell = AlignmentCell::over(station);
    cell.run(covered(&cell, recipe, space))
}

async fn covered(
    cell: &AlignmentCell<'_>,
    recipe: &Recipe,
    space: &Space,
) -> Result<Coverage, Halt> {
    // What the second look takes from the recipe.
    let mut recipe = recipe.clone();
    recipe.raster.x = space.x;
    recipe.raster.y = space.y;
    recipe.raster.mesh = space.mesh;
    let recipe = &recipe;
    let channel = match space.method {
        Method::MacroRaster | Method::MicroRaster => Channel::of_output(0),
        Method::Multimode => Channel::Sensing,
    };
    cell.laser(true)?;
    let mut input = Job::of(recipe, None);
    input.channel = channel;
    let output = Job::of(recipe, Some(0));
    let begin = cell.now();
    cell.announce(space.method.name(), "coarse");
    cell.load(Side::Left, 0).await?;
    let gap = recipe.raster.gap;
    let lowest = |job: &Job<'_>, up: f64| job.port.shifted(job.walk(), up - 0.5 * space.y, 0.0);
    input
        .place(cell, Side::Left, Tip::Fiber, lowest(&input, 0.0), gap)
        .await?;
    let mut coarse_seconds = cell.now() - begin;
    let mut sensing_seconds = None;
    if space.method == Method::Multimode {
        cell.announce(space.method.name(), "sensing");
        input.find_top(cell, recipe.ports.outputs[0]).await?;
        sensing_seconds = Some(cell.now() - begin - coarse_seconds);
    } else {
        cell.load(Side::Right, 0).await?;
        // The grid's points are the middles of its cells.
        let first = lowest(&output, 0.5 * space.mesh);
        output
            .place(cell, Side::Right, Tip::Fiber, first, gap)
            .await?;
        coarse_seconds = cell.now() - begin;
    }
    cell.announce(space.method.name(), "search");
    let searcher =
        Searcher::measure(cell, Side::Left, channel, recipe.raster.significance, 0.5).await?;
    let starts = Side::ALL.map(|side| cell.wanted(side));
    let mut scan = Scan {
        recipe,
        space,
        input,
        searcher,
        starts,
        reaches: Side::ALL.map(|side| cell.micro_reach_x(side).within(space.x, 1.0)),
        begin: cell.now(),
        looking: 0.0,
        coverage: Coverage {
            seconds: 0.0,
            coarse_seconds,
            sensing_seconds,
            samples: 0,
            passes: 1,
            dismissed: 0,
            threshold: searcher.threshold,
            brightest: f64::NEG_INFINITY,
            found: None,
        },
    };
    scan.run(cell).await?;
    for side in Side::ALL {
        cell.move_micro(side, Displacement::ZERO)?;
    }
    Ok(scan.coverage)
}

/// A bright place of both fibers.
#[derive(Debug, Clone, Copy)]
struct Bright {
    /// When, seconds of machine time.
    time: f64,
    input: Hit,
    output: Point<Macro>,
    output_micro: Displacement,
}

/// A search under way.
struct Scan<'r> {
    recipe: &'r Recipe,
    space: &'r Space,
    input: Job<'r>,
    searcher: Searcher,
    /// Where the macros began: the bottom of each area.
    starts: [Point<Macro>; 2],
    /// From where to where the micros sweep.
    reaches: [Reach; 2],
    begin: f64,
    /// Time spent on second looks so far, seconds.
    looking: f64,
    coverage: Coverage,
}

impl Scan<'_> {
    /// The whole space.
    async fn run(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let (across, up) = self.space.points();
        let (rows, columns) = match self.space.method {
            Method::MacroRaster => (up, across),
            Method::MicroRaster => (up, 1),
            Method::Multimode => (1, 1),
        };
        for row in 0..rows {
            let here = self.starts[1].shifted(0.0, row as f64 * self.space.mesh, 0.0);
            for column in 0..columns {
                if row + column > 0 {
                    self.back(cell).await?;
                }
                if row > 0 && column == 0 {
                    self.input.arrive(cell, Side::Right, here).await?;
                }
                let x = match self.space.method {
                    Method::MacroRaster => self.column(column, across),
                    Method::MicroRaster | Method::Multimode => 0.0,
                };
                if let Some(bright) = self.pass(cell, x).await? {
                    self.look(cell, &bright, here).await?;
                }
            }
        }
        self.coverage.seconds = cell.now() - self.begin - self.looking;
        if self.space.method == Method::Multimode {
            self.sidestep(cell).await?;
        }
        Ok(())
    }

    /// The guided light may have passed beside the sensing fiber's core: to either side.
    async fn sidestep(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let step = self.recipe.sensing.sidestep;
        for aside in [step, -step] {
            if self.coverage.found.is_some() {
                break;
            }
            let here = self.starts[1].shifted(aside, 0.0, 0.0);
            self.input.arrive(cell, Side::Right, here).await?;
            self.back(cell).await?;
            self.coverage.passes += 1;
            if let Some(bright) = self.pass(cell, 0.0).await? {
                self.look(cell, &bright, here).await?;
            }
        }
        Ok(())
    }

    /// A point of the output's grid across, as far as its micro reaches.
    fn column(&self, column: usize, across: usize) -> f64 {
        let middle = 0.5 * (across as f64 - 1.0);
        ((column as f64 - middle) * self.space.mesh)
            .clamp(self.reaches[1].low, self.reaches[1].high)
    }

    /// Brings the input back to the bottom of its area, arriving from below. It need not settle:
    /// it goes on upward at once.
    async fn back(&self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let start = self.starts[0];
        cell.move_micro(Side::Left, Displacement::ZERO)?;
        for to in [start.shifted(0.0, -self.recipe.coarse.run_up, 0.0), start] {
            cell.go(Side::Left, to).await?;
        }
        Ok(())
    }

    /// One creep of the input from the bottom of its area to the top, the output's micro at `x` or,
    /// in method 2, scanning too. Returns the brightest that counts as light.
    async fn pass(&mut self, cell: &AlignmentCell<'_>, x: f64) -> Result<Option<Bright>, Halt> {
        let Space {
            y, mesh, frequency, ..
        } = *self.space;
        let micro = self.space.method == Method::MicroRaster;
        // Method 2: a period a line of the output, and one more to bring its micro back.
        let lines = self.space.points().0 as f64;
        let periods = if micro { lines + 1.0 } else { 1.0 };
        let [of_input, of_output] = self.reaches;
        let across = |x: f64| Displacement::new(x, 0.0);
        let output = move |elapsed: f64| {
            let phase = (elapsed.max(0.0) * frequency) % periods;
            across(if phase < 1.0 {
                of_output.at((PI * phase).cos())
            } else {
                of_output.at(2.0 * (phase - 1.0) / lines - 1.0)
            })
        };
        let input = move |elapsed: f64| across(of_input.at((TAU * frequency * elapsed).sin()));
        let lag = cell.caps().groups[fine(Side::Left).0].lag.0;
        cell.start_line(
            Side::Left,
            self.starts[0].shifted(0.0, y, 0.0),
            Some(mesh * frequency / periods),
        )?;
        let step = (TUNING.search.knots * frequency)
            .recip()
            .max(cell.caps().cycle);
        let seconds = (y / mesh + TUNING.search.more_lines) * periods / frequency;
        cell.micro_path(Side::Left, (seconds, step), input)?;
        match self.space.method {
            Method::MacroRaster => cell.move_micro(Side::Right, across(x))?,
            Method::MicroRaster => cell.micro_path(Side::Right, (seconds, step), output)?,
            Method::Multimode => {}
        }
        let mut bright: Option<Bright> = None;
        while cell.is_moving(Side::Left) {
            let Some(volts) = cell.light(self.searcher.channel, f64::INFINITY).await? else {
                continue;
            };
            let seen = &mut self.coverage;
            seen.samples += 1;
            seen.brightest = seen.brightest.max(volts);
            let level = volts - self.searcher.background.mean;
            if volts > self.searcher.threshold && bright.is_none_or(|b| level > b.input.level) {
                // Where the tips were when this light went through them.
                let then = cell.now() - lag;
                bright = Some(Bright {
                    time: cell.now(),
                    input: Hit {
                        endpoint: cell.endpoint(Side::Left),
                        micro: cell.micro_at(Side::Left, then),
                        level,
                    },
                    output: cell.endpoint(Side::Right),
                    output_micro: cell.micro_at(Side::Right, then),
                });
            }
        }
        Ok(bright)
    }

    /// Looks at a bright place a second time, unless light is known already, and leaves the output
    /// at `here`.
    async fn look(
        &mut self,
        cell: &AlignmentCell<'_>,
        bright: &Bright,
        here: Point<Macro>,
    ) -> Result<(), Halt> {
        if self.coverage.found.is_some() || self.coverage.dismissed >= MOST_DISMISSED {
            return Ok(());
        }
        let begin = cell.now();
        let moves_output = self.space.method != Method::Multimode;
        if moves_output {
            cell.move_micro(Side::Right, bright.output_micro)?;
        }
        let mut found = false;
        for around in &self.recipe.raster.retry.around {
            self.input
                .recentre(cell, &self.searcher, &bright.input, *around)
                .await?;
            let level = self.searcher.contrast(cell, self.space.mesh).await?;
            if level > 0.5 * bright.input.level {
                self.coverage.found = Some(self.light(cell, bright, level, cell.now() - begin));
                found = true;
                break;
            }
        }
        if !found {
            self.coverage.dismissed += 1;
        }
        if moves_output {
            self.input.arrive(cell, Side::Right, here).await?;
        }
        self.looking += cell.now() - begin;
        Ok(())
    }

    /// Light where both fibers stand now, after a second look of so many seconds.
    fn light(&self, cell: &AlignmentCell<'_>, bright: &Bright, level: f64, looked: f64) -> Light {
        // From the middle of the area, by what control believes of its directions.
        let from_middle = |side: Side, at: Point<Macro>, micro: Displacement, first: f64| {
            let kinematics = cell.frame(side);
            let middle = self.starts[side.index()].shifted(0.0, 0.5 * self.space.y - first, 0.0);
            let middle: Point<Chip> = kinematics.chip_from_macro(middle);
            let tip = kinematics.chip_from_macro(at.moved(micro));
            [tip.x - middle.x, tip.y - middle.y]
        };
        let (left, right) = (Side::Left, Side::Right);
        Light {
            // Earlier looks at what was none have cost their time too.
            seconds: bright.time - self.begin + looked,
            level,
            input: from_middle(left, cell.endpoint(left), cell.micro(left), 0.0),
            output: (self.space.method != Method::Multimode).then(|| {
                let first = 0.5 * self.space.mesh;
                from_middle(right, bright.output, bright.output_micro, first)
            }),
        }
    }
}
