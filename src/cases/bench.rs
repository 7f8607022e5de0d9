//! The bench on which a case is recorded: how the robot was made, what its film really is, and what stands
//! between its motion and the files. Nothing of it is a cause, and nothing here is shared with a diagnosis.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::dice::Dice;
use super::drives::QUANTUM_V;
use super::effect::{Hook, film_torque};
use crate::film::Film;
use crate::kinematics::Vec3;
use crate::model::Robot;
use crate::simulate::write::Capture;

/// How nearly the robots of cases are their models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Likeness {
    /// Exactly.
    Drawn,
    /// Films, links, angles, axes, marker and clocks are off by a share of usual workshop tolerances, 3 % to
    /// all of them.
    Built,
    /// Besides, of another size and softness; two in five with a film that follows another law; at rates of
    /// 50 to 240 Hz; through a filter, with slow noise, spikes, lost frames, coarse digits, or without.
    Real,
}

/// A film that follows another law: elastic energy by the first invariant or by powers of the stretches, and
/// branches that relax linearly, with moduli that fall as a power of their times.
#[derive(Debug, Clone)]
pub enum Elastic {
    /// c_1 (I - 3) + c_2 (I - 3)^2 + c_3 (I - 3)^3 (Yeoh 1993), Pa.
    Yeoh([f64; 3]),
    /// sum mu_p/alpha_p (sum lambda_i^alpha_p - 3) (Ogden 1972): mu_p, Pa, and alpha_p.
    Ogden([[f64; 2]; 2]),
    /// Five terms of the inverse Langevin function (Arruda and Boyce 1993): modulus, Pa, and links of a chain.
    ArrudaBoyce([f64; 2]),
}

impl Elastic {
    /// Cauchy stress of an incompressible film that is free of stress across its thickness, Pa.
    fn stress(&self, [l1, l2]: [f64; 2]) -> [f64; 2] {
        let l3 = 1.0 / (l1 * l2);
        let by_invariant = |slope: f64| [l1, l2].map(|l| 2.0 * slope * (l * l - l3 * l3));
        let i = l1 * l1 + l2 * l2 + l3 * l3;
        match self {
            Elastic::Yeoh([c1, c2, c3]) => {
                by_invariant(c1 + 2.0 * c2 * (i - 3.0) + 3.0 * c3 * (i - 3.0).powi(2))
            }
            Elastic::Ogden(terms) => [l1, l2].map(|l| {
                let each = terms.map(|[mu, alpha]| mu * (l.powf(alpha) - l3.powf(alpha)));
                each[0] + each[1]
            }),
            Elastic::ArrudaBoyce([mu, links]) => {
                const C: [f64; 5] = [
                    0.5,
                    1.0 / 20.0,
                    11.0 / 1050.0,
                    19.0 / 7000.0,
                    519.0 / 673_750.0,
                ];
                let each = C
                    .iter()
                    .enumerate()
                    .map(|(n, c)| (n + 1) as f64 * c * (i / links).powi(n as i32));
                by_invariant(mu * each.sum::<f64>())
            }
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Elastic::Yeoh(_) => "Yeoh",
            Elastic::Ogden(_) => "Ogden",
            Elastic::ArrudaBoyce(_) => "Arruda-Boyce",
        }
    }
}

/// A film of another law.
#[derive(Debug, Clone)]
pub struct OtherFilm {
    /// The film of the model in whose place it is.
    of: Film,
    elastic: Elastic,
    /// Modulus over the elastic one, and time, s, of each branch.
    branches: Vec<[f64; 2]>,
}

impl OtherFilm {
    /// One as stiff as the film `of` the model at small stretch.
    fn draw(dice: &mut Dice, of: &Film) -> Self {
        let mu = of.mu_pa[0];
        let elastic = match dice.below(3) {
            0 => {
                let c1 = 0.5 * mu;
                Elastic::Yeoh([
                    c1,
                    -c1 * dice.range(0.02, 0.09),
                    c1 * dice.range(0.005, 0.03),
                ])
            }
            1 => {
                let (low, high) = (dice.range(1.3, 2.1), dice.range(3.0, 5.0));
                let share = dice.range(0.02, 0.12);
                // mu = sum mu_p alpha_p/2
                let of = |share: f64, alpha: f64| [2.0 * mu * share / alpha, alpha];
                Elastic::Ogden([of(1.0 - share, low), of(share, high)])
            }
            _ => Elastic::ArrudaBoyce([mu, dice.range(4.0, 25.0)]),
        };
        let count = 6 + dice.below(3);
        let (first, last) = (dice.log_range(0.01, 0.03), dice.log_range(60.0, 300.0));
        let power = dice.range(0.05, 0.25);
        let whole = dice.range(0.3, 0.6);
        let times: Vec<f64> = (0..count)
            .map(|i| first * f64::powf(last / first, i as f64 / (count - 1) as f64))
            .collect();
        let weights: Vec<f64> = times
            .iter()
            .map(|t| t.powf(-power) * dice.range(0.8, 1.2))
            .collect();
        let sum: f64 = weights.iter().sum();
        OtherFilm {
            of: of.clone(),
            elastic,
            branches: (weights.iter().zip(&times))
                .map(|(w, t)| [whole * w / sum, *t])
                .collect(),
        }
    }

    /// Takes the stress of the film of the model away and puts its own there. Where the model's is stiffer and
    /// slower now than it was, so is this one.
    fn hook(&self, robot: &Robot, now: &Film) -> Hook {
        let lozenges = robot.lozenges;
        let stiffer = now.mu_pa[0] / self.of.mu_pa[0];
        let slower = now.relaxation_time_s[0] / self.of.relaxation_time_s[0];
        let elastic = self.elastic.clone();
        let stress = move |l: [f64; 2]| elastic.stress(l).map(|s| stiffer * s);
        let relaxed = stress.clone();
        let branches: Vec<[f64; 2]> = (self.branches.iter())
            .map(|[share, time_s]| [*share, slower * time_s])
            .collect();
        let n = branches.len();
        Hook::with_states(
            6 * n,
            stress([1.3, 1.3])[0].abs(),
            move |s, states| {
                for k in 0..3 {
                    let own = relaxed(s.stretch[k]);
                    for at in 0..2 * n {
                        states[2 * n * k + at] = own[at % 2];
                    }
                }
            },
            move |s, states, action, rates| {
                for k in 0..3 {
                    let own = stress(s.stretch[k]);
                    let mut sigma = own;
                    for (b, [share, time_s]) in branches.iter().enumerate() {
                        for i in 0..2 {
                            let at = 2 * (n * k + b) + i;
                            sigma[i] += share * (own[i] - states[at]);
                            rates[at] = (own[i] - states[at]) / time_s;
                        }
                    }
                    let more = [0, 1].map(|i| sigma[i] - s.film_stress_pa[k][i]);
                    action.torque_dea_n_m[k] -= film_torque(&lozenges[k], s.theta_dea_rad[k], more);
                }
            },
        )
    }
}

/// Lines of a Nexus file above its numbers.
const HEADER_LINES: usize = 5;

/// What stands between motion and file.
#[derive(Debug, Clone, Copy, Default)]
struct Chain {
    /// Corner of a low-pass of the second order, run both ways, Hz.
    filter_hz: Option<f64>,
    /// Chance of a frame to lie elsewhere.
    spikes: f64,
    /// Smallest step, mm.
    quantum_mm: Option<f64>,
}

/// The bench of a case.
#[derive(Debug, Clone)]
pub struct Bench {
    seed: u64,
    likeness: Likeness,
    /// Lengths, thickness of the film and its modulus over those of the rig that is known best.
    size: [f64; 3],
    /// Whether parts are off.
    as_built: bool,
    /// Smallest step of the voltages' monitor, V.
    pub monitor_v: f64,
    /// Whether the drives are those of the paper alone.
    pub few_drives: bool,
    film: Option<OtherFilm>,
    chain: Chain,
}

impl Bench {
    /// Draws the bench of a case.
    pub fn new(likeness: Likeness, seed: u64) -> Self {
        let mut dice = Dice::new(seed, 7);
        let mut out = Bench {
            seed,
            likeness,
            size: [1.0; 3],
            as_built: likeness == Likeness::Built,
            monitor_v: QUANTUM_V,
            few_drives: false,
            film: None,
            chain: Chain::default(),
        };
        if likeness != Likeness::Real {
            return out;
        }
        if dice.chance(0.5) {
            out.size = [
                dice.log_range(0.7, 1.5),
                dice.log_range(0.6, 1.6),
                dice.log_range(0.6, 1.4),
            ];
        }
        out.as_built = dice.chance(0.7);
        if dice.chance(0.3) {
            out.monitor_v = dice.log_range(0.5, 10.0);
        }
        out.few_drives = dice.chance(0.2);
        out.chain = Chain {
            filter_hz: dice.chance(0.35).then(|| [6.0, 10.0, 20.0][dice.below(3)]),
            spikes: if dice.chance(0.2) { 3e-4 } else { 0.0 },
            quantum_mm: dice.chance(0.25).then_some(0.01),
        };
        out
    }

    /// Gives the robot, in two cases of five, another film than that `of` the model.
    pub fn draw_film(&mut self, of: &Film) {
        let mut dice = Dice::new(self.seed, 8);
        if self.likeness == Likeness::Real && dice.chance(0.4) {
            self.film = Some(OtherFilm::draw(&mut dice, of));
        }
    }

    /// The rig file of a robot of this size, from that of the rig that is known best.
    pub fn rig(&self, text: &str) -> String {
        let [length, thickness, modulus] = self.size;
        if self.size == [1.0; 3] {
            return text.into();
        }
        // torques of the film and of weights keep their proportion
        let mass = length * thickness * modulus;
        let line = |line: &str| {
            let scaled = |factor: f64| {
                let (key, rest) = line.split_once('=')?;
                let (value, note) = rest.split_once('#').unwrap_or((rest, ""));
                let value: f64 = value.trim().parse().ok()?;
                Some(format!("{key}= {:.4} # {note}", factor * value))
            };
            let key = line.split('=').next().unwrap_or_default().trim();
            let factor = match key {
                "L3_mm" => thickness,
                _ if key.ends_with("_mm") => length,
                _ if key.ends_with("_g") => mass,
                _ => 1.0,
            };
            let whole = (factor != 1.0).then(|| scaled(factor)).flatten();
            whole.unwrap_or_else(|| line.into())
        };
        text.lines().map(line).collect::<Vec<_>>().join("\n") + "\n"
    }

    /// Factor of moduli, and of the forearm's torques.
    pub fn stiffness(&self) -> [f64; 2] {
        let [length, thickness, modulus] = self.size;
        [modulus, modulus * length * length * thickness]
    }

    /// Factor of voltages.
    pub fn voltage(&self) -> f64 {
        self.size[1] * self.size[2].sqrt()
    }

    /// Makes a robot from its drawing.
    pub fn made(&self, drawn: &Robot) -> Made {
        if self.as_built {
            Made::new(self.seed, drawn)
        } else {
            Made::as_drawn(drawn)
        }
    }

    /// What the film of a robot does beside that of the model as it is now.
    pub fn hook(&self, robot: &Robot, now: &Film) -> Option<Hook> {
        self.film.as_ref().map(|f| f.hook(robot, now))
    }

    /// Another rate and noise of the capture.
    pub fn capture(&self, capture: &mut Capture) {
        if self.likeness != Likeness::Real {
            return;
        }
        let mut dice = Dice::new(self.seed, 9);
        capture.rate_hz = [50.0, 100.0, 100.0, 100.0, 120.0, 200.0, 240.0][dice.below(7)];
        if dice.chance(0.3) {
            capture.noise.coloured_m = dice.range(1e-5, 5e-5);
            capture.noise.correlation_s = dice.log_range(0.1, 1.0);
        }
    }

    /// A file of motion as it leaves the capture system: with spikes, filtered, in coarse digits. Without
    /// `noise` there are no spikes.
    pub fn exported(&self, csv: Vec<u8>, rate_hz: f64, index: usize, noise: bool) -> Vec<u8> {
        let chain = self.chain;
        if chain.filter_hz.is_none() && chain.spikes == 0.0 && chain.quantum_mm.is_none() {
            return csv;
        }
        let text = String::from_utf8(csv).unwrap_or_default();
        let lines: Vec<&str> = text.split_terminator("\r\n").collect();
        let (head, body) = lines.split_at(HEADER_LINES.min(lines.len()));
        let cells: Vec<Vec<&str>> = body.iter().map(|l| l.split(',').collect()).collect();
        let mut dice = Dice::new(self.seed, 200 + index as u64);
        let mut columns: Vec<Vec<f64>> = (2..8)
            .map(|c| {
                cells
                    .iter()
                    .map(|r| r[c].parse().unwrap_or(f64::NAN))
                    .collect()
            })
            .collect();
        if noise && chain.spikes > 0.0 {
            for row in 0..cells.len() {
                if dice.chance(chain.spikes) {
                    columns[dice.below(3)][row] += dice.sign() * dice.range(0.5, 4.0);
                }
            }
        }
        for column in &mut columns {
            let lost: Vec<bool> = column.iter().map(|x| x.is_nan()).collect();
            if let Some(corner) = chain.filter_hz {
                bridge(column);
                both_ways(column, corner / rate_hz);
            }
            for (x, lost) in column.iter_mut().zip(lost) {
                let q = chain.quantum_mm.unwrap_or(1e-3);
                *x = if lost { f64::NAN } else { (*x / q).round() * q };
            }
        }
        let mut out = String::new();
        for line in head {
            out += line;
            out += "\r\n";
        }
        for (row, own) in cells.iter().enumerate() {
            out += own[0];
            out += ",0";
            for column in &columns {
                out.push(',');
                if column[row].is_finite() {
                    out += &format!("{:.3}", column[row]);
                }
            }
            out += "\r\n";
        }
        out.into_bytes()
    }

    /// What the answer says of it.
    pub fn words(&self, capture: &Capture) -> BTreeMap<String, Value> {
        let mut out = BTreeMap::new();
        if self.likeness != Likeness::Real {
            return out;
        }
        let mut say = |key: &str, value: Value| out.insert(key.into(), value);
        say("size_thickness_modulus", json!(self.size));
        say("rate_hz", json!(capture.rate_hz));
        say("noise_slow_s", json!(capture.noise.correlation_s));
        say("filter_hz", json!(self.chain.filter_hz));
        say("spikes", json!(self.chain.spikes));
        say("quantum_mm", json!(self.chain.quantum_mm));
        say("monitor_V", json!(self.monitor_v));
        say("few_drives", json!(self.few_drives));
        say("film", json!(self.film.as_ref().map(|f| f.elastic.name())));
        say("as_built", json!(self.as_built));
        out
    }
}

/// Fills gaps by straight lines.
fn bridge(x: &mut [f64]) {
    let known: Vec<usize> = (0..x.len()).filter(|&i| x[i].is_finite()).collect();
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for i in a + 1..b {
            x[i] = x[a] + (x[b] - x[a]) * (i - a) as f64 / (b - a) as f64;
        }
    }
    if let (Some(&first), Some(&last)) = (known.first(), known.last()) {
        let (begin, end) = (x[first], x[last]);
        x[..first].fill(begin);
        x[last..].fill(end);
    }
}

/// Butterworth's low-pass of the second order, forwards and backwards; `corner` in cycles a sample.
fn both_ways(x: &mut [f64], corner: f64) {
    let k = (std::f64::consts::PI * corner.min(0.49)).tan();
    let norm = 1.0 / (1.0 + std::f64::consts::SQRT_2 * k + k * k);
    let b = k * k * norm;
    let a = [
        2.0 * (k * k - 1.0) * norm,
        (1.0 - std::f64::consts::SQRT_2 * k + k * k) * norm,
    ];
    let once = |x: &mut [f64]| {
        let (mut u, mut y) = ([x[0]; 2], [x[0]; 2]);
        for x in x.iter_mut() {
            let next = b * (*x + 2.0 * u[0] + u[1]) - a[0] * y[0] - a[1] * y[1];
            u = [*x, u[0]];
            y = [next, y[0]];
            *x = next;
        }
    };
    once(x);
    x.reverse();
    once(x);
    x.reverse();
}

/// A robot and its capture as they are made.
pub struct Made {
    /// The robot.
    pub robot: Robot,
    /// Marker of the end effector, from where it is stated, m.
    pub marker_m: Vec3,
    /// Axes of the capture.
    pub tilt_deg: Vec3,
    /// Standard deviation of the clock offset of a recording.
    pub clock_s: f64,
}

impl Made {
    /// As drawn.
    pub fn as_drawn(robot: &Robot) -> Self {
        Made {
            robot: robot.clone(),
            marker_m: [0.0; 3],
            tilt_deg: [0.0; 3],
            clock_s: 0.0,
        }
    }

    /// Off by a share of these tolerances: films 3 %, links 0.2 %, angles and axes 0.2 degrees, marker 0.1
    /// mm, clocks 1 ms.
    pub fn new(seed: u64, drawn: &Robot) -> Self {
        let mut dice = Dice::new(seed, 6);
        let share = dice.log_range(0.03, 1.0);
        let mut off = |tolerance: f64| share * tolerance * dice.normal();
        let mut out = Made::as_drawn(drawn);
        for (chain, lozenge) in (out.robot.mechanism.chains.iter_mut()).zip(&mut out.robot.lozenges)
        {
            lozenge.l3_m *= 1.0 + off(0.03);
            for length in chain.lengths_mut() {
                *length *= 1.0 + off(0.002);
            }
            chain.input_offset_rad += off(0.2_f64.to_radians());
            chain.dea_offset_rad += off(0.2_f64.to_radians());
        }
        out.marker_m = [0, 1, 2].map(|_| off(1e-4));
        out.tilt_deg = [0, 1, 2].map(|_| off(0.2));
        out.clock_s = share * 1e-3;
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_of_another_law_are_as_stiff_at_small_stretch() {
        let mu = 3e5;
        let of = |share: f64, alpha: f64| [2.0 * mu * share / alpha, alpha];
        // chains so long that they are Gaussian
        let all = [
            Elastic::Yeoh([0.5 * mu, -0.03 * mu, 0.01 * mu]),
            Elastic::Ogden([of(0.9, 1.7), of(0.1, 4.0)]),
            Elastic::ArrudaBoyce([mu, 1e7]),
        ];
        for elastic in all {
            // an equibiaxial strain e: sigma = 6 mu e
            let e = 1e-6;
            let sigma = elastic.stress([1.0 + e; 2]);
            let modulus = sigma[0] / (6.0 * e);
            assert!((modulus / mu - 1.0).abs() < 1e-4, "{elastic:?}: {modulus}");
            assert_eq!(elastic.stress([1.0; 2]), [0.0; 2]);
        }
    }

    #[test]
    fn the_filter_halves_at_its_corner_and_delays_nothing() {
        let wave = |f: f64| -> Vec<f64> {
            (0..2000)
                .map(|i| (std::f64::consts::TAU * f * i as f64).sin())
                .collect()
        };
        for (f, left) in [(0.006, 1.0), (0.06, 0.5)] {
            let plain = wave(f);
            let mut x = plain.clone();
            both_ways(&mut x, 0.06);
            let dot = |a: &[f64], b: &[f64]| {
                let each = a[500..1500].iter().zip(&b[500..1500]);
                each.map(|(a, b)| a * b).sum::<f64>()
            };
            let share = dot(&x, &plain) / dot(&plain, &plain);
            assert!((share - left).abs() < 2e-3, "{f}: {share}");
            let rest: Vec<f64> = x.iter().zip(&plain).map(|(a, b)| a - share * b).collect();
            assert!(dot(&rest, &rest) < 1e-5 * dot(&plain, &plain));
        }
    }
}
