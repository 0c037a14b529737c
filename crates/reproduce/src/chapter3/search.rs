//! Fig. 3.3: the three searches for first light.

use super::super::picture::{Content, Picture, Points};
use super::super::{Bench, Figure};
use super::macro_raster::{self, Covered};
use pigtail_control::methods::{Method, Space};
use pigtail_evaluate::plan::search_row;
use pigtail_session::job::Ended;
use rayon::prelude::*;

pub(super) fn methods(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let rate = setup.rig.spec.photodiode.rate;
    let fine = |method| Space::new(method, &setup.rig.recipe);
    let coarse = |space: Space| Space {
        mesh: 2.0 * space.mesh,
        ..space
    };
    let [one, two, three] = Method::ALL.map(fine);
    let one_coarse = coarse(one);
    let one_fast = Space {
        frequency: one_coarse.fastest(rate),
        ..one_coarse
    };
    // The last takes as long as all of the rest together.
    let spaces = [three, one_coarse, two, one_fast, one];
    let rows = spaces[..bench.count(5, 2)]
        .par_iter()
        .with_max_len(1)
        .map(|space| search_row(setup, space, bench.seed))
        .collect::<Result<Vec<_>, _>>()?;
    let row = |k: usize| rows.get(k);
    let seconds = |k: usize| row(k).and_then(|r| r.measured_seconds).unwrap_or(f64::NAN);
    let note = |k: usize| row(k).map_or_else(String::new, |r| r.note.clone());
    let minutes = |k: usize| seconds(k) / 60.0;
    let meshes = [2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.5, 15.0, 20.0];
    let form = |space: Space| -> Points {
        meshes
            .iter()
            .map(|um| {
                let mesh = 1e-6 * um;
                (*um, Space { mesh, ..space }.closed_form())
            })
            .collect()
    };
    let measured: Points = (0..rows.len())
        .filter(|k| *k != 3)
        .map(|k| (rows[k].mesh_um, seconds(k)))
        .collect();
    let mut dots: Vec<(f64, f64, f64)> = measured.iter().map(|p| (p.0, p.1, 0.5)).collect();
    dots.sort_by(|a, b| a.1.total_cmp(&b.1));
    let curves = [
        ("method 1, (3.3)", form(one)),
        ("method 2, (3.4)", form(two)),
        ("method 3, (3.5)", form(three)),
    ];
    let by_macro = macro_raster::covered(bench)?;
    let orders = seconds(4) / 3.0 / seconds(0);
    let figure =
        Figure::new("3.3", "Proposed light coupling initialization methods")
            .picture(
                Picture::curves("mesh, um", "time, s", curves)
                    .x(0.0, 20.0)
                    .y(1.0, 1e5)
                    .log_y()
                    .caption("By the closed forms, at 8 Hz and for method 2 at 100 Hz."),
            )
            .picture(
                Picture::of("mesh, um", "time, s", Content::Dots(dots))
                    .x(0.0, 20.0)
                    .y(1.0, 1e5)
                    .log_y()
                    .caption(
                        "In which the twin covered the space: methods 3 and 2 at 5 um, method 1 at 10 um \
                         and at 5 um.",
                    ),
            )
            .result("3.3-speed", 1e6 * one.mesh * rate)
            .result("3.3-rate", one.fastest(rate))
            .result("3.3-method1", one.closed_form() / 60.0)
            .result("3.3-method1-coarse", one_coarse.closed_form() / 60.0)
            .result("3.3-method2", two.closed_form() / 60.0)
            .result("3.3-method2-fiber", two.closed_form() / 180.0)
            .result("3.3-photodiode", 1.02 * two.photodiode_rate())
            .result("3.3-faster", 1.02 * two.photodiode_rate() / rate)
            .result("3.3-method3", three.closed_form())
            .noted("3.3-method1-twin", minutes(4), note(4))
            .noted("3.3-method1-coarse-twin", minutes(1), note(1))
            .noted("3.3-method2-twin", minutes(2), note(2))
            .noted("3.3-method3-twin", seconds(0), note(0))
            .result("3.3-fourth", seconds(4) / seconds(3))
            .noted(
                "3.3-orders",
                orders,
                format!("{:.0} s and {:.1} s a fiber.", seconds(4) / 3.0, seconds(0)),
            )
            .remark(
                "The searches sweep with the micro and creep with the macro: a macro that swept 100 um \
                 back and forth would spend it winding up its transmissions.",
            );
    let figure = alone(figure, by_macro);
    Ok(vec![if bench.quick {
        figure.without(&[
            "3.3-method1-twin",
            "3.3-method2-twin",
            "3.3-fourth",
            "3.3-orders",
        ])
    } else {
        figure
    }])
}

/// The raster of the macro alone.
fn alone(figure: Figure, [plain, reversal, memory]: [Covered; 3]) -> Figure {
    figure
            .picture(
                Picture::curves(
                    "x, um",
                    "y, um",
                    [
                        ("without compensation", plain.path),
                        ("compensated", memory.path),
                    ],
                )
                .x(-80.0, 80.0)
                .y(-80.0, 80.0)
                .equal()
                .caption(format!(
                    "The macro's own raster of 100 um by 100 um, {:.1} times a second back and forth, by the probes.",
                    memory.hertz
                )),
            )
            .noted(
                "3.3-macro",
                memory.share,
                format!(
                    "With the model that remembers, {:.0} um off at most; with (2.20)-(2.26) {:.3} and {:.0} um. At \
                     {:.1} Hz.",
                    memory.error, reversal.share, reversal.error, memory.hertz
                ),
            )
            .noted(
                "3.3-macro-plain",
                plain.share,
                format!("{:.0} um off at most.", plain.error),
            )
}
