//! What crosses between a bench in Rust and one in Python: numbers and tuples. The classes that people see are in
//! `python/pigtail/bench.py`.

use pigtail_hal::bench::{
    AxisCaps, Caps, ChannelCaps, DEGREES, Dither, Event, Glide, Group, GroupCaps, Knot, Law, Lead,
    Light, Limits, Pose, Refused, Request, Stage, Ticket, Widens,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// Metres, and radians.
pub(crate) type PoseWire = [f64; DEGREES];

/// Middle, within, radius, within, rate, who leads, how it widens.
type DitherWire = (
    [f64; 2],
    f64,
    f64,
    f64,
    f64,
    Option<(usize, PoseWire, [[f64; 3]; 2])>,
    Option<(f64, f64)>,
);

/// A law from its name and its numbers.
pub(crate) fn law(law: &Bound<'_, PyAny>) -> PyResult<Law> {
    let (name, of) = law.extract::<(String, Bound<'_, PyAny>)>()?;
    Ok(match name.as_str() {
        "line" => {
            let (to, speed): (PoseWire, Option<f64>) = of.extract()?;
            Law::Line {
                to: Pose(to),
                limits: Limits { speed },
            }
        }
        "scan" => {
            let knots: Vec<(f64, PoseWire)> = of.extract()?;
            let knot = |(time, at)| Knot { time, at: Pose(at) };
            Law::Scan(knots.into_iter().map(knot).collect())
        }
        "dither" => {
            let (centre, centre_within, radius, radius_within, rate, lead, widens): DitherWire =
                of.extract()?;
            Law::Dither(Dither {
                centre: Glide {
                    to: centre,
                    within: centre_within,
                },
                radius: Glide {
                    to: radius,
                    within: radius_within,
                },
                rate,
                lead: lead.map(|(group, from, gain)| Lead {
                    group: Group(group),
                    from: Pose(from),
                    gain,
                }),
                widens: widens.map(|(contact, doubles)| Widens { contact, doubles }),
            })
        }
        "brake" => Law::Brake,
        other => return Err(PyTypeError::new_err(format!("a law named {other}"))),
    })
}

/// The same the other way.
pub(crate) fn law_wire<'py>(py: Python<'py>, law: &Law) -> PyResult<Bound<'py, PyAny>> {
    let of = match law {
        Law::Line { to, limits } => (to.0, limits.speed).into_pyobject(py)?.into_any(),
        Law::Scan(knots) => {
            let knots: Vec<_> = knots.iter().map(|knot| (knot.time, knot.at.0)).collect();
            knots.into_pyobject(py)?
        }
        Law::Dither(dither) => {
            let lead = dither.lead;
            let wire: DitherWire = (
                dither.centre.to,
                dither.centre.within,
                dither.radius.to,
                dither.radius.within,
                dither.rate,
                lead.map(|lead| (lead.group.0, lead.from.0, lead.gain)),
                dither.widens.map(|widens| (widens.contact, widens.doubles)),
            );
            wire.into_pyobject(py)?.into_any()
        }
        Law::Brake => py.None().into_bound(py),
    };
    Ok((law.name(), of).into_pyobject(py)?.into_any())
}

/// A request from its name, its arm and its port; a laser's arm is whether it is on.
pub(crate) fn request((name, arm, port): &(String, usize, usize)) -> PyResult<Request> {
    let (arm, port) = (*arm, *port);
    Ok(match name.as_str() {
        "laser" => Request::Laser(arm != 0),
        "laser_power" => Request::LaserPower {
            percent: u8::try_from(arm).unwrap_or(u8::MAX),
        },
        "load" => Request::Load { arm, port },
        "attach" => Request::Attach { arm },
        "unload" => Request::Unload { arm },
        other => return Err(PyTypeError::new_err(format!("a request named {other}"))),
    })
}

/// The same the other way.
pub(crate) fn request_wire(request: Request) -> (&'static str, usize, usize) {
    match request {
        Request::Laser(on) => ("laser", usize::from(on), 0),
        Request::LaserPower { percent } => ("laser_power", usize::from(percent), 0),
        Request::Load { arm, port } => ("load", arm, port),
        Request::Attach { arm } => ("attach", arm, 0),
        Request::Unload { arm } => ("unload", arm, 0),
        // Nothing in Python asks for steps of the production cycle.
        Request::Handle { arm, .. } => ("handle", arm, 0),
    }
}

/// When, and volts.
type LightWire = (f64, Vec<f64>);

/// An event: its name; light; a ticket; why.
#[derive(IntoPyObject, FromPyObject)]
pub(crate) struct EventWire(String, Vec<LightWire>, u64, String);

impl EventWire {
    pub(crate) fn of(event: Event) -> Self {
        let wire = |light: Light| (light.time, light.volts);
        let nothing = String::new;
        match event {
            Event::Light(light) => Self("light".to_owned(), vec![wire(light)], 0, nothing()),
            Event::Batch(lights) => Self(
                "batch".to_owned(),
                lights.into_iter().map(wire).collect(),
                0,
                nothing(),
            ),
            Event::Played(ticket) => Self("played".to_owned(), Vec::new(), ticket.0, nothing()),
            // No bench that Python is handed has a camera.
            Event::Frame(_) => Self("frame".to_owned(), Vec::new(), 0, nothing()),
            Event::Done(ticket) => Self("done".to_owned(), Vec::new(), ticket.0, nothing()),
            Event::Failed(ticket, why) => Self("failed".to_owned(), Vec::new(), ticket.0, why),
            Event::Time => Self("time".to_owned(), Vec::new(), 0, nothing()),
        }
    }

    pub(crate) fn event(self) -> PyResult<Event> {
        let Self(name, lights, ticket, why) = self;
        let mut lights = lights
            .into_iter()
            .map(|(time, volts)| Light { time, volts });
        Ok(match (name.as_str(), lights.next()) {
            ("light", Some(light)) => Event::Light(light),
            ("batch", first) => Event::Batch(first.into_iter().chain(lights).collect()),
            ("played", _) => Event::Played(Ticket(ticket)),
            ("done", _) => Event::Done(Ticket(ticket)),
            ("failed", _) => Event::Failed(Ticket(ticket), why),
            ("time", _) => Event::Time,
            _ => return Err(PyTypeError::new_err(format!("an event named {name}"))),
        })
    }
}

/// Low, high, resolution, repeatability, backlash, speed.
type AxisWire = (f64, f64, f64, f64, f64, f64);

/// Name, arm, whether it is fine, axes, settling, bandwidth, lag and its deviation, whether it bends.
type GroupWire = (
    String,
    usize,
    bool,
    [Option<AxisWire>; DEGREES],
    f64,
    f64,
    (f64, f64),
    bool,
);

/// Name, arms, groups, channels (name, rate, resolution, full scale), bond, cycle.
#[derive(IntoPyObject, FromPyObject)]
pub(crate) struct CapsWire(
    String,
    Vec<String>,
    Vec<GroupWire>,
    Vec<(String, f64, f64, f64)>,
    f64,
    f64,
);

impl CapsWire {
    pub(crate) fn of(caps: &Caps) -> Self {
        let axis = |axis: AxisCaps| {
            let (low, high) = axis.range;
            let AxisCaps {
                resolution,
                repeatability,
                backlash,
                speed,
                ..
            } = axis;
            (low, high, resolution, repeatability, backlash, speed)
        };
        let group = |group: &GroupCaps| {
            (
                group.name.clone(),
                group.arm,
                group.stage == Stage::Fine,
                group.axes.map(|of| of.map(axis)),
                group.settling,
                group.bandwidth,
                group.lag,
                group.bends,
            )
        };
        let channel = |of: &ChannelCaps| (of.name.clone(), of.rate, of.resolution, of.full_scale);
        Self(
            caps.name.clone(),
            caps.arms.clone(),
            caps.groups.iter().map(group).collect(),
            caps.channels.iter().map(channel).collect(),
            caps.bond,
            caps.cycle,
        )
    }

    pub(crate) fn caps(self) -> Caps {
        let axis = |(low, high, resolution, repeatability, backlash, speed)| AxisCaps {
            range: (low, high),
            resolution,
            repeatability,
            backlash,
            speed,
        };
        let group =
            |(name, arm, fine, axes, settling, bandwidth, lag, bends): GroupWire| GroupCaps {
                name,
                arm,
                stage: if fine { Stage::Fine } else { Stage::Coarse },
                axes: axes.map(|of| of.map(axis)),
                settling,
                bandwidth,
                lag,
                bends,
            };
        let channel = |(name, rate, resolution, full_scale)| ChannelCaps {
            name,
            rate,
            resolution,
            full_scale,
        };
        let Self(name, arms, groups, channels, bond, cycle) = self;
        Caps {
            name,
            arms,
            groups: groups.into_iter().map(group).collect(),
            channels: channels.into_iter().map(channel).collect(),
            // A bench in Python says nothing of its laser's power.
            least_power: 100,
            bond,
            cycle,
        }
    }
}

/// The exception for what a bench refuses.
pub(crate) fn raised(py: Python<'_>, why: &Refused) -> PyErr {
    let raise = || -> PyResult<PyErr> {
        let errors = py.import("pigtail._errors")?;
        let error = match why {
            Refused::Ticket(ticket) => errors.getattr("TicketOver")?.call1((*ticket,)),
            why => errors.getattr("Refused")?.call1((why.to_string(),)),
        };
        Ok(PyErr::from_value(error?))
    };
    raise().unwrap_or_else(|error| error)
}
