//! The book's reference is made from the code: commands from what the program's parser knows, keys of
//! the files from the structs that they are read into. `UPDATE_PAGES=1 cargo test -p pigtail --test
//! pages` writes the pages anew.

use clap::Command;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use syn::{Attribute, Expr, Field, Fields, Item, ItemEnum, ItemStruct, Lit, Meta, Type};

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

/// What a file of sources says of the keys of a configuration file.
#[derive(Default)]
struct Sources {
    structs: BTreeMap<String, ItemStruct>,
    enums: BTreeMap<String, ItemEnum>,
    /// `Default`s that are written out: of each struct the fields' values as they stand there.
    defaults: BTreeMap<String, BTreeMap<String, String>>,
    /// Functions without arguments, which give defaults.
    functions: BTreeMap<String, String>,
}

impl Sources {
    fn new(files: &[&str]) -> Self {
        let mut sources = Self::default();
        for file in files {
            let parsed = syn::parse_file(&read(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
            for item in parsed.items {
                sources.add(item);
            }
        }
        sources
    }

    fn add(&mut self, item: Item) {
        match item {
            Item::Struct(item) => {
                self.structs.insert(item.ident.to_string(), item);
            }
            Item::Enum(item) => {
                self.enums.insert(item.ident.to_string(), item);
            }
            Item::Fn(item) if item.sig.inputs.is_empty() => {
                if let [syn::Stmt::Expr(value, None)] = item.block.stmts.as_slice() {
                    self.functions
                        .insert(item.sig.ident.to_string(), expression(value));
                }
            }
            Item::Impl(item) => {
                let is_default = item
                    .trait_
                    .as_ref()
                    .is_some_and(|(_, path, _)| path.is_ident("Default"));
                let (true, Type::Path(of)) = (is_default, &*item.self_ty) else {
                    return;
                };
                let Some(syn::ImplItem::Fn(function)) = item.items.first() else {
                    return;
                };
                if let [syn::Stmt::Expr(Expr::Struct(values), None)] =
                    function.block.stmts.as_slice()
                {
                    let fields = values.fields.iter().map(|field| {
                        let syn::Member::Named(name) = &field.member else {
                            panic!("a field has a name")
                        };
                        (name.to_string(), expression(&field.expr))
                    });
                    let of = of.path.segments.last().expect("a name").ident.to_string();
                    self.defaults.insert(of, fields.collect());
                }
            }
            _ => {}
        }
    }

    /// The tables of a struct and of those in it, `path` being where it stands in the file.
    fn tables(&self, text: &mut String, name: &str, path: &str, shipped: &toml::Table) {
        let item = &self.structs[name];
        let title = if path.is_empty() {
            "At the top".to_owned()
        } else {
            format!("`[{path}]`")
        };
        let _ = writeln!(text, "### {title}\n\n{}\n", doc(&item.attrs));
        let mut inside = Vec::new();
        let mut rows = String::new();
        let named = if let Fields::Named(named) = &item.fields {
            named.named.iter().collect::<Vec<_>>()
        } else {
            // What is made from other keys.
            let keys = serde(&item.attrs, "try_from").expect("a struct of keys");
            let Fields::Named(named) = &self.structs[&keys].fields else {
                panic!("{keys} has no keys")
            };
            named.named.iter().collect()
        };
        for field in named {
            if flag(&field.attrs, "skip") {
                continue;
            }
            let rust = field.ident.as_ref().expect("a name").to_string();
            let key = serde(&field.attrs, "rename").unwrap_or_else(|| rust.clone());
            let here = if path.is_empty() {
                key.clone()
            } else {
                format!("{path}.{key}")
            };
            let (of, optional) = Self::type_of(&field.ty);
            if self.structs.contains_key(&of) {
                inside.push((of, here));
                continue;
            }
            let default = self.where_left_out(item, field, &rust, optional);
            let there = at(shipped, &here).map_or_else(|| "-".to_owned(), value);
            let _ = writeln!(
                rows,
                "| `{key}` | {} | {} | {default} | {there} |",
                doc(&field.attrs),
                self.accepted(field, &of),
            );
        }
        if !rows.is_empty() {
            let _ = writeln!(
                text,
                "| key | meaning (inside, SI) | accepted | where it is left out | shipped |\n\
                 |---|---|---|---|---|\n{rows}"
            );
        }
        for (of, here) in inside {
            self.tables(text, &of, &here, shipped);
        }
    }

    fn where_left_out(
        &self,
        item: &ItemStruct,
        field: &Field,
        rust: &str,
        optional: bool,
    ) -> String {
        let written = || {
            let of = self.defaults.get(&item.ident.to_string())?;
            of.get(rust).map(|value| format!("`{value}` (SI)"))
        };
        if flag(&item.attrs, "default") {
            return written().expect("a struct with a default has it written out");
        }
        match serde(&field.attrs, "default") {
            Some(function) => match self.functions[&function].as_str() {
                "f64 :: INFINITY" => "none".to_owned(),
                value => format!("`{value}` (SI)"),
            },
            None if optional => "none".to_owned(),
            None if flag(&field.attrs, "default") => match Self::type_of(&field.ty).0.as_str() {
                "f64" => "`0`".to_owned(),
                of => {
                    let item = &self.enums[of];
                    let variant = item
                        .variants
                        .iter()
                        .find(|v| v.attrs.iter().any(|a| a.path().is_ident("default")))
                        .expect("an enum with a default");
                    format!("`{}`", variant_name(item, variant))
                }
            },
            None => "required".to_owned(),
        }
    }

    /// The last word of a type behind `Option` and `Box`, and whether it was optional.
    fn type_of(ty: &Type) -> (String, bool) {
        let Type::Path(path) = ty else {
            return ("array".to_owned(), false);
        };
        let last = path.path.segments.last().expect("a name");
        let name = last.ident.to_string();
        if let ("Option" | "Box", syn::PathArguments::AngleBracketed(arguments)) =
            (name.as_str(), &last.arguments)
            && let Some(syn::GenericArgument::Type(inner)) = arguments.args.first()
        {
            let (of, optional) = Self::type_of(inner);
            return (of, optional || name == "Option");
        }
        (name, false)
    }

    fn accepted(&self, field: &Field, of: &str) -> String {
        if let Some(with) = serde(&field.attrs, "deserialize_with") {
            return quantity(with.rsplit("::").next().expect("a name"));
        }
        if let Some(item) = self.enums.get(of) {
            let names: Vec<String> = item
                .variants
                .iter()
                .map(|v| format!("`{}`", variant_name(item, v)))
                .collect();
            return names.join(", ");
        }
        match of {
            "String" => "text",
            "u32" | "u64" => "a whole number of zero or more",
            "f64" => "a number",
            "array" => "an array of numbers",
            "Vec" => "an array of pairs of numbers",
            "MicroModel" => "a table that `identify hysteresis` writes",
            other => panic!("nothing is known of the type {other}"),
        }
        .to_owned()
    }
}

fn variant_name(item: &ItemEnum, variant: &syn::Variant) -> String {
    if let Some(name) = serde(&variant.attrs, "rename") {
        return name;
    }
    let name = variant.ident.to_string();
    match serde(&item.attrs, "rename_all").as_deref() {
        Some("lowercase") => name.to_lowercase(),
        Some("kebab-case") => {
            let mut kebab = String::new();
            for letter in name.chars() {
                if letter.is_uppercase() && !kebab.is_empty() {
                    kebab.push('-');
                }
                kebab.extend(letter.to_lowercase());
            }
            kebab
        }
        _ => name,
    }
}

/// What a function of `pigtail_hal::quantity` accepts, in its own words where it has some.
fn quantity(function: &str) -> String {
    match function {
        "positive" => return "a number above zero".to_owned(),
        "non_negative" => return "a number of zero or more".to_owned(),
        "fraction" => return "a number from 0 to 1".to_owned(),
        "one_or_more" => return "a number of one or more".to_owned(),
        "lengths" => return "an array of lengths (m, mm, um, nm)".to_owned(),
        "points" => return "an array of points, each of lengths (m, mm, um, nm)".to_owned(),
        "angles" => return "an array of angles (deg, rad, mrad)".to_owned(),
        _ => {}
    }
    let (sign, dimension) = if let Some(rest) = function.strip_prefix("optional_") {
        (" above zero", rest)
    } else if let Some(rest) = function.strip_prefix("positive_") {
        (" above zero", rest)
    } else if let Some(rest) = function.strip_prefix("non_negative_") {
        (" of zero or more", rest)
    } else {
        ("", function)
    };
    let source = read("crates/hal/src/quantity.rs");
    let start = format!("    {} {dimension} ", dimension.to_uppercase());
    let at = source
        .find(&start)
        .unwrap_or_else(|| panic!("no dimension {dimension}"));
    let entry = &source[at..at + source[at..].find(';').expect("an end")];
    let (head, units) = entry.split_once('[').expect("units");
    let name = head.split('"').nth(1).expect("a name");
    let units: Vec<&str> = units.split('"').skip(1).step_by(2).collect();
    format!("{name}{sign} ({})", units.join(", "))
}

fn expression(value: &Expr) -> String {
    use quote::ToTokens;
    match value {
        // `Type::default()` and the like stand for a table of defaults of its own.
        Expr::Call(_) => "its own".to_owned(),
        other => other.to_token_stream().to_string(),
    }
}

/// The doc comment as one line of Markdown; links to items become code.
fn doc(attributes: &[Attribute]) -> String {
    let mut lines = Vec::new();
    for attribute in attributes {
        if let Meta::NameValue(pair) = &attribute.meta
            && pair.path.is_ident("doc")
            && let Expr::Lit(literal) = &pair.value
            && let Lit::Str(text) = &literal.lit
        {
            lines.push(text.value().trim().to_owned());
        }
    }
    let mut text = lines.join(" ").replace("[`", "`").replace("`]", "`");
    // Where a link leads to is of no use outside of the code.
    while let Some(at) = text.find("`(") {
        let end = text[at..].find(')').expect("a link ends");
        text.replace_range(at + 1..=at + end, "");
    }
    text.replace('|', "\\|")
}

/// The value of a serde attribute.
fn serde(attributes: &[Attribute], key: &str) -> Option<String> {
    let mut found = None;
    each_serde(attributes, |name, value| {
        if name == key {
            found = value.or(found.take());
        }
    });
    found
}

/// Whether a serde attribute without a value is there.
fn flag(attributes: &[Attribute], key: &str) -> bool {
    let mut found = false;
    each_serde(attributes, |name, value| {
        found |= name == key && value.is_none();
    });
    found
}

fn each_serde(attributes: &[Attribute], mut see: impl FnMut(&str, Option<String>)) {
    for attribute in attributes.iter().filter(|a| a.path().is_ident("serde")) {
        attribute
            .parse_nested_meta(|meta| {
                let name = meta.path.get_ident().expect("a word").to_string();
                let value = match meta.value() {
                    Ok(value) => Some(value.parse::<syn::LitStr>()?.value()),
                    Err(_) => None,
                };
                see(&name, value);
                Ok(())
            })
            .expect("a serde attribute");
    }
}

/// The value at a path of a file, if it is there.
fn at<'t>(table: &'t toml::Table, path: &str) -> Option<&'t toml::Value> {
    let mut keys = path.split('.');
    let mut value = table.get(keys.next()?)?;
    for key in keys {
        value = value.get(key)?;
    }
    Some(value)
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
         `rigs/afpm` and in `recipes/y-branch.toml`. This page is made from the structs that the files \
         are read into; a test fails when it is out of date.\n\n\
         A rig may have a fourth file, `measured.toml`, with the tables `plant` and `calibration`: keys of those \
         two files for the machine that `reproduce` measures on, where it is not the one of the files themselves. \
         Nothing else reads it.\n\n",
    );
    for (file, about, shipped, root, sources) in [
        (
            "machine.toml",
            "The datasheet: everyone may read it.",
            "rigs/afpm/machine.toml",
            "Spec",
            &["crates/hal/src/spec.rs"][..],
        ),
        (
            "plant.toml",
            "The truth: only the twin reads it.",
            "rigs/afpm/plant.toml",
            "Plant",
            &[
                "crates/twin/src/plant.rs",
                "crates/twin/src/plant/joint.rs",
                "crates/twin/src/unrest.rs",
            ],
        ),
        (
            "calibration.toml",
            "The belief: only control reads it. Programs that measure write it.",
            "rigs/afpm/calibration.toml",
            "Calibration",
            &[
                "crates/control/src/calibration.rs",
                "crates/control/src/impulse/belief.rs",
            ],
        ),
        (
            "A recipe",
            "A device and how to align it.",
            "recipes/y-branch.toml",
            "Recipe",
            &[
                "crates/control/src/recipe.rs",
                "crates/control/src/recipe/fast.rs",
            ],
        ),
    ] {
        let _ = writeln!(text, "## {file}\n\n{about}\n");
        let values: toml::Table = read(shipped).parse().expect("TOML");
        Sources::new(sources).tables(&mut text, root, "", &values);
    }
    page("files.md", &text);
}
