//! Doubts: is the plain model adequate, where does it fail, and which physics was left out.

mod problem;
mod scan;

use rayon::prelude::*;

use crate::dataset::{Dataset, OffsetSource};
use crate::effects::{Seen, When};
use crate::model::{ForearmTorque, Robot};
use crate::residual::{OFFSET_REACH_S, RobotResidual};
use problem::{BRANCHES, Fitted, Problem, Tangent};

pub fn experiment(robot: &Robot, train: &[&Dataset], holdout: &[&Dataset], train_when: Vec<When>, holdout_when: Vec<When>) {
    let t0 = std::time::Instant::now();
    let forearm = ForearmTorque::zero();
    let open = |d: &[&'_ Dataset]| RobotResidual::new(robot, unsafe { std::mem::transmute(d) }, BRANCHES, &forearm).unwrap_or_else(|_| panic!("reach"));
    let residual = open(train);
    let offsets: Vec<f64> = train.iter().filter(|d| d.offset_source == OffsetSource::Free).map(|d| d.offset_s).collect();
    let (nonlinear, linear) = problem::unknowns(&offsets, 7, OFFSET_REACH_S);
    let mut p = Problem { train: residual, holdout: (!holdout.is_empty()).then(|| open(holdout)), train_when, holdout_when, nonlinear, linear };
    let eta: Vec<f64> = p.nonlinear.iter().map(|u| u.start).collect();
    let beta: Vec<f64> = p.linear.iter().map(|u| u.start).collect();
    eprintln!("open {:?}", t0.elapsed());
    p.train.keep_drawn(6);
    if let Some(h) = &mut p.holdout { h.keep_drawn(6); }
    eprintln!("drawn {:?}", t0.elapsed());
    let mut plain = p.fit(&[], &eta, &beta, 40);
    eprintln!("fit0 {:?} ev {} cost {:.1}", t0.elapsed(), plain.state.evaluations, plain.cost());
    for _ in 0..2 {
        p.weigh(&plain).unwrap();
        eprintln!("weigh {:?}", t0.elapsed());
        plain = p.fit(&[], &plain.state.eta.clone(), &plain.state.beta.clone(), 60);
        eprintln!("fit {:?} ev {} cost/N {:.3} N {}", t0.elapsed(), plain.state.evaluations, plain.cost() / plain.state.rows as f64, plain.state.rows);
    }
    eprintln!("T {:?} J {:.1} mu {:?}", plain.state.eta[..6].iter().map(|x| (x.exp() * 1e3).round() / 1e3).collect::<Vec<_>>(), 1.0 / plain.state.eta[6], plain.state.beta[..7].iter().map(|x| (x / 1e3).round()).collect::<Vec<_>>());
    let tangent = Tangent::new(&p, &plain).unwrap();
    let mut seen = Seen { voltage_v: 0.0, rate_v_s: 0.0, theta_b_rad: [9.0, -9.0], theta_dea_rad: [9.0, -9.0] };
    for (n, d) in train.iter().enumerate() {
        let m = p.train.mechanics(n);
        for k in 0..3 {
            for i in 1..d.samples() {
                let (a, b) = (d.command_v(k, i - 1, d.offset_s), d.command_v(k, i, d.offset_s));
                seen.voltage_v = seen.voltage_v.max(b.abs());
                seen.rate_v_s = seen.rate_v_s.max((b - a).abs() / d.step_s);
                let t = m.chains[k].theta_b[i][0];
                seen.theta_b_rad = [seen.theta_b_rad[0].min(t), seen.theta_b_rad[1].max(t)];
                let t = m.chains[k].theta_dea_rad[i];
                seen.theta_dea_rad = [seen.theta_dea_rad[0].min(t), seen.theta_dea_rad[1].max(t)];
            }
        }
    }
    let all = scan::scan(&p, &plain, &tangent, &seen).unwrap();
    eprintln!("scan {:?} {} hypotheses", t0.elapsed(), all.len());
    for s in all.iter().take(8) {
        eprintln!("   {:10.1} hid {:.4} {:?}", s.promised, s.hidden_share, s.acting);
    }
    // refit
    let mut chosen: Vec<&scan::Scanned> = Vec::new();
    for s in &all {
        let of = chosen.iter().filter(|c| c.acting.effect.id() == s.acting.effect.id()).count();
        if of < 2 && chosen.len() < 10 {
            chosen.push(s);
        }
    }
    let n = plain.state.rows as f64;
    let mut fits: Vec<(Fitted, f64)> = chosen
        .par_iter()
        .map(|s| {
            let t = std::time::Instant::now();
            let warm = p.fit(&[s.acting.clone()], &plain.state.eta, &plain.state.beta, 15);
            let f = if warm.cost() > plain.cost() - 0.5 * s.promised {
                let cold = p.fit(&[s.acting.clone()], &eta, &beta, 15);
                if warm.cost() < cold.cost() { warm } else { cold }
            } else { warm };
            (f, t.elapsed().as_secs_f64())
        })
        .collect();
    fits.sort_by(|a, b| a.0.cost().total_cmp(&b.0.cost()));
    eprintln!("refits {:?}", t0.elapsed());
    let h0 = p.held_out(&plain);
    eprintln!("   plain chi2/N {:.3} hold {:?}", plain.cost() / n, h0.map(|h| h.0 / h.1 as f64));
    for (f, t) in fits.iter().take(8) {
        let h = p.held_out(f);
        eprintln!("   {:.3} hold {:.3} ev {} {:.2}s {:?}", f.cost() / n, h.map_or(f64::NAN, |h| h.0 / h.1 as f64), f.state.evaluations, t, f.effects);
    }
}
