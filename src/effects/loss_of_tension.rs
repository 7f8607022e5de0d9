//! A wrinkled film carries no compression: with the net stress p = sigma_2 - eps E^2 spread evenly over +-w
//! around its mean, the parts below the threshold carry it no further. Carried is  t + (p + w - t)^2/(4 w)
//! between t - w and t + w, t below, p above.

use super::{Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, shape};

pub struct LossOfTension;

impl Effect for LossOfTension {
    fn id(&self) -> &'static str {
        "loss_of_tension"
    }
    fn says(&self) -> &'static str {
        "at high voltage the film loses its tension across and wrinkles"
    }
    fn source(&self) -> &'static str {
        "tension field: no compressive membrane stress; uneven stress"
    }
    fn equation(&self) -> &'static str {
        "of p = sigma_2 - eps E^2 the film carries t + (p + w - t)^2/(4 w) between t - w and t + w, \
         t below, p above; t = threshold |sigma_2(0)|, w = unevenness |sigma_2(0)|"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["amplifier_saturation", "leakage"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    // Both over the net stress at rest.
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                Quantity {
                    name: "threshold",
                    unit: "1",
                    off: f64::NEG_INFINITY,
                    lower: -3.0,
                    upper: 1.0,
                    spread: 0.7,
                    size: true,
                },
                shape("unevenness", "1", 0.15, 0.01, 1.0, 0.2),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Film
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [-0.6, -0.2, 0.1, 0.35, 0.6, 0.85]
            .iter()
            .map(|&t| vec![vec![t, 0.15]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "the highest voltages in the upper poses, with and without payload"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Rest
    }
    fn needs_tension(&self) -> bool {
        true
    }
    fn slack(
        &self,
        v: &[f64],
        along: &Along,
        sigma_2_pa: &[f64],
        phi_v: &[f64],
        change_pa: &mut [f64],
    ) {
        if v[0].is_infinite() {
            return;
        }
        let rest = sigma_2_pa[0].abs().max(1.0);
        let (t, w) = (v[0] * rest, v[1] * rest);
        for (i, change) in change_pa.iter_mut().enumerate() {
            let field = phi_v[i] * along.area_stretch[i] / along.lozenge.l3_m;
            let p = sigma_2_pa[i] - along.eps_f_m * field * field;
            let carried = if p >= t + w {
                p
            } else if p <= t - w {
                t
            } else {
                t + (p + w - t).powi(2) / (4.0 * w)
            };
            *change += carried - p;
        }
    }
}
