//! Exchanges as bytes.

use pigtail_hal::measurement::TipFix;
use pigtail_hal::pulse::HARMONICS;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, CHANNELS, MICRO_AXES, SIDES};
use pigtail_hal::{
    Command, Fault, FiberHandling, Handled, LightSample, Measurement, Pulse, Rule, VisionFrame,
};

/// One exchange: what was said, and what came back.
#[derive(Debug, Clone, PartialEq)]
pub struct Exchange {
    /// What was said.
    pub command: Command,
    /// What came back.
    pub answer: Result<Measurement, Fault>,
}

/// Quarter of a second of exchanges, on its way to the disk.
#[derive(Debug, Clone, Default)]
pub(super) struct Block {
    pub(super) rows: Vec<Row>,
    /// What the probes say, of the rows that have them.
    probes: Vec<Probes>,
    /// What comes seldom, with the row that it belongs to.
    seldom: Vec<(u32, Seldom)>,
}

/// What is there in every cycle, in the form in which it is copied fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    time: f64,
    motors: [f64; MOTORS],
    micro: [f64; PIEZOS],
    references: [i64; MOTORS],
    encoders: [i64; MOTORS],
    flags: u8,
}

type Probes = [f64; MOTORS];

const MOTORS: usize = SIDES * AXES;
const PIEZOS: usize = SIDES * MICRO_AXES;
/// A reference that there is not.
const NONE: i64 = i64::MIN;
const LASER: u8 = 1;
const STOP: u8 = 2;
const PROBES: u8 = 4;

impl Row {
    const ZERO: Self = Self {
        time: 0.0,
        motors: [0.0; MOTORS],
        micro: [0.0; PIEZOS],
        references: [NONE; MOTORS],
        encoders: [0; MOTORS],
        flags: 0,
    };

    /// The `next` ones, if this row has any.
    fn probes<T>(&self, next: impl FnOnce() -> Option<T>) -> Option<T> {
        (self.flags & PROBES != 0).then(next).flatten()
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Seldom {
    Pulse(u8, Pulse),
    Fiber(u8, FiberHandling),
    Light(LightSample),
    Vision(VisionFrame),
    Fault(Fault),
    Handled(u8, Handled),
    /// The laser at less than its full power, percent.
    Dimmed(u8),
}

/// Why bytes are no block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Damaged;

impl Block {
    /// Adds an exchange.
    #[inline]
    pub(super) fn push(&mut self, command: &Command, measured: &Measurement) {
        let index = self.rows.len() as u32;
        let mut flags = 0;
        if command.laser {
            flags |= LASER;
        }
        if measured.stop {
            flags |= STOP;
        }
        if let Some(probes) = &measured.probes {
            flags |= PROBES;
            self.probes.push(flat(probes));
        }
        self.rows.push(Row {
            time: measured.time,
            motors: volts(&command.motors),
            micro: volts(&command.micro),
            references: std::array::from_fn(|i| {
                command.references[i / AXES][i % AXES].map_or(NONE, |Counts(counts)| counts)
            }),
            encoders: std::array::from_fn(|i| measured.encoders[i / AXES][i % AXES].0),
            flags,
        });
        if command.laser_percent != Command::IDLE.laser_percent {
            self.seldom
                .push((index, Seldom::Dimmed(command.laser_percent)));
        }
        if let Some(light) = measured.light {
            self.seldom.push((index, Seldom::Light(light)));
        }
        if let Some(frame) = measured.vision {
            self.seldom.push((index, Seldom::Vision(frame)));
        }
        let pulses = command.pulses.as_flattened();
        if pulses.iter().any(Option::is_some) || command.fiber.iter().any(Option::is_some) {
            self.push_seldom(index, command);
        }
        for (i, handled) in measured.handled.iter().enumerate() {
            if let Some(handled) = handled {
                self.seldom
                    .push((index, Seldom::Handled(i as u8, *handled)));
            }
        }
    }

    /// Adds an exchange that a fault answered.
    pub(super) fn push_fault(&mut self, command: &Command, time: f64, fault: &Fault) {
        let measured = Measurement {
            time,
            encoders: [[Counts(0); AXES]; SIDES],
            light: None,
            vision: None,
            probes: None,
            handled: [None; SIDES],
            stop: false,
        };
        let index = self.rows.len() as u32;
        self.push(command, &measured);
        self.seldom.push((index, Seldom::Fault(fault.clone())));
    }

    #[cold]
    fn push_seldom(&mut self, index: u32, command: &Command) {
        for (i, pulse) in command.pulses.as_flattened().iter().enumerate() {
            if let Some(pulse) = pulse {
                self.seldom.push((index, Seldom::Pulse(i as u8, *pulse)));
            }
        }
        for (i, handling) in command.fiber.iter().enumerate() {
            if let Some(handling) = handling {
                self.seldom.push((index, Seldom::Fiber(i as u8, *handling)));
            }
        }
    }

    /// Makes `out` the bytes of the block: of each row what differs from the row before.
    pub(super) fn encode(&self, out: &mut Vec<u8>) {
        out.clear();
        out.extend((self.rows.len() as u32).to_le_bytes());
        let mut last = Row::ZERO;
        let (mut probes, mut seen) = (Probes::default(), self.probes.iter());
        for row in &self.rows {
            let mut mask = 0_u32;
            let at = out.len();
            out.extend([0; 4]);
            out.push(row.flags);
            out.extend(row.time.to_bits().to_le_bytes());
            let mut bit = 1_u32;
            let mut number = |out: &mut Vec<u8>, is: f64, was: f64| {
                if is.to_bits() != was.to_bits() {
                    mask |= bit;
                    out.extend(is.to_bits().to_le_bytes());
                }
                bit <<= 1;
            };
            for i in 0..MOTORS {
                number(out, row.motors[i], last.motors[i]);
            }
            for i in 0..PIEZOS {
                number(out, row.micro[i], last.micro[i]);
            }
            let before = probes;
            probes = row.probes(|| seen.next()).copied().unwrap_or_default();
            for i in 0..MOTORS {
                number(out, probes[i], before[i]);
            }
            let mut whole = |out: &mut Vec<u8>, is: i64, was: i64| {
                if is != was {
                    mask |= bit;
                    varint(out, is.wrapping_sub(was));
                }
                bit <<= 1;
            };
            for i in 0..MOTORS {
                whole(out, row.references[i], last.references[i]);
            }
            for i in 0..MOTORS {
                whole(out, row.encoders[i], last.encoders[i]);
            }
            out[at..at + 4].copy_from_slice(&mask.to_le_bytes());
            last = *row;
        }
        out.extend((self.seldom.len() as u32).to_le_bytes());
        for (index, what) in &self.seldom {
            out.extend(index.to_le_bytes());
            what.encode(out);
        }
    }

    /// Empties it, and keeps its memory.
    pub(super) fn clear(&mut self) {
        self.rows.clear();
        self.probes.clear();
        self.seldom.clear();
    }

    /// The block that these bytes are.
    pub(super) fn decode(bytes: &[u8]) -> Result<Self, Damaged> {
        let mut from = Bytes(bytes);
        let rows = from.u32()? as usize;
        // A row takes 13 bytes at least.
        if rows > bytes.len() / 13 {
            return Err(Damaged);
        }
        let mut block = Self {
            rows: Vec::with_capacity(rows),
            probes: Vec::new(),
            seldom: Vec::new(),
        };
        let (mut row, mut probes) = (Row::ZERO, Probes::default());
        for _ in 0..rows {
            let mask = from.u32()?;
            row.flags = from.u8()?;
            row.time = from.f64()?;
            let mut bit = 1_u32;
            for value in row
                .motors
                .iter_mut()
                .chain(&mut row.micro)
                .chain(&mut probes)
            {
                if mask & bit != 0 {
                    *value = from.f64()?;
                }
                bit <<= 1;
            }
            for value in row.references.iter_mut().chain(&mut row.encoders) {
                if mask & bit != 0 {
                    *value = value.wrapping_add(from.varint()?);
                }
                bit <<= 1;
            }
            block.rows.push(row);
            if row.flags & PROBES != 0 {
                block.probes.push(probes);
            }
        }
        for _ in 0..from.u32()? {
            let index = from.u32()?;
            let before = block.seldom.last().map_or(0, |(index, _)| *index);
            if index as usize >= rows || index < before {
                return Err(Damaged);
            }
            block.seldom.push((index, Seldom::decode(&mut from)?));
        }
        if from.0.is_empty() {
            Ok(block)
        } else {
            Err(Damaged)
        }
    }

    /// The exchanges, in order.
    pub(super) fn exchanges(&self) -> impl Iterator<Item = Exchange> {
        let mut seldom = self.seldom.iter().peekable();
        let mut probes = self.probes.iter();
        self.rows.iter().enumerate().map(move |(index, row)| {
            let mut command = Command {
                motors: std::array::from_fn(|i| {
                    std::array::from_fn(|k| Volts(row.motors[AXES * i + k]))
                }),
                micro: std::array::from_fn(|i| {
                    std::array::from_fn(|k| Volts(row.micro[MICRO_AXES * i + k]))
                }),
                references: std::array::from_fn(|i| {
                    std::array::from_fn(|k| {
                        let counts = row.references[AXES * i + k];
                        (counts != NONE).then_some(Counts(counts))
                    })
                }),
                laser: row.flags & LASER != 0,
                ..Command::IDLE
            };
            let mut measured = Measurement {
                time: row.time,
                encoders: std::array::from_fn(|i| {
                    std::array::from_fn(|k| Counts(row.encoders[AXES * i + k]))
                }),
                light: None,
                vision: None,
                probes: row.probes(|| probes.next()).map(|probes| {
                    std::array::from_fn(|i| std::array::from_fn(|k| probes[AXES * i + k]))
                }),
                handled: [None; SIDES],
                stop: row.flags & STOP != 0,
            };
            let mut fault = None;
            while let Some((_, what)) = seldom.next_if(|(at, _)| *at as usize == index) {
                match what {
                    Seldom::Pulse(i, pulse) => {
                        let i = usize::from(*i);
                        command.pulses[i / AXES][i % AXES] = Some(*pulse);
                    }
                    Seldom::Fiber(side, handling) => {
                        command.fiber[usize::from(*side)] = Some(*handling);
                    }
                    Seldom::Dimmed(percent) => command.laser_percent = *percent,
                    Seldom::Light(light) => measured.light = Some(*light),
                    Seldom::Vision(frame) => measured.vision = Some(*frame),
                    Seldom::Fault(what) => fault = Some(what.clone()),
                    Seldom::Handled(side, how) => {
                        measured.handled[usize::from(*side)] = Some(*how);
                    }
                }
            }
            Exchange {
                command,
                answer: fault.map_or(Ok(measured), Err),
            }
        })
    }
}

impl Seldom {
    fn encode(&self, out: &mut Vec<u8>) {
        let number = |out: &mut Vec<u8>, value: f64| out.extend(value.to_bits().to_le_bytes());
        let tip = |out: &mut Vec<u8>, tip: &TipFix| {
            for value in [tip.x, tip.z, tip.sigma] {
                number(out, value);
            }
        };
        match self {
            Self::Pulse(i, pulse) => {
                out.extend([0, *i]);
                for Volts(volts) in pulse.amplitudes {
                    number(out, volts);
                }
                number(out, pulse.period);
            }
            Self::Fiber(side, handling) => {
                let (what, port) = match handling {
                    FiberHandling::Load(port) => (0, *port),
                    FiberHandling::Attach => (1, 0),
                    FiberHandling::Unload => (2, 0),
                    FiberHandling::Pick(port) => (3, *port),
                    FiberHandling::Wet(volume) => (4, *volume),
                    FiberHandling::Lamp(on) => (5, u8::from(*on)),
                    FiberHandling::Release => (6, 0),
                    FiberHandling::Index => (7, 0),
                };
                out.extend([1, *side, what, port]);
            }
            Self::Light(light) => {
                out.push(2);
                number(out, light.time);
                for Volts(volts) in light.volts {
                    number(out, volts);
                }
            }
            Self::Vision(frame) => {
                out.push(3);
                number(out, frame.time);
                tip(out, &frame.sensing);
                for fiber in &frame.fiber {
                    out.push(u8::from(fiber.is_some()));
                    if let Some(fiber) = fiber {
                        tip(out, fiber);
                    }
                }
            }
            Self::Dimmed(percent) => out.extend([6, *percent]),
            Self::Handled(side, how) => out.extend([5, *side, u8::from(*how == Handled::Missed)]),
            Self::Fault(fault) => {
                out.push(4);
                number(out, fault.time);
                for text in [fault.rule.text(), &fault.axis, &fault.value, &fault.limit] {
                    out.extend((text.len() as u32).to_le_bytes());
                    out.extend(text.as_bytes());
                }
            }
        }
    }

    fn decode(from: &mut Bytes) -> Result<Self, Damaged> {
        let below = |value: u8, limit: usize| {
            if usize::from(value) < limit {
                Ok(value)
            } else {
                Err(Damaged)
            }
        };
        Ok(match from.u8()? {
            0 => {
                let i = below(from.u8()?, MOTORS)?;
                let mut amplitudes = [Volts(0.0); HARMONICS];
                for amplitude in &mut amplitudes {
                    *amplitude = Volts(from.f64()?);
                }
                Self::Pulse(
                    i,
                    Pulse {
                        amplitudes,
                        period: from.f64()?,
                    },
                )
            }
            1 => {
                let side = below(from.u8()?, SIDES)?;
                let (what, port) = (from.u8()?, from.u8()?);
                let handling = match what {
                    0 => FiberHandling::Load(port),
                    1 => FiberHandling::Attach,
                    2 => FiberHandling::Unload,
                    3 => FiberHandling::Pick(port),
                    4 => FiberHandling::Wet(port),
                    5 => FiberHandling::Lamp(port != 0),
                    6 => FiberHandling::Release,
                    7 => FiberHandling::Index,
                    _ => return Err(Damaged),
                };
                Self::Fiber(side, handling)
            }
            2 => {
                let time = from.f64()?;
                let mut volts = [Volts(0.0); CHANNELS];
                for volts in &mut volts {
                    *volts = Volts(from.f64()?);
                }
                Self::Light(LightSample { time, volts })
            }
            3 => {
                let time = from.f64()?;
                let sensing = from.tip()?;
                let mut fiber = [None; SIDES];
                for fiber in &mut fiber {
                    if from.u8()? != 0 {
                        *fiber = Some(from.tip()?);
                    }
                }
                Self::Vision(VisionFrame {
                    time,
                    fiber,
                    sensing,
                })
            }
            5 => {
                let side = below(from.u8()?, SIDES)?;
                let how = match from.u8()? {
                    0 => Handled::Done,
                    1 => Handled::Missed,
                    _ => return Err(Damaged),
                };
                Self::Handled(side, how)
            }
            6 => Self::Dimmed(from.u8()?),
            4 => {
                let time = from.f64()?;
                Self::Fault(Fault {
                    rule: Rule::from_text(&from.text()?),
                    axis: from.text()?,
                    value: from.text()?,
                    limit: from.text()?,
                    time,
                })
            }
            _ => return Err(Damaged),
        })
    }
}

fn volts<const N: usize, const ALL: usize>(volts: &[[Volts; N]; SIDES]) -> [f64; ALL] {
    std::array::from_fn(|i| volts[i / N][i % N].0)
}

fn flat(values: &[[f64; AXES]; SIDES]) -> [f64; MOTORS] {
    std::array::from_fn(|i| values[i / AXES][i % AXES])
}

/// Seven bits a byte, the sign folded into the lowest.
fn varint(out: &mut Vec<u8>, value: i64) {
    let mut rest = ((value << 1) ^ (value >> 63)).cast_unsigned();
    while rest >= 0x80 {
        out.push(rest as u8 | 0x80);
        rest >>= 7;
    }
    out.push(rest as u8);
}

/// Bytes that are being read.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Damaged> {
        let (head, rest) = self.0.split_first_chunk::<N>().ok_or(Damaged)?;
        self.0 = rest;
        Ok(*head)
    }

    fn u8(&mut self) -> Result<u8, Damaged> {
        Ok(self.take::<1>()?[0])
    }

    fn u32(&mut self) -> Result<u32, Damaged> {
        self.take().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, Damaged> {
        self.take()
            .map(|bytes| f64::from_bits(u64::from_le_bytes(bytes)))
    }

    fn varint(&mut self) -> Result<i64, Damaged> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok((value >> 1).cast_signed() ^ -((value & 1).cast_signed()));
            }
        }
        Err(Damaged)
    }

    fn tip(&mut self) -> Result<TipFix, Damaged> {
        Ok(TipFix {
            x: self.f64()?,
            z: self.f64()?,
            sigma: self.f64()?,
        })
    }

    fn text(&mut self) -> Result<String, Damaged> {
        let length = self.u32()? as usize;
        let (head, rest) = self.0.split_at_checked(length).ok_or(Damaged)?;
        self.0 = rest;
        String::from_utf8(head.to_vec()).map_err(|_| Damaged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(block: &Block) -> Vec<u8> {
        let mut bytes = Vec::new();
        block.encode(&mut bytes);
        bytes
    }

    #[test]
    fn varints_come_back() {
        for value in [0, 1, -1, 63, -64, 64, 1 << 40, i64::MAX, i64::MIN, NONE] {
            let mut out = Vec::new();
            varint(&mut out, value);
            assert_eq!(Bytes(&out).varint(), Ok(value));
        }
        assert!(Bytes(&[0xff; 12]).varint().is_err());
    }

    #[test]
    fn what_comes_seldom_comes_back() {
        let mut block = Block::default();
        let mut command = Command {
            laser: true,
            ..Command::IDLE
        };
        command.references[1][2] = Some(Counts(-7));
        command.pulses[1][0] = Some(Pulse {
            amplitudes: [Volts(1.0), Volts(-0.5), Volts(0.0), Volts(0.25)],
            period: 1e-3,
        });
        command.fiber = [Some(FiberHandling::Load(1)), Some(FiberHandling::Attach)];
        command.motors[0][1] = Volts(-0.0);
        let tip = TipFix {
            x: 1e-6,
            z: -2e-6,
            sigma: 7e-7,
        };
        let measured = Measurement {
            time: 0.4,
            encoders: [[Counts(3), Counts(-4), Counts(1 << 40)]; SIDES],
            light: Some(LightSample {
                time: 0.4,
                volts: [Volts(0.1); CHANNELS],
            }),
            vision: Some(VisionFrame {
                time: 0.36,
                fiber: [None, Some(tip)],
                sensing: tip,
            }),
            probes: Some([[1e-9; AXES]; SIDES]),
            stop: true,
            handled: [None; SIDES],
        };
        block.push(&command, &measured);
        let fault = Fault {
            rule: Rule::Other("a rule".to_owned()),
            axis: "left.z".to_owned(),
            value: "5 um".to_owned(),
            limit: "at most 4 um".to_owned(),
            time: 0.5,
        };
        block.push_fault(&Command::IDLE, 0.5, &fault);
        let back: Vec<_> = Block::decode(&bytes(&block))
            .expect("whole")
            .exchanges()
            .collect();
        assert_eq!(
            back[0],
            Exchange {
                command,
                answer: Ok(measured)
            }
        );
        assert_eq!(
            back[0].command.motors[0][1].0.to_bits(),
            (-0.0_f64).to_bits()
        );
        assert_eq!(back[1].answer, Err(fault));
    }

    #[test]
    fn damaged_bytes_are_told_and_never_panic() {
        let mut block = Block::default();
        for k in 0..50 {
            let mut command = Command::IDLE;
            command.motors[0][0] = Volts(f64::from(k));
            let measured = Measurement {
                time: f64::from(k),
                encoders: [[Counts(i64::from(k)); AXES]; SIDES],
                light: None,
                vision: None,
                probes: None,
                handled: [None; SIDES],
                stop: false,
            };
            block.push(&command, &measured);
        }
        let good = bytes(&block);
        for cut in 0..good.len() {
            assert!(Block::decode(&good[..cut]).is_err(), "{cut}");
        }
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x41;
            // What is still a block is one that can be walked through.
            if let Ok(block) = Block::decode(&bad) {
                assert_eq!(block.exchanges().count(), 50);
            }
        }
    }
}
