//! What the store of runs takes of a run: its folder and entry, the phases of three fibers, the hash
//! of a report and the seal.

use criterion::{Criterion, criterion_group, criterion_main};
use pigtail_store::runs::Run;

/// Phases of a device by the fast procedure.
const PHASES: u32 = 16;
/// Bytes of a run's report and samples.
const REPORT: usize = 400_000;

fn store(c: &mut Criterion) {
    let folder = tempfile::TempDir::new().expect("a folder");
    let report = vec![b'x'; REPORT];
    let read: Vec<_> = (0..4)
        .map(|k| (format!("file {k}"), "0".repeat(64)))
        .collect();
    let mut seed = 0;
    c.bench_function("a run entered, 16 phases", |b| {
        b.iter(|| {
            // A new name each time, or every run would look for a free one among the others.
            seed += 1;
            let run = Run::begin(folder.path(), "align", seed, &read).expect("a run");
            for phase in 0..PHASES {
                run.phase("input", "coarse", f64::from(phase), 0.5)
                    .expect("it is entered");
            }
            run.write("report.html", &report).expect("a file");
            run.finish("aligned").expect("it is entered");
        });
    });
}

criterion_group!(benches, store);
criterion_main!(benches);
