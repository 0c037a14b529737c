//! What an editor is told of a file: the schemas accept what the program reads, and mark what it refuses.

use assert_cmd::Command;
use jsonschema::Validator;
use pigtail::FileKind;
use pigtail_hal::quantity::{ANGLE, INTEGRAL, LENGTH, Sign, TORQUE};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn validator(kind: FileKind) -> Validator {
    jsonschema::validator_for(&kind.schema()).expect("a schema")
}

fn document(text: &str) -> Value {
    let table: toml::Table = text.parse().expect("TOML");
    serde_json::to_value(table).expect("JSON")
}

/// The files of a folder below the root.
fn files(folder: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(Path::new(ROOT).join(folder)).expect("a folder");
    entries
        .map(|entry| entry.expect("an entry").path())
        .collect()
}

/// Each shipped file with its kind: a rig's is named as its kind is.
fn shipped() -> Vec<(PathBuf, FileKind)> {
    let rigs = files("rigs");
    let of_rigs = rigs.iter().flat_map(|rig| {
        let files = fs::read_dir(rig).expect("a rig");
        let files = files.map(|entry| entry.expect("an entry").path());
        // What marks the rig that ships is no file of a kind.
        let toml = files.filter(|file| file.extension().is_some());
        toml.map(|file| {
            let name = file.file_stem().and_then(|name| name.to_str());
            let name = name.expect("a name");
            let bench = rig.ends_with("bench-piezo");
            let name = if bench {
                format!("bench-{name}")
            } else {
                name.to_owned()
            };
            let kind = name.parse().expect("a kind");
            (file, kind)
        })
    });
    let recipes = files("recipes").into_iter();
    let trays = files("trays").into_iter();
    let fleets = files("rigs/afpm/fleets").into_iter();
    of_rigs
        .chain(fleets.map(|file| (file, FileKind::Fleet)))
        .chain(recipes.map(|file| {
            let name = file.file_name().and_then(|name| name.to_str());
            let production = name.is_some_and(|name| name.starts_with("produce-"));
            let kind = if production {
                FileKind::Production
            } else {
                FileKind::Recipe
            };
            (file, kind)
        }))
        .chain(trays.map(|file| (file, FileKind::Tray)))
        .collect()
}

#[test]
fn every_shipped_file_is_valid() {
    let shipped = shipped();
    assert!(shipped.len() >= 5, "{shipped:?}");
    for (file, kind) in shipped {
        let document = document(&fs::read_to_string(&file).expect("a file"));
        let errors: Vec<_> = validator(kind)
            .iter_errors(&document)
            .map(|error| format!("{}: {error}", error.instance_path()))
            .collect();
        assert!(errors.is_empty(), "{}: {errors:#?}", file.display());
    }
}

/// Whatever table a key is put into, at any depth, it is marked when no such key exists.
#[test]
fn a_misspelt_key_is_not_valid_anywhere() {
    fn plant(value: &Value, path: &str, tables: &mut Vec<String>) {
        if let Value::Object(keys) = value {
            tables.push(path.to_owned());
            for (key, inner) in keys {
                plant(inner, &format!("{path}/{key}"), tables);
            }
        }
    }
    for (file, kind) in shipped() {
        let validator = validator(kind);
        let document = document(&fs::read_to_string(&file).expect("a file"));
        let mut tables = Vec::new();
        plant(&document, "", &mut tables);
        // What `identify hysteresis` writes is checked by the program alone.
        let written = |table: &str| table.starts_with("/hysteresis") && table.ends_with("/micro");
        // Below its tables a fleet has any key of two other files: the program knows which.
        let free = |table: &str| kind == FileKind::Fleet && !table.is_empty();
        let checked = |table: &&String| !written(table) && !free(table);
        for table in tables.iter().filter(checked) {
            let mut document = document.clone();
            let keys = document.pointer_mut(table).and_then(Value::as_object_mut);
            keys.expect("a table")
                .insert("sped".to_owned(), "1 mm/s".into());
            assert!(!validator.is_valid(&document), "{}{table}", file.display());
        }
    }
}

#[test]
fn what_the_program_refuses_by_itself_is_marked() {
    let machine =
        fs::read_to_string(Path::new(ROOT).join("rigs/afpm/machine.toml")).expect("a file");
    let validator = validator(FileKind::Machine);
    for (key, wrong) in [
        ("/z_stage/travel", Value::from("25 kg")),
        ("/z_stage/travel", Value::from("-25 mm")),
        ("/z_stage/travel", Value::from("0 mm")),
        ("/z_stage/travel", Value::from(0.025)),
        ("/vision/latency", Value::from("-1 ms")),
        ("/photodiode/bits", Value::from(1.5)),
        ("/sensing_fiber/offset", serde_json::json!(["1 um", "2 um"])),
    ] {
        let mut document = document(&machine);
        *document.pointer_mut(key).expect("a key") = wrong.clone();
        assert!(!validator.is_valid(&document), "{key} = {wrong}");
    }
    let mut lacking = document(&machine);
    lacking["servo"]
        .as_object_mut()
        .expect("a table")
        .remove("rate");
    assert!(!validator.is_valid(&lacking));
}

/// The pattern of a quantity says the same as the program does, of what a person may come to write.
#[test]
fn a_quantity_is_read_where_it_is_valid() {
    let numbers = [
        "1", "+1", "-1", "1.", ".5", "0.5", "0", "0.0", "00.10", "1e-3", "1E+3", "0e3", "", ".",
        "e3", "1e", "1,5", "1 2", "--1", "abc",
    ];
    let spaces = ["", " ", "  "];
    for (kind, key, dimension, sign) in [
        (FileKind::Machine, "/z_stage/travel", LENGTH, Sign::Positive),
        (FileKind::Machine, "/micro/angle", ANGLE, Sign::Any),
        (
            FileKind::Plant,
            "/five_bar/bearings/friction",
            TORQUE,
            Sign::NonNegative,
        ),
        (
            FileKind::Calibration,
            "/gains/z/ki",
            INTEGRAL,
            Sign::NonNegative,
        ),
    ] {
        let (file, _) = shipped()
            .into_iter()
            .find(|(_, of)| *of == kind)
            .expect("a file of this kind");
        let mut document = document(&fs::read_to_string(file).expect("a file"));
        let validator = validator(kind);
        let others = ["kg", "M", "", "V/(count  s)"];
        let units = dimension.units.iter().map(|(unit, _)| *unit).chain(others);
        for unit in units {
            for number in numbers {
                for space in spaces {
                    let text = format!("{number}{space}{unit}");
                    *document.pointer_mut(key).expect("a key") = text.clone().into();
                    assert_eq!(
                        validator.is_valid(&document),
                        dimension.parse(&text, sign).is_ok(),
                        "{key} = \"{text}\""
                    );
                }
            }
        }
    }
}

/// A default stands in a schema as a file would have it.
#[test]
fn every_default_is_valid_itself() {
    fn check(schema: &Value, count: &mut usize) {
        match schema {
            Value::Object(keys) => {
                if let Some(default) = keys.get("default") {
                    let mut alone = schema.clone();
                    alone.as_object_mut().expect("an object").remove("allOf");
                    assert!(jsonschema::is_valid(&alone, default), "{schema}");
                    *count += 1;
                }
                keys.values().for_each(|inner| check(inner, count));
            }
            Value::Array(values) => values.iter().for_each(|inner| check(inner, count)),
            _ => {}
        }
    }
    let mut count = 0;
    for kind in [
        FileKind::Machine,
        FileKind::Plant,
        FileKind::Calibration,
        FileKind::Fleet,
        FileKind::Recipe,
    ] {
        check(&kind.schema(), &mut count);
    }
    assert!(count > 40, "{count} defaults");
}

#[test]
fn a_recipe_of_old_is_valid() {
    let recipe = fs::read_to_string(Path::new(ROOT).join("recipes/y-branch.toml")).expect("a file");
    assert!(recipe.contains("[fast.conical_scan]"));
    let old = document(&recipe.replace("[fast.conical_scan]", "[fast.orbit]"));
    assert!(validator(FileKind::Recipe).is_valid(&old));
}

fn pigtail(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .args(arguments)
        .output()
        .expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

#[test]
fn the_program_prints_a_schema_lists_the_kinds_and_refuses_others() {
    let (code, out, _) = pigtail(&["schema", "machine"]);
    assert_eq!(code, Some(0));
    let printed: Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(printed, FileKind::Machine.schema());
    let (code, out, _) = pigtail(&["schema"]);
    assert_eq!(code, Some(0));
    for kind in [
        "machine",
        "plant",
        "calibration",
        "measured",
        "fleet",
        "recipe",
    ] {
        assert!(out.lines().any(|line| line.starts_with(kind)), "{out}");
    }
    let (code, out, error) = pigtail(&["schema", "rig"]);
    assert_eq!((code, out.as_str()), (Some(2), ""));
    assert!(
        error.contains("machine, plant, calibration, measured, fleet, recipe"),
        "{error}"
    );
}
