//! `pigtail sample-data`.

use crate::common::write_table;
use crate::{DONE, Failure};
use clap::Args;
use pigtail_evaluate::sample_data::sample_data;
use pigtail_hal::Error;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use std::fs;
use std::path::PathBuf;

/// Write records to try the commands on that read records
///
/// Files of columns as laboratories bring them, made by the twin of a seed: a servo axis, a joint with two encoders, a
/// piezo, a map of light, a contact, a stage's frequency response, a sled; and the parameters of two joints to simulate.
/// What is true of them is known, so that an answer can be judged: the axes are those of the rig's `plant.toml` as the seed
/// draws them; the map's peak is at 17.2, 10.6 um; the contact gives way by 12 um before it slides at 2 N; the stage has modes
/// at 180 and 540 Hz, damped by 0.03 and 0.015, and answers 0.3 ms late; the sled has 95 kg and 200 N s/m, slides at 20 N after
/// 5 um, and gets 35 N from a volt of its controller (160/s, 240 V s/m, 10 V at most).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail sample-data data
  pigtail identify windup --data data/two-encoders.csv --motor motor_deg --load load_deg
  pigtail identify friction --data data/friction.csv --displacement x_um --force force_N
  pigtail identify resonance --data data/response.csv
  pigtail align --map data/map.csv --map-columns x_um,y_um,power_V
  pigtail simulate joint --params data/axes.toml --axis z --step 400 --to step.csv")]
pub(crate) struct Arguments {
    /// The folder to write them into
    folder: PathBuf,
    /// What to draw: machine and noise
    #[arg(long, default_value_t = 0, value_parser = crate::from_zero::<u64>)]
    seed: u64,
    /// A folder with the three files of a rig, or the name of one below `rigs`
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    rig: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let setup = Setup::load(&arguments.rig, DEFAULT_RECIPE_NAME)?;
    let folder = &arguments.folder;
    let cannot = |path: &PathBuf, what: String| {
        let message = format!(
            "{what}; accepted is a folder that may be written into and has none of these files"
        );
        Failure::from(Error::new(path.display().to_string(), "", message))
    };
    let files = sample_data(&setup, arguments.seed)?;
    for file in &files {
        let path = folder.join(file.name);
        if path.exists() {
            return Err(cannot(&path, "is there already".to_owned()));
        }
    }
    fs::create_dir_all(folder)
        .map_err(|error| cannot(folder, format!("cannot be made ({error})")))?;
    for file in &files {
        let path = folder.join(file.name);
        fs::write(&path, &file.content)
            .map_err(|error| cannot(&path, format!("cannot be written ({error})")))?;
    }
    let mut text = Vec::new();
    if arguments.json {
        let files: Vec<_> = files
            .iter()
            .map(|file| {
                let path = folder.join(file.name).display().to_string();
                serde_json::json!({ "file": path, "about": file.about })
            })
            .collect();
        let document = serde_json::json!({ "seed": arguments.seed, "files": files });
        text.extend(format!("{document}\n").bytes());
    } else {
        let mut rows = vec![["file", "rows", "what it is"].map(str::to_owned).to_vec()];
        rows.extend(files.iter().map(|file| {
            let path = folder.join(file.name).display().to_string();
            let is_table = std::path::Path::new(file.name).extension() == Some("csv".as_ref());
            let rows = is_table.then(|| file.content.lines().count() - 1);
            let rows = rows.map_or_else(|| "-".to_owned(), |rows| rows.to_string());
            vec![path, rows, file.about.to_owned()]
        }));
        write_table(&mut text, &rows).map_err(anyhow::Error::from)?;
    }
    crate::print(&text)?;
    Ok(DONE)
}
