//! The searches for first light that the thesis compares (3.2.1), run on the twin, and the document
//! that sets their measured times beside the closed forms.

use pigtail_control::methods::{self, Coverage, Light, Space, Unfit};
use pigtail_control::station::Observer;
use pigtail_hal::Error;
use pigtail_numerics::rounded;
use pigtail_session::first_light::FirstLight;
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use serde::Serialize;
use std::time::Instant;

/// A search for first light, as the command line names it.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum Method {
    /// Method 1: a raster of the input for each point of a grid of the output, (3.3)
    MacroRaster,
    /// Method 2: both micros scan for each height of both macros, (3.4)
    MicroRaster,
    /// Method 3: the sensing fiber stands in for the output, (3.5)
    Multimode,
}

impl From<Method> for methods::Method {
    fn from(method: Method) -> Self {
        match method {
            Method::MacroRaster => Self::MacroRaster,
            Method::MicroRaster => Self::MicroRaster,
            Method::Multimode => Self::Multimode,
        }
    }
}

/// What `align --method` prints as JSON, and a row of `plan`. Keys are a contract: more may come,
/// none changes its name or meaning. The same seed gives the same values, `wall_seconds` apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchDocument {
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// The method: `macro-raster`, `micro-raster` or `multimode`.
    pub method: &'static str,
    /// The seed of machine, device, fixture and noise.
    pub seed: u64,
    /// Width and height of each fiber's area, X and Y, micrometres.
    pub area_um: [f64; 2],
    /// Grid spacing, micrometres.
    pub mesh_um: f64,
    /// Frequency of the sweep across, f, hertz.
    pub scan_hz: f64,
    /// How often the photodiodes are read, hertz.
    pub photodiode_hz: f64,
    /// Time to cover the space by the scan rate: `X Y^2 / (f D^3)`, (3.3) and (3.4);
    /// `Y / (f D)`, (3.5), a fiber.
    pub closed_form_seconds: f64,
    /// The same were the scan rate what the photodiode allows: `pi T_p X^2 Y^2 / D^4`, (3.3);
    /// `pi T_p X Y / D^2`, (3.5).
    pub photodiode_limited_seconds: f64,
    /// Machine time in which the twin really covered the whole space, the second looks at bright
    /// places apart; `null` where no search could begin.
    pub measured_seconds: Option<f64>,
    /// `measured_seconds` a fiber: methods 1 and 2 serve a whole device.
    pub measured_seconds_per_fiber: Option<f64>,
    /// Whether light was found that bore a second look.
    pub found: bool,
    /// Machine time from the start of the search until then; `null` unless found.
    pub found_seconds: Option<f64>,
    /// Where; `null` unless found.
    pub found_at: Option<Place>,
    /// Light samples taken in the search.
    pub samples: usize,
    /// How often the area was covered until light was found: method 3 does so again with the
    /// sensing fiber aside. Once is what `measured_seconds` tells.
    pub passes: u32,
    /// Bright places that did not bear a second look.
    pub dismissed: usize,
    /// What counted as light, volts; `null` where no search could begin.
    pub threshold_v: Option<f64>,
    /// The brightest that was seen, volts; `null` where no search could begin.
    pub brightest_v: Option<f64>,
    /// Machine time of the placement by vision before the search, seconds.
    pub coarse_seconds: Option<f64>,
    /// Machine time in which the sensing fiber found the chip's top; method 3 only.
    pub sensing_seconds: Option<f64>,
    /// Why no search could begin; empty where it did.
    pub detail: String,
    /// The program's version.
    pub version: &'static str,
    /// Time that the simulation took, seconds of a clock on the wall.
    pub wall_seconds: f64,
}

/// Where first light was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Place {
    /// The light above the background, volts.
    pub level_v: f64,
    /// The input fiber from the middle of its area, x and y in the chip's frame, micrometres.
    pub input_um: [f64; 2],
    /// The output fiber from the middle of its area; `null` in method 3, which has none yet.
    pub output_um: Option<[f64; 2]>,
}

/// Whether the setup's machine can search a space.
///
/// # Errors
///
/// The datasheet's key or the option that is in the way, its value and what is accepted.
pub fn check(setup: &Setup, space: &Space) -> Result<(), Error> {
    space.check(&setup.rig.spec).map_err(|unfit| match unfit {
        Unfit::Machine { key, message } => {
            // The datasheet is what is read first of a rig.
            let file = setup
                .rig
                .hashes
                .first()
                .map_or("machine.toml", |(name, _)| name);
            Error::new(file, key, message)
        }
        Unfit::Asked { what, message } => Error::new(format!("--{what}"), "", message),
    })
}

/// Covers a space on the twin that `seed` draws. [`check`] is to be asked before.
///
/// # Errors
///
/// When the plant cannot be built, or the machine has a fault. That no light is found, or that a
/// fiber cannot be placed, is no error: the document says so.
pub fn run(
    setup: &Setup,
    space: &Space,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<SearchDocument, Ended> {
    let start = Instant::now();
    let job = FirstLight { space: *space };
    let (coverage, detail) = match setup.run(&job, seed, observer) {
        Ok(coverage) => (Some(coverage), String::new()),
        Err(Ended::Outcome(outcome)) => (None, outcome.to_string()),
        Err(ended) => return Err(ended),
    };
    Ok(document(
        setup,
        space,
        seed,
        coverage.as_ref(),
        detail,
        start,
    ))
}

fn document(
    setup: &Setup,
    space: &Space,
    seed: u64,
    coverage: Option<&Coverage>,
    detail: String,
    start: Instant,
) -> SearchDocument {
    let rate = setup.rig.spec.photodiode.rate;
    let seconds = |value: f64| rounded(value, 1e-4);
    let volts = |value: f64| rounded(value, 1e-6);
    let measured = coverage.map(|c| c.seconds);
    let fibers = if space.method.once_a_device() {
        pigtail_control::job::PORTS.len() as f64
    } else {
        1.0
    };
    let found = coverage.and_then(|c| c.found);
    SearchDocument {
        rig: setup.rig.name.clone(),
        recipe: setup.rig.recipe_name.clone(),
        method: space.method.name(),
        seed,
        area_um: [space.x, space.y].map(|way| rounded(way * 1e6, 1e-6)),
        mesh_um: rounded(space.mesh * 1e6, 1e-6),
        scan_hz: rounded(space.frequency, 1e-6),
        photodiode_hz: rate,
        closed_form_seconds: seconds(space.closed_form()),
        photodiode_limited_seconds: seconds(space.photodiode_limited(rate)),
        measured_seconds: measured.map(seconds),
        measured_seconds_per_fiber: measured.map(|all| seconds(all / fibers)),
        found: found.is_some(),
        found_seconds: found.map(|light| seconds(light.seconds)),
        found_at: found.map(Place::of),
        samples: coverage.map_or(0, |c| c.samples),
        passes: coverage.map_or(0, |c| c.passes),
        dismissed: coverage.map_or(0, |c| c.dismissed),
        threshold_v: coverage.map(|c| volts(c.threshold)),
        brightest_v: coverage.map(|c| volts(c.brightest)),
        coarse_seconds: coverage.map(|c| seconds(c.coarse_seconds)),
        sensing_seconds: coverage.and_then(|c| c.sensing_seconds).map(seconds),
        detail,
        version: env!("CARGO_PKG_VERSION"),
        wall_seconds: rounded(start.elapsed().as_secs_f64(), 1e-3),
    }
}

impl Place {
    fn of(light: Light) -> Self {
        let um = |place: [f64; 2]| place.map(|metres| rounded(metres * 1e6, 1e-3));
        Self {
            level_v: rounded(light.level, 1e-6),
            input_um: um(light.input),
            output_um: light.output.map(um),
        }
    }
}
