//! The mechanism: from a pose of the end effector to angles and stretches, with exact derivatives.
//!
//! Symbols, frames and signs are those of the paper (Chang, Wang, Axinte, Dong), Eqs 8 to 12, 15 and 17.
//! World axes: origin at the centre of the base plate at the height of the bicep pivots, Z up, X through
//! chain 1.
//!
//! | code | paper | meaning |
//! |---|---|---|
//! | `theta_b_rad` | theta_b | bicep angle in the chain's plane, from +Z towards the axis of the robot |
//! | `theta_k1_rad` | theta_k1 | input of the stroke-amplifying four-bar (SAM) |
//! | `theta_sam_rad` | theta_SAM | its output, Eq 11 |
//! | `theta_dea_rad` | theta_DEA | obtuse angle of the lozenge; falls when the actuator is driven |
//! | `theta_fa_rad` | theta_FA | out-of-plane swing of the parallelogram forearm |
//!
//! Derivatives come from the constraint equations, differentiated by hand (implicit function theorem), not
//! from the printed inverse functions: they stay exact where an arc cosine loses digits.

mod four_bar;
mod lozenge;

pub use four_bar::FourBar;
pub use lozenge::Lozenge;

/// A vector of the world axes, or a row of partial derivatives with respect to the three world coordinates.
pub type Vec3 = [f64; 3];

/// Scalar product.
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// The part of a chain that cannot follow a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// The forearm would have to swing out of plane by 90 deg or more: |Nz| >= n0.
    ForearmSwing,
    /// Bicep and forearm cannot meet: the arc cosine of Eq 10 has no value.
    Elbow,
    /// The four-bar cannot close: the discriminant of Eq 11 is negative.
    FourBar,
    /// The lozenge would be folded flat: theta_DEA outside (0, 180) deg.
    Lozenge,
}

impl std::fmt::Display for Joint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Joint::ForearmSwing => "forearm (out-of-plane swing)",
            Joint::Elbow => "bicep (cannot meet the forearm)",
            Joint::FourBar => "SAM (four-bar cannot close)",
            Joint::Lozenge => "lozenge",
        })
    }
}

/// A pose that the mechanism cannot take: which chain, which joint, by how much.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "pose ({:.3}, {:.3}, {:.3}) mm is out of reach: chain {chain}, {joint}: {quantity} is {value:.6}, must lie within {low:.6} to {high:.6}",
    pose_m[0] * 1e3, pose_m[1] * 1e3, pose_m[2] * 1e3
)]
pub struct OutOfReach {
    /// The pose asked for, m, world axes.
    pub pose_m: Vec3,
    /// Chain number, 1 to 3.
    pub chain: usize,
    /// The joint that fails.
    pub joint: Joint,
    /// What is out of range.
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// Lower end of the possible range.
    pub low: f64,
    /// Upper end of the possible range.
    pub high: f64,
}

/// Lengths and angles of one chain of the robot (Fig 4 of the paper), m and rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chain {
    /// Azimuth psi of the chain about Z, rad.
    pub azimuth_rad: f64,
    /// l_ch: centre of the base to the bicep pivot, m.
    pub base_radius_m: f64,
    /// l_end: centre of the end effector to the forearm joint, m.
    pub effector_radius_m: f64,
    /// q: bicep length, m.
    pub bicep_m: f64,
    /// n0: forearm length, m.
    pub forearm_m: f64,
    /// omega + alpha: theta_k1 = theta_b - omega - alpha, rad.
    pub input_offset_rad: f64,
    /// The stroke-amplifying four-bar.
    pub four_bar: FourBar,
    /// theta_DEA = dea_offset - theta_SAM, rad.
    pub dea_offset_rad: f64,
}

/// The three chains; they may differ (a link that departs from its drawing in one chain).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mechanism {
    /// Chains 1, 2, 3.
    pub chains: [Chain; 3],
}

/// The pose of one chain: angles (rad) and their derivatives with respect to the end effector's position
/// (rad/m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChainPose {
    /// Bicep angle.
    pub theta_b_rad: f64,
    /// Four-bar input.
    pub theta_k1_rad: f64,
    /// Four-bar output.
    pub theta_sam_rad: f64,
    /// Lozenge angle.
    pub theta_dea_rad: f64,
    /// Forearm swing.
    pub theta_fa_rad: f64,
    /// d theta_b / du.
    pub dtheta_b_du: Vec3,
    /// d theta_DEA / du.
    pub dtheta_dea_du: Vec3,
    /// d theta_FA / du.
    pub dtheta_fa_du: Vec3,
    /// d theta_DEA / d theta_b (= -d theta_SAM / d theta_k1).
    pub dtheta_dea_dtheta_b: f64,
    /// n = Q - N in the chain's local axes, m; kept for the second derivative.
    n: Vec3,
    /// dn/d theta_b in the local axes, m.
    q_prime: Vec3,
    /// Q in the local axes, m.
    q: Vec3,
    /// Radial and tangential unit vectors of the chain.
    axes: (Vec3, Vec3),
    /// Sine and cosine of theta_k1.
    k1: [f64; 2],
    closure: four_bar::Closure,
    half_dea: [f64; 2],
}

impl ChainPose {
    /// Sine and cosine of theta_DEA / 2, for [`Lozenge::at`].
    pub fn half_dea(&self) -> [f64; 2] {
        self.half_dea
    }

    /// sin theta_b.
    pub fn sine_theta_b(&self) -> f64 {
        self.q[1] / (self.q[0] * self.q[0] + self.q[1] * self.q[1]).sqrt()
    }
}

impl Mechanism {
    /// Three equal chains at 0, 120 and 240 deg. `chain.azimuth_rad` is ignored.
    pub fn symmetric(chain: Chain) -> Self {
        let at = |k: usize| Chain {
            azimuth_rad: 2.0 * std::f64::consts::PI * k as f64 / 3.0,
            ..chain
        };
        Mechanism {
            chains: [at(0), at(1), at(2)],
        }
    }

    /// The pose of every chain with the end effector's centre at `u_m` (m, world axes). Along a track
    /// [`Mechanism::fixed`] is faster.
    ///
    /// # Errors
    /// [`OutOfReach`] names the first chain and joint that cannot follow.
    pub fn pose(&self, u_m: Vec3) -> Result<[ChainPose; 3], OutOfReach> {
        self.fixed().pose(u_m)
    }

    /// The mechanism with all that is the same at every pose worked out.
    pub fn fixed(&self) -> FixedMechanism {
        FixedMechanism {
            chains: self.chains.map(|chain| FixedChain {
                chain,
                axes: chain.axes(),
                input: sine_and_cosine(chain.input_offset_rad),
                dea: sine_and_cosine(chain.dea_offset_rad),
            }),
        }
    }
}

/// A mechanism with all that is the same at every pose worked out: [`Mechanism::fixed`].
#[derive(Debug, Clone, Copy)]
pub struct FixedMechanism {
    chains: [FixedChain; 3],
}

#[derive(Debug, Clone, Copy)]
struct FixedChain {
    chain: Chain,
    axes: (Vec3, Vec3),
    /// Sine and cosine of the input offset.
    input: [f64; 2],
    /// Sine and cosine of the lozenge's offset.
    dea: [f64; 2],
}

fn sine_and_cosine(angle_rad: f64) -> [f64; 2] {
    let (s, c) = angle_rad.sin_cos();
    [s, c]
}

impl FixedMechanism {
    /// The pose of every chain with the end effector's centre at `u_m` (m, world axes).
    ///
    /// # Errors
    /// [`OutOfReach`] names the first chain and joint that cannot follow.
    pub fn pose(&self, u_m: Vec3) -> Result<[ChainPose; 3], OutOfReach> {
        Ok([
            self.chains[0].pose(u_m, 1)?,
            self.chains[1].pose(u_m, 2)?,
            self.chains[2].pose(u_m, 3)?,
        ])
    }

    /// The pose of chain `k` (0 to 2) alone.
    ///
    /// # Errors
    /// [`OutOfReach`] when the chain has no angles for this position.
    pub fn chain_pose(&self, k: usize, u_m: Vec3) -> Result<ChainPose, OutOfReach> {
        self.chains[k].pose(u_m, k + 1)
    }
}

impl FixedChain {
    /// The pose of this chain; `number` (1 to 3) is used in the error only.
    ///
    /// Sines and cosines of sums are worked out from those of their parts; an angle is taken from them where
    /// it is wanted itself.
    fn pose(&self, u_m: Vec3, number: usize) -> Result<ChainPose, OutOfReach> {
        let fail = |joint, quantity, value, low, high| OutOfReach {
            pose_m: u_m,
            chain: number,
            joint,
            quantity,
            value,
            low,
            high,
        };
        let chain = &self.chain;
        let (r, t) = self.axes;
        // N_k in local axes: x up, y inwards, z = t (section 1 of the model).
        let nx = u_m[2];
        let ny = chain.base_radius_m - chain.effector_radius_m - dot(u_m, r);
        let nz = dot(u_m, t);
        let n0 = chain.forearm_m;
        if nz.is_nan() || nz.abs() >= n0 {
            let quantity = "out-of-plane offset over forearm length";
            return Err(fail(Joint::ForearmSwing, quantity, nz / n0, -1.0, 1.0));
        }
        // Eq 10
        let n_p_squared = n0 * n0 - nz * nz;
        let l_squared = nx * nx + ny * ny;
        let l_bn = l_squared.sqrt();
        let q = chain.bicep_m;
        let cosine = (q * q + l_squared - n_p_squared) / (2.0 * q * l_bn);
        if cosine.is_nan() || cosine.abs() > 1.0 {
            let quantity = "cosine of the bicep angle (Eq 10)";
            return Err(fail(Joint::Elbow, quantity, cosine, -1.0, 1.0));
        }
        // theta_b = pi - atan2(ny, -nx) + acos(cosine), in [0, 2 pi)
        let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
        let cb = (nx * cosine - ny * sine) / l_bn;
        let sb = (nx * sine + ny * cosine) / l_bn;
        let turn = sb.atan2(cb);
        let theta_b = if turn < 0.0 {
            turn + std::f64::consts::TAU
        } else {
            turn
        };
        let theta_k1 = theta_b - chain.input_offset_rad;
        let [so, co] = self.input;
        let k1 = [sb * co - cb * so, cb * co + sb * so];
        let bar = chain.four_bar.close(k1).map_err(|cosine| {
            let quantity = "cosine of the output angle (Eq 11)";
            fail(Joint::FourBar, quantity, cosine, -1.0, 1.0)
        })?;
        // theta_DEA = offset - theta_SAM = psi + offset - pi
        let ([sp, cp], [so, co]) = (bar.psi, self.dea);
        let (sd, cd) = (-(sp * co + cp * so), sp * so - cp * co);
        let theta_dea = sd.atan2(cd);
        if !(theta_dea > 0.0 && theta_dea < std::f64::consts::PI) {
            let quantity = "theta_DEA in rad";
            let (low, high) = (0.0, std::f64::consts::PI);
            return Err(fail(Joint::Lozenge, quantity, theta_dea, low, high));
        }
        // theta_DEA / 2 lies in the first quadrant.
        let half_dea = if cd < 0.0 {
            let s = (0.5 * (1.0 - cd)).sqrt();
            [s, 0.5 * sd / s]
        } else {
            let c = (0.5 * (1.0 + cd)).sqrt();
            [0.5 * sd / c, c]
        };
        // Constraint n.n = n0^2 with n = Q(theta_b) - N(u): its first derivative gives d theta_b / du.
        let q_vec = [q * cb, q * sb, 0.0];
        let q_prime = [-q * sb, q * cb, 0.0];
        let n = [q_vec[0] - nx, q_vec[1] - ny, -nz];
        let lever = dot(n, q_prime);
        // grad of n.N in world axes: n_x Z - n_y r + n_z t
        let pull = [-n[1] * r[0] + n[2] * t[0], -n[1] * r[1] + n[2] * t[1], n[0]];
        let dtheta_b_du = scale(pull, 1.0 / lever);
        let dtheta_dea_dtheta_b = -bar.dtheta_sam_dtheta_k1;
        Ok(ChainPose {
            theta_b_rad: theta_b,
            theta_k1_rad: theta_k1,
            theta_sam_rad: chain.dea_offset_rad - theta_dea,
            theta_dea_rad: theta_dea,
            theta_fa_rad: (nz / n0).asin(),
            dtheta_b_du,
            dtheta_dea_du: scale(dtheta_b_du, dtheta_dea_dtheta_b),
            dtheta_fa_du: scale(t, 1.0 / n_p_squared.sqrt()),
            dtheta_dea_dtheta_b,
            n,
            q_prime,
            q: q_vec,
            axes: (r, t),
            k1,
            closure: bar,
            half_dea,
        })
    }
}

impl Chain {
    /// Its eight lengths, m: l_ch, l_end, q, n0, a, b, c, d.
    pub fn lengths_mut(&mut self) -> [&mut f64; 8] {
        let bar = &mut self.four_bar;
        [
            &mut self.base_radius_m,
            &mut self.effector_radius_m,
            &mut self.bicep_m,
            &mut self.forearm_m,
            &mut bar.a_m,
            &mut bar.b_m,
            &mut bar.c_m,
            &mut bar.d_m,
        ]
    }

    /// Radial and tangential unit vectors r_k and t_k.
    fn axes(&self) -> (Vec3, Vec3) {
        let (s, c) = self.azimuth_rad.sin_cos();
        ([c, s, 0.0], [s, -c, 0.0])
    }

    /// d theta_b/dt (rad/s) and d^2 theta_b/dt^2 (rad/s^2) along a track with velocity `v_m_s` and
    /// acceleration `a_m_s2` of the end effector, at the pose `pose` of this chain.
    ///
    /// From the constraint n.n = n0^2, differentiated twice: n.n'' + n'.n' = 0.
    pub fn bicep_rates(&self, pose: &ChainPose, v_m_s: Vec3, a_m_s2: Vec3) -> (f64, f64) {
        let (r, t) = pose.axes;
        let local = |w: Vec3| [w[2], -dot(w, r), dot(w, t)];
        let (n_dot, n_ddot) = (local(v_m_s), local(a_m_s2));
        let rate = dot(pose.dtheta_b_du, v_m_s);
        let mut swing = 0.0; // n'.n'
        let mut pull = 0.0; // n.(Q rate^2 + N'')
        for i in 0..3 {
            let d = pose.q_prime[i] * rate - n_dot[i];
            swing += d * d;
            pull += pose.n[i] * (pose.q[i] * rate * rate + n_ddot[i]);
        }
        (rate, (pull - swing) / dot(pose.n, pose.q_prime))
    }
}

/// Second derivatives of one chain's angles with respect to the end effector's position, rad/m^2, and of
/// theta_DEA with respect to theta_b, 1/rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChainCurvature {
    /// d^2 theta_b / du^2.
    pub theta_b: [Vec3; 3],
    /// d^2 theta_DEA / du^2.
    pub theta_dea: [Vec3; 3],
    /// d^2 theta_FA / du^2.
    pub theta_fa: [Vec3; 3],
    /// d^2 theta_DEA / d theta_b^2.
    pub theta_dea_theta_b: f64,
}

impl Chain {
    /// Second derivatives of this chain's angles at `pose`, exact.
    ///
    /// theta_b from the constraint n.n = n0^2 with n = Q(theta_b) - N(u), differentiated twice: with g = d
    /// theta_b/du, s = (dN/du)^T dQ/d theta_b
    ///
    /// ```text
    /// (n.Q') d^2 theta_b/du^2 = (n.Q - q^2) g g^T + g s^T + s g^T - 1
    /// ```
    pub fn curvature(&self, pose: &ChainPose) -> ChainCurvature {
        let (r, t) = pose.axes;
        let g = pose.dtheta_b_du;
        let s = [
            -pose.q_prime[1] * r[0],
            -pose.q_prime[1] * r[1],
            pose.q_prime[0],
        ];
        let inverse_lever = 1.0 / dot(pose.n, pose.q_prime);
        let along = dot(pose.n, pose.q) - self.bicep_m * self.bicep_m;
        let bar = -self.four_bar.curvature(pose.k1, &pose.closure);
        // theta_FA = asin(Nz/n0): second derivative Nz / (n0^2 - Nz^2)^(3/2) along t.
        let (nz, inverse) = (-pose.n[2], dot(pose.dtheta_fa_du, t));
        let swing = nz * inverse * inverse * inverse;
        let mut out = ChainCurvature {
            theta_b: [[0.0; 3]; 3],
            theta_dea: [[0.0; 3]; 3],
            theta_fa: [[0.0; 3]; 3],
            theta_dea_theta_b: bar,
        };
        for i in 0..3 {
            for j in 0..3 {
                let one = if i == j { 1.0 } else { 0.0 };
                let gg = g[i] * g[j];
                let b = (along * gg + g[i] * s[j] + s[i] * g[j] - one) * inverse_lever;
                out.theta_b[i][j] = b;
                out.theta_dea[i][j] = pose.dtheta_dea_dtheta_b * b + bar * gg;
                out.theta_fa[i][j] = swing * t[i] * t[j];
            }
        }
        out
    }
}
