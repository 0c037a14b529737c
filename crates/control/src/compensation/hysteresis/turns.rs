//! From one turning point to any number of them: (4.2) out of the network of (4.4).
//!
//! The network says where a piezo is on the way back from a turn, `f(v1, v)`. How far that way has
//! brought it, `E(v1, v) = f(v1, v1) - f(v1, v)`, is Everett's function of these two voltages. Of what
//! wipes out inner loops, and whose loops between two voltages are alike, nothing more has to be known:
//! after turns at `v_1, v_2, ..., v_n` (4.2) is
//!
//! ```text
//! x = x(v_n) - E(v_n, v)      on the way down
//! x = x(v_n) + E(v, v_n)      on the way up
//! ```
//!
//! and a turn is forgotten, with the one before it, once the voltage has passed that one.
//!
//! `E` is kept in a table in which it grows with the way, for a network is smooth but where it was not
//! trained may fall. Along both of its voltages the table is a straight line from one node to the next,
//! so its inverse is found by walking from where the voltage is.

use super::Range;
use super::rbf::{FORWARD, Network, UNITS};

/// Intervals of a table along each voltage: straight lines between its nodes are then within a
/// nanometre of the network, for a range of 70 um.
const INTERVALS: usize = 128;

/// Nodes along each voltage.
const NODES: usize = INTERVALS + 1;

/// Distance of two nodes, units.
const STEP: f64 = UNITS / INTERVALS as f64;

/// The least slope of displacement over voltage, both in units: no piezo's is less after a turn.
const LEAST_SLOPE: f64 = 0.2;

/// So many turns are remembered. Of more those two are forgotten without which the rest tells nearly the same.
const TURNS: usize = 40;

/// A displacement that is nearer than this to where the piezo is is there, units: what rounding makes of it is no turn. Less than a millionth of
/// a nanometre.
const ROUNDING: f64 = 1e-10;

/// Turns of a piezo that is cycled with falling amplitude.
const CYCLED: usize = 24;

/// How far a way back has brought a piezo, by where it began and where it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Everett {
    /// `E` at the nodes, units: by the upper voltage, then the lower.
    nodes: Vec<f64>,
    /// The displacement at the bottom of the range, units.
    bottom: f64,
}

impl Everett {
    /// Out of the network `x = f(v1, v)`, which was trained with ways back from these turning points.
    pub(super) fn of(forward: &Network, turns: &Range) -> Self {
        let trained = |upper: f64, lower: f64| {
            // Where no way back was trained the nearest one is like it.
            let turn = upper.clamp(turns.low, turns.high);
            forward.value([turn, turn]) - forward.value([turn, lower + turn - upper])
        };
        // What the ways forward say of the same, from the bottom on.
        let bottom = forward.value([FORWARD, 0.0]);
        let mut nodes = vec![0.0; NODES * NODES];
        for i in 1..NODES {
            let upper = i as f64 * STEP;
            let apart = forward.value([FORWARD, upper]) - bottom - trained(upper, 0.0);
            for j in (0..i).rev() {
                let lower = j as f64 * STEP;
                // Both ways are believed alike where they tell of the same.
                let share = 0.5 * (upper - lower) / upper;
                let found = trained(upper, lower) + share * apart;
                let least = LEAST_SLOPE * STEP;
                let inner = nodes[i * NODES + j + 1];
                let before = if j < i - 1 {
                    nodes[(i - 1) * NODES + j]
                } else {
                    0.0
                };
                nodes[i * NODES + j] = found.max(inner + least).max(before + least);
            }
        }
        // Beyond the diagonal, where only a cell that it crosses is looked up.
        for i in 0..NODES {
            for j in i + 1..NODES {
                nodes[i * NODES + j] = -nodes[j * NODES + i];
            }
        }
        Self { nodes, bottom }
    }

    /// `E`; both voltages in units.
    fn at(&self, upper: f64, lower: f64) -> f64 {
        let (i, a) = cell(upper);
        let (j, b) = cell(lower);
        let row = |i: usize| {
            let [p, q] = [self.nodes[i * NODES + j], self.nodes[i * NODES + j + 1]];
            p + b * (q - p)
        };
        let (p, q) = (row(i), row(i + 1));
        p + a * (q - p)
    }

    /// How far a way from `turn` to `volts` brings the piezo, with its sign.
    fn way(&self, turn: f64, volts: f64, rising: bool) -> f64 {
        if rising {
            self.at(volts, turn) - self.at(turn, turn)
        } else {
            self.at(turn, turn) - self.at(turn, volts)
        }
    }
}

/// The interval in which a voltage is, and the share of it.
fn cell(volts: f64) -> (usize, f64) {
    let at = volts.clamp(0.0, UNITS) / STEP;
    let i = (at as usize).min(INTERVALS - 1);
    (i, at - i as f64)
}

/// Where a voltage turned, and the displacement there; units.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Turn {
    volts: f64,
    displacement: f64,
}

/// Every turn that still matters. The first is the bottom of the range; they lie ever closer together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turns {
    past: [Turn; TURNS],
    n: usize,
    /// Where the piezo is.
    now: Turn,
    rising: bool,
}

impl Turns {
    /// A piezo at the bottom of its range.
    fn bottom(everett: &Everett) -> Self {
        let bottom = Turn {
            volts: 0.0,
            displacement: everett.bottom,
        };
        let mut past = [Turn::default(); TURNS];
        past[0] = bottom;
        Self {
            past,
            n: 1,
            now: bottom,
            rising: true,
        }
    }

    /// A piezo that has been cycled with falling amplitude around a voltage, and rests there.
    pub(super) fn cycled(everett: &Everett, volts: f64) -> Self {
        let mut turns = Self::bottom(everett);
        let volts = volts.clamp(0.0, UNITS);
        for k in 0..CYCLED {
            let share = 1.0 - k as f64 / CYCLED as f64;
            let to = if k % 2 == 0 { UNITS } else { 0.0 };
            turns.follow(everett, volts + share * (to - volts));
        }
        turns.follow(everett, volts);
        turns
    }

    /// The displacement.
    pub(super) fn displacement(&self) -> f64 {
        self.now.displacement
    }

    fn last(&self) -> Turn {
        self.past[self.n - 1]
    }

    /// Turns round, if what comes next lies the other way.
    fn face(&mut self, everett: &Everett, rising: bool) {
        if rising == self.rising {
            return;
        }
        self.rising = rising;
        if self.now.volts == self.last().volts {
            // It has not gone on since it turned; but from the bottom there is one way only.
            self.n = (self.n - 1).max(1);
            return;
        }
        if self.n == TURNS {
            self.forget_least(everett);
        }
        self.past[self.n] = self.now;
        self.n += 1;
    }

    /// Forgets the two neighbours without which the turn after them is most nearly where it is: by so much the piezo leaps once that is passed.
    /// That is not the smallest loop: lines to and fro between two ends leave wide loops that are all but one and the same, of which all but one
    /// are to be forgotten before any circle. Never the last turn: from there the way ahead goes on, also one that turns back at once.
    fn forget_least(&mut self, everett: &Everett) {
        let leap = |k: usize| {
            let (from, to) = (self.past[k - 1], self.past[k + 2]);
            let way = everett.way(from.volts, to.volts, to.volts > from.volts);
            (from.displacement + way - to.displacement).abs()
        };
        let neighbours = 1..self.n - 2;
        let least = neighbours.min_by(|a, b| leap(*a).total_cmp(&leap(*b)));
        if let Some(least) = least {
            self.past.copy_within(least + 2..self.n, least);
            self.n -= 2;
        }
    }

    /// The turn that the way ahead passes, before which it and the last one are forgotten.
    fn ahead(&self) -> Option<Turn> {
        (self.n > 1).then(|| self.past[self.n - 2])
    }

    /// Goes to a voltage.
    pub(super) fn follow(&mut self, everett: &Everett, volts: f64) {
        let volts = volts.clamp(0.0, UNITS);
        if volts == self.now.volts {
            return;
        }
        self.face(everett, volts > self.now.volts);
        let passed = |turn: Turn, rising: bool| {
            if rising {
                volts >= turn.volts
            } else {
                volts <= turn.volts
            }
        };
        while self.ahead().is_some_and(|turn| passed(turn, self.rising)) {
            self.forget();
        }
        self.go(everett, volts);
    }

    /// Forgets the last turn, and the one before it, which has been passed. The bottom stays.
    fn forget(&mut self) {
        self.now = self.past[self.n - 2];
        self.n = (self.n - 2).max(1);
        if self.n == 1 {
            self.rising = self.now.volts > self.last().volts || self.now.volts <= 0.0;
        }
    }

    /// Goes on to a voltage that lies before the turn ahead.
    fn go(&mut self, everett: &Everett, volts: f64) {
        let from = self.last();
        self.now = Turn {
            volts,
            displacement: from.displacement + everett.way(from.volts, volts, self.rising),
        };
    }

    /// Goes to a displacement, or as near as limits of the voltage allow; the voltage there.
    pub(super) fn reach(&mut self, everett: &Everett, wanted: f64, limits: &Range) -> f64 {
        if (wanted - self.now.displacement).abs() <= ROUNDING {
            return self.now.volts;
        }
        self.face(everett, wanted > self.now.displacement);
        // As far as a turn but for rounding is as far: whoever goes to and fro between two places leaves two turns, however often.
        let passed = |turn: Turn, rising: bool| {
            if rising {
                wanted >= turn.displacement - ROUNDING
            } else {
                wanted <= turn.displacement + ROUNDING
            }
        };
        while self.ahead().is_some_and(|turn| passed(turn, self.rising)) {
            self.forget();
        }
        let end = if self.rising { limits.high } else { limits.low };
        let end = end.clamp(0.0, UNITS);
        let from = self.last();
        let at = |volts: f64| from.displacement + everett.way(from.volts, volts, self.rising);
        let (mut here, mut next) = (self.now, self.now);
        let short = |displacement: f64| {
            if self.rising {
                displacement < wanted
            } else {
                displacement > wanted
            }
        };
        let before_end = |volts: f64| {
            if self.rising {
                volts < end
            } else {
                volts > end
            }
        };
        while before_end(next.volts) && short(next.displacement) {
            here = next;
            // To the next node of the table, up to which it is a straight line.
            let (i, share) = cell(here.volts);
            let node = match (self.rising, share > 0.0) {
                (true, _) => i + 1,
                (false, true) => i,
                (false, false) => i - 1,
            };
            let volts = node as f64 * STEP;
            let volts = if before_end(volts) { volts } else { end };
            next = Turn {
                volts,
                displacement: at(volts),
            };
        }
        let rise = next.displacement - here.displacement;
        let volts = if short(next.displacement) || rise == 0.0 {
            next.volts
        } else {
            let share = (wanted - here.displacement) / rise;
            here.volts + share.clamp(0.0, 1.0) * (next.volts - here.volts)
        };
        self.go(everett, volts);
        volts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A piezo whose ways bend upward: a loop is open by half of what the square of its width says.
    fn bending() -> Everett {
        let mut nodes = vec![0.0; NODES * NODES];
        for i in 0..NODES {
            for j in 0..NODES {
                let way = (i as f64 - j as f64) * STEP;
                nodes[i * NODES + j] = way * (0.8 + 0.02 * way.abs());
            }
        }
        Everett { nodes, bottom: 0.0 }
    }

    /// A fiber at rest at its peak jumped by 0.2 um: rounding turned its piezo there and back, and where all turns were taken the one between
    /// had made two others forgotten.
    #[test]
    fn a_way_that_turns_back_at_once_goes_on_from_where_it_was_however_many_turns_there_were() {
        let everett = bending();
        for turns in [TURNS - 6, TURNS, TURNS + 7] {
            let mut piezo = Turns::bottom(&everett);
            // Ever closer together, and so that each lies between the two before it.
            for k in 0..turns {
                let far = 4.0 * 0.9_f64.powf(k as f64);
                let to = if k % 2 == 0 { 5.0 + far } else { 5.0 - far };
                piezo.follow(&everett, to);
            }
            piezo.follow(&everett, 5.0);
            let before = piezo;
            // There and back, and no way between.
            piezo.face(&everett, !piezo.rising);
            piezo.face(&everett, !piezo.rising);
            let after = |mut piezo: Turns, by: f64| {
                piezo.follow(&everett, 5.0 + by);
                piezo.displacement()
            };
            for by in [-1e-6, 0.0, 1e-6, 1e-2] {
                let off = after(piezo, by) - after(before, by);
                assert!(off.abs() < 1e-7, "{turns} turns, {by}: {off}");
            }
        }
    }

    #[test]
    fn of_too_many_turns_those_are_forgotten_that_matter_least() {
        let everett = bending();
        let mut piezo = Turns::bottom(&everett);
        let far = |k: usize| 4.0 * 0.9_f64.powf(k as f64);
        for k in 0..2 * TURNS {
            let to = if k % 2 == 0 {
                5.0 + far(k)
            } else {
                5.0 - far(k)
            };
            piezo.follow(&everett, to);
        }
        // The widest loops are there yet: up to the first turn and beyond it all is as without what lay between.
        let mut without = Turns::bottom(&everett);
        for volts in [9.0, 9.5] {
            without.follow(&everett, volts);
            piezo.follow(&everett, volts);
            let off = piezo.displacement() - without.displacement();
            assert!(off.abs() < 1e-9, "{volts}: {off}");
        }
    }

    /// Ever smaller circles around a middle.
    fn circles(everett: &Everett, piezo: &mut Turns) {
        for k in 0..TURNS {
            let far = 0.4 * 0.97_f64.powf(k as f64);
            piezo.follow(everett, if k % 2 == 0 { 5.5 + far } else { 5.5 - far });
        }
    }

    /// A search's lines filled the memory with one and the same loop; circles were forgotten in its favour, and a fiber that came to rest from them
    /// leapt by half a micrometre.
    #[test]
    fn wide_loops_that_are_nearly_one_are_forgotten_before_small_ones() {
        let everett = bending();
        let (mut piezo, mut once) = (Turns::bottom(&everett), Turns::bottom(&everett));
        once.follow(&everett, 9.5);
        once.follow(&everett, 0.5);
        for k in 0..TURNS {
            let shorter = 1e-6 * k as f64;
            piezo.follow(&everett, 9.5 - shorter);
            piezo.follow(&everett, 0.5 + shorter);
        }
        circles(&everett, &mut piezo);
        circles(&everett, &mut once);
        for volts in [5.6, 5.4, 5.8, 5.2, 6.0, 5.0] {
            piezo.follow(&everett, volts);
            once.follow(&everett, volts);
            let off = piezo.displacement() - once.displacement();
            assert!(off.abs() < 1e-4, "{volts}: {off}");
        }
    }

    #[test]
    fn lines_to_and_fro_between_the_same_two_places_leave_the_turns_of_the_first() {
        let everett = bending();
        let limits = Range {
            low: 0.0,
            high: UNITS,
        };
        // Of ends of any kind, for rounding is lucky with some.
        for far in (0..30).map(|k| 0.3 + 0.107 * f64::from(k)) {
            let mut piezo = Turns::cycled(&everett, 5.0);
            let middle = piezo.displacement();
            let mut lines = |many: usize| {
                for line in 0..many {
                    let to = if line % 2 == 0 { far } else { -far };
                    for step in (0..20).rev() {
                        let share = 1.0 - f64::from(step) / 10.0;
                        piezo.reach(&everett, middle + to * share, &limits);
                    }
                }
                piezo.n
            };
            let first = lines(2);
            assert_eq!(lines(3 * TURNS), first, "{far}");
        }
    }

    #[test]
    fn what_rounding_makes_of_a_displacement_is_no_turn() {
        let everett = bending();
        let limits = Range {
            low: 0.0,
            high: UNITS,
        };
        let mut piezo = Turns::cycled(&everett, 5.0);
        let at = piezo.displacement() + 0.5;
        let volts = piezo.reach(&everett, at, &limits);
        let turns = piezo.n;
        for by in [1e-15, -1e-15, 2e-15, -2e-15] {
            assert_eq!(piezo.reach(&everett, at + by, &limits), volts);
        }
        assert_eq!(piezo.n, turns);
    }
}
