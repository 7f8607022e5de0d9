//! `rig.toml`: the geometry and the masses that the user knows, in the units of the file.

use std::path::Path;

use toml::de::DeValue;

use super::described::{self, names};
use super::error::Error;
use super::keys::{Document, Keys, RIG, Value as _};

/// A rig file.
#[derive(Debug, Clone, PartialEq)]
pub enum Rig {
    /// `kind = "robot"`.
    Robot(RobotRig),
    /// `kind = "film-sample"`.
    FilmSample(FilmSampleRig),
}

/// A delta robot moved by dielectric-elastomer actuators through stroke-amplifying four-bars.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotRig {
    /// Its name.
    pub id: String,
    /// `[delta]`.
    pub delta: Delta,
    /// `[sam]`.
    pub sam: Sam,
    /// `[actuator]`.
    pub actuator: Actuator,
    /// `[film]`.
    pub film: RobotFilm,
    /// `[mass]`.
    pub mass: RobotMass,
    /// Tolerances that the file states.
    pub tolerances: Vec<Stated>,
}

/// A tolerance that a rig file states: one standard deviation of what is built, in the unit of the key.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// The key that carries it, or a key of `[tolerance]`.
    pub key: &'static str,
    /// The key's value; 1 for a key of `[tolerance]`.
    pub value: f64,
    /// The tolerance.
    pub tolerance: f64,
}

/// `[delta]`: the parallel mechanism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delta {
    /// Centre of the base to each bicep pivot, mm.
    pub l_ch_mm: f64,
    /// Centre of the end effector to each forearm joint, mm.
    pub l_end_mm: f64,
    /// Bicep length, mm.
    pub q_mm: f64,
    /// Forearm length, mm.
    pub n0_mm: f64,
    /// Bicep to input link of the amplifier, degrees.
    pub omega_deg: f64,
    /// Mounting angle of the amplifier, degrees.
    pub alpha_deg: f64,
}

/// `[sam]`: the stroke-amplifying four-bar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sam {
    /// Ground link, mm.
    pub a_mm: f64,
    /// Link on the bicep, mm.
    pub b_mm: f64,
    /// Coupler, mm.
    pub c_mm: f64,
    /// Link on the lozenge, mm.
    pub d_mm: f64,
}

/// `[actuator]`: the lozenge that carries the film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuator {
    /// Side of the lozenge, mm.
    pub l_dea_mm: f64,
    /// theta_DEA = dea_offset - theta_SAM, degrees.
    pub dea_offset_deg: f64,
    /// Films in parallel on one lozenge.
    pub films: u32,
}

/// `[film]` of a robot: unstretched, electrodes included in the thickness.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(non_snake_case)]
pub struct RobotFilm {
    /// Length along direction 1, mm.
    pub L1_mm: f64,
    /// Length along direction 2, mm.
    pub L2_mm: f64,
    /// Thickness, mm.
    pub L3_mm: f64,
    /// Relative permittivity, if known; a parameter file's value wins over it.
    pub eps_r: Option<f64>,
}

/// `[mass]` of a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotMass {
    /// End effector with forearms and marker, g.
    pub m_g: f64,
    /// Point mass at each bicep tip, g.
    pub m_bc_g: f64,
}

/// A film sample that hangs and carries a weight.
#[derive(Debug, Clone, PartialEq)]
#[allow(non_snake_case)]
pub struct FilmSampleRig {
    /// Its name.
    pub id: String,
    /// Direction 2, sides free, mm.
    pub width_mm: f64,
    /// Direction 1, vertical, mm.
    pub length_mm: f64,
    /// Rim without electrode, all round, mm.
    pub margin_mm: f64,
    /// Films in parallel.
    pub films: u32,
    /// Thickness, mm.
    pub L3_mm: f64,
    /// Relative permittivity, if known; a parameter file's value wins over it.
    pub eps_r: Option<f64>,
    /// Mass on the free end, g.
    pub m_g: f64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum RigKind {
    Robot,
    FilmSample,
}

impl Rig {
    /// Reads a rig file.
    ///
    /// # Errors
    /// The file cannot be read; a key is unknown (the nearest is named), missing, of the wrong type or cannot
    /// be.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_document(&Document::read(path, &RIG)?)
    }

    /// Reads the text of a rig file; `path` is for messages.
    ///
    /// # Errors
    /// As [`Rig::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        Self::from_document(&Document::new(path, text.to_owned(), &RIG))
    }

    fn from_document(document: &Document) -> Result<Self, Error> {
        let root = document.parse()?;
        let rig = Keys::any(document, &root, &["rig"]).need_table(
            "rig",
            &const { names(&described::RIG) },
            "a rig file begins with [rig]",
        )?;
        let kinds = [
            ("robot", RigKind::Robot),
            ("film-sample", RigKind::FilmSample),
        ];
        let kind = rig
            .choice("kind", &kinds)?
            .ok_or_else(|| rig.missing("kind", "add `kind = \"robot\"` or \"film-sample\""))?;
        let id = rig.need("id")?;
        match kind {
            RigKind::Robot => {
                let known = &const { names(&described::ROBOT_TOML) };
                let top = Keys::top(document, &root, known)?;
                robot(&top, id).map(Rig::Robot)
            }
            RigKind::FilmSample => {
                let top = Keys::top(document, &root, &const { names(&described::SAMPLE_TOML) })?;
                film_sample(&top, id).map(Rig::FilmSample)
            }
        }
    }

    /// Its name.
    #[must_use]
    pub fn id(&self) -> &str {
        match self {
            Rig::Robot(rig) => &rig.id,
            Rig::FilmSample(rig) => &rig.id,
        }
    }
}

/// Films in parallel: 1 unless the file says otherwise.
fn films(keys: &Keys<'_>) -> Result<u32, Error> {
    match keys.get::<i64>("films")? {
        None => Ok(1),
        Some(n) => u32::try_from(n).ok().filter(|n| *n > 0).ok_or_else(|| {
            keys.bad("films", format!("found {n}"))
                .expected("a whole number above 0")
        }),
    }
}

/// Keys of `[tolerance]`: what has no key of its own.
const OTHER_TOLERANCES: &[&str] = &names(&described::TOLERANCE);

/// Reads `{ value = 30.0, tolerance = 0.05 }`, or a bare number.
fn with_tolerance(value: &DeValue<'_>) -> Option<(f64, Option<f64>)> {
    let Some(table) = value.as_table() else {
        return f64::from_toml(value).map(|v| (v, None));
    };
    let of = |name: &str| {
        let found = table.iter().find(|(k, _)| k.get_ref() == name)?;
        f64::from_toml(found.1.get_ref())
    };
    let tolerance = of("tolerance").filter(|t| *t >= 0.0)?;
    (table.len() == 2).then_some((of("value")?, Some(tolerance)))
}

impl Keys<'_> {
    /// A number that may carry its tolerance.
    fn within(&self, key: &'static str, tolerances: &mut Vec<Stated>) -> Result<f64, Error> {
        const EXPECTED: &str =
            "a finite number, or { value = ..., tolerance = ... } with a tolerance not below 0";
        let found = self.get_with(key, EXPECTED, with_tolerance)?;
        let (value, tolerance) =
            found.ok_or_else(|| self.missing(key, &format!("add `{key} = ...`")))?;
        tolerances.extend(tolerance.map(|tolerance| Stated {
            key,
            value,
            tolerance,
        }));
        Ok(value)
    }

    fn positive_within(&self, key: &'static str, out: &mut Vec<Stated>) -> Result<f64, Error> {
        let value = self.within(key, out)?;
        if value <= 0.0 {
            return Err(self
                .bad(key, format!("found {value}"))
                .expected("a number above 0")
                .action("give the measured value in the unit that the key names"));
        }
        Ok(value)
    }

    fn not_negative_within(&self, key: &'static str, out: &mut Vec<Stated>) -> Result<f64, Error> {
        let value = self.within(key, out)?;
        if value < 0.0 {
            return Err(self
                .bad(key, format!("found {value}"))
                .expected("a number not below 0"));
        }
        Ok(value)
    }
}

fn robot(top: &Keys<'_>, id: String) -> Result<RobotRig, Error> {
    const WHY: &str = "a robot's rig file has [delta], [sam], [actuator], [film] and [mass]";
    let mut tolerances = Vec::new();
    let t = top.need_table("delta", &const { names(&described::DELTA) }, WHY)?;
    let delta = Delta {
        l_ch_mm: t.positive_within("l_ch_mm", &mut tolerances)?,
        l_end_mm: t.positive_within("l_end_mm", &mut tolerances)?,
        q_mm: t.positive_within("q_mm", &mut tolerances)?,
        n0_mm: t.positive_within("n0_mm", &mut tolerances)?,
        omega_deg: t.within("omega_deg", &mut tolerances)?,
        alpha_deg: t.within("alpha_deg", &mut tolerances)?,
    };
    let t = top.need_table("sam", &const { names(&described::SAM) }, WHY)?;
    let sam = Sam {
        a_mm: t.positive_within("a_mm", &mut tolerances)?,
        b_mm: t.positive_within("b_mm", &mut tolerances)?,
        c_mm: t.positive_within("c_mm", &mut tolerances)?,
        d_mm: t.positive_within("d_mm", &mut tolerances)?,
    };
    let t = top.need_table("actuator", &const { names(&described::ACTUATOR) }, WHY)?;
    let actuator = Actuator {
        l_dea_mm: t.need_positive("l_dea_mm")?,
        dea_offset_deg: t.within("dea_offset_deg", &mut tolerances)?,
        films: films(&t)?,
    };
    let t = top.need_table("film", &const { names(&described::ROBOT_FILM) }, WHY)?;
    let film = RobotFilm {
        L1_mm: t.need_positive("L1_mm")?,
        L2_mm: t.need_positive("L2_mm")?,
        L3_mm: t.positive_within("L3_mm", &mut tolerances)?,
        eps_r: t.positive("eps_r")?,
    };
    let t = top.need_table("mass", &const { names(&described::ROBOT_MASS) }, WHY)?;
    let mass = RobotMass {
        m_g: t.not_negative_within("m_g", &mut tolerances)?,
        m_bc_g: t.need_not_negative("m_bc_g")?,
    };
    if let Some(t) = top.table("tolerance", OTHER_TOLERANCES)? {
        for key in OTHER_TOLERANCES {
            if t.has(key) {
                let tolerance = t.need_not_negative(key)?;
                tolerances.push(Stated {
                    key,
                    value: 1.0,
                    tolerance,
                });
            }
        }
    }
    Ok(RobotRig {
        id,
        delta,
        sam,
        actuator,
        film,
        mass,
        tolerances,
    })
}

fn film_sample(top: &Keys<'_>, id: String) -> Result<FilmSampleRig, Error> {
    const WHY: &str = "a film sample's rig file has [sample], [film] and [mass]";
    let t = top.need_table("sample", &const { names(&described::SAMPLE) }, WHY)?;
    let width_mm = t.need_positive("width_mm")?;
    let length_mm = t.need_positive("length_mm")?;
    let margin_mm = match t.has("margin_mm") {
        true => t.need_not_negative("margin_mm")?,
        false => 0.0,
    };
    if 2.0 * margin_mm >= width_mm.min(length_mm) {
        return Err(t
            .bad("margin_mm", format!("found {margin_mm}"))
            .expected(format!("less than half of {} mm", width_mm.min(length_mm)))
            .action("the margin on both sides leaves no electrode"));
    }
    let films = films(&t)?;
    let t = top.need_table("film", &const { names(&described::SAMPLE_FILM) }, WHY)?;
    let (thickness_mm, eps_r) = (t.need_positive("L3_mm")?, t.positive("eps_r")?);
    let t = top.need_table("mass", &const { names(&described::SAMPLE_MASS) }, WHY)?;
    Ok(FilmSampleRig {
        id,
        width_mm,
        length_mm,
        margin_mm,
        films,
        L3_mm: thickness_mm,
        eps_r,
        m_g: t.need_not_negative("m_g")?,
    })
}
