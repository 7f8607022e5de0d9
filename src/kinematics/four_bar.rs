//! The stroke-amplifying four-bar, Eq 11 of the paper.

/// Link lengths, m: ground a, input b (on the bicep), coupler c, output d (on the lozenge).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FourBar {
    /// Ground link, m.
    pub a_m: f64,
    /// Input link, m.
    pub b_m: f64,
    /// Coupler, m.
    pub c_m: f64,
    /// Output link, m.
    pub d_m: f64,
}

/// The closed four-bar; psi = pi - theta_SAM is the angle of its output link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// sin psi, cos psi.
    pub psi: [f64; 2],
    /// d theta_SAM / d theta_k1.
    pub dtheta_sam_dtheta_k1: f64,
}

impl FourBar {
    /// Closes the loop |a + d e(psi) - b e(theta_k1)| = c on the branch of the minus root of Eq 11, from the
    /// sine and the cosine of theta_k1.
    ///
    /// Written with the angle of the vector a - b e(theta_k1) instead of the tangent of the half angle, which
    /// has a pole where H = 0 (Eq 11) though the mechanism has none there; and with sines and cosines of sums
    /// instead of angles.
    ///
    /// # Errors
    /// The cosine that leaves [-1, 1] when the discriminant of Eq 11 is negative: the links cannot meet.
    pub fn close(&self, [sin, cos]: [f64; 2]) -> Result<Closure, f64> {
        let FourBar {
            a_m: a,
            b_m: b,
            c_m: c,
            d_m: d,
        } = *self;
        let p = [a - b * cos, -b * sin];
        let p_squared = p[0] * p[0] + p[1] * p[1];
        let length = p_squared.sqrt();
        let cosine = (c * c - d * d - p_squared) / (2.0 * d * length);
        if cosine.is_nan() || cosine.abs() > 1.0 {
            return Err(cosine);
        }
        // psi = the angle of p + acos(cosine)
        let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
        let sin_psi = (p[1] * cosine + p[0] * sine) / length;
        let cos_psi = (p[0] * cosine - p[1] * sine) / length;
        // w = a + d e(psi) - b e(theta): w.w = c^2, differentiated once.
        let w = [p[0] + d * cos_psi, p[1] + d * sin_psi];
        let input = b * (-w[0] * sin + w[1] * cos);
        let output = d * (-w[0] * sin_psi + w[1] * cos_psi);
        Ok(Closure {
            psi: [sin_psi, cos_psi],
            dtheta_sam_dtheta_k1: -input / output,
        })
    }
}

impl FourBar {
    /// d^2 theta_SAM / d theta_k1^2, 1/rad, at the closure of [`FourBar::close`] for the same sine and cosine
    /// of theta_k1.
    ///
    /// From the constraint w.w = c^2, w = a + d e(psi) - b e(theta), differentiated twice:
    /// w.w'' + w'.w' = 0 with e'' = -e.
    pub fn curvature(&self, [sin, cos]: [f64; 2], closure: &Closure) -> f64 {
        let [sin_psi, cos_psi] = closure.psi;
        let psi_prime = -closure.dtheta_sam_dtheta_k1;
        let (b, d) = (self.b_m, self.d_m);
        let w = [self.a_m + d * cos_psi - b * cos, d * sin_psi - b * sin];
        let w_prime = [
            -d * sin_psi * psi_prime + b * sin,
            d * cos_psi * psi_prime - b * cos,
        ];
        let known = w[0] * (b * cos - d * cos_psi * psi_prime * psi_prime)
            + w[1] * (b * sin - d * sin_psi * psi_prime * psi_prime);
        let swing = w_prime[0] * w_prime[0] + w_prime[1] * w_prime[1];
        let output = d * (w[1] * cos_psi - w[0] * sin_psi);
        (known + swing) / output
    }
}
