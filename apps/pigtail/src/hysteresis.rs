//! `pigtail identify hysteresis` and `pigtail predict`.

use crate::choice::choice;
use crate::common::{Common, in_unit};
use crate::found::{self, FoundDocument, WriteArguments};
use crate::progress::Busy;
use crate::running::{self, stopped};
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use pigtail_evaluate::hysteresis::{self as machine, MachineDocument, MicrosDocument};
use pigtail_hal::Error;
use pigtail_hal::digest::hash;
use pigtail_hal::quantity::{FREQUENCY, Sign};
use pigtail_records::columns::LengthUnit;
use pigtail_records::hysteresis::{
    Columns, Data, HysteresisDocument, Inverted, Kind, Micros, ModelFile, Read, fit, tell,
    voltages, voltages_of,
};
use pigtail_report as report;
use pigtail_session::calibrations::Change;
use pigtail_session::own::Own;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_store::runs::Run;
use pigtail_store::samples::Samples;
use rayon::prelude::*;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Identify the hysteresis of the micro manipulators' piezos, and what compensating it is worth
/// (thesis 4.2)
///
/// Without `--data`, on the machine, by light on the flank of a beam (4.1): the right micro moves the
/// sensing fiber before a lit guide, the left one the input fiber before its own, whose light an output
/// fiber takes up. Each piezo goes full ways, back from voltages across the range (4.4), and turns all
/// over it, without any model that is believed so far. Both models are learned and tried on paths they were not
/// fitted to. A `calibration.toml` with the one asked for goes into the run's folder, its weights into a file beside
/// it, and with --write both go into the rig: from then on every motion of that micro is compensated with it.
///
/// Keys of the JSON: those of the micro that gained least, and `sides` with all of them.
///
/// With `--data` a model is fitted to a person's own record of voltage and displacement: to its
/// first three quarters, and judged on the rest, which was held back. Errors are beside those of
/// the best straight line. Writes a report with the loops and a `model.json` for `pigtail predict`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail identify hysteresis --side left
  pigtail identify hysteresis --rig my-rig --write
  pigtail identify hysteresis --data loops.csv --voltage u_V --displacement disp_um
  pigtail identify hysteresis --data loops.csv --voltage u_V --displacement x_nm --model rbf")]
#[command(group(clap::ArgGroup::new("machine").multiple(true).args(["rig", "fleet", "calibration", "write"]).conflicts_with("data")))]
pub(crate) struct IdentifyArguments {
    /// A file of columns; delimiter, decimal comma, encoding, names and units are told from it
    #[arg(long, value_name = "FILE", requires_all = ["input", "output"])]
    data: Option<PathBuf>,
    /// Its column of voltage
    #[arg(
        long = "voltage",
        alias = "input",
        value_name = "COLUMN",
        requires = "data"
    )]
    input: Option<String>,
    /// Its column of displacement
    #[arg(
        long = "displacement",
        alias = "output",
        value_name = "COLUMN",
        requires = "data"
    )]
    output: Option<String>,
    /// Its column of time; `t_s`, `time_s`, `t` or `time` if there is one, else samples are a second apart
    #[arg(long, value_name = "COLUMN", requires = "data")]
    time: Option<String>,
    /// Rows a second, hertz: where no column says when they were taken, or the column of time counts them
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive), requires = "data")]
    rate: Option<f64>,
    /// Unit of displacement in it; that of its name or header, else micrometres, if not given
    #[arg(long, value_parser = choice::<LengthUnit>(), requires = "data")]
    unit: Option<LengthUnit>,
    /// Which model
    #[arg(long, value_parser = choice::<Kind>(), default_value = "memory")]
    model: Kind,
    /// The micros of which side
    #[arg(long, value_parser = choice::<Micros>(), default_value = "both", conflicts_with = "data")]
    side: Micros,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    write: WriteArguments,
}

/// Apply a model of hysteresis to another record
///
/// Tells the displacement from the voltage and says how far that is from the one in the record, but
/// for an offset, for a sensor's zero is arbitrary. Judged is what comes after the voltage has been
/// at both ends of its range: before that nobody knows what the piezo remembers.
///
/// With `--inverse` tells the voltage for a path of wanted displacements. Where the record has a
/// voltage too, its error is given as the displacement that it makes. A path outside the model's
/// range of displacement is moved to its middle.
///
/// The run's folder gets a `predicted.csv`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail predict --model runs/20260101T120000-hysteresis-0/model.json --data other.csv
  pigtail predict --model model.json --data path.csv --displacement wanted_um --inverse")]
pub(crate) struct PredictArguments {
    /// The model.json of `pigtail identify hysteresis`
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// A file of columns; delimiter, decimal comma, encoding, names and units are told from it
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Its column of voltage; named as in the model's record if not given
    #[arg(long = "voltage", alias = "input", value_name = "COLUMN")]
    input: Option<String>,
    /// Its column of displacement; named as in the model's record if not given
    #[arg(long = "displacement", alias = "output", value_name = "COLUMN")]
    output: Option<String>,
    /// Its column of time
    #[arg(long, value_name = "COLUMN")]
    time: Option<String>,
    /// Rows a second, hertz: where no column says when they were taken, or the column of time counts them
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive))]
    rate: Option<f64>,
    /// Unit of displacement in it; that of its name or header, else of the model's record, if not given
    #[arg(long, value_parser = choice::<LengthUnit>())]
    unit: Option<LengthUnit>,
    /// Tell the voltage for the displacement
    #[arg(long)]
    inverse: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Where to write the run's folder
    #[arg(long, value_name = "FOLDER", default_value = "runs")]
    runs: PathBuf,
}

/// What its runs are called.
const KIND: &str = "identify hysteresis";

fn hash_of(path: &Path) -> (String, String) {
    let content = std::fs::read(path).unwrap_or_default();
    (path.display().to_string(), hash(content))
}

pub(crate) fn identify(arguments: &IdentifyArguments) -> Result<u8, Failure> {
    let (Some(data), Some(input), Some(output)) =
        (&arguments.data, &arguments.input, &arguments.output)
    else {
        return on_machine(arguments);
    };
    let data_file = Data::open(data, arguments.rate)?;
    let columns = Columns {
        input: input.clone(),
        output: output.clone(),
        time: arguments.time.clone(),
    };
    let Read {
        record,
        columns,
        unit,
        understood,
        remarks,
        timed,
    } = data_file.record(&columns, arguments.unit)?;
    let mut tried =
        fit(record, arguments.model).map_err(|invalid| data_file.explain(&invalid, &columns))?;
    if timed {
        tried.doubt_lag();
    }
    tried.document.read = understood;
    tried.document.remarks.splice(0..0, remarks);
    let seed = arguments.common.seed;
    let hashes = [hash_of(data)];
    let run = Run::begin(&arguments.common.runs, KIND, seed, &hashes)?;
    // A model that does not tell its own record is none.
    let is_model = tried.document.doubt.is_empty();
    if is_model {
        tried.document.model_file = run.path("model.json").display().to_string();
    }
    tried.document.report = run.path("report.html").display().to_string();
    let file = ModelFile {
        date: run.date(),
        origin: format!("identify hysteresis, run {}", run.name()),
        columns,
        unit,
        model: tried.model.clone(),
    };
    if is_model {
        run.write_json("model.json", &file)?;
    }
    run.write_json("summary.json", &tried.document)?;
    let title = format!("Hysteresis in {}", data.display());
    run.write("report.html", report::tried(&title, &tried)?)?;
    let record = &tried.record;
    Samples::default()
        .with("time_s", "as in the record", record.time.clone())
        .with("input_v", "voltage", record.input.clone())
        .with("output_um", "displacement", record.output.clone())
        .with(
            "predicted_um",
            "what the model tells of it",
            tried.prediction.clone(),
        )
        .keep(&run)?;
    run.finish("done")?;
    tell_about(&tried.document, arguments.common.json)
}

fn on_machine(arguments: &IdentifyArguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    arguments.write.check(&common.rig)?;
    let mut setup =
        common.setup_with(DEFAULT_RECIPE_NAME, &Own::default(), true, &["hysteresis"])?;
    let run = running::begin(&mut setup, &common.runs, KIND, common.seed, true)?;
    let busy = Busy::new(
        "identify hysteresis",
        "measuring the piezos and fitting their models",
    );
    let sides = arguments.side.sides().par_iter();
    let found: Vec<_> = sides
        .map(|side| machine::identify(&setup, arguments.model, *side, common.seed))
        .collect();
    drop(busy);
    let found = found
        .into_iter()
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| stopped(&run, &setup, error))?;
    let report = run.path("report.html").display().to_string();
    let (mut documents, mut changes) = (Vec::with_capacity(found.len()), Vec::new());
    for found in &found {
        let mut document = found.document.clone();
        document.report.clone_from(&report);
        let weights = serde_json::to_string_pretty(&found.model).map_err(anyhow::Error::from)?;
        let weights = format!("{weights}\n");
        let file = weights_file(&document);
        document.model_file = run.path(&file).display().to_string();
        changes.push(change(&run, &document, weights));
        documents.push(document);
    }
    let kept = found::keep(arguments.write, &run, common, &setup, KIND, &changes)?;
    for document in &mut documents {
        document.calibration = kept.written();
    }
    run.write("report.html", report::micros(&found)?)?;
    samples(&found).keep(&run)?;
    let Some(document) = MicrosDocument::new(documents) else {
        return Err(anyhow::anyhow!("there is no micro to identify").into());
    };
    let on = running::on(&setup, &document, Some(&kept));
    run.write_json("summary.json", &on)?;
    running::close_records(&run, &setup)?;
    run.finish("done")?;
    let text = running::told(common.json, &on, &setup, || {
        machine_account(&document, &kept)
    })?;
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

/// What was seen of each piezo, and the scans that the models were tried on, in columns.
fn samples(found: &[machine::Identified]) -> Samples {
    const AXES: [&str; 2] = ["x", "y"];
    const MODELS: [&str; 3] = ["no", "the_rbf", "the_memory"];
    let mut all = Samples::default();
    for found in found {
        let side = found.document.side;
        for (k, (piezo, axis)) in found.micro.piezos.iter().zip(AXES).enumerate() {
            let name = |what: &str| format!("{side}_{axis}_{what}");
            let seen = &piezo.series;
            let volts = seen.volts.iter().map(|volts| volts[k]).collect();
            all = all
                .with(
                    &name("time_s"),
                    "when the light was sampled",
                    seen.time.clone(),
                )
                .with(&name("input_v"), "the piezo's voltage", volts)
                .with(
                    &name("light_v"),
                    "photodiode, less what it gives in the dark",
                    seen.light.clone(),
                );
        }
        for (scan, model) in found.scans.iter().zip(MODELS) {
            let um = |metres: &[f64]| metres.iter().map(|m| 1e6 * m).collect();
            let name = |what: &str| format!("{side}_{what}_um_with_{model}_model");
            all = all
                .with(&name("wanted"), "what was wanted along x", um(&scan.wanted))
                .with(&name("was"), "where it was: the truth", um(&scan.was));
        }
    }
    all
}

/// A side's model as a change of the calibration.
fn change(run: &Run, document: &MachineDocument, weights: String) -> Change {
    let file = weights_file(document);
    let residual = document.residual_um.iter().fold(0.0, |m: f64, r| m.max(*r));
    let origin = format!("identify hysteresis, run {}", run.name());
    Change {
        table: format!("hysteresis.{}", document.side),
        values: vec![
            ("model", toml_edit::value(document.model)),
            ("weights", toml_edit::value(&file)),
            // One that stood in the calibration itself is replaced.
            ("micro", toml_edit::Item::None),
            ("residual", toml_edit::value(format!("{residual:.5} um"))),
            ("date", toml_edit::value(run.date())),
            ("origin", toml_edit::value(origin)),
        ],
        weights: Some((file, weights)),
    }
}

/// The run's file with a side's model.
fn weights_file(document: &MachineDocument) -> String {
    format!("weights-{}.json", document.side)
}

/// What a person wants to know of an identification on a machine.
fn machine_account(document: &MicrosDocument, found: &FoundDocument) -> String {
    let mut text = String::new();
    for d in &document.sides {
        let _ = writeln!(
            text,
            "The {} micro, forward and back over {:.0} um: the ways part by {:.2} % of the range; with the \
             model `{}` by {:.2} %",
            d.side, d.range_um, d.uncompensated_opening_percent, d.model, d.opening_percent
        );
        let _ = writeln!(
            text,
            "The scale errs by {:+.2} % without it, by {:+.2} % with it",
            d.uncompensated_gain_error_percent, d.gain_error_percent
        );
        let _ = writeln!(text, "What the best straight line leaves, um rms:");
        let _ = writeln!(
            text,
            "  {:24} {:>8} {:>8} {:>7} {:>8} {:>7}",
            "path", "none", "rbf", "better", "memory", "better"
        );
        for p in &d.paths {
            let _ = writeln!(
                text,
                "  {:24} {:8.3} {:8.3} {:6.1}x {:8.3} {:6.1}x",
                p.name,
                p.uncompensated_um,
                p.rbf_um,
                p.rbf_improvement,
                p.memory_um,
                p.memory_improvement
            );
        }
    }
    text += &found.account();
    let _ = writeln!(text, "Report: {}", document.least.report);
    text
}

pub(crate) fn predict(arguments: &PredictArguments) -> Result<u8, Failure> {
    let file = ModelFile::read(&arguments.model)?;
    let data = Data::open(&arguments.data, arguments.rate)?;
    let named = |given: &Option<String>, known: &str| given.as_deref().unwrap_or(known).to_owned();
    // A column of time that only the model's record had is not missed here.
    let known_time = file.columns.time.clone().filter(|name| data.has(name));
    let columns = Columns {
        input: named(&arguments.input, &file.columns.input),
        output: named(&arguments.output, &file.columns.output),
        time: arguments.time.clone().or(known_time),
    };
    // What the other file says of its unit goes before what the model's said.
    let unit = data.unit(&columns.output, arguments.unit, file.unit)?;
    let hashes = [hash_of(&arguments.model), hash_of(&arguments.data)];
    let compare = arguments.input.is_some() || data.has(&columns.input);
    if arguments.inverse && !compare {
        return path_alone(arguments, &file, &data, &columns, unit, &hashes);
    }
    let Read {
        record,
        understood,
        remarks,
        timed,
        ..
    } = data.record(&columns, Some(unit))?;
    data.timed_as(&file.columns, timed)?;
    let (mut tried, inverted) = if arguments.inverse {
        let (tried, inverted) = voltages_of(&file.model, record);
        (tried, Some(inverted))
    } else {
        (tell(&file.model, record), None)
    };
    tried.document.read = understood;
    tried.document.remarks.splice(0..0, remarks);
    let run = Run::begin(&arguments.runs, "predict", 0, &hashes)?;
    tried.document.model_file = arguments.model.display().to_string();
    tried.document.report = run.path("report.html").display().to_string();
    let title = format!("A model's account of {}", arguments.data.display());
    if let Some(inverted) = &inverted {
        run.write("predicted.csv", voltages_csv(inverted))?;
        let page = report::inverted(&title, inverted, Some(&tried))?;
        run.write("report.html", page)?;
    } else {
        let mut csv = "t_s,input_V,output_um,predicted_um\n".to_owned();
        let r = &tried.record;
        for (k, prediction) in tried.prediction.iter().enumerate() {
            let (t, v, x) = (r.time[k], r.input[k], r.output[k]);
            let _ = writeln!(csv, "{t},{v},{x},{prediction:.6}");
        }
        run.write("predicted.csv", csv)?;
        run.write("report.html", report::tried(&title, &tried)?)?;
    }
    run.write_json("summary.json", &tried.document)?;
    run.finish("done")?;
    tell_about(&tried.document, arguments.json)
}

fn voltages_csv(inverted: &Inverted) -> String {
    let mut csv = "t_s,wanted_um,voltage_V\n".to_owned();
    for ((t, x), v) in inverted
        .time
        .iter()
        .zip(&inverted.wanted)
        .zip(&inverted.volts)
    {
        let _ = writeln!(csv, "{t},{x},{v:.6}");
    }
    csv
}

/// The inverse of a path with no voltage to compare with: there is nothing to judge.
fn path_alone(
    arguments: &PredictArguments,
    file: &ModelFile,
    data: &Data,
    columns: &Columns,
    unit: LengthUnit,
    hashes: &[(String, String)],
) -> Result<u8, Failure> {
    let path = data.path(columns, Some(unit))?;
    data.timed_as(&file.columns, path.timed)?;
    if let Some((far, own)) = Inverted::too_far(&file.model, &path.wanted) {
        let message = format!(
            "goes over {far:.3} um; accepted is a path within the {own:.3} um of the model's record: is it in another unit?"
        );
        let file = arguments.data.display().to_string();
        return Err(Error::new(file, &columns.output, message).into());
    }
    let inverted = voltages(&file.model, path.time, path.wanted);
    let mut remarks = path.remarks;
    remarks.extend(inverted.at_ends(&file.model));
    let run = Run::begin(&arguments.runs, "predict", 0, hashes)?;
    run.write("predicted.csv", voltages_csv(&inverted))?;
    let title = format!("Voltages for {}", arguments.data.display());
    run.write("report.html", report::inverted(&title, &inverted, None)?)?;
    let (csv, page) = (run.path("predicted.csv"), run.path("report.html"));
    let document = serde_json::json!({
        "model": file.model.name(),
        "functions": file.model.functions(),
        "samples": inverted.volts.len(),
        "offset_um": inverted.offset,
        "read": path.understood,
        "remarks": remarks,
        "voltages": csv.display().to_string(),
        "report": page.display().to_string(),
    });
    run.write_json("summary.json", &document)?;
    run.finish("done")?;
    let text = if arguments.json {
        format!("{document}\n")
    } else {
        let mut notes = String::new();
        for remark in &remarks {
            let _ = writeln!(notes, "Note: {remark}");
        }
        format!(
            "Read: {}\n{} voltages by the model `{}`, the path moved by {:.3} um\n{notes}Voltages: {}\nReport: {}\n",
            path.understood,
            inverted.volts.len(),
            file.model.name(),
            inverted.offset,
            csv.display(),
            page.display()
        )
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

fn tell_about(document: &HysteresisDocument, json: bool) -> Result<u8, Failure> {
    let text = if json {
        let json = serde_json::to_string(document).map_err(anyhow::Error::from)?;
        format!("{json}\n")
    } else {
        account(document)
    };
    crate::print(text.as_bytes())?;
    Ok(if document.doubt.is_empty() {
        DONE
    } else {
        NEGATIVE
    })
}

/// What a person wants to know of it.
fn account(d: &HysteresisDocument) -> String {
    let mut text = format!("Read: {}\n", d.read);
    let percent = |um: f64| 100.0 * um / d.range_um;
    let _ = writeln!(
        text,
        "Model `{}` of {} functions over a range of {:.3} um",
        d.model, d.functions, d.range_um
    );
    let _ = writeln!(
        text,
        "  {:10} {:>10} {:>8} {:>10} {:>8} {:>12}",
        "", "rms, um", "%", "max, um", "%", "line's rms, %"
    );
    let mut row = |name: &str, rms: f64, max: f64, line: f64| {
        let _ = writeln!(
            text,
            "  {name:10} {rms:10.4} {:8.3} {max:10.4} {:8.3} {line:12.3}",
            percent(rms),
            percent(max)
        );
    };
    for (name, part) in [("fitted", &d.fitted), ("held back", &d.held_back)] {
        if let Some(p) = part {
            row(name, p.rms_um, p.max_um, percent(p.uncompensated_rms_um));
        }
    }
    if d.fitted.is_none() {
        row("predicted", d.rms_um, d.max_um, d.uncompensated_percent);
    }
    let _ = writeln!(
        text,
        "{:.1} times better than the best straight line",
        d.improvement
    );
    if let Some(open) = d.known_to_percent {
        let _ = writeln!(
            text,
            "Known to {open:.3} % of the range at the record's rates, whether its lag is of amplifier and sensor or of the logger"
        );
    }
    if let Some(volts) = d.rms_v {
        let _ = writeln!(text, "The voltage errs by {volts:.5} V rms");
    }
    if !d.doubt.is_empty() {
        let _ = writeln!(text, "The model does not tell this record: {}", d.doubt);
    }
    for remark in &d.remarks {
        let _ = writeln!(text, "Note: {remark}");
    }
    if !d.model_file.is_empty() {
        let _ = writeln!(text, "Model: {}", d.model_file);
    }
    let _ = writeln!(text, "Report: {}", d.report);
    text
}
