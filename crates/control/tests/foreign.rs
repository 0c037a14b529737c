//! How far what `find_peak` says of its peak holds on benches of another make than the twin's.

mod common;

use common::foreign::{Foreign, Make, makes};
use pigtail_control::align::find_peak;
use pigtail_hal::bench::{Group, Meter};

/// What came of some seeds.
#[derive(Default)]
struct Came {
    refused: usize,
    /// Errors in x and in y over the standard deviation that was said.
    errors: Vec<f64>,
    beside_nm: Vec<f64>,
    said_nm: Vec<f64>,
}

impl Came {
    fn of(make: &Make, seeds: std::ops::Range<u64>) -> Self {
        let recipe = common::recipe();
        let mut came = Self::default();
        for seed in seeds {
            let mut bench = Foreign::new(make.clone(), seed);
            let found = find_peak(&mut bench, Group(0), Meter(0), &recipe, 40e-6, None);
            let Ok(found) = found else {
                came.refused += 1;
                continue;
            };
            let peak = bench.peak();
            let off = [0, 1].map(|i| found.at[i] - peak[i]);
            came.errors.extend(off.map(|off| off / found.deviation));
            came.beside_nm.push(1e9 * off[0].hypot(off[1]));
            came.said_nm.push(1e9 * found.deviation);
        }
        came.beside_nm.sort_by(f64::total_cmp);
        came.said_nm.sort_by(f64::total_cmp);
        came
    }

    /// The share within 95 % intervals.
    fn covered(&self) -> f64 {
        let within = self.errors.iter().filter(|z| z.abs() < 1.96).count();
        within as f64 / self.errors.len() as f64
    }

    #[allow(
        clippy::print_stdout,
        reason = "what `--nocapture` shows are the book's figures"
    )]
    fn print(&self, name: &str) {
        let n = self.beside_nm.len();
        if n == 0 {
            println!("{name:28} refused {}", self.refused);
            return;
        }
        println!(
            "{name:28} refused {:3}  within 95 % {:5.1} %  beside {:5.1} nm, at most {:5.1}  said {:5.1} nm",
            self.refused,
            100.0 * self.covered(),
            self.beside_nm[n / 2],
            self.beside_nm[n - 1],
            self.said_nm[n / 2]
        );
    }
}

#[test]
fn a_peak_on_another_make_is_known_as_well_as_is_said() {
    for (name, make) in makes().into_iter().filter(|(name, _)| {
        [
            "usual",
            "noisy",
            "wider by a fifth",
            "lag, told wrongly by 3 ms",
        ]
        .contains(name)
    }) {
        let came = Came::of(&make, 5000..5040);
        came.print(name);
        assert!(came.refused <= 2, "{name}: {}", came.refused);
        // Of 80 less than 88 % within 95 % intervals: once in 200 times by chance.
        assert!(came.covered() > 0.88, "{name}: {}", came.covered());
    }
}

#[test]
#[ignore = "long: many seeds on many makes"]
fn peaks_on_many_makes_are_known_as_well_as_is_said() {
    for (name, make) in makes() {
        let came = Came::of(&make, 7000..7400);
        came.print(name);
        // A tip that wanders slower than it is watched is not seen to: the limit that the book names.
        if name == "shakes 20 nm, 200 ms" || came.errors.is_empty() {
            continue;
        }
        assert!(came.covered() > 0.93, "{name}: {}", came.covered());
        let worst = came
            .errors
            .iter()
            .fold(0.0_f64, |most, z| most.max(z.abs()));
        assert!(worst < 5.0, "{name}: {worst} standard deviations");
    }
}
