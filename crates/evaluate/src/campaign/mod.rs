//! Many devices aligned, each on its own plant: what a procedure is worth.
//!
//! Device `i` of a campaign with seed `s` is the one that `pigtail align --seed <s + i>` aligns, on a machine
//! of its own; where machines align several, [`Plan::seed_of`] tells which. Every row can be replayed and
//! looked at. Rows come in the order of devices and do not depend
//! on how many threads worked on them.

mod commissioned;
mod plan;
mod rows;
pub mod shard;
mod store;
mod summary;
mod sureness;

use crate::align::{self, align};
use crate::bench;
use anyhow::Result;
pub use commissioned::{Commissioned, Commissioning};
use pigtail_control::station::Unobserved;
use pigtail_hal::Error;
use pigtail_session::bench::BenchSetup;
use pigtail_session::job::Ended;
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
pub use plan::Plan;
pub use rows::{ROWS_PER_DEVICE, columns, push};
use std::collections::BTreeMap;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};
pub use store::Store;
pub use summary::{CampaignDocument, Cause, summarize};
pub use sureness::{Known, SHARES, Shares, Sureness, reliability};

/// Devices whose rows are kept together...
const PART: u64 = 256;
/// ...unless it took longer than anyone wants to lose when a campaign is killed.
const PART_SECONDS: Duration = Duration::from_secs(10);

/// How one device of a campaign ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Device {
    /// Its seed.
    pub seed: u64,
    /// What aligning it gave.
    pub document: align::AlignmentDocument,
}

fn device(setup: &Setup, procedure: Procedure, seed: u64) -> Result<Device, Ended> {
    // A panic is a mistake of the program, which a campaign is there to find: it is counted, and
    // costs no other device.
    let document = catch_unwind(AssertUnwindSafe(|| {
        align(setup, procedure, seed, &mut Unobserved)
    }))
    .unwrap_or_else(|panic| Ok(align::panicked(setup, procedure, seed, &*panic)))?;
    Ok(Device { seed, document })
}

/// Without the device of a worker that panicked, those after it could only pile up.
struct StopOnPanic<'a>(&'a AtomicBool);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// Whether a campaign's first device can be built, before anything is written.
///
/// # Errors
///
/// When the plant makes no machine.
pub fn check(setup: &Setup, seed: u64) -> Result<(), Error> {
    setup.twin(seed).map(|_| ())
}

/// Runs the devices of a campaign that are not done yet, on so many threads, until all are or
/// `stop` is set; devices that were begun by then are finished. `watch` sees each device in order.
///
/// # Errors
///
/// When a device's plant cannot be built or rows cannot be written. Rows of the devices before it
/// are kept.
pub fn run(
    store: &mut Store,
    setup: &Setup,
    threads: usize,
    stop: &AtomicBool,
    watch: impl FnMut(&Device),
) -> Result<()> {
    run_by(
        store,
        &|procedure, seed| device(setup, procedure, seed),
        threads,
        stop,
        watch,
    )
}

/// The same on benches that are controlled by position.
///
/// # Errors
///
/// As [`run`].
pub fn run_benches(
    store: &mut Store,
    setup: &BenchSetup,
    threads: usize,
    stop: &AtomicBool,
    watch: impl FnMut(&Device),
) -> Result<()> {
    let device = |_, seed| Ok(bench::device(setup, seed)?);
    run_by(store, &device, threads, stop, watch)
}

/// The same on machines that were commissioned.
///
/// # Errors
///
/// As [`run`].
pub fn run_commissioned(
    store: &mut Store,
    machines: &Commissioned,
    threads: usize,
    stop: &AtomicBool,
    watch: impl FnMut(&Device),
) -> Result<()> {
    let device = |procedure, seed| machines.device(procedure, seed);
    run_by(store, &device, threads, stop, watch)
}

fn run_by(
    store: &mut Store,
    device: &(impl Fn(Procedure, u64) -> Result<Device, Ended> + Sync),
    threads: usize,
    stop: &AtomicBool,
    mut watch: impl FnMut(&Device),
) -> Result<()> {
    let plan = store.plan().clone();
    let procedure = store.procedure();
    let mut table = store.table();
    let mut since = Instant::now();
    let left = store.done()..plan.devices;
    let one = |seed| device(procedure, seed);
    let ended = each(&plan, left, &one, threads, stop, |device| {
        watch(&device);
        rows::push(&mut table, procedure, &device);
        if rows::devices(&table) >= PART || since.elapsed() >= PART_SECONDS {
            store.append(&table)?;
            table = store.table();
            since = Instant::now();
        }
        Ok(())
    });
    // What is done is kept, however it ended.
    store.append(&table)?;
    ended
}

/// Does the devices of a range on so many threads and hands them on in order, until all are done or `stop` is set;
/// those that were begun by then are finished.
fn each(
    plan: &Plan,
    range: Range<u64>,
    device: &(impl Fn(u64) -> Result<Device, Ended> + Sync),
    threads: usize,
    stop: &AtomicBool,
    mut sink: impl FnMut(Device) -> Result<()>,
) -> Result<()> {
    let next = AtomicU64::new(range.start);
    // A device that was taken is finished, and they are taken in order: what is done has no gaps.
    let work = |results: mpsc::SyncSender<_>| {
        let _guard = StopOnPanic(stop);
        while !stop.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= range.end {
                break;
            }
            let result = device(plan.seed_of(index));
            if results.send((index, result)).is_err() {
                break;
            }
        }
    };
    std::thread::scope(|scope| {
        let (sender, results) = mpsc::sync_channel(2 * threads);
        for _ in 0..threads {
            let sender = sender.clone();
            scope.spawn(move || work(sender));
        }
        drop(sender);
        // Dropped with this block on an error, so that nobody waits to be heard.
        let results = results;
        let mut early = BTreeMap::new();
        let mut due = range.start;
        for (index, result) in &results {
            early.insert(index, result);
            while let Some(result) = early.remove(&due) {
                let named = || format!("device {due}, seed {}", plan.seed_of(due));
                let device = result.map_err(|error| anyhow::Error::new(error).context(named()))?;
                sink(device)?;
                due += 1;
            }
        }
        Ok(())
    })
}
