//! Spring-back torque of the forearms, T(theta_FA): the natural cubic spline through nodal torques (second
//! derivative zero at the end nodes), continued linearly beyond them. Smooth, and linear in the nodal
//! torques.

use nalgebra::{DMatrix, DVector};

/// Nodes and nodal torques of the curve.
#[derive(Debug, Clone, PartialEq)]
pub struct ForearmTorque {
    /// Node angles, rad, rising.
    nodes_rad: Vec<f64>,
    /// Nodal torques, N m.
    torque_n_m: Vec<f64>,
    /// Second derivatives at the nodes per nodal torque (rows: nodes), 1/rad^2.
    curvature: DMatrix<f64>,
    /// Second derivatives at the nodes, N m/rad^2.
    bend_n_m: Vec<f64>,
}

impl ForearmTorque {
    /// Nodes of a new curve unless the user says otherwise: -30 to 30 deg in steps of 10.
    pub const DEFAULT_NODES_DEG: [f64; 7] = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0];

    /// A curve through `torque_n_m` (N m) at `nodes_rad` (rad, rising).
    ///
    /// # Errors
    /// A sentence when there are fewer than two nodes, they do not rise, or the lengths differ.
    pub fn new(nodes_rad: Vec<f64>, torque_n_m: Vec<f64>) -> Result<Self, String> {
        let n = nodes_rad.len();
        if n < 2 {
            return Err(format!("a torque curve needs at least two nodes, got {n}"));
        }
        if torque_n_m.len() != n {
            let m = torque_n_m.len();
            return Err(format!("{n} nodes of the torque curve, but {m} torques"));
        }
        if let Some(i) = (1..n).find(|&i| nodes_rad[i].is_nan() || nodes_rad[i] <= nodes_rad[i - 1])
        {
            let (a, b) = (nodes_rad[i - 1].to_degrees(), nodes_rad[i].to_degrees());
            return Err(format!(
                "nodes of the torque curve must rise: {b} deg follows {a} deg"
            ));
        }
        // Continuity of the first derivative at the inner nodes; second derivative zero at the ends.
        let mut left = DMatrix::identity(n, n);
        let mut right = DMatrix::zeros(n, n);
        for i in 1..n - 1 {
            let (h0, h1) = (
                nodes_rad[i] - nodes_rad[i - 1],
                nodes_rad[i + 1] - nodes_rad[i],
            );
            left[(i, i - 1)] = h0 / 6.0;
            left[(i, i)] = (h0 + h1) / 3.0;
            left[(i, i + 1)] = h1 / 6.0;
            right[(i, i - 1)] = 1.0 / h0;
            right[(i, i)] = -1.0 / h0 - 1.0 / h1;
            right[(i, i + 1)] = 1.0 / h1;
        }
        let curvature = left.lu().solve(&right).expect("diagonally dominant");
        let bend_n_m = bend(&curvature, &torque_n_m);
        Ok(ForearmTorque {
            nodes_rad,
            torque_n_m,
            curvature,
            bend_n_m,
        })
    }

    /// No torque at all, at the default nodes.
    pub fn zero() -> Self {
        let nodes = Self::DEFAULT_NODES_DEG.map(f64::to_radians).to_vec();
        Self::new(nodes, vec![0.0; 7]).expect("the default nodes rise")
    }

    /// The same nodes with other torques, N m.
    ///
    /// # Panics
    /// When the number of torques is not the number of nodes.
    pub fn with_torques(&self, torque_n_m: &[f64]) -> Self {
        assert_eq!(torque_n_m.len(), self.nodes_rad.len());
        ForearmTorque {
            nodes_rad: self.nodes_rad.clone(),
            torque_n_m: torque_n_m.to_vec(),
            curvature: self.curvature.clone(),
            bend_n_m: bend(&self.curvature, torque_n_m),
        }
    }

    /// Nodal torques, N m.
    pub fn torque_n_m(&self) -> &[f64] {
        &self.torque_n_m
    }

    /// Node angles, rad.
    pub fn nodes_rad(&self) -> &[f64] {
        &self.nodes_rad
    }

    /// Second derivatives of the torque at the nodes, N m/rad^2.
    pub fn bends(&self) -> &[f64] {
        &self.bend_n_m
    }

    /// Where an angle lies: the node before it, and the shares of the torques and of the second derivatives
    /// of that node and of the next: T = share_0 T_i + share_1 T_i+1 + bend_0 T''_i + bend_1 T''_i+1.
    fn place(&self, theta_rad: f64) -> (usize, [f64; 2], [f64; 2]) {
        let n = self.nodes_rad.len();
        let inside = theta_rad.clamp(self.nodes_rad[0], self.nodes_rad[n - 1]);
        let i = self
            .nodes_rad
            .partition_point(|&x| x <= inside)
            .clamp(1, n - 1)
            - 1;
        let h = self.nodes_rad[i + 1] - self.nodes_rad[i];
        let b = (inside - self.nodes_rad[i]) / h;
        let a = 1.0 - b;
        let (ca, cb) = ((a * a * a - a) * h * h / 6.0, (b * b * b - b) * h * h / 6.0);
        // slope at the end node, for what lies beyond it
        let beyond = theta_rad - inside;
        let (sa, sb) = (
            (1.0 - 3.0 * a * a) * h / 6.0 * beyond,
            (3.0 * b * b - 1.0) * h / 6.0 * beyond,
        );
        (i, [a - beyond / h, b + beyond / h], [ca + sa, cb + sb])
    }

    /// The torque at `theta_rad` per nodal torque: T = sum_i basis_i torque_i. `out` has one place a node.
    pub fn basis(&self, theta_rad: f64, out: &mut [f64]) {
        let (i, share, bend) = self.place(theta_rad);
        for (j, out) in out.iter_mut().enumerate().take(self.nodes_rad.len()) {
            *out = bend[0] * self.curvature[(i, j)] + bend[1] * self.curvature[(i + 1, j)];
        }
        out[i] += share[0];
        out[i + 1] += share[1];
    }

    /// T(theta_FA), N m.
    pub fn torque_n_m_at(&self, theta_rad: f64) -> f64 {
        let (i, share, bend) = self.place(theta_rad);
        share[0] * self.torque_n_m[i]
            + share[1] * self.torque_n_m[i + 1]
            + bend[0] * self.bend_n_m[i]
            + bend[1] * self.bend_n_m[i + 1]
    }
}

/// Second derivatives at the nodes, N m/rad^2.
fn bend(curvature: &DMatrix<f64>, torque_n_m: &[f64]) -> Vec<f64> {
    let torque = DVector::from_column_slice(torque_n_m);
    (curvature * torque).as_slice().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve() -> ForearmTorque {
        let nodes = ForearmTorque::DEFAULT_NODES_DEG
            .map(f64::to_radians)
            .to_vec();
        let torque = vec![-0.0016, -0.0009, -0.0003, 0.0001, 0.0003, 0.0008, 0.0016];
        ForearmTorque::new(nodes, torque).unwrap()
    }

    #[test]
    fn passes_through_its_nodes_and_is_smooth_and_linear_beyond() {
        let c = curve();
        for (x, y) in c.nodes_rad().iter().zip(c.torque_n_m()) {
            assert!((c.torque_n_m_at(*x) - y).abs() < 1e-17);
        }
        let slope = |x: f64, h: f64| (c.torque_n_m_at(x + h) - c.torque_n_m_at(x - h)) / (2.0 * h);
        for x in c.nodes_rad().to_vec() {
            let (left, right) = (slope(x - 2e-5, 1e-5), slope(x + 2e-5, 1e-5));
            assert!((left - right).abs() < 1e-6, "kink at {x}");
        }
        let end = 30f64.to_radians();
        let bend =
            c.torque_n_m_at(end + 0.2) - 2.0 * c.torque_n_m_at(end + 0.1) + c.torque_n_m_at(end);
        assert!(bend.abs() < 1e-16, "{bend:e}");
    }

    #[test]
    fn wrong_nodes_are_refused_with_both_values() {
        let text = ForearmTorque::new(vec![0.0, 0.1, 0.1], vec![0.0; 3]).unwrap_err();
        assert!(text.contains("must rise"), "{text}");
        assert!(ForearmTorque::new(vec![0.0, 0.1], vec![0.0; 3]).is_err());
    }
}
