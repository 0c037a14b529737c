//! Whatever a file says, reading it ends in a value or in an error that says where: never in a panic.

use pigtail::faults::Faults;
use pigtail::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Setup, Source};
use pigtail_machines::record::Reader;
use pigtail_machines::twin::faults::Injection;
use proptest::prelude::*;
use std::io::Write;

fn sources() -> Vec<Source> {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME)
        .expect("the default rig is well")
        .sources
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

proptest! {
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
