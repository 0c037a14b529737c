//! A tray of devices: gripping, dispensing, the lamp, adhesive that shrinks as it cures, and the next device.

use super::{FiberInHolder, Fixed, Twin, tip_of};
use crate::plant::{AdhesivePlant, HandlingPlant};
use crate::sensors::normal;
use pigtail_hal::spec::{HandlingSpec, HolderSpec, OUTPUTS, SIDES};
use pigtail_hal::{FiberHandling, Handled, Side};
use pigtail_model::cure::{Cure, Cured, Heat};
use pigtail_model::frames::{Chip, Point};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;

/// A device of a tray, before it is brought to the manipulators.
#[derive(Debug, Clone)]
pub struct TrayDevice {
    /// The device with its fibers, as a twin of its own: mechanics and noise are those of the machine that it comes to.
    pub twin: Twin,
    /// Where its fibers really lie: side, port, and place in the frame of the chip by design, metres.
    pub fibers: Vec<(Side, usize, [f64; 3])>,
}

/// An adhesive between a fiber and the chip.
#[derive(Debug, Clone, Copy)]
struct Bond {
    cured: Cured,
    /// Of the lamp on it, of the nominal one.
    irradiance: f64,
    /// How far it pulls the fiber in all before it gels, and from then on, metres.
    shift: [[f64; 3]; 2],
    /// Where the tip and its holder were when it gelled.
    gelled: Option<(Point<Chip>, Point<Chip>)>,
}

impl Bond {
    /// How far it has pulled so far, metres: before the gel point, and after.
    fn pulled(&self, production: &Production) -> [[f64; 3]; 2] {
        let (a, gel) = (self.cured.conversion, production.cure.gel());
        let warm = production.adhesive.expansion * self.cured.warmer;
        let [before, after] = self.shift;
        let size = length(&after).max(f64::MIN_POSITIVE);
        let flows = before.map(|s| s * (a / gel).min(1.0));
        let solid = ((a - gel) / (1.0 - gel)).max(0.0) * (1.0 - production.adhesive.released);
        // Warmth pushes where shrinkage pulls from.
        [flows, after.map(|s| s * solid - warm * s / size)]
    }
}

fn length(v: &[f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// What a twin with a tray has beside one without.
#[derive(Debug, Clone)]
pub(super) struct Production {
    spec: HandlingSpec,
    handling: HandlingPlant,
    adhesive: AdhesivePlant,
    cure: Cure,
    /// Mean shift on this machine, before and after the gel point, metres, indexed by side.
    means: [[[f64; 3]; 2]; SIDES],
    rng: Pcg64Mcg,
    /// What each holder is at, until which cycle.
    busy: [Option<(FiberHandling, u64)>; SIDES],
    bonds: [Option<Bond>; SIDES],
    lamps: [bool; SIDES],
    fibers: Vec<(Side, usize, [f64; 3])>,
    waiting: VecDeque<TrayDevice>,
    /// The truths of the devices that have gone.
    gone: Vec<super::Truth>,
    apart: f64,
}

/// Cycles between two steps of the cure.
const EVERY: u64 = 25;

/// So much of what a holder moves once the adhesive has gelled bends the fiber's tip along, until it is let go.
const BENDS: f64 = 0.05;

impl Twin {
    /// The same machine with a tray: its own device with the places of its fibers, and those behind it.
    #[must_use]
    pub fn with_tray(
        mut self,
        fibers: Vec<(Side, usize, [f64; 3])>,
        waiting: Vec<TrayDevice>,
    ) -> Self {
        let mut of_machine = Pcg64Mcg::seed_from_u64(self.seeds.0);
        let adhesive = self.adhesive;
        let means = Side::ALL.map(|_| {
            let mut askew = |share: f64| share * adhesive.pull * normal(&mut of_machine);
            let mean = [
                askew(adhesive.askew),
                askew(adhesive.askew) - adhesive.pull,
                askew(adhesive.askew),
            ];
            [mean, mean.map(|m| m + askew(0.5 * adhesive.askew))]
        });
        let heat = Heat {
            lamp: adhesive.lamp_warms,
            reaction: adhesive.reaction_warms,
            activation: adhesive.activation,
            cools: adhesive.cools,
        };
        let cure = Cure::gelling(
            adhesive.gel,
            adhesive.gel_conversion,
            Cure::ORDERS,
            Cure::SEED,
            heat,
        );
        self.production = Some(Box::new(Production {
            spec: self.spec.handling,
            handling: self.handling,
            adhesive,
            cure,
            means,
            rng: Pcg64Mcg::seed_from_u64(self.seeds.1),
            busy: [None; SIDES],
            bonds: [None; SIDES],
            lamps: [false; SIDES],
            fibers,
            waiting: waiting.into(),
            gone: Vec::new(),
            apart: f64::INFINITY,
        }));
        self
    }

    /// The truths of the devices of a tray, in order: those that have gone, and the one that is here. Not part of
    /// [`pigtail_hal::Machine`].
    pub fn truths(&self) -> Vec<super::Truth> {
        let gone = self.production.iter().flat_map(|p| p.gone.iter().copied());
        gone.chain([self.truth()]).collect()
    }

    /// Where the fiber that a holder carries really is before its port. Not part of [`pigtail_hal::Machine`].
    pub fn held_truth(&self, side: Side) -> Option<super::FiberTruth> {
        let held = self.held[side.index()]?;
        let tip = self.held_tip(side, self.holders[side.index()], &held.fiber);
        let port = self.light.port(side, held.port);
        let fixed = Fixed {
            tip,
            fiber: held.fiber,
            coupling: self.light.coupling(port, tip, &held.fiber),
        };
        Some(self.light.truth(side, held.port, &fixed))
    }

    /// How far fibers lie from their places on a tray, standard deviation, metres.
    pub fn placed(&self) -> f64 {
        self.handling.placed
    }

    /// The least distance between both holders so far, metres; `None` without a tray. Not part of
    /// [`pigtail_hal::Machine`].
    pub fn smallest_apart(&self) -> Option<f64> {
        self.production.as_ref().map(|production| production.apart)
    }

    /// A step of the production cycle begins.
    pub(super) fn begin_handling(&mut self, side: Side, what: FiberHandling) {
        let cycle = self.cycle;
        let rate = self.spec.servo.rate;
        let Some(production) = &mut self.production else {
            self.handled[side.index()] = Some(Handled::Missed);
            return;
        };
        let spec = production.spec;
        let nominal = match what {
            FiberHandling::Pick(_) => spec.pick,
            FiberHandling::Wet(volume) => spec.wet * f64::from(volume),
            FiberHandling::Release => spec.release,
            FiberHandling::Index => spec.index,
            _ => 0.0,
        };
        let spread = production.handling.spread;
        let times = 1.0 + spread * (2.0 * production.rng.random::<f64>() - 1.0);
        let cycles = (nominal * times * rate).round().max(1.0) as u64;
        production.busy[side.index()] = Some((what, cycle + cycles));
    }

    /// What ends in this cycle, and how adhesives go on. `holders` are where the holders are.
    pub(super) fn produce(&mut self, holders: &[Point<Chip>; SIDES]) {
        self.holders = *holders;
        let Some(mut production) = self.production.take() else {
            return;
        };
        for side in Side::ALL {
            let i = side.index();
            if let Some((what, until)) = production.busy[i]
                && until <= self.cycle
            {
                production.busy[i] = None;
                let how = self.end_handling(&mut production, side, what, holders[i]);
                self.handled[i] = Some(how);
            }
            if self.cycle.is_multiple_of(EVERY) {
                self.cure(&mut production, side, holders[i]);
            }
        }
        let reach = |side: Side| {
            let held = self.held[side.index()].map_or(0.0, |held| held.fiber.offset[2]);
            holders[side.index()].shifted(0.0, 0.0, held)
        };
        let (left, right) = (reach(Side::Left), reach(Side::Right));
        let HolderSpec { width, height, .. } = self.spec.holder;
        let aside = ((right.x - left.x).abs() - width).max(0.0);
        let up = ((right.y - left.y).abs() - height).max(0.0);
        let along = (right.z - left.z).max(0.0);
        production.apart = production.apart.min(aside.hypot(up).hypot(along));
        self.production = Some(production);
    }

    fn end_handling(
        &mut self,
        production: &mut Production,
        side: Side,
        what: FiberHandling,
        holder: Point<Chip>,
    ) -> Handled {
        let i = side.index();
        match what {
            FiberHandling::Pick(port) => self.pick(production, side, usize::from(port), holder),
            FiberHandling::Wet(volume) => {
                if self.held[i].is_none() {
                    return Handled::Missed;
                }
                production.bonds[i] = Some(production.bond(side, f64::from(volume)));
                Handled::Done
            }
            FiberHandling::Lamp(on) => {
                production.lamps[i] = on;
                Handled::Done
            }
            FiberHandling::Release => {
                self.release(production, side);
                Handled::Done
            }
            FiberHandling::Index => {
                let Some(next) = production.waiting.pop_front() else {
                    return Handled::Missed;
                };
                production.gone.push(self.truth());
                self.light = next.twin.light;
                self.tray = next.twin.tray;
                self.attached = [[None; OUTPUTS]; SIDES];
                for (mine, its) in self.manipulators.iter_mut().zip(&next.twin.manipulators) {
                    mine.placement = its.placement;
                }
                production.fibers = next.fibers;
                Handled::Done
            }
            _ => Handled::Missed,
        }
    }

    /// The gripper closes: on the fiber of a port of this device, or of the next once it has been taken.
    fn pick(
        &mut self,
        production: &mut Production,
        side: Side,
        port: usize,
        holder: Point<Chip>,
    ) -> Handled {
        let i = side.index();
        let missed = production.rng.random::<f64>() < production.handling.missed;
        let own = self.tray[i].iter().any(|held| held.port == port);
        let (tray, fibers) = match production.waiting.front_mut() {
            Some(next) if !own => (&mut next.twin.tray[i], &next.fibers),
            _ => (&mut self.tray[i], &production.fibers),
        };
        let lies = fibers
            .iter()
            .find(|(at, of, _)| (*at, *of) == (side, port))
            .map(|(_, _, [x, y, z])| Point::new(*x, *y, *z));
        let near = lies
            .is_some_and(|lies: Point<Chip>| holder.distance(lies) <= production.handling.grips);
        let place = tray.iter().position(|held| held.port == port);
        match place {
            Some(place) if near && !missed && self.held[i].is_none() => {
                self.held[i] = Some(tray.remove(place));
                production.bonds[i] = None;
                Handled::Done
            }
            _ => Handled::Missed,
        }
    }

    fn cure(&self, production: &mut Production, side: Side, holder: Point<Chip>) {
        let i = side.index();
        let (Some(mut bond), Some(held)) = (production.bonds[i], &self.held[i]) else {
            return;
        };
        if !production.lamps[i] && bond.cured.warmer == 0.0 {
            return;
        }
        let lit = if production.lamps[i] {
            bond.irradiance
        } else {
            0.0
        };
        let seconds = EVERY as f64 * self.spec.period();
        bond.cured = production.cure.step(bond.cured, lit, seconds);
        if bond.gelled.is_none() && production.cure.has_gelled(&bond.cured) {
            let [x, y, z] = bond.pulled(production)[0];
            let tip = tip_of(holder, &held.fiber).shifted(x, y, z);
            bond.gelled = Some((tip, holder));
        }
        production.bonds[i] = Some(bond);
    }

    /// The holder opens. A fiber whose adhesive has not gelled is lost.
    fn release(&mut self, production: &mut Production, side: Side) {
        let i = side.index();
        production.lamps[i] = false;
        let (bond, held) = (production.bonds[i].take(), self.held[i].take());
        let (Some(bond), Some(held)) = (bond, held) else {
            return;
        };
        let Some((tip, _)) = bond.gelled else {
            return;
        };
        // Cold, and no longer held against what shrinks.
        let (a, gel) = (bond.cured.conversion, production.cure.gel());
        let [x, y, z] = bond.shift[1].map(|s| s * ((a - gel) / (1.0 - gel)).max(0.0));
        let tip = tip.shifted(x, y, z);
        let coupling = self
            .light
            .coupling(self.light.port(side, held.port), tip, &held.fiber);
        self.attached[i][held.port] = Some(Fixed {
            tip,
            fiber: held.fiber,
            coupling,
        });
    }

    /// The tip of a fiber in a holder, where adhesive may pull it or hold it.
    pub(super) fn held_tip(
        &self,
        side: Side,
        holder: Point<Chip>,
        fiber: &FiberInHolder,
    ) -> Point<Chip> {
        let tip = tip_of(holder, fiber);
        let Some(production) = &self.production else {
            return tip;
        };
        let Some(bond) = &production.bonds[side.index()] else {
            return tip;
        };
        let [[bx, by, bz], [ax, ay, az]] = bond.pulled(production);
        match bond.gelled {
            None => tip.shifted(bx + ax, by + ay, bz + az),
            Some((gelled, then)) => gelled.shifted(
                ax + BENDS * (holder.x - then.x),
                ay + BENDS * (holder.y - then.y),
                az + BENDS * (holder.z - then.z),
            ),
        }
    }
}

impl Production {
    /// An adhesive of so many nanolitres: it pulls as far as it is large.
    fn bond(&mut self, side: Side, volume: f64) -> Bond {
        let adhesive = self.adhesive;
        let size = (volume / adhesive.volume).cbrt();
        let rng = &mut self.rng;
        let shift = self.means[side.index()]
            .map(|mean| mean.map(|m| 0.5 * size * (m + adhesive.scatter * normal(rng))));
        Bond {
            cured: Cured::default(),
            irradiance: (adhesive.lamp_spread * normal(rng)).exp(),
            shift,
            gelled: None,
        }
    }
}
