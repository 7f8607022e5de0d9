//! A term that was learnt from recordings where no cause of the catalogue accounts for what is left: it acts
//! at one site, depends on stated coordinates, and is linear in its coefficients.
//!
//! | form | what coefficient j adds |
//! |---|---|
//! | spline | the natural cubic spline through 1 at knot j and 0 at the others, held beyond the ends |
//! | presliding | z_j, dz = (sign(dx) - z)(1 - e^(-\|dx\|/x_j)) (Dahl 1968) |
//! | lag | z_j, z_j' = (x - z_j)/tau_j |
//! | wave | sin and cos of 2 pi f t, t on the recording's motion clock |
//! | neighbours | the voltage times that of the next, and of the previous, actuator |
//! | potential | the force -grad of exp(-\|u - c_j\|^2/2 w^2) |
//! | ridge | a force along one direction, a spline of the position along it |
//! | affine | a constant force, and the forces of a symmetric stiffness about a point |
//! | drag | v along each axis, \|v\| v along each axis |
//! | oscillator | the force of a mass on a spring that follows the effector, along and across the axes |
//!
//! Of a single coordinate there are splines, preslidings and lags; what they make is over the largest force
//! that was measured, of an excursion over the largest one.
//!
//! Torques on theta_b and forces are turned to torques on theta_DEA by their levers. At the electrical sites
//! the sum is added to the square of the voltage that makes the Maxwell torque, which never falls below 0.

use super::line::{Terms, View};
use super::{Along, Effect, Memory, Part, Quantity, Reach, Site, decays};
use crate::kinematics::{Vec3, dot};

/// Where a learnt term acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A torque on theta_b, N m.
    Bicep,
    /// A torque on theta_DEA, N m.
    Film,
    /// A force on the end effector, N.
    Force,
    /// What is added to the squared voltage on its way to the film, V^2.
    Electrical,
    /// The same, as a share of the squared voltage.
    Capacitance,
    /// A torque on theta_b that changes over the series, N m.
    Series,
    /// A force (torque, stress) along a single coordinate, over the largest that was measured.
    Coordinate,
}

impl Place {
    /// All places.
    pub const ALL: [Place; 7] = [
        Place::Bicep,
        Place::Film,
        Place::Force,
        Place::Electrical,
        Place::Capacitance,
        Place::Series,
        Place::Coordinate,
    ];

    /// As files write it.
    pub fn name(self) -> &'static str {
        match self {
            Place::Bicep => "bicep",
            Place::Film => "film",
            Place::Force => "force",
            Place::Electrical => "electrical",
            Place::Capacitance => "capacitance",
            Place::Series => "series",
            Place::Coordinate => "coordinate",
        }
    }

    /// What it is, in words.
    pub fn says(self) -> &'static str {
        match self {
            Place::Bicep => "a torque on the bicep joints",
            Place::Film => "a torque on the lozenges, as the film makes one",
            Place::Force => "a force on the end effector",
            Place::Electrical => "a change of the voltage on its way to the film",
            Place::Capacitance => "a change of what the voltage does to the film",
            Place::Series => "a torque on the bicep joints that changes over the series",
            Place::Coordinate => "a force, torque or stress along the coordinate",
        }
    }

    /// Unit of what a term adds.
    pub fn unit(self) -> &'static str {
        match self {
            Place::Bicep | Place::Film | Place::Series => "N m",
            Place::Force => "N",
            Place::Electrical => "V^2",
            Place::Capacitance | Place::Coordinate => "1",
        }
    }
}

/// Time over which a rate of the voltage is seen, s: commands go in steps.
pub const RATE_S: f64 = 0.02;
/// Time within which what has no rate of its own is followed in forward dynamics, s.
const FOLLOW_S: f64 = 2e-4;

/// z of z' = (x - z)/tau from z = x on, where x is straight between samples; the last of each step.
fn lagging(x: &[f64], tau_s: f64, step_s: f64) -> Vec<f64> {
    let over_step = decays(step_s / tau_s);
    lagging_by(x, |_| over_step)
}

/// The same where the step to each sample decays ([`decays`]) by its own.
fn lagging_by(x: &[f64], over_step: impl Fn(usize) -> (f64, f64)) -> Vec<f64> {
    let mut z = x.first().copied().unwrap_or(0.0);
    let mut out = Vec::with_capacity(x.len());
    for i in 0..x.len() {
        if i > 0 {
            let (left, far) = over_step(i);
            z = left * z + (far - left) * x[i - 1] + (1.0 - far) * x[i];
        }
        out.push(z);
    }
    out
}

/// A coordinate of one actuator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    /// theta_b, rad.
    BicepAngle,
    /// theta_b', rad/s.
    BicepRate,
    /// theta_DEA, rad.
    LozengeAngle,
    /// lambda_1 lambda_2.
    AreaStretch,
    /// The largest lambda_1 lambda_2 so far.
    LargestStretch,
    /// Time in the series, s.
    SeriesTime,
    /// Voltage, V.
    Voltage,
    /// Its square, V^2.
    SquaredVoltage,
    /// Its size's third power, V^3.
    CubedVoltage,
    /// Its rate, V/s, as [`RATE_S`] lets it be seen whatever the sampling.
    VoltageRate,
    /// Of a single coordinate: its excursion from rest over the largest one.
    Excursion,
    /// Its rate, 1/s.
    ExcursionRate,
    /// The square of that rate, 1/s^2.
    SquaredExcursionRate,
    /// The rate's rate, 1/s^2.
    ExcursionAcceleration,
    /// The largest size of the excursion so far.
    LargestExcursion,
    /// The direction of the excursion, -1 to 1, which follows it within a hundredth of the largest one.
    Sliding,
}

impl Variable {
    /// All variables.
    pub const ALL: [Variable; 16] = [
        Variable::BicepAngle,
        Variable::BicepRate,
        Variable::LozengeAngle,
        Variable::AreaStretch,
        Variable::LargestStretch,
        Variable::SeriesTime,
        Variable::Voltage,
        Variable::SquaredVoltage,
        Variable::CubedVoltage,
        Variable::VoltageRate,
        Variable::Excursion,
        Variable::ExcursionRate,
        Variable::SquaredExcursionRate,
        Variable::ExcursionAcceleration,
        Variable::LargestExcursion,
        Variable::Sliding,
    ];

    /// As files write it.
    pub fn name(self) -> &'static str {
        match self {
            Variable::BicepAngle => "bicep angle",
            Variable::BicepRate => "bicep rate",
            Variable::LozengeAngle => "lozenge angle",
            Variable::AreaStretch => "area stretch",
            Variable::LargestStretch => "largest stretch so far",
            Variable::SeriesTime => "time in the series",
            Variable::Voltage => "voltage",
            Variable::SquaredVoltage => "squared voltage",
            Variable::CubedVoltage => "cubed voltage",
            Variable::VoltageRate => "voltage rate",
            Variable::Excursion => "excursion",
            Variable::ExcursionRate => "excursion rate",
            Variable::SquaredExcursionRate => "squared excursion rate",
            Variable::ExcursionAcceleration => "excursion acceleration",
            Variable::LargestExcursion => "largest excursion so far",
            Variable::Sliding => "sliding",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Variable::BicepAngle | Variable::LozengeAngle => "rad",
            Variable::BicepRate => "rad/s",
            Variable::AreaStretch
            | Variable::LargestStretch
            | Variable::Excursion
            | Variable::LargestExcursion
            | Variable::Sliding => "1",
            Variable::ExcursionRate => "1/s",
            Variable::SquaredExcursionRate | Variable::ExcursionAcceleration => "1/s^2",
            Variable::SeriesTime => "s",
            Variable::Voltage => "V",
            Variable::SquaredVoltage => "V^2",
            Variable::CubedVoltage => "V^3",
            Variable::VoltageRate => "V/s",
        }
    }

    /// Whether it is one of a single coordinate.
    pub fn of_coordinate(self) -> bool {
        matches!(
            self,
            Variable::Excursion
                | Variable::ExcursionRate
                | Variable::SquaredExcursionRate
                | Variable::ExcursionAcceleration
                | Variable::LargestExcursion
                | Variable::Sliding
        )
    }

    /// Its values along a robot's recording, where the voltage is `phi_v`; NaN of a single coordinate's.
    pub fn along(self, along: &Along, phi_v: &[f64]) -> Vec<f64> {
        let phi = |i: usize| phi_v.get(i).copied().unwrap_or(0.0);
        let now: Vec<f64> = (0..along.samples())
            .map(|i| self.now(along, i, phi(i)))
            .collect();
        match self {
            Variable::LargestStretch => now
                .into_iter()
                .scan(0.0_f64, |largest, x| {
                    *largest = largest.max(x);
                    Some(*largest)
                })
                .collect(),
            Variable::VoltageRate => {
                let behind = lagging(&now, RATE_S, along.step_s);
                (now.iter().zip(behind))
                    .map(|(x, z)| self.seen(*x, z))
                    .collect()
            }
            _ => now,
        }
    }

    /// What it is made of at a sample where the voltage is `phi_v`: the stretch of the largest so far, the
    /// voltage of its rate; of any other it is the value.
    fn now(self, along: &Along, i: usize, phi_v: f64) -> f64 {
        match self {
            Variable::BicepAngle => along.theta_b[i][0],
            Variable::BicepRate => along.theta_b[i][1],
            Variable::LozengeAngle => along.theta_dea_rad[i],
            Variable::AreaStretch | Variable::LargestStretch => along.area_stretch[i],
            Variable::SeriesTime => along.when.series_s + along.step_s * i as f64,
            Variable::Voltage | Variable::VoltageRate => phi_v.abs(),
            Variable::SquaredVoltage => phi_v * phi_v,
            Variable::CubedVoltage => phi_v.abs().powi(3),
            // no robot's: files that say so are refused
            _ => f64::NAN,
        }
    }

    /// Whether it looks back: it has a state z in forward dynamics.
    fn looks_back(self) -> bool {
        matches!(self, Variable::LargestStretch | Variable::VoltageRate)
    }

    /// Its value where [`Variable::now`] is `x` and its state `z`.
    fn seen(self, x: f64, z: f64) -> f64 {
        match self {
            Variable::LargestStretch => x.max(z),
            Variable::VoltageRate => (x - z) / RATE_S,
            _ => x,
        }
    }

    /// Whether forward dynamics know no rate of it, so that one more state follows it closely.
    fn followed(self) -> bool {
        !matches!(self, Variable::BicepAngle | Variable::LozengeAngle)
    }

    /// z' there.
    fn state_rate(self, x: f64, z: f64) -> f64 {
        match self {
            Variable::LargestStretch => (x - z).max(0.0) / FOLLOW_S,
            Variable::VoltageRate => (x - z) / RATE_S,
            _ => 0.0,
        }
    }

    /// A typical size, in its unit.
    fn size(self) -> f64 {
        match self {
            Variable::Voltage => 1e3,
            Variable::SquaredVoltage => 1e6,
            Variable::CubedVoltage => 1e9,
            Variable::VoltageRate => 1e4,
            _ => 1.0,
        }
    }
}

/// The shape of a learnt term.
#[derive(Debug, Clone, PartialEq)]
pub enum Form {
    /// Of one variable, times a power of another.
    Spline {
        /// The variable.
        of: Variable,
        /// Rising, in its unit.
        knots: Vec<f64>,
        /// What it is multiplied with.
        by: Option<Variable>,
    },
    /// Of one variable, over these ranges of it.
    Presliding {
        /// The variable.
        of: Variable,
        /// In its unit.
        ranges: Vec<f64>,
    },
    /// Of one variable, with these times, times another.
    Lag {
        /// The variable.
        of: Variable,
        /// Time constants, s.
        times_s: Vec<f64>,
        /// What it is multiplied with.
        by: Option<Variable>,
    },
    /// Of time.
    Wave {
        /// Frequency, Hz.
        frequency_hz: f64,
        /// What it is multiplied with.
        by: Option<Variable>,
    },
    /// Of the voltages of the other actuators.
    Neighbours,
    /// Of the position of the end effector.
    Potential {
        /// Centres, m.
        centres_m: Vec<Vec3>,
        /// Width, m.
        width_m: f64,
    },
    /// Of the position of the end effector along one direction: a force along it.
    Ridge {
        /// The direction, of length 1.
        along: Vec3,
        /// Rising, m.
        knots: Vec<f64>,
    },
    /// Of the position of the end effector about a point.
    Affine {
        /// The point, m.
        about_m: Vec3,
    },
    /// Of the velocity of the end effector.
    Drag,
    /// Of the velocity of the end effector.
    Oscillator {
        /// Natural frequency, Hz.
        frequency_hz: f64,
        /// Damping over the critical one.
        damping: f64,
    },
}

/// Pairs of axes of a symmetric matrix.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

impl Form {
    /// Number of coefficients.
    pub fn count(&self) -> usize {
        match self {
            Form::Spline { knots, .. } | Form::Ridge { knots, .. } => knots.len(),
            Form::Presliding { ranges, .. } => ranges.len(),
            Form::Lag { times_s, .. } => times_s.len(),
            Form::Wave { .. } | Form::Neighbours => 2,
            Form::Potential { centres_m, .. } => centres_m.len(),
            Form::Affine { .. } => 9,
            Form::Drag | Form::Oscillator { .. } => 6,
        }
    }

    /// The coordinates that it depends on, as files write them.
    pub fn variables(&self) -> Vec<&'static str> {
        let names = |of: &Variable, by: &Option<Variable>| {
            let mut out = vec![of.name()];
            out.extend(by.map(Variable::name));
            out
        };
        match self {
            Form::Spline { of, by, .. } | Form::Lag { of, by, .. } => names(of, by),
            Form::Presliding { of, .. } => vec![of.name(), "direction of motion"],
            Form::Wave { by, .. } => {
                let mut out = vec!["time"];
                out.extend(by.map(Variable::name));
                out
            }
            Form::Neighbours => vec!["voltages of the other actuators"],
            Form::Potential { .. } | Form::Affine { .. } | Form::Ridge { .. } => {
                vec!["effector x", "effector y", "effector z"]
            }
            Form::Drag => vec!["effector velocity"],
            Form::Oscillator { .. } => vec!["effector velocity", "history"],
        }
    }

    /// Whether it is one of a single coordinate.
    pub fn of_coordinate(&self) -> bool {
        let [of, by] = self.of_and_by();
        of.is_some_and(Variable::of_coordinate) && by.is_none_or(Variable::of_coordinate)
    }

    /// The variable, and what it is multiplied with, where it has them.
    fn of_and_by(&self) -> [Option<Variable>; 2] {
        match self {
            Form::Spline { of, by, .. } | Form::Lag { of, by, .. } => [Some(*of), *by],
            Form::Presliding { of, .. } => [Some(*of), None],
            Form::Wave { by, .. } => [None, *by],
            _ => [None; 2],
        }
    }

    /// Whether it depends on the voltage.
    fn electrical(&self) -> bool {
        let volts = |v: Variable| {
            matches!(
                v,
                Variable::Voltage
                    | Variable::SquaredVoltage
                    | Variable::CubedVoltage
                    | Variable::VoltageRate
            )
        };
        *self == Form::Neighbours || self.of_and_by().into_iter().flatten().any(volts)
    }

    /// Whether it remembers earlier samples.
    pub fn remembers(&self) -> bool {
        self.states() > 0
    }

    /// Whether it is a force on the end effector, whatever the actuator.
    pub fn is_force(&self) -> bool {
        matches!(
            self,
            Form::Potential { .. }
                | Form::Affine { .. }
                | Form::Ridge { .. }
                | Form::Drag
                | Form::Oscillator { .. }
        )
    }

    /// Number of the states of its memory in forward dynamics: of one actuator, of a force along one axis.
    pub fn states(&self) -> usize {
        self.state_sizes().len()
    }

    /// Typical sizes of those states, in the order of [`Learnt::start`].
    pub fn state_sizes(&self) -> Vec<f64> {
        let back = self.of_and_by().into_iter().flatten();
        let mut out: Vec<f64> = (back.filter(|v| v.looks_back()))
            .map(|v| match v {
                Variable::VoltageRate => Variable::Voltage.size(),
                _ => v.size(),
            })
            .collect();
        match self {
            Form::Presliding { of, ranges } => {
                out.extend(of.followed().then(|| of.size()));
                out.extend(ranges.iter().map(|_| 1.0));
            }
            Form::Lag { of, times_s, .. } => out.extend(times_s.iter().map(|_| of.size())),
            Form::Oscillator { frequency_hz, .. } => {
                out.extend([1.0 / (std::f64::consts::TAU * frequency_hz), 1.0]);
            }
            _ => {}
        }
        out
    }
}

/// A learnt term: what it is but for its coefficients.
#[derive(Debug)]
pub struct Learnt {
    /// Where it acts.
    pub place: Place,
    /// Its shape.
    pub form: Form,
    /// Range of each of [`Form::variables`] that the recordings showed; empty where that is not known.
    pub range: Vec<[f64; 2]>,
    quantities: &'static [Quantity],
}

impl PartialEq for Learnt {
    fn eq(&self, other: &Self) -> bool {
        self.place == other.place && self.form == other.form
    }
}

/// The id under which files write learnt terms.
pub const ID: &str = "learnt";

impl Learnt {
    /// A term of this shape, for as long as the program runs: [`super::Acting`] refers to it.
    pub fn new(place: Place, form: Form, range: Vec<[f64; 2]>) -> &'static Learnt {
        let one = |i: usize| Quantity {
            name: format!("coefficient_{}", i + 1).leak(),
            unit: place.unit(),
            off: 0.0,
            // found with all the others, not one by one
            lower: 0.0,
            upper: 0.0,
            spread: 1.0,
            size: true,
        };
        let quantities: Vec<Quantity> = (0..form.count()).map(one).collect();
        Box::leak(Box::new(Learnt {
            place,
            form,
            range,
            quantities: quantities.leak(),
        }))
    }

    /// Whether it acts on the voltage: what it makes of it depends on it.
    pub fn electrical(&self) -> bool {
        let place = matches!(self.place, Place::Electrical | Place::Capacitance);
        !self.form.is_force() && (place || self.form.electrical())
    }

    /// What the coefficients `v` add along a recording: torque on theta_DEA, N m, or squared voltage, V^2.
    fn add(&self, v: &[f64], along: &Along, phi_v: &[f64], out: &mut [f64]) {
        let wanted: Vec<usize> = (0..v.len()).filter(|&j| v[j] != 0.0).collect();
        if wanted.is_empty() {
            return;
        }
        if self.form.is_force() {
            let force = self.force(v, along);
            for ((o, f), lever) in out.iter_mut().zip(&force).zip(along.force_lever) {
                *o += dot(*f, *lever);
            }
            return;
        }
        let mut sum = vec![0.0; out.len()];
        self.scalar(v, along, phi_v, &mut sum);
        for (i, (o, s)) in out.iter_mut().zip(&sum).enumerate() {
            let phi = phi_v.get(i).copied().unwrap_or(0.0);
            *o += self.at_place(*s, along, i, phi);
        }
    }

    /// What a sum of `s` at its place adds at a sample: torque on theta_DEA, N m, or squared voltage, V^2.
    fn at_place(&self, s: f64, along: &Along, i: usize, phi_v: f64) -> f64 {
        let electrical = self.electrical();
        match self.place {
            Place::Bicep | Place::Series if electrical => s,
            Place::Bicep | Place::Series => s / along.bicep_lever[i],
            Place::Film if electrical => {
                let theta = along.theta_dea_rad[i];
                s / along.lozenge.half_capacitance_slope(theta, along.eps_f_m)
            }
            Place::Film | Place::Force | Place::Electrical | Place::Coordinate => s,
            Place::Capacitance => s * phi_v * phi_v,
        }
    }

    fn scalar(&self, v: &[f64], along: &Along, phi_v: &[f64], sum: &mut [f64]) {
        let times = |by: &Option<Variable>, sum: &mut [f64]| {
            if let Some(by) = by {
                for (s, b) in sum.iter_mut().zip(by.along(along, phi_v)) {
                    *s *= b;
                }
            }
        };
        match &self.form {
            Form::Spline { of, knots, by } => {
                let curve = Curve::through(knots, v);
                for (s, x) in sum.iter_mut().zip(of.along(along, phi_v)) {
                    *s += curve.at(x);
                }
                times(by, sum);
            }
            Form::Presliding { of, ranges } => {
                let x = of.along(along, phi_v);
                for (c, range) in v.iter().zip(ranges).filter(|p| *p.0 != 0.0) {
                    let mut z = 0.0;
                    for i in 0..sum.len() {
                        if i > 0 {
                            let d = x[i] - x[i - 1];
                            z += (d.signum() - z) * (1.0 - (-d.abs() / range).exp());
                        }
                        sum[i] += c * z;
                    }
                }
            }
            Form::Lag { of, times_s, by } => {
                let x = of.along(along, phi_v);
                for (c, time) in v.iter().zip(times_s).filter(|p| *p.0 != 0.0) {
                    for (s, z) in sum.iter_mut().zip(lagging(&x, *time, along.step_s)) {
                        *s += c * z;
                    }
                }
                times(by, sum);
            }
            Form::Wave { frequency_hz, by } => {
                for (i, s) in sum.iter_mut().enumerate() {
                    *s += wave(v, *frequency_hz, along.time_s(i));
                }
                times(by, sum);
            }
            Form::Neighbours => {
                for (i, s) in sum.iter_mut().enumerate() {
                    let of = |k: usize| along.others_v[k].get(i).copied().unwrap_or(0.0);
                    *s += phi_v[i] * (v[0] * of(0) + v[1] * of(1));
                }
            }
            _ => unreachable!("forces"),
        }
    }

    /// The force on the end effector along a recording, N.
    pub fn force(&self, v: &[f64], along: &Along) -> Vec<Vec3> {
        let n = along.position_m.len();
        let mut out = vec![[0.0; 3]; n];
        match &self.form {
            Form::Potential { centres_m, width_m } => {
                let square = width_m * width_m;
                for (c, centre) in v.iter().zip(centres_m).filter(|p| *p.0 != 0.0) {
                    for (f, u) in out.iter_mut().zip(along.position_m) {
                        let d = [0, 1, 2].map(|i| u[i] - centre[i]);
                        let e = c / square * (-0.5 * dot(d, d) / square).exp();
                        for i in 0..3 {
                            f[i] += e * d[i];
                        }
                    }
                }
            }
            Form::Ridge { along: axis, knots } => {
                let curve = Curve::through(knots, v);
                for (f, u) in out.iter_mut().zip(along.position_m) {
                    let size = curve.at(dot(*axis, *u));
                    for i in 0..3 {
                        f[i] += size * axis[i];
                    }
                }
            }
            Form::Affine { about_m } => {
                for (f, u) in out.iter_mut().zip(along.position_m) {
                    let d = [0, 1, 2].map(|i| u[i] - about_m[i]);
                    for i in 0..3 {
                        f[i] += v[i];
                    }
                    symmetric(&v[3..], d, f);
                }
            }
            Form::Drag => {
                for (f, speed) in out.iter_mut().zip(along.velocity_m_s) {
                    let size = dot(*speed, *speed).sqrt();
                    for i in 0..3 {
                        f[i] += (v[i] + v[3 + i] * size) * speed[i];
                    }
                }
            }
            Form::Oscillator { .. } => {
                for (f, p) in out.iter_mut().zip(self.pulled(along)) {
                    symmetric(v, p, f);
                }
            }
            _ => {}
        }
        out
    }

    /// What a mass of 1 kg on the spring pulls along each axis, N, along a recording.
    fn pulled(&self, along: &Along) -> Vec<Vec3> {
        let mut out = vec![[0.0; 3]; along.velocity_m_s.len()];
        let Form::Oscillator {
            frequency_hz,
            damping,
        } = self.form
        else {
            return out;
        };
        let omega = std::f64::consts::TAU * frequency_hz;
        let step = Swing::over(omega, damping, along.step_s);
        for axis in 0..3 {
            let mut s = [0.0; 2];
            for (i, v) in along.velocity_m_s.iter().enumerate() {
                if i > 0 {
                    s = step.next(s, along.velocity_m_s[i - 1][axis], v[axis]);
                }
                out[i][axis] = -swing_rate(omega, damping, s, v[axis])[1];
            }
        }
        out
    }

    /// The states of its memory where a robot rests, whose one sample is `along`, with `phi_v` at hand: those
    /// of the variables that look back, what follows the variable of a presliding, then those of the form.
    pub fn start(&self, along: &Along, phi_v: f64, z: &mut [f64]) {
        z.fill(0.0);
        let mut at = 0;
        for variable in self.form.of_and_by().into_iter().flatten() {
            if variable.looks_back() {
                z[at] = variable.now(along, 0, phi_v);
                at += 1;
            }
        }
        let ([of, _], at) = self.shown(along, phi_v, z);
        match &self.form {
            Form::Presliding { of: which, .. } if which.followed() => z[at] = of,
            Form::Lag { .. } => z[at..].fill(of),
            _ => {}
        }
    }

    /// The rates of those states. `theta_dea_rate_rad_s` is what a sample does not have.
    pub fn rates(
        &self,
        along: &Along,
        theta_dea_rate_rad_s: f64,
        phi_v: f64,
        z: &[f64],
        rate: &mut [f64],
    ) {
        let back = self.form.of_and_by().into_iter().flatten();
        for (i, variable) in back.filter(|v| v.looks_back()).enumerate() {
            rate[i] = variable.state_rate(variable.now(along, 0, phi_v), z[i]);
        }
        let ([x, _], mut at) = self.shown(along, phi_v, z);
        match &self.form {
            Form::Presliding { of, ranges } => {
                let speed = match of {
                    Variable::BicepAngle => along.theta_b[0][1],
                    Variable::LozengeAngle => theta_dea_rate_rad_s,
                    _ => {
                        rate[at] = (x - z[at]) / FOLLOW_S;
                        at += 1;
                        rate[at - 1]
                    }
                };
                for (j, range) in ranges.iter().enumerate() {
                    rate[at + j] = (speed - z[at + j] * speed.abs()) / range;
                }
            }
            Form::Lag { times_s, .. } => {
                for (j, time) in times_s.iter().enumerate() {
                    rate[at + j] = (x - z[at + j]) / time;
                }
            }
            _ => {}
        }
    }

    /// What the coefficients `v` add at one sample with these states, as [`Effect::torque`] (times the lever
    /// that `along` has) and [`Effect::voltage`] add it; not of a force.
    pub fn added(&self, v: &[f64], along: &Along, phi_v: f64, z: &[f64]) -> f64 {
        let ([of, by], at) = self.shown(along, phi_v, z);
        let mixed = |z: &[f64]| v.iter().zip(z).map(|(c, z)| c * z).sum::<f64>();
        let sum = match &self.form {
            Form::Spline { knots, .. } => Curve::through(knots, v).at(of) * by,
            Form::Presliding { of, .. } => mixed(&z[at + usize::from(of.followed())..]),
            Form::Lag { .. } => mixed(&z[at..]) * by,
            Form::Wave { frequency_hz, .. } => wave(v, *frequency_hz, along.time_s(0)) * by,
            _ => {
                let mut sum = [0.0];
                self.scalar(v, along, &[phi_v], &mut sum);
                sum[0]
            }
        };
        self.at_place(sum, along, 0, phi_v)
    }

    /// The force at one sample, N: of a swing, the part that its mass along `axis` pulls, with the rates of
    /// its states; of what has no states all of it, with the first axis.
    pub fn pull(&self, v: &[f64], along: &Along, axis: usize, z: &[f64], rate: &mut [f64]) -> Vec3 {
        match self.form {
            Form::Oscillator {
                frequency_hz,
                damping,
            } => {
                let omega = std::f64::consts::TAU * frequency_hz;
                let speed = along.velocity_m_s[0][axis];
                rate.copy_from_slice(&swing_rate(omega, damping, [z[0], z[1]], speed));
                let (mut pulled, mut force) = ([0.0; 3], [0.0; 3]);
                pulled[axis] = -rate[1];
                symmetric(v, pulled, &mut force);
                force
            }
            _ if axis == 0 => self.force(v, along)[0],
            _ => [0.0; 3],
        }
    }

    /// The voltage, V, whose square is `more` above that of `phi_v`, but never below 0.
    pub fn raised(phi_v: f64, more: f64) -> f64 {
        match more == 0.0 {
            true => phi_v,
            false => (phi_v * phi_v + more).max(0.0).sqrt().copysign(phi_v),
        }
    }

    /// What the variables show at one sample, 1 where there is none, and where the form's own states begin.
    fn shown(&self, along: &Along, phi_v: f64, z: &[f64]) -> ([f64; 2], usize) {
        let mut at = 0;
        let shown = self.form.of_and_by().map(|variable| {
            let Some(variable) = variable else { return 1.0 };
            let now = variable.now(along, 0, phi_v);
            if !variable.looks_back() {
                return now;
            }
            at += 1;
            variable.seen(now, z[at - 1])
        });
        (shown, at)
    }

    /// What each coefficient makes of a spline or a ridge at a value of its variable; nothing of other forms.
    pub fn at(&self, x: f64) -> Vec<f64> {
        let (Form::Spline { knots, .. } | Form::Ridge { knots, .. }) = &self.form else {
            return Vec::new();
        };
        units(knots, &[x], &[1.0]).concat()
    }

    /// Second derivatives at its knots of the curve that the coefficients `v` make of a spline or a ridge;
    /// nothing of other forms.
    pub fn bends(&self, v: &[f64]) -> Vec<f64> {
        match &self.form {
            Form::Spline { knots, .. } | Form::Ridge { knots, .. } => Curve::through(knots, v).bend,
            _ => Vec::new(),
        }
    }

    /// What the coefficients `v` make along a recording, in the unit of the place: of a force its size.
    pub fn made(&self, v: &[f64], along: &Along, phi_v: &[f64]) -> Vec<f64> {
        if self.form.is_force() {
            let size = |f: &Vec3| dot(*f, *f).sqrt();
            return self.force(v, along).iter().map(size).collect();
        }
        let mut out = vec![0.0; along.samples()];
        self.scalar(v, along, phi_v, &mut out);
        out
    }

    /// What each coefficient alone adds along a recording, as [`Effect::torque`] and [`Effect::voltage`] add
    /// it.
    pub fn columns(&self, along: &Along, phi_v: &[f64]) -> Vec<Vec<f64>> {
        let n = along.samples();
        if matches!(self.form, Form::Oscillator { .. }) {
            let pulled = self.pulled(along);
            let of = |(i, j): (usize, usize)| {
                let torque = |(p, l): (&Vec3, &Vec3)| match i == j {
                    true => p[i] * l[i],
                    false => p[j] * l[i] + p[i] * l[j],
                };
                pulled.iter().zip(along.force_lever).map(torque).collect()
            };
            return PAIRS.into_iter().map(of).collect();
        }
        if let Form::Spline { of, knots, by } = &self.form {
            let x = of.along(along, phi_v);
            let by = by.map(|by| by.along(along, phi_v));
            let scale = |i: usize| {
                let by = by.as_ref().map_or(1.0, |by| by[i]);
                self.at_place(by, along, i, phi_v.get(i).copied().unwrap_or(0.0))
            };
            let scale: Vec<f64> = (0..n).map(scale).collect();
            return units(knots, &x, &scale);
        }
        if let Form::Ridge { along: axis, knots } = &self.form {
            let x: Vec<f64> = along.position_m.iter().map(|u| dot(*axis, *u)).collect();
            let scale: Vec<f64> = along.force_lever.iter().map(|l| dot(*axis, *l)).collect();
            return units(knots, &x, &scale);
        }
        let one = |j: usize| {
            let mut v = vec![0.0; self.form.count()];
            v[j] = 1.0;
            let mut out = vec![0.0; n];
            self.add(&v, along, phi_v, &mut out);
            out
        };
        (0..self.form.count()).map(one).collect()
    }
}

/// A variable of a single coordinate along a recording.
fn along_coordinate(variable: Variable, view: &View) -> Vec<f64> {
    let n = view.xi.len();
    match variable {
        Variable::Excursion => view.xi.to_vec(),
        Variable::ExcursionRate => view.rate.to_vec(),
        Variable::SquaredExcursionRate => view.rate.iter().map(|r| r * r).collect(),
        Variable::ExcursionAcceleration => (0..n)
            .map(|i| {
                let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
                let time_s = (view.time_s[b] - view.time_s[a]).max(f64::MIN_POSITIVE);
                (view.rate[b] - view.rate[a]) / time_s
            })
            .collect(),
        Variable::LargestExcursion => (view.xi.iter())
            .scan(0.0_f64, |largest, x| {
                *largest = largest.max(x.abs());
                Some(*largest)
            })
            .collect(),
        Variable::Sliding => super::line::sliding(view.way, SLID),
        _ => vec![f64::NAN; n],
    }
}

/// Excursion within which [`Variable::Sliding`] follows a direction.
const SLID: f64 = 0.01;

/// Of a single coordinate.
impl Learnt {
    /// What each coefficient alone adds along a recording, over the largest force that was measured.
    pub fn columns_along(&self, view: &View) -> Vec<Vec<f64>> {
        let scaled = |mut columns: Vec<Vec<f64>>, by: &Option<Variable>| {
            if let Some(by) = by {
                let by = along_coordinate(*by, view);
                for column in &mut columns {
                    column.iter_mut().zip(&by).for_each(|(c, b)| *c *= b);
                }
            }
            columns
        };
        match &self.form {
            Form::Spline { of, knots, by } => {
                let x = along_coordinate(*of, view);
                scaled(units(knots, &x, &vec![1.0; x.len()]), by)
            }
            Form::Presliding { of, ranges } => {
                let x = match of {
                    Variable::Excursion => view.way.to_vec(),
                    of => along_coordinate(*of, view),
                };
                (ranges.iter())
                    .map(|range| super::line::sliding(&x, *range))
                    .collect()
            }
            Form::Lag { of, times_s, by } => {
                let x = along_coordinate(*of, view);
                let column = |tau_s: &f64| {
                    lagging_by(&x, |i| {
                        decays((view.time_s[i] - view.time_s[i - 1]) / tau_s)
                    })
                };
                scaled(times_s.iter().map(column).collect(), by)
            }
            _ => Vec::new(),
        }
    }

    /// What the coefficients `v` make along a recording, over the largest force that was measured.
    pub fn made_along(&self, v: &[f64], view: &View) -> Vec<f64> {
        let mut out = vec![0.0; view.xi.len()];
        for (c, column) in v.iter().zip(self.columns_along(view)) {
            out.iter_mut().zip(&column).for_each(|(o, x)| *o += c * x);
        }
        out
    }

    /// The range of each of [`Form::variables`] along a recording.
    pub fn ranges_along(&self, view: &View) -> Vec<[f64; 2]> {
        let over = |values: Vec<f64>| {
            let finite = values.into_iter().filter(|v| v.is_finite());
            finite.fold(NOTHING, |[low, high], v| [low.min(v), high.max(v)])
        };
        let one = |name: &'static str| match Variable::named(name) {
            Some(variable) => over(along_coordinate(variable, view)),
            None => [-1.0, 1.0],
        };
        self.form.variables().into_iter().map(one).collect()
    }
}

/// The curves through 1 at one knot and 0 at the others, at values, each times its scale.
fn units(knots: &[f64], x: &[f64], scale: &[f64]) -> Vec<Vec<f64>> {
    let cells: Vec<Cell> = x.iter().map(|x| Cell::of(knots, *x)).collect();
    let mut value = vec![0.0; knots.len()];
    (0..knots.len())
        .map(|j| {
            value.fill(0.0);
            value[j] = 1.0;
            let curve = Curve::through(knots, &value);
            let at = |(c, s): (&Cell, &f64)| s * curve.of(c);
            cells.iter().zip(scale).map(at).collect()
        })
        .collect()
}

/// A sine and a cosine of time.
fn wave(v: &[f64], frequency_hz: f64, t_s: f64) -> f64 {
    let turn = std::f64::consts::TAU * frequency_hz * t_s;
    v[0] * turn.sin() + v[1] * turn.cos()
}

/// Adds a symmetric matrix times a vector.
fn symmetric(m: &[f64], d: Vec3, f: &mut Vec3) {
    for (c, (i, j)) in m.iter().zip(PAIRS) {
        f[i] += c * d[j];
        if i != j {
            f[j] += c * d[i];
        }
    }
}

/// b' = p - v, p' = -omega^2 b - 2 zeta omega b': b behind, p the mass's speed.
pub fn swing_rate(omega: f64, zeta: f64, [b, p]: [f64; 2], v: f64) -> [f64; 2] {
    let rate = p - v;
    [rate, -omega * omega * b - 2.0 * zeta * omega * rate]
}

/// A step of that swing with a speed that goes straight from one sample to the next: linear in the state and
/// in both speeds.
struct Swing([[f64; 4]; 2]);

impl Swing {
    /// Runge-Kutta steps of a small part of a radian.
    fn over(omega: f64, zeta: f64, step_s: f64) -> Self {
        let parts = (20.0 * omega * step_s * (1.0 + zeta)).ceil().max(1.0);
        let h = step_s / parts;
        let mut columns = [[0.0; 2]; 4];
        for (which, column) in columns.iter_mut().enumerate() {
            let unit = |i: usize| if i == which { 1.0 } else { 0.0 };
            let mut s = [unit(0), unit(1)];
            for part in 0..parts as usize {
                let v = |x: f64| {
                    let x = (part as f64 + x) / parts;
                    (1.0 - x) * unit(2) + x * unit(3)
                };
                let on = |k: [f64; 2], x: f64| [0, 1].map(|i| s[i] + x * h * k[i]);
                let k1 = swing_rate(omega, zeta, s, v(0.0));
                let k2 = swing_rate(omega, zeta, on(k1, 0.5), v(0.5));
                let k3 = swing_rate(omega, zeta, on(k2, 0.5), v(0.5));
                let k4 = swing_rate(omega, zeta, on(k3, 1.0), v(1.0));
                s = [0, 1].map(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            }
            *column = s;
        }
        Swing([0, 1].map(|i| columns.map(|c| c[i])))
    }

    fn next(&self, [b, p]: [f64; 2], from: f64, to: f64) -> [f64; 2] {
        self.0
            .map(|r| r[0] * b + r[1] * p + r[2] * from + r[3] * to)
    }
}

/// A natural cubic spline that stays at its ends' values beyond them.
struct Curve<'a> {
    knots: &'a [f64],
    values: &'a [f64],
    /// Second derivatives at the knots.
    bend: Vec<f64>,
}

impl<'a> Curve<'a> {
    /// Second derivatives by Thomas's elimination.
    fn through(knots: &'a [f64], values: &'a [f64]) -> Self {
        let n = knots.len();
        let (mut upper, mut bend) = (vec![0.0; n], vec![0.0; n]);
        for i in 1..n.saturating_sub(1) {
            let (h0, h1) = (knots[i] - knots[i - 1], knots[i + 1] - knots[i]);
            let right = (values[i + 1] - values[i]) / h1 - (values[i] - values[i - 1]) / h0;
            let pivot = (h0 + h1) / 3.0 - h0 / 6.0 * upper[i - 1];
            upper[i] = h1 / 6.0 / pivot;
            bend[i] = (right - h0 / 6.0 * bend[i - 1]) / pivot;
        }
        for i in (1..n.saturating_sub(1)).rev() {
            bend[i] -= upper[i] * bend[i + 1];
        }
        Curve {
            knots,
            values,
            bend,
        }
    }

    fn at(&self, x: f64) -> f64 {
        self.of(&Cell::of(self.knots, x))
    }

    fn of(&self, c: &Cell) -> f64 {
        let i = c.knot;
        c.values[0] * self.values[i]
            + c.values[1] * self.values[i + 1]
            + c.bends[0] * self.bend[i]
            + c.bends[1] * self.bend[i + 1]
    }
}

/// Where a value lies among knots: between which two, and what their values and second derivatives count.
struct Cell {
    knot: usize,
    values: [f64; 2],
    bends: [f64; 2],
}

impl Cell {
    fn of(knots: &[f64], x: f64) -> Self {
        let n = knots.len();
        let x = x.clamp(knots[0], knots[n - 1]);
        let knot = knots.partition_point(|k| *k <= x).clamp(1, n - 1) - 1;
        let h = knots[knot + 1] - knots[knot];
        let b = (x - knots[knot]) / h;
        let a = 1.0 - b;
        Cell {
            knot,
            values: [a, b],
            bends: [a, b].map(|s| (s * s * s - s) * h * h / 6.0),
        }
    }
}

impl Effect for Learnt {
    fn id(&self) -> &'static str {
        ID
    }
    fn says(&self) -> &'static str {
        self.place.says()
    }
    fn over_series(&self, _: &[f64]) -> bool {
        let of_series = Variable::SeriesTime.name();
        self.form.variables().contains(&of_series)
    }
    fn source(&self) -> &'static str {
        "learnt from recordings"
    }
    fn equation(&self) -> &'static str {
        "what its terms make at its place, added up"
    }
    fn part(&self, _: &[f64]) -> Part {
        match self.place {
            Place::Bicep | Place::Series => Part::BicepJoint,
            Place::Film | Place::Capacitance => Part::Film,
            Place::Force | Place::Coordinate => Part::Effector,
            Place::Electrical => Part::Lead,
        }
    }
    fn parameters(&self) -> &'static [Quantity] {
        self.quantities
    }
    fn site(&self) -> Site {
        match self.electrical() {
            true => Site::Electrical,
            false => Site::Balance,
        }
    }
    fn reach(&self) -> Reach {
        match self.place {
            Place::Force | Place::Coordinate => Reach::All,
            _ => Reach::AllOrOne,
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "the drives that it was learnt from"
    }
    fn remembers(&self) -> bool {
        self.form.remembers()
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Learnt(self)
    }
    fn hears_others(&self) -> bool {
        self.form == Form::Neighbours
    }
    fn learnt(&self) -> Option<&Learnt> {
        Some(self)
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        let mut added = vec![0.0; phi_v.len()];
        self.add(v, along, phi_v, &mut added);
        for (phi, more) in phi_v.iter_mut().zip(added) {
            *phi = Learnt::raised(*phi, more);
        }
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        self.add(v, along, &[], torque_n_m);
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        for (force, more) in terms.force.iter_mut().zip(self.made_along(v, view)) {
            *force += more;
        }
    }
}

impl Place {
    /// The one that files write so.
    pub fn named(name: &str) -> Option<Self> {
        Place::ALL.into_iter().find(|p| p.name() == name)
    }
}

impl Variable {
    /// The one that files write so.
    pub fn named(name: &str) -> Option<Self> {
        Variable::ALL.into_iter().find(|v| v.name() == name)
    }
}

/// What is smallest and largest of nothing.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

impl Form {
    /// All names of forms.
    pub const NAMES: [&'static str; 10] = [
        "spline",
        "presliding",
        "lag",
        "wave",
        "neighbours",
        "potential",
        "ridge",
        "affine",
        "drag",
        "oscillator",
    ];

    /// As files write it: one of [`Form::NAMES`].
    pub fn name(&self) -> &'static str {
        match self {
            Form::Spline { .. } => "spline",
            Form::Presliding { .. } => "presliding",
            Form::Lag { .. } => "lag",
            Form::Wave { .. } => "wave",
            Form::Neighbours => "neighbours",
            Form::Potential { .. } => "potential",
            Form::Ridge { .. } => "ridge",
            Form::Affine { .. } => "affine",
            Form::Drag => "drag",
            Form::Oscillator { .. } => "oscillator",
        }
    }

    /// What it adds, of its coefficients c_j and its variables x and (where it is multiplied with one) y;
    /// u is the position of the end effector, v its velocity.
    pub fn formula(&self) -> &'static str {
        match self {
            Form::Spline { by: None, .. } => {
                "the natural cubic spline s(x) through values at knots, held beyond the first and the last"
            }
            Form::Spline { .. } => {
                "y s(x), s the natural cubic spline through values at knots, held beyond the first and the last"
            }
            Form::Presliding { .. } => "sum of c_j z_j, dz_j = (sign(dx) - z_j) |dx|/w_j, w widths",
            Form::Lag { by: None, .. } => "sum of c_j z_j, tau_j z_j' = x - z_j, tau times",
            Form::Lag { .. } => "y times the sum of c_j z_j, tau_j z_j' = x - z_j, tau times",
            Form::Wave { by: None, .. } => "c_1 sin(2 pi f t) + c_2 cos(2 pi f t), f the frequency",
            Form::Wave { .. } => "y (c_1 sin(2 pi f t) + c_2 cos(2 pi f t)), f the frequency",
            Form::Neighbours => {
                "phi (c_1 phi_next + c_2 phi_previous), phi_next that of actuator k + 1, 1 after 3"
            }
            Form::Potential { .. } => {
                "-grad of the sum of c_j exp(-|u - u_j|^2/(2 w^2)), u_j centres, w the width"
            }
            Form::Ridge { .. } => {
                "e s(e . u), e the direction, s the natural cubic spline through values at knots, held beyond the first and the last"
            }
            Form::Affine { .. } => {
                "[c_1, c_2, c_3] + [[c_4, c_7, c_8], [c_7, c_5, c_9], [c_8, c_9, c_6]] (u - u_0), u_0 about"
            }
            Form::Drag => "[c_1 v_x, c_2 v_y, c_3 v_z] + |v| [c_4 v_x, c_5 v_y, c_6 v_z]",
            Form::Oscillator { .. } => {
                "[[c_1, c_4, c_5], [c_4, c_2, c_6], [c_5, c_6, c_3]] q, q = w^2 b + 2 d w b', b'' + q + v' = 0, w = 2 pi f, f the frequency, d the damping"
            }
        }
    }

    /// The places where it can act: forces at the force alone, and what the voltage makes not at the
    /// joints.
    pub fn places(&self) -> Vec<Place> {
        let fits = |p: &Place| match (self, p) {
            (
                Form::Potential { .. }
                | Form::Ridge { .. }
                | Form::Affine { .. }
                | Form::Drag
                | Form::Oscillator { .. },
                p,
            ) => *p == Place::Force,
            (_, Place::Force) => false,
            (form, Place::Coordinate) => form.of_coordinate(),
            (form, _) if form.of_coordinate() => false,
            // a torque on theta_b is no squared voltage
            (_, Place::Bicep | Place::Series) => !self.electrical(),
            _ => true,
        };
        Place::ALL.into_iter().filter(fits).collect()
    }

    /// Units of [`Form::variables`].
    pub fn units(&self) -> Vec<&'static str> {
        let unit = |name: &'static str| match name {
            "direction of motion" => "1",
            "time" | "history" => "s",
            "voltages of the other actuators" => "V",
            "effector velocity" => "m/s",
            "effector x" | "effector y" | "effector z" => "m",
            other => Variable::named(other).map_or("1", Variable::unit),
        };
        self.variables().into_iter().map(unit).collect()
    }

    /// The range of each of [`Form::variables`] along a recording, where the voltage is `phi_v`, among the
    /// samples that count: of an effector's velocity its size, of the others' voltages their sizes, of the
    /// direction of motion -1 to 1, of history the time since the recording began. From infinity to
    /// -infinity where no sample counts or the variable is not known there.
    pub fn ranges(
        &self,
        along: &Along,
        phi_v: &[f64],
        counts: &dyn Fn(usize) -> bool,
    ) -> Vec<[f64; 2]> {
        let n = along.samples();
        let over = |at: &dyn Fn(usize) -> f64| {
            let all = (0..n).filter(|i| counts(*i)).map(at);
            all.filter(|v| v.is_finite())
                .fold(NOTHING, |[low, high], v| [low.min(v), high.max(v)])
        };
        let known = |v: Variable| {
            let values = v.along(along, phi_v);
            over(&|i| values[i])
        };
        let one = |name: &'static str| match name {
            "direction of motion" => match (0..n).any(counts) {
                true => [-1.0, 1.0],
                false => NOTHING,
            },
            "time" => over(&|i| along.time_s(i)),
            "history" => over(&|i| along.step_s * i as f64),
            "voltages of the other actuators" => {
                let of =
                    |k: usize| over(&|i| along.others_v[k].get(i).map_or(f64::NAN, |v| v.abs()));
                wider(of(0), of(1))
            }
            "effector velocity" => over(&|i| {
                let v = along.velocity_m_s[i];
                dot(v, v).sqrt()
            }),
            "effector x" => over(&|i| along.position_m[i][0]),
            "effector y" => over(&|i| along.position_m[i][1]),
            "effector z" => over(&|i| along.position_m[i][2]),
            other => Variable::named(other).map_or(NOTHING, known),
        };
        self.variables().into_iter().map(one).collect()
    }
}

/// The range that holds both.
pub fn wider(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// A variable that leaves the range in which a term was learnt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outside {
    /// Which of [`Form::variables`].
    pub variable: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The range that the recordings showed.
    pub learnt: [f64; 2],
    /// The range that is asked for.
    pub asked: [f64; 2],
}

impl Outside {
    /// How far it is below and above, in the unit; 0 at an end that it does not pass by more than 1 % of the
    /// range.
    pub fn by(&self) -> [f64; 2] {
        let margin = INSIDE * (self.learnt[1] - self.learnt[0]);
        let below = self.learnt[0] - self.asked[0];
        let above = self.asked[1] - self.learnt[1];
        [below, above].map(|by| if by > margin { by } else { 0.0 })
    }
}

/// Share of a range by which a variable may pass its ends and is still inside: recordings of one drive differ
/// by that.
const INSIDE: f64 = 0.01;

impl Learnt {
    /// The variables that leave their ranges where `asked` (of [`Form::ranges`]) is asked for, by more than
    /// 1 % of the range. What a term remembers fades, and a direction is one of two: neither leaves a range.
    pub fn outside(&self, asked: &[[f64; 2]]) -> Vec<Outside> {
        let names = self.form.variables();
        let each = names.into_iter().zip(self.form.units());
        let each = each.zip(self.range.iter().zip(asked));
        each.map(|((variable, unit), (learnt, asked))| Outside {
            variable,
            unit,
            learnt: *learnt,
            asked: *asked,
        })
        .filter(|o| !matches!(o.variable, "history" | "direction of motion"))
        .filter(|o| o.by() != [0.0; 2])
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_add_up_to_what_the_coefficients_add() {
        let knots = vec![0.0, 0.3, 1.0, 1.4];
        let values = [1.0, -2.0, 0.5, 0.7];
        let xs = [-0.2, 0.1, 0.3, 0.9, 1.39, 2.0];
        let units = units(&knots, &xs, &[2.0; 6]);
        let curve = Curve::through(&knots, &values);
        for (i, x) in xs.iter().enumerate() {
            let sum: f64 = units.iter().zip(values).map(|(u, v)| v * u[i]).sum();
            assert!((sum - 2.0 * curve.at(*x)).abs() < 1e-13);
        }
    }

    #[test]
    fn a_curve_passes_through_its_values_and_is_held_beyond() {
        let (knots, values) = ([0.0, 0.3, 1.0, 1.4], [1.0, -2.0, 0.5, 0.7]);
        let curve = Curve::through(&knots, &values);
        for (x, y) in knots.iter().zip(values) {
            assert!((curve.at(*x) - y).abs() < 1e-14);
        }
        assert_eq!(curve.at(-5.0), 1.0);
        assert!((curve.at(9.0) - 0.7).abs() < 1e-14);
        let slope = |x: f64| (curve.at(x + 1e-6) - curve.at(x - 1e-6)) / 2e-6;
        for x in [0.3, 1.0] {
            // a bend of 40 or so changes it by 2e-4 on the way
            assert!(
                (slope(x - 2e-6) - slope(x + 2e-6)).abs() < 1e-3,
                "kink at {x}"
            );
        }
    }

    #[test]
    fn an_oscillator_far_below_its_frequency_is_a_mass() {
        // forced slowly, the mass goes along: force -m a
        let (omega, h) = (40.0, 1e-2);
        let speed = |t: f64| (0.5 * t).sin();
        let step = Swing::over(omega, 0.5, h);
        let mut s = [0.0; 2];
        for i in 0..600 {
            let t = i as f64 * h;
            s = step.next(s, speed(t), speed(t + h));
        }
        let rate = swing_rate(omega, 0.5, s, speed(6.0))[1];
        assert!((rate - 0.5 * 3f64.cos()).abs() < 2e-2, "{rate}");
    }

    #[test]
    fn ranges_are_those_of_the_samples_that_count() {
        let lozenge = crate::kinematics::Lozenge {
            side_m: 0.03,
            l1_m: 0.02,
            l2_m: 0.02,
            l3_m: 5e-5,
            films: 1.0,
        };
        let along = Along {
            step_s: 0.5,
            when: super::super::When {
                start_s: 2.0,
                ..Default::default()
            },
            lozenge: &lozenge,
            eps_f_m: 1e-11,
            bicep_m: 0.05,
            theta_dea_rad: &[1.9, 2.0, 1.8, 9.0],
            area_stretch: &[1.3, 1.2, 1.4, 9.0],
            theta_b: &[
                [0.1, 1.0, 0.0],
                [0.2, -2.0, 0.0],
                [0.3, 0.5, 0.0],
                [9.0, 9.0, 9.0],
            ],
            bicep_lever: &[1.0; 4],
            force_lever: &[[0.0; 3]; 4],
            acceleration_m_s2: &[[0.0; 3]; 4],
            position_m: &[[0.1, 0.0, 1.0], [0.0, -0.2, 1.0], [0.0; 3], [9.0; 3]],
            velocity_m_s: &[[0.3, 0.4, 0.0], [0.0; 3], [0.0, 0.0, -2.0], [9.0; 3]],
            others_v: [&[1.0, -5.0, 2.0, 99.0], &[0.5, 3.0, f64::NAN, 99.0]],
        };
        let phi = [-7.0, 3.0, 1.0, 99.0];
        let of = |form: &Form| form.ranges(&along, &phi, &|i| i < 3);
        let curve = Form::Spline {
            of: Variable::BicepAngle,
            knots: vec![0.0, 1.0],
            by: Some(Variable::Voltage),
        };
        assert_eq!(of(&curve), [[0.1, 0.3], [1.0, 7.0]]);
        let wave = Form::Wave {
            frequency_hz: 1.0,
            by: Some(Variable::BicepRate),
        };
        assert_eq!(of(&wave), [[2.0, 3.0], [-2.0, 1.0]]);
        assert_eq!(of(&Form::Neighbours), [[0.5, 5.0]]);
        let affine = Form::Affine { about_m: [0.0; 3] };
        assert_eq!(of(&affine), [[0.0, 0.1], [-0.2, 0.0], [0.0, 1.0]]);
        assert_eq!(of(&Form::Drag), [[0.0, 2.0]]);
        let grip = Form::Presliding {
            of: Variable::BicepAngle,
            ranges: vec![0.1],
        };
        assert_eq!(of(&grip), [[0.1, 0.3], [-1.0, 1.0]]);
        let swing = Form::Oscillator {
            frequency_hz: 1.0,
            damping: 0.1,
        };
        assert_eq!(of(&swing), [[0.0, 2.0], [0.0, 1.0]]);
        // the time since the recording began leaves no range, the speed does
        let term = Learnt::new(Place::Force, swing, vec![[0.0, 1.0], [0.0, 0.5]]);
        let left = term.outside(&[[0.0, 2.0], [0.0, 1.0]]);
        assert_eq!(left.len(), 1);
        assert_eq!(
            (left[0].variable, left[0].by()),
            ("effector velocity", [0.0, 1.0])
        );
        assert_eq!(term.outside(&[[0.0, 1.009], [0.0, 0.5]]), []);
        // nothing asked for, or nothing known
        let none = curve.ranges(&along, &phi, &|_| false);
        assert_eq!(none, [NOTHING; 2]);
        let known = vec![[0.1, 0.3], [1.0, 7.0]];
        let term = Learnt::new(Place::Film, curve.clone(), known);
        assert_eq!(term.outside(&none), []);
        let term = Learnt::new(Place::Film, curve, Vec::new());
        assert_eq!(term.outside(&[[-9.0, 9.0]; 2]), []);
    }

    #[test]
    fn forces_act_at_the_force_alone_and_voltages_not_at_joints() {
        let spline = |of| Form::Spline {
            of,
            knots: vec![0.0, 1.0],
            by: None,
        };
        assert_eq!(Form::Drag.places(), [Place::Force]);
        let of_angle = spline(Variable::BicepAngle).places();
        assert_eq!(of_angle.len(), 5);
        assert!(!of_angle.contains(&Place::Force));
        let of_voltage = [Place::Film, Place::Electrical, Place::Capacitance];
        assert_eq!(spline(Variable::Voltage).places(), of_voltage);
        assert_eq!(Form::Neighbours.places(), of_voltage);
        // names are told apart
        for place in Place::ALL {
            assert_eq!(Place::named(place.name()), Some(place));
        }
        for variable in Variable::ALL {
            assert_eq!(Variable::named(variable.name()), Some(variable));
        }
        assert_eq!(Variable::named("voltag"), None);
    }
}
