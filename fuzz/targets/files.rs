//! The four files of a rig and a recipe: the first byte says which of them is given.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Source};
use pigtail_session::setup::Setup;
use std::sync::LazyLock;

static GOOD: LazyLock<Vec<Source>> = LazyLock::new(|| {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME)
        .expect("the default rig is well")
        .sources
});

fuzz_target!(|data: &[u8]| {
    let Some((which, text)) = data.split_first() else {
        return;
    };
    let Ok(text) = std::str::from_utf8(text) else {
        return;
    };
    let mut sources = GOOD.clone();
    let which = usize::from(*which) % sources.len();
    sources[which].text = text.to_owned();
    let name = sources[which].name.clone();
    if let Err(error) = Setup::from_sources(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME, sources) {
        // What is wrong is in this file, or between it and another, which then is named.
        let said = error.to_string();
        assert!(said.contains(".toml"), "{name}: {said}");
    }
});
