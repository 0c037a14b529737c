//! The book's reference is made from the program: commands from what its parser knows, keys of the files
//! from the JSON Schemas of the types that they are read into. `UPDATE_PAGES=1 cargo test -p pigtail --test
//! pages` writes the pages anew.

use clap::Command;
use pigtail::FileKind;
use pigtail_control::calibration::Calibration;
use pigtail_control::recipe::Recipe;
use pigtail_control::tuning;
use pigtail_cycle::recipe::Production;
use pigtail_hal::Spec;
use pigtail_hal::bench::spec::BenchSpec;
use pigtail_session::bench::BenchCalibration;
use pigtail_session::fleet::FleetKeys;
use pigtail_twin::bench::BenchPlant;
use pigtail_twin::plant::Plant;
use serde::de::value::{Error, MapDeserializer, SeqDeserializer};
use serde::de::{Deserializer, Error as _, IntoDeserializer, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Compares a page with what it should be, or writes it.
fn page(name: &str, wanted: &str) {
    let path = root().join("book/src/reference").join(name);
    if std::env::var_os("UPDATE_PAGES").is_some() {
        fs::write(&path, wanted).expect("the page can be written");
    }
    let there = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        there == wanted,
        "{} is out of date; `UPDATE_PAGES=1 cargo test -p pigtail --test pages` writes it",
        path.display()
    );
}

#[test]
fn the_page_of_commands_is_what_the_program_knows() {
    let mut text = String::from(
        "# Commands\n\nEach section is what `--help` prints. This page is made from the program; a test \
         fails when it is out of date.\n\n",
    );
    let mut command = pigtail::command().term_width(96);
    command.build();
    add_command(&mut text, &mut command, "");
    page("commands.md", &text);
}

fn add_command(text: &mut String, command: &mut Command, before: &str) {
    let name = format!("{before}{}", command.get_name());
    let help = command.render_long_help().to_string();
    let help: Vec<&str> = help.lines().map(str::trim_end).collect();
    let _ = writeln!(
        text,
        "## {name}\n\n```text\n{}\n```\n",
        help.join("\n").trim_end()
    );
    for sub in command.get_subcommands_mut() {
        if sub.get_name() != "help" && !sub.is_hide_set() {
            add_command(text, sub, &format!("{name} "));
        }
    }
}

/// Asks a type for the keys of the table at a path, in the order in which they are declared: a schema knows
/// them by name only. The answer comes as the error.
#[derive(Clone, Copy)]
struct Order<'p>(&'p [&'p str]);

impl<'de> Deserializer<'de> for Order<'_> {
    type Error = Error;

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.0.split_first() {
            None => Err(Error::custom(fields.join(" "))),
            Some((&key, rest)) => {
                visitor.visit_map(MapDeserializer::new(std::iter::once((key, Order(rest)))))
            }
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_seq(SeqDeserializer::new(std::iter::once(self)))
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("no table"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf unit unit_struct
        newtype_struct tuple tuple_struct map enum identifier ignored_any
    }
}

impl IntoDeserializer<'_> for Order<'_> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

fn order<T: for<'de> Deserialize<'de>>(path: &[&str]) -> Vec<String> {
    let told = T::deserialize(Order(path))
        .err()
        .expect("no file")
        .to_string();
    told.split(' ').map(str::to_owned).collect()
}

/// A kind of file: its schema, the order of its keys, and a file of this kind that is shipped.
struct File {
    schema: Value,
    order: fn(&[&str]) -> Vec<String>,
    shipped: toml::Table,
}

impl File {
    /// The table at a path and those in it; `how` says what is said of it where it stands.
    fn table(&self, text: &mut String, path: &[&str], table: &Value, how: &str) {
        let title = if path.is_empty() {
            "At the top".to_owned()
        } else {
            format!("`[{}]`", path.join("."))
        };
        let _ = writeln!(text, "### {title}\n\n{}{how}\n", description(table));
        let keys = table["properties"].as_object().expect("a table has keys");
        let order = (self.order)(path);
        let mut named: Vec<_> = keys
            .iter()
            // A former name is for files of old.
            .filter(|(_, key)| key["deprecated"] != true)
            .collect();
        named.sort_by_key(|(name, _)| order.iter().position(|of| of == *name).expect("declared"));
        let required = |name: &str| {
            let all = table["required"].as_array();
            all.is_some_and(|all| all.iter().any(|of| of == name))
        };
        let (mut inside, mut rows) = (Vec::new(), String::new());
        for (name, key) in named {
            let mut here = path.to_vec();
            here.push(name);
            let of = self.resolved(key);
            if of.get("properties").is_some() {
                inside.push((here, of, how_it_stands(key, of, required(name))));
                continue;
            }
            let each = self.resolved(&of["items"]);
            if each.get("properties").is_some() {
                let how = how_it_stands(key, each, required(name)) + " There are several.";
                inside.push((here, each, how));
                continue;
            }
            let default = match key.get("default") {
                Some(default) => value(&toml::Value::try_from(default).expect("TOML")),
                None if required(name) => "required".to_owned(),
                None => "none".to_owned(),
            };
            let shipped = at(&self.shipped, &here).map_or_else(|| "-".to_owned(), value);
            let _ = writeln!(
                rows,
                "| `{name}` | {} | {} | {default} | {shipped} |",
                description(key).replace('|', "\\|"),
                accepted(of),
            );
        }
        if !rows.is_empty() {
            let _ = writeln!(
                text,
                "| key | meaning (inside, SI) | accepted | where it is left out | shipped |\n\
                 |---|---|---|---|---|\n{rows}"
            );
        }
        for (here, of, how) in inside {
            self.table(text, &here, of, &how);
        }
    }

    /// What a schema refers to, or itself.
    fn resolved<'s>(&'s self, schema: &'s Value) -> &'s Value {
        let whole = schema["allOf"].as_array().and_then(|all| all.first());
        let whole = whole.unwrap_or(schema);
        match whole["$ref"].as_str() {
            Some(place) => self.schema.pointer(&place[1..]).expect("a definition"),
            None => whole,
        }
    }
}

/// What is said of a table where it stands, beside what is said of all of its kind.
fn how_it_stands(key: &Value, of: &Value, required: bool) -> String {
    let mut how = String::new();
    let here = description(key);
    if !description(of).starts_with(here.trim_end_matches('.')) {
        let _ = write!(how, " {here}");
    }
    match &key["default"] {
        Value::Null if required => {}
        Value::Null => how.push_str(" May be left out."),
        default => {
            let default = toml::Value::try_from(default).expect("TOML");
            let _ = write!(how, " Where it is left out it is `{default}`.");
        }
    }
    how
}

fn description(schema: &Value) -> &str {
    schema["description"].as_str().unwrap_or_default()
}

/// What a key accepts, in words.
fn accepted(schema: &Value) -> String {
    // A quantity says it itself.
    if let Some(title) = schema["title"].as_str() {
        return title.to_owned();
    }
    if let Some(values) = schema["oneOf"].as_array() {
        let names: Vec<_> = values.iter().map(|of| format!("`{}`", text(of))).collect();
        return names.join(", ");
    }
    let bound = |key: &str| schema[key].as_f64();
    match schema["type"].as_str().expect("a type") {
        "string" => "text".to_owned(),
        "boolean" => "true or false".to_owned(),
        of @ ("number" | "integer") => {
            let number = if of == "integer" {
                "a whole number"
            } else {
                "a number"
            };
            match (
                bound("exclusiveMinimum"),
                bound("minimum"),
                bound("maximum"),
            ) {
                (None, None, None) => number.to_owned(),
                (Some(0.0), None, None) => format!("{number} above zero"),
                (None, Some(0.0), None) => format!("{number} of zero or more"),
                (None, Some(1.0), None) => format!("{number} of one or more"),
                (None, Some(least), Some(most)) => format!("{number} from {least} to {most}"),
                other => panic!("nothing is known of bounds {other:?}"),
            }
        }
        "object" => "tables of keys".to_owned(),
        "array" => {
            let count = schema["maxItems"].as_u64().map(|n| format!("{n} "));
            let each = match (&schema["items"]["type"], &schema["items"]["maxItems"]) {
                (Value::String(of), _) if of == "number" => "numbers",
                (Value::String(of), _) if of == "string" => "texts",
                (_, Value::Number(two)) if two.as_u64() == Some(2) => "pairs of numbers",
                _ => panic!("nothing is known of an array of {}", schema["items"]),
            };
            format!("an array of {}{each}", count.unwrap_or_default())
        }
        other => panic!("nothing is known of the type {other}"),
    }
}

fn text(one: &Value) -> &str {
    one["const"].as_str().expect("a name")
}

/// The value at a path of a file, if it is there.
fn at<'t>(table: &'t toml::Table, path: &[&str]) -> Option<&'t toml::Value> {
    let (first, rest) = path.split_first()?;
    rest.iter().try_fold(table.get(*first)?, |value, key| {
        // Of several tables the first.
        let one = value.as_array().and_then(|all| all.first());
        one.unwrap_or(value).get(*key)
    })
}

fn value(value: &toml::Value) -> String {
    const LONG: usize = 48;
    let text = value.to_string();
    if text.chars().count() > LONG {
        "(long)".to_owned()
    } else {
        format!("`{text}`")
    }
}

#[test]
fn the_page_of_files_is_what_is_read() {
    let mut text = String::from(
        "# Files\n\nA quantity is a text of a number and a unit, `\"5 um\"`. Inside all is SI. Unknown keys \
         are refused. Beside what stands here some keys are checked against each other; the error then \
         names the file, the key, the value and what would be accepted. \"Shipped\" is the value in \
         `rigs/afpm` and in `recipes/y-branch.toml`. This page is made from what \
         the program reads the files into, as are the schemas that `pigtail schema` prints for an editor; a test \
         fails when it is out of date.\n\n\
         A rig may have a `measured.toml` too, with the tables `plant` and `calibration`: keys of those \
         two files for the machine that `reproduce` measures on, where it is not the one of the files themselves. \
         Nothing else reads it.\n\n",
    );
    for (name, about, shipped, kind, order) in [
        (
            "machine.toml",
            "The datasheet: everyone may read it.",
            "rigs/afpm/machine.toml",
            FileKind::Machine,
            order::<Spec> as fn(&[&str]) -> Vec<String>,
        ),
        (
            "plant.toml",
            "The truth: only the twin reads it.",
            "rigs/afpm/plant.toml",
            FileKind::Plant,
            order::<Plant>,
        ),
        (
            "calibration.toml",
            "The belief: only control reads it. Programs that measure write it.",
            "rigs/afpm/calibration.toml",
            FileKind::Calibration,
            order::<Calibration>,
        ),
        (
            "A fleet",
            "What machines of a rig, and the devices on them, may be: `fleets/NAME.toml` in its folder, or any file \
             ([how it is written](../howto/fleets.md)). Only the twin is drawn from it; what of it is \
             a datasheet control is told. Shipped: `workshop`.",
            "rigs/afpm/fleets/workshop.toml",
            FileKind::Fleet,
            order::<FleetKeys>,
        ),
        (
            "A recipe",
            "A device and how to align it.",
            "recipes/y-branch.toml",
            FileKind::Recipe,
            order::<Recipe>,
        ),
        (
            "A production recipe",
            "How the fibers of a tray become pigtails.",
            "recipes/produce-fast.toml",
            FileKind::Production,
            order::<Production>,
        ),
        (
            "machine.toml of a bench",
            "The datasheet of a bench that is controlled by position ([implement your own](../howto/bench.md)). \"Shipped\" \
             is from here on the value in `rigs/bench-piezo`.",
            "rigs/bench-piezo/machine.toml",
            FileKind::BenchMachine,
            order::<BenchSpec>,
        ),
        (
            "plant.toml of a bench",
            "Its truth: only the twin reads it.",
            "rigs/bench-piezo/plant.toml",
            FileKind::BenchPlant,
            order::<BenchPlant>,
        ),
        (
            "calibration.toml of a bench",
            "The belief: poses that were taught.",
            "rigs/bench-piezo/calibration.toml",
            FileKind::BenchCalibration,
            order::<BenchCalibration>,
        ),
    ] {
        let _ = writeln!(text, "## {name}\n\n{about}\n");
        let file = File {
            schema: kind.schema(),
            order,
            shipped: read(shipped).parse().expect("TOML"),
        };
        file.table(&mut text, &[], &file.schema, "");
    }
    page("files.md", &text);
}

#[test]
fn the_page_of_tuning_is_what_alignment_goes_by() {
    let mut text = String::from(
        "# Tuning\n\nNumbers that alignment goes by and that are neither a recipe's, nor a datasheet's, nor belief about one machine: \
         thresholds, margins, counts. Each was found by looking at machines, nearly always at twins, so that on others alignment may do worse \
         by it. They stand in one place of the program (`control/tuning`), and no file changes them. This page is made from there; a test fails when it is \
         out of date.\n\n\
         Origin: an *equation*, or what is meant, has it so; somebody has *measured* how others do; makers or the thesis have *stated* it; or it was a \
         *choice*, which did well. A unit of 1 is none; a width is the distance at which the light has fallen to 1/e, a turn that of a circle, sigma a \
         standard deviation.\n\n\
         Shown to hold for is said of a topic as a whole: on these machines alignment was run with all of its numbers as they are, \
         with the figures of [fleets](../howto/fleets.md), [benches](../howto/bench.md), [the procedures](../explanation/fast.md) and \
         [production](../howto/produce.md). No number was varied by itself for that, but where its meaning says so.\n\n",
    );
    for topic in tuning::topics() {
        let shown: Vec<_> = topic.shown.iter().map(|shown| shown.machines()).collect();
        let _ = writeln!(
            text,
            "## {}\n\n`{}`. Shown to hold for: {}.\n\n| number | value | unit | origin | meaning |\n|---|---|---|---|---|",
            topic.about.trim_end_matches('.'),
            topic.key,
            shown.join("; "),
        );
        for number in topic.numbers {
            let _ = writeln!(
                text,
                "| `{}` | {} | {} | {} | {} |",
                number.key,
                number.value,
                number.unit,
                number.origin.name(),
                number.meaning
            );
        }
        text.push('\n');
    }
    page("tuning.md", &text);
}
