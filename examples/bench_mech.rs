use deacal::{dataset::Dataset, model::{Mechanics, Robot, ForearmTorque}, recording::{Recording, Rig}, residual::RobotResidual};
fn main() {
    let r = Recording::open("/work/shared/datasets/practice/practice-01/train/02-single".as_ref()).unwrap();
    let d = Dataset::from_recording(&r, None).unwrap();
    let Some(Rig::Robot(rig)) = &r.rig else { panic!() };
    let robot = Robot::from_rig(rig, None).unwrap();
    let track = d.track();
    let mut best = f64::MAX;
    for _ in 0..30 { let t = std::time::Instant::now(); let m = Mechanics::new(&robot, &track).unwrap(); best = best.min(t.elapsed().as_secs_f64()); std::hint::black_box(&m); }
    println!("mechanics {:.3} ms for {} samples: {:.0} ns", best*1e3, d.samples(), best*1e9/d.samples() as f64);
    let f = ForearmTorque::zero();
    let res = RobotResidual::new(&robot, &[&d], 6, &f).map_err(|_| ()).unwrap();
    use deacal::residual::SeparableResidual;
    let mut eta: Vec<f64> = [0.03f64,0.15,0.76,3.9,20.0,100.0].iter().map(|t| t.ln()).collect(); eta.push(0.0125);
    let beta = vec![1e5; 14];
    let mut best = f64::MAX;
    for _ in 0..30 { let t = std::time::Instant::now(); let m = res.evaluate(&eta, &beta).unwrap(); best = best.min(t.elapsed().as_secs_f64()); std::hint::black_box(&m); }
    println!("evaluate {:.3} ms", best*1e3);
    let mech = Mechanics::new(&robot, &track).unwrap();
    let p = res.parameters(&eta, &beta);
    let mut best = f64::MAX;
    for _ in 0..30 { let t = std::time::Instant::now(); for k in 0..3 { std::hint::black_box(mech.film_torque_n_m(k, &p).unwrap()); } best = best.min(t.elapsed().as_secs_f64()); }
    println!("film torque {:.3} ms", best*1e3);
    let mut best = f64::MAX;
    for _ in 0..30 { let t = std::time::Instant::now(); for k in 0..3 { std::hint::black_box(d.voltage.squared(k, 0.0, 0.01, d.samples())); } best = best.min(t.elapsed().as_secs_f64()); }
    println!("squared {:.3} ms", best*1e3);
}
