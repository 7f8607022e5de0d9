//! The balance with effects: what each of them does to the motion, the Maxwell torque, the film and the
//! torques of one track.

use std::sync::Arc;

use super::{Mechanics, Parameters, Robot, Unreachable};
use crate::dataset::Track;
use crate::effects::{Acting, Along, Reading, Site, When};
use crate::film::kernel::{LANES, Pass, Shape};
use crate::film::{Film, Locked};
use crate::kinematics::Vec3;
use crate::units::VACUUM_PERMITTIVITY_F_M;

/// Effects of a kind.
fn at(effects: &[Acting], site: Site) -> impl Iterator<Item = &Acting> {
    effects.iter().filter(move |a| a.effect.site() == site)
}

/// What the next and the previous actuator have, of what all three have.
pub fn others<T: Copy>(k: usize, of: [T; 3]) -> [T; 2] {
    [of[(k + 1) % 3], of[(k + 2) % 3]]
}

/// A robot and a track with those effects that change the mechanism or the measured motion.
fn moved(
    mut robot: Robot,
    mut track: Arc<Track>,
    effects: &[Acting],
    pivot_m: Vec3,
) -> (Robot, Arc<Track>) {
    for a in at(effects, Site::Motion) {
        let (mechanism, lozenges) = (&mut robot.mechanism, &mut robot.lozenges);
        a.effect.geometry(&a.values, a.on, mechanism, lozenges);
        if a.effect.reads_otherwise() {
            let track = Arc::make_mut(&mut track);
            a.effect.reading(
                &a.values,
                &mut Reading {
                    step_s: track.step_s,
                    pivot_m,
                    position_m: &mut track.position_m,
                    velocity_m_s: &mut track.velocity_m_s,
                    acceleration_m_s2: &mut track.acceleration_m_s2,
                },
            );
        }
    }
    (robot, track)
}

impl Mechanics {
    /// The balance of `robot` along `track` with those effects that change the mechanism or the measured
    /// motion. `pivot_m` is the point about which the capture's axes would be rotated; of a `known` balance
    /// along this track, with other such effects, the chains that move alike are shared.
    ///
    /// # Errors
    /// Those of [`Mechanics::new`].
    pub fn with_effects(
        robot: &Robot,
        track: &Track,
        effects: &[Acting],
        pivot_m: Vec3,
        known: Option<&Mechanics>,
    ) -> Result<Self, (usize, Unreachable)> {
        let (robot, track) = moved(robot.clone(), Arc::new(track.clone()), effects, pivot_m);
        match known {
            Some(known) => Mechanics::beside(robot, track, known),
            None => Mechanics::of(robot, track),
        }
    }

    /// The same balance with more effects; chains that move alike are shared.
    ///
    /// # Errors
    /// Those of [`Mechanics::new`].
    pub fn with_more(
        &self,
        effects: &[Acting],
        pivot_m: Vec3,
    ) -> Result<Self, (usize, Unreachable)> {
        let (robot, track) = moved(self.robot.clone(), self.track.clone(), effects, pivot_m);
        Mechanics::beside(robot, track, self)
    }

    /// What an effect sees of chain `k` (0 to 2).
    pub fn along(&self, k: usize, when: When) -> Along<'_> {
        let chain = &self.chains[k];
        Along {
            step_s: self.track.step_s,
            when,
            lozenge: &self.robot.lozenges[k],
            eps_f_m: self.robot.eps_r * VACUUM_PERMITTIVITY_F_M,
            bicep_m: self.robot.mechanism.chains[k].bicep_m,
            theta_dea_rad: &chain.theta_dea_rad,
            area_stretch: &chain.area_stretch,
            theta_b: &chain.theta_b,
            bicep_lever: &chain.bicep_lever,
            force_lever: &chain.force_lever,
            acceleration_m_s2: &self.track.acceleration_m_s2,
            position_m: &self.track.position_m,
            velocity_m_s: &self.track.velocity_m_s,
            others_v: [&[]; 2],
        }
    }

    /// The voltage that makes the Maxwell torque of chain `k`, V, where the amplifiers are told `command_v`.
    pub fn film_voltage_v(
        &self,
        k: usize,
        when: When,
        effects: &[Acting],
        command_v: [&[f64]; 3],
    ) -> Vec<f64> {
        let mut phi = command_v[k].to_vec();
        let along = Along {
            others_v: others(k, command_v),
            ..self.along(k, when)
        };
        for a in at(effects, Site::Electrical).filter(|a| a.on[k]) {
            a.effect.voltage(&a.values, &along, &mut phi);
        }
        phi
    }

    /// 1/2 dC/d theta_DEA of chain `k` with effects, N m/V^2.
    pub fn half_capacitance_slope(&self, k: usize, when: When, effects: &[Acting]) -> Vec<f64> {
        let mut half = self.chains[k].half_capacitance_slope.clone();
        let along = self.along(k, when);
        for a in effects.iter().filter(|a| a.on[k]) {
            a.effect.capacitance(&a.values, &along, &mut half);
        }
        half
    }

    /// Torque of the effects on theta_DEA of chain `k`, N m, positive where it opens the lozenge.
    pub fn effect_torque_n_m(&self, k: usize, when: When, effects: &[Acting]) -> Vec<f64> {
        let mut out = vec![0.0; self.samples()];
        let along = self.along(k, when);
        for a in at(effects, Site::Balance).filter(|a| a.on[k]) {
            a.effect.torque(&a.values, &along, &mut out);
        }
        out
    }

    /// Factors on the stress of [equilibrium spring, branches] of chain `k`; `None` without an effect on the
    /// film there.
    pub fn stress_factor(
        &self,
        k: usize,
        when: When,
        effects: &[Acting],
        film: &Film,
    ) -> Option<Vec<[f64; 2]>> {
        let mut out: Option<Vec<[f64; 2]>> = None;
        let along = self.along(k, when);
        for a in at(effects, Site::Film).filter(|a| a.on[k]) {
            let factor = out.get_or_insert_with(|| vec![[1.0; 2]; self.samples()]);
            a.effect.stress(&a.values, &along, film, factor);
        }
        out
    }

    /// What the film of chain `k` needs more of the Maxwell torque, N m, because it cannot carry compression;
    /// `None` where it can. `phi_v` is the voltage on the film.
    ///
    /// # Errors
    /// [`Locked`] when a spring reaches its locking stretch.
    pub fn slack_torque_n_m(
        &self,
        k: usize,
        when: When,
        effects: &[Acting],
        parameters: &Parameters,
        phi_v: &[f64],
    ) -> Result<Option<Vec<f64>>, Locked> {
        let mut slack = at(effects, Site::Film)
            .filter(|a| a.on[k] && a.effect.needs_tension())
            .peekable();
        if slack.peek().is_none() {
            return Ok(None);
        }
        let sigma = self.sigma_2_pa(k, &parameters.film)?;
        let along = self.along(k, when);
        let mut change = vec![0.0; self.samples()];
        for a in slack {
            a.effect
                .slack(&a.values, &along, &sigma, phi_v, &mut change);
        }
        let volume = along.lozenge.volume_m3();
        for (c, theta) in change.iter_mut().zip(along.theta_dea_rad) {
            *c *= volume * along.lozenge.log_stretch_slopes(*theta)[1];
        }
        Ok(Some(change))
    }

    /// sigma_2 of all springs of chain `k` at each sample, Pa.
    fn sigma_2_pa(&self, k: usize, film: &Film) -> Result<Vec<f64>, Locked> {
        let mut history = self.chains[k].history.clone();
        history.first.lever = [0.0, 1.0];
        for node in history.segments.iter_mut().flat_map(|s| &mut s.nodes) {
            node.lever = [0.0, 1.0];
        }
        let shape = Shape {
            relaxation_time_s: &film.relaxation_time_s,
            locking: film.locking,
        };
        let mut pass = Pass::of_stress(&history, shape);
        let width = pass.row_width();
        let mut rows = vec![0.0; 128 * width];
        let mut out = Vec::with_capacity(self.samples());
        loop {
            let count = pass.next_block(&mut rows)?;
            if count == 0 {
                return Ok(out);
            }
            for row in rows[..count * width].chunks(width) {
                let spring = |n: usize| row[n / LANES * 3 * LANES + n % LANES] * film.mu_pa[n];
                out.push((0..film.mu_pa.len()).map(spring).sum());
            }
        }
    }
}
