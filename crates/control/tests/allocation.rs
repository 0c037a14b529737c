//! A servo cycle asks nothing of the heap: a real machine's cycle has no time to wait for it.

mod common;

use common::{Obedient, calibration, spec};
use pigtail_control::station::{Observer, Sample, Station};
use pigtail_control::trajectory::{Arc, Shape};
use pigtail_hal::Side;
use pigtail_model::frames::{Displacement, Point};

struct Counting(usize);

impl Observer for Counting {
    fn phase(&mut self, _: &str, _: &'static str, _: f64) {}
    fn sample(&mut self, _: &Sample) {
        self.0 += 1;
    }
}

#[test]
fn a_cycle_of_both_manipulators_allocates_nothing() {
    let spec = spec();
    let calibration = calibration(&spec);
    let mut machine = Obedient::new(spec);
    let mut observer = Counting(0);
    let mut cycles = 0;
    {
        let mut station =
            Station::new(&mut machine, &calibration, &mut observer).expect("no fault");
        for shape in [Shape::Trapezoid, Shape::SCurve] {
            station.set_shape(shape);
            let here = station.wanted(Side::Left);
            let arc = Arc::about(here, [here.x + 2e-3, here.y], 4.0, 1e-3);
            station.start_arc(Side::Left, arc, None).expect("it fits");
            let to = Point::new(
                3e-3,
                4e-3,
                if shape == Shape::SCurve { -5e-3 } else { 5e-3 },
            );
            station.start_line(Side::Right, to, None).expect("it fits");
            let info = allocation_counter::measure(|| {
                while station.moving(Side::Left) || station.moving(Side::Right) {
                    let way = 1e-8 * f64::from(cycles % 1000);
                    station.move_micro(Side::Left, Displacement::new(way, -way));
                    station.move_micro(Side::Right, Displacement::new(-way, way));
                    station.cycle().expect("no fault");
                    cycles += 1;
                }
            });
            assert_eq!(info.count_total, 0, "{shape:?}");
        }
    }
    assert!(cycles > 2000, "{cycles} cycles are no test");
    assert!(observer.0 > 400, "{} light samples are no test", observer.0);
    let counted = allocation_counter::measure(|| drop(std::hint::black_box(vec![1_u8])));
    assert_eq!(counted.count_total, 1, "the counter counts");
}
