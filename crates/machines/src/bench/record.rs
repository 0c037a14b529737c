//! The record of what was asked of a bench and what it answered, and a bench that answers from it.
//!
//! A line of JSON for each exchange; numbers are read back to the last bit.

use pigtail_hal::bench::{
    Bench, Caps, Estimate, Event, Frame, Group, Law, Light, Pose, Refused, Request, Ticket,
};
use pigtail_hal::{Fault, Rule};
use serde::{Deserialize, Serialize};
use std::cell::{Cell, RefCell};
use std::io::{BufRead, Write};

/// What a call was answered, or why it was refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Answer<T> {
    #[serde(rename = "is")]
    Is(T),
    #[serde(rename = "refused")]
    Refused(String),
}

impl<T: Clone> Answer<T> {
    fn of(result: &Result<T, Refused>) -> Self {
        match result {
            Ok(answer) => Self::Is(answer.clone()),
            Err(refused) => Self::Refused(refused.to_string()),
        }
    }

    fn result(self) -> Result<T, Refused> {
        match self {
            Self::Is(answer) => Ok(answer),
            Self::Refused(why) => Err(Refused::State(why)),
        }
    }
}

/// Light as JSON can have it: `None` where a meter has no sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Sample {
    time: f64,
    volts: Vec<Option<f64>>,
}

impl Sample {
    fn of(light: &Light) -> Self {
        let some = |volts: &f64| Some(*volts).filter(|volts| !volts.is_nan());
        Self {
            time: light.time,
            volts: light.volts.iter().map(some).collect(),
        }
    }

    fn light(self) -> Light {
        let volts = self.volts.into_iter();
        Light {
            time: self.time,
            volts: volts.map(|volts| volts.unwrap_or(f64::NAN)).collect(),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Heard {
    Light(Sample),
    Batch(Vec<Sample>),
    Frame(Frame),
    Played(Ticket),
    Done(Ticket),
    Failed(Ticket, String),
    Time,
    Fault {
        rule: String,
        axis: String,
        value: String,
        limit: String,
        time: f64,
    },
}

impl Heard {
    fn of(result: &Result<Event, Fault>) -> Self {
        match result {
            Ok(Event::Light(light)) => Self::Light(Sample::of(light)),
            Ok(Event::Batch(batch)) => Self::Batch(batch.iter().map(Sample::of).collect()),
            Ok(Event::Frame(frame)) => Self::Frame(frame.clone()),
            Ok(Event::Played(ticket)) => Self::Played(*ticket),
            Ok(Event::Done(ticket)) => Self::Done(*ticket),
            Ok(Event::Failed(ticket, why)) => Self::Failed(*ticket, why.clone()),
            Ok(Event::Time) => Self::Time,
            Err(fault) => Self::Fault {
                rule: fault.rule.text().to_owned(),
                axis: fault.axis.clone(),
                value: fault.value.clone(),
                limit: fault.limit.clone(),
                time: fault.time,
            },
        }
    }

    fn result(self) -> Result<Event, Fault> {
        Ok(match self {
            Self::Light(sample) => Event::Light(sample.light()),
            Self::Batch(batch) => Event::Batch(batch.into_iter().map(Sample::light).collect()),
            Self::Frame(frame) => Event::Frame(frame),
            Self::Played(ticket) => Event::Played(ticket),
            Self::Done(ticket) => Event::Done(ticket),
            Self::Failed(ticket, why) => Event::Failed(ticket, why),
            Self::Time => Event::Time,
            Self::Fault {
                rule,
                axis,
                value,
                limit,
                time,
            } => {
                return Err(Fault {
                    rule: Rule::from_text(&rule),
                    axis,
                    value,
                    limit,
                    time,
                });
            }
        })
    }
}

/// An exchange with a bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Exchange {
    /// The record begins at this time.
    Begin(f64),
    Play(Group, Law, Answer<Ticket>),
    Bend(Ticket, Law, Answer<f64>),
    Request(Request, Answer<Ticket>),
    /// By when, which is nothing where nobody said; what came of it; and the time then.
    Next(Option<f64>, Heard, f64),
    Pose(Group, f64, Option<Estimate>),
    Reference(Group, Option<Pose>),
    Reaches(Group, Pose, bool),
    Stop,
}

fn said(by: f64) -> Option<f64> {
    Some(by).filter(|by| by.is_finite())
}

/// A bench that writes down what is asked of it and what it answers.
pub struct Recorder<B, W: Write> {
    bench: B,
    out: RefCell<W>,
    /// That it could not be written, once it could not.
    broken: RefCell<Option<String>>,
}

impl<B: Bench, W: Write> Recorder<B, W> {
    /// Begins a record.
    pub fn new(bench: B, out: W) -> Self {
        let recorder = Self {
            out: RefCell::new(out),
            broken: RefCell::new(None),
            bench,
        };
        recorder.keep(&Exchange::Begin(recorder.bench.now()));
        recorder
    }

    fn keep(&self, exchange: &Exchange) {
        let mut out = self.out.borrow_mut();
        let written = serde_json::to_writer(&mut *out, exchange).map_err(std::io::Error::from);
        let written = written.and_then(|()| out.write_all(b"\n"));
        if let Err(why) = written {
            self.broken.borrow_mut().get_or_insert(why.to_string());
        }
    }

    /// Ends the record.
    ///
    /// # Errors
    ///
    /// When it could not be written.
    pub fn finish(self) -> std::io::Result<W> {
        if let Some(why) = self.broken.into_inner() {
            return Err(std::io::Error::other(why));
        }
        let mut out = self.out.into_inner();
        out.flush()?;
        Ok(out)
    }
}

impl<B: Bench, W: Write> Bench for Recorder<B, W> {
    fn caps(&self) -> &Caps {
        self.bench.caps()
    }

    fn now(&self) -> f64 {
        self.bench.now()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        let result = self.bench.play(group, law.clone());
        self.keep(&Exchange::Play(group, law, Answer::of(&result)));
        result
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        let result = self.bench.bend(ticket, law.clone());
        self.keep(&Exchange::Bend(ticket, law, Answer::of(&result)));
        result
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        let result = self.bench.request(what);
        self.keep(&Exchange::Request(what, Answer::of(&result)));
        result
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        if let Some(why) = self.broken.borrow().clone() {
            self.bench.stop();
            return Err(Fault {
                rule: Rule::RecordWritable,
                axis: self.bench.caps().name.clone(),
                value: why,
                limit: "a record that can be written".to_owned(),
                time: self.bench.now(),
            });
        }
        let result = self.bench.next(by);
        let heard = Heard::of(&result);
        self.keep(&Exchange::Next(said(by), heard, self.bench.now()));
        result
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        let answer = self.bench.pose(group, at);
        self.keep(&Exchange::Pose(group, at, answer));
        answer
    }

    fn reference(&self, group: Group) -> Option<Pose> {
        let answer = self.bench.reference(group);
        self.keep(&Exchange::Reference(group, answer));
        answer
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        let answer = self.bench.reaches(group, pose);
        self.keep(&Exchange::Reaches(group, *pose, answer));
        answer
    }

    fn stop(&mut self) {
        self.bench.stop();
        self.keep(&Exchange::Stop);
    }
}

/// A bench that answers as it was recorded. Whoever asks otherwise than it was asked is told so, by a fault.
pub struct Replay {
    caps: Caps,
    exchanges: Vec<Exchange>,
    next: Cell<usize>,
    now: f64,
    fault: RefCell<Option<Fault>>,
}

impl Replay {
    /// Reads a record of a bench with this datasheet.
    ///
    /// # Errors
    ///
    /// When it cannot be read, or is no record. A last line that was not written to its end is left out.
    pub fn read(caps: Caps, from: impl BufRead) -> std::io::Result<Self> {
        let lines: Vec<String> = from.lines().collect::<Result<_, _>>()?;
        let mut exchanges = Vec::with_capacity(lines.len());
        for (index, line) in lines.iter().enumerate() {
            match serde_json::from_str(line) {
                Ok(exchange) => exchanges.push(exchange),
                Err(_) if index > 0 && index + 1 == lines.len() => {}
                Err(why) => {
                    let text =
                        format!("line {}: {why}; accepted is a record of a bench", index + 1);
                    return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, text));
                }
            }
        }
        let Some(Exchange::Begin(now)) = exchanges.first().cloned() else {
            let text = "it does not begin as a record of a bench does";
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, text));
        };
        Ok(Self {
            caps,
            exchanges,
            next: Cell::new(1),
            now,
            fault: RefCell::new(None),
        })
    }

    /// What was recorded here, if it was what is asked now.
    fn answer<T>(&self, asked: &str, same: impl Fn(&Exchange) -> Option<T>) -> Option<T> {
        let at = self.next.get();
        let there = self.exchanges.get(at);
        if self.fault.borrow().is_none()
            && let Some(answer) = there.and_then(same)
        {
            self.next.set(at + 1);
            return Some(answer);
        }
        let rule = match there {
            Some(_) => Rule::ReplayDiffers,
            None => Rule::ReplayEnds,
        };
        self.fault.borrow_mut().get_or_insert(Fault {
            rule,
            axis: self.caps.name.clone(),
            value: asked.to_owned(),
            limit: format!("what stands in line {} of the record", at + 1),
            time: self.now,
        });
        None
    }

    fn differs(&self) -> Refused {
        let fault = self.fault.borrow().clone();
        Refused::State(fault.map_or_else(String::new, |fault| fault.to_string()))
    }
}

impl Bench for Replay {
    fn caps(&self) -> &Caps {
        &self.caps
    }

    fn now(&self) -> f64 {
        self.now
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Play(of, played, answer) if (of, played) == (&group, &law) => {
                Some(answer.clone())
            }
            _ => None,
        };
        let answer = self.answer(&format!("a {} is played", law.name()), same);
        answer.ok_or_else(|| self.differs())?.result()
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Bend(of, played, answer) if (of, played) == (&ticket, &law) => {
                Some(answer.clone())
            }
            _ => None,
        };
        let answer = self.answer(&format!("ticket {ticket} is bent"), same);
        answer.ok_or_else(|| self.differs())?.result()
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Request(of, answer) if *of == what => Some(answer.clone()),
            _ => None,
        };
        let answer = self.answer(&format!("{what:?} is requested"), same);
        answer.ok_or_else(|| self.differs())?.result()
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Next(until, heard, now) if *until == said(by) => Some((heard.clone(), *now)),
            _ => None,
        };
        if let Some((heard, now)) = self.answer(&format!("time passes until {by} s"), same) {
            self.now = now;
            return heard.result();
        }
        let fault = self.fault.borrow().clone();
        Err(fault.expect("what differs is a fault"))
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Pose(of, time, answer) if (*of, *time) == (group, at) => Some(*answer),
            _ => None,
        };
        self.answer(&format!("a pose at {at} s"), same).flatten()
    }

    fn reference(&self, group: Group) -> Option<Pose> {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Reference(of, answer) if *of == group => Some(*answer),
            _ => None,
        };
        self.answer("a reference", same).flatten()
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        let same = |exchange: &Exchange| match exchange {
            Exchange::Reaches(of, at, answer) if (of, at) == (&group, pose) => Some(*answer),
            _ => None,
        };
        self.answer("whether a pose is reached", same)
            .unwrap_or(false)
    }

    fn stop(&mut self) {
        let same = |exchange: &Exchange| (*exchange == Exchange::Stop).then_some(());
        // That nothing was stopped when it was recorded is no harm.
        if self.fault.borrow().is_none() {
            let _ = self.answer("a stop", same);
        }
    }
}
