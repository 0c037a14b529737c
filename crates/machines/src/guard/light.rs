//! Light that goes out while nothing has moved.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::Broken;
use super::keepout::Keepout;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::CHANNELS;
use pigtail_hal::{Channel, Command, Measurement, Rule, Spec};

/// Light counts as such from this share of a photodiode's range on.
const BRIGHT: f64 = 0.02;
/// It has gone out when so little of it is left...
const LEFT: f64 = 0.1;
/// ...while no tip has been told to be farther than this from where it is, metres, for as long as piezos take
/// to come where they are told: no mode is so narrow.
const STILL: f64 = 1e-6;

/// It goes out by more than so many times what it has varied by from sample to sample...
const VARIES: f64 = 8.0;
/// ...on average over so many of them; before there are some of them nothing is known of that.
const AVERAGED: (f64, u32) = (50.0, 5);

/// Samples for which a photodiode still remembers a device that has gone.
const REMEMBERS: u32 = 10;

/// How light varies while nothing moves.
#[derive(Debug, Clone, Copy, Default)]
struct Varies {
    /// Mean square of the difference from one sample to the next, square volts.
    square: f64,
    samples: u32,
}

impl Varies {
    fn note(&mut self, by: f64) {
        let (average, _) = AVERAGED;
        self.samples = self.samples.saturating_add(1);
        let share = 1.0 / f64::from(self.samples).min(average);
        self.square += share * (by * by - self.square);
    }

    /// Whether a difference is none of the usual ones.
    fn is_new(&self, by: f64) -> bool {
        let (_, least) = AVERAGED;
        self.samples >= least && by > VARIES * self.square.sqrt()
    }
}

/// What the photodiodes saw last.
#[derive(Debug, Clone)]
pub(super) struct LightWatch {
    bright: f64,
    /// The least that each photodiode has read: the dark, or what is always there, volts.
    dark: [f64; CHANNELS],
    last: Option<[Volts; CHANNELS]>,
    /// The laser's power, percent.
    power: u8,
    varies: [Varies; CHANNELS],
    /// Samples that are still to be passed over.
    blind: u32,
}

impl LightWatch {
    pub(super) fn new(spec: &Spec) -> Self {
        Self {
            bright: BRIGHT * spec.photodiode.range,
            dark: [f64::INFINITY; CHANNELS],
            last: None,
            power: 100,
            varies: [Varies::default(); CHANNELS],
            blind: 0,
        }
    }

    /// The device goes, or has just gone: its light goes with it, and what the next one lets through is another.
    pub(super) fn change_device(&mut self) {
        self.forget();
        self.varies = [Varies::default(); CHANNELS];
        self.blind = REMEMBERS;
    }

    /// What was seen no longer says what should be: a fiber has been changed.
    pub(super) fn forget(&mut self) {
        self.last = None;
    }

    #[inline(always)]
    pub(super) fn check(
        &mut self,
        command: &Command,
        measured: &Measurement,
        keepout: &Keepout,
    ) -> Result<(), Broken> {
        if !command.laser {
            self.last = None;
        }
        // A photodiode remembers the power that was for as long as it does a device.
        if command.laser_percent != self.power {
            self.power = command.laser_percent;
            self.forget();
            self.blind = REMEMBERS;
        }
        let Some(light) = &measured.light else {
            return Ok(());
        };
        if self.blind > 0 {
            self.blind -= 1;
            self.last = None;
            return Ok(());
        }
        let before = self.last.take();
        if command.laser {
            self.last = Some(light.volts);
        }
        for (dark, Volts(volts)) in self.dark.iter_mut().zip(light.volts) {
            *dark = dark.min(volts);
        }
        let Some(volts) = before else {
            return Ok(());
        };
        if !still(keepout) {
            self.varies = [Varies::default(); CHANNELS];
            return Ok(());
        }
        for channel in Channel::ALL {
            let i = channel.index();
            let (was, is) = (volts[i].0 - self.dark[i], light.volts[i].0 - self.dark[i]);
            let gone = was > self.bright && is < LEFT * was && self.varies[i].is_new(was - is);
            self.varies[i].note(was - is);
            if gone {
                return Err(Broken::new(
                    Rule::LightLoss,
                    channel.name(),
                    format!(
                        "{:.3} V became {:.3} V while nothing moved",
                        volts[i].0, light.volts[i].0
                    ),
                    format!("at least {:.3} V", self.dark[i] + LEFT * was),
                ));
            }
        }
        Ok(())
    }
}

#[inline(always)]
fn still(keepout: &Keepout) -> bool {
    keepout.is_still(0, STILL) && keepout.is_still(1, STILL)
}
