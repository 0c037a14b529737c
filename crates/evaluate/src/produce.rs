//! A tray produced on a twin: what control says of each pigtail beside what is.

use pigtail_control::job::PORTS;
use pigtail_control::station::Observer;
use pigtail_cycle::check::side_of;
use pigtail_cycle::run::{Event, Pigtail, Produced, Run};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Command, Error, Fault, Handled, Machine, Measurement, Rule, Side, Spec};
use pigtail_numerics::rounded;
use pigtail_session::job::Ended;
use pigtail_session::produce::{Loaded, Produce};
use pigtail_session::setup::Setup;
use pigtail_twin::production::TrayDevice;
use pigtail_twin::{FiberTruth, Specimen, Truth, Twin};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Deserializer, Serialize};
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::Instant;

/// What `produce` prints as JSON. Keys are a contract: more may come, none changes its name or meaning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProduceDocument {
    /// Devices that were begun.
    pub devices: usize,
    /// Fibers that were begun.
    pub fibers: usize,
    /// Share of these devices that passed, 0 to 1.
    #[serde(rename = "yield")]
    pub passed: f64,
    /// Machine time a fiber, from pick to verified.
    pub seconds_per_fiber: Percentiles,
    /// Of that, its alignment.
    #[serde(default)]
    pub align_seconds: Percentiles,
    /// Devices that were done an hour of machine time, be they good or not.
    pub devices_per_hour: f64,
    /// Share of the time in which a manipulator neither did anything nor held anything under the lamp, percent.
    pub idle_percent: Sides,
    /// Loss of the pigtails at their interface, decibels: the truth.
    pub loss_db_after_cure: Percentiles,
    /// How far cure and release have left fibers from their peaks, and how far the adhesive has shifted them in all,
    /// micrometres, medians; by the light.
    pub shift_um: Shift,
    /// Devices that were rejected, by cause.
    pub rejected: BTreeMap<String, usize>,
    /// Loss that the cure has added, decibels: the truth.
    pub added_loss_db: Percentiles,
    /// Fibers that passed and have in truth lost more than their recipe accepts.
    pub wrongly_passed: usize,
    /// Whether anything touched a chip: the truth.
    pub collision: bool,
    /// The least distance of anything from a chip, micrometres: the truth.
    #[serde(deserialize_with = "or_infinite")]
    pub smallest_gap_um: f64,
    /// The least distance between both holders, millimetres: the truth.
    #[serde(deserialize_with = "or_infinite")]
    pub smallest_apart_mm: f64,
    /// Share of the time in which a manipulator held something under the lamp, percent.
    pub held_percent: Sides,
    /// Machine time of it all, seconds.
    pub seconds: f64,
    /// How many times faster than real time it was simulated; not the same from run to run.
    pub times_real_time: f64,
    /// Why the machine stopped by itself; `null` where it did not.
    #[serde(deserialize_with = "kept_fault")]
    pub fault: Option<Fault>,
    /// What a person is called for; `null` where nobody is.
    pub called: Option<String>,
    /// The tray's file.
    pub tray: String,
    /// The seed.
    pub seed: u64,
    /// The fleet.
    pub fleet: String,
    /// Every device, with what is known of its fibers.
    pub produced: Vec<Told>,
}

/// What nothing came near to is infinitely far, which JSON has no number for.
fn or_infinite<'d, D: Deserializer<'d>>(kept: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(kept)?.unwrap_or(f64::INFINITY))
}

fn kept_fault<'d, D: Deserializer<'d>>(kept: D) -> Result<Option<Fault>, D::Error> {
    #[derive(Deserialize)]
    struct Kept {
        rule: String,
        axis: String,
        value: String,
        limit: String,
        time: f64,
    }
    let kept = Option::<Kept>::deserialize(kept)?;
    Ok(kept.map(|kept| Fault {
        rule: Rule::from_text(&kept.rule),
        axis: kept.axis,
        value: kept.value,
        limit: kept.limit,
        time: kept.time,
    }))
}

/// Percentiles of a quantity; not there where there is none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Percentiles {
    /// The median.
    pub p50: Option<f64>,
    /// What 99 % are below.
    pub p99: Option<f64>,
}

impl Percentiles {
    /// Of some values.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = values.len().checked_sub(1)?;
            Some(rounded(values[(share * last as f64).ceil() as usize], 1e-4))
        };
        Self {
            p50: at(0.5),
            p99: at(0.99),
        }
    }
}

/// A number for each manipulator.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sides {
    /// The left one.
    pub left: f64,
    /// The right one.
    pub right: f64,
}

/// See [`ProduceDocument::shift_um`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// With the light's peak followed; `null` where nobody did.
    pub tracked: Option<f64>,
    /// In all.
    pub untracked: Option<f64>,
}

/// A device, and the truth about its fibers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Told {
    /// What control says.
    #[serde(flatten)]
    pub produced: Produced,
    /// Where its fibers really are, in their order; nothing where one is not fixed.
    pub truth: Vec<Option<Offset>>,
}

/// Where a fiber really is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Offset {
    /// From its peak, x, y, and beyond the wanted gap, micrometres.
    pub offset_um: [f64; 3],
    /// Loss at the interface, decibels.
    pub loss_db: f64,
    /// What of it cure and release have added, from when the lamp was switched on, decibels.
    pub added_db: f64,
    /// What of that comes of where it is across; the rest is what the gap has done, by its length and its ripples.
    #[serde(default)]
    pub added_across_db: f64,
}

/// A twin whose truth is noted whenever a fiber is let go.
struct Noted {
    twin: Twin,
    notes: Rc<Notes>,
}

#[derive(Default)]
struct Notes {
    truth: RefCell<Option<Truth>>,
    /// The fibers when the lamp was switched on.
    before: RefCell<[Option<FiberTruth>; SIDES]>,
    ended: Cell<u64>,
}

impl Machine for Noted {
    fn spec(&self) -> &Spec {
        self.twin.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        for side in Side::ALL {
            if command.fiber[side.index()] == Some(pigtail_hal::FiberHandling::Lamp(true)) {
                self.notes.before.borrow_mut()[side.index()] = self.twin.held_truth(side);
            }
        }
        let measured = self.twin.exchange(command)?;
        if measured.handled.contains(&Some(Handled::Done)) {
            *self.notes.truth.borrow_mut() = Some(self.twin.truth());
            self.notes.ended.set(self.notes.ended.get() + 1);
        }
        Ok(measured)
    }

    fn stop(&mut self) {
        self.twin.stop();
    }

    fn clear(&mut self) -> Option<Fault> {
        self.twin.clear()
    }
}

/// The twin of a tray from a device on: machine and first device of a seed.
///
/// # Errors
///
/// When the plant makes no machine.
pub fn tray_twin(setup: &Setup, loaded: &Loaded, seed: u64, from: usize) -> Result<Twin, Error> {
    let named = Specimen::from(seed);
    let of = |k: usize| Specimen::of(named.machine(), named.device() + k as u64).seed();
    let lie = |k: usize, twin: &Twin| {
        let device = &loaded.tray.devices[k];
        let mut rng = Pcg64Mcg::seed_from_u64(of(k).wrapping_mul(16).wrapping_add(12));
        let fibers = device.fibers.iter().filter_map(|(port, place)| {
            let at = loaded.tray.places.get(place)?.at;
            let index = PORTS.iter().position(|p| p == port)?;
            let off = twin.placed();
            let mut by = || -> f64 {
                off * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng)
            };
            let at = at.map(|x| x + by());
            Some((side_of(port), index.saturating_sub(1), at))
        });
        fibers.collect::<Vec<_>>()
    };
    let first = setup.twin(of(from))?;
    let fibers = lie(from, &first);
    let waiting = (from + 1..loaded.tray.devices.len()).map(|k| {
        let twin = setup.twin(of(k))?;
        let fibers = lie(k, &twin);
        Ok(TrayDevice { twin, fibers })
    });
    let waiting = waiting.collect::<Result<Vec<_>, Error>>()?;
    Ok(first.with_tray(fibers, waiting))
}

/// What is told while a tray is produced.
#[derive(Debug, Clone, Copy)]
pub enum Heard<'h> {
    /// What control tells.
    Event(&'h Event<'h>),
    /// A device is over, with the truth about it.
    Device(&'h Told),
}

/// What came of a tray, and what each manipulator did.
pub struct Outcome {
    /// The document.
    pub document: ProduceDocument,
    /// What control says.
    pub run: Run,
}

/// Produces a tray on the twin that `seed` draws, from the first device that is not in `before`.
///
/// # Errors
///
/// When the plant makes no machine, or it cannot be recorded. A device that fails is no error.
pub fn produce(
    setup: &Setup,
    loaded: &Loaded,
    seed: u64,
    before: &[Told],
    observer: &mut dyn Observer,
    hear: &mut dyn FnMut(Heard),
) -> Result<Outcome, Ended> {
    let wall = Instant::now();
    let from = before.len();
    let setup = setup.at(seed)?;
    let notes = Rc::new(Notes::default());
    let mut told: Vec<Told> = before.to_vec();
    let (run, twin) = if from < loaded.tray.devices.len() {
        let mut noted = Noted {
            twin: tray_twin(&setup, loaded, seed, from)?,
            notes: Rc::clone(&notes),
        };
        let mut added: Vec<Option<Offset>> = Vec::new();
        let wanted = setup.rig.recipe.approach.gap;
        let mut tell = |event: &Event| {
            hear(Heard::Event(event));
            match event {
                Event::Fiber(pigtail) => added.push(offset(&notes, pigtail, wanted)),
                Event::Device(produced) => {
                    let device = Told {
                        produced: (*produced).clone(),
                        truth: std::mem::take(&mut added),
                    };
                    hear(Heard::Device(&device));
                    told.push(device);
                }
                _ => {}
            }
        };
        let taught: Vec<Pigtail> = before
            .iter()
            .flat_map(|told| told.produced.fibers.iter().cloned())
            .collect();
        let job = Produce {
            loaded,
            from,
            taught: &taught,
            tell: RefCell::new(&mut tell),
        };
        let run = setup.perform(&mut noted, &job, seed, observer)?;
        (run, Some(noted.twin))
    } else {
        (Run::default(), None)
    };
    let document = document(&setup, loaded, seed, &run, twin.as_ref(), told, wall);
    Ok(Outcome { document, run })
}

fn offset(notes: &Notes, pigtail: &Pigtail, wanted: f64) -> Option<Offset> {
    pigtail.cured?;
    let truth = (*notes.truth.borrow())?;
    let side = side_of(&pigtail.port);
    let index = PORTS.iter().position(|port| *port == pigtail.port)?;
    let fiber: FiberTruth = match side {
        Side::Left => truth.input?,
        Side::Right => truth.outputs[index.saturating_sub(1)]?,
    };
    let before = notes.before.borrow()[side.index()]?;
    Some(Offset {
        offset_um: [fiber.x, fiber.y, fiber.gap - wanted].map(|m| rounded(1e6 * m, 1e-6)),
        loss_db: rounded(-10.0 * fiber.coupling.log10(), 1e-6),
        added_db: rounded(10.0 * (before.coupling / fiber.coupling).log10(), 1e-6),
        added_across_db: rounded(fiber.across_db() - before.across_db(), 1e-6),
    })
}

/// What devices came to, whichever trays they were on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sums {
    pub(crate) devices: usize,
    pub(crate) fibers: usize,
    /// Devices that passed, and fibers.
    pub(crate) passed: usize,
    pub(crate) fibers_passed: usize,
    pub(crate) seconds_per_fiber: Percentiles,
    pub(crate) align_seconds: Percentiles,
    pub(crate) loss_db_after_cure: Percentiles,
    pub(crate) shift_um: Shift,
    pub(crate) rejected: BTreeMap<String, usize>,
    pub(crate) added_loss_db: Percentiles,
    pub(crate) wrongly_passed: usize,
}

impl Sums {
    pub(crate) fn of<'t>(told: impl IntoIterator<Item = &'t Told>, loaded: &Loaded) -> Self {
        let (mut devices, mut fibers, mut passed, mut fibers_passed) = (0, 0, 0, 0);
        let mut rejected = BTreeMap::new();
        let (mut seconds, mut loss, mut added) = (Vec::new(), Vec::new(), Vec::new());
        let mut aligning = Vec::new();
        let (mut tracked, mut untracked) = (Vec::new(), Vec::new());
        let mut wrongly_passed = 0;
        for device in told {
            devices += 1;
            let produced = &device.produced;
            if produced.rejected.is_empty() {
                passed += 1;
            } else {
                *rejected.entry(produced.rejected.clone()).or_insert(0) += 1;
            }
            let production = loaded
                .productions
                .values()
                .find(|p| p.name == produced.recipe);
            let accepted = production.map_or(f64::INFINITY, |p| p.verify.added_loss_db);
            for (fiber, truth) in produced.fibers.iter().zip(&device.truth) {
                fibers += 1;
                fibers_passed += usize::from(fiber.passed);
                seconds.push(fiber.seconds);
                aligning.push(fiber.align_seconds);
                loss.extend(truth.map(|truth| truth.loss_db));
                added.extend(truth.map(|truth| truth.added_db));
                if let Some(cured) = fiber.cured {
                    untracked.push(cured.shift_um);
                    tracked.extend(cured.before_um.map(|_| cured.off_um));
                }
                let wrong = truth.is_none_or(|truth| truth.added_db > accepted);
                wrongly_passed += usize::from(fiber.passed && wrong);
            }
        }
        Self {
            devices,
            fibers,
            passed,
            fibers_passed,
            seconds_per_fiber: Percentiles::of(seconds),
            align_seconds: Percentiles::of(aligning),
            loss_db_after_cure: Percentiles::of(loss),
            shift_um: Shift {
                tracked: Percentiles::of(tracked).p50,
                untracked: Percentiles::of(untracked).p50,
            },
            rejected,
            added_loss_db: Percentiles::of(added),
            wrongly_passed,
        }
    }

    /// Share of the devices that passed.
    pub(crate) fn share(&self) -> f64 {
        rounded(self.passed as f64 / self.devices.max(1) as f64, 1e-4)
    }
}

fn document(
    setup: &Setup,
    loaded: &Loaded,
    seed: u64,
    run: &Run,
    twin: Option<&Twin>,
    told: Vec<Told>,
    wall: Instant,
) -> ProduceDocument {
    let sums = Sums::of(&told, loaded);
    let share = |side: Side, held: bool| {
        let bars = run.bars.iter().filter(|bar| bar.side == side.name());
        let counted = bars.filter(|bar| bar.held == held && bar.what != "index");
        counted.map(|bar| bar.end - bar.start).sum::<f64>() / run.seconds.max(1e-9)
    };
    let percent = |share: f64| rounded(100.0 * share, 1e-2);
    let idle = |side: Side| percent((1.0 - share(side, true) - share(side, false)).max(0.0));
    let truth = twin.map(Twin::truth);
    let done = |device: &&Produced| device.rejected != "fault";
    let here = run.devices.iter().filter(done).count();
    ProduceDocument {
        devices: sums.devices,
        fibers: sums.fibers,
        passed: sums.share(),
        seconds_per_fiber: sums.seconds_per_fiber,
        align_seconds: sums.align_seconds,
        devices_per_hour: rounded(3600.0 * here as f64 / run.seconds.max(1e-9), 1e-2),
        idle_percent: Sides {
            left: idle(Side::Left),
            right: idle(Side::Right),
        },
        loss_db_after_cure: sums.loss_db_after_cure,
        shift_um: sums.shift_um,
        rejected: sums.rejected,
        added_loss_db: sums.added_loss_db,
        wrongly_passed: sums.wrongly_passed,
        collision: truth.is_some_and(|truth| truth.smallest_gap <= 0.0),
        smallest_gap_um: truth.map_or(0.0, |truth| rounded(1e6 * truth.smallest_gap, 1e-6)),
        smallest_apart_mm: twin
            .and_then(Twin::smallest_apart)
            .map_or(0.0, |apart| rounded(1e3 * apart, 1e-6)),
        held_percent: Sides {
            left: percent(share(Side::Left, true)),
            right: percent(share(Side::Right, true)),
        },
        seconds: rounded(run.seconds, 1e-4),
        times_real_time: (run.seconds / wall.elapsed().as_secs_f64()).round(),
        fault: run.fault.clone(),
        called: run.called.clone(),
        tray: loaded.file.clone(),
        seed,
        fleet: setup.fleet_name().to_owned(),
        produced: told,
    }
}
