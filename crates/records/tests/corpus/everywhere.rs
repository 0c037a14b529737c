//! One table as all the programs of this world write it, read by every command that takes one.

use crate::normal;
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use pigtail_records::columns::Named;
use pigtail_records::hysteresis::{Columns, Data};
use pigtail_records::input::{self, Kind};
use pigtail_records::{friction, map, resonance, windup};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::path::Path;
use std::sync::Arc;

/// Columns by bare name and unit; the first is time, seconds, where there is one.
struct Table {
    names: Vec<&'static str>,
    units: Vec<&'static str>,
    columns: Vec<Vec<f64>>,
    timed: bool,
}

impl Table {
    fn rows(&self) -> usize {
        self.columns[0].len()
    }

    fn row(&self, k: usize, from: usize, between: &str, decimal: &str) -> String {
        let fields: Vec<String> = self.columns[from..]
            .iter()
            .map(|c| format!("{:.9}", c[k]).replace('.', decimal))
            .collect();
        fields.join(between)
    }

    fn body(&self, from: usize, between: &str, decimal: &str, end: &str) -> String {
        (0..self.rows())
            .map(|k| self.row(k, from, between, decimal) + end)
            .collect()
    }

    /// `x_um`.
    fn suffixed(&self) -> Vec<String> {
        let pairs = self.names.iter().zip(&self.units);
        pairs.map(|(n, u)| format!("{n}_{u}")).collect()
    }

    fn bracketed(&self) -> Vec<String> {
        let pairs = self.names.iter().zip(&self.units);
        pairs.map(|(n, u)| format!("{n} [{u}]")).collect()
    }

    fn bare(&self) -> Vec<String> {
        self.names.iter().map(|n| (*n).to_owned()).collect()
    }
}

/// What it is, its bytes, and what its columns are called there.
type Written = (&'static str, Vec<u8>, Vec<String>);

fn parquet(names: &[String], columns: &[Vec<f64>]) -> Vec<u8> {
    let fields: Vec<String> = names
        .iter()
        .map(|n| format!("OPTIONAL DOUBLE {n};"))
        .collect();
    let fields = fields.concat();
    let schema =
        Arc::new(parse_message_type(&format!("message m {{ {fields} }}")).expect("a schema"));
    let mut bytes = Vec::new();
    let properties = WriterProperties::builder()
        .set_compression(parquet::basic::Compression::SNAPPY)
        .build();
    let mut writer =
        SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties)).expect("a file");
    let mut group = writer.next_row_group().expect("a group");
    for column in columns {
        let mut own = group.next_column().expect("a column").expect("one more");
        // What is missing is null.
        let levels: Vec<i16> = column.iter().map(|v| i16::from(v.is_finite())).collect();
        let there: Vec<f64> = column.iter().copied().filter(|v| v.is_finite()).collect();
        own.typed::<DoubleType>()
            .write_batch(&there, Some(&levels), None)
            .expect("values");
        own.close().expect("a column");
    }
    group.close().expect("a group");
    writer.close().expect("a file");
    bytes
}

/// Level 5, uncompressed: a column vector for each name.
pub(crate) fn mat(names: &[String], columns: &[Vec<f64>]) -> Vec<u8> {
    let mut bytes = vec![b' '; 124];
    let head = b"MATLAB 5.0 MAT-file, made by a test";
    bytes[..head.len()].copy_from_slice(head);
    bytes.extend([0x00, 0x01, b'I', b'M']);
    let element = |bytes: &mut Vec<u8>, kind: u32, data: &[u8]| {
        bytes.extend(kind.to_le_bytes());
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(data);
        while !bytes.len().is_multiple_of(8) {
            bytes.push(0);
        }
    };
    for (name, column) in names.iter().zip(columns) {
        let mut array = Vec::new();
        // Array flags: of doubles.
        element(&mut array, 6, &[6, 0, 0, 0, 0, 0, 0, 0]);
        let size: Vec<u8> = [column.len() as u32, 1]
            .iter()
            .flat_map(|n| n.to_le_bytes())
            .collect();
        element(&mut array, 5, &size);
        element(&mut array, 1, name.as_bytes());
        let data: Vec<u8> = column.iter().flat_map(|v| v.to_le_bytes()).collect();
        element(&mut array, 9, &data);
        element(&mut bytes, 14, &array);
    }
    bytes
}

#[expect(clippy::too_many_lines, reason = "a list of formats")]
fn written(table: &Table) -> Vec<Written> {
    let (suffixed, bracketed, bare) = (table.suffixed(), table.bracketed(), table.bare());
    let commas = suffixed.join(",") + "\n" + &table.body(0, ",", ".", "\n");
    let preamble = "Logger 3.1; when: today\nby me; all mine\n\n".to_owned()
        + &bracketed.join(";")
        + "\r\n"
        + &table.body(0, ";", ",", "\r\n");
    let tabs = suffixed.join("\t") + "\r\n" + &table.body(0, "\t", ",", "\r\n");
    let wide: Vec<u8> = std::iter::once(0xfeff_u16)
        .chain(tabs.encode_utf16())
        .flat_map(u16::to_le_bytes)
        .collect();
    let big: Vec<u8> = tabs.encode_utf16().flat_map(u16::to_be_bytes).collect();
    let row_of_units = bare.join(";")
        + "\n"
        + &table.units.join(";").replace('u', "\u{b5}")
        + "\n"
        + &table.body(0, ";", ".", "\n");
    let latin: Vec<u8> = row_of_units.chars().map(|c| c as u32 as u8).collect();
    let bars = suffixed.join("|") + "\n" + &table.body(0, "|", ".", "\n");
    let blanks = format!("# {}\n", suffixed.join("  ")) + &table.body(0, "   ", ".", "\n");
    let mark = format!("\u{feff}{commas}");
    let quoted = suffixed
        .iter()
        .map(|n| format!("\"{n}\""))
        .collect::<Vec<_>>()
        .join(",")
        + "\n"
        + &table.body(0, ",", ".", "\n");
    let mut all: Vec<Written> = vec![
        ("commas", commas.into(), suffixed.clone()),
        ("a byte-order mark", mark.into(), suffixed.clone()),
        (
            "a preamble, brackets, decimal commas",
            preamble.into(),
            bracketed,
        ),
        ("UTF-16, tabs", wide, suffixed.clone()),
        (
            "UTF-16 of the other end, without a mark",
            big,
            suffixed.clone(),
        ),
        ("Latin-1, a row of units", latin, bare.clone()),
        ("bars", bars.into(), suffixed.clone()),
        (
            "blanks, names in a comment",
            blanks.into(),
            suffixed.clone(),
        ),
        ("quotes", quoted.into(), suffixed.clone()),
        (
            "Parquet",
            parquet(&suffixed, &table.columns),
            suffixed.clone(),
        ),
        ("MATLAB", mat(&suffixed, &table.columns), suffixed.clone()),
    ];
    if table.timed {
        let iso = {
            let mut text = format!("Time,{}\n", suffixed[1..].join(","));
            for k in 0..table.rows() {
                let t = table.columns[0][k];
                let (minutes, seconds) = ((t / 60.0).floor(), t % 60.0);
                let _ = writeln!(
                    text,
                    "2024-05-01T23:{:02}:{seconds:09.6}Z,{}",
                    minutes as u32,
                    table.row(k, 1, ",", ".")
                );
            }
            text
        };
        let period = table.columns[0][1] - table.columns[0][0];
        let mut recorder = format!(
            "# REM made by a test\n#\n# VERSION = 1\n# TYPE = 1\n# SEPARATOR = 32\n# DIM = {}\n# SAMPLE_TIME = {period:.6}\n# NDATA = {}\n",
            table.names.len() - 1,
            table.rows()
        );
        for (k, name) in suffixed[1..].iter().enumerate() {
            let _ = writeln!(recorder, "# NAME{k} = {name}");
        }
        recorder += "# END_HEADER\n";
        recorder += &table.body(1, " ", ".", "\n");
        let scope = {
            let names: Vec<String> = suffixed[1..].iter().map(|n| format!("Name;{n}")).collect();
            let times: Vec<String> = suffixed[1..]
                .iter()
                .map(|_| format!("SampleTime[ms];{}", 1e3 * period))
                .collect();
            let mut text = format!(
                "Name;a scope\nFile;C:\\scope.csv\n\n{}\n{}\n\n",
                names.join(";"),
                times.join(";")
            );
            for k in 0..table.rows() {
                let pairs: Vec<String> = table.columns[1..]
                    .iter()
                    .map(|c| {
                        format!(
                            "{:.6};{:.9}",
                            1e3 * (table.columns[0][k] - table.columns[0][0]),
                            c[k]
                        )
                        .replace('.', ",")
                    })
                    .collect();
                let _ = writeln!(text, "{}", pairs.join(";"));
            }
            text
        };
        all.push((
            "ISO times",
            iso.into(),
            [vec!["Time".to_owned()], suffixed[1..].to_vec()].concat(),
        ));
        all.push(("a data recorder's", recorder.into(), suffixed.clone()));
        all.push(("a scope's", scope.into(), suffixed));
    }
    all
}

/// Numbers that a command makes of a file, by the columns behind the first.
type Made = fn(&Path, &[String]) -> Result<Vec<f64>, String>;

fn alike(what: &str, table: &Table, make: Made, tolerance: f64) -> Vec<String> {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let mut wrong = Vec::new();
    let mut first: Option<Vec<f64>> = None;
    for (how, bytes, names) in written(table) {
        fs::write(&path, bytes).expect("a file");
        match make(&path, &names) {
            Err(error) => wrong.push(format!("{what}, {how}: {error}")),
            Ok(found) => {
                let first = first.get_or_insert_with(|| found.clone());
                let same = first.len() == found.len()
                    && first
                        .iter()
                        .zip(&found)
                        .all(|(a, b)| (a - b).abs() <= tolerance * (a.abs() + b.abs()) + 1e-15);
                if !same {
                    let (a, b) = (&first[..first.len().min(6)], &found[..found.len().min(6)]);
                    wrong.push(format!("{what}, {how}: {b:?} for {a:?}"));
                }
            }
        }
    }
    wrong
}

/// Time, and columns over it.
/// Name, unit and what it is over time.
type Over<'a> = (&'static str, &'static str, &'a dyn Fn(f64) -> f64);

fn timed(n: usize, period: f64, of: &[Over]) -> Table {
    let time: Vec<f64> = (0..n).map(|k| period * k as f64).collect();
    let mut columns = vec![time.clone()];
    columns.extend(
        of.iter()
            .map(|(.., f)| time.iter().map(|t| f(*t)).collect::<Vec<f64>>()),
    );
    Table {
        names: std::iter::once("t").chain(of.iter().map(|o| o.0)).collect(),
        units: std::iter::once("s").chain(of.iter().map(|o| o.1)).collect(),
        columns,
        timed: true,
    }
}

#[test]
#[expect(clippy::too_many_lines, reason = "a list of commands")]
fn every_command_reads_every_file() {
    let mut wrong = Vec::new();
    let place = |t: f64| 100.0 * (1.3 * t).sin() + 3.0 * (4.0 * t).cos();
    let force = |t: f64| 2.0 * (3.0 * (1.3 * t).cos()).tanh() + 0.01 * (17.0 * t).sin();
    let table = timed(4000, 0.005, &[("x", "um", &place), ("f", "N", &force)]);
    let make: Made = |path, names| {
        let roles = friction::Roles {
            time: None,
            rate: None,
            displacement: Named::new(&*names[1]),
            force: Named::new(&*names[2]),
        };
        let read = roles.read(path).map_err(|e| e.to_string())?;
        let found = friction::friction(&read, None, 3, None);
        let known = found.answer.parameters.iter().filter_map(|(p, _)| p.known);
        Ok(known.map(|k| k.value).collect())
    };
    wrong.extend(alike("friction", &table, make, 1e-3));

    let rows = crate::windup::made(1);
    let column = |c: usize| rows.iter().map(|r| r[c]).collect::<Vec<f64>>();
    let table = Table {
        names: vec!["t", "m", "l"],
        units: vec!["s", "deg", "deg"],
        columns: vec![column(0), column(1), column(2)],
        timed: true,
    };
    let make: Made = |path, names| {
        let roles = windup::Roles {
            time: None,
            rate: None,
            motor: Named::new(&*names[1]),
            load: Named::new(&*names[2]),
            torque: None,
            ratio: 1.0,
        };
        let read = roles.read(path).map_err(|e| e.to_string())?;
        let found = windup::windup(&read, None);
        let raw = found
            .answer
            .more
            .get("raw_deg")
            .and_then(serde_json::Value::as_f64);
        raw.map(|raw| vec![raw]).ok_or(found.answer.verdict)
    };
    wrong.extend(alike("windup", &table, make, 1e-3));

    let volts = |t: f64| 50.0 - 45.0 * (6.0 * t).cos();
    let moved = |t: f64| 12.0 - 11.0 * (6.0 * t - 0.1).cos();
    let table = timed(2000, 0.005, &[("u", "V", &volts), ("d", "um", &moved)]);
    let make: Made = |path, names| {
        let columns = Columns {
            input: names[1].clone(),
            output: names[2].clone(),
            time: None,
        };
        let data = Data::open(path, None).map_err(|e| e.to_string())?;
        let read = data.record(&columns, None).map_err(|e| e.to_string())?;
        let r = read.record;
        Ok([r.input, r.output, vec![r.time[1] - r.time[0]]].concat())
    };
    wrong.extend(alike("hysteresis", &table, make, 1e-5));

    let table = timed(
        300,
        0.002,
        &[("u", "mV", &|t: f64| 100.0 * (40.0 * t).sin())],
    );
    let make: Made = |path, _| {
        let read = input::read(path, Kind::Voltage, &input::Chosen::default())
            .map_err(|e| e.to_string())?;
        Ok(read.rows.into_iter().flat_map(|(t, v)| [t, v]).collect())
    };
    wrong.extend(alike("simulate", &table, make, 1e-5));

    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let frequency: Vec<f64> = (1..=300).map(|k| 2.0 * f64::from(k)).collect();
    let polar: Vec<(f64, f64)> = frequency
        .iter()
        .map(|f| {
            let o = 180.0;
            let (re, im) = (o * o - f * f, 2.0 * 0.03 * o * f);
            (
                o * o / re.hypot(im) * (1.0 + 0.003 * normal(&mut rng)),
                -im.atan2(re).to_degrees(),
            )
        })
        .collect();
    let table = Table {
        names: vec!["f", "gain", "phase"],
        units: vec!["Hz", "dB", "deg"],
        columns: vec![
            frequency,
            polar.iter().map(|p| 20.0 * p.0.log10()).collect(),
            polar.iter().map(|p| p.1).collect(),
        ],
        timed: false,
    };
    let make: Made = |path, names| {
        let named = |k: usize| Some(Named::new(&*names[k]));
        let roles = resonance::Roles {
            frequency: named(0),
            magnitude: named(1),
            phase: named(2),
            ..resonance::Roles::default()
        };
        let (answer, _) = resonance::resonance(&roles, path).map_err(|e| e.to_string())?;
        let known = answer.parameters.iter().filter_map(|(p, _)| p.known);
        Ok(known.map(|k| k.value).take(2).collect())
    };
    wrong.extend(alike("resonance", &table, make, 1e-3));

    let mut columns = vec![Vec::new(), Vec::new(), Vec::new()];
    for i in 0..15 {
        for j in 0..15 {
            let (x, y) = (0.5 * f64::from(i), 0.5 * f64::from(j));
            columns[0].push(x);
            columns[1].push(y);
            columns[2].push(1.5 * (-((x - 3.2).powi(2) + (y - 4.1).powi(2)) / 4.0).exp() + 0.1);
        }
    }
    let table = Table {
        names: vec!["x", "y", "power"],
        units: vec!["um", "um", "mW"],
        columns,
        timed: false,
    };
    let make: Made = |path, _| {
        let columns = map::Columns {
            names: None,
            place: None,
            power: None,
            inverted: false,
            step: None,
            settled: false,
        };
        let read = map::read(path, &columns).map_err(|e| e.to_string())?;
        let readings = read.scan.readings();
        Ok(readings
            .iter()
            .flat_map(|r| [r.at.x, r.at.y, r.power])
            .collect())
    };
    wrong.extend(alike("map", &table, make, 1e-6));
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// A file that is cut off or mangled within is refused, and nothing panics.
#[test]
fn binary_files_that_are_broken_are_refused() {
    let names = ["a", "b"].map(str::to_owned);
    let columns = vec![(0..200).map(f64::from).collect::<Vec<_>>(); 2];
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r");
    for good in [parquet(&names, &columns), mat(&names, &columns)] {
        for cut in (8..good.len()).step_by(97) {
            fs::write(&path, &good[..cut]).expect("a file");
            let _ = input::read(&path, Kind::Voltage, &input::Chosen::default());
            let mut turned = good.clone();
            turned[cut] ^= 0xa5;
            fs::write(&path, turned).expect("a file");
            let _ = input::read(&path, Kind::Voltage, &input::Chosen::default());
        }
        fs::write(&path, &good[..good.len() / 2]).expect("a file");
        assert!(input::read(&path, Kind::Voltage, &input::Chosen::default()).is_err());
    }
    assert!(File::open(&path).is_ok());
}
