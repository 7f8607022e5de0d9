//! `causes`: the catalogue of what a model may leave out.

use serde::Serialize;

use super::{Failure, Talk};
use crate::effects::line::{self, Kind};
use crate::effects::{CATALOGUE, Effect, Quantity, Reach, Site, plain_name};
use crate::recording::suggestion;
use crate::report::html::number;
use crate::report::terminal;

/// Which causes.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Causes to tell all about, by id (default: all of them, a line each)
    #[arg(value_name = "ID")]
    ids: Vec<String>,
}

/// A cause as `--json` gives it.
#[derive(Serialize)]
struct CauseJson {
    id: &'static str,
    /// `robot`, or the kinds of single coordinates.
    of: Vec<&'static str>,
    says: &'static str,
    acts_on: &'static str,
    equation: &'static str,
    /// Ids of causes, and what else it is easily taken for.
    taken_for: &'static [&'static str],
    parameters: Vec<QuantityJson>,
    brought_out_by: &'static str,
    source: &'static str,
}

#[derive(Serialize)]
struct QuantityJson {
    name: &'static str,
    unit: &'static str,
    off: f64,
    lower: f64,
    upper: f64,
    typical: Option<f64>,
}

/// A cause and what it is a cause of.
type Listed = (&'static dyn Effect, Vec<&'static str>);

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let all = all();
    let mut wanted: Vec<&Listed> = Vec::new();
    for id in &a.ids {
        let found: Vec<&Listed> = all.iter().filter(|c| c.0.id() == id).collect();
        if found.is_empty() {
            let ids: Vec<&str> = all.iter().map(|c| c.0.id()).collect();
            return Err(format!("no cause is called `{id}`; {}", suggestion(id, &ids)).into());
        }
        wanted.extend(found);
    }
    if wanted.is_empty() {
        wanted.extend(&all);
    }
    talk.result(&wanted.iter().map(|c| json(c)).collect::<Vec<_>>());
    if !a.ids.is_empty() {
        wanted.iter().for_each(|c| tell(c, talk));
        return Ok(());
    }
    talk.answer(&format!(
        "{} causes that a model may leave out; `deacal causes ID` tells all about one",
        all.len()
    ));
    for (heading, robot) in [
        ("Of a robot:", true),
        ("Of a bench, an axis or a coupon:", false),
    ] {
        talk.say(heading);
        let here = all.iter().filter(|c| (c.1 == ["robot"]) == robot);
        let row = |c: &Listed| [c.0.id().to_owned(), number::words(c.0.says())];
        let rows: Vec<[String; 2]> = here.map(row).collect();
        terminal::columns(&rows).iter().for_each(|l| talk.say(l));
    }
    Ok(())
}

/// Causes of a robot, then those of single coordinates.
fn all() -> Vec<Listed> {
    let robot = CATALOGUE.iter().map(|e| (*e, vec!["robot"]));
    let kind = |k: &Kind| match k {
        Kind::Axis => "axis",
        Kind::Bench => "hinge bench",
        Kind::Coupon => "film coupon",
    };
    let lines = line::CATALOGUE.iter().map(|e| {
        let of = e.kinds().iter().map(kind).collect();
        (*e as &dyn Effect, of)
    });
    robot.chain(lines).collect()
}

fn acts_on((effect, of): &Listed) -> &'static str {
    if *of != ["robot"] {
        return "the single coordinate";
    }
    match effect.site() {
        Site::Balance => "the balance of torques",
        Site::Electrical => "the voltage, between command and film",
        Site::Clock => "the clock on which the command is read",
        Site::Film => "the film's stress or capacitance",
        Site::Motion => "the mechanism, or its measured motion",
    }
}

fn json(c: &Listed) -> CauseJson {
    let quantity = |q: &Quantity| QuantityJson {
        name: q.name,
        unit: q.unit,
        off: q.off,
        lower: q.lower,
        upper: q.upper,
        typical: typical(q),
    };
    CauseJson {
        id: c.0.id(),
        of: c.1.clone(),
        says: c.0.says(),
        acts_on: acts_on(c),
        equation: c.0.equation(),
        taken_for: c.0.taken_for(),
        parameters: c.0.parameters().iter().map(quantity).collect(),
        brought_out_by: c.0.brought_out_by(),
        source: c.0.source(),
    }
}

/// The symbols of the equations.
const SYMBOLS: [&str; 2] = [
    "phi_c command, phi on the film, C capacitance, E field; theta_b bicep, theta_DEA lozenge; u position, u_m measured; ' a rate",
    "x excursion from rest, v its rate, f force that the model asks for, u input, u_c its command, each over its largest",
];

/// What is met in practice; nothing can be said of a limit that is out of reach where it does nothing.
fn typical(q: &Quantity) -> Option<f64> {
    let at = match q.size {
        true => q.off + q.spread,
        false => q.off,
    };
    at.is_finite().then_some(at)
}

fn tell(c: &Listed, talk: Talk) {
    let (effect, of) = c;
    let id = effect.id();
    talk.answer(&format!("{}: {}.", plain_name(id), effect.says()));
    talk.say(&format!("  id: {id}"));
    talk.say(&format!("  equation: {}", effect.equation()));
    talk.say(&format!("    ({})", SYMBOLS[usize::from(*of != ["robot"])]));
    let row = |q: &Quantity| {
        let size = |v: f64| number::sized(v, q.unit, 2);
        let what = match q.size {
            true if q.off.is_finite() => format!("nothing at {}", size(q.off)),
            true => "nothing where it is out of reach".into(),
            false => "shapes it".into(),
        };
        let usual = typical(q).map_or_else(String::new, |at| format!("typically {}", size(at)));
        let range = format!("{} to {}", size(q.lower), size(q.upper));
        let name = q.name.replace('_', " ");
        [name, usual, range, what]
    };
    let rows: Vec<[String; 4]> = effect.parameters().iter().map(row).collect();
    terminal::columns(&rows).iter().for_each(|l| talk.say(l));
    let words = effect.variants().join(", ");
    let place = match (of.as_slice(), effect.reach()) {
        (["robot"], Reach::AllOrOne) => "one actuator, or all",
        (["robot"], Reach::All) => "all actuators",
        (["robot"], Reach::One) => "one actuator",
        _ => "",
    };
    let kinds: Vec<String> = of.iter().map(|k| (*k).to_owned()).collect();
    let others = effect.taken_for().iter().copied().map(plain_name);
    let others = number::list(&others.collect::<Vec<String>>());
    let lines = [
        ("forms", words.as_str()),
        ("of", &number::list(&kinds)),
        ("acts on", acts_on(c)),
        ("sits in", place),
        ("easily taken for", &others),
        ("brought out by", effect.brought_out_by()),
        ("source", effect.source()),
    ];
    for (what, says) in lines.iter().filter(|l| !l.1.is_empty()) {
        talk.say(&format!("  {what}: {}", number::words(says)));
    }
}
