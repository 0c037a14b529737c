//! What a tray will take, from recipe and machine alone; and what limits it.
//!
//! The plan goes through the same steps as [`run`](crate::run::run), in the same order, with the times that datasheet and recipe
//! say: lines by the limits of the axes, handling and cure as stated, alignment as expected. What has to wait for what
//! follows from that order: a step begins when its manipulator, and whatever it shares, is free.

use crate::cell::Bar;
use crate::check::side_of;
use crate::recipe::Production;
use crate::run::bond::{BEFORE, BEFORE_FIRST, BEFORE_TWO};
use crate::run::witness::ROUND;
use crate::tray::{Device, Tray};
use pigtail_control::job::PORTS;
use pigtail_control::recipe::Recipe;
use pigtail_control::trajectory::{Limits, Line, Path, Profile, Rates, Shape};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Side, Spec};
use pigtail_model::frames::{Macro, Point};
use serde::Serialize;
use std::collections::BTreeMap;

/// What a tray will take.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// What each manipulator does, when.
    #[serde(skip)]
    pub bars: Vec<Bar>,
    /// All of it, seconds of machine time.
    pub seconds: f64,
    /// A device, seconds: the mean.
    pub seconds_per_device: f64,
    /// Devices an hour.
    pub devices_per_hour: f64,
    /// Share of the time in which a manipulator neither does anything nor holds anything, percent, left and right.
    pub idle_percent: [f64; SIDES],
    /// Share of the time in which a manipulator has no work of its own, and is idle or stands still for the other, at least, for
    /// fibers as unequal as those of this tray, however they are overlapped: one less its work over that of the manipulator that
    /// has more.
    pub idle_or_waiting_at_least_percent: [f64; SIDES],
    /// Share of the time in which a manipulator is idle at least where each also holds still for the other's cures as it does here,
    /// percent, left and right; see [`idle_at_least`].
    pub idle_at_least_percent: [f64; SIDES],
    /// Share of the time in which a manipulator is idle at least were everything but the other's cures done in no time, percent, left and
    /// right.
    pub idle_by_cures_at_least_percent: [f64; SIDES],
    /// What each manipulator has to do, the longest first.
    pub work: Vec<Work>,
    /// What is on the critical path, and how many seconds of it, the longest first.
    pub limits: Vec<(String, f64)>,
}

/// For how long each manipulator is at something, seconds of the whole tray.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Work {
    /// What; `witness` is to hold still for the other one's cure.
    pub what: String,
    /// The left one.
    pub left: f64,
    /// The right one.
    pub right: f64,
}

/// For axes to come to rest at the end of a line, seconds.
const REST: f64 = 0.06;

/// Looks before the lamp is on, and requests that are over in a cycle or two, seconds.
const LOOKS: f64 = 0.2;

/// How far back a holder stays clear, metres: as when the tray is run.
const CLEAR: f64 = 2e-3;

/// Which of some bars are on the critical path: from the last one to end back to what each had to wait for.
pub fn critical(bars: &[Bar]) -> Vec<bool> {
    /// Bars that follow so closely have waited for each other, seconds.
    const CLOSE: f64 = 0.02;
    let mut on = vec![false; bars.len()];
    let last = (0..bars.len()).max_by(|a, b| bars[*a].end.total_cmp(&bars[*b].end));
    let mut at = last;
    while let Some(i) = at {
        on[i] = true;
        let before = |k: &usize| !on[*k] && bars[*k].end <= bars[i].start + CLOSE;
        // Of those that end together, the one of the same manipulator.
        at = (0..bars.len()).filter(before).max_by(|a, b| {
            let key =
                |k: usize| (bars[k].end * 1e3 + f64::from(bars[k].side == bars[i].side)).floor();
            key(*a).total_cmp(&key(*b))
        });
    }
    on
}

/// Sums of the bars on a critical path, the longest first.
pub fn limits(bars: &[Bar]) -> Vec<(String, f64)> {
    let mut sums: BTreeMap<&str, f64> = BTreeMap::new();
    for (bar, on) in bars.iter().zip(critical(bars)) {
        if on {
            *sums.entry(bar.what).or_insert(0.0) += bar.end - bar.start;
        }
    }
    let mut all: Vec<_> = sums
        .into_iter()
        .map(|(what, s)| (what.to_owned(), s))
        .collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

/// Share of the time in which a manipulator is idle, percent.
pub fn idle(bars: &[Bar], side: Side, seconds: f64) -> f64 {
    let of = bars
        .iter()
        .filter(|bar| bar.side == side.name() && bar.what != "index");
    let busy: f64 = of.map(|bar| bar.end - bar.start).sum();
    100.0 * (1.0 - busy / seconds.max(1e-9)).max(0.0)
}

/// See [`Plan::idle_or_waiting_at_least_percent`].
pub fn at_least(bars: &[Bar], side: Side) -> f64 {
    let work = |of: Side| -> f64 {
        let own = bars
            .iter()
            .filter(|bar| bar.side == of.name() && bar.what != "witness");
        own.map(|bar| bar.end - bar.start).sum()
    };
    let most = work(Side::Left).max(work(Side::Right));
    100.0 * (1.0 - work(side) / most.max(1e-9))
}

/// What the idle time of a manipulator cannot be below, whatever the order of these steps, percent. It does one thing at a time: all of
/// it takes no less time `T` than either of them is at work or holds still for the other, and whoever is at that for `t` is idle for
/// `1 - t/T` of it, or for more where it takes longer.
pub fn idle_at_least(bars: &[Bar], side: Side) -> f64 {
    let at = |of: Side| -> f64 {
        let own = bars.iter().filter(|bar| bar.side == of.name());
        own.map(|bar| bar.end - bar.start).sum()
    };
    let least = at(Side::Left).max(at(Side::Right));
    100.0 * (1.0 - at(side) / least.max(1e-9))
}

/// See [`Plan::idle_by_cures_at_least_percent`]: whoever has more to cure takes no less time than that.
pub fn idle_by_cures(bars: &[Bar], side: Side) -> f64 {
    let cures = |of: Side| -> f64 {
        let own = bars
            .iter()
            .filter(|b| b.side == of.name() && b.what == "cure");
        own.map(|bar| bar.end - bar.start).sum()
    };
    let own = bars
        .iter()
        .filter(|b| b.side == side.name() && b.what != "witness");
    let own: f64 = own.map(|bar| bar.end - bar.start).sum();
    let least = Side::ALL.map(cures).into_iter().fold(own, f64::max);
    100.0 * (1.0 - own / least.max(1e-9))
}

/// What each manipulator has done, for how long, the longest first.
pub fn work(bars: &[Bar]) -> Vec<Work> {
    let mut sums: BTreeMap<&str, [f64; SIDES]> = BTreeMap::new();
    for bar in bars {
        let of = sums.entry(bar.what).or_default();
        of[usize::from(bar.side == Side::Right.name())] += bar.end - bar.start;
    }
    let mut all: Vec<Work> = sums
        .into_iter()
        .map(|(what, [left, right])| Work {
            what: what.to_owned(),
            left,
            right,
        })
        .collect();
    all.sort_by(|a, b| (b.left + b.right).total_cmp(&(a.left + a.right)));
    all
}

struct Planner<'p> {
    tray: &'p Tray,
    spec: &'p Spec,
    recipe: &'p Recipe,
    /// When each manipulator, and the needle, is free.
    free: [f64; SIDES],
    needle: f64,
    at: [[f64; 3]; SIDES],
    bars: Vec<Bar>,
}

impl Planner<'_> {
    fn line(&self, side: Side, to: [f64; 3]) -> f64 {
        let rates = |speed, acceleration, jerk| Rates {
            speed,
            acceleration,
            jerk,
        };
        let (xy, z) = (&self.spec.five_bar, &self.spec.z_stage);
        let limits = Limits {
            xy: rates(xy.speed, xy.acceleration, xy.jerk),
            z: rates(z.speed, z.acceleration, z.jerk),
        };
        let [ax, ay, az] = self.at[side.index()];
        let [bx, by, bz] = to;
        // As long in the manipulator's frame as in the chip's.
        let line = Line::new(Point::<Macro>::new(ax, ay, az), Point::new(bx, by, bz));
        let path: Path = line.into();
        if path.length() == 0.0 {
            return 0.0;
        }
        Profile::new(Shape::default(), path.length(), &path.limits(&limits)).duration() + REST
    }

    fn go(&mut self, side: Side, to: [f64; 3]) -> f64 {
        let seconds = self.line(side, to);
        self.at[side.index()] = to;
        seconds
    }

    fn back(&mut self, side: Side) -> f64 {
        let [x, y, z] = self.at[side.index()];
        let ports = &self.recipe.ports;
        let clear = match side {
            Side::Left => z.min(ports.input[2] - CLEAR),
            Side::Right => {
                let far = ports.outputs.iter().map(|at| at[2]).fold(0.0, f64::max);
                z.max(far + CLEAR)
            }
        };
        self.go(side, [x, y, clear])
    }

    fn bar(&mut self, side: Side, on: (&str, &str), what: &'static str, held: bool, seconds: f64) {
        let start = self.free[side.index()];
        let end = start + seconds;
        self.free[side.index()] = end;
        if seconds > 0.0 {
            self.bars.push(Bar {
                side: side.name(),
                device: on.0.to_owned(),
                port: on.1.to_owned(),
                what,
                held,
                start,
                end,
            });
        }
    }

    fn pick(&mut self, side: Side, device: &Device, port: &str) {
        let on = (device.serial.as_str(), port);
        let back = self.back(side);
        self.bar(side, on, "retreat", false, back);
        let place = self.tray.places[&device.fibers[port]].at;
        let seconds = self.go(side, place) + self.spec.handling.pick + LOOKS;
        self.bar(side, on, "pick", false, seconds);
    }

    fn adhesive(&mut self, side: Side, device: &Device, port: &str, production: &Production) {
        let on = (device.serial.as_str(), port);
        let at = match side {
            Side::Left => self.tray.dispenser.left,
            Side::Right => self.tray.dispenser.right,
        };
        let i = side.index();
        let waits = (self.needle - self.free[i]).max(0.0);
        let adhesive = &production.adhesive;
        let seconds = waits
            + self.go(side, at)
            + self.spec.handling.wet * f64::from(adhesive.volume)
            + adhesive.dwell;
        self.bar(side, on, "adhesive", false, seconds);
        self.needle = self.free[i];
    }

    /// Both are free only when the later one is.
    fn meet(&mut self) {
        let later = self.free[0].max(self.free[1]);
        self.free = [later; SIDES];
    }
}

/// What a tray will take on a machine. Tray and recipes are well; see [`check`](crate::check).
#[expect(
    clippy::too_many_lines,
    reason = "the cycle of a device, in order, as it is run"
)]
pub fn plan(
    tray: &Tray,
    productions: &BTreeMap<String, Production>,
    recipe: &Recipe,
    spec: &Spec,
    homes: [[f64; 3]; SIDES],
) -> Plan {
    let (left, right) = (Side::Left, Side::Right);
    let mut plan = Planner {
        tray,
        spec,
        recipe,
        free: [0.0; SIDES],
        needle: 0.0,
        at: homes,
        bars: Vec::new(),
    };
    let of = |device: &Device| &productions[tray.recipe_of(device)];
    let (mut ahead, mut left_clear) = (false, 0.0);
    let mut taught = [false; SIDES];
    for (k, device) in tray.devices.iter().enumerate() {
        let production = of(device);
        if k > 0 {
            let back = plan.back(right);
            plan.bar(right, (&device.serial, ""), "retreat", false, back);
            // The left one need not be done with what it is at, only away from the chip.
            plan.free[right.index()] = plan.free[right.index()].max(left_clear);
            let index = spec.handling.index + spec.vision.oldest();
            plan.bar(right, (&device.serial, ""), "index", false, index);
            if !ahead {
                plan.meet();
            }
        }
        let next = tray
            .devices
            .get(k + 1)
            .filter(|next| of(next).ports[0] == PORTS[0]);
        let last = production.ports.len() - 1;
        let together = production.cure.together;
        let mut wets = false;
        for (n, port) in production.ports.iter().enumerate() {
            let side = side_of(port);
            let on = (device.serial.as_str(), port.as_str());
            let input = port == PORTS[0];
            if !(input && ahead) {
                plan.pick(side, device, port);
                plan.adhesive(side, device, port, production);
            }
            if input {
                ahead = false;
                plan.meet();
            }
            let align = production.align.expected[usize::from(!input)];
            plan.bar(side, on, "align", false, align);
            let number = PORTS.iter().position(|p| p == port).unwrap_or(0);
            let at = number
                .checked_sub(1)
                .map_or(recipe.ports.input, |i| recipe.ports.outputs[i]);
            plan.at[side.index()] = at;
            if input {
                plan.bar(right, on, "align", false, align);
                plan.at[right.index()] = recipe.ports.outputs[0];
            }
            if together && n == 0 {
                // It waits at its peak for the first output.
                continue;
            }
            if let Some(next) = next
                && n == last
                && wets
            {
                // Beside the last of the cures.
                let start = plan.free[right.index()];
                plan.free[left.index()] = plan.free[left.index()].max(start);
                plan.adhesive(left, next, PORTS[0], of(next));
                wets = false;
            }
            let sides: &[Side] = match (together && n == 1, side) {
                (true, _) => &[left, right],
                (false, Side::Left) => &[left],
                (false, Side::Right) => &[right],
            };
            if sides.len() > 1 {
                let on = (device.serial.as_str(), PORTS[0]);
                let waits = plan.free[right.index()] - plan.free[left.index()];
                plan.bar(left, on, "witness", true, waits.max(0.0));
            }
            let first = sides.iter().any(|side| !taught[side.index()]);
            for side in sides {
                taught[side.index()] = true;
            }
            let before = match (production.cure.track, sides.len() > 1) {
                (false, _) => 0.0,
                _ if first => BEFORE_FIRST,
                (true, false) => BEFORE,
                (true, true) => BEFORE_TWO,
            };
            // Of an input that is cured alone the sensing fiber is the witness.
            let round = if input { ROUND } else { 0.0 };
            let cure = production.cure.time + LOOKS + before + round;
            let verify = production.verify.look;
            for side in sides {
                plan.bar(*side, on, "cure", true, cure);
                plan.bar(*side, on, "release", false, spec.handling.release);
                plan.bar(*side, on, "verify", false, verify);
            }
            if input {
                let all = cure + spec.handling.release + verify;
                plan.bar(right, on, "witness", true, all);
            }
            if sides.contains(&left) {
                let back = plan.back(left);
                plan.bar(left, on, "retreat", false, back);
                left_clear = plan.free[left.index()];
                if let Some(next) = next {
                    plan.pick(left, next, PORTS[0]);
                    ahead = true;
                    wets = n < last;
                    if !wets {
                        plan.adhesive(left, next, PORTS[0], of(next));
                    }
                }
            }
        }
    }
    let seconds = plan.free[0].max(plan.free[1]);
    let devices = tray.devices.len().max(1) as f64;
    Plan {
        seconds,
        seconds_per_device: seconds / devices,
        devices_per_hour: 3600.0 * devices / seconds.max(1e-9),
        idle_percent: Side::ALL.map(|side| idle(&plan.bars, side, seconds)),
        idle_or_waiting_at_least_percent: Side::ALL.map(|side| at_least(&plan.bars, side)),
        idle_at_least_percent: Side::ALL.map(|side| idle_at_least(&plan.bars, side)),
        idle_by_cures_at_least_percent: Side::ALL.map(|side| idle_by_cures(&plan.bars, side)),
        work: work(&plan.bars),
        limits: limits(&plan.bars),
        bars: plan.bars,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_order_of_the_steps_leaves_less_idle_than_is_said() {
        let bar = |side, what, start, end| Bar {
            side,
            device: String::new(),
            port: String::new(),
            what,
            held: false,
            start,
            end,
        };
        // Left 10 s of work; right 20 s of work and 20 s as a witness.
        let order = |gap: f64| {
            vec![
                bar("left", "cure", gap, gap + 10.0),
                bar("right", "witness", 0.0, 20.0),
                bar("right", "cure", 20.0, 40.0),
            ]
        };
        for gap in [0.0, 15.0, 30.0, 50.0] {
            let bars = order(gap);
            let seconds = f64::max(40.0, gap + 10.0);
            let least = Side::ALL.map(|side| idle_at_least(&bars, side));
            assert_eq!(least, [75.0, 0.0]);
            assert_eq!(at_least(&bars, Side::Left), 50.0);
            assert_eq!(
                Side::ALL.map(|side| idle_by_cures(&bars, side)),
                [50.0, 0.0]
            );
            for side in Side::ALL {
                assert!(idle(&bars, side, seconds) >= least[side.index()] - 1e-9);
            }
        }
    }
}
