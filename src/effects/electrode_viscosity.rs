//! The electrode flows like grease: each direction carries eta d ln lambda_i/dt, referred to the film's
//! thickness, which is a torque -V eta sum (d ln lambda_i/d theta_DEA)^2 theta_DEA'.

use super::{Along, Effect, Part, Quantity, Reach, Seen, Site, size};

pub struct ElectrodeViscosity;

impl Effect for ElectrodeViscosity {
    fn id(&self) -> &'static str {
        "x_electrode_viscosity"
    }
    fn says(&self) -> &'static str {
        "the electrode resists stretching in proportion to its rate, like grease"
    }
    fn source(&self) -> &'static str {
        "Newtonian layer on the film"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_DEA: -V viscosity sum_i (d ln lambda_i/d theta_DEA)^2 theta_DEA', V the \
         film's volume"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("viscosity", "Pa s", 0.0, 2e5, 3e3)] }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![100.0]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "sines of one amplitude at rates up to above 2 Hz, and a load step under constant voltage"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let per_rate = v[0] * along.lozenge.volume_m3();
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let slope = along.lozenge.log_stretch_slopes(along.theta_dea_rad[i]);
            let rate = along.theta_b[i][1] * along.bicep_lever[i];
            *t -= per_rate * (slope[0] * slope[0] + slope[1] * slope[1]) * rate;
        }
    }
}
