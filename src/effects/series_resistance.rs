//! Wire and electrode resistance R feed the capacitance of the film:  R d(C phi)/dt = phi_c - phi. An
//! electrode resists the more the farther it is stretched:  R = resistance (A/1.2)^stretch_exponent at area
//! stretch A.

use super::{
    Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, decays, shape, size,
};

pub struct SeriesResistance;

/// Area stretch at which the resistance is stated.
const AT_AREA: f64 = 1.2;

/// The resistance at an area stretch, ohm, of the values of this cause.
pub(crate) fn resistance_ohm(v: &[f64], area_stretch: f64) -> f64 {
    match v[1] == 0.0 {
        true => v[0],
        false => v[0] * (area_stretch / AT_AREA).powf(v[1]),
    }
}

impl Effect for SeriesResistance {
    fn id(&self) -> &'static str {
        "series_resistance"
    }
    fn says(&self) -> &'static str {
        "the resistance of wires and electrodes delays the charge of the film"
    }
    fn source(&self) -> &'static str {
        "Kirchhoff's law for a resistor before a changing capacitance; a power law for the stretched electrode"
    }
    fn equation(&self) -> &'static str {
        "resistance (A/1.2)^stretch_exponent (C phi)' = phi_c - phi, A the area stretch"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["time_offset", "mocap_lag", "joint_damping", "slew_limit"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Lead
    }
    // The film has about 3 nF: 0.5 Gohm would leave a lag of 1.5 s.
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("resistance", "ohm", 0.0, 5e8, 3e7),
                shape("stretch_exponent", "1", 0.0, 0.0, 10.0, 3.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1e6, 0.0]], vec![vec![2e7, 0.0]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "steps with holds, and sines at two rates: a resistance loses amplitude at the higher one"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Rates, Exercise::Staircase]
    }
    fn remembers(&self) -> bool {
        true
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Charge
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        if v[0] > 0.0 {
            let wire = |i: usize| resistance_ohm(v, along.area_stretch[i]);
            charged(wire, along, phi_v[0], 0, |_, _| 0.0, phi_v);
        }
    }
}

/// The voltage on a film that a wire of `wire_ohm(i)` feeds, in place of the commanded one, V, from
/// `first_v` at the first sample; a conductance over the film takes `leak(i, phi)` times the current that phi
/// would drive through the wire. With the charge q = C phi and k = 1 + leak,  q' = (C phi_c - k q)/(R C)  is
/// integrated exactly for a linear C phi_c and the mean 1/(R C) of the step, so that phi is phi_c/k in the
/// limit of no resistance; k is that of the step's end, which `rounds` steps of a fixed point close in on.
pub(super) fn charged(
    wire_ohm: impl Fn(usize) -> f64,
    along: &Along,
    first_v: f64,
    rounds: usize,
    leak: impl Fn(usize, f64) -> f64,
    phi_v: &mut [f64],
) {
    let mut c0 = along.capacitance_f(0);
    let mut elastance0 = 1.0 / c0;
    let mut rate0 = elastance0 / wire_ohm(0);
    let mut before = std::mem::replace(&mut phi_v[0], first_v);
    let mut charge = c0 * first_v;
    for i in 1..phi_v.len() {
        let command = phi_v[i];
        let c1 = along.capacitance_f(i);
        let elastance1 = 1.0 / c1;
        let rate1 = elastance1 / wire_ohm(i);
        let rate = 0.5 * along.step_s * (rate0 + rate1);
        let after = |phi: f64| {
            let k = 1.0 + leak(i, phi);
            let (decay, mean) = decays(k * rate);
            charge * decay + (c0 * before * (mean - decay) + c1 * command * (1.0 - mean)) / k
        };
        let mut next = after(charge * elastance0);
        for _ in 0..rounds {
            next = after(next * elastance1);
        }
        charge = next;
        before = command;
        phi_v[i] = charge * elastance1;
        (c0, elastance0, rate0) = (c1, elastance1, rate1);
    }
}
