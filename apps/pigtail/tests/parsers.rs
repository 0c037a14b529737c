//! Whatever a file says, reading it ends in a value or in an error that says where: never in a panic.

use pigtail_machines::record::Reader;
use pigtail_records::columns::Named;
use pigtail_records::fragment::{AxisTable, Fragment, Kind, MotionTable, RecordTable};
use pigtail_records::map::{self, Columns};
use pigtail_records::part::{Drive, Part};
use pigtail_records::{friction, resonance, servo, windup};
use pigtail_session::faults::Faults;
use pigtail_session::own::Own;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Source};
use pigtail_session::setup::Setup;
use pigtail_twin::faults::Injection;
use proptest::prelude::*;
use std::io::Write;
use std::path::Path;

fn sources() -> Vec<Source> {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME)
        .expect("the default rig is well")
        .rig
        .sources
}

/// What `identify servo` writes of an axis.
fn fragment(kind: Kind) -> String {
    let axis = AxisTable {
        kind,
        force_per_volt: 8.0,
        inertia: 3.0,
        viscous: [25.0, 26.0],
        coulomb: [4.0, 4.1],
        offset: -0.5,
    };
    let motion = MotionTable {
        stroke: 0.02,
        speed: 0.5,
        acceleration: 6.0,
        voltage: 2.0,
        noise: 3e-8,
        bandwidth: 100.0,
    };
    let part = Part::new(
        &axis,
        None,
        &motion,
        &Drive::PLAIN,
        ("2026-01-01", "a test"),
    );
    Fragment {
        origin: "a test".to_owned(),
        axis,
        controller: None,
        record: RecordTable {
            file: "log.csv".into(),
            columns: std::collections::BTreeMap::new(),
        },
        motion: Some(motion),
        z_stage: None,
        five_bar: None,
        machine: None,
        calibration: None,
    }
    .with(part)
    .text()
    .expect("finite numbers")
}

/// A rig with an axis of one's own, whose fragment says this.
fn own(text: &str) -> Result<Setup, pigtail_hal::Error> {
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(text.as_bytes()).expect("written");
    let own = Own::read(&[file.path().to_owned()])?;
    let named = pigtail_session::rig::Named {
        rig: DEFAULT_RIG_NAME,
        recipe: DEFAULT_RECIPE_NAME,
        ..pigtail_session::rig::Named::default()
    };
    Setup::load_with(&named, &own, false)
}

#[test]
fn a_fragment_is_a_setup_as_it_is() {
    for kind in [Kind::Linear, Kind::Rotary] {
        let setup = own(&fragment(kind)).expect("a setup");
        assert!(setup.rig.spec.probe.is_none());
    }
}

/// A change to a text: a piece of it replaced by something that may be meant badly.
fn spoilt(text: &str, at: usize, length: usize, by: &str) -> String {
    let floor = |mut i: usize| {
        i = i.min(text.len());
        while !text.is_char_boundary(i) {
            i -= 1;
        }
        i
    };
    let (from, to) = (floor(at), floor(at.saturating_add(length)));
    format!("{}{by}{}", &text[..from], &text[to..])
}

fn bad() -> impl Strategy<Value = String> {
    prop_oneof![
        Just(String::new()),
        Just("-".to_owned()),
        Just("0".to_owned()),
        Just("1e308".to_owned()),
        Just("-1e-320".to_owned()),
        Just("nan".to_owned()),
        Just("inf".to_owned()),
        Just("\"\"".to_owned()),
        Just("[]".to_owned()),
        Just("= {".to_owned()),
        Just("\n[five_bar]\n".to_owned()),
        "[ -~]{1,12}",
        "\\PC{1,4}",
        any::<f64>().prop_map(|x| x.to_string()),
        any::<i64>().prop_map(|x| x.to_string()),
    ]
}

/// A table of numbers, some of which are spoilt.
fn table() -> impl Strategy<Value = String> {
    let value = prop_oneof![
        20 => (-1.0..1.0_f64).prop_map(|x| x.to_string()),
        4 => Just("0".to_owned()),
        1 => bad(),
    ];
    let time = prop_oneof![Just(1e-3), Just(0.0), Just(-1.0), 0.0..1e-3_f64];
    let row = (time, value.clone(), value);
    proptest::collection::vec(row, 0..120).prop_map(|rows| {
        let mut now = 0.0;
        let lines = rows.into_iter().map(|(step, x, y)| {
            now += step;
            format!("{now},{x},{y}\n")
        });
        std::iter::once("t,x,y\n".to_owned()).chain(lines).collect()
    })
}

/// Reads a table as everything that there is, and makes of it what can be made.
fn read(path: &Path) {
    let x = || Named::new("x");
    let y = || Named::new("y");
    let columns = Columns {
        names: Some(["t", "x", "y"].map(str::to_owned)),
        place: None,
        power: None,
        inverted: false,
        step: None,
        settled: false,
    };
    let _ = map::read(path, &columns);
    let roles = servo::Roles {
        rate: None,
        time: None,
        reference: None,
        position: x(),
        voltage: y(),
        injected: None,
    };
    let _ = roles.read(path);
    let roles = friction::Roles {
        rate: None,
        time: None,
        displacement: x(),
        force: y(),
    };
    if let Ok(record) = roles.read(path) {
        let _ = friction::friction(&record, None, 4, None);
    }
    let roles = windup::Roles {
        rate: None,
        time: None,
        motor: x(),
        load: y(),
        torque: None,
        ratio: 1.0,
    };
    if let Ok(record) = roles.read(path) {
        let _ = windup::windup(&record, None);
    }
    let roles = resonance::Roles {
        frequency: Some(Named::new("t")),
        magnitude: Some(x()),
        phase: Some(y()),
        parts: None,
        coherence: None,
    };
    let _ = resonance::resonance(&roles, path);
}

proptest! {
    #[test]
    fn any_table_is_read_or_refused(table in table(), at in 0.0..1.0_f64, by in bad()) {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        let at = (at * table.len() as f64) as usize;
        for text in [spoilt(&table, at, 3, &by), table] {
            file.as_file().set_len(0).expect("emptied");
            file.write_all(text.as_bytes()).expect("written");
            read(file.path());
        }
    }

    #[test]
    fn a_spoilt_file_is_an_error_or_a_setup(
        which in 0..4_usize,
        at in 0.0..1.0_f64,
        length in 0..12_usize,
        by in bad(),
    ) {
        let mut sources = sources();
        let text = &mut sources[which].text;
        let at = (at * text.len() as f64) as usize;
        *text = spoilt(text, at, length, &by);
        let names: Vec<_> = sources.iter().map(|source| source.name.clone()).collect();
        if let Err(error) = Setup::from_sources(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME, sources) {
            let said = error.to_string();
            prop_assert!(names.iter().any(|name| said.contains(name)), "{said}");
        }
    }

    #[test]
    fn a_spoilt_fragment_is_an_error_or_a_setup(
        turns in any::<bool>(),
        at in 0.0..1.0_f64,
        length in 0..12_usize,
        by in bad(),
    ) {
        let text = fragment(if turns { Kind::Rotary } else { Kind::Linear });
        let at = (at * text.len() as f64) as usize;
        if let Err(error) = own(&spoilt(&text, at, length, &by)) {
            prop_assert!(!error.to_string().is_empty());
        }
    }

    #[test]
    fn any_text_is_a_fault_or_an_error(text in "\\PC{0,40}", kind in "[a-z-]{1,20}", rest in "[:@a-z0-9.+-]{0,24}") {
        for text in [text, format!("{kind}{rest}"), format!("belt-slip{rest}")] {
            if let Ok(injection) = text.parse::<Injection>() {
                prop_assert_eq!(injection.to_string().parse::<Injection>(), Ok(injection));
            }
            let _ = text.parse::<Faults>();
        }
    }

    #[test]
    fn any_bytes_are_a_record_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..400), magic in any::<bool>()) {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        if magic {
            file.write_all(b"PIGTAIL1").expect("written");
        }
        file.write_all(&bytes).expect("written");
        if let Ok(mut reader) = Reader::open(file.path()) {
            while let Ok(Some(_)) = reader.next_exchange() {}
        }
    }
}
