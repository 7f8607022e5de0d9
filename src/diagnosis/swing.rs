//! Whether the excess swings at a frequency of its own: a line in the spectrum of what the plain model leaves
//! that the motion neither has nor makes. A pump, a fan, hum, a bench that sways or a part that hangs loose
//! shows so; what follows from the motion without memory, whatever law it obeys, stands at multiples and sums
//! of the motion's own frequencies, and so do the signs of where it is and how fast.

use realfft::RealFftPlanner;

use super::locate::Spot;

/// A line of the spectrum that stands alone.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Swing {
    /// From and to, Hz: as well as the longest recording tells it.
    pub range_hz: [f64; 2],
    /// Share of the squares that lie there.
    pub share: f64,
    /// Share of the frequencies that it takes up.
    pub band: f64,
}

/// Share of the squares that a line has to hold.
const HOLDS: f64 = 0.5;
/// Lobes of the spectrum on either side that a line is held against.
const AROUND: usize = 12;
/// By how much a law of the motion stands out where it makes a line: what noise draws in so many frequencies
/// stays below.
const STANDS_OUT: f64 = 12.0;
/// Share of a law's power from which a line of it counts: a step has a ten-thousandth in its 50th multiple.
const OF_A_LAW: f64 = 1e-4;
/// Share of the motion's power up to which a line of it may be that of something else that pushes; what rings
/// after a jolt has most.
const OF_THE_MOTION: f64 = 0.1;
/// Periods that a recording has to show.
const PERIODS: f64 = 4.0;
/// Samples that a period has to have.
const SAMPLES: f64 = 4.0;

/// Power at `j/span_s` of a course, one frequency after the other.
fn power(
    planner: &mut RealFftPlanner<f64>,
    values: &[(f64, f64)],
    [step_s, span_s]: [f64; 2],
    tapered: bool,
) -> Vec<f64> {
    let size = (span_s / step_s).ceil() as usize;
    let fft = planner.plan_fft_forward(size);
    let mut course = fft.make_input_vec();
    let mean = values.iter().map(|v| v.1).sum::<f64>() / values.len() as f64;
    let (first, last) = (values[0].0, values[values.len() - 1].0);
    for (time, value) in values {
        let at = ((time - first) / step_s).round() as usize;
        let along = (time - first) / (last - first);
        let taper = match tapered {
            true => (std::f64::consts::PI * along).sin().powi(2),
            false => 1.0,
        };
        if let Some(c) = course.get_mut(at) {
            *c = taper * (value - mean);
        }
    }
    let mut spectrum = fft.make_output_vec();
    // lengths are those that the plan asks for
    let _ = fft.process(&mut course, &mut spectrum);
    spectrum.iter().map(|c| c.norm_sqr()).collect()
}

/// By how much a spectrum stands out of its neighbourhood within `lobe` steps of `at`, and the share of its
/// power that lies there.
fn peak(power: &[f64], at: usize, lobe: usize) -> [f64; 2] {
    let within = |by: usize| at.saturating_sub(by)..(at + by + 1).min(power.len());
    let inside = &power[within(lobe)];
    let largest = inside.iter().copied().fold(0.0, f64::max);
    let mut around: Vec<f64> = within(AROUND * lobe)
        .filter(|j| j.abs_diff(at) > 2 * lobe)
        .map(|j| power[j])
        .collect();
    around.sort_by(f64::total_cmp);
    let usual = around.get(around.len() / 2).copied().unwrap_or(0.0);
    let all = power.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    [
        largest / usual.max(f64::MIN_POSITIVE),
        inside.iter().sum::<f64>() / all,
    ]
}

/// Values, and on which side of their quarters they are: what has every frequency that a law of them can make.
fn sides(values: Vec<f64>) -> Vec<Vec<f64>> {
    let mut order = values.clone();
    order.sort_by(f64::total_cmp);
    let edges = [1, 2, 3].map(|quarter| order[quarter * order.len() / 4]);
    let beyond = edges.map(|edge| {
        values
            .iter()
            .map(|v| f64::from(u8::from(*v > edge)))
            .collect()
    });
    let mut all = vec![values];
    all.extend(beyond);
    all
}

/// Adds a spectrum, so many times, to a sum.
fn add(sum: &mut Vec<f64>, own: &[f64], weight: f64) {
    sum.resize(sum.len().max(own.len()), 0.0);
    own.iter().zip(sum).for_each(|(o, s)| *s += weight * o);
}

/// Spectra of what laws of one quantity make, over all courses.
#[derive(Default)]
struct Spectra(Vec<Vec<f64>>);

impl Spectra {
    /// Adds those of one more course, each over its power.
    fn add(&mut self, own: &[Vec<f64>]) {
        self.0.resize(own.len(), Vec::new());
        for (sum, own) in self.0.iter_mut().zip(own) {
            let all = own.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            add(sum, own, 1.0 / all);
        }
    }

    /// Whether one of them has a line there.
    fn has_line(&self, at: usize, lobe: usize) -> bool {
        self.0.iter().any(|power| {
            let [out, share] = peak(power, at, lobe);
            out > STANDS_OUT && share > OF_A_LAW
        })
    }
}

/// Samples of one actuator in one recording, each apart.
fn courses(spots: &[Spot]) -> Vec<Vec<&Spot>> {
    let mut courses: Vec<Vec<&Spot>> = Vec::new();
    for spot in spots {
        let own = |c: &&mut Vec<&Spot>| {
            c[0].recording == spot.recording && c[0].actuator == spot.actuator
        };
        match courses.iter_mut().rev().take(3).find(own) {
            Some(course) => course.push(spot),
            None => courses.push(vec![spot]),
        }
    }
    courses.retain(|c| c.len() > 16 && lasts_s(c) > 0.0);
    courses
}

fn lasts_s(course: &[&Spot]) -> f64 {
    course[course.len() - 1].at[2] - course[0].at[2]
}

/// The line that holds most of what is left, where it follows neither from the motion nor from the drive: what
/// pushes at its own frequency moves a rig that is free to, but has only a small part in its motion.
pub(super) fn swing(spots: &[Spot]) -> Option<Swing> {
    let courses = courses(spots);
    let longest_s = courses.iter().map(|c| lasts_s(c)).fold(0.0, f64::max);
    let shortest_s = courses.iter().map(|c| lasts_s(c)).fold(longest_s, f64::min);
    let span_s = 2.0 * longest_s;
    let mut planner = RealFftPlanner::new();
    let (mut error, mut step_s) = (Vec::new(), 0.0_f64);
    let (mut motion, mut drive) = (Spectra::default(), Spectra::default());
    for course in &courses {
        let mut steps: Vec<f64> = course.windows(2).map(|w| w[1].at[2] - w[0].at[2]).collect();
        steps.sort_by(f64::total_cmp);
        let own_s = steps[steps.len() / 2];
        if own_s <= 0.0 {
            return None;
        }
        step_s = step_s.max(own_s);
        let mut of = |values: &[f64], tapered: bool| {
            let course = course.iter().zip(values).map(|(s, v)| (s.at[2], *v));
            power(
                &mut planner,
                &course.collect::<Vec<_>>(),
                [own_s, span_s],
                tapered,
            )
        };
        let along = |at: usize| -> Vec<f64> { course.iter().map(|s| s.at[at]).collect() };
        let left: Vec<f64> = course.iter().map(|s| s.error).collect();
        add(&mut error, &of(&left, false), 1.0);
        let mut lines = |laws: Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            laws.iter().map(|law| of(law, true)).collect()
        };
        let mut moves = sides(along(6));
        moves.extend(sides(along(4)));
        moves.push(along(1).iter().map(|v| v.signum()).collect());
        motion.add(&lines(moves));
        drive.add(&lines(sides(along(0))));
    }
    let lobe = (span_s / shortest_s).ceil() as usize;
    let first = (PERIODS * span_s / shortest_s).ceil() as usize;
    let last = ((span_s / (SAMPLES * step_s)) as usize).min(error.len());
    let top = (first..last).max_by(|a, b| error[*a].total_cmp(&error[*b]))?;
    let (from, to) = (top.saturating_sub(lobe), (top + lobe).min(error.len() - 1));
    let share = error[from..=to].iter().sum::<f64>() / error.iter().sum::<f64>();
    let its_own = !motion.has_line(top, lobe)
        || (!drive.has_line(top, lobe) && peak(&motion.0[0], top, lobe)[1] < OF_THE_MOTION);
    if share.is_nan() || share < HOLDS || !its_own {
        return None;
    }
    let frequency_hz = top as f64 / span_s;
    let half = 0.5 / longest_s;
    Some(Swing {
        range_hz: [frequency_hz - half, frequency_hz + half],
        share,
        band: (to - from + 1) as f64 / error.len() as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// What a law of motion, and something else, leave of two recordings.
    fn spots(left: impl Fn(f64, f64, f64) -> f64) -> Vec<Spot> {
        let mut out = Vec::new();
        for recording in 0..2 {
            for i in 0..8000 {
                let t = 0.01 * f64::from(i);
                let x = (TAU * 0.31 * t).sin() + 0.6 * (TAU * 0.83 * t + 1.0).sin();
                let phase = 1.7 * recording as f64;
                let v = 0.31 * (TAU * 0.31 * t).cos() + 0.6 * 0.83 * (TAU * 0.83 * t + 1.0).cos();
                let noise = (i as f64 * 12.9898 + phase).sin() * 43758.5453;
                let error = left(x, t, phase) + 0.2 * (noise - noise.floor() - 0.5);
                out.push(Spot {
                    recording,
                    actuator: 0,
                    error,
                    before: error * error,
                    after: 1.0,
                    at: [x, v, t, x, v, x, x],
                });
            }
        }
        out
    }

    #[test]
    fn what_swings_on_its_own_is_found() {
        let found = swing(&spots(|_, t, phase| (TAU * 2.228 * t + phase).sin())).unwrap();
        assert!(
            (found.range_hz[0] < 2.228) && (found.range_hz[1] > 2.228),
            "{found:?}"
        );
        assert!(found.share > 0.9 && found.band < 0.01, "{found:?}");
        // beside a law of the motion, too
        let both = spots(|x, t, phase| 0.3 * x.powi(3) + (TAU * 2.228 * t + phase).sin());
        assert!(swing(&both).is_some());
    }

    #[test]
    fn what_the_motion_makes_is_no_swing_of_its_own() {
        type Law = fn(f64, f64, f64) -> f64;
        let laws: [Law; 5] = [
            |x, _, _| x.powi(3),
            |x, _, _| (6.0 * x).sin(),
            |_, t, _| (TAU * 0.31 * t).cos().signum(),
            |_, t, _| (TAU * 3.0 * 0.31 * t).sin(),
            |_, t, _| (TAU * (0.31 + 0.83) * t).sin(),
        ];
        for (i, law) in laws.into_iter().enumerate() {
            assert_eq!(swing(&spots(law)), None, "{i}");
        }
        assert_eq!(swing(&spots(|_, _, _| 0.0)), None);
    }
}
