//! Work beside Python: the interpreter goes on meanwhile, hears of progress, and Ctrl-C stops the machine.

use crate::failure::Failure;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// How often Python is asked for Ctrl-C and told of progress.
const TICK: Duration = Duration::from_millis(50);

#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct State {
    done: u64,
    total: u64,
    text: String,
}

/// What work and whoever waits for it have in common.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// Whether the work is to stop: the stop button of the machine that it works on.
    pub(crate) stop: Arc<AtomicBool>,
    state: Mutex<State>,
}

impl Watch {
    /// Tells how far the work is; `total` is zero where nobody knows.
    pub(crate) fn tell(&self, done: u64, total: u64, text: impl Into<String>) {
        let text = text.into();
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = State { done, total, text };
    }

    /// Tells that one more is done.
    pub(crate) fn one_more(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.done += 1;
    }

    fn state(&self) -> State {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.clone()
    }
}

/// The process that imported this.
static IMPORTED_BY: OnceLock<u32> = OnceLock::new();

/// Notes which process this is.
pub(crate) fn imported() {
    IMPORTED_BY.get_or_init(std::process::id);
}

/// Works on all cores. Threads do not come along into a process that is forked, and what waits for them there waits for
/// ever: such a process has threads of its own.
pub(crate) fn on_all_cores<T: Send>(job: impl FnOnce() -> T + Send) -> T {
    static OWN: Mutex<Option<(u32, &'static ThreadPool)>> = Mutex::new(None);
    let process = std::process::id();
    if IMPORTED_BY.get() == Some(&process) {
        return job();
    }
    let mut own = OWN.lock().unwrap_or_else(PoisonError::into_inner);
    let pool = match *own {
        Some((of, pool)) if of == process => Some(pool),
        _ => {
            let made = ThreadPoolBuilder::new().build().ok();
            // As long as the process: to end one whose threads are elsewhere is to wait for them too.
            let made = made.map(|pool| &*Box::leak(Box::new(pool)));
            *own = made.map(|pool| (process, pool));
            made
        }
    };
    drop(own);
    match pool {
        Some(pool) => pool.install(job),
        None => job(),
    }
}

/// Does work on a thread of its own, without the interpreter's lock. An exception of the interpreter, be it
/// Ctrl-C's, or one of `progress`, stops the work, and is raised when that has ended.
pub(crate) fn work<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(&Watch) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let watch = Watch::default();
    let (sender, ended) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        let watch = &watch;
        let worker = scope.spawn(move || {
            // Dropped when the work is over, however it ended.
            let _sender = sender;
            catch_unwind(AssertUnwindSafe(|| on_all_cores(|| job(watch))))
        });
        let mut raised = None;
        let mut told = State::default();
        let mut ended = ended;
        loop {
            let (back, over) = py.detach(move || {
                let over = ended.recv_timeout(TICK) == Err(RecvTimeoutError::Disconnected);
                (ended, over)
            });
            ended = back;
            if over {
                break;
            }
            if raised.is_some() {
                continue;
            }
            let state = watch.state();
            let heard = py.check_signals().and_then(|()| match progress {
                Some(progress) if state != told => {
                    progress.call1((state.done, state.total, state.text.clone()))?;
                    told = state;
                    Ok(())
                }
                _ => Ok(()),
            });
            if let Err(error) = heard {
                watch.stop.store(true, Ordering::Relaxed);
                raised = Some(error);
            }
        }
        let result = worker.join();
        match (raised, result) {
            (Some(error), _) => Err(error),
            (None, Ok(Ok(Ok(value)))) => Ok(value),
            (None, Ok(Ok(Err(failure)))) => Err(failure.raise(py)),
            (None, Ok(Err(panic)) | Err(panic)) => Err(Failure::panic(&*panic).raise(py)),
        }
    })
}
