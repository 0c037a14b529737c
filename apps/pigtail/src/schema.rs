//! `pigtail schema`.

use crate::choice::choice;
use crate::{DONE, Failure};
use clap::Args;
use pigtail_control::calibration::Calibration;
use pigtail_control::recipe::Recipe;
use pigtail_cycle::recipe::Production;
use pigtail_cycle::tray::Tray;
use pigtail_hal::Spec;
use pigtail_hal::bench::spec::BenchSpec;
use pigtail_session::bench::BenchCalibration;
use pigtail_session::fleet::FleetKeys;
use pigtail_twin::bench::BenchPlant;
use pigtail_twin::plant::Plant;
use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema};
use serde_json::Value;
use strum::{EnumMessage, VariantArray};

/// Print the JSON Schema of a kind of file, for an editor
///
/// With it an editor completes the keys of a rig or a recipe, shows their meaning, and marks what is misspelt,
/// missing or in a wrong unit while it is written. Without a further word the kinds are listed.
///
/// A schema checks each key by itself. Whether the keys fit each other is checked by `pigtail rig check`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail schema
  pigtail schema machine > machine.schema.json

An editor with taplo (such as Even Better TOML of VS Code) finds it by the first line of the file:
  #:schema ./machine.schema.json")]
pub(crate) struct Arguments {
    /// The kind of file, one of those that are listed without it
    #[arg(value_name = "FILE-KIND", value_parser = choice::<FileKind>())]
    kind: Option<FileKind>,
}

/// A kind of file that people write, and that has a schema.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum FileKind {
    /// machine.toml of a rig: the datasheet
    Machine,
    /// plant.toml of a rig: the truth, which only the twin reads
    Plant,
    /// calibration.toml of a rig: the belief, which only control reads
    Calibration,
    /// measured.toml of a rig: keys of plant and calibration for the machine that `reproduce` measures on
    Measured,
    /// A fleet of a rig: what its machines, and the devices on them, may be
    Fleet,
    /// A recipe: a device and how to align it
    Recipe,
    /// A tray: devices, fibers and their places
    Tray,
    /// A production recipe: how the fibers of a tray become pigtails
    Production,
    /// machine.toml of a bench that is controlled by position
    BenchMachine,
    /// plant.toml of such a bench
    BenchPlant,
    /// calibration.toml of such a bench
    BenchCalibration,
}

impl FileKind {
    /// The JSON Schema of such a file: draft 7, which every editor knows.
    pub fn schema(self) -> Value {
        match self {
            Self::Machine => schema::<Spec>(),
            Self::Plant => schema::<Plant>(),
            Self::Calibration => schema::<Calibration>(),
            Self::Measured => {
                let mut schema = schema::<Measured>();
                allow_parts(&mut schema);
                schema
            }
            Self::Fleet => schema::<FleetKeys>(),
            Self::Recipe => schema::<Recipe>(),
            Self::Tray => schema::<Tray>(),
            Self::Production => schema::<Production>(),
            Self::BenchMachine => schema::<BenchSpec>(),
            Self::BenchPlant => schema::<BenchPlant>(),
            Self::BenchCalibration => schema::<BenchCalibration>(),
        }
    }
}

/// Where the machine that `reproduce` measures on departs from the rig's files.
#[derive(JsonSchema)]
#[schemars(deny_unknown_fields)]
#[expect(
    dead_code,
    reason = "its tables are read as changes of two other files"
)]
struct Measured {
    /// Keys of `plant.toml` that are otherwise.
    plant: Option<Plant>,
    /// Keys of `calibration.toml` that are otherwise.
    calibration: Option<Calibration>,
}

fn schema<T: JsonSchema>() -> Value {
    let mut settings = SchemaSettings::draft07();
    let tidy = RecursiveTransform(|schema: &mut Schema| {
        leave_null_out(schema);
        in_plain_words(schema);
    });
    // First: draft 7 then sees a table that may be missing as any other table.
    settings.transforms.insert(0, Box::new(tidy));
    settings.into_generator().into_root_schema_for::<T>().into()
}

/// TOML has no null, and a quantity has an end: a key that may be missing is one that is not required, and
/// nothing more.
fn leave_null_out(schema: &mut Schema) {
    let endless = |default: &Value| {
        default
            .as_str()
            .is_some_and(|text| text.starts_with("inf "))
    };
    let nothing = |default: &Value| default.is_null() || endless(default);
    if schema.get("default").is_some_and(nothing) {
        schema.remove("default");
    }
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|of| of != "null");
        if let [only] = types.as_slice() {
            let only = only.clone();
            schema.insert("type".to_owned(), only);
        }
    }
    if let Some(Value::Array(any)) = schema.get_mut("anyOf") {
        any.retain(|of| of["type"] != "null");
        if let [Value::Object(only)] = any.as_slice() {
            let only = only.clone();
            schema.remove("anyOf");
            for (key, value) in only {
                schema.insert(key, value);
            }
        }
    }
}

/// A doc comment as one line; its links to other items lead nowhere outside of the code.
fn in_plain_words(schema: &mut Schema) {
    let Some(Value::String(text)) = schema.get_mut("description") else {
        return;
    };
    *text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    *text = text.replace("[`", "`").replace("`]", "`");
    while let Some(start) = text.find("`(")
        && let Some(end) = text[start..].find(')')
    {
        text.replace_range(start + 1..=start + end, "");
    }
}

/// No key is required any more, at any depth.
fn allow_parts(schema: &mut Value) {
    match schema {
        Value::Object(keys) => {
            keys.remove("required");
            keys.values_mut().for_each(allow_parts);
        }
        Value::Array(values) => values.iter_mut().for_each(allow_parts),
        _ => {}
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let name = |&kind: &FileKind| -> &'static str { kind.into() };
    let text = if let Some(kind) = arguments.kind {
        serde_json::to_string_pretty(&kind.schema()).map_err(anyhow::Error::from)? + "\n"
    } else {
        let lines = FileKind::VARIANTS.iter().map(|kind| {
            let about = kind.get_documentation().unwrap_or_default();
            format!("{:<19}{about}\n", name(kind))
        });
        lines.collect()
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}
