//! What a rig is to expect of each way to align: the closed forms of the thesis's three searches
//! (3.3)-(3.5) beside their times on the twin, and the whole procedures.

use crate::align::align;
use crate::methods::{SearchDocument, check, run};
use pigtail_control::methods::{Method, Space};
use pigtail_control::station::Unobserved;
use pigtail_hal::Spec;
use pigtail_numerics::rounded;
use pigtail_session::job::Ended;
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
use serde::Serialize;
use std::time::Instant;
use strum::VariantArray;

/// What `plan` prints as JSON. Keys are a contract: more may come, none changes its name or
/// meaning. The same seed gives the same values, every `wall_seconds` apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanDocument {
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// The seed of the searches' machine and device, and of the first that the procedures align.
    pub seed: u64,
    /// A row a method and mesh.
    pub searches: Vec<SearchRow>,
    /// A row a whole procedure.
    pub procedures: Vec<ProcedureRow>,
    /// The program's version.
    pub version: &'static str,
    /// Time that all of it took, seconds of a clock on the wall.
    pub wall_seconds: f64,
}

/// A search for first light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchRow {
    /// The method: `macro-raster`, `micro-raster` or `multimode`.
    pub method: &'static str,
    /// Grid spacing, micrometres.
    pub mesh_um: f64,
    /// Frequency of the sweep across, hertz.
    pub scan_hz: f64,
    /// How often the photodiodes are read, hertz: the rig's, or those of a faster variant of it.
    pub photodiode_hz: f64,
    /// Time to cover the space by the scan rate, (3.3)-(3.5): a device's in methods 1 and 2, a
    /// fiber's in method 3.
    pub closed_form_seconds: f64,
    /// The same were the scan rate what the photodiode allows.
    pub photodiode_limited_seconds: f64,
    /// Machine time in which the twin covered it; `null` where it cannot.
    pub measured_seconds: Option<f64>,
    /// `measured_seconds` a fiber.
    pub seconds_per_fiber: Option<f64>,
    /// Whether light was found.
    pub found: bool,
    /// When; `null` unless found.
    pub found_seconds: Option<f64>,
    /// Time that the simulation took, seconds of a clock on the wall; `null` where there was none.
    pub wall_seconds: Option<f64>,
    /// What there is to know of it; may be empty.
    pub note: String,
}

/// A whole procedure, over some devices.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProcedureRow {
    /// The procedure.
    pub procedure: &'static str,
    /// Devices aligned, of successive seeds.
    pub devices: u64,
    /// Those of them with every fiber aligned, in truth, and nothing touched.
    pub successes: u64,
    /// Machine time a fiber, all phases: the mean over all fibers, seconds.
    pub mean_seconds_per_fiber: f64,
    /// The longest, seconds.
    pub max_seconds_per_fiber: f64,
    /// Time that the simulation took, seconds of a clock on the wall.
    pub wall_seconds: f64,
}

/// Forms that differ by less agree: the thesis rounds 7.96 Hz to 8.
const AGREE: f64 = 0.05;

/// Measures every row on the twin. `step` is told the name of each before it begins.
///
/// # Errors
///
/// When the plant cannot be built, or the machine has a fault.
pub fn plan(
    setup: &Setup,
    seed: u64,
    devices: u64,
    step: &mut dyn FnMut(&str),
) -> Result<PlanDocument, Ended> {
    let start = Instant::now();
    let mut searches = Vec::new();
    for space in spaces(setup) {
        step(space.method.name());
        searches.push(search_row(setup, &space, seed)?);
    }
    let mut procedures = Vec::new();
    for &procedure in Procedure::VARIANTS {
        step(procedure.name());
        procedures.push(procedure_row(setup, procedure, seed, devices)?);
    }
    Ok(PlanDocument {
        rig: setup.rig.name.clone(),
        recipe: setup.rig.recipe_name.clone(),
        seed,
        searches,
        procedures,
        version: env!("CARGO_PKG_VERSION"),
        wall_seconds: rounded(start.elapsed().as_secs_f64(), 1e-3),
    })
}

/// Each method at the recipe's mesh and at twice it; method 1 also at the scan rate that the
/// photodiode allows there.
pub fn spaces(setup: &Setup) -> Vec<Space> {
    let mut spaces = Vec::new();
    for method in Method::ALL {
        let fine = Space::new(method, &setup.rig.recipe);
        let coarse = Space {
            mesh: 2.0 * fine.mesh,
            ..fine
        };
        spaces.extend([fine, coarse]);
        if method == Method::MacroRaster {
            spaces.push(Space {
                frequency: coarse.fastest(setup.rig.spec.photodiode.rate),
                ..coarse
            });
        }
    }
    spaces
}

/// The number of rows that [`plan`] measures.
pub fn rows(setup: &Setup) -> usize {
    spaces(setup).len() + Procedure::VARIANTS.len()
}

/// Measures one search on the twin, where need be on a variant with faster photodiodes.
///
/// # Errors
///
/// When the plant cannot be built, or the machine has a fault.
pub fn search_row(setup: &Setup, space: &Space, seed: u64) -> Result<SearchRow, Ended> {
    let mut notes = Vec::new();
    let faster = match space.method {
        Method::MicroRaster if check(setup, space).is_err() => {
            let faster = faster(&setup.rig.spec, Space::new(space.method, &setup.rig.recipe));
            faster.map(|spec| {
                let mut setup = setup.clone();
                setup.rig.spec = spec;
                setup
            })
        }
        _ => None,
    };
    if let Some(spec) = faster.as_ref().map(|setup| &setup.rig.spec) {
        notes.push(format!(
            "on a rig with photodiodes read at {} Hz, of {} kHz, and a servo at {} Hz",
            spec.photodiode.rate,
            spec.photodiode.bandwidth * 1e-3,
            spec.servo.rate
        ));
    }
    let setup = faster.as_ref().unwrap_or(setup);
    let rate = setup.rig.spec.photodiode.rate;
    let (closed, limited) = (space.closed_form(), space.photodiode_limited(rate));
    if (closed / limited - 1.0).abs() > AGREE {
        notes.push(format!(
            "the two forms part: the photodiode allows {:.1} Hz",
            space.fastest(rate)
        ));
    }
    let search: Option<SearchDocument> = match check(setup, space) {
        Ok(()) => Some(run(setup, space, seed, &mut Unobserved)?),
        Err(error) => {
            notes.push(error.message);
            None
        }
    };
    if let Some(search) = search.as_ref().filter(|search| !search.detail.is_empty()) {
        notes.push(search.detail.clone());
    }
    Ok(SearchRow {
        method: space.method.name(),
        mesh_um: rounded(space.mesh * 1e6, 1e-6),
        scan_hz: rounded(space.frequency, 1e-6),
        photodiode_hz: rate,
        closed_form_seconds: rounded(closed, 1e-4),
        photodiode_limited_seconds: rounded(limited, 1e-4),
        measured_seconds: search.as_ref().and_then(|s| s.measured_seconds),
        seconds_per_fiber: search.as_ref().and_then(|s| s.measured_seconds_per_fiber),
        found: search.as_ref().is_some_and(|s| s.found),
        found_seconds: search.as_ref().and_then(|s| s.found_seconds),
        wall_seconds: search.as_ref().map(|s| s.wall_seconds),
        note: notes.join("; "),
    })
}

/// A machine like this one whose photodiodes can follow a search, in half multiples of their rate
/// and bandwidth, and whose servo card reads them; `None` where no servo rate suits the camera too.
fn faster(spec: &Spec, space: Space) -> Option<Spec> {
    let factor = (2.0 * space.photodiode_rate() / spec.photodiode.rate).ceil() / 2.0;
    let rate = factor * spec.photodiode.rate;
    let mut faster = spec.clone();
    faster.photodiode.rate = rate;
    faster.photodiode.bandwidth *= factor;
    let cycles = (spec.servo.rate / rate).ceil();
    faster.servo.rate = (0..16)
        .map(|more| (cycles + f64::from(more)) * rate)
        .find(|servo| (servo / spec.vision.rate).fract().abs() < 1e-9)?;
    Some(faster)
}

fn procedure_row(
    setup: &Setup,
    procedure: Procedure,
    seed: u64,
    devices: u64,
) -> Result<ProcedureRow, Ended> {
    let start = Instant::now();
    let (mut successes, mut sum, mut max, mut fibers) = (0, 0.0, 0.0, 0.0);
    for device in 0..devices {
        let document = align(setup, procedure, seed.wrapping_add(device), &mut Unobserved)?;
        successes += u64::from(document.is_success());
        for fiber in &document.fibers {
            sum += fiber.seconds;
            fibers += 1.0;
            max = f64::max(max, fiber.seconds);
        }
    }
    Ok(ProcedureRow {
        procedure: procedure.name(),
        devices,
        successes,
        mean_seconds_per_fiber: rounded(sum / f64::max(fibers, 1.0), 1e-4),
        max_seconds_per_fiber: rounded(max, 1e-4),
        wall_seconds: rounded(start.elapsed().as_secs_f64(), 1e-3),
    })
}
