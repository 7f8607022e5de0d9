//! The film: reference integrator against an independent simulator, production kernel against both,
//! identities.
use crate::common;
use common::*;
use deacal::film::kernel::{History, LANES, Pass, ROW, Shape};
use deacal::film::{Film, InitialState, ReferenceState, gent_stress, integrate_reference};

#[test]
fn reference_integrator_agrees_with_the_independent_simulator() {
    let g = golden("film");
    let tolerance = &g["tolerance"];
    for case in g["cases"].as_array().unwrap() {
        let film = film(case);
        let history = &case["history"];
        let stretch = |t: f64| {
            [
                sines(&history["lambda_1"], t)[0],
                sines(&history["lambda_2"], t)[0],
            ]
        };
        let rows = case["rows"].as_array().unwrap();
        let times: Vec<f64> = rows.iter().map(|r| number(&r["t"])).collect();
        let states =
            integrate_reference(&film, initial(&case["start"]), stretch, &times, 1e-3).unwrap();
        for (row, state) in rows.iter().zip(&states) {
            for (n, want) in row["xi"].as_array().unwrap().iter().enumerate() {
                for i in 0..2 {
                    let error = (state.xi[n][i] - numbers(want)[i]).abs();
                    assert!(
                        error < number(&tolerance["xi_absolute"]),
                        "{} {error:e}",
                        case["name"]
                    );
                }
            }
            let (sigma, energy) = film.stress_pa(state.lambda, &state.xi).unwrap();
            let want = numbers(&row["sigma_Pa"]);
            for i in 0..2 {
                let allowed = number(&tolerance["sigma_absolute_Pa"])
                    .max(number(&tolerance["sigma_relative"]) * want[i].abs());
                assert!(
                    (sigma[i] - want[i]).abs() < allowed,
                    "{} {sigma:?} {want:?}",
                    case["name"]
                );
            }
            let want = number(&row["W_J_per_m3"]);
            assert!((energy - want).abs() < 1e-8 * want, "{energy} {want}");
        }
    }
}

#[test]
fn locking_is_an_error_that_names_the_spring() {
    let g = golden("film");
    for case in g["must_error"].as_array().unwrap() {
        let film = film(case);
        let lambda = [number(&case["lambda_1"]), number(&case["lambda_2"])];
        let error = film.stress_pa(lambda, &[lambda; 6]).unwrap_err();
        assert_eq!(error.spring, 1);
        assert!(error.to_string().contains("locking"), "{error}");
        let history = History::sampled(
            InitialState::Relaxed,
            0.01,
            &[lambda; 3],
            &[[0.0; 2]; 3],
            &[[1.0, 0.0]; 3],
        );
        let shape = Shape {
            relaxation_time_s: &film.relaxation_time_s,
            locking: film.locking,
        };
        let mut rows = vec![0.0; ROW * 4];
        let error = Pass::new(&history, shape)
            .next_block(&mut rows)
            .unwrap_err();
        assert_eq!(error.spring, 1);
    }
}

/// Stress over modulus of each spring along a reference integration, for direction `i`.
fn reference_stress(film: &Film, states: &[ReferenceState], i: usize) -> Vec<Vec<f64>> {
    let unit = |state: &ReferenceState, n: usize| {
        let x = if n == 0 { [1.0; 2] } else { state.xi[n - 1] };
        let squared = |j: usize| (state.lambda[j] / x[j]).powi(2);
        gent_stress(squared(0), squared(1), film.locking).unwrap().0[i]
    };
    (0..=film.branches())
        .map(|n| states.iter().map(|s| unit(s, n)).collect())
        .collect()
}

/// All rows of a pass, in blocks of an awkward size.
fn run(history: &History, shape: Shape) -> Vec<Vec<f64>> {
    let mut pass = Pass::new(history, shape);
    let width = pass.row_width();
    let mut rows = vec![0.0; 37 * width];
    let mut out = Vec::new();
    loop {
        let n = pass.next_block(&mut rows).unwrap();
        if n == 0 {
            break;
        }
        out.extend(rows[..n * width].chunks(width).map(<[f64]>::to_vec));
    }
    assert_eq!(out.len(), history.samples());
    out
}

fn sampled(
    case: &serde_json::Value,
    step: f64,
    duration: f64,
    lever: [f64; 2],
) -> (History, Vec<f64>) {
    let n = (duration / step).round() as usize + 1;
    let times: Vec<f64> = (0..n).map(|i| i as f64 * step).collect();
    let both = |t: f64| {
        [
            sines(&case["history"]["lambda_1"], t),
            sines(&case["history"]["lambda_2"], t),
        ]
    };
    let stretch: Vec<[f64; 2]> = times.iter().map(|&t| both(t).map(|s| s[0])).collect();
    let rate: Vec<[f64; 2]> = times
        .iter()
        .map(|&t| both(t).map(|s| s[1] / s[0]))
        .collect();
    let history = History::sampled(
        initial(&case["start"]),
        step,
        &stretch,
        &rate,
        &vec![lever; n],
    );
    (history, times)
}

/// What the scheme's order gives at 100 Hz with drives of up to 4 Hz: largest error of a spring's stress
/// relative to the largest stress of that spring.
fn tolerance(relaxation_s: f64, virgin: bool) -> f64 {
    let smooth: f64 = if relaxation_s < 0.05 {
        3e-4
    } else if relaxation_s < 5.0 {
        1e-4
    } else {
        2e-5
    };
    if virgin { smooth.max(2e-4) } else { smooth }
}

#[test]
fn production_kernel_at_100_hz_keeps_the_accuracy_of_its_order() {
    let g = golden("film");
    for case in g["cases"].as_array().unwrap() {
        let film = film(case);
        for direction in 0..2 {
            let mut lever = [0.0; 2];
            lever[direction] = 1.0;
            let (history, times) = sampled(case, 0.01, 12.0, lever);
            let shape = Shape {
                relaxation_time_s: &film.relaxation_time_s,
                locking: film.locking,
            };
            let rows = run(&history, shape);
            let stretch = |t: f64| {
                [
                    sines(&case["history"]["lambda_1"], t)[0],
                    sines(&case["history"]["lambda_2"], t)[0],
                ]
            };
            let states =
                integrate_reference(&film, initial(&case["start"]), stretch, &times, 2e-3).unwrap();
            for (n, want) in reference_stress(&film, &states, direction)
                .iter()
                .enumerate()
            {
                let size = want.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                let error = want
                    .iter()
                    .zip(&rows)
                    .fold(0.0_f64, |m, (w, r)| m.max((w - r[n]).abs()));
                let allowed = if n == 0 {
                    1e-12
                } else {
                    tolerance(film.relaxation_time_s[n - 1], case["start"] == "virgin")
                };
                println!(
                    "{} {direction} spring {n}: {:.2e} of {allowed:.0e}",
                    case["name"],
                    error / size
                );
                assert!(
                    error < allowed * size,
                    "{} {direction} spring {n}: {:.2e}",
                    case["name"],
                    error / size
                );
            }
        }
    }
}

#[test]
fn halving_the_step_divides_the_error_by_four_or_more() {
    let g = golden("film");
    let case = &g["cases"][0];
    let film = film(case);
    let shape = Shape {
        relaxation_time_s: &film.relaxation_time_s,
        locking: film.locking,
    };
    let fine = run(&sampled(case, 0.000_625, 6.0, [1.0, 0.3]).0, shape);
    let error = |step: f64, stride: usize| {
        let rows = run(&sampled(case, step, 6.0, [1.0, 0.3]).0, shape);
        rows.iter().enumerate().fold(0.0_f64, |m, (i, r)| {
            m.max((r[2] - fine[i * stride][2]).abs())
        })
    };
    let (coarse, half) = (error(0.01, 16), error(0.005, 8));
    assert!(coarse / half > 3.8, "{coarse:e} {half:e}");
}

#[test]
fn kernel_derivatives_equal_differences_of_the_kernel() {
    let g = golden("film");
    for name in [0, 3, 4] {
        let case = &g["cases"][name];
        let film = film(case);
        let (history, _) = sampled(case, 0.01, 5.0, [0.7, -0.4]);
        let value = |t: &[f64], j: f64| {
            run(
                &history,
                Shape {
                    relaxation_time_s: t,
                    locking: j,
                },
            )
        };
        let at = value(&film.relaxation_time_s, film.locking);
        let h = 1e-5;
        let shifted = |branch: Option<usize>, s: f64| {
            let (mut t, mut j) = (film.relaxation_time_s.clone(), film.locking);
            match branch {
                Some(n) => t[n] *= (s * h).exp(),
                None => j *= (s * h).exp(),
            }
            value(&t, j)
        };
        for branch in 0..film.branches() {
            let (up, down) = (shifted(Some(branch), 1.0), shifted(Some(branch), -1.0));
            for i in 0..at.len() {
                let difference = (up[i][branch + 1] - down[i][branch + 1]) / (2.0 * h);
                let exact = at[i][LANES + branch + 1];
                assert!(
                    (difference - exact).abs() < 1e-8,
                    "T{branch} row {i}: {exact} {difference}"
                );
            }
        }
        let (up, down) = (shifted(None, 1.0), shifted(None, -1.0));
        for i in 0..at.len() {
            for spring in 0..=film.branches() {
                let difference = (up[i][spring] - down[i][spring]) / (2.0 * h);
                let exact = at[i][2 * LANES + spring];
                assert!(
                    (difference - exact).abs() < 1e-8,
                    "J spring {spring} row {i}: {exact} {difference}"
                );
            }
        }
    }
}

#[test]
fn up_to_eight_branches_fill_two_packs_of_lanes() {
    let g = golden("film");
    let (history, times) = sampled(&g["cases"][1], 0.01, 3.0, [1.0, 0.0]);
    let t8 = [0.05, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];
    let all = run(
        &history,
        Shape {
            relaxation_time_s: &t8,
            locking: 60.0,
        },
    );
    let one = run(
        &history,
        Shape {
            relaxation_time_s: &t8[7..],
            locking: 60.0,
        },
    );
    for i in 0..times.len() {
        assert_eq!(
            all[i][ROW], one[i][1],
            "spring 9 stands first in the second pack"
        );
    }
}
