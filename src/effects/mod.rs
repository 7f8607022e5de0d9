//! What the plain model leaves out: one cause a file. Switched off, a cause changes nothing, to the bit.
//!
//! An [`Effect`] says in one sentence what it is, has parameters with units and bounds, and acts at one
//! [`Site`] of the balance. It sees one actuator along one recording ([`Along`]) and knows nothing of fits.
//! Ids, parameter names and units are those of the catalogue that `diagnosis.json` and `parameters.toml` use.
//! The forms are textbook forms: a real cause is richer, so an estimate is the equivalent value that does the
//! same work.

mod actuator_asymmetry;
mod actuator_mass;
mod amplifier_deadband;
mod amplifier_gain;
mod amplifier_saturation;
mod angle_error;
mod backlash;
mod clock_skew;
mod command;
mod dated;
mod dielectric_relaxation;
mod electrode_failure;
mod electrode_stiffness;
mod electrode_viscosity;
mod end_stop;
mod film_law;
mod frame_tilt;
mod hinge_stiffness;
mod joint_damping;
mod joint_friction;
mod leakage;
pub mod learnt;
pub mod line;
mod link_length_error;
mod loss_of_tension;
mod marker_offset;
mod mocap_lag;
mod mullins_softening;
mod nonlinear_flow;
mod payload_change;
mod permittivity_stretch;
mod series_resistance;
mod slew_limit;
mod slow_creep;
mod space_charge;
mod temperature_drift;
mod thickness_error;
mod time_offset;

pub use command::command_for;
pub(crate) use dated::Dated;

use crate::film::Film;
use crate::kinematics::{Lozenge, Mechanism, Vec3};

/// Every cause that is known, in the order of the balance: electrical chain, film and lozenge, joints and
/// masses, measurement; and at the end, with ids `x_...`, those that are thought of only where none of the
/// others will do ([`is_rare`]).
pub const CATALOGUE: &[&dyn Effect] = &[
    &series_resistance::SeriesResistance,
    &leakage::Leakage,
    &amplifier_gain::AmplifierGain,
    &amplifier_deadband::AmplifierDeadband,
    &amplifier_saturation::AmplifierSaturation,
    &slew_limit::SlewLimit,
    &permittivity_stretch::PermittivityStretch,
    &dielectric_relaxation::DielectricRelaxation,
    &electrode_failure::ElectrodeFailure,
    &electrode_stiffness::ElectrodeStiffness,
    &hinge_stiffness::HingeStiffness,
    &mullins_softening::MullinsSoftening,
    &slow_creep::SlowCreep,
    &loss_of_tension::LossOfTension,
    &actuator_asymmetry::ActuatorAsymmetry,
    &temperature_drift::TemperatureDrift,
    &joint_friction::JointFriction,
    &joint_damping::JointDamping,
    &end_stop::EndStop,
    &actuator_mass::ActuatorMass,
    &link_length_error::LinkLengthError,
    &payload_change::PayloadChange,
    &time_offset::TimeOffset,
    &clock_skew::ClockSkew,
    &frame_tilt::FrameTilt,
    &marker_offset::MarkerOffset,
    &mocap_lag::MocapLag,
    &space_charge::SpaceCharge,
    &electrode_viscosity::ElectrodeViscosity,
    &nonlinear_flow::NonlinearFlow,
    &backlash::Backlash,
];

/// The cause with this id.
pub fn by_id(id: &str) -> Option<&'static dyn Effect> {
    CATALOGUE.iter().copied().find(|e| e.id() == id)
}

/// The name of a cause in words: its id without underscores, and without the mark of causes that no shared
/// list has.
#[must_use]
pub fn plain_name(id: &str) -> String {
    id.strip_prefix("x_").unwrap_or(id).replace('_', " ")
}

/// Whether a cause of a robot is thought of only where none of the others will do: nearly all that it does,
/// one of them does too.
pub fn is_rare(id: &str) -> bool {
    id.starts_with("x_")
}

/// Where a cause enters, and so what has to be worked out again when its values change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Site {
    /// Another torque in the balance.
    Balance,
    /// From the commanded voltage to the Maxwell torque.
    Electrical,
    /// The clock on which the command is read.
    Clock,
    /// The film's stress; what such a cause changes of the capacitance counts as well.
    Film,
    /// The mechanism, or what was measured of its motion.
    Motion,
}

/// A part of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// High-voltage amplifier.
    Amplifier,
    /// Wires from it to the film.
    Lead,
    /// Film with its electrodes.
    Film,
    /// Hinges of the lozenge.
    Hinges,
    /// The four-bar between bicep and lozenge.
    FourBar,
    /// The joint of a bicep at the base.
    BicepJoint,
    /// Bicep.
    Bicep,
    /// Forearm.
    Forearm,
    /// Base.
    Base,
    /// End effector.
    Effector,
    /// What the capture sees: the marker on the end effector.
    Marker,
    /// The clocks of voltage and motion.
    Clocks,
}

/// A kind of drive, by what it shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exercise {
    /// All actuators together, whole raised cosines at 0.2, 0.7 and 2.2 Hz: what depends on the rate.
    Rates,
    /// A staircase up and down, then the same with the sign turned: what depends on the voltage, and what a
    /// hold lets relax.
    Staircase,
    /// Held corners off the axis, each actuator high and low: what depends on the pose.
    Corners,
    /// Slow triangles with small reversals on both flanks: what depends on the direction.
    Reversals,
    /// A large cycle, a smaller one, a rest, the large one again: what depends on the past.
    Again,
}

/// What a cause keeps of an actuator from one instant to the next, where a motion is run forward or worked
/// out sample by sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Memory<'a> {
    /// Nothing.
    None,
    /// The charge of a film that is fed through a wire, C: of none where the value `resistance` is 0.
    Charge,
    /// Two slow polarisations, V.
    Polarisation,
    /// What charge in the film holds off, V.
    HeldOff,
    /// The amplifier's output, V.
    Output,
    /// Presliding, -1 to 1.
    Presliding,
    /// theta_b behind a play, now and at the beginning, rad.
    Play,
    /// The largest energy density, J/m^3.
    LargestEnergy,
    /// ln xi_1, ln xi_2 of a slow branch.
    Branch,
    /// ln xi_1, ln xi_2 of a branch that flows the faster the more it carries.
    Flow,
    /// sigma_2 at the beginning, Pa.
    Rest,
    /// theta_b', rad/s, followed closely: its difference is the acceleration.
    BicepRate,
    /// The end effector's velocity, m/s, followed closely.
    Velocity,
    /// What a learnt term has, of a force axis by axis.
    Learnt(&'a learnt::Learnt),
}

/// Which actuators a cause may sit in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// In all three at once, or in one.
    AllOrOne,
    /// In all three at once.
    All,
    /// In one.
    One,
}

impl Reach {
    /// The sets of actuators that a cause of this reach may sit in.
    pub fn sets(self) -> &'static [[bool; 3]] {
        const SETS: [[bool; 3]; 4] = [
            [true, true, true],
            [true, false, false],
            [false, true, false],
            [false, false, true],
        ];
        match self {
            Reach::AllOrOne => &SETS,
            Reach::All => &SETS[..1],
            Reach::One => &SETS[1..],
        }
    }
}

// Those of which a room needs just this one.
pub(crate) use amplifier_gain::AmplifierGain;
pub(crate) use angle_error::AngleError;
pub(crate) use electrode_failure::ElectrodeFailure;
pub(crate) use electrode_stiffness::ElectrodeStiffness;
pub(crate) use end_stop::EndStop;
pub(crate) use film_law::{LinearBranch, StretchExponent};
pub(crate) use frame_tilt::FrameTilt;
pub(crate) use joint_friction::level as friction_level;
pub(crate) use leakage::leak;
pub(crate) use link_length_error::LinkLengthError;
pub(crate) use marker_offset::MarkerOffset;
pub(crate) use nonlinear_flow::flow;
pub(crate) use payload_change::PayloadChange;
pub(crate) use series_resistance::{SeriesResistance, resistance_ohm};
pub(crate) use slow_creep::creep;
pub(crate) use thickness_error::ThicknessError;
pub(crate) use time_offset::TimeOffset;

/// One parameter of a cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Name, as files write it.
    pub name: &'static str,
    /// Unit, as files write it.
    pub unit: &'static str,
    /// The value at which it changes nothing; for a parameter that only shapes the cause, a usual value.
    pub off: f64,
    /// Smallest value that is physically possible.
    pub lower: f64,
    /// Largest value that is physically plausible.
    pub upper: f64,
    /// Spread of what is met in practice around `off` (for a shaping parameter: around the usual value).
    pub spread: f64,
    /// Whether it is a size of the cause (the residual is nearly proportional to it), or shapes it.
    pub size: bool,
}

impl Quantity {
    /// The name under which files write it: three that end in `_x`, `_y`, `_z` are one list (`offset`), and
    /// this is its place there.
    pub fn part(&self) -> (&'static str, Option<usize>) {
        let ends = ["_x", "_y", "_z"];
        let found = ends
            .iter()
            .enumerate()
            .find_map(|(i, end)| Some((self.name.strip_suffix(end)?, Some(i))));
        found.unwrap_or((self.name, None))
    }

    /// Whether it is a size up to or from which something happens, so that the residual is in no proportion
    /// to it.
    pub fn is_threshold(&self) -> bool {
        self.size && (self.off.is_infinite() || self.name == "threshold")
    }
}

/// The quantity of a size that is zero when off.
const fn size(
    name: &'static str,
    unit: &'static str,
    lower: f64,
    upper: f64,
    spread: f64,
) -> Quantity {
    Quantity {
        name,
        unit,
        off: 0.0,
        lower,
        upper,
        spread,
        size: true,
    }
}

/// The quantity of a shaping parameter.
const fn shape(
    name: &'static str,
    unit: &'static str,
    usual: f64,
    lower: f64,
    upper: f64,
    spread: f64,
) -> Quantity {
    Quantity {
        name,
        unit,
        off: usual,
        lower,
        upper,
        spread,
        size: false,
    }
}

/// When a recording was made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct When {
    /// Number of the recording in its series, from 0.
    pub recording: usize,
    /// Its first sample in the time of the series, s.
    pub series_s: f64,
    /// Its first sample on its own motion clock, s.
    pub start_s: f64,
}

/// One actuator along one recording, sample by sample.
#[derive(Debug, Clone, Copy)]
pub struct Along<'a> {
    /// Distance of the samples, s.
    pub step_s: f64,
    /// When the recording was made.
    pub when: When,
    /// Lozenge and unstretched film.
    pub lozenge: &'a Lozenge,
    /// Permittivity, F/m.
    pub eps_f_m: f64,
    /// Bicep length, m.
    pub bicep_m: f64,
    /// theta_DEA, rad.
    pub theta_dea_rad: &'a [f64],
    /// lambda_1 lambda_2.
    pub area_stretch: &'a [f64],
    /// theta_b, rad; its first and second time derivative, rad/s and rad/s^2.
    pub theta_b: &'a [[f64; 3]],
    /// d theta_DEA/d theta_b: a torque on the bicep divided by it is the torque on the lozenge that does the
    /// same work.
    pub bicep_lever: &'a [f64],
    /// The torque on this lozenge per force on the end effector: (G^-1)_k, N m/N.
    pub force_lever: &'a [Vec3],
    /// Acceleration of the end effector, m/s^2.
    pub acceleration_m_s2: &'a [Vec3],
    /// Its position, m.
    pub position_m: &'a [Vec3],
    /// Its velocity, m/s.
    pub velocity_m_s: &'a [Vec3],
    /// The voltages that the next and the previous actuator are told, V; empty where they are not known.
    pub others_v: [&'a [f64]; 2],
}

impl Along<'_> {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.theta_dea_rad.len()
    }

    /// Capacitance of the films at a sample, F: [`Lozenge::capacitance_f`].
    pub fn capacitance_f(&self, i: usize) -> f64 {
        self.lozenge
            .capacitance_of_area_f(self.area_stretch[i], self.eps_f_m)
    }

    /// Time of a sample on the motion clock of the recording, s.
    pub fn time_s(&self, i: usize) -> f64 {
        self.when.start_s + self.step_s * i as f64
    }

    /// Whether a change at `time_s` of recording number `recording` has happened at sample i.
    pub fn after(&self, i: usize, recording: f64, time_s: f64) -> bool {
        let here = self.when.recording as f64;
        here > recording || (here == recording && self.time_s(i) >= time_s)
    }
}

/// What the recordings show of the robot's range: where thresholds may lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Largest commanded voltage, V.
    pub voltage_v: f64,
    /// Steepest change of the command, V/s.
    pub rate_v_s: f64,
    /// Smallest and largest theta_b, rad.
    pub theta_b_rad: [f64; 2],
    /// Smallest and largest theta_DEA, rad.
    pub theta_dea_rad: [f64; 2],
}

/// The motion as it was measured: what a cause on the reading changes.
#[derive(Debug)]
pub struct Reading<'a> {
    /// Distance of the samples, s.
    pub step_s: f64,
    /// The point in the world about which the capture's axes would be rotated: the base marker less the
    /// marker's offset, m.
    pub pivot_m: Vec3,
    /// Position, m.
    pub position_m: &'a mut [Vec3],
    /// Velocity, m/s.
    pub velocity_m_s: &'a mut [Vec3],
    /// Acceleration, m/s^2.
    pub acceleration_m_s2: &'a mut [Vec3],
}

/// One cause that the plain model leaves out. Every method changes nothing unless the cause says otherwise;
/// `v` are the values of its parameters in their order.
pub trait Effect: Sync + Send {
    /// Id of the catalogue.
    fn id(&self) -> &'static str;
    /// One sentence of physics.
    fn says(&self) -> &'static str;
    /// Where the form is from.
    fn source(&self) -> &'static str;
    /// Its equation, one line of plain text in the names of its parameters. Of a robot: phi_c is the command
    /// and phi the voltage on the film, u the position and u_m the measured one, a prime a rate. Of a single
    /// coordinate: x is the excursion from rest, f the force that the model asks for, u the input and u_c its
    /// command, each over its largest value; v is the rate of x.
    fn equation(&self) -> &'static str;
    /// What it is easily taken for: ids of causes, and parts of the plain model in words; empty where nothing
    /// is stated. What given recordings cannot tell apart, a diagnosis works out from them.
    fn taken_for(&self) -> &'static [&'static str] {
        &[]
    }
    /// The part of a robot that it sits in, with these values.
    fn part(&self, _v: &[f64]) -> Part {
        Part::BicepJoint
    }
    /// Its parameters.
    fn parameters(&self) -> &'static [Quantity];
    /// Where it enters; unless stated, the balance.
    fn site(&self) -> Site {
        Site::Balance
    }
    /// Which actuators it may sit in; unless stated, all: a single coordinate has no others.
    fn reach(&self) -> Reach {
        Reach::All
    }
    /// Forms that are told apart by a word (which link), empty where there is one form only. The values carry
    /// its number first.
    fn variants(&self) -> &'static [&'static str] {
        &[]
    }
    /// Where a scan of a robot looks: values near off, one group a start. The columns of a group are varied
    /// together. Nowhere unless stated: what acts on a single coordinate only says where in
    /// [`line::LineEffect::near`].
    fn starts(&self, _seen: &Seen) -> Vec<Vec<Vec<f64>>> {
        Vec::new()
    }
    /// Values near which a plainer reading of the same form may do as well.
    fn plainer(&self, _v: &[f64]) -> Option<Vec<f64>> {
        None
    }
    /// Share by which it changes all torque that a voltage makes, to first order; 0 where it does not do
    /// that.
    fn share_of_made(&self, _v: &[f64]) -> f64 {
        0.0
    }
    /// Whether it scales all torque that a voltage makes, by nearly one share all along. Beside parts that
    /// may differ it can then shrink all torques, and the error with them.
    fn scales_made(&self) -> bool {
        false
    }
    /// Whether it goes on from one recording of a series to the next, with these values.
    fn over_series(&self, _v: &[f64]) -> bool {
        false
    }
    /// The drive that brings it out, in half a sentence.
    fn brought_out_by(&self) -> &'static str;
    /// The kinds of drive that a robot shows it by, the most telling first; unless stated, those that go all
    /// over its range.
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Corners, Exercise::Reversals]
    }

    /// Changes lengths.
    fn geometry(&self, _v: &[f64], _on: [bool; 3], _m: &mut Mechanism, _l: &mut [Lozenge; 3]) {}
    /// Whether it changes how the motion is read: [`Effect::reading`] does nothing otherwise.
    fn reads_otherwise(&self) -> bool {
        false
    }
    /// Changes the measured motion back to the true one.
    fn reading(&self, _v: &[f64], _motion: &mut Reading) {}
    /// Changes the true motion to the measured one; unless stated, by [`Effect::reading`] with the opposite
    /// values, which undo a shift or a rotation.
    fn captured(&self, v: &[f64], motion: &mut Reading) {
        let back: Vec<f64> = v.iter().map(|v| -v).collect();
        self.reading(&back, motion);
    }
    /// Whether what [`Effect::reading`] gives at a sample depends on later ones.
    fn looks_ahead(&self) -> bool {
        false
    }
    /// Time at which the command is read, s after the first frame, for a frame at `t_s`.
    fn clock(&self, _v: &[f64], t_s: f64) -> f64 {
        t_s
    }
    /// From the commanded voltage to the one that makes the Maxwell torque, V, sample by sample.
    fn voltage(&self, _v: &[f64], _along: &Along, _phi_v: &mut [f64]) {}
    /// Whether what [`Effect::voltage`] gives at a sample depends on earlier ones.
    fn remembers(&self) -> bool {
        false
    }
    /// What it keeps of an actuator where it is not given all samples at once.
    fn memory(&self) -> Memory<'_> {
        Memory::None
    }
    /// Whether [`Effect::voltage`] looks at [`Along::others_v`].
    fn hears_others(&self) -> bool {
        false
    }
    /// What it is where it was learnt from recordings and stands in no catalogue.
    fn learnt(&self) -> Option<&learnt::Learnt> {
        None
    }
    /// Changes 1/2 dC/d theta_DEA, N m/V^2.
    fn capacitance(&self, _v: &[f64], _along: &Along, _half_slope: &mut [f64]) {}
    /// Multiplies the stress of [equilibrium spring, branches].
    fn stress(&self, _v: &[f64], _along: &Along, _film: &Film, _factor: &mut [[f64; 2]]) {}
    /// Whether [`Effect::line`] looks at [`line::View::elastic`].
    fn sees_elastic(&self) -> bool {
        false
    }
    /// Changes what is asked of, or given to, a single coordinate ([`mod@line`]).
    fn line(&self, _v: &[f64], _view: &line::View, _terms: &mut line::Terms) {}
    /// Its law at one moment, where what it does to a single coordinate is told by that coordinate's course:
    /// such a cause runs forward as well. Causes of the input alone run forward as they stand.
    fn law(&self) -> Option<&dyn line::Forward> {
        None
    }
    /// Numbers of the recordings of which it has, after its own values, what its memory held where they begin
    /// ([`mod@line`]).
    fn under_way(&self) -> &[usize] {
        &[]
    }
    /// Whether it acts on the input of a single coordinate.
    fn drives(&self) -> bool {
        false
    }
    /// Share of an input of frequency `f_hz` that it passes on, on a single coordinate.
    fn passes(&self, _v: &[f64], _f_hz: f64) -> f64 {
        1.0
    }
    /// Whether what it makes of the input of a single coordinate depends on earlier samples.
    fn lags(&self) -> bool {
        false
    }
    /// Takes back what [`Effect::line`] makes of the input of a single coordinate.
    fn undo(&self, _v: &[f64], _undone: &mut line::Undone) {}
    /// Adds the torque that acts on theta_DEA, N m, positive where it opens the lozenge.
    fn torque(&self, _v: &[f64], _along: &Along, _torque_n_m: &mut [f64]) {}
    /// Whether [`Effect::slack`] does something.
    fn needs_tension(&self) -> bool {
        false
    }
    /// What is missing of sigma_2, Pa, where the film cannot carry compression; `sigma_2_pa` is the stress of
    /// all springs.
    fn slack(
        &self,
        _v: &[f64],
        _along: &Along,
        _sigma_2_pa: &[f64],
        _phi_v: &[f64],
        _change_pa: &mut [f64],
    ) {
    }
}

/// A cause at work: its values, and the actuators that it sits in.
#[derive(Clone)]
pub struct Acting {
    /// The cause.
    pub effect: &'static dyn Effect,
    /// Values of its parameters.
    pub values: Vec<f64>,
    /// The actuators that it sits in.
    pub on: [bool; 3],
}

impl std::fmt::Debug for Acting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:?} on {:?}", self.effect.id(), self.values, self.on)
    }
}

impl PartialEq for Acting {
    fn eq(&self, other: &Self) -> bool {
        self.is(other) && self.values == other.values
    }
}

impl Acting {
    /// Places of the values that a fit may move: not the word that picks a form, not the moment of a change.
    #[must_use]
    pub fn free_values(&self) -> Vec<usize> {
        let quantities = self.effect.parameters().iter().enumerate();
        let free = quantities.filter(|(i, q)| {
            let picked = !self.effect.variants().is_empty() && *i == 0;
            !picked && q.lower < q.upper && q.name != "time" && q.name != "recording"
        });
        free.map(|(i, _)| i).collect()
    }

    /// The cause switched off.
    pub fn off(effect: &'static dyn Effect, on: [bool; 3]) -> Self {
        let values = effect.parameters().iter().map(|q| q.off).collect();
        Acting { effect, values, on }
    }

    /// The value of its parameter of this name, where it has one.
    pub fn value(&self, name: &str) -> Option<f64> {
        let quantities = self.effect.parameters().iter();
        let mut named = quantities.zip(&self.values);
        named.find(|(q, _)| q.name == name).map(|(_, v)| *v)
    }

    /// Whether it changes what is measured of the motion, and not the robot.
    pub fn is_of_capture(&self) -> bool {
        self.effect.site() == Site::Motion && self.effect.part(&self.values) == Part::Marker
    }

    /// Whether it is the same cause in the same actuators, whatever the values.
    pub fn is(&self, other: &Acting) -> bool {
        self.effect.id() == other.effect.id()
            && self.effect.learnt() == other.effect.learnt()
            && self.on == other.on
    }
}

/// What is left of a state after x of its time constants, e^-x, and its mean along the way, (1 - e^-x)/x.
fn decays(x: f64) -> (f64, f64) {
    let left = (-x).exp();
    let mean = if x < 1e-6 {
        1.0 - 0.5 * x
    } else {
        (1.0 - left) / x
    };
    (left, mean)
}

/// A logistic step from 0 to 1 around 0.
fn soft_step(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// ln(1 + e^x): a soft max(x, 0).
fn soft_plus(x: f64) -> f64 {
    match x {
        x if x > 30.0 => x,
        // most samples are that far from an edge
        x if x < -100.0 => 0.0,
        x => x.exp().ln_1p(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equations_are_in_the_names_of_their_parameters() {
        let lines = line::every().map(|e| e as &dyn Effect);
        for effect in CATALOGUE.iter().copied().chain(lines) {
            let says = effect.equation();
            for q in effect.parameters() {
                let name = q.part().0;
                // which link, and in which recording, is no number of an equation
                let picks = !effect.variants().is_empty() || name == "recording";
                assert!(
                    says.contains(name) || picks,
                    "{}: {name} in {says}",
                    effect.id()
                );
            }
            let words = effect.taken_for().iter().flat_map(|t| t.split(' '));
            for other in words.filter(|w| w.contains('_')) {
                assert!(by_id(other).is_some(), "{}: {other}", effect.id());
            }
        }
    }

    #[test]
    fn what_a_voltage_depends_on_is_kept() {
        for effect in CATALOGUE {
            let kept = effect.memory() != Memory::None;
            let electrical = effect.site() == Site::Electrical;
            assert!(!electrical || kept == effect.remembers(), "{}", effect.id());
        }
    }

    #[test]
    fn what_begins_at_a_moment_has_a_size_a_time_and_a_recording() {
        let mut found = 0;
        for effect in CATALOGUE {
            let q = effect.parameters();
            if q.iter().any(|q| q.name == "recording") {
                let names: Vec<&str> = q[1..].iter().map(|q| q.name).collect();
                assert!(
                    q[0].size && names == ["time", "recording"],
                    "{}",
                    effect.id()
                );
                found += 1;
            }
        }
        assert_eq!(found, 2);
    }

    #[test]
    fn a_link_sits_where_it_is() {
        let link =
            by_id("link_length_error").map(|e| [0, 2, 3, 7].map(|l| e.part(&[f64::from(l), 0.0])));
        let places = [Part::Base, Part::Bicep, Part::Forearm, Part::FourBar];
        assert_eq!(link, Some(places));
    }
}
