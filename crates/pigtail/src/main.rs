use pigtail::rig::Setup;
use pigtail_control::{
    procedure,
    station::{Station, Unobserved},
};
fn main() {
    let n: u64 = std::env::args().nth(1).map_or(5, |a| a.parse().unwrap());
    let setup = Setup::load("afpm", "y-branch").unwrap_or_else(|e| {
        eprintln!("{e}");
        std::process::exit(2)
    });
    let t0 = std::time::Instant::now();
    let mut mt = 0.0;
    for seed in 0..n {
        let mut twin = pigtail_machines::Twin::new(setup.spec.clone(), &setup.plant, seed).unwrap();
        let mut obs = Unobserved;
        let mut station = Station::new(&mut twin, &setup.calibration, &mut obs).unwrap();
        let r = procedure::thesis(&mut station, &setup.recipe).unwrap();
        mt += station.time();
        let truth = twin.truth();
        let ts = [truth.input, truth.outputs[0], truth.outputs[1]];
        for (f, t) in r.iter().zip(ts) {
            print!("{seed} {} {:.1}s ", f.port, f.seconds());
            for (n, s) in &f.phases {
                print!("{n} {s:.1} ");
            }
            if let Some(t) = t {
                print!(
                    "| x {:.3} y {:.3} gap {:.2} um {:.2} dB",
                    t.x * 1e6,
                    t.y * 1e6,
                    t.gap * 1e6,
                    -10.0 * t.coupling.log10()
                );
            }
            println!(" {}", f.outcome);
        }
        println!("   smallest gap {:.1}", truth.smallest_gap * 1e6);
    }
    let w = t0.elapsed().as_secs_f64();
    println!("machine {mt:.1} s wall {w:.2} s x{:.0}", mt / w);
}
