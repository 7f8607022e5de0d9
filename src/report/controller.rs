//! f_ID and F_FP as one self-contained file for a controller: C99, MATLAB (and Octave), Python.
//!
//! One evaluator a language (`controller.c`, `controller.m`, `controller.py` beside this file) takes a motion
//! sample by sample, as the model and the film's production kernel do; here the robot, the parameters and the
//! causes are written into it as constants. What changes lengths is worked out before.

use std::fmt::Write;

use super::export::{Format, head};
use super::parameter_file::ParameterFile;
use crate::effects::learnt::{Form, Learnt, Variable};
use crate::effects::{Acting, Effect, Memory, Site};
use crate::kinematics::Chain;
use crate::model::Robot;
use crate::recording::Error;
use crate::units::VACUUM_PERMITTIVITY_F_M;

const C: &str = include_str!("controller/controller.c");
const MATLAB: &str = include_str!("controller/controller.m");
const PYTHON: &str = include_str!("controller/controller.py");

/// Stands for a bound that is not there: no voltage and no angle comes near it, and every language can write
/// it.
const NO_BOUND: f64 = 1e300;

/// Why there is no such file.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// JSON has no functions.
    #[error("JSON holds data, no functions: with --controller take --format m, py or c")]
    Json,
    /// A cause that cannot be worked out sample by sample.
    #[error(
        "`{id}` cannot be in a controller: {why}; take its [[effect]] block out, or predict with `deacal predict`"
    )]
    Cause {
        /// Its id.
        id: &'static str,
        /// Why.
        why: &'static str,
    },
    /// The name is none for a MATLAB function.
    #[error(
        "`{0}` is no name for a MATLAB function: begin it with a letter, go on with letters, digits and _"
    )]
    Name(String),
    /// The parameter file.
    #[error(transparent)]
    File(#[from] Error),
}

/// A controller's file, and what its user should know.
#[derive(Debug, Clone, PartialEq)]
pub struct Controller {
    /// The text of the file.
    pub text: String,
    /// Sentences.
    pub remarks: Vec<String>,
}

/// A constant of the model: its name and one number or several.
type Constant = (&'static str, Vec<f64>);

/// A cause as the evaluators know it.
struct Cause {
    id: &'static str,
    on: [bool; 3],
    /// Numbers that are remembered, of one actuator.
    places: usize,
    numbers: Vec<f64>,
    learnt: Option<Term>,
}

/// What a learnt cause has beside that.
struct Term {
    electrical: bool,
    at: &'static str,
    form: &'static str,
    of: Option<Variable>,
    by: Option<Variable>,
    coefficients: Vec<f64>,
    /// Knots, widths, times or centres.
    x: Vec<f64>,
    /// Second derivatives of the curve.
    bend: Vec<f64>,
}

/// A controller of `robot` with the parameters and the causes of `file`. `name` is that of the MATLAB
/// function: the file's without its ending.
///
/// # Errors
/// [`Refused`]: the format has no functions, or a cause needs more than what has been sampled so far.
pub fn controller(
    file: &ParameterFile,
    robot: &Robot,
    format: Format,
    name: &str,
) -> Result<Controller, Refused> {
    if format == Format::Json {
        return Err(Refused::Json);
    }
    let letters = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let is_name = name.starts_with(|c: char| c.is_ascii_alphabetic()) && name.chars().all(letters);
    if format == Format::Matlab && !is_name {
        return Err(Refused::Name(name.to_owned()));
    }
    let (robot, causes, recording, remarks) = causes(file, robot)?;
    let parameters = file.parameters()?;
    let forearm = &parameters.forearm;
    let constants: Vec<Constant> = vec![
        ("mu_Pa", parameters.film.mu_pa.clone()),
        ("T_s", parameters.film.relaxation_time_s.clone()),
        ("J", vec![parameters.film.locking]),
        ("eps_F_m", vec![robot.eps_r * VACUUM_PERMITTIVITY_F_M]),
        ("effector_kg", vec![robot.effector_kg]),
        ("bicep_tip_kg", vec![robot.bicep_tip_kg]),
        ("nodes_rad", forearm.nodes_rad().to_vec()),
        ("torque_N_m", forearm.torque_n_m().to_vec()),
        ("torque_bend", forearm.bends().to_vec()),
        ("recording", vec![recording]),
    ];
    let chains: Vec<Vec<Constant>> = (0..3).map(|k| chain(&robot, k)).collect();
    let mut comments = vec![
        "f_ID (motion to voltages) and F_FP (motion and voltages to force), sample by sample."
            .into(),
        "Do not edit: export again.".to_owned(),
    ];
    comments.extend(head(file));
    for (number, entry) in numbered(file) {
        comments.push(format!(
            "recording {number} of the series: {}, at {} s",
            entry.0, entry.1
        ));
    }
    comments.extend(remarks.iter().cloned());
    let text = match format {
        Format::C => c(&comments, &constants, &chains, &causes),
        Format::Python => python(&comments, &constants, &chains, &causes),
        _ => matlab(&comments, &constants, &chains, &causes, name),
    };
    Ok(Controller { text, remarks })
}

/// Recordings of the series by their numbers, as causes see them: id and beginning, s.
fn numbered(file: &ParameterFile) -> Vec<(usize, (String, f64))> {
    let entry = |e: &super::parameter_file::SeriesEntry| (e.number + 1, (e.id.clone(), e.begins_s));
    file.series.iter().map(entry).collect()
}

/// The robot with what changes its lengths, the other causes, and the number of a run after the series.
fn causes(
    file: &ParameterFile,
    robot: &Robot,
) -> Result<(Robot, Vec<Cause>, f64, Vec<String>), Refused> {
    let last = file.series.iter().map(|e| e.number + 1).max().unwrap_or(0);
    let run = (last + 1) as f64;
    // A moment of a recording that the series does not have lies before everything.
    let number_of = |id: &str| {
        let entry = file.series.iter().find(|e| e.id == id);
        Some(entry.map_or(0, |e| e.number + 1))
    };
    let mut robot = robot.clone();
    let (mut out, mut remarks) = (Vec::new(), Vec::new());
    for (mut acting, entry) in file.acting(&number_of)?.into_iter().zip(&file.effects) {
        let id = acting.effect.id();
        let quantities = acting.effect.parameters().iter();
        for (value, q) in acting.values.iter_mut().zip(quantities) {
            if q.name == "recording" {
                if entry.moment_here() {
                    *value = run;
                }
                remarks.push(format!(
                    "{id} has a moment, in recording {value}: a run has the number {run} unless it is told another."
                ));
            }
        }
        let refused = |why| Err(Refused::Cause { id, why });
        if acting.effect.looks_ahead() {
            return refused(
                "what the capture has smoothed away is found from samples to come, so its poses have to be freed of the lag before they are fed",
            );
        }
        if acting.effect.needs_tension() {
            return refused(
                "the voltage that a slack film needs depends on the voltage itself, and a prediction takes it from a recording",
            );
        }
        match acting.effect.site() {
            Site::Clock => remarks.push(format!(
                "{id} is of the recordings' clocks: a controller is fed the command of the sample's own instant."
            )),
            Site::Motion if !acting.is_of_capture() => acting.effect.geometry(
                &acting.values,
                acting.on,
                &mut robot.mechanism,
                &mut robot.lozenges,
            ),
            _ => out.push(cause(&acting)),
        }
        if acting.is_of_capture() {
            remarks.push(format!(
                "{id} is of the capture: feed poses as it measures them; for planned poses take its block out."
            ));
        }
    }
    Ok((robot, out, run, remarks))
}

fn cause(acting: &Acting) -> Cause {
    let bounded = |v: &f64| v.clamp(-NO_BOUND, NO_BOUND);
    let mut numbers: Vec<f64> = acting.values.iter().map(bounded).collect();
    let learnt = acting.effect.learnt();
    let places = match acting.effect.memory() {
        Memory::Learnt(term) => places(term),
        Memory::Charge | Memory::Polarisation | Memory::Flow => 4,
        Memory::HeldOff | Memory::Branch | Memory::Presliding | Memory::Play => 2,
        Memory::Output | Memory::LargestEnergy => 1,
        // of a slack film there is no controller, and rates are given
        Memory::Rest | Memory::BicepRate | Memory::Velocity | Memory::None => 0,
    };
    let term = learnt.map(|term| {
        let (of, by) = match &term.form {
            Form::Spline { of, by, .. } | Form::Lag { of, by, .. } => (Some(*of), *by),
            Form::Presliding { of, .. } => (Some(*of), None),
            Form::Wave { by, .. } => (None, *by),
            _ => (None, None),
        };
        let coefficients = std::mem::take(&mut numbers);
        let (own, x) = match &term.form {
            Form::Spline { knots, .. } => (vec![], knots.clone()),
            Form::Ridge { along, knots } => (along.to_vec(), knots.clone()),
            Form::Presliding { ranges, .. } => (vec![], ranges.clone()),
            Form::Lag { times_s, .. } => (vec![], times_s.clone()),
            Form::Wave { frequency_hz, .. } => (vec![*frequency_hz], vec![]),
            Form::Potential { centres_m, width_m } => (vec![*width_m], centres_m.concat()),
            Form::Affine { about_m } => (about_m.to_vec(), vec![]),
            Form::Oscillator {
                frequency_hz,
                damping,
            } => (vec![*frequency_hz, *damping], vec![]),
            Form::Neighbours | Form::Drag => (vec![], vec![]),
        };
        numbers = own;
        Term {
            electrical: term.site() == Site::Electrical,
            at: match term.place.name() {
                "series" => "bicep",
                other => other,
            },
            form: term.form.name(),
            of,
            by,
            bend: term.bends(&coefficients),
            coefficients,
            x,
        }
    });
    Cause {
        id: acting.effect.id(),
        on: acting.on,
        places,
        numbers,
        learnt: term,
    }
}

/// Numbers that a learnt term remembers: two of each variable, and those of its form.
fn places(term: &Learnt) -> usize {
    if !term.form.remembers() {
        return 0;
    }
    let count = term.form.count();
    match term.form {
        Form::Presliding { .. } => 5 + count,
        Form::Lag { .. } => 4 + 2 * count,
        Form::Oscillator { .. } => 17,
        _ => 4,
    }
}

fn chain(robot: &Robot, k: usize) -> Vec<Constant> {
    let (c, l) = (&robot.mechanism.chains[k], &robot.lozenges[k]);
    let Chain { four_bar: bar, .. } = c;
    let turned = |angle: f64| vec![angle.sin(), angle.cos()];
    vec![
        ("radial", vec![c.azimuth_rad.cos(), c.azimuth_rad.sin()]),
        ("base_radius", vec![c.base_radius_m]),
        ("effector_radius", vec![c.effector_radius_m]),
        ("bicep", vec![c.bicep_m]),
        ("forearm", vec![c.forearm_m]),
        ("input", turned(c.input_offset_rad)),
        ("dea", turned(c.dea_offset_rad)),
        ("bar", vec![bar.a_m, bar.b_m, bar.c_m, bar.d_m]),
        ("side", vec![l.side_m]),
        ("l1", vec![l.l1_m]),
        ("l2", vec![l.l2_m]),
        ("l3", vec![l.l3_m]),
        ("films", vec![l.films]),
    ]
}

/// Numbers with commas between.
fn commas(values: &[f64]) -> String {
    let each: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
    each.join(", ")
}

/// Words or numbers in a list that is broken where a line grows long.
fn broken(values: &[f64], indent: &str, go_on: &str) -> String {
    let rows: Vec<String> = values.chunks(5).map(commas).collect();
    rows.join(&format!(",{go_on}\n{indent}"))
}

/// A name of the C enumerations.
fn upper(word: &str) -> String {
    format!("DEACAL_{}", word.to_uppercase().replace(' ', "_"))
}

fn variable(v: Option<Variable>) -> &'static str {
    v.map_or("none", Variable::name)
}

fn c(
    comments: &[String],
    constants: &[Constant],
    chains: &[Vec<Constant>],
    causes: &[Cause],
) -> String {
    let mut out = String::new();
    for line in comments {
        let _ = writeln!(out, "/* {} */", line.replace("*/", "* /"));
    }
    let one = |name: &str| constants.iter().find(|(n, _)| *n == name).map(|(_, v)| v);
    let count = |name: &str| one(name).map_or(0, Vec::len);
    let all: usize = causes.iter().map(|c| 3 * c.places).sum();
    let largest = causes.iter().map(|c| c.places).max().unwrap_or(0).max(1);
    let _ = writeln!(
        out,
        "\n/* A header; where DEACAL_IMPLEMENTATION is defined before it is included, in one source, the functions too. */
#ifndef DEACAL_CONTROLLER_H
#define DEACAL_CONTROLLER_H

#define DEACAL_BRANCHES {}
#define DEACAL_NODES {}
#define DEACAL_EFFECTS {}
#define DEACAL_MEMORY {}
#define DEACAL_LARGEST {largest}
#define DEACAL_RECORDING {:?}
",
        count("T_s"),
        count("nodes_rad"),
        causes.len(),
        all.max(1),
        one("recording").map_or(0.0, |v| v[0]),
    );
    let mut data = String::new();
    let names = [
        ("mu_Pa", "deacal_mu_pa"),
        ("T_s", "deacal_relaxation_s"),
        ("nodes_rad", "deacal_nodes_rad"),
        ("torque_N_m", "deacal_torque_n_m"),
        ("torque_bend", "deacal_torque_bend"),
    ];
    for (key, name) in names {
        c_array(&mut data, name, one(key).map_or(&[][..], Vec::as_slice));
    }
    let names = [
        ("J", "deacal_locking"),
        ("eps_F_m", "deacal_eps_f_m"),
        ("effector_kg", "deacal_effector_kg"),
        ("bicep_tip_kg", "deacal_bicep_tip_kg"),
    ];
    for (key, name) in names {
        let value = one(key).map_or(0.0, |v| v[0]);
        let _ = writeln!(data, "static const double {name} = {value:?};");
    }
    c_chains(&mut data, chains);
    c_effects(&mut data, causes);
    out.push_str(&C.replace("@DATA@\n", &data));
    out
}

/// An array, which has at least one number in C.
fn c_array(data: &mut String, name: &str, values: &[f64]) {
    let values = if values.is_empty() { &[0.0] } else { values };
    let _ = writeln!(
        data,
        "static const double {name}[{}] = {{\n    {}\n}};",
        values.len(),
        broken(values, "    ", "")
    );
}

/// The lengths and angles of the three chains.
fn c_chains(data: &mut String, chains: &[Vec<Constant>]) {
    data.push_str("static const deacal_chain deacal_chains[3] = {\n");
    for chain in chains {
        let fields: Vec<String> = chain
            .iter()
            .map(|(_, v)| match v.len() {
                1 => commas(v),
                _ => format!("{{{}}}", commas(v)),
            })
            .collect();
        let _ = writeln!(data, "    {{{}}},", fields.join(",\n     "));
    }
    data.push_str("};\n");
}

/// The causes, after the arrays of what was learnt.
fn c_effects(data: &mut String, causes: &[Cause]) {
    for (i, cause) in causes.iter().enumerate() {
        if let Some(t) = &cause.learnt {
            c_array(data, &format!("deacal_c_{i}"), &t.coefficients);
            c_array(data, &format!("deacal_x_{i}"), &t.x);
            c_array(data, &format!("deacal_bend_{i}"), &t.bend);
        }
    }
    let _ = writeln!(
        data,
        "static const deacal_effect deacal_effects[{}] = {{",
        causes.len().max(1)
    );
    let mut memory = 0;
    for (i, cause) in causes.iter().enumerate() {
        let on: Vec<String> = (cause.on.iter())
            .map(|on| i32::from(*on).to_string())
            .collect();
        let mut numbers = cause.numbers.clone();
        numbers.resize(4, 0.0);
        let term = match &cause.learnt {
            Some(t) => format!(
                "{}, {}, {}, {},\n     {}, {}, deacal_c_{i}, deacal_x_{i}, deacal_bend_{i}",
                i32::from(t.electrical),
                upper(&format!("at {}", t.at)),
                upper(t.form),
                upper(c_variable(t.of)),
                upper(c_variable(t.by)),
                t.coefficients.len()
            ),
            None => "0, 0, 0, 0, 0, 0, NULL, NULL, NULL".to_owned(),
        };
        let _ = writeln!(
            data,
            "    {{{}, {{{}}}, {memory}, {}, {{{}}},\n     {term}}},",
            upper(cause.id),
            on.join(", "),
            cause.places,
            commas(&numbers),
        );
        memory += 3 * cause.places;
    }
    if causes.is_empty() {
        data.push_str("    {DEACAL_LEARNT, {0, 0, 0}, 0, 0, {0.0, 0.0, 0.0, 0.0}, 0, 0, 0, 0, 0, 0, NULL, NULL, NULL}\n");
    }
    data.push_str("};\n");
}

/// A variable's name in C.
fn c_variable(v: Option<Variable>) -> &'static str {
    match v {
        Some(Variable::LargestStretch) => "largest stretch",
        Some(Variable::SeriesTime) => "series time",
        other => variable(other),
    }
}

fn python(
    comments: &[String],
    constants: &[Constant],
    chains: &[Vec<Constant>],
    causes: &[Cause],
) -> String {
    let mut out = String::new();
    for line in comments {
        let _ = writeln!(out, "# {line}");
    }
    out.push('\n');
    let value = |name: &str, v: &[f64]| {
        let list = matches!(
            name,
            "mu_Pa" | "T_s" | "nodes_rad" | "torque_N_m" | "torque_bend"
        );
        match v {
            [one] if !list => format!("{one:?}"),
            v if v.len() <= 4 => format!("[{}]", commas(v)),
            v => format!("[\n        {},\n    ]", broken(v, "        ", "")),
        }
    };
    let mut data = String::from("MODEL = {\n");
    for (name, v) in constants {
        let _ = writeln!(data, "    \"{name}\": {},", value(name, v));
    }
    data.push_str("}\n\nCHAINS = [\n");
    for chain in chains {
        data.push_str("    {\n");
        for (name, v) in chain {
            let _ = writeln!(data, "        \"{name}\": {},", value(name, v));
        }
        data.push_str("    },\n");
    }
    data.push_str("]\n\nEFFECTS = [\n");
    let truth = |v: bool| if v { "True" } else { "False" };
    for cause in causes {
        let _ = writeln!(data, "    {{\n        \"kind\": \"{}\",", cause.id);
        let on = cause.on.map(truth).join(", ");
        let _ = writeln!(data, "        \"on\": [{on}],");
        let _ = writeln!(data, "        \"remembers\": {},", truth(cause.places > 0));
        let _ = writeln!(data, "        \"p\": [{}],", commas(&cause.numbers));
        if let Some(t) = &cause.learnt {
            let _ = writeln!(data, "        \"electrical\": {},", truth(t.electrical));
            let words = [
                ("at", t.at),
                ("form", t.form),
                ("of", variable(t.of)),
                ("by", variable(t.by)),
            ];
            for (key, word) in words {
                let _ = writeln!(data, "        \"{key}\": \"{word}\",");
            }
            for (key, v) in [("c", &t.coefficients), ("x", &t.x), ("bend", &t.bend)] {
                let indent = "            ";
                let list = broken(v, indent, "");
                let _ = match v.is_empty() {
                    true => writeln!(data, "        \"{key}\": [],"),
                    false => writeln!(data, "        \"{key}\": [\n{indent}{list},\n        ],"),
                };
            }
        }
        data.push_str("    },\n");
    }
    data.push(']');
    out.push_str(&PYTHON.replace("@DATA@", &data));
    out
}

fn matlab(
    comments: &[String],
    constants: &[Constant],
    chains: &[Vec<Constant>],
    causes: &[Cause],
    name: &str,
) -> String {
    let list = |v: &[f64]| match v {
        [one] => format!("{one:?}"),
        v => format!("[{}]", broken(v, "      ", " ...")),
    };
    let mut data = String::from("function [m, chains, effects] = model()\n  m = struct();\n");
    for (key, v) in constants {
        let _ = writeln!(data, "  m.{key} = {};", list(v));
    }
    data.push_str("  chains = cell(1, 3);\n");
    for (k, chain) in chains.iter().enumerate() {
        for (key, v) in chain {
            let _ = writeln!(data, "  chains{{{}}}.{key} = {};", k + 1, list(v));
        }
    }
    let _ = writeln!(data, "  effects = cell(1, {});", causes.len());
    for (i, cause) in causes.iter().enumerate() {
        let mut put = |key: &str, text: String| {
            let _ = writeln!(data, "  effects{{{}}}.{key} = {text};", i + 1);
        };
        put("kind", format!("'{}'", cause.id));
        let on = cause.on.map(|on| on.to_string()).join(", ");
        put("on", format!("[{on}]"));
        put("remembers", (cause.places > 0).to_string());
        put("p", list(&cause.numbers));
        let t = cause.learnt.as_ref();
        put("electrical", t.is_some_and(|t| t.electrical).to_string());
        put("form", format!("'{}'", t.map_or("", |t| t.form)));
        if let Some(t) = t {
            put("at", format!("'{}'", t.at));
            put("of", format!("'{}'", variable(t.of)));
            put("by", format!("'{}'", variable(t.by)));
            put("c", list(&t.coefficients));
            put("x", list(&t.x));
            put("bend", list(&t.bend));
        }
    }
    data.push_str("end");
    let about: String = comments
        .iter()
        .fold(String::new(), |all, line| format!("{all}% {line}\n"));
    // what stands first in the file has to be the function
    MATLAB
        .replace("@DATA@", &format!("{about}{data}"))
        .replace("@NAME@", name)
}
