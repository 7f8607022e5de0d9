//! `simulate`: known parameters and a drive to a recording, as the instruments would have written it.

use std::path::PathBuf;

use super::{Failure, Talk, load};
use crate::jobs::simulate::{
    Course, DriveText, PayloadText, Simulated, Simulation, Stated, at_least_zero as not_below_zero,
    effect, number, positive as above_zero, simulate,
};
use crate::recording::{DAY, is_id};
use crate::report::json::SimulationJson;
use crate::report::output::OutputSet;
use crate::report::parameter_file::Effect;
use crate::simulate::DEFAULT_RATE_HZ;

/// What to simulate.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["voltage", "drive", "path"])))]
pub(super) struct Arguments {
    /// rig.toml of a robot or of a hanging film sample; a copy goes into the recording
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// Parameter file: the truth of the simulation, its [[effect]] tables included
    #[arg(long)]
    params: PathBuf,
    /// A cause that the plain model leaves out, at work beside those of the parameter file:
    /// ID:NAME=VALUE,NAME=VALUE with the names and units of [[effect]], in all actuators or in those after an
    /// `@`; may be given several times. series_resistance:resistance=1e7@2; marker_offset:offset=1e-3/0/0 (m;
    /// or offset_x=1e-3); link_length_error:link=q,relative_error=0.01;
    /// electrode_failure:fraction=0.2,time=4@1 (4 s into this recording, or into the one named by
    /// recording=ID). Electrical causes act in their order, from the amplifier to the film. A planned path or
    /// circle knows nothing of causes
    #[arg(
        long,
        value_name = "ID:NAME=VALUE[@ACTUATOR]",
        value_parser = effect
    )]
    effect: Vec<Effect>,
    /// Voltages to apply (CSV: time_s, phi1_kV, phi2_kV, phi3_kV, or phi1_V, ...; of a sample phi_kV or
    /// phi_V); the first row is time 0
    #[arg(long, value_name = "FILE")]
    voltage: Option<PathBuf>,
    /// Built-in drive, KIND:KEY=VALUE,KEY=VALUE; lists with `/`, one voltage for all actuators or three.
    /// sine:peak_V=5500,hz=0.333 (phase_deg=0/0/0);
    /// multisine:peak_V=4000,hz=0.1/0.3/0.7;
    /// staircase:peak_V=5000,steps=5,hold_s=4 (ramp_s=0.5, repeats=2);
    /// holds:levels_V=3000/4000/0,time_s=13/13/5 (ramp_s=3, scale=1/0/0);
    /// chirp:peak_V=4000,from_hz=0.1,to_hz=2;
    /// circle:radius_mm=5,height_mm=-50 (period_s=3, turns=5, move_s=3), through the inverse model
    #[arg(long, value_name = "DRIVE")]
    drive: Option<DriveText>,
    /// Planned path (CSV: time_s, x_mm, y_mm, z_mm): its voltages come from the inverse model; the plan is
    /// left as planned.csv
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// Length, s (default: 60 for sine, multisine and chirp, else as long as the drive lasts)
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,
    /// Samples a second of a built-in drive or planned path
    #[arg(long, value_name = "HZ", default_value_t = DEFAULT_RATE_HZ, value_parser = positive)]
    drive_rate: f64,
    /// Turns the sign of the voltages every so many seconds
    #[arg(long, value_name = "S", value_parser = positive)]
    flip_every: Option<f64>,
    /// The amplifier holds the last value between samples instead of a straight line
    #[arg(long)]
    hold_previous: bool,
    /// Payload, g; with steps: 0,7:5,50:0 (0 g at first, 5 g from 7 s on, 0 g from 50 s on)
    #[arg(long, value_name = "G", default_value = "0")]
    payload: PayloadText,
    /// Highest voltage that is allowed, V
    #[arg(long, value_name = "V", default_value_t = f64::INFINITY, value_parser = positive)]
    limit: f64,
    /// Standard deviation of the white noise of each marker coordinate, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = at_least_zero)]
    noise: f64,
    /// Standard deviation of noise with a correlation time, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = at_least_zero)]
    coloured_noise: f64,
    /// Its correlation time, s
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = positive)]
    noise_correlation: f64,
    /// Gap of the end effector's marker, START:LENGTH in s; may be given several times
    #[arg(long, value_name = "S:S", value_parser = parse_gap)]
    gap: Vec<(f64, f64)>,
    /// True offset of the clocks: voltage clock minus motion clock, s
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true, value_parser = number)]
    clock_offset: f64,
    /// The offset that recording.toml states, s, or `estimate` (default: the true one)
    #[arg(long, value_name = "S|estimate", allow_negative_numbers = true, value_parser = parse_stated)]
    stated_offset: Option<Stated>,
    /// Smallest step of the voltage log, V; 0 for none
    #[arg(long, value_name = "V", default_value_t = 0.1, value_parser = at_least_zero)]
    quantum: f64,
    /// Frames a second of the capture
    #[arg(long, value_name = "HZ", default_value_t = 100.0, value_parser = positive)]
    rate: f64,
    /// Seed of the noise; the same seed gives the same bytes
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Name of the recording [default: that of its folder]
    #[arg(long, value_parser = parse_id)]
    id: Option<String>,
    /// Electrode, as `deacal ageing` compares them
    #[arg(long, value_name = "NAME")]
    electrode: Option<String>,
    /// Batch, as `deacal ageing` compares them
    #[arg(long, value_name = "NAME")]
    batch: Option<String>,
    /// Day of the recording, as `deacal ageing` orders them
    #[arg(
        long,
        value_name = "N",
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(i64).range(DAY[0] as i64..=DAY[1] as i64)
    )]
    day: Option<i64>,
    /// Folder of the recording
    #[arg(short, long, default_value = "out/simulate")]
    output: PathBuf,
}

fn positive(text: &str) -> Result<f64, String> {
    above_zero(number(text)?)
}

fn at_least_zero(text: &str) -> Result<f64, String> {
    not_below_zero(number(text)?)
}

fn parse_gap(text: &str) -> Result<(f64, f64), String> {
    let (start, length) = text
        .split_once(':')
        .ok_or("expected START:LENGTH in seconds")?;
    Ok((at_least_zero(start)?, positive(length)?))
}

fn parse_stated(text: &str) -> Result<Stated, String> {
    match text {
        "estimate" => Ok(Stated::Estimate),
        other => number(other).map(Stated::Seconds),
    }
}

fn parse_id(text: &str) -> Result<String, String> {
    if is_id(text) {
        return Ok(text.to_owned());
    }
    Err("expected a name that can be a file's, such as sym-01 or ageing/day-03".into())
}

impl Arguments {
    /// Name of the recording.
    fn name(&self) -> String {
        let folder = self.output.file_name().and_then(|n| n.to_str());
        let of_folder = || {
            folder
                .filter(|f| is_id(f))
                .unwrap_or("simulated")
                .to_owned()
        };
        self.id.clone().unwrap_or_else(of_folder)
    }

    /// What is asked for.
    fn simulation(&self) -> Result<Simulation, Failure> {
        let course = match (&self.path, &self.voltage, &self.drive) {
            (Some(path), ..) => Course::PathFile(path.clone()),
            (_, Some(voltage), _) => Course::VoltageFile(voltage.clone()),
            (.., Some(drive)) => Course::BuiltIn(drive.clone()),
            _ => return Err("no drive was given".into()),
        };
        let name = self.params.display().to_string();
        let truth = load::parameters(&self.params)?;
        Ok(Simulation {
            effects: self.effect.clone(),
            duration_s: self.duration,
            drive_rate_hz: self.drive_rate,
            flip_every_s: self.flip_every,
            hold_previous: self.hold_previous,
            payload: self.payload.clone(),
            limit_v: self.limit,
            noise_mm: self.noise,
            coloured_noise_mm: self.coloured_noise,
            noise_correlation_s: self.noise_correlation,
            gaps_s: self.gap.clone(),
            clock_offset_s: self.clock_offset,
            stated_offset: self.stated_offset,
            quantum_v: self.quantum,
            rate_hz: self.rate,
            seed: self.seed,
            id: self.name(),
            electrode: self.electrode.clone(),
            batch: self.batch.clone(),
            day: self.day,
            ..Simulation::new(self.rig.clone(), truth, name, course)
        })
    }
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let names = ["recording.toml", "motion.csv", "voltage.csv"];
    OutputSet::check(&a.output, &names, talk.overwrite())?;
    let made = simulate(a.simulation()?)?;
    let mut set = OutputSet::new(&a.output, talk.overwrite())?;
    let result = made.write(&mut set)?;
    set.commit()?;
    say(&made, &result, talk);
    Ok(())
}

/// Says what was simulated and written.
fn say(made: &Simulated, result: &SimulationJson, talk: Talk) {
    talk.result(result);
    talk.headline(&format!(
        "{}: {} frames, {:.2} s; stroke {:.2} mm, at most {:.0} V",
        result.id, result.n_frames, result.duration_s, result.stroke_mm, result.largest_voltage_v
    ));
    for acted in &made.effects {
        talk.say(&format!("  with {}", acted.line()));
    }
    for remark in &made.remarks {
        talk.say(&format!("  ! {remark}"));
    }
    if let Some(off_plan_mm) = result.off_plan_mm {
        talk.say(&format!("  at most {off_plan_mm:.4} mm off the plan"));
    }
    if let Some(speed) = made.begins_moving_m_s() {
        talk.say(&format!(
            "  ! the path begins with {:.1} mm/s, the robot at rest: let the path begin at rest",
            speed * 1e3
        ));
    }
    talk.say(&format!("Written to {}", result.folder));
}
