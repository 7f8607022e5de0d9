//! Numbers in the manifest and the rig that no laboratory has: a wrong unit, a slipped digit, two entries
//! exchanged.
//!
//! The limits are those of things, not of a data set: a robot that stands on a table and is moved by films, a
//! film between a wafer's coating and a mat, an elastomer's permittivity. Between "wrong" and what is met
//! there is a factor of three or more.

use super::view::{Is, View, short};
use super::{Findings, Grade};
use crate::recording::{CouponElongation, CouponLoad, NumberOrEstimate, Payload, Rig};
use crate::units::{GRAVITY_M_S2, VACUUM_PERMITTIVITY_F_M};

/// Lengths of links, mm; sides of a film, mm; its thickness, mm; a relative permittivity.
const LINK_MM: [f64; 2] = [0.5, 3000.0];
const SIDE_MM: [f64; 2] = [1.0, 2000.0];
const THICKNESS_MM: [f64; 2] = [0.5e-3, 5.0];
pub(super) const PERMITTIVITY: [f64; 2] = [1.0, 100.0];
/// Films in parallel in a lozenge, or hanging beside one another.
const FILMS: [f64; 2] = [1.0, 100.0];
/// Masses that move, g.
const MASS_G: [f64; 2] = [0.05, 5000.0];
/// Tension of a hanging film, nominal, Pa: below, it hangs slack or the mass is in kg; above, it tears.
const TENSION_PA: [f64; 2] = [500.0, 2e7];
/// Largest voltage, V, and largest field in unstretched film, V/m: silicone and acrylic break down at 0.1 to
/// 0.4 GV/m of stretched film.
const VOLTAGE_V: f64 = 6e4;
const FIELD_V_M: f64 = 1e9;
/// Weights that the largest drive of the films can hold, times over: a robot sags under more.
const CARRIED: f64 = 5.0;

struct Stated<'a> {
    found: &'a mut Findings,
}

impl Stated<'_> {
    fn wrong(&mut self, says: String, remedy: impl Into<String>) {
        self.found.add("stated_value", Grade::Wrong, says, remedy);
    }

    /// A number that has to lie within a range.
    fn within(&mut self, name: &str, value: f64, [low, high]: [f64; 2], unit: &str, what: &str) {
        if (low..=high).contains(&value) {
            return;
        }
        let times = if value < low { "below" } else { "above" };
        let hint = match value {
            v if (low..=high).contains(&(v * 1e3)) => " (a thousandth: the wrong unit?)",
            v if (low..=high).contains(&(v * 1e-3)) => " (a thousandfold: the wrong unit?)",
            _ => "",
        };
        self.wrong(
            format!(
                "{name} = {value} is {times} what {what} can be, {} to {} {unit}{hint}",
                short(low),
                short(high)
            ),
            format!("state {name} in {unit}"),
        );
    }
}

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    voltages(view, found);
    let mut s = Stated { found };
    match &view.recording.rig {
        Some(Rig::Robot(_)) => robot(view, &mut s),
        Some(Rig::FilmSample(_)) => sample(view, &mut s),
        None => {}
    }
    payload(view, &mut s);
    coupon(view, &mut s);
    axis(view, &mut s);
}

/// The voltages themselves.
fn voltages(view: &View<'_>, found: &mut Findings) {
    let Some(v) = &view.recording.voltage else {
        return;
    };
    let scale = v.unit.to_si * v.scale.unwrap_or(1.0);
    let known = |x: &f64| x.is_finite() && x.abs() < 1e12;
    let most = view
        .signals
        .iter()
        .filter(|s| s.is == Is::Voltage)
        .map(|s| {
            super::linear::quantile(s.values.iter().copied().filter(known).map(f64::abs), 0.999)
        })
        .fold(0.0, f64::max);
    let volts = most * scale;
    if volts > VOLTAGE_V {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "the voltages reach {} {}, that is {} kV, which no amplifier of such a rig makes and no film stands",
                short(most),
                v.unit.symbol,
                short(volts * 1e-3)
            ),
            format!(
                "look at unit = \"{}\"{} under [voltage]; is it V?",
                v.unit.symbol,
                v.scale.map_or(String::new(), |s| format!(" and scale = {s}"))
            ),
        );
    } else if volts > 0.02 && volts < 100.0 && v.scale.is_none() {
        let m = view.signals.iter().filter(|s| s.is == Is::Marker).take(3);
        let si = view
            .recording
            .motion
            .as_ref()
            .map_or(1e-3, |m| m.unit.to_si);
        let moves = m
            .map(|s| {
                let q = |share| super::linear::quantile(s.values.iter().copied(), share);
                (q(0.97) - q(0.03)) * si
            })
            .fold(0.0, f64::max);
        if moves > 1e-3 {
            found.add(
                "unit",
                Grade::Wrong,
                format!(
                    "the voltages reach {} V only, and the motion is {:.1} mm: films of tens of micrometres need a thousand times as much",
                    short(volts),
                    moves * 1e3
                ),
                "state unit = \"kV\" under [voltage], or scale = 1000.0 where a monitor of 1 V per kV was logged",
            );
        }
    }
}

fn robot(view: &View<'_>, s: &mut Stated<'_>) {
    let Some(Rig::Robot(rig)) = &view.recording.rig else {
        return;
    };
    let d = &rig.delta;
    let links = [
        ("l_ch_mm", d.l_ch_mm),
        ("l_end_mm", d.l_end_mm),
        ("q_mm", d.q_mm),
        ("n0_mm", d.n0_mm),
        ("a_mm", rig.sam.a_mm),
        ("b_mm", rig.sam.b_mm),
        ("c_mm", rig.sam.c_mm),
        ("d_mm", rig.sam.d_mm),
        ("l_dea_mm", rig.actuator.l_dea_mm),
    ];
    for (name, value) in links {
        s.within(name, value, LINK_MM, "mm", "a link of a robot on a table");
    }
    let radians = |v: f64| v != 0.0 && v.abs() <= std::f64::consts::TAU;
    if radians(rig.actuator.dea_offset_deg) {
        let v = rig.actuator.dea_offset_deg;
        s.wrong(
            format!("dea_offset_deg = {v} is next to nothing in degrees, and {:.1} degrees where it is in radians", v.to_degrees()),
            "state it in degrees",
        );
    }
    if radians(d.omega_deg) && d.omega_deg.abs() > 0.5 {
        s.wrong(
            format!("omega_deg = {} is next to nothing in degrees, and {:.1} degrees where it is in radians", d.omega_deg, d.omega_deg.to_degrees()),
            "state it in degrees",
        );
    }
    let f = &rig.film;
    s.within("L1_mm", f.L1_mm, SIDE_MM, "mm", "the side of a film");
    s.within("L2_mm", f.L2_mm, SIDE_MM, "mm", "the side of a film");
    thickness(f.L3_mm, f.L1_mm.min(f.L2_mm), s);
    films(rig.actuator.films, s);
    if let Some(eps) = f.eps_r {
        s.within(
            "eps_r",
            eps,
            PERMITTIVITY,
            "",
            "the permittivity of a film relative to vacuum",
        );
    }
    s.within(
        "m_g",
        rig.mass.m_g,
        MASS_G,
        "g",
        "the moving mass of such a robot",
    );
    if rig.mass.m_bc_g > 20.0 * rig.mass.m_g.max(MASS_G[0]) || rig.mass.m_bc_g > MASS_G[1] {
        s.wrong(
            format!(
                "m_bc_g = {} at each bicep tip is out of proportion to m_g = {}",
                rig.mass.m_bc_g, rig.mass.m_g
            ),
            "state both in g",
        );
    }
    field(view, f.L3_mm, s);
    carried(view, s);
}

fn films(films: u32, s: &mut Stated<'_>) {
    s.within(
        "films",
        f64::from(films),
        FILMS,
        "films",
        "the number of films in parallel",
    );
}

fn thickness(l3_mm: f64, side_mm: f64, s: &mut Stated<'_>) {
    if l3_mm > 0.2 * side_mm || l3_mm > THICKNESS_MM[1] {
        s.wrong(
            format!("L3_mm = {l3_mm} is no film, at a side of {} mm: {l3_mm} mm thick, or {} mm where that is in micrometres", short(side_mm), short(l3_mm * 1e-3)),
            "state the thickness of the unstretched film in mm",
        );
    } else {
        s.within(
            "L3_mm",
            l3_mm,
            THICKNESS_MM,
            "mm",
            "the thickness of a film",
        );
    }
}

/// The field in the unstretched film at the largest voltage.
fn field(view: &View<'_>, l3_mm: f64, s: &mut Stated<'_>) {
    let Some(v) = &view.recording.voltage else {
        return;
    };
    if s.found.wrong(&["unit", "sentinel", "stated_value"]) {
        return;
    }
    let scale = v.unit.to_si * v.scale.unwrap_or(1.0);
    let most = v
        .channels
        .iter()
        .map(|c| super::linear::quantile(c.iter().map(|x| x.abs()), 0.999));
    let volts = most.fold(0.0, f64::max) * scale;
    let field = volts / (l3_mm * 1e-3);
    if field > FIELD_V_M {
        s.wrong(
            format!(
                "{} V across L3_mm = {l3_mm} is a field of {} V/um, at which every film breaks down",
                short(volts),
                short(field * 1e-6)
            ),
            "look at the thickness of the film and at the unit of the voltages",
        );
    }
}

/// Weights against what the films can do.
fn carried(view: &View<'_>, s: &mut Stated<'_>) {
    let (Some(glance), Some(Rig::Robot(rig))) = (&view.glance, &view.recording.rig) else {
        return;
    };
    if s.found.wrong(&["unit", "stated_value", "sentinel"]) {
        return;
    }
    let payload_g = glance.most_payload_kg() * 1e3;
    // Half the capacitance's energy at the largest voltage, in three films over a bicep's length is the size
    // of the force that a drive makes.
    let most = (0..3)
        .map(|k| {
            glance.voltage.channels_v()[k]
                .iter()
                .map(|v| v * v)
                .fold(0.0, f64::max)
        })
        .fold(0.0, f64::max);
    if most <= 0.0 {
        return;
    }
    let lozenge = &glance.robot.lozenges[0];
    let eps = glance.robot.eps_r * VACUUM_PERMITTIVITY_F_M;
    let energy_j = 0.5 * eps * lozenge.films * lozenge.l1_m * lozenge.l2_m / lozenge.l3_m * most;
    let force_n = 3.0 * energy_j / (rig.delta.q_mm * 1e-3);
    let weight_n = (rig.mass.m_g + payload_g) * 1e-3 * GRAVITY_M_S2;
    if weight_n > CARRIED * force_n {
        let what = if payload_g > rig.mass.m_g {
            format!("payload_g = {}", short(payload_g))
        } else {
            format!("m_g = {}", rig.mass.m_g)
        };
        s.wrong(
            format!(
                "{what} weighs {} N, and what the voltages can do at these films is of the size of {} N: nothing would move",
                short(weight_n),
                short(force_n)
            ),
            "state masses in g",
        );
    }
}

fn sample(view: &View<'_>, s: &mut Stated<'_>) {
    let Some(Rig::FilmSample(rig)) = &view.recording.rig else {
        return;
    };
    s.within(
        "width_mm",
        rig.width_mm,
        SIDE_MM,
        "mm",
        "the side of a film",
    );
    s.within(
        "length_mm",
        rig.length_mm,
        SIDE_MM,
        "mm",
        "the side of a film",
    );
    thickness(rig.L3_mm, rig.width_mm.min(rig.length_mm), s);
    films(rig.films, s);
    if let Some(eps) = rig.eps_r {
        s.within(
            "eps_r",
            eps,
            PERMITTIVITY,
            "",
            "the permittivity of a film relative to vacuum",
        );
    }
    field(view, rig.L3_mm, s);
    if s.found.wrong(&["stated_value"]) {
        return;
    }
    let payload_g = match &view.recording.manifest.payload {
        Payload::Constant { mass_g } => *mass_g,
        Payload::Steps(steps) => steps.iter().map(|p| p.mass_g).fold(0.0, f64::max),
    };
    let mass_g = rig.m_g + payload_g;
    let section = rig.width_mm * rig.L3_mm * f64::from(rig.films) * 1e-6;
    let tension = mass_g * 1e-3 * GRAVITY_M_S2 / section;
    if !(TENSION_PA[0]..=TENSION_PA[1]).contains(&tension) {
        s.wrong(
            format!(
                "a mass of {mass_g} g pulls at {} mm x {} mm of film with {} kPa, {}",
                rig.width_mm,
                short(rig.L3_mm * f64::from(rig.films)),
                short(tension * 1e-3),
                if tension < TENSION_PA[0] {
                    "too little to keep it taut: is the mass in kg?"
                } else {
                    "at which it tears"
                }
            ),
            "state m_g and payload_g in g, and the film's width and thickness in mm",
        );
    }
}

fn payload(view: &View<'_>, s: &mut Stated<'_>) {
    let masses: Vec<f64> = match &view.recording.manifest.payload {
        Payload::Constant { mass_g } => vec![*mass_g],
        Payload::Steps(steps) => steps.iter().map(|p| p.mass_g).collect(),
    };
    for m in masses {
        if m < 0.0 {
            s.wrong(
                format!("payload_g = {m} is below zero"),
                "state the mass that was added, in g",
            );
        }
        if view.recording.motion.is_some() && m > 0.0 && m < 2e-3 {
            s.wrong(
                format!(
                    "payload_g = {m} is {} mg, less than a grain of sand",
                    short(m * 1e3)
                ),
                "state the mass that was added in g",
            );
        }
    }
}

fn coupon(view: &View<'_>, s: &mut Stated<'_>) {
    let Some(c) = &view.recording.manifest.coupon else {
        return;
    };
    if let CouponElongation::Displacement { gauge_mm, .. } = &c.elongation {
        s.within(
            "gauge_mm",
            *gauge_mm,
            SIDE_MM,
            "mm",
            "the gauge length of a coupon",
        );
    }
    if let CouponLoad::Force {
        width_mm,
        thickness_mm,
        ..
    } = &c.load
    {
        s.within(
            "width_mm",
            *width_mm,
            [0.2, 2000.0],
            "mm",
            "the width of a coupon",
        );
        s.within(
            "thickness_mm",
            *thickness_mm,
            [0.5e-3, 50.0],
            "mm",
            "the thickness of a coupon",
        );
        if thickness_mm > width_mm {
            s.wrong(
                format!("thickness_mm = {thickness_mm} is more than width_mm = {width_mm}"),
                "exchange them, or state the thickness in mm and not in micrometres",
            );
        }
    }
}

fn axis(view: &View<'_>, s: &mut Stated<'_>) {
    let Some(a) = &view.recording.manifest.axis else {
        return;
    };
    let (crate::recording::AxisInertia::MassKg(inertia)
    | crate::recording::AxisInertia::InertiaKgM2(inertia)) = a.inertia;
    for (name, value) in [
        ("mass", inertia),
        ("damping", a.damping),
        ("stiffness", a.stiffness),
    ] {
        if let NumberOrEstimate::Number(v) = value
            && v < 0.0
        {
            s.wrong(
                format!("{name} = {v} is below zero"),
                "state it as a positive number; where the force counts against the position, change the sign of its scale",
            );
        }
    }
    if let NumberOrEstimate::Number(v) = a.input_gain
        && v == 0.0
    {
        s.wrong(
            "input_gain = 0 makes the input do nothing".into(),
            "state N (or N m) per unit of the input, or \"estimate\"",
        );
    }
}
