//! |d phi/dt| is bounded, on the falling side possibly lower: phi follows the command at no more than `rate_up`, `rate_down`.

use super::{Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site};

pub struct SlewLimit;

const fn rate(name: &'static str) -> Quantity {
    Quantity {
        name,
        unit: "V/s",
        off: f64::INFINITY,
        lower: 500.0,
        upper: 1e6,
        spread: 1e4,
        size: true,
    }
}

impl Effect for SlewLimit {
    fn id(&self) -> &'static str {
        "slew_limit"
    }
    fn says(&self) -> &'static str {
        "the amplifier cannot change its output faster than a bound"
    }
    fn source(&self) -> &'static str {
        "output current of the converter over the film's capacitance"
    }
    fn equation(&self) -> &'static str {
        "-rate_down <= |phi|' <= rate_up, and phi as near to phi_c as that allows"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["series_resistance", "time_offset"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Amplifier
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[rate("rate_up"), rate("rate_down")] }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, seen: &Seen) -> Vec<Vec<Vec<f64>>> {
        let mut out = Vec::new();
        for share in [0.75, 0.45, 0.25, 0.12] {
            let r = share * seen.rate_v_s;
            out.push(vec![vec![r, r]]);
            out.push(vec![vec![1.5 * r, 0.75 * r]]);
        }
        out
    }
    fn brought_out_by(&self) -> &'static str {
        "steps up and down between far voltages"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Rates, Exercise::Staircase]
    }
    fn remembers(&self) -> bool {
        true
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Output
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        if v[0].is_infinite() && v[1].is_infinite() {
            return;
        }
        let (up, down) = (v[0] * along.step_s, v[1] * along.step_s);
        for i in 1..phi_v.len() {
            let sign = if phi_v[i] == 0.0 {
                phi_v[i - 1].signum()
            } else {
                phi_v[i].signum()
            };
            let before = phi_v[i - 1] * sign;
            phi_v[i] = sign * (sign * phi_v[i]).clamp(before - down, before + up);
        }
    }
}
