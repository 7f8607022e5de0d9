//! The lozenge: from its angle to the stretches of the film, Eq 8 of the paper.

/// The lozenge and the unstretched film in it, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lozenge {
    /// l_DEA: side of the lozenge, m.
    pub side_m: f64,
    /// L1: unstretched length along direction 1 (long diagonal), m.
    pub l1_m: f64,
    /// L2: unstretched length along direction 2, m.
    pub l2_m: f64,
    /// L3: unstretched thickness, m.
    pub l3_m: f64,
    /// Films in parallel on one lozenge.
    pub films: f64,
}

impl Lozenge {
    /// lambda_1 = (2 l_DEA / L1) sin(theta/2), lambda_2 = (2 l_DEA / L2) cos(theta/2).
    pub fn stretches(&self, theta_dea_rad: f64) -> [f64; 2] {
        let (s, c) = (theta_dea_rad / 2.0).sin_cos();
        [
            2.0 * self.side_m / self.l1_m * s,
            2.0 * self.side_m / self.l2_m * c,
        ]
    }

    /// d ln lambda_i / d theta_DEA: (cot(theta/2), -tan(theta/2)) / 2, 1/rad.
    pub fn log_stretch_slopes(&self, theta_dea_rad: f64) -> [f64; 2] {
        let (s, c) = (theta_dea_rad / 2.0).sin_cos();
        [0.5 * c / s, -0.5 * s / c]
    }

    /// Stretches, their logarithmic slopes, and capacitance per permittivity (m) from the sine and the cosine
    /// of half the angle: [`Lozenge::stretches`], [`Lozenge::log_stretch_slopes`] and
    /// [`Lozenge::capacitance_f`] in one.
    pub fn at(&self, [s, c]: [f64; 2]) -> ([f64; 2], [f64; 2], f64) {
        let stretch = [
            2.0 * self.side_m / self.l1_m * s,
            2.0 * self.side_m / self.l2_m * c,
        ];
        let area = stretch[0] * stretch[1];
        let capacitance = self.films * self.l1_m * self.l2_m / self.l3_m * area * area;
        (stretch, [0.5 * c / s, -0.5 * s / c], capacitance)
    }

    /// Volume of all films, m^3: n_f L1 L2 L3.
    pub fn volume_m3(&self) -> f64 {
        self.films * self.l1_m * self.l2_m * self.l3_m
    }

    /// Capacitance of all films in parallel, F, for permittivity `eps_f_m` (F/m): n_f eps (L1 L2/L3)
    /// (lambda_1 lambda_2)^2.
    pub fn capacitance_f(&self, theta_dea_rad: f64, eps_f_m: f64) -> f64 {
        let [l1, l2] = self.stretches(theta_dea_rad);
        self.capacitance_of_area_f(l1 * l2, eps_f_m)
    }

    /// [`Lozenge::capacitance_f`] where lambda_1 lambda_2 is `area_stretch`.
    pub fn capacitance_of_area_f(&self, area_stretch: f64, eps_f_m: f64) -> f64 {
        self.films * eps_f_m * self.l1_m * self.l2_m / self.l3_m * area_stretch.powi(2)
    }

    /// Maxwell torque per squared voltage, 1/2 dC/d theta_DEA, N m/V^2: tau_volt = this times phi^2.
    pub fn half_capacitance_slope(&self, theta_dea_rad: f64, eps_f_m: f64) -> f64 {
        let [g1, g2] = self.log_stretch_slopes(theta_dea_rad);
        self.capacitance_f(theta_dea_rad, eps_f_m) * (g1 + g2)
    }
}
