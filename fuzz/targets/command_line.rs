//! The words after `pigtail`, a line each; and faults, which have a grammar of their own.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pigtail_session::faults::Faults;
use pigtail_twin::faults::Injection;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let words = std::iter::once("pigtail").chain(text.lines());
    let _ = pigtail::command().try_get_matches_from(words);
    for word in text.lines() {
        if let Ok(injection) = word.parse::<Injection>() {
            assert_eq!(injection.to_string().parse::<Injection>(), Ok(injection));
        }
        let _ = word.parse::<Faults>();
    }
});
