//! Concealed cases: the same seed gives the same bytes, every effect can be made at every strength, switched off it changes nothing,
//! and the files read back to what the case holds in memory.

use deacal::cases::{self, DriveSet, Kind, Spec};

fn spec(kind: Kind, seed: u64, strength: f64) -> Spec {
    Spec {
        kind,
        seed,
        strength,
        drive: DriveSet::Ordinary,
    }
}

/// Root mean square distance of two lists of positions, m.
fn apart(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let sum: f64 = a
        .iter()
        .zip(b)
        .map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>())
        .sum();
    (sum / a.len() as f64).sqrt()
}

fn all() -> Vec<Kind> {
    let known = cases::effects().map(Kind::Effect);
    known.chain(cases::unknowns().map(Kind::Unknown)).collect()
}

/// What an effect does to the motion, at three strengths and some seeds. For the eye.
#[test]
#[ignore = "prints a table for the eye"]
fn survey() {
    let only = std::env::var("DEACAL_SURVEY").unwrap_or_default();
    for kind in all() {
        let (Kind::Effect(id) | Kind::Unknown(id)) = kind else {
            continue;
        };
        if !id.contains(&only) {
            continue;
        }
        for seed in [11, 12] {
            let off = match cases::generate_off(&spec(kind, seed, 0.5)) {
                Ok(off) => off,
                Err(e) => {
                    println!("{id} off: {e}");
                    continue;
                }
            };
            for strength in [0.0, 0.5, 1.0] {
                let begin = std::time::Instant::now();
                match cases::generate(&spec(kind, seed, strength)) {
                    Ok(case) => {
                        let time = begin.elapsed().as_secs_f64();
                        let far: Vec<String> = case
                            .train
                            .iter()
                            .zip(&off.train)
                            .map(|(a, b)| format!("{:.3}", apart(&a.clean_m, &b.clean_m) * 1e3))
                            .collect();
                        let z = &case.truth.recordings[0].z_mm;
                        println!(
                            "{id:22} {seed} {strength:.1} {time:5.2} s {:?} z {:?} apart {} mm",
                            case.truth.detail[0].actuators,
                            z,
                            far.join(" ")
                        );
                    }
                    Err(e) => println!("{id} {seed} {strength}: {e}"),
                }
            }
        }
    }
}
