//! A film coupon: stretch as a ratio that begins at 1, and a stress that a rubber makes at it.

use super::linear::quantile;
use super::view::{View, short};
use super::{Findings, Grade};
use crate::recording::{RawColumn, RawElongation, RawLoad};

/// Stretches that elastomers stand.
const STRETCH: f64 = 15.0;
/// Secant moduli of films, Pa: gels from 1 kPa, stiff rubbers to 60 MPa at the first per cent.
const MODULUS_PA: [f64; 2] = [800.0, 2e8];
/// Nominal stress that no rubber stands, Pa: natural rubber tears at 30 MPa.
const STRENGTH_PA: f64 = 6e7;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(c) = &view.recording.coupon else {
        return;
    };
    if found.wrong(&["sentinel", "stated_value"]) {
        return;
    }
    let (stretch, gauge_mm) = stretch_of(&c.elongation);
    let stress = stress_of(&c.load);
    let rows: Vec<usize> = (0..stretch.len().min(stress.len()))
        .filter(|&i| stretch[i].is_finite() && stress[i].is_finite())
        .collect();
    if rows.len() < 4 {
        return;
    }
    let q = |share| quantile(rows.iter().map(|&i| stretch[i]), share);
    let (low, high) = (q(0.0), q(1.0));
    if is_strain(low, high, gauge_mm, found) {
        return;
    }
    // secant moduli above a per cent of strain
    let secant: Vec<f64> = rows
        .iter()
        .filter(|&&i| stretch[i] > 1.0 + 0.3 * (high - 1.0).max(0.01))
        .map(|&i| stress[i] / (stretch[i] - 1.0))
        .collect();
    if secant.len() < 3 {
        return;
    }
    let most = quantile(rows.iter().map(|&i| stress[i]), 0.99);
    let middle = quantile(secant.iter().copied(), 0.5);
    modulus(&c.load, middle, most, found);
}

/// A column in SI.
fn si(column: &RawColumn) -> Vec<f64> {
    let factor = column.unit.map_or(1.0, |u| u.to_si);
    column.values.iter().map(|v| v * factor).collect()
}

/// Stretches, and the gauge length of those that come of a displacement, mm.
fn stretch_of(elongation: &RawElongation) -> (Vec<f64>, Option<f64>) {
    match elongation {
        RawElongation::Displacement {
            displacement,
            gauge_mm,
        } => {
            let gauge = gauge_mm * 1e-3;
            (
                si(displacement).iter().map(|d| 1.0 + d / gauge).collect(),
                Some(*gauge_mm),
            )
        }
        RawElongation::Stretch(s) => (si(s), None),
    }
}

/// Nominal stresses, Pa.
fn stress_of(load: &RawLoad) -> Vec<f64> {
    match load {
        RawLoad::Force {
            force,
            width_mm,
            thickness_mm,
        } => {
            let section = width_mm * thickness_mm * 1e-6;
            si(force).iter().map(|f| f / section).collect()
        }
        RawLoad::NominalStress(s) => si(s),
    }
}

/// Says when the stretches from `low` to `high` are strains, or more than an elastomer stands.
fn is_strain(low: f64, high: f64, gauge_mm: Option<f64>, found: &mut Findings) -> bool {
    if gauge_mm.is_none() && low < 0.5 && high < STRETCH {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "the stretch begins at {} and goes to {}: that is a strain; a stretch is length over length, 1 at rest",
                short(low),
                short(high)
            ),
            "add 1 to the column, or state it as displacement with gauge_mm = 1.0",
        );
        return true;
    }
    if high > STRETCH {
        let says = match gauge_mm {
            None if low > 50.0 => format!(
                "the stretch goes from {} to {}: per cent of the length, it seems",
                short(low),
                short(high)
            ),
            None => format!(
                "the stretch goes to {}, which no elastomer stands: per cent of strain, it seems",
                short(high)
            ),
            Some(gauge) => format!(
                "the stretch goes to {}, which no elastomer stands, by a displacement of {} mm over gauge_mm = {gauge}",
                short(high),
                short((high - 1.0) * gauge)
            ),
        };
        let remedy = match gauge_mm {
            None if low > 50.0 => "divide the column by 100: a stretch is 1 at rest",
            None => "divide the column by 100 and add 1: a stretch is 1 at rest",
            Some(_) => {
                "look at the displacement's unit and the gauge length, and whether two columns are exchanged"
            }
        };
        found.add("unit", Grade::Wrong, says, remedy);
        return true;
    }
    false
}

/// Holds stress over strain, and the largest stress, against what elastomers have.
fn modulus(load: &RawLoad, middle: f64, most: f64, found: &mut Findings) {
    if middle < 0.0 {
        found.add(
            "sign",
            Grade::Wrong,
            format!(
                "the stress is negative where the film is stretched (about {} kPa per unit of strain): pull counts as positive",
                short(middle * 1e-3)
            ),
            "change the sign of the force or stress column",
        );
    } else if !(MODULUS_PA[0]..=MODULUS_PA[1]).contains(&middle) || most > STRENGTH_PA {
        let (unit, what, remedy) = match load {
            RawLoad::Force { force, .. } => (
                force.unit,
                "force",
                "look at the units of force and displacement, at width_mm and thickness_mm, and whether the two columns are exchanged",
            ),
            RawLoad::NominalStress(s) => (
                s.unit,
                "stress",
                "look at the stress's unit under units (Pa, kPa, MPa), and whether the two columns are exchanged",
            ),
        };
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "stress over strain is {} MPa and the largest stress {} MPa, which no elastomer film has (1 kPa to 100 MPa; 30 MPa), with the {} in {}",
                short(middle * 1e-6),
                short(most * 1e-6),
                what,
                unit.map_or("its unit", |u| u.symbol)
            ),
            remedy,
        );
    }
}
