//! The hanging film sample (section 5 of the model): three parts of one film with a mass on the free end.

use crate::units::{GRAVITY_M_S2, VACUUM_PERMITTIVITY_F_M};

/// A strip of film that hangs by one end, with an electrode that leaves a margin all round and a mass on the free end.
///
/// ```text
/// active part   (length - 2 margin) x (width - 2 margin), sigma_2 = eps E^2, E = phi lambda_1 lambda_2/L3
/// side strips   beside it, together 2 margin wide, the same lambda_1, sigma_2 = 0
/// end strips    in series, together 2 margin long, as wide as the film, sigma_2 = 0
/// sum over parallel parts of (sigma_1 - eps E^2)/lambda_1 width L3 = M (g - x'')
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HangingSample {
    /// Width (direction 2), m.
    pub width_m: f64,
    /// Length (direction 1, vertical), m.
    pub length_m: f64,
    /// Margin without electrode, all round, m.
    pub margin_m: f64,
    /// L3: thickness of one film, m.
    pub l3_m: f64,
    /// Films on top of each other.
    pub films: f64,
    /// Relative permittivity.
    pub eps_r: f64,
    /// M: mass on the free end, kg.
    pub mass_kg: f64,
}

impl HangingSample {
    /// Unstretched lengths of the active part (and the side strips beside it) and of the end strips together, m.
    pub fn lengths_m(&self) -> [f64; 2] {
        [self.length_m - 2.0 * self.margin_m, 2.0 * self.margin_m]
    }

    /// Unstretched cross-sections (width L3, all films) of the active part, the side strips together and the end strips, m^2.
    pub fn sections_m2(&self) -> [f64; 3] {
        let thickness = self.films * self.l3_m;
        [
            (self.width_m - 2.0 * self.margin_m) * thickness,
            2.0 * self.margin_m * thickness,
            self.width_m * thickness,
        ]
    }

    /// eps/L3^2, so that eps E^2 = this times (phi lambda_1 lambda_2)^2, F/m^3.
    pub fn maxwell_f_m3(&self) -> f64 {
        self.eps_r * VACUUM_PERMITTIVITY_F_M / (self.l3_m * self.l3_m)
    }

    /// Weight of the mass, N.
    pub fn weight_n(&self) -> f64 {
        self.mass_kg * GRAVITY_M_S2
    }

    /// Says what is wrong with the numbers.
    ///
    /// # Errors
    /// A sentence.
    pub fn check(&self) -> Result<(), String> {
        let named = [
            ("width", self.width_m),
            ("length", self.length_m),
            ("thickness L3", self.l3_m),
            ("number of films", self.films),
            ("relative permittivity", self.eps_r),
            ("mass", self.mass_kg),
        ];
        for (name, value) in named {
            if !(value > 0.0 && value.is_finite()) {
                return Err(format!("the sample's {name} must be positive, got {value}"));
            }
        }
        let widest = 0.5 * self.width_m.min(self.length_m);
        if !(self.margin_m > 0.0 && self.margin_m < widest) {
            return Err(format!(
                "the margin must lie between 0 and {:.3} mm, got {:.3} mm",
                widest * 1e3,
                self.margin_m * 1e3
            ));
        }
        Ok(())
    }
}
