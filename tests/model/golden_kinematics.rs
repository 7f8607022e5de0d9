//! The mechanism against an independent simulator, and its derivatives against differences of itself.
use crate::common;
use common::*;

fn close(what: &str, got: f64, want: f64, absolute: f64, relative: f64) {
    let error = (got - want).abs();
    assert!(
        error <= absolute.max(relative * want.abs()),
        "{what}: {got} against {want}, off by {error:e}"
    );
}

#[test]
fn poses_agree_with_the_independent_simulator() {
    let g = golden("kinematics");
    let (mechanism, lozenge) = (mechanism(&g["rig"]), lozenge(&g["rig"]));
    let absolute = number(&g["tolerance"]["absolute"]);
    let relative = number(&g["tolerance"]["derivatives_relative"]);
    let poses = g["poses"].as_array().unwrap();
    assert!(!poses.is_empty());
    for pose in poses {
        let u = triple(&pose["u_mm"]).map(|v| v * 1e-3);
        let got = mechanism.pose(u).unwrap();
        for (k, want) in pose["chains"].as_array().unwrap().iter().enumerate() {
            let angle = |name, got| close(name, got, number(&want[name]), absolute, 0.0);
            angle("theta_b", got[k].theta_b_rad);
            angle("theta_k1", got[k].theta_k1_rad);
            angle("theta_SAM", got[k].theta_sam_rad);
            angle("theta_DEA", got[k].theta_dea_rad);
            angle("theta_FA", got[k].theta_fa_rad);
            let [l1, l2] = lozenge.stretches(got[k].theta_dea_rad);
            angle("lambda_1", l1);
            angle("lambda_2", l2);
            let row = |name: &str, got: [f64; 3]| {
                let want = triple(&want[name]);
                let size = want.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                for i in 0..3 {
                    close(name, got[i], want[i], relative * size, relative);
                }
            };
            row("dtheta_DEA_du", got[k].dtheta_dea_du);
            row("dtheta_FA_du", got[k].dtheta_fa_du);
            row("dtheta_b_du", got[k].dtheta_b_du);
        }
    }
}

#[test]
fn poses_out_of_reach_say_which_chain_and_joint() {
    let g = golden("kinematics");
    let list = g["unreachable"].as_array().unwrap();
    assert!(!list.is_empty());
    for item in list {
        let mut rig = g["rig"].clone();
        for (key, value) in item["rig_change"].as_object().into_iter().flatten() {
            rig[key] = value.clone();
        }
        let u = triple(&item["u_mm"]).map(|v| v * 1e-3);
        let error = mechanism(&rig)
            .pose(u)
            .expect_err("this pose cannot be taken");
        let text = error.to_string();
        let first = &item["failing"][0];
        assert_eq!(error.chain, number(&first["chain"]) as usize, "{text}");
        let joint = first["joint"].as_str().unwrap();
        assert!(
            text.contains("out of reach") && text.contains(joint),
            "{text}"
        );
        assert!(
            error.value < error.low || error.value > error.high,
            "{text}"
        );
    }
}

#[test]
fn derivatives_are_those_of_the_angles() {
    let g = golden("kinematics");
    let mechanism = mechanism(&g["rig"]);
    let u = [0.004, -0.007, -0.055];
    let at = mechanism.pose(u).unwrap();
    let h = 1e-6;
    for axis in 0..3 {
        let moved = |s: f64| {
            let mut w = u;
            w[axis] += s * h;
            mechanism.pose(w).unwrap()
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        for k in 0..3 {
            let slope = |f: fn(&deacal::kinematics::ChainPose) -> f64| {
                (f(&up[k]) - f(&down[k])) / (2.0 * h)
            };
            close(
                "b",
                slope(|p| p.theta_b_rad),
                at[k].dtheta_b_du[axis],
                1e-6,
                1e-7,
            );
            close(
                "DEA",
                slope(|p| p.theta_dea_rad),
                at[k].dtheta_dea_du[axis],
                1e-6,
                1e-7,
            );
            close(
                "FA",
                slope(|p| p.theta_fa_rad),
                at[k].dtheta_fa_du[axis],
                1e-6,
                1e-7,
            );
        }
    }
    // theta_b along a track: first and second time derivative against differences.
    let track = |t: f64| {
        [
            0.004 + 0.01 * t + 0.3 * t * t,
            -0.007 - 0.02 * t * t,
            -0.055 + 0.05 * t,
        ]
    };
    let (v, a) = ([0.01, 0.0, 0.05], [0.6, -0.04, 0.0]);
    let dt = 1e-4;
    let (p, m) = (
        mechanism.pose(track(dt)).unwrap(),
        mechanism.pose(track(-dt)).unwrap(),
    );
    for k in 0..3 {
        let (rate, acceleration) = mechanism.chains[k].bicep_rates(&at[k], v, a);
        let (up, mid, down) = (p[k].theta_b_rad, at[k].theta_b_rad, m[k].theta_b_rad);
        close("rate", rate, (up - down) / (2.0 * dt), 1e-6, 1e-6);
        close(
            "acceleration",
            acceleration,
            (up - 2.0 * mid + down) / (dt * dt),
            1e-5,
            1e-5,
        );
    }
}
