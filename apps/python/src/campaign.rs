//! Campaigns: all of one, one shard, and shards made into one.

use crate::align::broken;
use crate::failure::Failure;
use crate::input::{choice, refused};
use crate::rig::Rig;
use crate::work::{Watch, work};
use pigtail_evaluate::campaign::shard::{self, Shard};
use pigtail_evaluate::campaign::{self, CampaignDocument, Commissioned, Plan, Store, summarize};
use pigtail_report as report;
use pigtail_session::calibrations::{On, RunsOn};
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a campaign is to do, and on what.
#[pyclass(frozen, module = "pigtail._pigtail")]
pub(crate) struct Spec {
    setup: Setup,
    plan: Plan,
}

#[pymethods]
impl Spec {
    #[new]
    #[pyo3(signature = (rig, procedure, seed, devices, machines, commissioned, faults))]
    fn new(
        py: Python<'_>,
        rig: &Rig,
        procedure: &str,
        seed: u64,
        devices: u64,
        machines: Option<u64>,
        commissioned: bool,
        faults: Option<&str>,
    ) -> PyResult<Self> {
        let plan = || -> Result<Self, Failure> {
            let procedure: Procedure = choice("procedure", procedure)?;
            let mut setup = rig.setup()?;
            setup.faults = broken(faults, &[])?;
            for (key, value) in [("devices", Some(devices)), ("machines", machines)] {
                if value == Some(0) {
                    return Err(
                        refused(key, 0, "is 0; accepted is a whole number above zero").into(),
                    );
                }
            }
            let (all, each) = match machines {
                Some(machines) => (machines.saturating_mul(devices), devices),
                None => (devices, 1),
            };
            if seed.checked_add(all).is_none() {
                let message = format!("is {seed}, and with {all} devices seeds would run out");
                return Err(refused("seed", seed, message).into());
            }
            campaign::check(&setup, seed)?;
            let plan = Plan::new(&setup, procedure, seed, all)
                .with_devices_each(each)
                .with_commissioned(commissioned);
            Ok(Self { setup, plan })
        };
        plan().map_err(|failure| failure.raise(py))
    }

    /// The folder for its shards, made if it is not there.
    fn folder(&self, py: Python<'_>, runs: PathBuf) -> PyResult<PathBuf> {
        shard::folder(&runs, &self.plan, &self.setup)
            .map_err(|error| Failure::from(error).raise(py))
    }

    /// Runs all of it here.
    #[pyo3(signature = (runs, threads, progress))]
    fn run(
        &self,
        py: Python<'_>,
        runs: PathBuf,
        threads: usize,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(String, String)> {
        work(py, progress, |watch| {
            let store = Store::begin(&runs, self.plan.clone())?;
            finished(store, &self.setup, &runs, threads, watch)
        })
    }
}

/// Goes on with a campaign.
#[pyfunction]
#[pyo3(signature = (folder, threads, progress))]
pub(crate) fn campaign_resume(
    py: Python<'_>,
    folder: PathBuf,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, String)> {
    work(py, progress, |watch| {
        let plan = Plan::read(&folder)?;
        let setup = plan.setup(None)?;
        let store = Store::resume(&folder, &plan)?;
        let runs = folder.parent().unwrap_or(Path::new(".")).to_owned();
        finished(store, &setup, &runs, threads, watch)
    })
}

/// Runs one shard of the campaign of a folder: its file, and how many devices were done just now.
#[pyfunction]
#[pyo3(signature = (folder, index, of, threads, progress))]
pub(crate) fn campaign_shard(
    py: Python<'_>,
    folder: PathBuf,
    index: u64,
    of: u64,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Option<PathBuf>, u64)> {
    work(py, progress, |watch| {
        let shard =
            Shard::new(index, of).map_err(|why| refused("shard", format!("{index}/{of}"), why))?;
        let (plan, setup) = shard::setup(&folder)?;
        let runs = folder.parent().unwrap_or(Path::new("."));
        let machines = commissioned(
            &setup,
            &shard.machine_seeds(&plan),
            &plan,
            runs,
            threads,
            watch,
        )?;
        let range = shard.devices(&plan);
        watch.tell(0, range.end - range.start, "devices");
        let seen = |_: &_| watch.one_more();
        let ran = shard::run(
            &folder,
            shard,
            &setup,
            machines.as_ref(),
            threads,
            &watch.stop,
            seen,
        )?;
        Ok((ran.file, ran.done))
    })
}

/// Makes one campaign of all shards of a folder.
#[pyfunction]
#[pyo3(signature = (folder, runs, progress))]
pub(crate) fn campaign_merge(
    py: Python<'_>,
    folder: PathBuf,
    runs: PathBuf,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, String)> {
    work(py, progress, |watch| {
        let (store, setup) = shard::merge(&folder, &runs)?;
        finished(store, &setup, &runs, 1, watch)
    })
}

fn commissioned(
    setup: &Setup,
    seeds: &[u64],
    plan: &Plan,
    runs: &Path,
    threads: usize,
    watch: &Watch,
) -> Result<Option<Commissioned>, Failure> {
    if !plan.commissioned {
        return Ok(None);
    }
    watch.tell(0, seeds.len() as u64, "machines commissioned");
    let done = Commissioned::of(setup, seeds, runs, threads, &watch.stop, |_, _| {
        watch.one_more();
    });
    Ok(Some(done?))
}

/// Does what is left of a campaign, sums it up, and writes its report.
fn finished(
    mut store: Store,
    setup: &Setup,
    runs: &Path,
    threads: usize,
    watch: &Watch,
) -> Result<(String, String), Failure> {
    let started = Instant::now();
    let (plan, before) = (store.plan().clone(), store.done());
    if before < plan.devices {
        let machines = commissioned(setup, &plan.machine_seeds(), &plan, runs, threads, watch)?;
        watch.tell(before, plan.devices, "devices");
        let seen = |_: &_| watch.one_more();
        match &machines {
            None => campaign::run(&mut store, setup, threads, &watch.stop, seen)?,
            Some(on) => campaign::run_commissioned(&mut store, on, threads, &watch.stop, seen)?,
        }
    }
    watch.tell(store.done(), plan.devices, "rows are collected");
    store.collect()?;
    let document: CampaignDocument = summarize(&store, started.elapsed().as_secs_f64())?;
    let on = On::new(&setup.rig, &document);
    if !store.was_whole() {
        store.finish(&document, &on, &report::campaign(&store, &document)?)?;
    }
    let json = serde_json::to_string(&on).map_err(anyhow::Error::from)?;
    let words = report::text::campaign(&document, store.done() - before, None)
        + &format!("Ran on {}\n", RunsOn::of(&setup.rig));
    Ok((json, words))
}
