//! The fused residual pass against the machine's own limit, measured in the same run: how many times as long
//! an evaluation takes as its 29.5 million floating-point operations would at the peak of fused
//! multiply-adds; and a fit, and five starts, in evaluations. Ratios, because machines differ and are shared.
//!
//! `cargo bench --bench kernel`

use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::Instant;

use deacal::dataset::{Dataset, Parts, Voltage};
use deacal::film::kernel::{Pass, ROW, Shape};
use deacal::film::{Film, InitialState};
use deacal::fit::separable::{Options, Prior, Unknown, minimise};
use deacal::kinematics::{Chain, FourBar, Lozenge, Mechanism};
use deacal::model::{ForearmTorque, Mechanics, Parameters, Robot, Track};
use deacal::residual::{RobotResidual, SeparableResidual};
use pulp::{Arch, Simd, WithSimd};

/// Operations of one evaluation: 3 actuators, 60 s at 100 Hz (performance notes of the project).
const OPERATIONS: f64 = 29.5e6;

struct Peak<'a>(&'a mut [f64], usize);

impl WithSimd for Peak<'_> {
    type Output = f64;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        const CHAINS: usize = 16;
        let mut x = [simd.splat_f64s(1.0); CHAINS];
        let (a, b) = (simd.splat_f64s(self.0[0]), simd.splat_f64s(self.0[1]));
        for _ in 0..self.1 {
            for x in &mut x {
                *x = simd.mul_add_e_f64s(*x, a, b);
            }
        }
        for x in x {
            self.0[0] += simd.reduce_sum_f64s(x);
        }
        (2 * CHAINS * self.1 * S::F64_LANES) as f64
    }
}

/// Best of several timings of `run`, s.
fn best(times: usize, mut run: impl FnMut()) -> f64 {
    (0..times)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    let mut flops = 0.0;
    let seconds = best(20, || {
        let mut seed = [0.999_999, 1e-9];
        flops = Arch::new().dispatch(Peak(black_box(&mut seed), 200_000));
        black_box(seed);
    });
    let peak = flops / seconds;
    let (robot, dataset, film) = recording(60.0);
    let datasets = [&dataset];
    let forearm = ForearmTorque::zero();
    let residual = RobotResidual::new(&robot, &datasets, 6, &forearm).expect("in reach");
    let mut eta: Vec<f64> = film.relaxation_time_s.iter().map(|t| t.ln()).collect();
    eta.push(1.0 / film.locking);
    let mut beta = film.mu_pa.clone();
    beta.extend([0.0; 7]);
    let evaluation = best(60, || {
        black_box(
            residual
                .evaluate(black_box(&eta), &beta)
                .expect("no locking"),
        );
    });
    let limit = OPERATIONS / peak;
    let kernel = best(60, || {
        let mut rows = vec![0.0; 64 * ROW];
        let shape = Shape {
            relaxation_time_s: &film.relaxation_time_s,
            locking: film.locking,
        };
        for chain in &residual.mechanics(0).chains {
            let mut pass = Pass::new(&chain.history, shape);
            while pass.next_block(&mut rows).expect("no locking") > 0 {
                black_box(&rows);
            }
        }
    });
    println!("fused multiply-add peak        {:8.1} GFLOP/s", peak * 1e-9);
    println!("one residual and Jacobian      {:8.3} ms", evaluation * 1e3);
    println!("  of which the film kernel     {:8.3} ms", kernel * 1e3);
    println!(
        "  over 29.5 MFLOP at the peak  {:8.2} (bar: 4)",
        evaluation / limit
    );
    let long = recording(600.0);
    let datasets = [&long.1];
    let longer = RobotResidual::new(&robot, &datasets, 6, &forearm).expect("in reach");
    let ten = best(10, || {
        black_box(longer.evaluate(black_box(&eta), &beta).expect("no locking"));
    });
    println!(
        "  600 s over 60 s              {:8.2} (linear: 10)",
        ten / evaluation
    );

    let starts: Vec<Vec<f64>> = (0..5)
        .map(|s| {
            let shift = |i: usize| {
                0.8 * (((s * 7 + i * 3) % 5) as f64 / 2.0 - 1.0) * f64::from(s.min(1) as u8)
            };
            let times = [0.03, 0.15, 0.8, 4.0, 20.0, 100.0f64];
            let logs = times.iter().enumerate().map(|(i, t)| t.ln() + shift(i));
            logs.chain([0.02 + 0.015 * shift(6)]).collect()
        })
        .collect();
    let nonlinear: Vec<Unknown> = starts[0]
        .iter()
        .enumerate()
        .map(|(i, &mean)| {
            let (sd, lower, upper) = if i < 6 {
                (1.15, -5.3, 8.0)
            } else {
                (0.05, 1e-4, 20.0)
            };
            Unknown {
                prior: Some(Prior { mean, sd }),
                ..Unknown::free(mean, lower, upper)
            }
        })
        .collect();
    let mut linear = vec![Unknown::free(1e5, 0.0, 1e9); 7];
    linear.extend([Unknown::fixed(0.0); 7]);
    let options = Options::default();
    let mut weighed = RobotResidual::new(&robot, &[&dataset], 6, &forearm).expect("in reach");
    weighed.weigh(&eta, &beta).expect("no locking");
    let fit = |start: &[f64]| {
        minimise(&weighed, &nonlinear, &linear, start, &options, |_| {
            ControlFlow::Continue(())
        })
    };
    let one = best(5, || {
        black_box(fit(&starts[0]));
    });
    let all = best(3, || {
        for s in &starts {
            black_box(fit(s));
        }
    });
    println!(
        "one fit, converged             {:8.1} evaluations' worth (bar: 30), {:.1} ms",
        one / evaluation,
        one * 1e3
    );
    println!(
        "five starts, one after another {:8.1} evaluations' worth (bar: 100), {:.1} ms",
        all / evaluation,
        all * 1e3
    );
    for s in &starts {
        let state = fit(s);
        println!(
            "  {} evaluations, cost {:.6}, {}",
            state.evaluations,
            state.cost,
            state.ended.map_or("", |e| e.words())
        );
    }
}

/// A noisy symmetric-and-lateral motion with the voltages that a known film needs for it.
fn recording(duration_s: f64) -> (Robot, Dataset, Film) {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let chain = Chain {
        azimuth_rad: 0.0,
        base_radius_m: 0.03,
        effector_radius_m: 0.025,
        bicep_m: 0.05,
        forearm_m: 0.05,
        input_offset_rad: 93f64.to_radians(),
        four_bar: FourBar {
            a_m: 0.055,
            b_m: 0.01,
            c_m: 0.0115,
            d_m: 0.062,
        },
        dea_offset_rad: 151f64.to_radians(),
    };
    let lozenge = Lozenge {
        side_m: 0.05,
        l1_m: 0.0629,
        l2_m: 0.04065,
        l3_m: 85e-6,
        films: 2.0,
    };
    let robot = Robot {
        mechanism: Mechanism::symmetric(chain),
        lozenges: [lozenge; 3],
        eps_r: 2.8,
        effector_kg: 6e-3,
        bicep_tip_kg: 0.96e-3,
        tolerances: Vec::new(),
    };
    let film = Film {
        mu_pa: vec![1120e3, 220e3, 120e3, 55e3, 45e3, 35e3, 30e3],
        relaxation_time_s: vec![0.02, 0.12, 0.7, 4.0, 25.0, 150.0],
        locking: 80.0,
    };
    let step_s = 0.01;
    let n = (duration_s / step_s) as usize;
    let w = 2.0 * std::f64::consts::PI / 3.0;
    let at = |t: f64| {
        let (s, c) = (w * t).sin_cos();
        let z = -0.053 + 0.010 * c;
        (
            [0.003 * s, 0.002 * s, z],
            [0.003 * w * c, 0.002 * w * c, -0.010 * w * s],
            [-0.003 * w * w * s, -0.002 * w * w * s, -0.010 * w * w * c],
        )
    };
    let track = Track {
        step_s,
        position_m: (0..n).map(|i| at(i as f64 * step_s).0).collect(),
        velocity_m_s: (0..n).map(|i| at(i as f64 * step_s).1).collect(),
        acceleration_m_s2: (0..n).map(|i| at(i as f64 * step_s).2).collect(),
        payload_kg: vec![0.0; n],
        initial: InitialState::Relaxed,
    };
    let parameters = Parameters {
        film: film.clone(),
        forearm: ForearmTorque::zero(),
    };
    let phi = Mechanics::new(&robot, &track)
        .expect("in reach")
        .phi_squared_v2(&parameters)
        .expect("no locking");
    let mut generator = rand_chacha::ChaCha12Rng::seed_from_u64(7);
    let measured_m = track
        .position_m
        .iter()
        .map(|p| {
            p.map(|v| {
                let z: f64 = StandardNormal.sample(&mut generator);
                v + 3e-5 * z
            })
        })
        .collect();
    let channels = (0..3)
        .map(|k| phi.iter().map(|p| p[k].max(0.0).sqrt()).collect())
        .collect();
    let parts = Parts {
        id: "bench".into(),
        step_s,
        start_s: 0.0,
        measured_m,
        payload_kg: vec![0.0; n],
        voltage: Voltage::new((0..n).map(|i| i as f64 * step_s).collect(), channels, false),
        monitor: None,
        offset_s: Some(0.0),
        initial: InitialState::Relaxed,
    };
    (robot, Dataset::new(parts, None).expect("long enough"), film)
}
