//! Names of old in files that people have stay valid.

use pigtail_session::Rig;
use std::fs;
use std::path::Path;

#[test]
fn a_recipe_may_call_its_conical_scan_an_orbit() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recipes/y-branch.toml");
    let text = fs::read_to_string(shipped).expect("the shipped recipe");
    let of_old = text
        .replace("[fast.conical_scan]", "[fast.orbit]")
        .replace("turns = 10", "turns = 7");
    assert!(of_old.contains("[fast.orbit]") && of_old.contains("turns = 7"));
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("old.toml");
    fs::write(&file, &of_old).expect("a file");
    let rig = Rig::load("afpm", &file.display().to_string()).expect("a recipe of old");
    assert_eq!(rig.recipe.fast.conical_scan.turns, 7);
}
