//! The other forms of a named cause: which of the links is wrong the recordings may hardly tell, and a user
//! should not mend the wrong one.

use rayon::prelude::*;

use super::POLISH;
use super::judge::Judged;
use super::problem::Problem;
use super::subject::Subject;

/// Share of what the named form takes away from which another form counts as nearly as good.
const NEARLY: f64 = 0.95;

/// Sentences on the forms that explain nearly as much as the named ones, each with the sizes at which it
/// does; none where the recordings tell.
pub(super) fn others<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    best: &Judged,
) -> Vec<String> {
    let fitted = &best.fitted;
    let film = &fitted.state.eta[..problem.nonlinear.len()];
    let fall = |cost: f64| plain.fitted.cost() - cost;
    let sentence = |e: usize| {
        let effect = fitted.effects[e].effect;
        let forms = effect.variants();
        let own = fitted.effects[e].values[0] as usize;
        let as_good: Vec<String> = (0..forms.len())
            .into_par_iter()
            .filter(|form| *form != own)
            .filter_map(|form| {
                let mut effects = fitted.effects.clone();
                for (v, q) in effects[e].values.iter_mut().zip(effect.parameters()) {
                    // from off: what fits one form another may not be able to follow
                    *v = if q.size { q.off } else { *v };
                }
                effects[e].values[0] = form as f64;
                let other = problem.fit(&effects, film, &fitted.state.beta, POLISH);
                if fall(other.cost()) < NEARLY * fall(fitted.cost()) {
                    return None;
                }
                let sizes: Vec<String> = (effect.parameters().iter())
                    .zip(&other.effects[e].values)
                    .filter(|(q, _)| q.size)
                    .map(|(q, v)| {
                        let (factor, unit) = problem.train.unit_of(q.unit);
                        let (name, v) = (q.name.replace('_', " "), factor * v);
                        match unit.as_str() {
                            "1" => format!("{name} {:+.2} %", 100.0 * v),
                            _ => format!("{name} {v:.3} {unit}"),
                        }
                    })
                    .collect();
                Some(format!("{} ({})", forms[form], sizes.join(", ")))
            })
            .collect();
        let named = forms.get(own)?;
        (!as_good.is_empty()).then(|| {
            format!(
                "These recordings hardly tell which form of {} it is: {} takes away nearly as much as {named}. Measure before one of them is mended.",
                effect.id(),
                as_good.join(" or "),
            )
        })
    };
    (0..fitted.effects.len()).filter_map(sentence).collect()
}
