//! The hanging film sample (section 5 of the model): three parts of one film with a mass on the free end.

use crate::recording::FilmSampleRig;
use crate::units::{GRAVITY_M_S2, VACUUM_PERMITTIVITY_F_M};

/// What an electrode does beside conducting: the causes by which it ages. [`Electrode::IDEAL`] does nothing,
/// to the bit.
///
/// The layer is elastic and was painted on the unstretched film, so that its stretches are those of the film:
/// in the active part it is a further equilibrium spring. Wire and electrode feed the film's capacitance C
/// through R. Where area has lost contact, C and the Maxwell stress keep the same share.
///
/// ```text
/// sigma_i += modulus (A - C, B - C)/D at xi = 1        in the active part      (electrode_stiffness)
/// R d(C phi)/dt = phi_c - phi                                                  (series_resistance)
/// C, eps E^2 times active_fraction                                             (electrode_failure: 1 - fraction)
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Electrode {
    /// Modulus of the layer, Pa, referred to the film's thickness.
    pub modulus_pa: f64,
    /// R between the source and the film, ohm.
    pub resistance_ohm: f64,
    /// Share of the active area that is still in contact.
    pub active_fraction: f64,
}

impl Electrode {
    /// Neither stiff nor resistive, all of it in contact.
    pub const IDEAL: Electrode = Electrode {
        modulus_pa: 0.0,
        resistance_ohm: 0.0,
        active_fraction: 1.0,
    };
}

/// A strip of film that hangs by one end, with an electrode that leaves a margin all round and a mass on the
/// free end.
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
    /// What the electrode does beside conducting.
    pub electrode: Electrode,
}

impl HangingSample {
    /// The sample of a `rig.toml` with `payload_kg` beside the rig's mass and an ideal electrode. `eps_r`,
    /// where given (a parameter file's), wins over the rig's.
    ///
    /// # Errors
    /// A sentence when neither states the permittivity, or the numbers make no sample.
    pub fn from_rig(
        rig: &FilmSampleRig,
        eps_r: Option<f64>,
        payload_kg: f64,
    ) -> Result<Self, String> {
        let mm = 1e-3;
        let eps_r = eps_r.or(rig.eps_r).ok_or_else(|| {
            format!(
                "rig `{}` states no relative permittivity and no parameter file gives one: add eps_r under [film]",
                rig.id
            )
        })?;
        let sample = HangingSample {
            width_m: rig.width_mm * mm,
            length_m: rig.length_mm * mm,
            margin_m: rig.margin_mm * mm,
            l3_m: rig.L3_mm * mm,
            films: f64::from(rig.films),
            eps_r,
            mass_kg: rig.m_g * 1e-3 + payload_kg,
            electrode: Electrode::IDEAL,
        };
        sample
            .check()
            .map_err(|what| format!("rig `{}`: {what}", rig.id))?;
        Ok(sample)
    }

    /// Unstretched lengths of the active part (and the side strips beside it) and of the end strips together,
    /// m.
    pub fn lengths_m(&self) -> [f64; 2] {
        [self.length_m - 2.0 * self.margin_m, 2.0 * self.margin_m]
    }

    /// Unstretched cross-sections (width L3, all films) of the active part, the side strips together and the
    /// end strips, m^2.
    pub fn sections_m2(&self) -> [f64; 3] {
        let thickness = self.films * self.l3_m;
        [
            (self.width_m - 2.0 * self.margin_m) * thickness,
            2.0 * self.margin_m * thickness,
            self.width_m * thickness,
        ]
    }

    /// eps/L3^2, so that eps E^2 = this times (phi lambda_1 lambda_2)^2, F/m^3; of the area in contact.
    pub fn maxwell_f_m3(&self) -> f64 {
        self.electrode.active_fraction * self.eps_r * VACUUM_PERMITTIVITY_F_M
            / (self.l3_m * self.l3_m)
    }

    /// C at lambda_1 lambda_2 = 1, F; it grows with (lambda_1 lambda_2)^2.
    pub fn capacitance_f(&self) -> f64 {
        let area = self.lengths_m()[0] * (self.width_m - 2.0 * self.margin_m);
        self.maxwell_f_m3() * area * self.l3_m * self.films
    }

    /// R C at lambda_1 lambda_2 = 1, s.
    pub fn time_constant_s(&self) -> f64 {
        self.electrode.resistance_ohm * self.capacitance_f()
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
        let Electrode {
            modulus_pa,
            resistance_ohm,
            active_fraction,
        } = self.electrode;
        // Compared with a film, a layer that pushes would be no layer; a softer one is a softer film.
        if !modulus_pa.is_finite() {
            return Err(format!("an electrode of modulus {modulus_pa} Pa"));
        }
        if !(resistance_ohm >= 0.0 && resistance_ohm.is_finite()) {
            return Err(format!(
                "a series resistance must not be negative, got {resistance_ohm} ohm"
            ));
        }
        if !(active_fraction > 0.0 && active_fraction.is_finite()) {
            return Err(format!(
                "the share of the electrode in contact must be positive, got {active_fraction}"
            ));
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
