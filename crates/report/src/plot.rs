//! Pictures, and beside them what is in them as JSON: what is in one is said here, drawn it is by `svg`.
//!
//! The picture is whole without a script, and on paper. With one (`chart.js`, which stands in the page once), a
//! reader zooms, reads values at a cursor and switches curves off; it draws from the JSON and asks for nothing else,
//! so that a page which gets its numbers while it is open can hand them to the same script.

mod svg;

use super::figure::Axes;
use serde::Serialize;

/// Colours of which a map is made; as many paths stand in the SVG.
const SHADES: usize = 32;
/// The class of a cross.
const CROSS: &str = "cross";
/// Colours of curves: classes `c0` to `c7` of the style.
const COLOURS: usize = 8;

/// What a colour means: its ends, its name and unit, and whether colours go by the square root.
#[derive(Debug, Clone, Serialize)]
struct Colour {
    low: f64,
    high: f64,
    label: String,
    root: bool,
}

impl Colour {
    /// Which of the shades a value has.
    fn shade(&self, value: f64) -> usize {
        let share = ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        let share = if self.root { share.sqrt() } else { share };
        // Not a number is dark.
        (share * (SHADES - 1) as f64).round() as usize
    }
}

#[derive(Debug, Clone, Copy, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Line,
    Dots,
    Boxes,
}

/// Something that is drawn of numbers. Boxes reach from `x`, `y` to `x1`, `y1`.
#[derive(Debug, Clone, Serialize)]
struct Series {
    name: String,
    kind: Kind,
    /// Classes of the style.
    class: String,
    #[serde(serialize_with = "digits")]
    x: Vec<f64>,
    #[serde(serialize_with = "digits")]
    y: Vec<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty", serialize_with = "digits")]
    x1: Vec<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty", serialize_with = "digits")]
    y1: Vec<f64>,
    /// Values that colours show.
    #[serde(skip_serializing_if = "Vec::is_empty", serialize_with = "digits")]
    v: Vec<f64>,
}

/// Six digits, which is more than any chart shows; a value that needs more is in the run's own files.
fn digits<S: serde::Serializer>(values: &[f64], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(values.iter().map(|v| {
        let rounded: f64 = format!("{v:.5e}").parse().unwrap_or(f64::NAN);
        rounded.is_finite().then_some(rounded)
    }))
}

/// A line across the picture with a name.
#[derive(Debug, Clone, Serialize)]
struct Mark {
    /// `x` for a value of the axis across.
    axis: char,
    at: f64,
    name: String,
    class: &'static str,
}

/// A stretch of the axis across with a name.
#[derive(Debug, Clone, Serialize)]
struct Band {
    name: String,
    from: f64,
    to: f64,
}

#[derive(Debug, Clone, Serialize)]
struct Axis {
    label: String,
    from: f64,
    to: f64,
    log: bool,
    whole: bool,
    /// Names in place of numbers, of 0, 1, ... from below.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    names: Vec<String>,
}

/// A picture that is being made.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Plot {
    #[serde(skip)]
    width: u32,
    #[serde(skip)]
    height: u32,
    #[serde(skip)]
    equal: bool,
    x: Axis,
    y: Axis,
    #[serde(skip_serializing_if = "Option::is_none")]
    colour: Option<Colour>,
    bands: Vec<Band>,
    marks: Vec<Mark>,
    series: Vec<Series>,
}

impl Plot {
    pub(super) fn new(axes: &Axes) -> Self {
        let axis = |(ends, label): &(std::ops::Range<f64>, &str)| Axis {
            label: (*label).to_owned(),
            from: ends.start,
            to: ends.end,
            log: false,
            whole: false,
            names: Vec::new(),
        };
        Self {
            width: axes.width,
            height: super::figure::HEIGHT,
            equal: false,
            x: axis(&axes.x),
            y: axis(&axes.y),
            colour: None,
            bands: Vec::new(),
            marks: Vec::new(),
            series: Vec::new(),
        }
    }

    /// The axis across is logarithmic.
    pub(super) fn log_x(mut self) -> Self {
        self.x.log = true;
        self
    }

    /// The upward axis is logarithmic.
    pub(super) fn log_y(mut self) -> Self {
        self.y.log = true;
        self
    }

    /// With what a reproduced figure adds: a logarithmic axis upward, and printed values as lines.
    pub(super) fn scaled(mut self, log_y: bool, printed: &[(char, f64, String)]) -> Self {
        self.y.log = log_y;
        for (axis, at, name) in printed {
            self = match axis {
                'x' => self.mark_x(name, *at, "soft"),
                _ => self.mark_y(name, *at, "soft"),
            };
        }
        self
    }

    /// The axis across counts something.
    pub(super) fn whole_x(mut self) -> Self {
        self.x.whole = true;
        self
    }

    /// The upward axis counts something.
    pub(super) fn whole_y(mut self) -> Self {
        self.y.whole = true;
        self
    }

    /// Both axes have one scale: the shorter one is made longer.
    pub(super) fn equal(mut self) -> Self {
        self.equal = true;
        self
    }

    /// Rows of the upward axis by name, the first on top; their heights are `rows - 1` to 0.
    pub(super) fn rows(mut self, names: &[&str]) -> Self {
        self.y.names = names.iter().rev().map(|n| (*n).to_owned()).collect();
        self.height = svg::BELOW as u32 + 20 + 34 * names.len() as u32;
        self
    }

    /// What colours mean, from dark to bright.
    pub(super) fn colour(mut self, low: f64, high: f64, label: &str, root: bool) -> Self {
        self.colour = Some(Colour {
            low,
            high: if high > low { high } else { low + 1.0 },
            label: label.to_owned(),
            root,
        });
        self
    }

    fn push(mut self, name: &str, kind: Kind, class: &str, points: &[(f64, f64)]) -> Self {
        self.series.push(Series {
            name: name.to_owned(),
            kind,
            class: class.to_owned(),
            x: points.iter().map(|p| p.0).collect(),
            y: points.iter().map(|p| p.1).collect(),
            x1: Vec::new(),
            y1: Vec::new(),
            v: Vec::new(),
        });
        self
    }

    /// The next colour of a curve.
    fn next_class(&self) -> String {
        let used = self
            .series
            .iter()
            .filter(|s| s.class.starts_with('c'))
            .count();
        let dashed = if used >= COLOURS { " dash" } else { "" };
        format!("c{}{dashed}", used % COLOURS)
    }

    /// A curve in a colour of its own.
    pub(super) fn line(self, name: &str, points: &[(f64, f64)]) -> Self {
        let class = self.next_class();
        self.push(name, Kind::Line, &class, points)
    }

    /// A curve in a class of the style: `ink`, `soft`, `limit`, `thin`, `dash`.
    pub(super) fn line_as(self, name: &str, class: &str, points: &[(f64, f64)]) -> Self {
        self.push(name, Kind::Line, class, points)
    }

    /// Points in a colour of their own; `class` says how large: `small`, `large`.
    pub(super) fn dots(self, name: &str, class: &str, points: &[(f64, f64)]) -> Self {
        let class = format!("{} {class}", self.next_class());
        self.push(name, Kind::Dots, &class, points)
    }

    /// Points in a class of the style.
    pub(super) fn dots_as(self, name: &str, class: &str, points: &[(f64, f64)]) -> Self {
        self.push(name, Kind::Dots, class, points)
    }

    /// Points whose third number is a colour.
    pub(super) fn shaded_dots(self, name: &str, class: &str, points: &[(f64, f64, f64)]) -> Self {
        let places: Vec<_> = points.iter().map(|p| (p.0, p.1)).collect();
        let mut plot = self.push(name, Kind::Dots, class, &places);
        if let Some(series) = plot.series.last_mut() {
            series.v = points.iter().map(|p| p.2).collect();
        }
        plot
    }

    /// Boxes between two corners.
    pub(super) fn boxes(self, name: &str, class: &str, boxes: &[[(f64, f64); 2]]) -> Self {
        let corners: Vec<_> = boxes.iter().map(|b| b[0]).collect();
        let mut plot = self.push(name, Kind::Boxes, class, &corners);
        if let Some(series) = plot.series.last_mut() {
            series.x1 = boxes.iter().map(|b| b[1].0).collect();
            series.y1 = boxes.iter().map(|b| b[1].1).collect();
        }
        plot
    }

    /// Boxes between two corners whose last number is a colour.
    pub(super) fn shaded_boxes(self, name: &str, boxes: &[([(f64, f64); 2], f64)]) -> Self {
        let corners: Vec<_> = boxes.iter().map(|b| b.0).collect();
        let mut plot = self.boxes(name, "", &corners);
        if let Some(series) = plot.series.last_mut() {
            series.v = boxes.iter().map(|b| b.1).collect();
        }
        plot
    }

    /// A stretch of the axis across.
    pub(super) fn band(mut self, name: &str, from: f64, to: f64) -> Self {
        self.bands.push(Band {
            name: name.to_owned(),
            from,
            to,
        });
        self
    }

    /// A cross at a place.
    pub(super) fn mark_point(self, name: &str, at: (f64, f64)) -> Self {
        self.push(name, Kind::Dots, CROSS, &[at])
    }

    /// A line upward at a value of the axis across; `class` is `limit` or `soft`.
    pub(super) fn mark_x(mut self, name: &str, at: f64, class: &'static str) -> Self {
        self.marks.push(Mark {
            axis: 'x',
            at,
            name: name.to_owned(),
            class,
        });
        self
    }

    /// A line across at a value of the upward axis.
    pub(super) fn mark_y(mut self, name: &str, at: f64, class: &'static str) -> Self {
        self.marks.push(Mark {
            axis: 'y',
            at,
            name: name.to_owned(),
            class,
        });
        self
    }
}

#[cfg(test)]
mod tests {
    use super::svg::short;
    use super::*;

    fn axes() -> Axes<'static> {
        Axes {
            width: super::super::figure::WHOLE,
            x: (0.0..2.0, "time, s"),
            y: (-1.0..1.0, "light, V"),
        }
    }

    /// The JSON that stands beside a picture.
    fn numbers(page: &str) -> serde_json::Value {
        let (_, rest) = page
            .split_once("<script type=\"application/json\">")
            .unwrap();
        serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
    }

    #[test]
    fn the_numbers_beside_a_picture_are_those_of_the_data() {
        let data = [(0.0, 0.123_456_7), (1.0, -0.25), (2.0, f64::NAN)];
        let page = Plot::new(&axes())
            .line("</script>", &data)
            .draw()
            .into_string();
        let read = numbers(&page);
        let y = &read["series"][0]["y"];
        for (k, (_, value)) in data.iter().enumerate() {
            match y[k].as_f64() {
                Some(written) => assert!((written - value).abs() <= 1e-5 * value.abs(), "{y}"),
                None => assert!(value.is_nan(), "{y}"),
            }
        }
        assert_eq!(read["series"][0]["name"], "</script>");
        assert_eq!(read["x"]["label"], "time, s");
    }

    #[test]
    fn a_point_lies_where_its_value_is() {
        let mut plot = Plot::new(&axes()).line("", &[(0.0, 0.0), (1.0, 0.5)]);
        let (x, y) = plot.scales();
        let page = plot.draw().into_string();
        let d = format!(
            "M{} {}L{} {}",
            short(x.place.start),
            short(0.5 * (y.place.start + y.place.end)),
            short(0.5 * (x.place.start + x.place.end)),
            short(0.25 * y.place.start + 0.75 * y.place.end)
        );
        assert!(page.contains(&d), "{d} in {page}");
    }

    #[test]
    fn what_is_not_there_breaks_a_curve() {
        let gap = [(0.0, 0.0), (0.5, f64::NAN), (1.0, 0.0)];
        let page = Plot::new(&axes()).line("", &gap).draw().into_string();
        let (_, data) = page.split_once("class=\"data\"").unwrap();
        let d = data.split_once(" d=\"").unwrap().1;
        assert_eq!(d.split_once('"').unwrap().0.matches('M').count(), 2);
    }

    #[test]
    fn every_curve_is_drawn_and_has_a_key() {
        let many: Vec<String> = (0..10).map(|k| format!("curve {k}")).collect();
        let plot = many.iter().fold(Plot::new(&axes()), |plot, name| {
            plot.line(name, &[(0.0, 0.0), (1.0, 1.0)])
        });
        let page = plot.draw().into_string();
        assert_eq!(page.matches("class=\"key\"").count(), 10);
        assert_eq!(page.matches("<g data-k=").count(), 10);
    }

    #[test]
    fn dark_is_dark_and_bright_is_bright() {
        let colour = Colour {
            low: 0.0,
            high: 4.0,
            label: String::new(),
            root: true,
        };
        assert_eq!(colour.shade(0.0), 0);
        assert_eq!(colour.shade(4.0), SHADES - 1);
        assert_eq!(colour.shade(1.0), 16);
        assert_eq!(colour.shade(f64::NAN), 0);
    }
}
