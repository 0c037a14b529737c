//! Ways of an axis as flags take them: in counts of its encoder, or with a unit.

use crate::common::spaced;
use pigtail_hal::quantity::{ANGLE, LENGTH, Sign};
use pigtail_hal::{Axis, Error};
use pigtail_session::rig::Rig;
use pigtail_session::tune::way_of_count;

/// How far an axis is to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Way {
    /// Counts of its encoder.
    Counts(i64),
    /// Metres of a stage.
    Length(f64),
    /// Radians of a joint.
    Angle(f64),
}

/// Parses a way above zero: counts without a unit, else a length or an angle.
pub(crate) fn way(text: &str) -> Result<Way, String> {
    let named = spaced(text);
    if let Ok(counts) = named.parse::<i64>() {
        return match counts {
            1.. => Ok(Way::Counts(counts)),
            _ => Err(format!(
                "\"{text}\" is not positive; accepted is more than zero"
            )),
        };
    }
    let of = |unit: &&str| named.ends_with(&format!(" {unit}"));
    let angles = ANGLE.units.iter().map(|(unit, _)| unit).any(of);
    if angles {
        return ANGLE.parse(&named, Sign::Positive).map(Way::Angle);
    }
    LENGTH
        .parse(&named, Sign::Positive)
        .map(Way::Length)
        .map_err(|why| {
            if named.contains(' ') && why.contains("positive") {
                why
            } else {
                format!(
                    "\"{text}\" is no way of an axis; accepted is a whole number of counts, a length of z \
                     (\"81 um\") or an angle of a five-bar joint (\"0.9 deg\")"
                )
            }
        })
}

impl Way {
    /// The way in counts of an axis, at least `least` and at most what is safe of its range.
    pub(crate) fn counts(
        self,
        rig: &Rig,
        axis: Axis,
        flag: &str,
        least: i64,
    ) -> Result<i64, Error> {
        let count = way_of_count(rig, axis);
        let counts = match (self, axis) {
            (Self::Counts(counts), _) => counts as f64,
            (Self::Length(way), Axis::Z) | (Self::Angle(way), Axis::A | Axis::B) => way / count,
            (Self::Length(_), _) => {
                let message = "a five-bar joint turns; accepted is an angle (deg, rad) or counts";
                return Err(Error::new(flag, "", message));
            }
            (Self::Angle(_), _) => {
                let message = "z goes straight; accepted is a length (m, mm, um, nm) or counts";
                return Err(Error::new(flag, "", message));
            }
        };
        let most = (0.4 * rig.range_counts(axis)).floor();
        if counts > most {
            let message = format!(
                "{counts:.0} counts are beyond the axis's range; accepted is at most {most:.0}"
            );
            return Err(Error::new(flag, "", message));
        }
        let counts = counts.round() as i64;
        if counts < least {
            let shortest = match axis {
                Axis::Z => format!("{:.3} um", 1e6 * least as f64 * count),
                Axis::A | Axis::B => format!("{:.5} deg", (least as f64 * count).to_degrees()),
            };
            let message = format!(
                "{counts} counts are too few; accepted is at least {least}, which are {shortest}"
            );
            return Err(Error::new(flag, "", message));
        }
        Ok(counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_in_counts_or_has_its_unit() {
        assert_eq!(way("400"), Ok(Way::Counts(400)));
        for text in ["10um", "10 um", "0.01 mm", "1e-5m"] {
            assert_eq!(way(text), Ok(Way::Length(1e-5)), "{text}");
        }
        assert_eq!(way("90deg"), Ok(Way::Angle(std::f64::consts::FRAC_PI_2)));
        for text in ["", "0", "-5", "-5um", "4.5", "5 kg", "um", "nan", "inf um"] {
            let why = way(text).unwrap_err();
            assert!(why.contains("accepted"), "{text}: {why}");
        }
    }
}
