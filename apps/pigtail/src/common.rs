//! What the commands that run a machine have in common.

use clap::Args;
use pigtail_hal::Error;
use pigtail_hal::quantity::{Dimension, Sign};
use pigtail_report::text;
use pigtail_session::calibrations::find;
use pigtail_session::fleet::NOMINAL;
use pigtail_session::own::Own;
use pigtail_session::rig::{DEFAULT_RIG_NAME, Named};
use pigtail_session::setup::Setup;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub(crate) struct Common {
    /// What to draw: machine, device, fixture and noise
    #[arg(long, default_value_t = 0, value_parser = crate::from_zero::<u64>)]
    pub(crate) seed: u64,
    /// A folder with the three files of a rig, or the name of one below `rigs`
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    pub(crate) rig: String,
    /// What machine and device may be: a fleet of the rig (nominal, thesis, workshop, harsh, shift), or a TOML file
    #[arg(long, default_value = NOMINAL)]
    pub(crate) fleet: String,
    /// A calibration in place of the rig's: the number of a version, a run that found it, or a file
    #[arg(long, value_name = "VERSION|RUN|FILE")]
    pub(crate) calibration: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    pub(crate) json: bool,
    /// Where to write the run's folder
    #[arg(long, value_name = "FOLDER", default_value = "runs")]
    pub(crate) runs: PathBuf,
}

impl Common {
    /// The rig's twin and a recipe.
    pub(crate) fn setup(&self, recipe: &str) -> Result<Setup, Error> {
        self.setup_with(recipe, &Own::default(), false, &[])
    }

    /// The same with axes of a person's own, on a `bench` if they are to be measured, and without tables of the
    /// calibration that are about to be replaced.
    pub(crate) fn setup_with(
        &self,
        recipe: &str,
        own: &Own,
        bench: bool,
        without: &[&str],
    ) -> Result<Setup, Error> {
        let calibration = believed(&self.rig, self.calibration.as_deref(), &self.runs)?;
        let named = Named {
            rig: &self.rig,
            recipe,
            calibration: calibration.as_deref(),
            without,
        };
        Setup::load_with(&named, own, bench)?.of_fleet(&self.fleet)
    }
}

/// The file of the calibration that is named in place of a rig's, if any is.
pub(crate) fn believed(
    rig: &str,
    calibration: Option<&str>,
    runs: &Path,
) -> Result<Option<PathBuf>, Error> {
    let found = calibration
        .map(|named| find(rig, named, runs))
        .transpose()?;
    Ok(found.map(|found| found.file))
}

/// Axes of a person's own in place of the rig's.
#[derive(Debug, Args)]
pub(crate) struct OwnAxes {
    /// Puts an axis of your own in place of the rig's: a fragment that identify servo, friction, windup --data or
    /// resonance wrote, or what tune --from wrote, or the folder of such a run; may be given more than once
    #[arg(long, value_name = "FRAGMENT")]
    pub(crate) from: Vec<PathBuf>,
}

/// Writes a header and its rows; where the terminal is too narrow, rows become
/// columns if that helps.
pub(crate) fn write_table(out: &mut impl Write, rows: &[Vec<String>]) -> io::Result<()> {
    out.write_all(text::table(rows, text::room()).as_bytes())
}

/// A parser of quantities above zero.
pub(crate) fn quantity(
    dimension: Dimension,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| dimension.parse(&spaced(text), Sign::Positive)
}

/// A parser of numbers that are in a unit, the one of the flag's name or of its help, where they name none of their own;
/// what it returns is in that unit.
pub(crate) fn in_unit(
    dimension: Dimension,
    unit: &'static str,
    sign: Sign,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let factor = dimension.unit(unit).map_or(1.0, |(_, factor)| factor);
        let plain = text.trim().parse::<f64>().is_ok();
        let named = if plain {
            format!("{} {unit}", text.trim())
        } else {
            spaced(text)
        };
        let value = dimension.parse(&named, sign).map_err(|why| {
            // What was typed, and not what was made of it.
            why.replace(&format!("\"{named}\""), &format!("\"{text}\""))
        })?;
        // Twelve digits are more than anybody writes, and hide what dividing leaves in the last one.
        let own = format!("{:.11e}", value / factor);
        own.parse().map_err(|_| format!("\"{text}\" is no number"))
    }
}

/// A quantity as files have it: with a space between number and unit, which is often left out at a prompt.
pub(crate) fn spaced(text: &str) -> String {
    let text = text.trim();
    // The exponent of `1e-3 m` is part of the number.
    let number = (1..=text.len())
        .rev()
        .filter(|end| text.is_char_boundary(*end))
        .find(|end| text[..*end].parse::<f64>().is_ok());
    match number {
        Some(end) if end < text.len() => format!("{} {}", &text[..end], text[end..].trim_start()),
        _ => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_hal::quantity::{LENGTH, TIME};

    #[test]
    fn a_length_may_be_written_with_and_without_a_space() {
        let parse = quantity(LENGTH);
        for text in [
            "10um", "10 um", " 10  um ", "0.01 mm", "0.01mm", "1e-5m", "1e-5 m",
        ] {
            assert!((parse(text).unwrap() - 1e-5).abs() < 1e-18, "{text}");
        }
        for text in ["10", "um", "10 s", "-1um", "", "1e-5"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_number_without_a_unit_is_in_the_one_that_the_flag_says() {
        let nm = in_unit(LENGTH, "nm", Sign::Any);
        for text in ["100", "100nm", "100 nm", "0.1 um", "1e-4mm", "1e-7 m"] {
            assert_eq!(nm(text), Ok(100.0), "{text}");
        }
        assert_eq!(nm("-2um"), Ok(-2000.0));
        let ms = in_unit(TIME, "ms", Sign::Positive);
        assert_eq!(ms("0.25 s"), Ok(250.0));
        for text in ["0", "-1", "5 um", "", "nan", "inf", "ms"] {
            let why = ms(text).unwrap_err();
            assert!(why.contains(&format!("\"{text}\"")), "{text}: {why}");
        }
    }
}
