//! The report of a machine that was commissioned.

use super::html::page;
use maud::html;
use pigtail_session::commission::{CommissionDocument, Verdict};
use serde_json::Value;

/// The report of a machine that was commissioned, as one HTML text.
pub fn commission(d: &CommissionDocument) -> String {
    let title = format!("Commissioning of {}, machine {}", d.rig, d.seed);
    let body = html! {
        p {
            strong { (if d.accepted { "Accepted" } else { "Not accepted" }) }
            (format!(" after {:.0} s of machine time. Fleet {}.", d.seconds_machine, d.fleet))
        }
        table {
            tr { th { "step" } th { "verdict" } th { "machine time, s" } th { "why" } }
            @for step in &d.steps {
                tr {
                    td { (step.name) }
                    td { (if step.verdict == Verdict::Passed { "passed" } else { "failed" }) }
                    td { (format!("{:.1}", step.seconds)) }
                    td { (step.why) }
                }
            }
        }
        @for step in &d.steps {
            h2 { (step.name) }
            table {
                @for (name, value) in rows(&step.values) {
                    tr { td { (name) } td { (value) } }
                }
            }
        }
        h2 { "What is not known" }
        ul { @for unknown in &d.unknown { li { (unknown) } } }
    };
    page(&title, &body)
}

/// Values one below the other, those of tables under both names.
fn rows(values: &serde_json::Map<String, Value>) -> Vec<(String, String)> {
    let text = |value: &Value| match value {
        Value::String(text) => text.clone(),
        Value::Null => "-".to_owned(),
        value => value.to_string(),
    };
    let each = values.iter().flat_map(|(name, value)| match value {
        Value::Object(inner) => inner
            .iter()
            .map(|(key, value)| (format!("{name}: {key}"), text(value)))
            .collect(),
        value => vec![(name.clone(), text(value))],
    });
    each.collect()
}
