//! Chapter 3: path planning.

use super::Basis::{Calibrated, Definition, Doubtful, Prediction};
use super::Kind::{Above, Below, Factor, Formula, Measured};
use super::{Statement, claim};

const MODES_ARE_GAUSSIAN: &str = "the twin's light is the overlap of Gaussian modes";
const MODES: &str = "mode_radius of fiber and device in plant.toml: half of the printed core, for no mode is printed";
const TILT: &str = "mode_radius and misplacement.tilt in plant.toml and the recipe's approach.gap: none is printed";
const CLOSED_FORM: &str = "a formula of the thesis with its own numbers";
const TIMETABLE: &str = "the search goes by a timetable, the formula's lines at the formula's rate; the twin adds what \
    turning takes, 0 to 9 %";
const SENSING: &str = "the recipe's sensing.speed, 300 um/s: the thesis prints none";
const RASTER: &str =
    "the recipe's sensing.speed, raster.margin and raster.overscan: none is printed";
const BRISK: &str =
    "the speed in z, in this experiment alone three quarters of what the climb can follow";
const APPROACH: &str =
    "the recipe's approach.speed, 5.5 um/s, half of all of the time: the thesis prints none";
const LATERAL: &str = "the recipe's final.patterns and final.accuracy are set for this tolerance";
const GAP: &str = "the recipe's approach.frames and approach.gap are set for this tolerance; machine.toml's \
    vision.accuracy_z is 0.5 um, where the thesis prints 2 um for its vision";
const FAST: &str =
    "the fast procedure and the recipe's [fast], which were worked on for short times";

pub(super) const CLAIMS: &[Statement] = &[
    claim(
        "3.2-gaussian",
        ("3.1", "the profile is a smooth Gaussian like function"),
        "R2 of a Gaussian through the light around the peak",
        (0.95, "", Above),
        Definition(MODES_ARE_GAUSSIAN),
    ),
    claim(
        "3.2-radius",
        (
            "3.2",
            "Outside of the 5um radii negligible light coupling exists",
        ),
        "light 5 um aside over that at the peak; negligible is a twentieth",
        (0.05, "", Below),
        Doubtful(MODES),
    ),
    claim(
        "3.2-loss",
        (
            "3.1",
            "to reduce coupling losses to acceptable levels (11 %) ... 2um in z and 0.1um in x and y",
        ),
        "loss of a fiber that is off by all of these and tilted by the fixture's most",
        (0.11, "", Below),
        Doubtful(TILT),
    )
    .simulated(),
    claim(
        "3.2-pair-gap",
        ("3.2", "For this reason the z distance between the fibers and the chip had to be within 50um"),
        "gap up to which light of a pair that is 5 um off is told from noise",
        (50.0, "um", Measured),
        Prediction,
    )
    .because(63.1, "A pair that is 5 um off is at the edge of what is seen at all: with a fifth more noise (6 mV in place \
        of 5 mV) none is seen at any gap. Neither the noise nor what counted as light is printed.")
    .simulated(),
    claim(
        "3.2-single",
        ("3.2", "the tolerances are higher for coupling two fibers at once compared to single fiber coupling"),
        "how far aside one fiber may be over how far both may, at 50 um",
        (1.0, "", Above),
        Prediction,
    )
    .simulated(),
    claim(
        "3.2-back",
        ("3.2", "for single fiber coupling it is possible to move backward in z to decrease alignment tolerances"),
        "how far aside one fiber may be at 100 um over that at 50 um",
        (1.0, "", Above),
        Prediction,
    )
    .simulated(),
    claim(
        "3.3-speed",
        ("3.2", "(3.1): v = 5um / (1/500 s-1) = 2500um/s"),
        "fastest sweep at which a sample falls into each mesh",
        (2500.0, "um/s", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-rate",
        ("3.2", "(3.2): f = v / (2 pi A) = 8Hz"),
        "scan rate of that speed over 100 um",
        (8.0, "Hz", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-macro",
        ("3.2.1", "the macro manipulator scans a Cartesian pattern of the input side"),
        "share of the mesh that the macro's own raster covers, windup compensated; a scan covers above 0.95",
        (0.95, "", Above),
        Prediction,
    ),
    claim(
        "3.3-macro-plain",
        ("2.4", "the position of the endpoint was highly path dependent which made trajectory planning ... more difficult"),
        "the same without compensation; difficult is below 0.95",
        (0.95, "", Below),
        Prediction,
    ),
    claim(
        "3.3-method1",
        (
            "3.2.1",
            "For a scan rate of 8 Hz with the required range and mesh spacing this method takes 67 minutes",
        ),
        "method 1 by (3.3), 5 um",
        (67.0, "min", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-method1-coarse",
        (
            "3.2.1",
            "Even with an unreliable grid spacing of 10um the process still takes 8.3 minutes",
        ),
        "method 1 by (3.3), 10 um",
        (8.3, "min", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-method2",
        (
            "3.2.1",
            "At the increased scanning rate the space can be covered in 5.3 minutes",
        ),
        "method 2 by (3.4), 5 um",
        (5.3, "min", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-method2-fiber",
        (
            "3.2.1",
            "only once per device this amounts to 1.8 minutes per fiber",
        ),
        "a third of it",
        (1.8, "min", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-photodiode",
        (
            "3.2.1",
            "it is necessary to increase the photodiode sampling rate ... to 6250 Hz",
        ),
        "slowest photodiode for 100 Hz over 100 um at 5 um",
        (6250.0, "Hz", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-faster",
        (
            "3.2.1",
            "increase the photodiode sampling rate by a factor of 12.5",
        ),
        "the same over the rate of the photodiodes",
        (12.5, "", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-method3",
        (
            "3.2.1",
            "For a scan rate of 8 Hz the time required is 5 seconds per fiber",
        ),
        "method 3 by (3.5), 5 um",
        (5.0, "s", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.3-method1-twin",
        ("3.2.1", "this method takes 67 minutes"),
        "method 1 on the twin, all of its space",
        (67.0, "min", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "3.3-method1-coarse-twin",
        (
            "3.2.1",
            "Even with an unreliable grid spacing of 10um the process still takes 8.3 minutes",
        ),
        "the same at 10 um",
        (8.3, "min", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "3.3-method2-twin",
        ("3.2.1", "the space can be covered in 5.3 minutes"),
        "method 2 on the twin with faster photodiodes",
        (5.3, "min", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "3.3-method3-twin",
        ("3.2.1", "the time required is 5 seconds per fiber"),
        "method 3 on the twin, the whole area of a fiber",
        (5.0, "s", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "3.3-fourth",
        (
            "3.2.1",
            "the time required varies as the fourth power of the number of mesh points per axis",
        ),
        "method 1 on the twin at 5 um over that at 10 um, each as fast as the photodiode allows",
        (16.0, "", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "3.3-orders",
        (
            "abstract",
            "This method is shown to reduce the time required by over two orders of magnitude",
        ),
        "a fiber by method 1 on the twin over one by method 3",
        (100.0, "", Above),
        Definition(TIMETABLE),
    ),
    claim(
        "3.4-height",
        (
            "3.2.2",
            "At this point the multimode is within 50um of the output location in the y direction",
        ),
        "greatest distance in y of the sensing fiber from where the output fiber was aligned",
        (50.0, "um", Below),
        Prediction,
    ),
    claim(
        "3.4-core",
        ("3.2.2", "It was found that a core diameter of 100um provided the best compromise"),
        "core of 30, 50, 100, 200 and 400 um that aligns most fibers, of equals the fastest",
        (100.0, "um", Measured),
        Prediction,
    )
    .because(200.0, "The trade-off is there: with 30 um a fourth of the fibers find no light (45 of 180), and with 400 um, in which \
        sixteen times the scattered light of 100 um falls, none does. From 50 um to 200 um all are aligned, and of \
        these the widest takes the least time, for its placement hardly matters: 180 of 180 each, in 9.6, 8.3 and 7.8 s (60 \
        devices from seed 0). Control measures scattered light and its fluctuation before it looks for the input; how the thesis \
        told the input's light from it is not printed."),
    claim(
        "3.4-time",
        (
            "3.2.2",
            "This method was found to be robust ... The time required was under 5s",
        ),
        "longest time in which the sensing fiber found the top",
        (5.0, "s", Below),
        Doubtful(SENSING),
    ),
    claim(
        "3.5-period",
        (
            "3.3",
            "time delays ... 4ms which corresponds to an oscillation period of 25Hz",
        ),
        "patterns of nine points and a pause in a second",
        (25.0, "Hz", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.5-closed",
        (
            "3.3",
            "step size is chosen to be 0.1um which allows a maximum tracking rate of 2.5um/s",
        ),
        "a step a pattern",
        (2.5, "um/s", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "3.5-dwell",
        ("3.3", "The optimal time delays were determined experimentally to be 4ms"),
        "fastest drift followed with the best of 2, 8 and 16 ms over that with 4 ms",
        (1.0, "", Below),
        Prediction,
    )
    .because(2.0, "Here a steady drift is followed at a step a pattern down to the photodiode's own period, 2 ms, and \
        with a micro of half the resonance (100 Hz) as well: it need not come to rest for that. With one of 60 Hz and \
        2 ms the patterns that are averaged in the end find no peak. What made 4 ms the best there is not printed."),
    claim(
        "3.5-step-tracking",
        ("3.3", "As the step size is decreased ... the tracking performance decreases"),
        "fastest drift followed with half of the step over that with the step",
        (1.0, "", Below),
        Prediction,
    ),
    claim(
        "3.5-step-time",
        ("3.3", "As the step size is decreased beyond a certain point, the maximization time increases"),
        "time of the climb with half of the step over that with the step",
        (1.0, "", Above),
        Prediction,
    ),
    claim(
        "3.5-tracking",
        ("3.3", "a maximum tracking rate of 2.5um/s"),
        "fastest drift that was followed on the twin",
        (2.5, "um/s", Measured),
        Prediction,
    ),
    claim(
        "3.5-macro",
        (
            "3.3",
            "allows the micro to reject low frequency disturbances such as movement of the macro",
        ),
        "mean light while the macro goes 10 um over that before, the climb going on",
        (0.5, "", Above),
        Prediction,
    ),
    claim(
        "3.5-creep",
        ("3.3", "and drifting of the piezoelectric actuators"),
        "mean light over 20 s of creep over that before, the climb going on",
        (0.5, "", Above),
        Prediction,
    ),
    claim(
        "3.5-xy",
        (
            "3.3",
            "a complete x-y alignment could be performed in less than 5s",
        ),
        "mean time of the climb",
        (5.0, "s", Below),
        Prediction,
    ),
    claim(
        "budget-coupling",
        (
            "3.2.2",
            "The time required to initiate light coupling ... amounts to 6.7s per fiber",
        ),
        "mean time of sensing fiber and raster",
        (6.7, "s", Measured),
        Doubtful(RASTER),
    ),
    claim(
        "budget-z",
        (
            "3.3",
            "The maximization in the z direction can be accomplished in less than 10s",
        ),
        "mean time of approach and final maximization",
        (10.0, "s", Below),
        Calibrated(BRISK),
    ),
    claim(
        "budget-all",
        ("3.4", "the time required for alignment is 21.7 s/fiber"),
        "mean time a fiber, once placed",
        (21.7, "s", Measured),
        Doubtful(APPROACH),
    ),
    claim(
        "budget-required",
        ("3.4", "This is well within the required time of 90s"),
        "longest time a fiber, placing and all",
        (90.0, "s", Below),
        Doubtful(APPROACH),
    ),
    claim(
        "budget-lateral",
        (
            "3.1",
            "the fibers must be aligned with an accuracy of ... 0.1um in the x and y directions",
        ),
        "greatest true error in x or y",
        (0.1, "um", Below),
        Calibrated(LATERAL),
    ),
    claim(
        "budget-gap",
        (
            "3.1",
            "the fibers must be aligned with an accuracy of 2um in the z direction",
        ),
        "greatest true error in z",
        (2.0, "um", Below),
        Calibrated(GAP),
    ),
    claim(
        "budget-scan",
        (
            "3.4",
            "a scan rate of 40 Hz ... would decrease the time required by a factor of 5",
        ),
        "(3.5) at 8 Hz over (3.5) at what a photodiode five times as fast allows",
        (5.0, "", Formula),
        Definition(CLOSED_FORM),
    )
    .computed(),
    claim(
        "budget-photodiodes",
        ("3.4", "If the sampling rate can be increased by a factor of 5 ... decrease the time required by a factor of 5"),
        "method 3 on the twin over the same with photodiodes five times as fast, at 40 Hz",
        (5.0, "", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "budget-micro",
        ("3.4", "If the bandwidth could be doubled ... the time required would drop by a factor of two"),
        "time of the climb over that with a micro of twice the resonance and half the delays",
        (2.0, "", Factor),
        Prediction,
    ),
    claim(
        "budget-vary",
        ("3.4", "Using variable step sizes in the hill climbing could also improve performance perhaps by a factor of two"),
        "time of the climb over that with steps that vary eightfold",
        (2.0, "", Factor),
        Prediction,
    ),
    claim(
        "budget-half",
        (
            "3.4",
            "If the area to be scanned could be reduced by a half, the time required would decrease by a factor of 2",
        ),
        "method 3 on the twin over the same of half the height",
        (2.0, "", Measured),
        Definition(TIMETABLE),
    ),
    claim(
        "budget-better",
        ("3.4", "the alignment time could be reduced to 3.2s"),
        "mean time a fiber by the fast procedure, once placed",
        (3.2, "s", Below),
        Doubtful(FAST),
    ),
];
