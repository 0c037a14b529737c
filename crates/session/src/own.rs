//! An axis of a person's own in a rig: fragments that were identified, put into the rig's three files.

use crate::rig::Source;
use pigtail_control::calibration::Calibration;
use pigtail_hal::{Axis, Error, Spec, config};
use pigtail_records::fragment::{Fragment, Kind};
use pigtail_records::part::{Slides, Winds};
use pigtail_twin::Plant;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use toml_edit::{DocumentMut, Item, TableLike, value};

/// Fragments, in the order in which they are put in.
#[derive(Debug, Clone, Default)]
pub struct Own {
    pieces: Vec<Piece>,
}

/// A fragment, and the file it is in.
#[derive(Debug, Clone)]
struct Piece {
    file: String,
    what: What,
}

#[derive(Debug, Clone)]
enum What {
    /// `identify servo`: a whole axis.
    Axis(Box<Fragment>),
    /// `identify friction`: friction of a load.
    Friction(Slides),
    /// `identify windup --data`: what winds up, for the twin.
    Transmission(Winds),
    /// `identify resonance`: the first resonance, hertz.
    Resonance(f64),
    /// Tables of a `calibration.toml`.
    Belief(toml::Table),
}

/// Tables of a calibration that may be brought.
const BELIEFS: [&str; 5] = ["gains", "geometry", "windup", "hysteresis", "impulse"];

const ACCEPTED: &str = "accepted is what identify servo, friction, windup --data or resonance wrote, what tune --from \
                        wrote, or the folder of such a run";

impl Own {
    /// Reads fragments: files, or folders of runs that hold them.
    ///
    /// # Errors
    ///
    /// When one cannot be read or is none.
    pub fn read(paths: &[PathBuf]) -> Result<Self, Error> {
        let mut pieces = Vec::new();
        for path in paths {
            if path.is_dir() {
                let files = ["plant.toml", "calibration.toml"].map(|file| path.join(file));
                let there: Vec<_> = files.iter().filter(|file| file.is_file()).collect();
                if there.is_empty() {
                    let message =
                        format!("holds neither plant.toml nor calibration.toml; {ACCEPTED}");
                    return Err(Error::new(path.display().to_string(), "", message));
                }
                for file in there {
                    pieces.push(piece(file)?);
                }
            } else {
                pieces.push(piece(path)?);
            }
        }
        for (k, piece) in pieces.iter().enumerate() {
            let again = |other: &&Piece| {
                std::mem::discriminant(&other.what) == std::mem::discriminant(&piece.what)
                    && other.axes() == piece.axes()
                    && !matches!(piece.what, What::Belief(_))
            };
            if let Some(first) = pieces[..k].iter().find(again) {
                let message = format!(
                    "tells of the same as {}; accepted is one of them",
                    first.file
                );
                return Err(Error::new(&piece.file, "", message));
            }
        }
        // A whole axis before what refines it, and what control believes of it at last.
        pieces.sort_by_key(|piece| match piece.what {
            What::Axis(_) => 0,
            What::Resonance(_) => 1,
            What::Transmission(_) => 2,
            What::Friction(_) => 3,
            What::Belief(_) => 4,
        });
        Ok(Self { pieces })
    }

    /// Whether there is nothing of it.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Whether it holds a whole axis, and no gains but those to begin with.
    pub fn is_untuned(&self) -> bool {
        let whole = |p: &Piece| matches!(p.what, What::Axis(_));
        let gains = |p: &Piece| matches!(&p.what, What::Belief(t) if t.contains_key("gains"));
        self.pieces.iter().any(whole) && !self.pieces.iter().any(gains)
    }

    /// The files that it was read from, in words.
    pub fn names(&self) -> String {
        let files: Vec<&str> = self.pieces.iter().map(|p| p.file.as_str()).collect();
        files.join(" and ")
    }

    /// That some of it is of this axis.
    ///
    /// # Errors
    ///
    /// When there are fragments, and none is of it.
    pub fn concerns(&self, axis: Axis) -> Result<(), Error> {
        let mine = |piece: &Piece| piece.axes().is_none_or(|a| a == name(axis));
        if self.pieces.is_empty() || self.pieces.iter().any(mine) {
            return Ok(());
        }
        let (first, other) = match axis {
            Axis::Z => ("an axis that turns", "fivebar"),
            Axis::A | Axis::B => ("an axis along a line", "z"),
        };
        let message = format!("is of {first}; accepted with it is the axis {other}");
        Err(Error::new(&self.pieces[0].file, "", message))
    }

    /// Puts it into a rig's `machine.toml`, `plant.toml` and `calibration.toml`. A whole axis brings no probe
    /// of its output: where it is to work, not to be measured on a bench, the rig's are left out.
    ///
    /// # Errors
    ///
    /// When the rig has a mistake, or a fragment and the rig make no machine together.
    pub fn put(&self, files: &mut [Source; 3], bench: bool) -> Result<(), Error> {
        for piece in &self.pieces {
            let spec = Spec::parse(&files[0].name, &files[0].text)?;
            let plant = Plant::parse(&files[1].name, &files[1].text)?;
            let belief = Calibration::parse(&files[2].name, &files[2].text, &spec)?;
            let mut rig = Rig {
                machine: document(&files[0])?,
                plant: document(&files[1])?,
                calibration: document(&files[2])?,
            };
            match &piece.what {
                What::Axis(fragment) => {
                    rig.axis(&piece.file, fragment)?;
                    if !bench {
                        rig.at_work(fragment, &spec, &belief);
                    }
                }
                What::Friction(slides) => {
                    let replaced = self.replaces(name(axis_of(slides.kind)));
                    rig.friction(slides, &spec, &plant, replaced);
                }
                What::Transmission(winds) => rig.transmission(winds, &spec, &plant),
                What::Resonance(hertz) => {
                    let whole = self.pieces.iter().find_map(|p| match &p.what {
                        What::Axis(fragment) => Some(axis_of(fragment.axis.kind)),
                        _ => None,
                    });
                    let Some(axis) = whole else {
                        let message = "does not say of which axis, nor what it moves; accepted is a resonance beside \
                                       what identify servo wrote of its axis";
                        return Err(Error::new(&piece.file, "resonance", message));
                    };
                    rig.resonance(*hertz, axis, &spec, &plant);
                }
                What::Belief(tables) => {
                    for (key, table) in tables {
                        merge(rig.calibration.as_table_mut(), key, table);
                    }
                }
            }
            let texts = [&rig.machine, &rig.plant, &rig.calibration].map(ToString::to_string);
            for (file, text) in files.iter_mut().zip(texts) {
                if file.text != text {
                    file.name = format!("{} with {}", file.name, piece.file);
                    file.text = text;
                }
            }
        }
        Ok(())
    }

    /// Whether a whole axis came for one of the rig.
    fn replaces(&self, axis: &str) -> bool {
        let whole = |p: &Piece| matches!(p.what, What::Axis(_)) && p.axes() == Some(axis);
        self.pieces.iter().any(whole)
    }
}

impl Piece {
    /// The kind of axis it is of, as tables name it; `None` of any.
    fn axes(&self) -> Option<&str> {
        match &self.what {
            What::Axis(fragment) => Some(name(axis_of(fragment.axis.kind))),
            What::Friction(slides) => Some(name(axis_of(slides.kind))),
            What::Transmission(winds) => Some(&winds.table),
            What::Resonance(_) | What::Belief(_) => None,
        }
    }
}

fn axis_of(kind: Kind) -> Axis {
    match kind {
        Kind::Linear => Axis::Z,
        Kind::Rotary => Axis::A,
    }
}

/// The name of an axis in tables of a calibration.
fn name(axis: Axis) -> &'static str {
    match axis {
        Axis::A | Axis::B => "five_bar",
        Axis::Z => "z",
    }
}

/// The name of its table in the other two files.
fn stage(axis: Axis) -> &'static str {
    match axis {
        Axis::A | Axis::B => "five_bar",
        Axis::Z => "z_stage",
    }
}

fn piece(path: &Path) -> Result<Piece, Error> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path)
        .map_err(|error| Error::new(&file, "", format!("cannot be read: {error}")))?;
    let table: toml::Table = config::parse(&file, &text)?;
    let of = |key: &str| match table.get(key) {
        Some(toml::Value::Table(inner)) => toml::to_string(inner).ok(),
        _ => None,
    };
    let what = if table.contains_key("axis") {
        What::Axis(Box::new(Fragment::read(path)?))
    } else if table.contains_key("law") {
        let Some(text) = of("part") else {
            let message = "is not there: a force against an angle, or a torque against a length, is no friction of a \
                           joint; accepted is a force against a length or a torque against an angle";
            return Err(Error::new(&file, "part", message));
        };
        let slides: Slides = config::parse(&file, &text)?;
        let known = ["coulomb-presliding", "maxwell-slip", "lugre"];
        if !known.contains(&slides.friction.as_str()) {
            let message = format!(
                "\"{}\" is no law; accepted are {}",
                slides.friction,
                known.join(", ")
            );
            return Err(Error::new(&file, "part.friction", message));
        }
        good(
            &file,
            "part",
            &[
                ("presliding", slides.presliding),
                ("fixed", slides.fixed),
                ("coulomb", slides.coulomb),
                ("stribeck", slides.stribeck.unwrap_or(1.0)),
            ],
        )?;
        What::Friction(slides)
    } else if let Some(text) = of("transmission") {
        let winds: Winds = config::parse(&file, &text)?;
        if !["five_bar", "z"].contains(&winds.table.as_str()) {
            let message = format!(
                "\"{}\" is no kind of axis; accepted are five_bar, z",
                winds.table
            );
            return Err(Error::new(&file, "transmission.table", message));
        }
        good(
            &file,
            "transmission",
            &[
                ("w_max", winds.w_max),
                ("presliding", winds.presliding),
                ("compliance", winds.compliance.unwrap_or(1.0)),
            ],
        )?;
        What::Transmission(winds)
    } else if let Some(toml::Value::Table(resonance)) = table.get("resonance") {
        let first = resonance.get("frequency_1").and_then(toml::Value::as_float);
        let hertz = first.unwrap_or(f64::NAN);
        good(&file, "resonance", &[("frequency_1", hertz)])?;
        What::Resonance(hertz)
    } else if !table.is_empty() && table.keys().all(|key| BELIEFS.contains(&key.as_str())) {
        What::Belief(table)
    } else {
        return Err(Error::new(&file, "", format!("is no fragment; {ACCEPTED}")));
    };
    Ok(Piece { file, what })
}

fn good(file: &str, table: &str, numbers: &[(&str, f64)]) -> Result<(), Error> {
    for (key, number) in numbers {
        if !(number.is_finite() && *number > 0.0) {
            let message = format!("is {number}; accepted is a finite number above zero");
            return Err(Error::new(file, format!("{table}.{key}"), message));
        }
    }
    Ok(())
}

fn document(file: &Source) -> Result<DocumentMut, Error> {
    file.text
        .parse()
        .map_err(|error: toml_edit::TomlError| Error::new(&file.name, "", error.message()))
}

/// The three files while they are changed.
struct Rig {
    machine: DocumentMut,
    plant: DocumentMut,
    calibration: DocumentMut,
}

impl Rig {
    /// An axis in place of the rig's: its plant, its drive, its gains, and nothing that was learnt of the other.
    fn axis(&mut self, file: &str, fragment: &Fragment) -> Result<(), Error> {
        let axis = axis_of(fragment.axis.kind);
        let plant = match axis {
            Axis::Z => &fragment.z_stage,
            Axis::A | Axis::B => &fragment.five_bar,
        };
        let missing = |key: &str| {
            let message = "is not there: the fragment is of the axis alone; accepted is one that identify servo wrote";
            Error::new(file, key, message)
        };
        let plant = plant.as_ref().ok_or_else(|| missing(stage(axis)))?;
        let machine = fragment
            .machine
            .as_ref()
            .ok_or_else(|| missing("machine"))?;
        let calibration = fragment
            .calibration
            .as_ref()
            .ok_or_else(|| missing("calibration"))?;
        merge(
            self.plant.as_table_mut(),
            stage(axis),
            &plant.clone().into(),
        );
        for (key, table) in machine {
            merge(self.machine.as_table_mut(), key, table);
        }
        for (key, table) in calibration {
            merge(self.calibration.as_table_mut(), key, table);
        }
        self.forget(axis);
        Ok(())
    }

    /// An axis that is to work: no faster than its record shows it, for nobody knows more of it, and without
    /// a probe of its output.
    fn at_work(&mut self, fragment: &Fragment, spec: &Spec, belief: &Calibration) {
        self.machine.remove("probe");
        let axis = axis_of(fragment.axis.kind);
        let Some(motion) = &fragment.motion else {
            return;
        };
        // Of the endpoint, which a link carries around its joint.
        let (arm, speed, acceleration) = match axis {
            Axis::Z => (1.0, spec.z_stage.speed, spec.z_stage.acceleration),
            Axis::A | Axis::B => (
                belief.geometry.five_bar.proximal,
                spec.five_bar.speed,
                spec.five_bar.acceleration,
            ),
        };
        for (key, allowed, seen, unit) in [
            ("speed", speed, 0.9 * arm * motion.speed, "m/s"),
            (
                "acceleration",
                acceleration,
                arm * motion.acceleration,
                "m/s2",
            ),
        ] {
            if seen < allowed {
                self.machine[stage(axis)][key] = value(format!("{seen:.6e} {unit}"));
            }
        }
    }

    /// What was measured of another axis than the one that is there now.
    fn forget(&mut self, axis: Axis) {
        for table in ["windup", "impulse"] {
            if let Some(table) = self
                .calibration
                .get_mut(table)
                .and_then(Item::as_table_like_mut)
            {
                table.remove(name(axis));
            }
        }
    }

    fn joint(&mut self, axis: Axis) -> &mut Item {
        &mut self.plant[stage(axis)]["joint"]
    }

    /// Friction of the load, in radians of the output. Of an axis that was identified as a whole it is a part
    /// of what the motor has to overcome, of the rig's own it stands in place of the load's.
    fn friction(&mut self, slides: &Slides, spec: &Spec, plant: &Plant, replaced: bool) {
        let axis = axis_of(slides.kind);
        // Way of the load for a radian of the output.
        let way = match axis {
            Axis::Z => plant.z_stage.lead / TAU,
            Axis::A | Axis::B => 1.0,
        };
        let (fixed, coulomb) = (slides.fixed.max(slides.coulomb) * way, slides.coulomb * way);
        let known = match axis {
            Axis::Z => &plant.z_stage.joint,
            Axis::A | Axis::B => &plant.five_bar.joint,
        };
        let viscous = slides
            .viscous
            .map_or(known.load_friction.viscous(), |v| v.max(0.0) * way * way);
        let rest =
            (known.motor_friction.coulomb() - coulomb / spec.drive(axis).gear_ratio).max(0.0);
        let motor = known.motor_friction.viscous();
        let joint = self.joint(axis);
        joint["friction"] = value(slides.friction.clone());
        joint["presliding"] = value(format!("{:.6e} rad", slides.presliding / way));
        joint["load_friction"] = levels(fixed, coulomb, viscous);
        if let Some(stribeck) = slides.stribeck {
            joint["stribeck"] = value(format!("{:.6e} rad/s", stribeck / way));
        }
        if replaced {
            joint["motor_friction"] = levels(rest, rest, motor);
        }
        self.forget(axis);
    }

    /// What winds up: the load's friction twists the transmission by `w_max`, along an exponential.
    fn transmission(&mut self, winds: &Winds, spec: &Spec, plant: &Plant) {
        let (axis, known) = match winds.table.as_str() {
            "z" => (Axis::Z, &plant.z_stage.joint),
            _ => (Axis::A, &plant.five_bar.joint),
        };
        // The motor's torque reaches the output multiplied by the gear.
        let gear = spec.drive(axis).gear_ratio;
        let stiffness = winds
            .compliance
            .map_or(known.transmission.linear, |c| gear / c);
        let level = stiffness * winds.w_max;
        let viscous = known.load_friction.viscous();
        let joint = self.joint(axis);
        joint["transmission"]["linear"] = value(format!("{stiffness:.6e} N m/rad"));
        joint["transmission"]["cubic"] = value("0 N m/rad3");
        joint["friction"] = value("maxwell-slip");
        joint["presliding"] = value(format!("{:.6e} rad", winds.presliding));
        joint["load_friction"] = levels(level, level, viscous);
        self.forget(axis);
    }

    /// The stiffness that lets motor and load resonate so.
    fn resonance(&mut self, hertz: f64, axis: Axis, spec: &Spec, plant: &Plant) {
        let known = match axis {
            Axis::Z => &plant.z_stage.joint,
            Axis::A | Axis::B => &plant.five_bar.joint,
        };
        let ratio = 1.0 / spec.drive(axis).gear_ratio;
        let w = TAU * hertz;
        let stiffness = w * w / (1.0 / known.load_inertia + ratio * ratio / known.motor_inertia);
        self.joint(axis)["transmission"]["linear"] = value(format!("{stiffness:.6e} N m/rad"));
    }
}

fn levels(fixed: f64, coulomb: f64, viscous: f64) -> Item {
    let mut table = toml_edit::InlineTable::new();
    for (key, level) in [("static", fixed), ("coulomb", coulomb)] {
        table.insert(key, format!("{level:.6e} N m").into());
    }
    table.insert("viscous", format!("{viscous:.6e} N m s/rad").into());
    value(table)
}

/// How deep tables of a rig have headers of their own.
const DEEP: usize = 2;

/// Sets what `new` has of a key, tables key by key; those that describe one thing, such as a joint or a
/// drive, as a whole.
fn merge(into: &mut dyn TableLike, key: &str, new: &toml::Value) {
    merge_at(into, key, new, 1);
}

fn merge_at(into: &mut dyn TableLike, key: &str, new: &toml::Value, depth: usize) {
    let toml::Value::Table(table) = new else {
        into.insert(key, value(inline(new)));
        return;
    };
    let held = into.get(key).is_some_and(Item::is_table_like);
    if !held {
        let mut fresh = toml_edit::Table::new();
        fresh.set_implicit(table.values().all(toml::Value::is_table));
        into.insert(key, Item::Table(fresh));
    }
    let Some(there) = into.get_mut(key).and_then(Item::as_table_like_mut) else {
        return;
    };
    if depth >= DEEP {
        // A thing of its own: nothing of the one that was there stays.
        there.clear();
        for (key, inner) in table {
            there.insert(key, value(inline(inner)));
        }
        return;
    }
    for (key, inner) in table {
        merge_at(there, key, inner, depth + 1);
    }
}

fn inline(new: &toml::Value) -> toml_edit::Value {
    match new {
        toml::Value::String(text) => text.into(),
        toml::Value::Integer(number) => (*number).into(),
        toml::Value::Float(number) => (*number).into(),
        toml::Value::Boolean(flag) => (*flag).into(),
        toml::Value::Datetime(moment) => moment.to_string().into(),
        toml::Value::Array(values) => values
            .iter()
            .map(inline)
            .collect::<toml_edit::Array>()
            .into(),
        toml::Value::Table(table) => {
            let mut new = toml_edit::InlineTable::new();
            for (key, inner) in table {
                new.insert(key, inline(inner));
            }
            new.into()
        }
    }
}
