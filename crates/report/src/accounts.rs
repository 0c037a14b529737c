//! The thesis's claims counted by what they rest on, what was changed of them, and how they fare on drawn machines.

use super::html::{fixed, number, verdict};
use super::thesis::label;
use maud::{Markup, html};
use pigtail_reproduce::ReproductionDocument;
use pigtail_reproduce::accounts::{Accounts, Count};
use pigtail_reproduce::claims::changes::{Change, Verdict};
use pigtail_reproduce::claims::{Claim, Group, Kind, Subject};
use pigtail_reproduce::specimens::{OnSpecimens, SpecimensDocument};

pub(super) fn summary(d: &ReproductionDocument) -> Markup {
    let a = &d.accounts;
    html! {
        table.accounts {
            @for group in Group::ALL {
                @let count = a.group(group);
                @let (many, meaning) = group.meaning();
                @if count.of > 0 {
                    tr { td { b { (many) } ": " (meaning) } (cells(count)) }
                }
                @match group {
                    Group::Prediction => (part("nothing was changed of them after a result was seen", a.predictions_unchanged)),
                    Group::Calibrated => (part("it is in doubt whether the number was set for them", a.calibrated_in_doubt)),
                    Group::Definition => {},
                }
            }
            tr.all { td { "all" } (cells(Count { hold: d.held, of: d.of })) }
            (part("of all, what is measured, how, or on which machine was changed after a result was seen", a.changed))
        }
        p {
            "Only predictions say something for the twin. "
            @if d.quick { "A quick run: fewer steps, devices and runs. " }
            "Took " (fixed(d.seconds, 0)) " s."
        }
        p {
            @if d.specimen {
                "The machine is a specimen that the seed drew; what the thesis simulated is simulated on \
                 the one in the middle."
            } @else {
                "The machine is the thesis's, in the middle of its make: the rig's plant for what was \
                 simulated, with what its measured.toml changes for what was measured; the seed drew \
                 device, fixture and noise."
            }
            " Measured is what encoders, probes and photodiodes tell, by the control code of a real run."
        }
        details {
            summary { "How near a result must come" }
            p {
                "Chosen before any result, by the kind of the claim. Which quantity a sentence means and how it is \
                 measured was not always: see " a href="#changed" { "what was changed" } "."
            }
            dl.tolerances {
                @for kind in Kind::ALL {
                    dt { (kind.tolerance()) } dd { (kind.reason()) }
                }
            }
        }
    }
}

/// A row of some claims of the row above.
fn part(what: &str, count: Count) -> Markup {
    html! {
        @if count.of > 0 {
            tr.part { td.soft { (what) } (cells(count)) }
        }
    }
}

fn cells(count: Count) -> Markup {
    html! { td.number { (count.hold) " of " (count.of) " hold" } }
}

/// What was changed after a result was seen, with both results.
pub(super) fn changes(a: &Accounts) -> Markup {
    let first =
        |k: usize, change: &Change| k == 0 || a.changed_after_result[k - 1].claim != change.claim;
    html! {
        @if a.changed.of > 0 || !a.withdrawn.is_empty() {
            h2 #changed { "What was changed after a result was seen" }
            p {
                "Both results are those of the programs of their time, on the thesis's machine or, the first of chapter \
                 2, on the specimen of seed 0."
            }
            table.claims {
                thead { tr {
                    th.when { "claim" }
                    th { "change" }
                    th.what { "of the" }
                    th.result { "before" }
                    th.result { "after" }
                } }
                tbody {
                    @for (k, change) in a.changed_after_result.iter().enumerate() {
                        tr id=[first(k, change).then(|| format!("changed-{}", change.claim))] {
                            td {
                                b { (change.claim) }
                                span.soft { (change.date) " " code { (change.commit) } }
                            }
                            td {
                                @if !change.from.is_empty() { s { (change.from) } " " }
                                (change.to)
                                span.soft { (change.why) }
                            }
                            td data-of="of the" { (change.what.name()) }
                            (result("before", change.before))
                            (result("after", Some(change.after)))
                        }
                    }
                    @for w in &a.withdrawn {
                        tr {
                            td { b { (w.claim) } span.soft { (w.date) " " code { (w.commit) } } }
                            td { s { (w.was) } span.soft { (w.why) } }
                            td data-of="of the" { "withdrawn" }
                            td {} td {}
                        }
                    }
                }
            }
        }
    }
}

fn result(when: &str, result: Option<Verdict>) -> Markup {
    html! {
        td data-of=(when) {
            @if let Some(r) = result {
                (r.ours) ", " span.(verdict(r.holds)) { (if r.holds { "holds" } else { "fails" }) }
            } @else { "no claim" }
        }
    }
}

/// The claims on drawn machines.
pub(super) fn drawn(d: &SpecimensDocument, claims: &[Claim]) -> Markup {
    let (first, last) = (d.seeds.first(), d.seeds.last());
    let nominal = |id: &str| claims.iter().find(|c| c.id == id);
    html! {
        h2 #drawn { "On drawn machines" }
        p {
            (d.seeds.len()) " machines, each with its device and fixture, as the plant's variation and misplacement \
             have them: seeds " (first.copied().unwrap_or_default()) " to " (last.copied().unwrap_or_default())
            ". A claim counts by its tolerance alone."
        }
        table.accounts {
            @for group in Group::ALL {
                @let tally = d.accounts.group(group);
                @if tally.claims > 0 {
                    tr {
                        td { b { (group.meaning().0) } }
                        td.number { (tally.on_all) " of " (tally.claims) " hold on every machine" }
                        td.number { (tally.hold) " of " (tally.of) " machine by machine" }
                    }
                }
            }
        }
        table.claims {
            thead { tr {
                th { "claim" }
                th.number { "thesis" }
                th.number { "middle" }
                th.number { "least" }
                th.number { "median" }
                th.number { "most" }
                th.number { "hold on" }
            } }
            tbody {
                @for c in &d.claims {
                    @if let (Some(held), Some(nominal)) = (c.held, nominal(c.id)) { (drawn_row(c, held, nominal)) }
                }
            }
        }
        @for ended in &d.ended {
            p.soft {
                "Seed " (ended.seed) ", " (ended.figures.join(", ")) ": " (ended.how)
                ". Their claims count as not held."
            }
        }
        @for subject in [Subject::Model, Subject::Numbers] {
            @let same: Vec<&str> = d.claims.iter().filter(|c| c.not_drawn == subject.not_drawn()).map(|c| c.id).collect();
            @if let (Some(why), false) = (subject.not_drawn(), same.is_empty()) {
                p.soft { "Not drawn, " (why) ": " (same.join(", ")) "." }
            }
        }
    }
}

fn drawn_row(c: &OnSpecimens, held: usize, nominal: &Claim) -> Markup {
    let figure = c.id.split('-').next().unwrap_or(c.id);
    html! {
        tr {
            td {
                a href={ "#f" (figure) } { (label(figure)) (figure) } ": " (nominal.quantity)
                span.basis { b { (c.basis.name()) } }
            }
            td.number data-of="thesis" { (nominal.tolerance_sign()) (nominal.thesis) " " (nominal.unit) }
            td.number data-of="middle" { (digits(nominal.ours)) }
            td.number data-of="least" { (digits(c.least)) }
            td.number data-of="median" { (digits(c.median)) }
            td.number data-of="most" { (digits(c.most)) }
            td.number data-of="hold on" { span.(verdict(held == c.of)) { (held) " of " (c.of) } }
        }
    }
}

fn digits(value: Option<f64>) -> String {
    value.map_or_else(|| number(None, 0), |v| v.to_string())
}
