//! What can go wrong with a machine while it runs, to be injected into the twin by name, place, size
//! and time.
//!
//! `NAME[:WHERE][:SIZE]@TIME`, such as `encoder-stuck:left.z@3.2s` or `vision-wrong:z:-200um@1s`.
//! What is not said is the name's own default; the text that a [`Injection`] prints says all of it.

use pigtail_hal::quantity::{LENGTH, Sign, TIME, VOLTAGE};
use pigtail_hal::spec::{AXES, CHANNELS, MICRO_AXES, SIDES};
use pigtail_hal::{Axis, AxisName, Channel, Side};
use rand::RngExt;
use std::fmt;
use std::str::FromStr;

/// A fault and when it begins. It stays, but for those that last for a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Injection {
    /// What goes wrong, where, and how much.
    pub fault: Breakage,
    /// From when on, seconds of machine time.
    pub from: f64,
}

/// Something that breaks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Breakage {
    /// What.
    pub kind: Kind,
    /// Where.
    pub place: Place,
    /// How much, in the kind's own unit (SI); no meaning for kinds without a size.
    pub size: f64,
}

/// What can break.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// An encoder reads zero for a while: its plug is loose. Size: seconds.
    EncoderDropout,
    /// An encoder no longer counts.
    EncoderStuck,
    /// An amplifier gives no more than a share of its voltage.
    AmplifierSaturation,
    /// An amplifier gives no voltage.
    AmplifierDead,
    /// A transmission slips: its output stays behind the motor by so much, once, in the direction in
    /// which it moves next. Size: metres at the endpoint.
    BeltSlip,
    /// The friction of a joint changes by a factor.
    Friction,
    /// A photodiode sees nothing.
    PhotodiodeDead,
    /// A photodiode reads the end of its range.
    PhotodiodeSaturated,
    /// 50 Hz from the mains on a photodiode. Size: amplitude in volts.
    PhotodiodeHum,
    /// Vision sees every tip elsewhere. Size: metres.
    VisionWrong,
    /// The laser is off.
    LaserOff,
    /// A piezo that gives only a share of its stroke.
    PiezoDepolarised,
    /// The servo comes late, once. Size: seconds.
    ServoOverrun,
    /// A person presses stop.
    StopPressed,
}

/// Where something breaks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// One macro axis.
    Axis(AxisName),
    /// One piezo of a manipulator, 0 or 1.
    Piezo(Side, usize),
    /// One photodiode.
    Photodiode(Channel),
    /// One of vision's directions: x (0) or z (2).
    Direction(usize),
    /// The machine.
    Machine,
}

/// What a kind may be given.
struct Entry {
    kind: Kind,
    name: &'static str,
    places: Places,
    size: Size,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Places {
    Axes,
    Piezos,
    Photodiodes,
    Directions,
    Machine,
}

/// What a size is, and what it is where nobody says.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Size {
    None,
    Seconds(f64),
    Metres(f64),
    Volts(f64),
    Share(f64),
    Factor(f64),
}

const ENTRIES: [Entry; 14] = {
    use Places::{Axes, Directions, Photodiodes, Piezos};
    const fn entry(kind: Kind, name: &'static str, places: Places, size: Size) -> Entry {
        Entry {
            kind,
            name,
            places,
            size,
        }
    }
    [
        entry(
            Kind::EncoderDropout,
            "encoder-dropout",
            Axes,
            Size::Seconds(0.05),
        ),
        entry(Kind::EncoderStuck, "encoder-stuck", Axes, Size::None),
        entry(
            Kind::AmplifierSaturation,
            "amplifier-saturation",
            Axes,
            Size::Share(0.2),
        ),
        entry(Kind::AmplifierDead, "amplifier-dead", Axes, Size::None),
        entry(Kind::BeltSlip, "belt-slip", Axes, Size::Metres(50e-6)),
        entry(Kind::Friction, "friction", Axes, Size::Factor(2.0)),
        entry(
            Kind::PhotodiodeDead,
            "photodiode-dead",
            Photodiodes,
            Size::None,
        ),
        entry(
            Kind::PhotodiodeSaturated,
            "photodiode-saturated",
            Photodiodes,
            Size::None,
        ),
        entry(
            Kind::PhotodiodeHum,
            "photodiode-hum",
            Photodiodes,
            Size::Volts(0.1),
        ),
        entry(
            Kind::VisionWrong,
            "vision-wrong",
            Directions,
            Size::Metres(200e-6),
        ),
        entry(Kind::LaserOff, "laser-off", Places::Machine, Size::None),
        entry(
            Kind::PiezoDepolarised,
            "piezo-depolarised",
            Piezos,
            Size::Share(0.5),
        ),
        entry(
            Kind::ServoOverrun,
            "servo-overrun",
            Places::Machine,
            Size::Seconds(0.02),
        ),
        entry(
            Kind::StopPressed,
            "stop-pressed",
            Places::Machine,
            Size::None,
        ),
    ]
};

impl Kind {
    /// All there are, in the order in which lists have them.
    pub fn all() -> impl Iterator<Item = Self> {
        ENTRIES.iter().map(|entry| entry.kind)
    }

    fn entry(self) -> &'static Entry {
        ENTRIES
            .iter()
            .find(|entry| entry.kind == self)
            .expect("every kind has an entry")
    }

    /// The name that files and options use.
    pub fn name(self) -> &'static str {
        self.entry().name
    }

    /// What may be said of it, for a person: `friction:AXIS:FACTOR (2)`.
    pub fn about(self) -> String {
        let Entry {
            name, places, size, ..
        } = self.entry();
        let place = match places {
            Places::Axes => ":left.a|left.b|left.z|right.a|right.b|right.z",
            Places::Piezos => ":left.micro1|left.micro2|right.micro1|right.micro2",
            Places::Photodiodes => ":output1|output2|sensing",
            Places::Directions => ":x|z",
            Places::Machine => "",
        };
        let size = match size {
            Size::None => String::new(),
            size => format!("[:{}]", size.text(size.default())),
        };
        format!("{name}{place}{size}")
    }

    /// A fault of this kind at a place that is drawn, of the size that a kind has by itself; vision
    /// errs in either direction, and an encoder that drops out may do so on any axis.
    pub fn draw(self, rng: &mut impl RngExt) -> Breakage {
        let mut below = |n: usize| rng.random_range(0..n);
        let Entry { places, size, .. } = self.entry();
        let place = match places {
            Places::Axes => Place::Axis(AxisName {
                side: Side::ALL[below(SIDES)],
                axis: Axis::ALL[below(AXES)],
            }),
            Places::Piezos => Place::Piezo(Side::ALL[below(SIDES)], below(MICRO_AXES)),
            Places::Photodiodes => Place::Photodiode(Channel::ALL[below(CHANNELS)]),
            Places::Directions => Place::Direction([0, 2][below(2)]),
            Places::Machine => Place::Machine,
        };
        let sign = match self {
            Self::VisionWrong => [1.0, -1.0][below(2)],
            _ => 1.0,
        };
        Breakage {
            kind: self,
            place,
            size: sign * size.default(),
        }
    }
}

impl FromStr for Kind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        ENTRIES
            .iter()
            .find(|entry| entry.name == text)
            .map(|entry| entry.kind)
            .ok_or_else(|| {
                let names: Vec<_> = ENTRIES.iter().map(|entry| entry.name).collect();
                format!(
                    "there is no fault \"{text}\"; accepted is {}",
                    names.join(", ")
                )
            })
    }
}

impl Size {
    fn default(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Seconds(size)
            | Self::Metres(size)
            | Self::Volts(size)
            | Self::Share(size)
            | Self::Factor(size) => size,
        }
    }

    fn text(self, value: f64) -> String {
        // What was micrometres is said as such, and not as a sum of binary fractions.
        let rounded = |value: f64| (value * 1e6).round() / 1e6;
        match self {
            Self::None => String::new(),
            Self::Seconds(_) => format!("{}ms", rounded(value * 1e3)),
            Self::Metres(_) => format!("{}um", rounded(value * 1e6)),
            Self::Volts(_) => format!("{}mV", rounded(value * 1e3)),
            Self::Share(_) | Self::Factor(_) => format!("{value}"),
        }
    }

    fn parse(self, text: &str) -> Result<f64, String> {
        let number = |low: f64, high: f64| {
            text.parse::<f64>()
                .ok()
                .filter(|value| (low..=high).contains(value))
                .ok_or_else(|| {
                    format!("\"{text}\" is no size; accepted is a number from {low} to {high}")
                })
        };
        let within = |value: f64, most: f64, said: &str| {
            if value.abs() <= most {
                Ok(value)
            } else {
                Err(format!(
                    "\"{text}\" is too much; accepted is at most {said}"
                ))
            }
        };
        match self {
            Self::None => Err(format!("\"{text}\": this fault has no size")),
            Self::Seconds(_) => within(TIME.parse(&spaced(text), Sign::Positive)?, 10.0, "10 s"),
            Self::Metres(_) => within(LENGTH.parse(&spaced(text), Sign::Any)?, 0.01, "10 mm"),
            Self::Volts(_) => within(
                VOLTAGE.parse(&spaced(text), Sign::Positive)?,
                100.0,
                "100 V",
            ),
            Self::Share(_) => number(0.0, 1.0),
            Self::Factor(_) => number(0.1, 10.0),
        }
    }
}

/// `3.2s` as a quantity is written in files: `3.2 s`.
fn spaced(text: &str) -> String {
    let unit = text
        .find(|c: char| c.is_ascii_alphabetic() && c != 'e')
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(unit);
    format!("{} {}", number.trim(), unit.trim())
}

impl Place {
    fn parse(places: Places, text: &str) -> Result<Self, String> {
        match places {
            Places::Axes => text.parse().map(Self::Axis),
            Places::Piezos => {
                let named = Side::ALL
                    .into_iter()
                    .flat_map(|side| (0..MICRO_AXES).map(move |i| Self::Piezo(side, i)));
                one_of(named, text, "piezo")
            }
            Places::Photodiodes => one_of(
                Channel::ALL.into_iter().map(Self::Photodiode),
                text,
                "photodiode",
            ),
            Places::Directions => one_of(
                [0, 2].into_iter().map(Self::Direction),
                text,
                "direction of vision",
            ),
            Places::Machine => Err(format!("\"{text}\": this fault has no place")),
        }
    }

    /// Where a fault is that nobody has placed.
    fn default(places: Places) -> Self {
        match places {
            Places::Axes => Self::Axis(AxisName {
                side: Side::Left,
                axis: Axis::Z,
            }),
            Places::Piezos => Self::Piezo(Side::Left, 0),
            Places::Photodiodes => Self::Photodiode(Channel::Output1),
            Places::Directions => Self::Direction(2),
            Places::Machine => Self::Machine,
        }
    }
}

fn one_of(
    mut places: impl Iterator<Item = Place> + Clone,
    text: &str,
    what: &str,
) -> Result<Place, String> {
    places
        .clone()
        .find(|place| place.to_string() == text)
        .ok_or_else(|| {
            let names: Vec<_> = places.by_ref().map(|place| place.to_string()).collect();
            format!(
                "there is no {what} \"{text}\"; accepted is {}",
                names.join(", ")
            )
        })
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Axis(at) => write!(f, "{at}"),
            Self::Piezo(side, i) => write!(f, "{}.micro{}", side.name(), i + 1),
            Self::Photodiode(channel) => write!(f, "{}", channel.name()),
            Self::Direction(0) => write!(f, "x"),
            Self::Direction(_) => write!(f, "z"),
            Self::Machine => Ok(()),
        }
    }
}

impl fmt::Display for Breakage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Entry { name, size, .. } = self.kind.entry();
        write!(f, "{name}")?;
        if self.place != Place::Machine {
            write!(f, ":{}", self.place)?;
        }
        match size {
            Size::None => Ok(()),
            size => write!(f, ":{}", size.text(self.size)),
        }
    }
}

impl fmt::Display for Injection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}s", self.fault, self.from)
    }
}

/// `NAME[:WHERE][:SIZE]`.
impl FromStr for Breakage {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(':');
        let kind: Kind = parts.next().unwrap_or_default().parse()?;
        let Entry { places, size, .. } = kind.entry();
        let rest: Vec<&str> = parts.collect();
        let known = |why: String| format!("{why} (as in {})", kind.about());
        let (place, said) = match rest[..] {
            [] => (Place::default(*places), None),
            [one] => match Place::parse(*places, one) {
                Ok(place) => (place, None),
                // One that is no place may be a size.
                Err(_) if size.parse(one).is_ok() => (Place::default(*places), Some(one)),
                Err(why) => return Err(known(why)),
            },
            [place, size] => (Place::parse(*places, place).map_err(known)?, Some(size)),
            _ => {
                return Err(format!(
                    "\"{text}\" says too much; accepted is {}",
                    kind.about()
                ));
            }
        };
        let size = match said {
            None => size.default(),
            Some(text) => size.parse(text).map_err(known)?,
        };
        Ok(Self { kind, place, size })
    }
}

/// `NAME[:WHERE][:SIZE]@TIME`.
impl FromStr for Injection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some((fault, time)) = text.rsplit_once('@') else {
            return Err(format!(
                "\"{text}\" does not say when; accepted is NAME[:WHERE][:SIZE]@TIME, such as \
                 encoder-stuck:left.z@3.2s"
            ));
        };
        Ok(Self {
            fault: fault.parse()?,
            from: TIME.parse(&spaced(time), Sign::NonNegative)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn what_is_printed_is_what_is_read() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for kind in Kind::all() {
            for k in 0..20 {
                let injection = Injection {
                    fault: kind.draw(&mut rng),
                    from: 0.1 * f64::from(k),
                };
                let text = injection.to_string();
                assert_eq!(text.parse::<Injection>().as_ref(), Ok(&injection), "{text}");
            }
        }
    }

    #[test]
    fn a_mistake_says_what_is_accepted() {
        for (text, told) in [
            ("melt@1s", "belt-slip"),
            ("encoder-stuck:left.z", "@TIME"),
            ("encoder-stuck:left.q@1s", "right.z"),
            ("encoder-stuck:left.z:3um@1s", "no size"),
            ("laser-off:left.z@1s", "no place"),
            ("vision-wrong:y@1s", "x, z"),
            ("friction:left.a:0@1s", "0.1 to 10"),
            ("belt-slip:left.z:2s@1s", "a length"),
            ("laser-off@-1s", "zero or more"),
            ("laser-off@1", "a time"),
            ("a:b:c:d@1s", "there is no fault"),
        ] {
            let why = text.parse::<Injection>().expect_err(text);
            assert!(why.contains(told), "{text}: {why}");
        }
    }

    #[test]
    fn what_is_not_said_is_the_default() {
        let slip: Injection = "belt-slip@2s".parse().expect("good");
        assert_eq!(slip.to_string(), "belt-slip:left.z:50um@2s");
        let wrong: Injection = "vision-wrong:-30um@2s".parse().expect("good");
        assert_eq!(wrong.to_string(), "vision-wrong:z:-30um@2s");
    }
}
