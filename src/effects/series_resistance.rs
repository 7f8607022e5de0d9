//! Wire and electrode resistance R feed the capacitance of the film:  R d(C phi)/dt = phi_c - phi.

use super::{Along, Effect, Quantity, Reach, Seen, Site, size};

pub struct SeriesResistance;

impl Effect for SeriesResistance {
    fn id(&self) -> &'static str {
        "series_resistance"
    }
    fn says(&self) -> &'static str {
        "the resistance of wires and electrodes delays the charge of the film"
    }
    fn source(&self) -> &'static str {
        "Kirchhoff's law for a resistor before a changing capacitance"
    }
    // The film has about 3 nF: 0.5 Gohm would leave a lag of 1.5 s.
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("resistance", "ohm", 0.0, 5e8, 3e7)] }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1e6]], vec![vec![2e7]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "steps with holds, and sines at two rates: a resistance loses amplitude at the higher one"
    }
    fn remembers(&self) -> bool {
        true
    }
    /// With the charge q = C phi:  q' = (C phi_c - q)/(R C), integrated exactly for a linear C phi_c and the mean 1/C of the step, so
    /// that phi is phi_c in the limit of no resistance.
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        let r = v[0];
        if r == 0.0 {
            return;
        }
        let capacitance = |i: usize| {
            along
                .lozenge
                .capacitance_f(along.theta_dea_rad[i], along.eps_f_m)
        };
        let mut c0 = capacitance(0);
        let mut charge = c0 * phi_v[0];
        let mut before = phi_v[0];
        for i in 1..phi_v.len() {
            let c1 = capacitance(i);
            let c = 2.0 / (1.0 / c0 + 1.0 / c1);
            let x = along.step_s / (r * c);
            let decay = (-x).exp();
            // phi_1(x) = (1 - e^-x)/x, share of the slope
            let mean = if x < 1e-6 {
                1.0 - 0.5 * x
            } else {
                (1.0 - decay) / x
            };
            let command = phi_v[i];
            charge = charge * decay + c0 * before * (mean - decay) + c1 * command * (1.0 - mean);
            before = command;
            phi_v[i] = charge / c1;
            c0 = c1;
        }
    }
}
