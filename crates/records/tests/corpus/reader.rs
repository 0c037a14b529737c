//! One record as all the programs of this world write it.

use crate::servo;
use pigtail_records::columns::Named;
use pigtail_records::servo::{Roles, servo as servo_of};
use pigtail_sysid::servo::{Friction, Settings};
use std::fmt::Write as _;
use std::fs;

/// A record's names and rows between some characters.
fn written(names: &str, between: &str, decimal: &str, end: &str, columns: &[usize]) -> String {
    let mut text = names.replace('|', between);
    text += end;
    for row in servo::plain(7).iter().take(3000) {
        let fields: Vec<String> = columns
            .iter()
            .map(|c| format!("{:.7}", row[*c]).replace('.', decimal))
            .collect();
        let _ = write!(text, "{}{end}", fields.join(between));
    }
    text
}

fn utf16(text: &str) -> Vec<u8> {
    std::iter::once(0xfeff)
        .chain(text.encode_utf16())
        .flat_map(u16::to_le_bytes)
        .collect()
}

/// What it is, its bytes, the columns of reference, position and voltage, and the rate.
type File = (&'static str, Vec<u8>, [&'static str; 3], Option<f64>);

const ALL: [usize; 4] = [0, 1, 2, 3];

#[test]
fn a_record_is_the_same_however_it_is_written() {
    let plain = |names: &str| written(names, ",", ".", "\n", &ALL);
    let names = "t_s|r_m|q_m|u_V";
    let iso = {
        let mut text = "Time,r_m,q_m,u_V\n".to_owned();
        for [t, r, q, u] in servo::plain(7).iter().take(3000) {
            let _ = writeln!(
                text,
                "2024-05-01T23:59:{:06.3},{r:.7},{q:.7},{u:.7}",
                50.0 + t.min(9.999)
            );
        }
        text
    };
    let recorder = "# REM\n#\n# SAMPLE_TIME = 0.001\n# NAME0 = r_m\n# NAME1 = q_m\n# NAME2 = u_V\n# END_HEADER\n";
    let recorder = recorder.to_owned() + &written("", " ", ".", "\n", &ALL[1..]);
    let scope = {
        let mut text = "Name;a scope\n\nName;r_m;Name;q_m;Name;u_V\nSampleTime[ms];1;SampleTime[ms];1;SampleTime[ms];1\n\n"
            .to_owned();
        for (k, [_, r, q, u]) in servo::plain(7).iter().take(3000).enumerate() {
            let _ = writeln!(text, "{k};{r:.7};{k};{q:.7};{k};{u:.7}");
        }
        text
    };
    let preamble =
        "Logger 3.1\nWhen: today; by: me\n\n".to_owned() + &written(names, ";", ",", "\r\n", &ALL);
    let units = written("t|r|q|u\n[s]|[m]|[m]|[V]", ";", ".", "\n", &ALL);
    let bare = ["r", "q", "u"];
    let usual = ["r_m", "q_m", "u_V"];
    let cases: [File; 12] = [
        ("commas", plain("t_s,r_m,q_m,u_V").into(), usual, None),
        (
            "a byte-order mark",
            format!("\u{feff}{}", plain("t_s,r_m,q_m,u_V")).into(),
            usual,
            None,
        ),
        (
            "carriage returns alone",
            written(names, ",", ".", "\r", &ALL).into(),
            usual,
            None,
        ),
        (
            "semicolons",
            written(names, ";", ".", "\n", &ALL).into(),
            usual,
            None,
        ),
        ("decimal commas, a preamble", preamble.into(), usual, None),
        (
            "tabs, decimal commas, UTF-16",
            utf16(&written(names, "\t", ",", "\r\n", &ALL)),
            usual,
            None,
        ),
        (
            "blanks, names in a comment",
            written("# t_s|r_m|q_m|u_V", "  ", ".", "\n", &ALL).into(),
            usual,
            None,
        ),
        ("units in a row", units.into(), bare, None),
        ("ISO times", iso.into(), usual, None),
        (
            "no time and a rate",
            written("r_m|q_m|u_V", ",", ".", "\n", &ALL[1..]).into(),
            usual,
            Some(1000.0),
        ),
        ("a data recorder's", recorder.into(), usual, None),
        ("a scope's", scope.into(), usual, None),
    ];
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    for (what, content, [reference, position, voltage], rate) in cases {
        fs::write(&path, content).expect("a file");
        let roles = Roles {
            time: None,
            rate,
            reference: Some(Named::new(reference)),
            position: Named::new(position),
            voltage: Named::new(voltage),
            injected: None,
        };
        let read = roles
            .read(&path)
            .unwrap_or_else(|error| panic!("{what}: {error}"));
        let even = read.record.even();
        assert_eq!(even.samples(), 3000, "{what}: {}", read.understood);
        assert!((even.period - 1e-3).abs() < 1e-9, "{what}: {}", even.period);
        for (k, row) in servo::plain(7).iter().take(3000).enumerate() {
            let found = even.stretches[0].columns[0][k];
            assert!(
                (found - row[2]).abs() < 1e-7,
                "{what} {k}: {found} for {}",
                row[2]
            );
        }
    }
}

#[test]
fn what_is_no_record_is_refused_in_words() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let commas = written("t_s|r_m|q_m|u_V", ",", ",", "\n", &ALL);
    let mixed = written("t_s|r_m|q_m|u_V", ";", ",", "\n", &ALL) + "1.5;0;0;0\n";
    let cases: [(&str, Vec<u8>, &str); 8] = [
        ("nothing", Vec::new(), "is empty"),
        ("names alone", b"t_s,r_m,q_m,u_V\n".to_vec(), "no rows"),
        (
            "prose",
            b"Dear reader\nthis is a letter\n".to_vec(),
            "no such column",
        ),
        (
            "commas between and within",
            commas.into(),
            "commas between the fields and in the numbers",
        ),
        ("both decimal marks", mixed.into(), "decimal point"),
        ("a spreadsheet", b"PK\x03\x04xxxx".to_vec(), "spreadsheet"),
        ("no text", b"\x00\x01".to_vec(), "which no text has"),
        ("Parquet", b"PAR1xxxx".to_vec(), "Parquet"),
    ];
    for (what, content, says) in cases {
        fs::write(&path, content).expect("a file");
        let roles = Roles {
            time: Some(Named::new("t_s")),
            rate: None,
            reference: None,
            position: Named::new("q_m"),
            voltage: Named::new("u_V"),
            injected: None,
        };
        let error = roles.read(&path).expect_err(what).to_string();
        assert!(error.contains(says), "{what}: {error}");
    }
}

/// As other people's tools write them: a typesetter's minus is read, the rest is refused with what to do.
#[test]
fn habits_of_other_tools_are_read_or_refused_in_words() {
    let plain = written("t_s|r_m|q_m|u_V", ",", ".", "\n", &ALL);
    let read = |text: &str, position: &str| {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("r.csv");
        fs::write(&path, text).expect("a file");
        let roles = Roles {
            time: None,
            rate: None,
            reference: None,
            position: Named::new(position),
            voltage: Named::new("u_V"),
            injected: None,
        };
        roles.read(&path).map_err(|e| e.to_string())
    };
    let good = read(&plain, "q_m").expect("a record").record;
    let typeset = read(&plain.replace('-', "\u{2212}"), "q_m").expect("a record");
    assert_eq!(typeset.record, good);
    let inner = plain
        .trim_end()
        .replace(',', "\",\"")
        .replace('\n', "\"\n\"");
    let quoted = format!("\"{inner}\"\n");
    assert_eq!(read(&quoted, "q_m").expect("a record").record, good);
    // Symbols over units, as by ISO 80000; a delimiter behind each row's last field.
    let symbols = plain.replacen("t_s,r_m,q_m,u_V", "t/s,r / m,q / m,u_V", 1);
    assert_eq!(read(&symbols, "q / m").expect("a record").record, good);
    assert_eq!(
        read(&plain.replace('\n', ",\n"), "q_m")
            .expect("a record")
            .record,
        good
    );
    let (head, rows) = plain.split_once('\n').expect("rows");
    let refused = [
        (
            format!("{plain}{head}\n{rows}"),
            "q_m",
            "several recordings",
        ),
        (format!("{plain}{rows}"), "q_m", "time that rises"),
        (format!("{plain}mean,0.1,0.1,0\n"), "q_m", "is no number"),
        (
            plain.replace("q_m", "q_in"),
            "q_in",
            "no unit that is read here",
        ),
        (
            plain.replace("q_m", "q_cm"),
            "q_cm",
            "no unit that is read here",
        ),
        (
            plain.replace("q_m", "q_percent"),
            "q_percent",
            "no unit that is read here",
        ),
        (
            plain.replace("q_m", "q [counts]"),
            "q [counts]",
            "no unit that is read here",
        ),
        (
            plain.replace("u_V", "u_%").replace("q_m", "q [rpm]"),
            "q [rpm]",
            "no unit that is read here",
        ),
        (plain.replace("\n0.0", "\n1,000.0"), "q_m", "fields"),
        (plain.replace("\n0.0", "\n1'000.0"), "q_m", "is no number"),
    ];
    for (text, position, why) in refused {
        let error = read(&text, position).expect_err(why);
        assert!(error.contains(why), "{why}: {error}");
    }
}

/// What an instrument writes that is of two recordings, or of channels with times of their own, is not taken for one.
#[test]
fn exports_of_several_recordings_or_rates_are_refused_in_words() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let read = |content: &str, time: Option<&str>, [position, voltage]: [&str; 2]| {
        fs::write(&path, content).expect("a file");
        let roles = Roles {
            time: time.map(Named::new),
            rate: None,
            reference: None,
            position: Named::new(position),
            voltage: Named::new(voltage),
            injected: None,
        };
        roles.read(&path).map_err(|e| e.to_string())
    };
    let rows = servo::plain(7);
    // A channel that nobody asks for, at twice the rate of the others; its scale factor is that of the scope's picture.
    let mut scope =
        "Name;Scope\n\nName;other;Name;q;Name;u\nScaleFactor;1;ScaleFactor;0,001;ScaleFactor;1\n\
                     Unit;mm;Unit;m;Unit;V\n\n"
            .to_owned();
    for (k, [t, _, q, u]) in rows.iter().take(3000).enumerate() {
        let (fast, slow) = (0.5 * k as f64, 1e3 * t);
        let _ = writeln!(scope, "{fast};1.5;{slow};{q:.9};{slow};{u:.7}");
    }
    let scope = scope.replace('.', ",");
    let error = read(&scope, None, ["q", "u"]).expect_err("another channel's time");
    assert!(error.contains("--time \"time_ms 2\""), "{error}");
    let own = read(&scope, Some("time_ms 2:ms"), ["q", "u"]).expect("their own time");
    assert!((own.record.even().period - servo::PERIOD).abs() < 1e-9);
    assert!(own.understood.contains("a factor"), "{}", own.understood);
    // Two recordings of a data recorder in one file.
    let header = "# REM\n# SEPARATOR = 9\n# SAMPLE_TIME = 0.001\n# NAME0 = q_m\n# NAME1 = u_V\n# END_HEADER\n";
    let mut table = header.to_owned();
    for [_, _, q, u] in rows.iter().take(2000) {
        let _ = writeln!(table, "{q:.9}\t{u:.7}");
    }
    read(&table, None, ["q_m", "u_V"]).expect("one recording");
    let error = read(&format!("{table}{table}"), None, ["q_m", "u_V"]).expect_err("two");
    assert!(error.contains("another recording begins here"), "{error}");
    // Moments counted in nanoseconds are read as such where their name says so, and asked for where it does not.
    let counted = |name: &str| {
        let mut text = format!("{name},q_m,u_V\n");
        for [t, _, q, u] in rows.iter().take(2000) {
            let _ = writeln!(text, "{:.0},{q:.9},{u:.7}", 1e9 * t);
        }
        text
    };
    let named = read(&counted("t_ns"), Some("t_ns"), ["q_m", "u_V"]).expect("nanoseconds");
    assert!((named.record.even().period - servo::PERIOD).abs() < 1e-9);
    let error = read(&counted("t"), None, ["q_m", "u_V"]).expect_err("no unit");
    assert!(
        error.contains("is it in another unit (as \"t:ns\")"),
        "{error}"
    );
}

/// A name that two columns have is no name, what a current drives is told as that, and what is left out of a .mat is said.
#[test]
fn what_a_name_leaves_open_is_asked_or_said() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let read = |names: &str, scale: f64, [position, voltage]: [&str; 2]| {
        let mut text = names.to_owned() + "\n";
        for [t, r, q, u] in servo::plain(7).iter().take(3000) {
            let _ = writeln!(text, "{t:.7},{r:.7},{q:.7},{:.7}", scale * u);
        }
        fs::write(&path, text).expect("a file");
        let roles = Roles {
            time: None,
            rate: None,
            reference: None,
            position: Named::new(position),
            voltage: Named::new(voltage),
            injected: None,
        };
        roles.read(&path).map_err(|e| e.to_string())
    };
    let twice = read("t_s,q_m,q_m,u_V", 1.0, ["q_m", "u_V"]).expect_err("two columns");
    assert!(twice.contains("stands over 2 columns"), "{twice}");
    let volts = read("t_s,r_m,q_m,u_V", 1.0, ["q_m", "u_V"]).expect("volts");
    let amperes = read("t_s,r_m,q_m,i_mA", 1e3, ["q_m", "i_mA"]).expect("a current");
    let column =
        |read: &pigtail_records::servo::Read| read.record.even().stretches[0].columns[1].clone();
    for (a, b) in column(&volts).iter().zip(column(&amperes)) {
        assert!((a - b).abs() < 2e-7, "{a} {b}");
    }
    let says = |remarks: &[String]| remarks.iter().any(|r| r.contains("is a current"));
    assert!(says(&amperes.remarks) && !says(&volts.remarks));
    // The end of a channel's name is no unit where no current is wanted.
    let channel = read("t_s,r_m,encoder_A,u_V", 1.0, ["encoder_A", "u_V"]).expect("a channel");
    assert_eq!(channel.record, volts.record);
}

#[test]
fn vectors_of_another_length_are_named() {
    let names = ["t_s", "x_um", "f_N"].map(str::to_owned);
    let long: Vec<f64> = (0..300).map(f64::from).collect();
    let columns = vec![long.clone(), long.clone(), long[..200].to_vec()];
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.mat");
    fs::write(&path, crate::everywhere::mat(&names, &columns)).expect("a file");
    let roles = pigtail_records::friction::Roles {
        time: None,
        rate: None,
        displacement: Named::new("x_um"),
        force: Named::new("f_N"),
    };
    let error = roles.read(&path).expect_err("no force").to_string();
    assert!(
        error.contains("f_N is left out: it has 200 values"),
        "{error}"
    );
}

/// What an inertia would be in another unit or at another rate is what it is when the record is read so.
#[test]
fn an_inertia_in_another_unit_is_the_one_that_is_said() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("r.csv");
    let mut text = "r,q,u\n".to_owned();
    // Behind its first motion, which saturates.
    for [_, r, q, u] in &servo::plain(7)[2000..10_000] {
        let _ = writeln!(text, "{r:.9},{q:.9},{u:.6}");
    }
    fs::write(&path, text).expect("a file");
    let found = |position: &str, reference: &str, rate: f64| {
        let roles = Roles {
            time: None,
            rate: Some(rate),
            reference: Some(Named::new(reference)),
            position: Named::new(position),
            voltage: Named::new("u:V"),
            injected: None,
        };
        let read = roles.read(&path).expect("a record");
        // A hundredth of what it is, so that it is an axis in either unit.
        let set = Settings::new(0.35);
        let found = servo_of(&read, None, &set, (Friction::Symmetric, None)).answer;
        let inertia = found.parameters[0].0.known.map(|k| k.value);
        (
            inertia.unwrap_or_else(|| panic!("{}", found.verdict)),
            found.remarks,
        )
    };
    let (_, remarks) = found("q", "r", 1000.0);
    let said = |were: &str| -> f64 {
        let remark = remarks.iter().find(|r| r.contains(were));
        let remark = remark.unwrap_or_else(|| panic!("{were}: {remarks:?}"));
        let (_, number) = remark
            .split_once("the inertia would be ")
            .expect("an inertia");
        number.trim_end_matches(" kg").parse().expect("a number")
    };
    for (were, (is, _)) in [
        ("were q in mm", found("q:mm", "r:mm", 1000.0)),
        ("were the rows taken at 2000 Hz", found("q", "r", 2000.0)),
    ] {
        let said = said(were);
        assert!((said / is - 1.0).abs() < 0.01, "{were}: {said} for {is}");
    }
    let (_, named) = found("q:m", "r:m", 1000.0);
    assert!(!named.iter().any(|r| r.contains("in mm")), "{named:?}");
}
