//! Circles around a peak, and what their light tells.

use super::topic;

topic! {
    /// Circles around a peak.
    pub struct Circle in "circle", shown [Fast, Bench] {
        /// Standard deviations by which a peak must stand out of the noise.
        significant: f64 = 5.0, "sigma", Choice;
        /// By which light may be that of a peak that more turns make stand out: noise seldom makes so much of a turn.
        perhaps: f64 = 2.0, "sigma", Choice;
        /// How far a peak may be from where it was first believed to be.
        far: f64 = 4.0, "widths", Choice;
        /// The same at the chip, which a fiber that strays would touch.
        nearby: f64 = 1.2, "widths", Choice;
        /// How near the peak the turns that count must be, and the middle of the circles that have found one.
        near: f64 = 0.15, "widths", Choice;
        /// How near to it whoever looks from there for something else, or goes on from there to another gap.
        centred: f64 = 0.1, "widths", Choice;
        /// In what part of a turn a circle becomes smaller.
        shrink: f64 = 0.3, "turns", Choice;
        /// In what part of a turn its middle goes over to a new place.
        glide: f64 = 0.25, "turns", Choice;
        /// Light on a turn, at least: fewer do not tell a peak from what is around it.
        samples: f64 = 10.0, "samples", Choice;
        /// A gap that is told anew so little different is the same.
        same: f64 = 1e-9, "m", Choice;
        /// How far a circle goes that looks for light around a place: what is seen on the way there does not count.
        around: f64 = 1.25, "turns", Choice;
        /// What of a spot's being oblong along the piezos is none of their strokes', one standard deviation: modes that are oblong
        /// askew, a loop that is not as its model has it.
        oblong: f64 = 0.03, "1", Choice;
        /// No spot is believed to be more so in one turn.
        most_oblong: f64 = 0.6, "1", Choice;
        /// How far a circle's middle goes in a turn, at most.
        stride: f64 = 1.2, "widths", Choice;
        /// Of how many standard deviations of a peak's place a way there must be to tell how much farther away it was seen than it is.
        tells: f64 = 10.0, "sigma", Choice;
        /// No peak is believed to be seen more times as far away as it is.
        farther: f64 = 4.0, "1", Choice;
        /// Seen askew by more than a sixth of a turn a peak is run after for ever: turns are made slower that see it so by nearly as much.
        askew: f64 = 1.0, "rad", Equation;
    }
}

topic! {
    /// Where the peaks of turns lead.
    pub struct Ahead in "ahead", shown [Fast] {
        /// Of more turns than the most in one place, one in so many is left out, of the first: piezos creep by the logarithm of
        /// time, which is no straight line where all of it is looked at.
        old: usize = 3, "1", Choice;
        /// Standard deviations of a drift that is no drift for sure.
        chance: f64 = 2.0, "sigma", Choice;
        /// What was foreseen gets no older than that where the middle stays: else all would be believed in the end.
        fresh: u32 = 2, "turns", Choice;
        /// How far the small turn may find the peak from where the wide ones foresaw it, beside noise: what is farther has been
        /// moved meanwhile. Rather once too often: it costs some turns.
        moved: f64 = 40e-9, "m", Choice;
        /// The same in standard deviations, on top.
        moved_deviations: f64 = 3.0, "sigma", Choice;
        /// How fast a peak moves when all is done, as piezos creep.
        creep: f64 = 15e-9, "m a turn", Measured;
        /// How far it strays meanwhile from a straight line: creep by the logarithm of time that is as fast as this after three turns
        /// bends by so much after five or six.
        strays: f64 = 1.5e-9, "m a turn", Equation;
        /// From the middle of the last wide turn to that of the small one, but for what is waited on the way. Foreseeing as far as
        /// the fiber's attaching makes offsets in x twice as large, and those in y larger by a third.
        ahead: f64 = 1.3, "turns", Measured;
    }
}

topic! {
    /// The last turns at the chip.
    pub struct LastTurns in "last", shown [Fast, Bench] {
        /// Turns that foresee a peak, at least: a straight line and how they scatter about it.
        fewest: usize = 3, "turns", Equation;
        /// Standard deviations by which a small turn may see the peak beside where it was foreseen, and is believed by itself: beyond, another one is to see it
        /// there too. By chance one of ten fibers is looked at once more.
        doubtful: f64 = 2.0, "sigma", Choice;
        /// Turns on the small circle at most, where one of them does not tell enough; as many times as many as on the wide one where a try has come to no
        /// sure place.
        looks: f64 = 6.0, "turns", Choice;
        /// Radius of the small turn at least, enough for light without noise: the smaller, the better the light on it tells that at
        /// its middle.
        smallest: f64 = 0.15, "widths", Choice;
        /// Its radius at most.
        largest: f64 = 0.3, "widths", Choice;
        /// Square of its radius for a sample's noise, of its light: it must stand out of the noise.
        noisy: f64 = 10.0, "1", Choice;
        /// So many times the most turns in one place are made at the chip, at most.
        most_turns: u32 = 12, "1", Choice;
        /// No peak is worth a look from near that is not even known so well after these.
        roughly: f64 = 30e-9, "m", Choice;
        /// How far beside the middle of a circle a micro comes to rest, along an axis, of the circle's radius, by what a model of its
        /// piezos' hysteresis does not know; one standard deviation. Of 651 rests on 12 machines of `workshop` commissioned by a
        /// model that remembers it was 0.012, rms, 0.04 for 99 of 100 and 0.06 for the worst, for the circle that finds the peak and
        /// for the small one alike; of 787 on 8 without any model 0.013; of 192 on machines of `nominal` as shipped 0.013, and of
        /// 106 of `harsh` 0.013, and 0.074 for the worst.
        hidden: f64 = 0.012, "1", Measured;
        /// The same where the model is a network: it knows less of small loops. Of 702 rests on the same 12 machines it was 0.028 to
        /// 0.032 in x, 0.015 in y, and 0.15 for the worst.
        hidden_by_networks: f64 = 0.03, "1", Measured;
        /// What of both is tips that shook while they were looked at, which counts by itself: of tips that the twin holds still 0.008 was left of 0.012
        /// (40 machines of `workshop`). For what is told of a fiber; what is decided leaves it in.
        shaken: f64 = 0.009, "1", Measured;
        /// Of what has a bound less is likelier than all: a drift slows down, a ripple is as strong as bare glass makes it at most and stands
        /// anywhere in its wave. Where its density falls in a straight line to nothing at the bound its variance is half of one that is even. For
        /// what is told of a fiber; what is decided takes it as even.
        likely: f64 = std::f64::consts::FRAC_1_SQRT_2, "1", Equation;
        /// How well the wide turns alone must know the peak before a small one is made, of what both together must: the small one
        /// is to be near the peak, and knows it better.
        wide: f64 = 1.5, "1", Choice;
        /// How well the wide turns and the small one together must know the peak, of what the wide ones must; but for light so dim
        /// that it takes very many.
        together: f64 = 0.8, "1", Choice;
        /// In what time the micro comes from the small turn to rest: twice as slowly it rings a quarter as much.
        come_to_rest: f64 = 0.6, "turns", Choice;
        /// The same where the micro rings: so slow a change excites it little.
        gentle: f64 = 2.0, "turns", Choice;
        /// A spot narrower than so many times its design may be one that a micro near its resonance goes around farther than it is told to. Set
        /// after a fiber was attached that swung by 0.1 um: there it was 0.76. Of three devices of `nominal` it is 0.96 to 1.06.
        as_told: f64 = 0.93, "designed widths", Choice;
        /// How far it may swing, at most, before it comes to rest, where that does not die away: then it may be noise. What shakes
        /// is told apart from that by all turns together.
        swings: f64 = 60e-9, "m", Choice;
        /// Or so many times as far as it is known to shake.
        shakes: f64 = 2.0, "1", Choice;
        /// Small turns, at most, until it no longer rings.
        ringing: u32 = 10, "turns", Choice;
        /// A swing that is more than this share of that of the turn before does not die away.
        lasting: f64 = 0.8, "1", Choice;
        /// As the misfit, for the small turn, times its radius squared: a peak that was moved in the middle of it, or a piezo that
        /// does not move, which makes `1 / sqrt(8)`.
        small_misfit: f64 = 0.2, "1", Choice;
        /// Of how fast a peak creeps, what is not foreseen on the way from the last turn to where the fiber is fixed; and of how
        /// fast it has been seen to move, where that takes longer than a turn.
        unforeseen: f64 = 0.3, "1", Choice;
        /// For how long a peak is watched that scatters by more than noise.
        watched: usize = 24, "turns", Choice;
        /// How fast a peak may move while its turns are made: five times as fast as it creeps.
        fastest: f64 = 5.0 * 15e-9, "m a turn", Choice;
        /// By how much the light on the circle may differ from that of a peak, of its own: one whose modes are not as designed does
        /// by 3 % at most, a piezo that goes half of its way makes it 5 %.
        misfit: f64 = 0.04, "1", Measured;
        /// So many times as far as light seems to say a tip may move, and no farther: else the turns are made again with the width
        /// that they have told.
        misjudged: f64 = 1.5, "1", Choice;
        /// How far a micro that rings may swing where the fiber is attached.
        quiet: f64 = 20e-9, "m", Choice;
        /// A gap that turns out to be so wrong when all else is done is worth doing the last turns again.
        late: f64 = 1.3, "tolerances", Choice;
        /// No peak need be known better: what creeps until a fiber is fixed is as much.
        finest: f64 = 5e-9, "m", Choice;
        /// Share of the light that the wide turns have foreseen which must be there at last.
        bright: f64 = 0.9, "1", Choice;
    }
}

topic! {
    /// How peaks answer to where circles are, on a bench that nobody has measured.
    pub struct Answer in "answer", shown [Bench] {
        /// How much more or less than it should, and how far aside, a peak may be seen of what its circle's middle was off; one
        /// standard deviation. A spot that is wider or narrower by 15 % makes so much, and so does light that is later than
        /// believed by a twentieth of a turn.
        unknown: f64 = 0.3, "1", Choice;
        /// Farthest from what it should be, by the complex logarithm: a spot that is 35 % wider or narrower, or light a tenth of a
        /// turn later, with nothing else.
        most: f64 = 0.6, "1", Choice;
        /// Standard deviations that it is beyond that.
        surely: f64 = 3.0, "sigma", Choice;
        /// Smallest wander of a peak that is looked at: as good as none.
        least_wander: f64 = 0.25, "noises of a turn", Choice;
        /// Largest, of what turns leave about a straight line: one that is seen for a few turns alone may be part of a wider one.
        most_wander: f64 = 4.0, "1", Choice;
    }
}

topic! {
    /// What the light tells beside where its peak is: how wide the spot is, how the tip shakes.
    pub struct WatchedLight in "watch", shown [Fast, Bench] {
        /// How far a circle's middle may have gone at the beginning of a turn that tells how a tip shakes: a tip that shakes by 40
        /// nm sends it there, and what a micro does on so short a way is nothing beside it.
        sent: f64 = 100e-9, "m", Choice;
        /// Radii of the circles by which the width of the spot is seen: how light spreads was measured on the same circles as it is
        /// used on, whatever is known of the spot meanwhile. A micro does not go as far on circles of another size.
        widths: [f64; 2] = [0.35, 1.2], "designed widths", Choice;
        /// How often turns on both are repeated, to and fro, at least.
        rounds: u32 = 4, "1", Choice;
        /// The same where it is known by how much rounds differ.
        rounds_told: u32 = 2, "1", Equation;
        /// The same at most.
        most_rounds: u32 = 192, "1", Choice;
        /// From one to the other. In whole turns, so that light is always sampled at the same places of a circle: a micro that
        /// rings there does so at every gap alike, and all widths are wrong by the same share.
        over: f64 = 1.0, "turns", Equation;
        /// For how long a tip is watched at first that may shake too much, in x and in y; then for as long again until that is
        /// decided.
        first: usize = 40, "samples", Choice;
        /// The same at most, all together.
        most: usize = 1280, "samples", Measured;
        /// How far beside the peak light is watched: there it is steepest.
        steep: f64 = 0.7, "widths", Equation;
        /// For how long a piezo creeps as good as steadily: what is slower, circles follow.
        straight: f64 = 0.2, "s", Choice;
        /// Beside the peak the light is less than there by this share at least.
        least_fall: f64 = 0.02, "1", Choice;
        /// So many times longer than it is believed to settle a micro may still swing of which nobody has measured that.
        forgets: f64 = 8.0, "settlings", Choice;
        /// For so long before it is looked at for the first time.
        glance: f64 = 2.0, "settlings", Choice;
        /// Standard deviations of what is left of a turn that noise may make.
        surely: f64 = 4.0, "sigma", Choice;
        /// Widths whose squares are known worse tell nothing.
        known_roughly: f64 = 0.3, "1", Choice;
        /// Standard deviations by which noise at the peak must be more than in the dark to be believed.
        chance: f64 = 2.0, "sigma", Choice;
        /// So many lines tell by how much they differ what their degrees of freedom are worth.
        many: f64 = 8.0, "lines", Choice;
    }
}

topic! {
    /// How micros swing, by steps of their piezos on the slope of a peak.
    pub struct MicroDynamics in "dynamics", shown [Commissioned] {
        /// Middle of the steps, from the peak: light is steepest at 0.7.
        beside: f64 = 0.6, "widths", Choice;
        /// Height of a step: many times what a tip shakes, and little beside the width.
        height: f64 = 0.2, "widths", Choice;
        /// So many, to and fro: each tenth of them begins as late after a sample.
        steps: u32 = 40, "1", Choice;
        /// How long each is looked at.
        each: f64 = 0.08, "s", Choice;
        /// Samples that tell the light at the peak.
        top: usize = 20, "samples", Choice;
        /// Resonances that are tried first.
        resonances: [f64; 12] = [40.0, 55.0, 75.0, 100.0, 135.0, 180.0, 240.0, 320.0, 430.0, 570.0, 760.0, 1000.0], "Hz", Choice;
        /// The same of dampings.
        dampings: [f64; 6] = [0.03, 0.08, 0.2, 0.4, 0.65, 0.9], "1", Choice;
        /// Light is about so late beside that: the photodiode's own lag, and a cycle or two.
        delay: f64 = 0.4e-3, "s", Choice;
        /// It is within this: what is told takes effect within a cycle or two, and samples are no older.
        delays: [f64; 2] = [-0.5e-3, 3e-3], "s", Choice;
        /// How well it must be told how fast it comes to rest, standard deviation of the natural logarithm: it is waited for as much longer.
        told: f64 = 0.5, "1", Choice;
        /// A resonance below this is none of a micro's...
        least: f64 = 15.0, "Hz", Choice;
        /// ...and one above it is not told by samples.
        most: f64 = 2.5e3, "Hz", Choice;
        /// A micro has come to rest after so many time constants: a fiftieth of what it swung by is left.
        constants: f64 = 4.0, "time constants", Choice;
        /// Of a time constant that is longer than it was measured by so many standard deviations.
        surely: f64 = 2.0, "sigma", Choice;
        /// Circles have so many turns in a period of the resonance, at most: beyond, a micro goes much farther than it is told to, and much later.
        turns: f64 = 0.7, "1", Choice;
        /// How well a lag is known, of itself, beside what was measured: it differs from way to way.
        lag: f64 = 0.1, "1", Choice;
    }
}

topic! {
    /// Micros that swing for longer than anybody knows, as a camera sees it.
    pub struct MicroRingDown in "ring_down", shown [Fast] {
        /// A micro goes to and fro so far while its tip is far from all...
        radius: f64 = 2.4e-6, "m", Choice;
        /// ...and so often at each of the rates of what it does later: one that swings by them farther and farther shows it, and not so far that who guards the
        /// machine minds.
        turns: f64 = 3.0, "turns", Choice;
        /// How much earlier or later than it says a camera may expose a frame.
        exposed: f64 = 12e-3, "s", Choice;
        /// A tip that swings by so much more than it is told to, seen where it is farthest...
        astray: f64 = 3.5e-6, "m", Choice;
        /// ...and by so many deviations of the camera's noise, as it was seen before: three frames make that of noise alone once in a million times.
        deviations: f64 = 3.0, "sigma", Choice;
        /// What the camera states of its noise counts as much as so many frames.
        stated: f64 = 2.0, "frames", Choice;
        /// A micro goes to and fro when a tip has been on its way for so long, by when it was seen how noisy the camera is.
        after: f64 = 0.2, "s", Choice;
        /// How many times as noisy as it states a camera may be, as far as what was seen is concerned.
        noises: [f64; 6] = [1.0, 1.4, 2.0, 2.8, 4.0, 5.6], "1", Choice;
        /// A holder whose way from frame to frame differs by no more is on a steady way, or at rest.
        steady: f64 = 10e-6, "m", Choice;
        /// What it winds up where it sets out or turns back has settled after so many frames more.
        settled: u32 = 5, "frames", Choice;
        /// For how long one that swings is looked at after it was left alone.
        watched: f64 = 0.4, "s", Choice;
        /// It takes this much longer to come to rest than was believed, at least.
        longer: f64 = 2.0, "1", Choice;
        /// Fewer frames tell nothing of that.
        frames: usize = 3, "1", Choice;
        /// Time constants that are tried, from...to, in so many steps of equal ratio: 15 Hz damped by 0.01 has one of a second.
        constants: [f64; 2] = [0.01, 1.0], "s", Choice;
        /// See above.
        steps: u32 = 40, "1", Choice;
        /// The longest is believed that makes what was seen no less likely than this, by minus twice the logarithm: two standard deviations.
        bears: f64 = 4.0, "1", Choice;
    }
}

topic! {
    /// How tips shake.
    pub struct TipShaking in "shaking", shown [Fast] {
        /// That a tip which was measured has changed since, and is such as is usual: a loose screw, another table, a machine
        /// started nearby. As one that happens now and then and not on most days.
        changed: f64 = 0.05, "1", Choice;
        /// What is slower than a turn is believed to be as much as what is faster, or as much as was measured, worth so much.
        worth_slow: f64 = 10.0, "degrees of freedom", Choice;
        /// By so many times as much, by variance, a micro swings on the wide circle that rings.
        rings: f64 = 6.0, "1", Choice;
        /// A tip that shakes less than this is still.
        least: f64 = 5e-9, "m", Choice;
        /// Standard deviations by which a tip may be stiller than it seems.
        stiller: f64 = 2.0, "sigma", Choice;
        /// How well it is told how far a tip shakes: as well as it is the same on another day. Standard deviation of its natural logarithm.
        known: f64 = 0.1, "1", Choice;
        /// Or that it is no more than this.
        nothing: f64 = 0.05, "tolerances", Choice;
        /// By so many standard deviations.
        told_surely: f64 = 3.0, "sigma", Choice;
        /// How far a tip shakes that nobody has measured, before it is seen. 95 % of the tips of amplifiers and tables such as
        /// workshops have lie between 2 and 32 nm; the shipped fleet `workshop` makes the same choice, so that this fleet is no
        /// test of it.
        usual: f64 = 8e-9, "m", Choice;
        /// How well that is known, standard deviation of its natural logarithm.
        usual_spread: f64 = 0.7, "1", Choice;
        /// Standard deviations of the noise's own variance that a few turns may show.
        noise_chance: f64 = 3.0, "sigma", Choice;
        /// Standard deviations of what noise makes of a few turns where it is asked whether a micro rings.
        rings_chance: f64 = 2.0, "sigma", Choice;
    }
}
