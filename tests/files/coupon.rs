//! What a calibration on coupons writes: fit.json, parameters.toml and report.html of the bundled film.

use crate::common;

use std::ops::ControlFlow;
use std::path::Path;

use common::check;
use deacal::calibration::{CouponOutcome, CouponRequest, calibrate_coupons};
use deacal::dataset::Coupon;
use deacal::recording::Recording;
use deacal::report::html::render_coupons;
use deacal::report::json::{FitJson, PlanJson, to_text};
use deacal::report::parameter_file::ParameterFile;
use deacal::report::provenance::Provenance;
use serde_json::Value;

fn fitted(request: &CouponRequest) -> (CouponOutcome, Provenance) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/miles2015_vhb4910");
    let recording = Recording::open(&folder).unwrap();
    let coupon = Coupon::from_recording(&recording).unwrap();
    let go = |_: &_| ControlFlow::Continue(());
    let outcome = calibrate_coupons(&[&coupon], request, &go).unwrap();
    let provenance = Provenance::of("deacal fit coupon miles2015_vhb4910", [&recording]);
    (outcome, provenance)
}

#[test]
fn fit_json_has_the_contracts_keys_in_pascal() {
    let (outcome, provenance) = fitted(&CouponRequest::new(3));
    let fit = FitJson::of_coupons(&outcome, provenance);
    let text = to_text(&fit);
    check("fit", &text);
    assert!(!text.contains("NaN"));
    assert_eq!(serde_json::from_str::<FitJson>(&text).unwrap(), fit);
    let json: Value = serde_json::from_str(&text).unwrap();
    let c = &outcome.coupons[0];
    assert_eq!(json["job"], "coupon");
    assert_eq!(json["rmse_unit"], "Pa");
    assert_eq!(json["rmse_basis"], "all");
    assert_eq!(json["n_samples"], 1275 - 11);
    assert_eq!(json["converged"], true);
    assert!(json["eps_r"].is_null() && json["swing_range_deg"].is_null());
    for (at, value) in [
        ("/rmse_V", c.rmse_pa),
        ("/rmse_all_V", c.rmse_pa),
        ("/max_error_V", c.max_error_pa),
        ("/noise_floor_V", c.noise_pa),
        ("/nrmse_percent", outcome.nrmse_percent),
        ("/recordings/0/rmse_V", c.rmse_pa),
        ("/recordings/0/max_error_V", c.max_error_pa),
        ("/recordings/0/nrmse_percent", c.nrmse_percent),
        ("/recordings/0/chains/0/rmse_V", c.rmse_pa),
        ("/parameters/J/value", outcome.film.locking),
        ("/parameters/mu_1/value", outcome.film.mu_pa[0]),
        ("/plan/0/noise_pa", c.noise_pa),
    ] {
        let found = json.pointer(at).and_then(Value::as_f64).unwrap_or(f64::NAN);
        let near = (found - value).abs() <= 1e-12 * value.abs();
        assert!(near, "{at}: {found}, not {value}");
    }
    let recording = &json["recordings"][0];
    assert_eq!(recording["id"], "miles2015-vhb4910");
    assert_eq!(recording["mode"], "uniaxial");
    assert_eq!(recording["film_state"], "virgin");
    assert_eq!(recording["exceeds_noise"], true);
    assert!(
        recording["notes"][0]
            .as_str()
            .unwrap()
            .contains("2455.4 Pa")
    );
    assert_eq!(fit.plan, [PlanJson::Coupon(c.plan.clone())]);
    assert_eq!(fit.parameters.0.len(), 8);
    for (name, p) in &fit.parameters.0 {
        if let (Some(noise), Some(misfit)) = (p.std_error, p.misfit_std_error) {
            assert!(misfit >= noise, "{name}: {misfit} {noise}");
        }
    }
    // the places lie in the record, and their shares are shares
    assert_eq!(fit.worst.len(), 4);
    let shares: f64 = fit.worst.iter().filter_map(|w| w.share).sum();
    assert!((0.5..=1.1).contains(&shares), "{:?}", fit.worst);
    let known = |p: &str| p.contains("stretching from") || p.contains("releasing from");
    assert!(fit.worst.iter().all(|w| known(&w.place)), "{:?}", fit.worst);
}

#[test]
fn parameters_read_back_to_the_same_bits() {
    let mut request = CouponRequest::new(4);
    request.fix.push(("mu_5".into(), 0.0));
    request.fix.push(("T_1".into(), 0.3));
    for request in [CouponRequest::new(0), CouponRequest::new(3), request] {
        let (outcome, provenance) = fitted(&request);
        let written = ParameterFile::of_coupons(&outcome, provenance);
        let text = written.to_toml().unwrap();
        let read = ParameterFile::parse(Path::new("parameters.toml"), &text).unwrap();
        assert!(read.eps_r().is_none() && read.forearm.is_none() && read.effects.is_empty());
        assert_eq!(read.provenance, written.provenance);
        let film = read.film.as_ref().unwrap();
        let quantities = film.mu_pa.iter().chain(&film.relaxation_time_s);
        let quantities: Vec<_> = quantities.chain([&film.locking]).collect();
        let values = outcome.film.mu_pa.iter().copied();
        let values = values.chain(outcome.film.relaxation_time_s.iter().copied());
        let values: Vec<f64> = values.chain([outcome.film.locking]).collect();
        assert_eq!(quantities.len(), values.len());
        let n = outcome.film.branches();
        let names = (0..=n).map(|i| format!("mu_{}", i + 1));
        let names = names.chain((1..=n).map(|i| format!("T_{i}")));
        for ((q, value), name) in quantities.iter().zip(values).zip(names.chain(["J".into()])) {
            let e = outcome.estimates.iter().find(|e| e.name == name).unwrap();
            let bits = |v: f64| if v.is_nan() { u64::MAX } else { v.to_bits() };
            assert_eq!(q.value.to_bits(), value.to_bits(), "{name}");
            assert_eq!(value.to_bits(), e.value.to_bits(), "{name}");
            let error = if e.fixed { f64::NAN } else { e.std_error };
            assert_eq!(bits(q.std_error), bits(error), "{name}");
        }
        // and it is the film of the next run
        assert_eq!(read.parameters().unwrap().film, outcome.film);
        check(
            "parameters",
            &deacal::report::json::to_text(&written.to_json()),
        );
    }
}

#[test]
fn the_report_of_a_real_film() {
    let (outcome, provenance) = fitted(&CouponRequest::new(3));
    let html = render_coupons(&outcome, &provenance);
    assert!(html.len() < 400_000, "{}", html.len());
    for words in [
        "Calibration of the film on coupons",
        "does not fit",
        "miles2015-vhb4910",
        "1264 rows, 11 rows masked",
        "with misfit",
        "slack",
    ] {
        assert!(html.contains(words), "{words}");
    }
    if let Some(folder) = std::env::var_os("DEACAL_WRITE_REPORT") {
        let path = Path::new(&folder).join("coupon.html");
        deacal::report::output::write_atomic(&path, deacal::report::output::Overwrite::Any, &html)
            .unwrap();
    }
}
