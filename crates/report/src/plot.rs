//! Pictures as SVG, and beside them what is in them as JSON.
//!
//! The picture is whole without a script, and on paper. With one (`chart.js`, which stands in the page once), a
//! reader zooms, reads values at a cursor and switches curves off; it draws from the JSON and asks for nothing else,
//! so that a page which gets its numbers while it is open can hand them to the same script.

use super::figure::Axes;
use super::scale::Scale;
use maud::{Markup, PreEscaped, html};
use serde::Serialize;
use std::fmt::Write as _;

/// Colours of which a map is made; as many paths stand in the SVG.
const SHADES: usize = 32;
/// Colours of curves: classes `c0` to `c7` of the style.
const COLOURS: usize = 8;
/// Room above the picture for the name of the upward axis, and below for the other one.
const ABOVE: f64 = 28.0;
const BELOW: f64 = 50.0;
/// Room at the right: for half of a number, or for the colour bar.
const RIGHT: f64 = 20.0;
const BAR: f64 = 86.0;
/// Width of a character, in units of the picture, of the largest text that the style gives.
const CHARACTER: f64 = 9.0;

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
        self.height = BELOW as u32 + 20 + 34 * names.len() as u32;
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

    /// Where the axes lie in the picture; with one scale for both they are made longer.
    fn scales(&mut self) -> (Scale, Scale) {
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let right = if self.colour.is_some() { BAR } else { RIGHT };
        let mut y = Scale {
            ends: self.y.from..self.y.to,
            place: height - BELOW..ABOVE,
            log: self.y.log,
        };
        let longest = |texts: &mut dyn Iterator<Item = usize>| texts.max().unwrap_or(0) as f64;
        let left = if self.equal {
            7.0
        } else if self.y.names.is_empty() {
            let ticks = y.ticks(TICKS_Y, self.y.whole);
            longest(&mut ticks.iter().map(|t| t.1.len())).max(3.0)
        } else {
            longest(&mut self.y.names.iter().map(String::len))
        };
        let left = (12.0 + CHARACTER * left).min(0.4 * width);
        if self.equal {
            let (w, h) = (width - right - left, height - BELOW - ABOVE);
            let unit = ((self.x.to - self.x.from) / w).max((self.y.to - self.y.from) / h);
            for (axis, room) in [(&mut self.x, w), (&mut self.y, h)] {
                let middle = 0.5 * (axis.from + axis.to);
                (axis.from, axis.to) = (middle - 0.5 * unit * room, middle + 0.5 * unit * room);
            }
            y.ends = self.y.from..self.y.to;
        }
        let x = Scale {
            ends: self.x.from..self.x.to,
            place: left..width - right,
            log: self.x.log,
        };
        (x, y)
    }

    /// The picture, its legend and its numbers.
    pub(super) fn draw(mut self) -> Markup {
        let (x, y) = self.scales();
        let size = if self.width > super::figure::HALF {
            "chart whole"
        } else {
            "chart half"
        };
        // What colours mean stands at their bar.
        let keyed = |s: &&Series| !s.name.is_empty() && s.v.is_empty();
        let crossed = self.series.iter().any(|s| s.class == CROSS);
        let named = self.series.iter().filter(keyed).count() + usize::from(crossed);
        let view = format!("0 0 {} {}", self.width, self.height);
        let frame = format!(
            "{:.1} {:.1} {:.1} {:.1}",
            x.place.start, y.place.end, x.place.end, y.place.start
        );
        let numbers = serde_json::to_string(&self).unwrap_or_default();
        html! {
            div class=(size) data-frame=(frame) {
                svg viewBox=(view) role="img" aria-label=(format!("{} against {}", self.y.label, self.x.label)) {
                    (PreEscaped(self.svg(&x, &y)))
                }
                @if named > 1 {
                    div.keys {
                        @for (k, s) in self.series.iter().enumerate() {
                            @if !s.name.is_empty() && s.v.is_empty() {
                                span.key data-k=(k) { i class={ (s.class) " " (kind(s.kind)) } {} (s.name) }
                            }
                        }
                    }
                }
                // What could end the block early is written otherwise.
                script type="application/json" { (PreEscaped(numbers.replace('<', "\\u003c"))) }
            }
        }
    }

    fn svg(&self, x: &Scale, y: &Scale) -> String {
        let mut svg = String::new();
        let (left, right, top, bottom) = (x.place.start, x.place.end, y.place.end, y.place.start);
        let _ = write!(
            svg,
            "<rect class=\"plot\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            right - left,
            bottom - top
        );
        svg += "<g class=\"bands\">";
        for (k, band) in self.bands.iter().enumerate() {
            let (from, to) = (x.at(band.from), x.at(band.to));
            if k % 2 == 0 {
                let _ = write!(svg, "<path d=\"{}\"/>", rectangle([from, top, to, bottom]));
            }
        }
        svg += "</g><g class=\"axes\">";
        self.grid(&mut svg, x, y);
        // What lies beyond the axes is cut off by a picture within the picture.
        let _ = write!(
            svg,
            "</g><svg class=\"data\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" viewBox=\"{left:.1} {top:.1} \
             {:.1} {:.1}\">",
            right - left,
            bottom - top,
            right - left,
            bottom - top
        );
        for (k, series) in self.series.iter().enumerate() {
            self.series(&mut svg, k, series, x, y);
        }
        svg += "</svg><g class=\"marks\">";
        self.marks(&mut svg, x, y);
        svg += "</g>";
        let _ = write!(
            svg,
            "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text class=\"label\" x=\"4\" y=\"16\">{}</text>",
            0.5 * (left + right),
            f64::from(self.height) - 8.0,
            escaped(&self.x.label),
            escaped(&self.y.label)
        );
        if let Some(colour) = &self.colour {
            bar(&mut svg, colour, right + 14.0, y);
        }
        svg
    }

    fn grid(&self, svg: &mut String, x: &Scale, y: &Scale) {
        let (left, right, top, bottom) = (x.place.start, x.place.end, y.place.end, y.place.start);
        for (value, text) in x.ticks(TICKS_X, self.x.whole) {
            let at = x.at(value);
            let _ = write!(svg, "<path d=\"M{at:.2} {bottom:.1}V{top:.1}\"/>");
            if !text.is_empty() {
                let _ = write!(
                    svg,
                    "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>",
                    bottom + 18.0
                );
            }
        }
        let rows = self.y.names.iter().enumerate();
        let ticks = if self.y.names.is_empty() {
            y.ticks(TICKS_Y, self.y.whole)
        } else {
            rows.map(|(k, name)| (k as f64, escaped(name))).collect()
        };
        for (value, text) in ticks {
            let at = y.at(value);
            if self.y.names.is_empty() {
                let _ = write!(svg, "<path d=\"M{left:.1} {at:.2}H{right:.1}\"/>");
            }
            if !text.is_empty() {
                let _ = write!(
                    svg,
                    "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
                    left - 7.0,
                    at + 4.5
                );
            }
        }
    }

    fn series(&self, svg: &mut String, k: usize, s: &Series, x: &Scale, y: &Scale) {
        let place = |i: usize| -> String {
            let (px, py) = (x.at(s.x[i]), y.at(s.y[i]));
            match s.kind {
                Kind::Line => format!("{} {}", short(px), short(py)),
                Kind::Dots if s.class == CROSS => {
                    format!("M{} {}h14m-7 -7v14", short(px - 7.0), short(py))
                }
                Kind::Dots => format!("M{} {}h0", short(px), short(py)),
                Kind::Boxes => rectangle([px, py, x.at(s.x1[i]), y.at(s.y1[i])]),
            }
        };
        let shown = |i: &usize| {
            let seen = |scale: &Scale, v: f64| v.is_finite() && (!scale.log || v > 0.0);
            seen(x, s.x[*i]) && seen(y, s.y[*i])
        };
        let _ = write!(
            svg,
            "<g data-k=\"{k}\" class=\"{} {}\">",
            kind(s.kind),
            s.class
        );
        let all = 0..s.x.len();
        match &self.colour {
            Some(colour) if !s.v.is_empty() => {
                let mut shades = vec![String::new(); SHADES];
                for i in all.filter(shown) {
                    shades[colour.shade(s.v[i])] += &place(i);
                }
                // Bright ones on top.
                for (shade, d) in shades.iter().enumerate().filter(|(_, d)| !d.is_empty()) {
                    let name = if s.kind == Kind::Boxes {
                        "fill"
                    } else {
                        "stroke"
                    };
                    let _ = write!(
                        svg,
                        "<path data-v=\"{shade}\" {name}=\"{}\" d=\"{d}\"/>",
                        viridis(shade as f64 / (SHADES - 1) as f64)
                    );
                }
            }
            _ => {
                let mut d = String::new();
                // Where the pen is; `None` where it is up.
                let mut pen: Option<(f64, f64)> = None;
                let last = s.x.len().saturating_sub(1);
                for i in all {
                    if !shown(&i) {
                        pen = None;
                        continue;
                    }
                    if s.kind == Kind::Line {
                        let at = (x.at(s.x[i]), y.at(s.y[i]));
                        // What nobody could see apart is in the numbers alone.
                        let near =
                            |p: (f64, f64)| (p.0 - at.0).abs().max((p.1 - at.1).abs()) < NEAR;
                        if i != last && pen.is_some_and(near) {
                            continue;
                        }
                        d.push(if pen.is_some() { 'L' } else { 'M' });
                        pen = Some(at);
                    }
                    d += &place(i);
                }
                let _ = write!(svg, "<path d=\"{d}\"/>");
            }
        }
        svg.push_str("</g>");
    }

    fn marks(&self, svg: &mut String, x: &Scale, y: &Scale) {
        let (left, right, top, bottom) = (x.place.start, x.place.end, y.place.end, y.place.start);
        for band in &self.bands {
            let (from, to) = (x.at(band.from), x.at(band.to));
            // A name that does not fit into its stretch would run into the next one.
            if to - from > CHARACTER * band.name.len() as f64 + 6.0 {
                let _ = write!(
                    svg,
                    "<text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                    from + 4.0,
                    top + 15.0,
                    escaped(&band.name)
                );
            }
        }
        for (k, mark) in self.marks.iter().enumerate() {
            let (scale, across) = if mark.axis == 'x' {
                (x, true)
            } else {
                (y, false)
            };
            let at = scale.at(mark.at);
            let (low, high) = if across { (left, right) } else { (top, bottom) };
            if !(low..=high).contains(&at) {
                continue;
            }
            let class = mark.class;
            if across {
                let _ = write!(
                    svg,
                    "<path class=\"{class}\" d=\"M{at:.2} {bottom:.1}V{top:.1}\"/>"
                );
                // Names of marks that lie side by side go one below the other, and never out of the picture.
                let out = at + CHARACTER * mark.name.len() as f64 + 6.0 > right;
                let (anchor, aside) = if out { ("end", -5.0) } else { ("start", 5.0) };
                let row = f64::from(u32::from(!self.bands.is_empty())) + (k % 4) as f64;
                let _ = write!(
                    svg,
                    "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
                    at + aside,
                    top + 15.0 + 17.0 * row,
                    escaped(&mark.name)
                );
            } else {
                let _ = write!(
                    svg,
                    "<path class=\"{class}\" d=\"M{left:.1} {at:.2}H{right:.1}\"/>"
                );
                let _ = write!(
                    svg,
                    "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                    right - 5.0,
                    if at - top < 20.0 { at + 15.0 } else { at - 5.0 },
                    escaped(&mark.name)
                );
            }
        }
    }
}

/// Points of a curve that lie nearer than this, in units of the picture, are drawn once.
const NEAR: f64 = 0.25;
/// The class of a cross.
const CROSS: &str = "cross";

/// Distances between numbers at an axis, in units of the picture.
const TICKS_X: f64 = 82.0;
const TICKS_Y: f64 = 42.0;

/// The colour bar at the right of the picture.
fn bar(svg: &mut String, colour: &Colour, left: f64, y: &Scale) {
    let (top, bottom) = (y.place.end, y.place.start);
    let size = (bottom - top) / SHADES as f64;
    for shade in 0..SHADES {
        let from = bottom - size * shade as f64;
        let _ = write!(
            svg,
            "<path fill=\"{}\" d=\"{}\"/>",
            viridis(shade as f64 / (SHADES - 1) as f64),
            // Half a unit of the next one lies below, so that no gap shines through.
            rectangle([left, from, left + 12.0, (from - size - 0.5).max(top)])
        );
    }
    let scale = Scale {
        ends: colour.low..colour.high,
        place: bottom..top,
        log: false,
    };
    let mut last = f64::INFINITY;
    for (value, text) in scale.ticks(TICKS_Y, false) {
        let share = (value - colour.low) / (colour.high - colour.low);
        let share = if colour.root {
            share.max(0.0).sqrt()
        } else {
            share
        };
        let at = bottom - share * (bottom - top);
        // The square root brings numbers together at the top.
        if last - at < 18.0 {
            continue;
        }
        last = at;
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\">{text}</text>",
            left + 17.0,
            at + 4.5
        );
    }
    let _ = write!(
        svg,
        "<text class=\"label\" x=\"{:.1}\" y=\"16\" text-anchor=\"end\">{}</text>",
        left + BAR - 18.0,
        escaped(&colour.label)
    );
}

fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Line => "line",
        Kind::Dots => "dots",
        Kind::Boxes => "boxes",
    }
}

/// A coordinate to a hundredth of a unit, which no zoom of a page shows.
fn short(value: f64) -> String {
    let text = format!("{:.2}", value.clamp(-1e5, 1e5));
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn rectangle([x0, y0, x1, y1]: [f64; 4]) -> String {
    format!(
        "M{} {}H{}V{}H{}Z",
        short(x0),
        short(y0),
        short(x1),
        short(y1),
        short(x0)
    )
}

fn escaped(text: &str) -> String {
    html! { (text) }.into_string()
}

/// The colours of maps from dark to bright, 0 to 1, told apart also in grey; the last bit of yellow would not be seen on
/// white. Between the nine that `matplotlib` prints of its *viridis* they are straight.
fn viridis(share: f64) -> String {
    const KNOTS: [[f64; 3]; 9] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
        [253.0, 231.0, 37.0],
    ];
    let at = 0.96 * share.clamp(0.0, 1.0) * (KNOTS.len() - 1) as f64;
    let k = (at as usize).min(KNOTS.len() - 2);
    let part = at - k as f64;
    let mix = |i: usize| (KNOTS[k][i] + part * (KNOTS[k + 1][i] - KNOTS[k][i])).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
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
