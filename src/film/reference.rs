//! The reference integrator: slow, exact to rounding, along a stretch history given as a function of time. It
//! is the yardstick of the production kernel and of the golden numbers; no recording goes through it.

use super::{Film, InitialState, Locked, gent_stress};

/// The film at one instant of a reference integration.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceState {
    /// Time, s.
    pub t_s: f64,
    /// Stretches lambda_1, lambda_2.
    pub lambda: [f64; 2],
    /// Inelastic stretches xi of each branch.
    pub xi: Vec<[f64; 2]>,
}

/// Integrates the flow rule of every branch along `stretch(t) -> (lambda_1, lambda_2)` from the first of
/// `times_s` and returns the state at each of them. Classical Runge-Kutta of fourth order in the elastic log
/// stretches with steps no longer than T/40 and `max_step_s`, each branch by itself (branches do not
/// interact).
///
/// # Errors
/// [`Locked`] with the branch and the time.
///
/// # Panics
/// When `times_s` is not rising.
pub fn integrate_reference(
    film: &Film,
    start: InitialState,
    stretch: impl Fn(f64) -> [f64; 2],
    times_s: &[f64],
    max_step_s: f64,
) -> Result<Vec<ReferenceState>, Locked> {
    let mut out: Vec<ReferenceState> = times_s
        .iter()
        .map(|&t_s| ReferenceState {
            t_s,
            lambda: stretch(t_s),
            xi: vec![[1.0; 2]; film.branches()],
        })
        .collect();
    for (n, &relaxation) in film.relaxation_time_s.iter().enumerate() {
        // y = ln xi; dy/dt = flow(lambda(t), y) / T
        let flow = |t: f64, y: [f64; 2]| -> Result<[f64; 2], Locked> {
            let l = stretch(t);
            let a = (2.0 * (l[0].ln() - y[0])).exp();
            let b = (2.0 * (l[1].ln() - y[1])).exp();
            let (s, _) = gent_stress(a, b, film.locking).map_err(|invariant| Locked {
                spring: n + 2,
                invariant,
                locking: film.locking,
                at_s: Some(t),
            })?;
            Ok([
                (s[0] - 0.5 * s[1]) / (3.0 * relaxation),
                (s[1] - 0.5 * s[0]) / (3.0 * relaxation),
            ])
        };
        let first = stretch(times_s[0]);
        let mut y = match start {
            InitialState::Relaxed => [first[0].ln(), first[1].ln()],
            InitialState::Virgin => [0.0, 0.0],
        };
        let mut t = times_s[0];
        for (i, &target) in times_s.iter().enumerate() {
            assert!(target >= t, "times must rise");
            let steps = ((target - t) / max_step_s.min(relaxation / 40.0)).ceil() as usize;
            if steps > 0 {
                let h = (target - t) / steps as f64;
                let t0 = t;
                for k in 0..steps {
                    let t = t0 + h * k as f64;
                    let add = |y: [f64; 2], k: [f64; 2], f: f64| [y[0] + f * k[0], y[1] + f * k[1]];
                    let k1 = flow(t, y)?;
                    let k2 = flow(t + 0.5 * h, add(y, k1, 0.5 * h))?;
                    let k3 = flow(t + 0.5 * h, add(y, k2, 0.5 * h))?;
                    let k4 = flow(t + h, add(y, k3, h))?;
                    for j in 0..2 {
                        y[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
                    }
                }
            }
            t = target;
            out[i].xi[n] = [y[0].exp(), y[1].exp()];
        }
    }
    Ok(out)
}
