//! The rows of a campaign: one a fiber, in columns that say their unit.

use super::Device;
use crate::arms::Arms;
use pigtail_control::job::PORTS;
use pigtail_control::outcome::OutcomeCode;
use pigtail_hal::Side;
use pigtail_numerics::rounded;
use pigtail_session::procedure::Procedure;
use pigtail_store::rows::{Cell, Column, Kind, Table};

/// Rows of a device.
pub const ROWS_PER_DEVICE: u64 = PORTS.len() as u64;

/// The columns of a procedure's rows, in order.
pub fn columns(procedure: Procedure) -> Vec<Column> {
    let column = |name: &str, kind, required, about: &str| {
        if required {
            Column::required(name, kind, about)
        } else {
            Column::new(name, kind, about)
        }
    };
    let (flag, number) = (Kind::Flag, Kind::Number);
    let mut columns = vec![
        column(
            "seed",
            Kind::Whole,
            true,
            "replays the device: pigtail align --seed",
        ),
        column("port", Kind::Text, true, "the fiber's port"),
        column(
            "outcome",
            Kind::Text,
            true,
            "what control says of it; fault: the machine stopped",
        ),
        column(
            "detail",
            Kind::Text,
            false,
            "the evidence; null where aligned",
        ),
        column(
            "within_tolerance",
            flag,
            false,
            "whether it really is; null unless attached",
        ),
        column(
            "collision",
            flag,
            false,
            "whether anything touched the chip",
        ),
        column(
            "seconds",
            number,
            false,
            "machine time of the fiber; null unless attempted",
        ),
    ];
    for phase in procedure.phases() {
        let about = format!("machine time of the phase {phase}; null unless entered");
        columns.push(column(&format!("{phase}_s"), number, false, &about));
    }
    let truth = "the truth; null unless attached";
    columns.extend([
        column(
            "other_s",
            number,
            false,
            "machine time of other phases; null where there are none",
        ),
        column(
            "offset_x_um",
            number,
            false,
            &format!("across the chip, {truth}"),
        ),
        column(
            "offset_y_um",
            number,
            false,
            &format!("up from the chip, {truth}"),
        ),
        column(
            "offset_z_um",
            number,
            false,
            &format!("gap beyond the wanted one, {truth}"),
        ),
        column(
            "coupling_loss_db",
            number,
            false,
            &format!("at this interface, {truth}"),
        ),
        column(
            "smallest_gap_um",
            number,
            false,
            "least distance of anything from the chip, same for a device's fibers",
        ),
    ]);
    columns.extend(beliefs());
    columns.extend(ends());
    columns.extend(ARMS.map(|(name, about)| {
        let about = format!("{about}, same for a device's fibers");
        column(name, number, false, &about)
    }));
    columns
}

/// Columns of what the manipulators did, and what they mean.
pub(super) const ARMS: [(&str, &str); 4] = [
    (
        "device_s",
        "machine time in which the manipulators were watched",
    ),
    ("left_idle_s", "of it, how long the left one stands still"),
    ("right_idle_s", "of it, how long the right one stands still"),
    ("both_moving_s", "of it, how long both move"),
];

/// Columns of what control believes of a fiber.
fn beliefs() -> [Column; 6] {
    let number = |name: &str, about: &str| Column::new(name, Kind::Number, about);
    let level = "least share of control's own intervals that holds the truth";
    [
        number(
            "believed_x_um",
            "half width of control's interval of 95 % in x, and in y; null where it has none",
        ),
        number(
            "believed_z_um",
            "half width of control's interval of 95 % of the gap",
        ),
        number("level_x", &format!("{level}, in x")),
        number("level_y", &format!("{level}, in y")),
        number("level_z", &format!("{level}, of the gap")),
        number(
            "stated_outside",
            "control's own probability that the fiber is out of tolerance",
        ),
    ]
}

/// Columns of a device on which something broke.
fn ends() -> [Column; 2] {
    let text = |name: &str, about: &str| Column::new(name, Kind::Text, about);
    [
        text("injected", "what was broken on purpose, and when"),
        text(
            "rule",
            "why the machine stopped, same for a device's fibers",
        ),
    ]
}

/// Adds the rows of a device.
pub fn push(table: &mut Table, procedure: Procedure, device: &Device) {
    let document = &device.document;
    let injected = (!document.injected.is_empty()).then(|| document.injected.join(","));
    for fiber in &document.fibers {
        let attempted = !fiber.phases.is_empty();
        let mut row = vec![
            Cell::Whole(device.seed),
            Cell::Text(Some(fiber.port)),
            Cell::Text(Some(fiber.outcome.name())),
            Cell::Text((fiber.outcome != OutcomeCode::Aligned).then_some(&fiber.detail)),
            Cell::Flag(fiber.within_tolerance),
            Cell::Flag(Some(document.collision)),
            Cell::Number(attempted.then_some(fiber.seconds)),
        ];
        let in_phases = |of: &dyn Fn(&str) -> bool| {
            fiber
                .phases
                .iter()
                .filter(|phase| of(phase.name))
                .map(|phase| phase.seconds)
                .reduce(|sum, seconds| sum + seconds)
        };
        let named = procedure.phases();
        for phase in named {
            row.push(Cell::Number(in_phases(&|name| name == *phase)));
        }
        row.push(Cell::Number(in_phases(&|name| !named.contains(&name))));
        let offset = fiber.offset_um;
        row.extend(
            [
                offset.map(|o| o.x),
                offset.map(|o| o.y),
                offset.map(|o| o.z),
                fiber.coupling_loss_db,
                document.smallest_gap_um,
            ]
            .map(Cell::Number),
        );
        let believed = fiber.believed.as_ref();
        let levels = believed
            .zip(offset)
            .map(|(believed, o)| believed.place.levels([o.x, o.y, o.z].map(|um| 1e-6 * um)));
        let level = |i: usize| levels.map(|levels| rounded(levels[i], 1e-9));
        row.extend(
            [
                believed.map(|b| b.within_95_percent_um.x),
                believed.map(|b| b.within_95_percent_um.z),
                level(0),
                level(1),
                level(2),
                believed.map(|b| b.outside),
            ]
            .map(Cell::Number),
        );
        row.push(Cell::Text(injected.as_deref()));
        row.push(Cell::Text(document.fault.as_ref().map(|f| f.rule.text())));
        let arms = document.arms.as_ref();
        row.extend(
            [
                arms.map(|arms| arms.seconds),
                arms.map(|arms| arms.idle_seconds()[Side::Left.index()]),
                arms.map(|arms| arms.idle_seconds()[Side::Right.index()]),
                arms.map(Arms::both_moving_seconds),
            ]
            .map(Cell::Number),
        );
        table.add(row);
    }
}

/// Whole devices in a table.
pub(super) fn devices(table: &Table) -> u64 {
    table.rows() as u64 / ROWS_PER_DEVICE
}
