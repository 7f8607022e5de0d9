use deacal::{dataset::Dataset, effects::When, model::Robot, recording::{Recording, Rig}};
fn load(dir: &std::path::Path) -> Vec<(Recording, Dataset)> {
    let mut names: Vec<_> = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    names.iter().map(|p| { let r = Recording::open(p).unwrap(); let d = Dataset::from_recording(&r, None).unwrap(); (r, d) }).collect()
}
fn main() {
    for case in std::env::args().skip(1) {
        let base = std::path::PathBuf::from(&case);
        let t = std::time::Instant::now();
        let (a, b) = (load(&base.join("train")), load(&base.join("holdout")));
        println!("== {case} load {:?}", t.elapsed());
        let Some(Rig::Robot(rig)) = &a[0].0.rig else { panic!() };
        let robot = Robot::from_rig(rig, None).unwrap();
        let when = |i: usize, d: &Dataset| When { recording: i, series_s: 145.0 * i as f64, start_s: d.start_s };
        let ta: Vec<&Dataset> = a.iter().map(|x| &x.1).collect();
        let tb: Vec<&Dataset> = b.iter().map(|x| &x.1).collect();
        let wa = a.iter().enumerate().map(|(i, x)| when(i, &x.1)).collect();
        let wb = b.iter().enumerate().map(|(i, x)| when(i + a.len(), &x.1)).collect();
        deacal::diagnosis::experiment(&robot, &ta, &tb, wa, wb);
    }
}
