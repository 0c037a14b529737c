//! A bench that Python implements, for our control.

use crate::wire::{CapsWire, EventWire, PoseWire, law_wire, request_wire};
use pigtail_hal::bench::{
    Bench, Caps, Estimate, Event, Group, Law, Pose, Refused, Request, Ticket,
};
use pigtail_hal::{Fault, Rule};
use pyo3::intern;
use pyo3::prelude::*;
use std::cell::{Cell, RefCell};

/// A bench that Python implements, behind the class there that checks what it says.
///
/// The first exception is kept, and nothing but `stop` is asked of Python after it: it is raised, as it is, when control has
/// ended.
pub(crate) struct OwnBench {
    bench: Py<PyAny>,
    caps: Caps,
    /// When it was heard of last, seconds.
    now: Cell<f64>,
    raised: RefCell<Option<PyErr>>,
    stopped: bool,
}

impl OwnBench {
    pub(crate) fn new(bench: Bound<'_, PyAny>) -> PyResult<Self> {
        let caps: CapsWire = bench.call_method0("caps")?.extract()?;
        let now = bench.call_method0("now")?.extract()?;
        Ok(Self {
            bench: bench.unbind(),
            caps: caps.caps(),
            now: Cell::new(now),
            raised: RefCell::new(None),
            stopped: false,
        })
    }

    /// What Python raised.
    pub(crate) fn raised(&self) -> Option<PyErr> {
        self.raised.borrow_mut().take()
    }

    /// Calls Python, unless it has raised something already.
    fn call<T>(
        &self,
        call: impl FnOnce(Python<'_>, &Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Option<T> {
        if self.raised.borrow().is_some() {
            return None;
        }
        Python::attach(|py| {
            let heard = py
                .check_signals()
                .and_then(|()| call(py, self.bench.bind(py)));
            heard
                .map_err(|error| *self.raised.borrow_mut() = Some(error))
                .ok()
        })
    }

    fn gone(&self) -> Refused {
        Refused::State(format!("{} has raised an exception", self.caps.name))
    }

    /// What was refused by word, or what it gave.
    fn said<T>(&self, said: Option<Result<T, Refused>>) -> Result<T, Refused> {
        said.ok_or_else(|| self.gone())?
    }
}

/// What a method that may refuse has said: its value, or why not.
fn or_refused<'py, T: FromPyObjectOwned<'py>>(
    said: &Bound<'py, PyAny>,
) -> PyResult<Result<T, Refused>> {
    let (value, refused): (Bound<'py, PyAny>, Option<(String, Option<u64>)>) = said.extract()?;
    Ok(match refused {
        Some((_, Some(ticket))) => Err(Refused::Ticket(ticket)),
        Some((why, None)) => Err(Refused::State(why)),
        None => Ok(value.extract().map_err(Into::into)?),
    })
}

/// A fault in words: code, rule, axis, value, limit, time.
type FaultWire = (String, String, String, String, String, f64);

fn fault((code, rule, axis, value, limit, time): FaultWire) -> Fault {
    let known = Rule::ALL.iter().find(|rule| rule.code() == code);
    Fault {
        rule: known.cloned().unwrap_or(Rule::Other(rule)),
        axis,
        value,
        limit,
        time,
    }
}

impl Bench for OwnBench {
    fn caps(&self) -> &Caps {
        &self.caps
    }

    fn now(&self) -> f64 {
        let now = self.call(|py, bench| bench.call_method0(intern!(py, "now"))?.extract());
        if let Some(now) = now {
            self.now.set(now);
        }
        self.now.get()
    }

    fn play(&mut self, Group(group): Group, law: Law) -> Result<Ticket, Refused> {
        let said = self.call(|py, bench| {
            let law = law_wire(py, &law)?;
            or_refused(&bench.call_method1(intern!(py, "play"), (group, law))?)
        });
        self.said(said).map(Ticket)
    }

    fn bend(&mut self, Ticket(ticket): Ticket, law: Law) -> Result<f64, Refused> {
        let said = self.call(|py, bench| {
            let law = law_wire(py, &law)?;
            or_refused(&bench.call_method1(intern!(py, "bend"), (ticket, law))?)
        });
        self.said(said)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        let said = self.call(|py, bench| {
            let what = request_wire(what);
            or_refused(&bench.call_method1(intern!(py, "request"), (what,))?)
        });
        self.said(said).map(Ticket)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        let heard = self.call(|py, bench| {
            let said = bench.call_method1(intern!(py, "next"), (by,))?;
            let (event, stopped): (Option<EventWire>, Option<FaultWire>) = said.extract()?;
            match (event, stopped) {
                (Some(event), _) => event.event().map(Ok),
                (None, Some(stopped)) => Ok(Err(fault(stopped))),
                (None, None) => Ok(Ok(Event::Time)),
            }
        });
        heard.unwrap_or_else(|| {
            Err(Fault {
                rule: Rule::Other("bench answers".to_owned()),
                axis: self.caps.name.clone(),
                value: "it has raised an exception".to_owned(),
                limit: "none".to_owned(),
                time: self.now.get(),
            })
        })
    }

    fn pose(&self, Group(group): Group, at: f64) -> Option<Estimate> {
        let known = self.call(|py, bench| {
            let said = bench.call_method1(intern!(py, "pose"), (group, at))?;
            said.extract::<Option<(PoseWire, bool)>>()
        });
        known.flatten().map(|(pose, measured)| Estimate {
            pose: Pose(pose),
            measured,
        })
    }

    fn reaches(&self, Group(group): Group, pose: &Pose) -> bool {
        let said = self.call(|py, bench| {
            let said = bench.call_method1(intern!(py, "reaches"), (group, pose.0))?;
            said.extract()
        });
        said.unwrap_or(false)
    }

    fn stop(&mut self) {
        // Once is enough where it has raised something: it holds.
        if self.stopped && self.raised.borrow().is_some() {
            return;
        }
        self.stopped = true;
        Python::attach(|py| {
            let stopped = self.bench.bind(py).call_method0(intern!(py, "stop"));
            if let Err(error) = stopped {
                self.raised.borrow_mut().get_or_insert(error);
            }
        });
    }
}
