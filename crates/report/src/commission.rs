//! The report of a machine that was commissioned: what an owner files with the machine.
//!
//! On top what it came to; then what failed and what to do about it, how much room its tolerances leave, what each
//! step has measured, and what is not known.

use super::html::{configuration, fixed, page, prose, table, th, verdict};
use maud::{Markup, html};
use pigtail_control::recipe::Accept;
use pigtail_numerics::statistics::wilson;
use pigtail_session::commission::{CommissionDocument, Plan, StepDocument, StepName, Verdict};
use serde_json::{Map, Value};
use strum::EnumMessage;

/// The report of a machine that was commissioned, as one HTML text.
pub fn commission(
    d: &CommissionDocument,
    hashes: &[(String, String)],
    accept: &Accept,
    plan: &Plan,
) -> String {
    let title = format!("Commissioning of {}, machine {}", d.rig, d.seed);
    let step = |name: StepName| d.steps.iter().find(|step| step.name == name);
    let acceptance = step(StepName::Acceptance);
    let failed: Vec<&StepDocument> = (d.steps.iter())
        .filter(|step| step.verdict == Verdict::Failed)
        .collect();
    let words = match (d.accepted, acceptance) {
        (true, _) => "Accepted",
        (false, None) => "Not tried on devices",
        (false, Some(_)) => "Not accepted",
    };
    let good = d.accepted || (acceptance.is_none() && failed.is_empty());
    let limited = acceptance
        .and_then(|step| step.values.get("limited_by"))
        .and_then(Value::as_str);
    let body = html! {
        p {
            span class=(verdict(good)) { (words) }
            (format!(
                ": {} of {} steps passed, in {:.0} s of machine time.",
                d.steps.len() - failed.len(),
                d.steps.len(),
                d.seconds_machine
            ))
            @if let Some(axes) = limited { " What is nearest to its tolerance: " (axes) "." }
        }
        div.scroll { table {
            @for (name, value) in about(d, plan) { tr { td { (name) } td.text.long { (value) } } }
        } }
        @if !failed.is_empty() {
            h2 { "What failed, and what to do" }
            @for step in &failed {
                p { b { (step.name) } ": " (prose(&step.why)) "." }
                p.soft { (prose(advice(step.name))) }
            }
        }
        @if let Some(step) = acceptance { (devices(step, accept)) }
        h2 { "Steps" }
        (table(&["step", "verdict", "machine time\ns", "what it asks"].map(str::to_owned), &steps(d)))
        @for step in d.steps.iter().filter(|step| step.name != StepName::Acceptance) {
            h2 { "Measured: " (step.name) }
            p.soft { (meaning(step)) }
            @if step.values.is_empty() { p { "Nothing: " (step.why) "." } }
            @for (header, rows) in measured(&step.values) { (table(&header, &rows)) }
        }
        h2 { "What is not known" }
        ul { @for unknown in &d.unknown { li { (unknown) } } }
        (configuration(hashes, env!("CARGO_PKG_VERSION")))
    };
    page(&title, &body)
}

/// What it is a report of.
fn about(d: &CommissionDocument, plan: &Plan) -> [(&'static str, String); 6] {
    let calibration = match d.calibration.as_str() {
        "" => "none was found",
        path => path,
    };
    [
        ("rig", d.rig.clone()),
        ("fleet", d.fleet.clone()),
        ("machine (seed)", d.seed.to_string()),
        ("date", plan.date.clone()),
        ("run", plan.run.clone()),
        ("calibration", calibration.to_owned()),
    ]
}

fn steps(d: &CommissionDocument) -> Vec<Vec<String>> {
    let row = |step: &StepDocument| {
        let passed = step.verdict == Verdict::Passed;
        let asks = step.name.get_documentation();
        vec![
            step.name.to_string(),
            if passed { "passed" } else { "failed" }.to_owned(),
            fixed(step.seconds, 1),
            asks.unwrap_or_default().to_owned(),
        ]
    };
    d.steps.iter().map(row).collect()
}

/// What the devices came to, and how much room their tolerances leave.
fn devices(step: &StepDocument, accept: &Accept) -> Markup {
    let number = |key: &str| step.values.get(key).and_then(Value::as_f64);
    let count = |key: &str| number(key).unwrap_or(0.0) as u64;
    let (aligned, attempted) = (count("aligned"), count("attempted"));
    let [low, high] = wilson(aligned, attempted).map(|share| 100.0 * share);
    let seconds = |key| number(key).map_or_else(|| "-".to_owned(), |s| fixed(s, 2));
    let cpk = |axis: &str| step.values.get("cpk")?.get(axis)?.as_f64();
    let [aside, gap] = [accept.aside, accept.gap].map(|metres| 1e6 * metres);
    let limit = step.values.get("limited_by").and_then(Value::as_str);
    html! {
        h2 { "Devices that were tried" }
        p {
            (aligned) " of " (attempted) " fibers that were attempted on " (count("devices"))
            " devices were aligned by control's own word"
            @if attempted > 0 { (format!(" (95 %: {low:.0} to {high:.0} %)")) }
            "; " (count("fibers") - attempted) " were not attempted. A fiber took "
            (seconds("seconds_p50")) " s in the median, " (seconds("seconds_max")) " s at most."
        }
        @if step.values.contains_key("cpk") {
            div.scroll { table {
                tr { th { "axis" } (th("tolerance", "± um")) th { "Cpk" } (th("99.73 % are within", "± um")) th.text { "" } }
                @for (axis, tolerance) in [("x", aside), ("y", aside), ("z", gap)] {
                    @let limits = limit.is_some_and(|limit| limit.split(' ').any(|word| word == axis));
                    tr {
                        td { (axis) }
                        td { (fixed(tolerance, 2)) }
                        td class=[limits.then_some("limits")] { (cpk(axis).map_or("-".to_owned(), |cpk| fixed(cpk, 2))) }
                        // Along z what it is believed to be off is taken from the tolerance before.
                        td { (cpk(axis).filter(|_| axis != "z").map_or("-".to_owned(), |cpk| fixed(tolerance / cpk, 3))) }
                        td.text { @if limits { "nearest to its tolerance" } }
                    }
                }
            } }
            p.soft {
                "Cpk is the tolerance, less what a fiber is believed to be off, over half the width that holds 99.73 % of where it \
                 may be, as control believes it; the median fiber's. Below 1 more than 0.27 % of such fibers are outside; 1.33 is \
                 what is customary in production."
            }
            @if let Some(limit) = limit { p { (relief(limit)) } }
        }
    }
}

/// What would give more room.
fn relief(limit: &str) -> &'static str {
    if limit == "z" {
        "Along z the gap limits: how well vision knows where tip and facet are (its bounds are in the datasheet), or, where light \
         tells the gap, how well it is known how light spreads; or, on a bench without vision, how well the poses at the chip were taught."
    } else {
        "Across the light it is how far tips shake (below) and how well the piezos' models hold that limit: a calmer place, or \
         longer looks at the last circle (the recipe's), give more room."
    }
}

/// What a person does about a step that failed.
fn advice(name: StepName) -> &'static str {
    match name {
        StepName::Axes => {
            "Nothing was found on an axis that does not move as it should: see to its cables, amplifier and brake; exchange the \
             motor's two leads, or the encoder's, where it moves the wrong way. Then again, with --steps axes."
        }
        StepName::Dark => {
            "Keep the room's light away from the photodiode, and see to its amplifier's offset. Then again, with --steps dark."
        }
        StepName::Gains => {
            "`pigtail characterize AXIS step` and `frequency` show how the axis answers: a resonance, play, or friction far above \
             the datasheet's. `pigtail tune` tries other gains."
        }
        StepName::Windup => {
            "`pigtail identify windup AXIS` draws the loops: a transmission without windup needs no model, one that slips is to be \
             mended first."
        }
        StepName::Geometry => {
            "The camera has to see both tips around home: see to its light, its focus and its field."
        }
        StepName::Piezos => {
            "A fiber that shows light is what tells: see to the laser and to the device that was tried. Where camera and macro \
             disagree, one of their scales is wrong: the camera's pixel, or the gear in the datasheet."
        }
        StepName::Dynamics => {
            "A tip is stepped once two fibers have come to the light: the outcome above says what kept them from there. One that swings for \
             longer than a step is looked at is loose: see to what holds it."
        }
        StepName::Shaking => {
            "A tip is watched once a fiber has come to the light: the outcome above says what kept it from there. `pigtail align` \
             with this machine's seed shows the way in its report."
        }
        StepName::Spot => {
            "Circles around a fiber's peak at the chip tell how wide its spot is: the outcome above says what kept fibers from there."
        }
        StepName::Spread => {
            "Light that is clear at several gaps tells how it spreads: the outcome above says what kept fibers from there."
        }
        StepName::Groups => {
            "Where no light was found, see to the laser and to the poses that were taught. A coarse axis that falls short by more than any \
             screw of its kind, or stands elsewhere than told, is to be mended: what was measured of its arm is not believed."
        }
        StepName::Acceptance => {
            "`pigtail align` with this machine's seed shows how a fiber is lost, in its report. What was found before stands; the \
             steps before it that failed come first."
        }
    }
}

/// What a step's numbers are, and how well they are known.
fn meaning(step: &StepDocument) -> &'static str {
    let told = |value: &Value| value.get("told_um").is_some();
    match step.name {
        StepName::Axes if step.values.values().any(told) => {
            "How far each axis was told to go and went, by its own sensors, and how long that took until it was at rest."
        }
        StepName::Axes => {
            "The voltage rises until the axis has moved a few counts, first forward, then back. Known to the rise in a servo cycle. \
             What is left of the way at the output, by its probe, once the voltage is off."
        }
        StepName::Dark => "Mean and standard deviation of single readings without the laser.",
        StepName::Gains => {
            "Gains are choices, not measurements: how each axis answers a step under them is what was measured, once each. Times to \
             rise are from 10 to 90 %; times are known to a servo cycle, overshoot to a count."
        }
        StepName::Windup => {
            "The level of windup, what the model leaves of the loop (root mean square), and the gap between forward and backward \
             without and with the model."
        }
        StepName::Geometry => {
            "How much farther than believed both tips are at home in x and z, on average over chips and fibers that were placed anew, and how well              that is known by how they differ; how much more than believed the axis along the light is turned about y, how much more the one across it              (squareness), how much a way in y goes along x and z (roll, pitch), and how much farther than told stages go by the camera. Each with              its standard deviation. Home and yaw are believed; the others are for whoever sets the stages up."
        }
        StepName::Piezos => {
            "What the model leaves of the camera's frames (its noise, above all), how well the model is known by them (a standard \
             deviation), and how far the micro goes in y for a displacement in x, by light."
        }
        StepName::Dynamics => {
            "Resonance and damping of both axes of each micro, by steps of each piezo beside the peak: light, whose logarithm is the square of \
             the way from there. Known is how fast it comes to rest, as a standard deviation of the logarithm; misfit is what noise and all \
             else leaves of a step."
        }
        StepName::Shaking => {
            "How far the tip shakes in x or y: a standard deviation, and how well that is known."
        }
        StepName::Spot => {
            "How far from the peak the light has fallen to 1/e where fiber and guide touch, in the micro's own scale, and by how much the \
             next fiber's may be another (a standard deviation)."
        }
        StepName::Spread => {
            "The light's wavelength over 2 pi in the micro's own scale, and how well it is known (a standard deviation); where \
             vision knows the gap, nothing is to be measured."
        }
        StepName::Groups => {
            "Each with its standard deviation, at the gap and the light that are said. Lag: how much later a sample of light is than the pose \
             that it is of, by the group's own sensors. Backlash: how far a coarse axis falls short when it comes from above. The spot: \
             where light has fallen to 1/e along x and y of the arm, at the chip. Where the coarse group stands is seen over some micrometres only, \
             root mean square."
        }
        StepName::Acceptance => "",
    }
}

/// Names of a value: what stands in the header of its columns, one for each number of a list, and below it the unit;
/// by what it is multiplied to be in that unit.
struct Named {
    key: &'static str,
    names: &'static [&'static str],
    scale: f64,
}

const fn named(key: &'static str, names: &'static [&'static str], scale: f64) -> Named {
    Named { key, names, scale }
}

/// The keys that steps have.
const NAMES: [Named; 59] = [
    named("forward_V", &["moves at\nV"], 1.0),
    named("backward_V", &["back at\nV"], 1.0),
    named("way_counts", &["went\ncounts", "back\ncounts"], 1.0),
    named("way_of_output_um", &["output went\num"], 1.0),
    named("told_um", &["told\num"], 1.0),
    named("went_um", &["went\num"], 1.0),
    named("seconds", &["within\ns"], 1.0),
    named("gap_um", &["gap\num"], 1.0),
    named("light_V", &["light\nV"], 1.0),
    named("noise_percent", &["its noise\n%"], 1.0),
    named("fine_lag_ms", &["fine group's lag\nms", "±\nms"], 1.0),
    named("coarse_lag_ms", &["coarse group's lag\nms", "±\nms"], 1.0),
    named("backlash_x_um", &["backlash in x\num", "±\num"], 1.0),
    named("backlash_y_um", &["backlash in y\num", "±\num"], 1.0),
    named("backlash_z_um", &["backlash in z\num", "±\num"], 1.0),
    named(
        "stands_nm",
        &["stands off in x\nnm", "stands off in y\nnm"],
        1.0,
    ),
    named("over_um", &["over\num"], 1.0),
    named("spot_x_um", &["spot in x\num", "±\num"], 1.0),
    named("spot_y_um", &["spot in y\num", "±\num"], 1.0),
    named("mean_V", &["dark\nmV"], 1e3),
    named("noise_V", &["a reading's noise\nmV"], 1e3),
    named("kp_V_per_count", &["kp\nV/count"], 1.0),
    named("ki_V_per_count_s", &["ki\nV/(count s)"], 1.0),
    named("kd_V_s_per_count", &["kd\nV s/count"], 1.0),
    named("times_gentler", &["made less\ntimes"], 1.0),
    named("rise_ms", &["rise\nms"], 1.0),
    named("settling_ms", &["settling\nms"], 1.0),
    named("overshoot_percent", &["overshoot\n%"], 1.0),
    named("settled", &["comes to rest"], 1.0),
    named("swings", &["to and fro\ntimes"], 1.0),
    named("specified_met", &["as specified"], 1.0),
    named("speed_mm_s", &["led at no more than\nmm/s"], 1.0),
    named("w_max_um", &["windup\num"], 1.0),
    named("q_um", &["curvature q\num"], 1.0),
    named("residual_um", &["left of it\num"], 1.0),
    named("gap_without_um", &["gap without model\num"], 1.0),
    named("gap_with_um", &["gap with it\num"], 1.0),
    named("winds_up", &["winds up"], 1.0),
    named("home_x_um", &["home in x\num", "±\num"], 1.0),
    named("home_z_um", &["home in z\num", "±\num"], 1.0),
    named("yaw_deg", &["yaw\ndegrees", "±\ndegrees"], 1.0),
    named(
        "squareness_deg",
        &["squareness\ndegrees", "±\ndegrees"],
        1.0,
    ),
    named("roll_deg", &["roll\ndegrees", "±\ndegrees"], 1.0),
    named("pitch_deg", &["pitch\ndegrees", "±\ndegrees"], 1.0),
    named("farther_x_percent", &["farther in x\n%", "±\n%"], 1.0),
    named("farther_z_percent", &["farther in z\n%", "±\n%"], 1.0),
    named("residual_nm", &["left in x\nnm", "left in y\nnm"], 1.0),
    named("known_nm", &["known in x\n± nm", "known in y\n± nm"], 1.0),
    named("drift_nm_s", &["drift in x\nnm/s", "drift in y\nnm/s"], 1.0),
    named("ratio", &["y for x\num/um"], 1.0),
    named("ratio_deviation", &["±\num/um"], 1.0),
    named("scale_by_macro", &["by the macro\num/um"], 1.0),
    named("deviation_nm", &["shakes\nnm"], 1.0),
    named("spread", &["±\n%"], 100.0),
    named("left", &["left in a bond's time\n% of its variance"], 100.0),
    named("x_nm", &["along x\nnm"], 1.0),
    named("y_nm", &["along y\nnm"], 1.0),
    named("x_um", &["along x\num"], 1.0),
    named("y_um", &["along y\num"], 1.0),
];

/// How well a value is known, which stands behind it, whatever the order of its step.
const KNOWN: [(&str, &str); 4] = [
    ("x_nm", "deviation_x"),
    ("y_nm", "deviation_y"),
    ("x_um", "deviation_x"),
    ("y_um", "deviation_y"),
];

type Table = (Vec<String>, Vec<Vec<String>>);

/// Tables of what a step has measured: one for each kind of thing, a row for each thing.
fn measured(values: &Map<String, Value>) -> Vec<Table> {
    let mut tables: Vec<(Vec<&str>, Table)> = Vec::new();
    for (thing, value) in values {
        let Value::Object(inner) = value else {
            // A value of the step as a whole.
            let row = vec![thing.replace('_', " "), text(value, 1.0, 4)];
            tables.push((Vec::new(), (vec![String::new(); 2], vec![row])));
            continue;
        };
        let keys: Vec<&str> = ordered(inner);
        let mut row = vec![thing.replace('_', "-")];
        let mut header = vec![String::new()];
        for key in &keys {
            columns(key, &inner[*key], &mut header, &mut row);
        }
        match tables.iter_mut().find(|(of, _)| *of == keys) {
            Some((_, (_, rows))) => rows.push(row),
            None => tables.push((keys, (header, vec![row]))),
        }
    }
    (tables.into_iter())
        .map(|(_, table)| {
            if table.0.len() > MOST {
                turned(table)
            } else {
                table
            }
        })
        .collect()
}

/// So many columns are for a page of paper, or a narrow window.
const MOST: usize = 9;

/// A row for each quantity in place of a column.
fn turned((header, rows): Table) -> Table {
    let things = rows.iter().map(|row| row[0].clone());
    let turned = std::iter::once(String::new()).chain(things).collect();
    let quantities = header.iter().enumerate().skip(1);
    let quantities = quantities.map(|(k, name)| {
        let name = name.replacen('\n', ", ", 1);
        let values = rows.iter().map(|row| row[k].clone());
        std::iter::once(name).chain(values).collect()
    });
    (turned, quantities.collect())
}

/// The keys in the order of [`NAMES`], each followed by how well it is known; those without a name at the end.
fn ordered(inner: &Map<String, Value>) -> Vec<&str> {
    let mut keys: Vec<&str> = inner.keys().map(String::as_str).collect();
    keys.sort_by_key(|key| {
        let of = KNOWN
            .iter()
            .find(|(value, known)| known == key && inner.contains_key(*value));
        let value = of.map_or(*key, |(value, _)| value);
        let place = NAMES.iter().position(|named| named.key == value);
        (place.unwrap_or(NAMES.len()), of.is_some())
    });
    keys
}

/// Adds the columns of a value to a header and a row.
fn columns(key: &str, value: &Value, header: &mut Vec<String>, row: &mut Vec<String>) {
    let named = NAMES.iter().find(|named| named.key == key);
    let known = KNOWN.iter().any(|(_, known)| *known == key);
    let scale = if known {
        100.0
    } else {
        named.map_or(1.0, |named| named.scale)
    };
    let several = match value {
        Value::Array(several) => several.as_slice(),
        value => std::slice::from_ref(value),
    };
    for (k, value) in several.iter().enumerate() {
        let name = named.and_then(|named| named.names.get(k)).map_or_else(
            || {
                if known {
                    "±\n%".to_owned()
                } else {
                    key.replace('_', " ")
                }
            },
            |name| (*name).to_owned(),
        );
        let digits = if name.starts_with('±') { 2 } else { 4 };
        row.push(text(value, scale, digits));
        header.push(name);
    }
}

/// A value as a person reads it, of so many digits that count.
fn text(value: &Value, scale: f64, count: i32) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::Bool(value) => if *value { "yes" } else { "no" }.to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_i64() && scale == 1.0 => number.to_string(),
        Value::Number(number) => digits(scale * number.as_f64().unwrap_or(f64::NAN), count),
        value => value.to_string(),
    }
}

fn digits(value: f64, count: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let before = value.abs().log10().floor() as i32 + 1;
    let behind = usize::try_from(count - before).unwrap_or(0).min(7);
    fixed(value, behind)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn tables_of(values: &Value) -> Vec<Table> {
        measured(values.as_object().expect("an object"))
    }

    #[test]
    fn things_of_a_kind_stand_in_one_table() {
        let tables = tables_of(&json!({
            "left.A": {"rise_ms": 12.3456, "settled": true},
            "right.A": {"rise_ms": 9.0, "settled": false},
            "z": {"kp_V_per_count": 0.00123},
        }));
        let [(header, rows), (_, gains)] = &tables[..] else {
            panic!("{tables:?}");
        };
        assert_eq!(header, &["", "rise\nms", "comes to rest"]);
        assert_eq!(
            rows,
            &[["left.A", "12.35", "yes"], ["right.A", "9.000", "no"]]
        );
        assert_eq!(gains, &[["z", "0.001230"]]);
    }

    #[test]
    fn how_well_a_value_is_known_stands_behind_it_and_lists_have_columns() {
        let side = json!({"deviation_x": 0.012, "deviation_y": 0.02, "x_nm": 246.7, "y_nm": 250.0});
        let tables = tables_of(&json!({ "left": side }));
        assert_eq!(
            tables[0].0,
            ["", "along x\nnm", "±\n%", "along y\nnm", "±\n%"]
        );
        assert_eq!(tables[0].1[0], ["left", "246.7", "1.2", "250.0", "2.0"]);
        let side = json!({"deviation_x": 0.036, "deviation_y": 0.036, "x_um": 2.6, "y_um": 2.5});
        let tables = tables_of(&json!({ "left": side }));
        assert_eq!(
            tables[0].0,
            ["", "along x\num", "±\n%", "along y\num", "±\n%"]
        );
        let tables = tables_of(&json!({"left": {"known_nm": [1.5, 2.5]}}));
        assert_eq!(tables[0].0, ["", "known in x\n± nm", "known in y\n± nm"]);
    }

    #[test]
    fn what_has_no_name_yet_is_shown_all_the_same() {
        let tables = tables_of(&json!({"all": 3, "left": {"new_um": null}}));
        assert_eq!(tables[0].1, [["all", "3"]]);
        assert_eq!(tables[1].0, ["", "new um"]);
        assert_eq!(tables[1].1, [["left", "-"]]);
    }
}
