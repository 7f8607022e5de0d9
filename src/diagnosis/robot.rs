//! The delta robot as a subject: three torques a sample, judged in volts above 1 kV.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::DRAWN;
use super::chain::Case;
use super::contact;
use super::explain::explain;
use super::learn::{self, Group, Made};
use super::outcome::*;
use super::problem::{BRANCHES, Problem};
use super::subject::{At, Coordinate, Errors, Subject, TermColumns, Whereabouts, Words};
use super::tolerance::{self, Tolerance};
use crate::dataset::{Dataset, OffsetSource};
use crate::effects::learnt::Learnt;
use crate::effects::{Acting, CATALOGUE, Effect, Seen, When};
use crate::film::Locked;
use crate::fit::memory::Memory;
use crate::kinematics::Vec3;
use crate::model::{ForearmTorque, Parameters, Robot};
use crate::residual::{
    Departure, DepartureTorques, ExpectedScore, OFFSET_REACH_S, RobotResidual, frames_apart, root_v,
};
use crate::simulate::predict_motions;

/// Pairs of draws of the noise from which it is told how far estimates are off.
const NOISE_PAIRS: usize = 2;

/// Diagnoses `robot` on the recordings `train`, judged also on `holdout`. `watch` is told what is being done.
///
/// # Errors
/// [`Error`].
pub fn diagnose(
    robot: &Robot,
    train: &[Entry],
    holdout: &[Entry],
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Error> {
    let mut remarks = Vec::new();
    let (own, held) = (thinned(train), thinned(holdout));
    let (train, holdout) = (
        &with_datasets(train, own.iter().map(|d| &**d))[..],
        &with_datasets(holdout, held.iter().map(|d| &**d))[..],
    );
    let mut problem = open(robot, train, holdout, &mut remarks)?;
    problem.memory = request.memory.clone();
    problem.tally = request.tally.clone();
    let mut case = Case::new(problem, remarks, request, watch);
    let (mut field, mut choice) = case.rounds()?;
    if let Some(rests) = contact::rests([train, holdout], robot, &case, &field, &choice)? {
        (field, choice) = rests.instead(&mut case, field);
    }
    let at_edge = choice.at_edge;
    let mut diagnosis = explain(&mut case, field, choice)?;
    if at_edge {
        contact::widen(&mut diagnosis.candidates);
    }
    diagnosis.eps_r = robot.eps_r;
    diagnosis.pose = Some(Pose {
        robot: robot.clone(),
        position_m: middle(train),
    });
    Ok(diagnosis)
}

/// The frames that recordings are worked with: a fast capture has nothing to say below the residual's low-pass
/// that every so many-th frame has not.
fn thinned<'d>(entries: &[Entry<'d>]) -> Vec<Cow<'d, Dataset>> {
    let thin = |e: &Entry<'d>| e.dataset.thinned(frames_apart(e.dataset));
    entries.iter().map(thin).collect()
}

/// Entries with these datasets in the places of their own.
pub(super) fn with_datasets<'d>(
    entries: &[Entry],
    datasets: impl IntoIterator<Item = &'d Dataset>,
) -> Vec<Entry<'d>> {
    let each = datasets.into_iter().zip(entries);
    each.map(|(dataset, e)| Entry {
        dataset,
        when: e.when,
    })
    .collect()
}

/// The mean position of the end effector, m.
fn middle(entries: &[Entry]) -> Vec3 {
    let (count, sum) = entries
        .iter()
        .flat_map(|e| e.dataset.track().position_m)
        .fold((0.0, [0.0; 3]), |(n, sum): (f64, Vec3), p| {
            (n + 1.0, [0, 1, 2].map(|i| sum[i] + p[i]))
        });
    sum.map(|s| s / f64::max(count, 1.0))
}

pub(super) fn open<'a>(
    robot: &'a Robot,
    train: &[Entry<'a>],
    holdout: &[Entry<'a>],
    remarks: &mut Vec<String>,
) -> Result<Problem<RobotResidual<'a>>, Error> {
    if train.is_empty() {
        return Err(Error::Nothing);
    }
    let forearm = ForearmTorque::zero();
    let residual = |entries: &[Entry<'a>]| {
        let list: Vec<&'a crate::dataset::Dataset> = entries.iter().map(|e| e.dataset).collect();
        let mut r = RobotResidual::new(robot, &list, BRANCHES, &forearm).map_err(
            |(number, sample, why)| Error::Unreachable {
                recording: list[number].id.clone(),
                time_s: list[number].time_s(sample),
                why: why.to_string(),
            },
        )?;
        r.keep_drawn(DRAWN);
        Ok::<_, Error>(r)
    };
    let own = residual(train)?;
    for e in train {
        let d = e.dataset;
        let span = (0..3)
            .flat_map(|k| {
                let first = d.command_v(k, 0, d.offset_s);
                (0..d.samples()).map(move |i| (d.command_v(k, i, d.offset_s) - first).abs())
            })
            .fold(0.0, f64::max);
        if span < 50.0 {
            remarks.push(format!(
                "{}: the voltages hardly change ({span:.0} V): it says next to nothing of the film or of any effect that depends on the drive.",
                d.id
            ));
        }
    }
    if remarks.len() == train.len() {
        let what = "no recording changes its voltages by more than 50 V: nothing moves, so nothing can be judged; record a sine, steps or a multisine";
        return Err(Error::NothingExcited(what.into()));
    }
    if train.len() == 1 {
        remarks.push("One recording only: effects that need a series (drift, creep, changes between recordings, payloads) can hardly be judged.".into());
    }
    let offsets: Vec<f64> = train
        .iter()
        .filter(|e| e.dataset.offset_source == OffsetSource::Free)
        .map(|e| e.dataset.offset_s)
        .collect();
    if !offsets.is_empty() {
        remarks.push("A clock offset is left to be estimated: it is free in every model, so a wrong clock cannot be named and a lag of the voltage is harder to see.".into());
    }
    let (nonlinear, linear) =
        super::problem::unknowns(&offsets, forearm.nodes_rad().len(), OFFSET_REACH_S);
    super::enough(own.rows(), nonlinear.len() + linear.len())?;
    let when = |entries: &[Entry]| entries.iter().map(|e| e.when).collect::<Vec<When>>();
    let (train_when, holdout_when) = (when(train), when(holdout));
    let placed = |r: RobotResidual<'a>, when: &[When]| r.with_effects(Vec::new(), Vec::new(), when);
    let problem = Problem {
        train: placed(own, &train_when),
        holdout: (!holdout.is_empty())
            .then(|| {
                let held = residual(holdout)?;
                super::enough_held_out(held.rows())?;
                Ok::<_, Error>(placed(held, &holdout_when))
            })
            .transpose()?,
        train_when,
        holdout_when,
        assumed: None,
        nonlinear,
        linear,
        independent: super::judge::INDEPENDENT,
        begun: DepartureTorques::new(),
        weighed_at: None,
        smoothed_at: None,
        memory: Memory::default(),
        tally: Tally::default(),
    };
    Ok(problem)
}

/// The range that recordings show.
fn seen(residual: &RobotResidual) -> Seen {
    let mut seen = Seen {
        voltage_v: 0.0,
        rate_v_s: 0.0,
        theta_b_rad: [f64::INFINITY, f64::NEG_INFINITY],
        theta_dea_rad: [f64::INFINITY, f64::NEG_INFINITY],
    };
    for (number, d) in residual.datasets().enumerate() {
        let m = residual.mechanics(number);
        for k in 0..3 {
            let mut before = d.command_v(k, 0, d.offset_s);
            for i in 1..d.samples() {
                let v = d.command_v(k, i, d.offset_s);
                seen.voltage_v = seen.voltage_v.max(v.abs());
                seen.rate_v_s = seen.rate_v_s.max((v - before).abs() / d.step_s);
                before = v;
            }
            for i in (0..d.samples()).filter(|&i| d.usable[i]) {
                let widen = |r: &mut [f64; 2], x: f64| *r = [r[0].min(x), r[1].max(x)];
                widen(&mut seen.theta_b_rad, m.chains[k].theta_b[i][0]);
                widen(&mut seen.theta_dea_rad, m.chains[k].theta_dea_rad[i]);
            }
        }
    }
    seen
}

/// The motions that the model makes of the recordings' voltages.
fn motions(residual: &RobotResidual, eta: &[f64], beta: &[f64]) -> Option<Vec<Vec<[f64; 3]>>> {
    predict_motions(
        &residual.mechanics(0).robot,
        &residual.datasets().map(Dataset::whole).collect::<Vec<_>>(),
        &residual.parameters(eta, beta),
        &|r| residual.offset_s(r, eta),
        &residual.effects(eta),
        &residual.series(),
    )
}

/// beta without what departs from the drawing: simulated robots are as drawn.
fn as_drawn(residual: &RobotResidual, beta: &[f64]) -> Vec<f64> {
    let mut beta = beta.to_vec();
    let first = beta.len() - residual.layout().departures;
    beta[first..].fill(0.0);
    beta
}

impl Subject for RobotResidual<'_> {
    const CHAINS: usize = 3;

    fn rig(&self) -> RigKind {
        RigKind::Robot
    }

    fn starts(&self) -> Vec<(&'static dyn Effect, Vec<Vec<f64>>)> {
        let seen = seen(self);
        CATALOGUE
            .iter()
            .flat_map(|e| e.starts(&seen).into_iter().map(move |v| (*e, v)))
            .collect()
    }

    fn moments(&self) -> Vec<&'static dyn Effect> {
        let begins = |e: &&dyn Effect| e.parameters().iter().any(|q| q.name == "recording");
        CATALOGUE.iter().copied().filter(begins).collect()
    }

    fn words(&self) -> Words {
        Words {
            unit: "V".into(),
            basis: "above_1kV",
            over: " above 1 kV",
            directed: "voltage",
            moving: 100.0,
            rich: "To see what could hide here: three rates, holds, a staircase with repeats, a known payload on and off, and poses off the axis.",
            repeat: "The same drive again, then one actuator at a time, with and without a known payload: what repeats with voltage, pose, direction or time says what it depends on.",
        }
    }

    fn whereabouts(&self) -> Vec<Whereabouts> {
        self.datasets()
            .zip(self.series())
            .map(|(d, when)| Whereabouts {
                id: d.id.clone(),
                when,
                span_s: [d.start_s, d.time_s(d.samples() - 1)],
            })
            .collect()
    }

    fn kept_times_s(&self, recording: usize) -> Vec<f64> {
        let d = self.dataset(recording);
        self.kept(recording).iter().map(|&c| d.time_s(c)).collect()
    }

    fn coordinates(&self) -> Vec<Coordinate> {
        [
            ("voltage", "voltage", "V", 0, 1.0),
            ("voltage_rate", "voltage rate", "V/s", 1, 1.0),
            ("height", "height", "mm", 3, 100.0),
            ("largest_stretch", "largest stretch", "1", 5, 1e4),
            ("position", "position", "deg", 6, 100.0),
        ]
        .map(|(dimension, says, unit, at, rounding)| Coordinate {
            dimension,
            says,
            unit: unit.into(),
            at,
            rounding,
        })
        .into()
    }

    fn at(&self, recording: usize) -> Vec<[At; 3]> {
        let (d, mechanics) = (self.dataset(recording), self.mechanics(recording));
        let mut largest = [0.0_f64; 3];
        let so_far: Vec<[f64; 3]> = (0..d.samples())
            .map(|i| {
                [0, 1, 2].map(|k| {
                    let angle = mechanics.chains[k].theta_dea_rad[i];
                    let [a, b] = mechanics.robot.lozenges[k].stretches(angle);
                    largest[k] = largest[k].max(a * b);
                    largest[k]
                })
            })
            .collect();
        self.kept(recording)
            .iter()
            .map(|&c| {
                [0, 1, 2].map(|k| {
                    let t = d.time_s(c);
                    let v = |t: f64| d.voltage.at(k, t + d.offset_s);
                    [
                        v(t).abs(),
                        (v(t + 0.02).abs() - v(t - 0.02).abs()) / 0.04,
                        t,
                        d.axes[2].position[c] * 1e3,
                        mechanics.chains[k].theta_b[c][1],
                        so_far[c][k],
                        mechanics.chains[k].theta_b[c][0].to_degrees(),
                    ]
                })
            })
            .collect()
    }

    fn whitening(&self, recording: usize) -> Vec<[f64; 6]> {
        RobotResidual::whitening(self, recording).to_vec()
    }

    fn features(&self, recording: usize) -> (Vec<&'static str>, Vec<Vec<[f64; 3]>>) {
        let (d, m) = (self.dataset(recording), self.mechanics(recording));
        let when = self.series()[recording];
        let kept = self.kept(recording);
        let v = |k: usize, t: f64| d.voltage.at(k, t + d.offset_s) / 1e3;
        let rate = |k: usize, t: f64| (v(k, t + 0.02) - v(k, t - 0.02)) / 0.04;
        let t = |c: usize| d.time_s(c);
        let mut largest = [0.0_f64; 3];
        let mut at = 0;
        let swing: Vec<[f64; 3]> = kept
            .iter()
            .map(|&c| {
                while at <= c {
                    for (k, l) in largest.iter_mut().enumerate() {
                        *l = l.max(m.chains[k].theta_dea_rad[at]);
                    }
                    at += 1;
                }
                largest
            })
            .collect();
        let mut names = Vec::new();
        let mut columns = Vec::new();
        let mut add = |name: &'static str, value: &dyn Fn(usize, usize, usize) -> f64| {
            names.push(name);
            columns.push(
                kept.iter()
                    .enumerate()
                    .map(|(i, &c)| [0, 1, 2].map(|k| value(i, c, k)))
                    .collect(),
            );
        };
        add("voltage", &|_, c, k| v(k, t(c)));
        add("voltage squared", &|_, c, k| v(k, t(c)).powi(2));
        add("voltage to the fourth", &|_, c, k| v(k, t(c)).powi(4));
        add("voltage rate", &|_, c, k| rate(k, t(c)));
        add("voltage times its rate", &|_, c, k| {
            v(k, t(c)) * rate(k, t(c))
        });
        add("bicep rate", &|_, c, k| m.chains[k].theta_b[c][1]);
        add("direction of motion", &|_, c, k| {
            (m.chains[k].theta_b[c][1] / 0.02).tanh()
        });
        add("bicep rate times its size", &|_, c, k| {
            let rate = m.chains[k].theta_b[c][1];
            rate * rate.abs()
        });
        add("bicep angle", &|_, c, k| m.chains[k].theta_b[c][0]);
        add("bicep angle squared", &|_, c, k| {
            (m.chains[k].theta_b[c][0] - 3.9).powi(2)
        });
        add("bicep angle cubed", &|_, c, k| {
            (m.chains[k].theta_b[c][0] - 3.9).powi(3)
        });
        add("forearm swing", &|_, c, k| m.chains[k].theta_fa_rad[c]);
        add("time", &|_, c, _| t(c));
        add("time in the series", &|_, c, _| when.series_s + t(c));
        add("largest lozenge angle so far", &|i, _, k| swing[i][k]);
        add("squared voltages of the other actuators", &|_, c, k| {
            (0..3).filter(|&j| j != k).map(|j| v(j, t(c)).powi(2)).sum()
        });
        add("acceleration along Z", &|_, c, _| {
            m.track.acceleration_m_s2[c][2]
        });
        (names, columns)
    }

    fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        series: &[When],
    ) -> Self {
        RobotResidual::with_effects(self, effects, free, series)
    }

    fn effects(&self, eta: &[f64]) -> Vec<Acting> {
        RobotResidual::effects(self, eta)
    }

    fn linearise(&mut self, eta: &[f64], beta: &[f64], anew: bool) -> Result<(), Locked> {
        RobotResidual::linearise(self, eta, beta, anew)
    }

    fn weigh(&mut self, eta: &[f64], beta: &[f64]) -> Result<(), Locked> {
        RobotResidual::weigh(self, eta, beta)
    }

    fn design(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        RobotResidual::design(self, eta, beta)
    }

    fn fingerprint(&self, eta: &[f64], beta: &[f64], acting: &Acting) -> Result<Vec<f64>, Locked> {
        RobotResidual::fingerprint(self, eta, beta, acting)
    }

    fn fingerprint_by_actuator(
        &self,
        eta: &[f64],
        beta: &[f64],
        effect: &'static dyn Effect,
        v: &[f64],
    ) -> Result<[Vec<f64>; 3], Locked> {
        RobotResidual::fingerprint_by_actuator(self, eta, beta, effect, v)
    }

    fn dictionary(&self, residual: &DVector<f64>) -> Vec<Group> {
        learn::of_robot(self, residual)
    }

    fn term_columns(&self, term: &Learnt) -> TermColumns {
        RobotResidual::term_columns(self, term)
    }

    fn made_by(&self, acting: &Acting) -> Made {
        learn::made_by(self, acting)
    }

    fn without(&self, recording: usize, kept: Range<usize>) -> Self {
        let mut out = self.clone();
        out.mute(recording, kept);
        out
    }

    fn noise_rows(&self) -> Vec<Vec<f64>> {
        RobotResidual::noise_rows(self)
    }

    fn fresh_noise_rows(
        &self,
        count: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<Vec<f64>>, Locked> {
        RobotResidual::fresh_noise_rows(self, count, eta, beta)
    }

    fn score_covariance(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        RobotResidual::score_covariance(self, eta, beta)
    }

    fn expected_score(
        &self,
        eta: &[f64],
        beta: &[f64],
        truth: &[f64],
    ) -> Result<Option<ExpectedScore>, Locked> {
        let (true_eta, true_beta) = truth.split_at(eta.len());
        let motions = motions(self, true_eta, true_beta);
        let beta = &as_drawn(self, beta);
        RobotResidual::expected_score(self, motions.as_deref(), eta, beta, NOISE_PAIRS)
    }

    fn expected_residual(&self, eta: &[f64], beta: &[f64]) -> Option<DVector<f64>> {
        let motions = motions(self, eta, beta)?;
        // a film that such a track would lock tells nothing
        let beta = &as_drawn(self, beta);
        RobotResidual::expected_residual(self, &motions, eta, beta, NOISE_PAIRS).ok()?
    }

    fn take_out(&mut self, expected: Option<&DVector<f64>>) {
        RobotResidual::take_out(self, expected);
    }

    fn tolerances(&self) -> Vec<Tolerance> {
        let robot = self.robot();
        tolerance::of_robot(
            &robot.tolerances,
            robot.effector_kg,
            self.datasets().count(),
        )
    }

    fn departures(
        &self,
        eta: &[f64],
        beta: &[f64],
        list: &[Departure],
    ) -> Result<DepartureTorques, Locked> {
        RobotResidual::departures(self, eta, beta, list)
    }

    fn begun(&self, eta: &[f64], beta: &[f64]) -> Result<DepartureTorques, Locked> {
        RobotResidual::begun(self, eta, beta)
    }

    fn departure_rows(&self, torques: &DepartureTorques) -> DMatrix<f64> {
        RobotResidual::departure_rows(self, torques)
    }

    fn allow(&mut self, torques: &DepartureTorques, combine: &DMatrix<f64>) {
        RobotResidual::allow(self, torques, combine);
    }

    fn filtered_departures(&self, torques: &DepartureTorques) -> Vec<DMatrix<f64>> {
        RobotResidual::filtered_departures(self, torques)
    }

    fn allow_more(&mut self, filtered: &[DMatrix<f64>], combine: &DMatrix<f64>) {
        RobotResidual::allow_more(self, filtered, combine);
    }

    fn rebuild(&mut self, base: Vec<Acting>) -> Result<(), Locked> {
        RobotResidual::rebuild(self, base)
    }

    fn allowed(&self) -> usize {
        self.layout().departures
    }

    fn carried(&self, plain: &[f64]) -> Vec<f64> {
        let mut eta = plain[..BRANCHES + 1].to_vec();
        let free = &self.layout().free_offsets;
        eta.extend(free.iter().map(|&r| self.dataset(r).offset_s));
        eta
    }

    fn parameters(&self, eta: &[f64], beta: &[f64]) -> Parameters {
        RobotResidual::parameters(self, eta, beta)
    }

    fn errors(&self, recording: usize, eta: &[f64], beta: &[f64]) -> Result<Errors, Locked> {
        let d = self.dataset(recording);
        let e = self.voltage_error(recording, eta, beta)?;
        let n = d.samples();
        let three = |of: &dyn Fn(usize, usize) -> f64| {
            (0..n).map(|i| [0, 1, 2].map(|k| of(i, k))).collect()
        };
        Ok(Errors {
            time_s: (0..n).map(|i| d.time_s(i)).collect(),
            error: three(&|i, k| root_v(e.predicted_squared_v2[i][k]) - e.command_v[i][k].abs()),
            basis: e
                .command_v
                .iter()
                .map(|c| c.map(|v| v.abs() > 1000.0))
                .collect(),
            command: e.command_v,
            sd: e.sd_v,
            counts: e.counts,
            height: d.axes[2].position.iter().map(|z| z * 1e3).collect(),
        })
    }

    fn kept_errors(
        &self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<[f64; 4]>, Locked> {
        let d = self.dataset(recording);
        let torque = self.filtered_torque_error(recording, eta, beta)?;
        Ok(self
            .kept(recording)
            .iter()
            .zip(torque)
            .map(|(&c, t)| [d.time_s(c), t[0], t[1], t[2]])
            .collect())
    }
}
