//! Equations that are not to be believed.

use super::equations::{APART, Equations};
use super::{LEAST_EQUATIONS, Record, Settings, Unknown, clipped, doubtful, other};

/// Leaves out the equations that are not to be believed: which were kept, where some were not, and whether a voltage that was cut off is
/// the reason.
pub(super) fn believed(
    (columns, lost): (&mut Equations, &doubtful::Lost),
    record: &Record,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<(Option<Vec<bool>>, bool), Unknown> {
    let out = |keep: &[bool]| keep.iter().filter(|k| !**k).count();
    let mut keep = doubtful::untouched(columns, lost, set, record.even.period);
    if let Some(keep) = &keep {
        columns.retain(keep);
        enough(columns, record)?;
    }
    if columns.one_way {
        return Ok((keep, false));
    }
    let mut cut = false;
    if let Some((whole, level)) = clipped::clipped(record, set, columns)? {
        remarks.push(format!(
            "the voltage is cut off in the record: where it is high the motion asks for more than is written; the \
             equations above {level:.3} V were left out, {:.0} % of them",
            100.0 * out(&whole) as f64 / whole.len() as f64
        ));
        columns.retain(&whole);
        enough(columns, record)?;
        keep = Some(both(keep, whole));
        cut = true;
    }
    if let Some(near) = columns.apart() {
        remarks.push(format!(
            "{} of {} equations stand apart from all others, by more than {APART} standard deviations; set aside",
            out(&near),
            near.len()
        ));
        columns.retain(&near);
        keep = Some(both(keep, near));
    }
    if let Some(slides) = other::sliding(columns) {
        remarks.push(format!(
            "where it stands, friction is not that of its motion: equations below a tenth of its highest speed were left \
             out, {:.0} % of them",
            100.0 * out(&slides) as f64 / slides.len() as f64
        ));
        columns.retain(&slides);
        keep = Some(both(keep, slides));
    }
    Ok((keep, cut))
}

/// Which of all are kept, of those that were before, where some were not.
fn both(before: Option<Vec<bool>>, of_these: Vec<bool>) -> Vec<bool> {
    let all = before.unwrap_or_else(|| vec![true; of_these.len()]);
    let mut of_these = of_these.into_iter();
    let both = all
        .into_iter()
        .map(|kept| kept && of_these.next().unwrap_or(true));
    both.collect()
}

pub(super) fn enough(columns: &Equations, record: &Record) -> Result<(), Unknown> {
    if columns.force.len() >= LEAST_EQUATIONS {
        return Ok(());
    }
    Err(Unknown::all(format!(
        "it makes {} equations of {} samples in {} stretches; wanted are at least {LEAST_EQUATIONS}",
        columns.force.len(),
        record.even.samples(),
        record.even.stretches.len()
    )))
}
