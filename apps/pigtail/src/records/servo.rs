//! `pigtail identify servo`.

use super::{Output, finish, hash_of, origin};
use crate::Failure;
use crate::common::in_unit;
use crate::progress::Busy;
use clap::{Args, ValueEnum};
use pigtail_hal::quantity::{FREQUENCY, LENGTH, Sign, VOLTAGE};
use pigtail_records::columns::Named;
use pigtail_records::part::Drive;
use pigtail_records::servo::{self, Roles};
use pigtail_store::runs::Run;
use pigtail_sysid::servo::{Controller, Friction, Method, Settings};
use std::path::PathBuf;

/// Heading of what a fragment tells of an axis beside its record.
const DRIVE: &str = "Its drive, for the fragment";

/// Identify inertia and friction of a servo axis from a record of it
///
/// Fits the inverse dynamic model, force = inertia x acceleration + viscous + Coulomb friction + offset,
/// by least squares: the position filtered both ways, differentiated by central differences, everything
/// decimated. Symmetric friction with an offset, and friction that each direction has for itself; by
/// ordinary least squares, weighted, with instrumental variables from the closed loop replayed, and with the
/// delay of the voltage as one unknown more. The
/// verdict says which variant generalises: by the second record (--validate), else by the last part of the
/// first one. Where a record does not excite a parameter, it is not given a value, and the exit code is 1.
///
/// A column is NAME or NAME:UNIT; without, its unit is the one its name ends with (`q_mm`, `q [mm]`), else SI.
/// With a reference, the controller is identified too, and the record replayed in closed loop.
#[derive(Debug, Args)]
#[command(
    override_usage = "\
pigtail identify servo [OPTIONS] --data <FILE> --position <COLUMN>
       --voltage <COLUMN> --force-per-volt <K>",
    after_help = "\
Examples:
  pigtail identify servo --data log.csv --time t_s --reference q_ref_m --position q_meas_m --voltage u_V \
--force-per-volt 35.15
  pigtail identify servo --data log.csv --position pos:mm --voltage cmd:V --force-per-volt 12 --validate b.csv"
)]
pub(crate) struct ServoArguments {
    /// A file of columns; delimiter, decimal comma, encoding, names and units are told from it
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Its column of time; `t_s`, `time_s`, `t` or `time` if not given
    #[arg(long, value_name = "COLUMN")]
    time: Option<Named>,
    /// Rows a second, hertz: where no column says when they were taken, or the column of time counts them
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive))]
    rate: Option<f64>,
    /// Its column of the position's reference
    #[arg(long, value_name = "COLUMN")]
    reference: Option<Named>,
    /// Its column of position, a length or an angle
    #[arg(long, value_name = "COLUMN")]
    position: Named,
    /// Its column of motor voltage
    #[arg(long, value_name = "COLUMN")]
    voltage: Named,
    /// Its column of what was added to the controller's voltage, volts or a force, where something was
    #[arg(long, value_name = "COLUMN")]
    injected: Option<Named>,
    /// Force (N) or torque (N m) of a volt, or of an ampere where the column is a current
    #[arg(long, value_name = "K", value_parser = crate::positive)]
    force_per_volt: f64,
    /// A second record of the same columns, to judge by
    #[arg(long, value_name = "FILE")]
    validate: Option<PathBuf>,
    /// Friction whose parameters are reported
    #[arg(long, value_enum, default_value = "symmetric")]
    friction: FrictionChoice,
    /// Method whose parameters are reported; if not given, `delayed` where the record shows when its voltage acts, and
    /// is told better so, else `least-squares`
    #[arg(long, value_enum)]
    method: Option<MethodChoice>,
    /// Cutoff of the position's filter, hertz; if not given a tenth of the sample rate, less where the position is noisy, more
    /// where rows are far apart, at most 100
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive))]
    cutoff: Option<f64>,
    /// Order of the filter
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=8))]
    order: u8,
    /// Samples left out at the start
    #[arg(long, default_value_t = 49, value_parser = crate::from_zero::<usize>)]
    skip: usize,
    /// One equation in so many samples; sample rate over cutoff if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    decimate: Option<u32>,
    /// The controller u = KV (KP (reference - position) - velocity), bounded by LIMIT volts; found in the record if
    /// not given
    #[arg(long, value_name = "KP,KV,LIMIT", value_parser = cascade)]
    controller: Option<Controller>,
    /// Turns of the output for a turn of the motor; 1 if not given
    #[arg(long, value_name = "R", value_parser = crate::positive, help_heading = DRIVE)]
    gear_ratio: Option<f64>,
    /// Travel for a turn of the screw, metres, of an axis along a line; 0.01 if not given
    #[arg(long, value_name = "METRES", value_parser = in_unit(LENGTH, "m", Sign::Positive), help_heading = DRIVE)]
    lead: Option<f64>,
    /// Encoder counts in a turn of the motor; if not given, one is as coarse as the position's noise
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..), help_heading = DRIVE)]
    counts_per_turn: Option<u32>,
    /// The amplifier's bound, volts; if not given, the controller's, or the most that the record shows
    #[arg(long, value_name = "VOLTS", value_parser = in_unit(VOLTAGE, "V", Sign::Positive), help_heading = DRIVE)]
    voltage_limit: Option<f64>,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrictionChoice {
    /// Both directions alike, and an offset
    Symmetric,
    /// Each direction for itself
    Asymmetric,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MethodChoice {
    /// Ordinary least squares
    LeastSquares,
    /// Least squares by Huber's weights
    Weighted,
    /// Instrumental variables
    Instrumental,
    /// Least squares with the time after which a voltage acts as one unknown more
    Delayed,
}

fn cascade(text: &str) -> Result<Controller, String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|t| {
            t.trim()
                .parse()
                .ok()
                .filter(|v: &f64| v.is_finite() && *v > 0.0)
        })
        .collect();
    match numbers.as_deref() {
        Some([kp, kv, limit]) => Ok(Controller::cascade(*kp, *kv, *limit)),
        _ => Err(format!(
            "\"{text}\" is not three finite numbers above zero, separated by commas"
        )),
    }
}

pub(crate) fn servo(a: &ServoArguments) -> Result<u8, Failure> {
    let roles = Roles {
        time: a.time.clone(),
        rate: a.rate,
        reference: a.reference.clone(),
        position: a.position.clone(),
        voltage: a.voltage.clone(),
        injected: a.injected.clone(),
    };
    let first = roles.read(&a.data)?;
    let second = a
        .validate
        .as_ref()
        .map(|path| roles.read(path))
        .transpose()?;
    let set = Settings {
        cutoff: a.cutoff,
        order: usize::from(a.order),
        skip: a.skip,
        decimate: a.decimate.map(|d| d as usize),
        controller: a.controller,
        ..Settings::new(a.force_per_volt)
    };
    servo::check_cutoff(&a.data, &first, a.cutoff, "--cutoff")?;
    let friction = match a.friction {
        FrictionChoice::Symmetric => Friction::Symmetric,
        FrictionChoice::Asymmetric => Friction::Asymmetric,
    };
    let method = a.method.map(|method| match method {
        MethodChoice::LeastSquares => Method::LeastSquares,
        MethodChoice::Weighted => Method::Weighted,
        MethodChoice::Instrumental => Method::Instrumental,
        MethodChoice::Delayed => Method::Delayed,
    });
    servo::check_lead(&first, a.lead, "--lead")?;
    let drive = Drive {
        ratio: a.gear_ratio.unwrap_or(Drive::PLAIN.ratio),
        lead: a.lead.unwrap_or(Drive::PLAIN.lead),
        counts: a.counts_per_turn,
        limit: a.voltage_limit,
    };
    let busy = Busy::new("identify servo", "fitting models to the record");
    let found = servo::servo(&first, second.as_ref(), &set, (friction, method));
    drop(busy);
    let mut found = found;
    found
        .answer
        .more
        .insert("read".to_owned(), first.understood.clone().into());
    let answer = found.answer.clone();
    let shown = found.shown.take();
    let fragment = found.best.is_some() && answer.is_whole();
    let fragment = fragment.then_some(move |run: &Run| {
        let (date, origin) = (run.date(), origin("servo", run));
        let text = found.fragment(&first, a.force_per_volt, &drive, (&date, &origin));
        let files = text.transpose()?.map(|text| ("plant.toml", text));
        Ok(files.into_iter().collect())
    });
    let mut hashes = vec![hash_of(&a.data)];
    hashes.extend(a.validate.as_deref().map(hash_of));
    let title = format!("A servo axis from {}", a.data.display());
    finish(
        "servo",
        &title,
        answer,
        shown.as_ref(),
        &hashes,
        fragment,
        &a.output,
    )
}
