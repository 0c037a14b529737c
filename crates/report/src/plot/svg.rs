//! A picture as SVG: where axes lie, ticks and their grid, what is drawn of numbers, marks, and the colour bar.

use super::{CROSS, Colour, Kind, Plot, SHADES, Series};
use crate::figure::HALF;
use crate::scale::Scale;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write as _;

/// Room above the picture for the name of the upward axis, and below for the other one.
const ABOVE: f64 = 28.0;
pub(super) const BELOW: f64 = 50.0;
/// Room at the right: for half of a number, or for the colour bar.
const RIGHT: f64 = 20.0;
const BAR: f64 = 86.0;
/// Width of a character, in units of the picture, of the largest text that the style gives.
const CHARACTER: f64 = 9.0;

impl Plot {
    /// Where the axes lie in the picture; with one scale for both they are made longer.
    pub(super) fn scales(&mut self) -> (Scale, Scale) {
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
    pub(in super::super) fn draw(mut self) -> Markup {
        let (x, y) = self.scales();
        let size = match (self.width > HALF, &self.colour) {
            (true, None) => "chart whole",
            (false, None) => "chart half",
            (true, Some(_)) => "chart whole map",
            (false, Some(_)) => "chart half map",
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
        // Names of lines across stand at the right, but at the left where lines upward have theirs.
        let upward = self.marks.iter().any(|mark| mark.axis == 'x');
        let (side, anchor_across) = if upward {
            (left + 5.0, "start")
        } else {
            (right - 5.0, "end")
        };
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
                    "<text class=\"{class}\" x=\"{side:.1}\" y=\"{:.1}\" text-anchor=\"{anchor_across}\">{}</text>",
                    if at - top < 20.0 { at + 15.0 } else { at - 5.0 },
                    escaped(&mark.name)
                );
            }
        }
    }
}

/// Points of a curve that lie nearer than this, in units of the picture, are drawn once.
const NEAR: f64 = 0.25;

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
pub(super) fn short(value: f64) -> String {
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
