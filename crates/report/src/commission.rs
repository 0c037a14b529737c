//! The report of a machine that was commissioned.

use super::html::{page, table, verdict};
use maud::html;
use pigtail_session::commission::{CommissionDocument, Verdict};
use serde_json::Value;

/// The report of a machine that was commissioned, as one HTML text.
pub fn commission(d: &CommissionDocument) -> String {
    let title = format!("Commissioning of {}, machine {}", d.rig, d.seed);
    let steps: Vec<Vec<String>> = d
        .steps
        .iter()
        .map(|step| {
            let passed = step.verdict == Verdict::Passed;
            let verdict = if passed { "passed" } else { "failed" };
            let seconds = format!("{:.1}", step.seconds);
            vec![
                step.name.to_string(),
                verdict.to_owned(),
                seconds,
                step.why.clone(),
            ]
        })
        .collect();
    let body = html! {
        p {
            span class=(verdict(d.accepted)) { (if d.accepted { "Accepted" } else { "Not accepted" }) }
            (format!(" after {:.0} s of machine time. Fleet {}.", d.seconds_machine, d.fleet))
        }
        (table(&["step", "verdict", "machine time\ns", "why"].map(str::to_owned), &steps))
        @for step in &d.steps {
            h2 { (step.name) }
            (table(&["quantity", "value"].map(str::to_owned), &rows(&step.values)))
        }
        h2 { "What is not known" }
        ul { @for unknown in &d.unknown { li { (unknown) } } }
    };
    page(&title, &body)
}

/// Values one below the other, those of tables under both names.
fn rows(values: &serde_json::Map<String, Value>) -> Vec<Vec<String>> {
    let text = |value: &Value| match value {
        Value::String(text) => text.clone(),
        Value::Null => "-".to_owned(),
        value => value.to_string(),
    };
    let each = values.iter().flat_map(|(name, value)| match value {
        Value::Object(inner) => inner
            .iter()
            .map(|(key, value)| vec![format!("{name}: {key}"), text(value)])
            .collect(),
        value => vec![vec![name.clone(), text(value)]],
    });
    each.collect()
}
