//! What chance alone makes of a scan: is the largest of some hundred scores larger than noise would have made
//! it?
//!
//! The score of a column F of a hypothesis is s = F'r, with everything that a refit could absorb projected
//! out. Were the plain model right, s would have mean 0 and the covariance  V = F~'S F~ + w'P w:  S is the
//! covariance of the residual's noise, with its colour, from the drawn tracks in blocks longer than its
//! memory; w = (C'C + P)^-1 C'F, and P the priors of the plain model, which pull a little wherever the data
//! say little. T = s'V^-1 s then has the chi-squared distribution of as many degrees of freedom as the
//! hypothesis has columns (Rao's score test with White's covariance). V is an estimate from a few tracks and,
//! for a change that acts in a few blocks only, from those blocks: with nu degrees of freedom (Satterthwaite
//! 1946) T (nu - n + 1)/(nu n) has the F distribution of n and nu - n + 1 (Hotelling 1931). The tracks are
//! not those that set the weights.
//!
//! Hypotheses overlap, so the limit for the largest of all is not that of a table. Noise is drawn again and
//! again (each block takes one of the drawn tracks and a sign: a wild bootstrap), goes through the same scan,
//! and the largest surprise of each draw is kept.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::beta::beta_reg;
use statrs::function::erf::erfc;
use statrs::function::gamma::gamma_ur;

use super::judge::INDEPENDENT;
use super::problem::{Fitted, Problem, Tangent};
use super::scan::{Group, Unit};
use super::subject::Subject;
use crate::film::Locked;

/// Tracks that are drawn for the covariance of the scores.
const TRACKS: usize = 18;
/// Draws of noise for the distribution of the largest surprise.
const DRAWS: usize = 400;
/// Length of a block that takes its noise from one drawn track, s: long against the memory of the residual's
/// noise.
const BLOCK_S: f64 = 4.0;
/// Blocks of a recording at least, where it is shorter.
const FEWEST_BLOCKS: f64 = 6.0;
/// Distance of the moments at which a change is looked for, in kept samples, and their number at most.
const MOMENTS: usize = 12;
const MOST_MOMENTS: usize = 150;

/// Between these the noise may be larger than the capture promises, as a variance.
const SCALES: [f64; 2] = [0.5, 3.0];

/// Surprises of clean recordings over those of drawn noise: what the draws do not have (noise in the columns,
/// motion that the smoother takes for noise). From 70 clean cases of the project's own (`deacal prove`, seeds
/// 4242 and 7001): the exponential tail of their largest surprises exceeds 14.6 in about one of a hundred,
/// that of the draws 8.8 in one of fifty.
pub(super) const BEYOND_DRAWN: f64 = 1.65;

/// A column with all that its score needs.
struct Column {
    /// The column with the tangent space projected out.
    left: DVector<f64>,
    /// F'r with the tangent space projected out.
    score: f64,
    /// Product with the residual in each block.
    own: Vec<f64>,
    /// Product with each drawn track (inner) in each block (outer).
    noise: Vec<f64>,
    /// P^(1/2) w.
    prior: DVector<f64>,
    /// F'F with the tangent space projected out: V, were the noise white.
    square: f64,
}

/// A hypothesis: its columns, and whether only one sign is possible.
struct Hypothesis {
    id: &'static str,
    on: [bool; 3],
    columns: Vec<usize>,
    one_sided: bool,
    inverse: DMatrix<f64>,
    /// Degrees of freedom of the estimate of V.
    freedom: f64,
    /// Products of its columns in each block.
    blocks: Vec<DMatrix<f64>>,
    /// Inverse of their sum.
    whole: DMatrix<f64>,
}

/// What a scan's scores are worth against noise.
#[derive(Debug, Clone, Default)]
pub(super) struct Chance {
    /// The largest surprise, -ln of its p-value taken alone, and whose it is.
    pub largest: f64,
    /// Id of the effect with the largest surprise.
    pub whose: &'static str,
    /// Largest surprise of each effect, in the order of the catalogue's first mention.
    pub each: Vec<(&'static str, f64)>,
    /// Variance of the noise over the one that the weights promise.
    pub scale: f64,
    /// Variance of a score over the one that white noise of the promised size would give it, median over the
    /// hypotheses.
    pub colour: f64,
    /// Effect, actuators, their largest surprise, and how much larger the variance of that score is than
    /// white noise of the promised size would make it.
    designs: Vec<(&'static str, [bool; 3], f64, f64)>,
    /// Largest surprises of drawn noise, rising.
    drawn: Vec<f64>,
    /// Stretches to be left out one at a time.
    pub blocks: super::blocks::Blocks,
    /// Mean squares above which noise makes next to none.
    pub most: f64,
}

impl Chance {
    /// Variance of the noise over the one that the weights promise, as what was fitted looks, with what its
    /// colour makes of a score; and the latter alone. Neither is less than 1.
    pub fn noises(&self) -> [f64; 2] {
        let colour = self.colour.max(1.0);
        [self.scale.max(1.0) * colour, colour]
    }

    /// By how much the fall of the sum of squares that an effect brings about overstates the evidence: the
    /// noise of its score is not white, and scatters from block to block.
    pub fn design(&self, id: &str, on: [bool; 3]) -> f64 {
        let own = self.designs.iter().find(|d| d.0 == id && d.1 == on);
        own.map_or(1.0, |d| d.3)
    }

    /// Largest surprise of an effect on these actuators.
    pub fn surprise(&self, id: &str, on: [bool; 3]) -> f64 {
        let own = self.designs.iter().find(|d| d.0 == id && d.1 == on);
        own.map_or(0.0, |d| d.2)
    }

    /// Largest surprise of an effect.
    pub fn surprise_of(&self, id: &str) -> f64 {
        let own = self.each.iter().find(|e| e.0 == id);
        own.map_or(0.0, |e| e.1)
    }

    /// The surprise that noise exceeds in this share of scans.
    pub fn limit(&self, rate: f64) -> f64 {
        let n = self.drawn.len();
        if n == 0 {
            return f64::INFINITY;
        }
        let within = 1.0 / n as f64;
        let at = |share: f64| {
            let i = ((1.0 - share) * n as f64) as usize;
            self.drawn[i.min(n - 1)]
        };
        // Beyond the draws the tail of the largest surprise falls by e each unit.
        BEYOND_DRAWN * (at(rate.max(5.0 * within)) + (5.0 * within / rate).ln().max(0.0))
    }

    /// The fall of the sum of squares that a hypothesis of one column must bring about to surprise as much as
    /// the limit.
    pub fn fall(&self, rate: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1e4);
        let limit = self.limit(rate);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if surprise(middle, 1) < limit {
                low = middle;
            } else {
                high = middle;
            }
        }
        high * self.scale * self.colour
    }

    /// Probability that noise makes as large a surprise.
    pub fn p_value(&self) -> f64 {
        let n = self.drawn.len();
        let largest = self.largest / BEYOND_DRAWN;
        let above = self.drawn.iter().filter(|d| **d >= largest).count();
        if above >= 5 || n == 0 {
            return (above as f64 + 1.0) / (n as f64 + 1.0);
        }
        let edge = self.drawn[n.saturating_sub(5).min(n - 1)];
        (5.0 / n as f64) * (-(largest - edge).max(0.0)).exp()
    }
}

/// -ln of the probability that t = s'V^-1 s of n columns is exceeded, where V is estimated with `freedom`
/// degrees of freedom.
fn surprise_of_estimated(t: f64, n: usize, freedom: f64) -> f64 {
    let rest = freedom - n as f64 + 1.0;
    if freedom > 1e4 || t <= 0.0 {
        return surprise(t, n);
    }
    let rest = rest.max(1.0);
    let p = beta_reg(0.5 * rest, 0.5 * n as f64, freedom / (freedom + t));
    -p.max(1e-290).ln()
}

/// -ln of the probability that chi-squared of n degrees of freedom exceeds t.
fn surprise(t: f64, n: usize) -> f64 {
    let t = t.max(0.0);
    // Beyond the range of exp the leading term suffices.
    if t > 600.0 {
        return 0.5 * t - 0.5 * (n as f64 - 2.0) * (0.5 * t).ln();
    }
    let tail = (-0.5 * t).exp();
    let p = match n {
        1 => erfc((0.5 * t).sqrt()),
        2 => tail,
        3 => erfc((0.5 * t).sqrt()) + (2.0 * t / std::f64::consts::PI).sqrt() * tail,
        _ => gamma_ur(0.5 * n as f64, 0.5 * t),
    };
    -p.max(1e-290).ln()
}

struct Blocks {
    /// First row of each block, and one past the last row of all.
    edges: Vec<usize>,
    tracks: Vec<DVector<f64>>,
}

impl Blocks {
    fn new<S: Subject>(
        problem: &Problem<S>,
        plain: &Fitted,
        tangent: &Tangent,
    ) -> Result<Self, Locked> {
        let mut edges = vec![0];
        for number in 0..problem.train_when.len() {
            let times = problem.train.kept_times_s(number);
            let first = *edges.last().unwrap_or(&0);
            // a short recording still has blocks to scatter
            let span = times.last().unwrap_or(&0.0) - times.first().unwrap_or(&0.0);
            let block_s = BLOCK_S.min(span / FEWEST_BLOCKS);
            let mut begins = times.first().copied().unwrap_or(0.0);
            for (j, &t) in times.iter().enumerate() {
                if t - begins >= block_s && j + 6 < times.len() {
                    edges.push(first + S::CHAINS * j);
                    begins = t;
                }
            }
            edges.push(first + S::CHAINS * times.len());
        }
        let rows = tangent.residual.len();
        let tracks: Vec<DVector<f64>> = problem
            .train
            .fresh_noise_rows(TRACKS, &plain.state.eta, &plain.state.beta)?
            .into_iter()
            .filter(|d| d.len() == rows)
            .map(DVector::from_vec)
            .collect();
        Ok(Blocks { edges, tracks })
    }

    /// Share of its rows that counts, for each block, from those of the recordings.
    fn shares(&self, rows: &[f64], independent: &[f64]) -> Vec<f64> {
        let mut number = 0;
        let mut end = rows.first().copied().unwrap_or(0.0);
        (self.edges.windows(2))
            .map(|e| {
                while e[0] as f64 >= end && number + 1 < rows.len() {
                    number += 1;
                    end += rows[number];
                }
                independent[number] / rows[number].max(1.0)
            })
            .collect()
    }

    /// How many of its rows count as independent, for each recording: by how much the mean square scatters
    /// over the drawn tracks. Where an axis hardly moves, what is left of its noise is so slow that all rows
    /// say the same few things.
    fn independent<S: Subject>(&self, problem: &Problem<S>) -> Vec<f64> {
        let mut first = 0;
        (0..problem.train_when.len())
            .map(|number| {
                let rows = S::CHAINS * problem.train.kept_times_s(number).len();
                let squares = self.tracks.iter();
                let squares = squares.map(|t| t.rows(first, rows).norm_squared());
                let squares: Vec<f64> = squares.collect();
                first += rows;
                independent_rows(&squares, rows)
            })
            .collect()
    }

    /// What a score needs of a column that is zero before row `from`.
    fn column(&self, tangent: &Tangent, f: &DVector<f64>, from: usize) -> Column {
        let n = f.len();
        let own = f.rows(from, n - from);
        let a = tangent.columns.rows(from, n - from).tr_mul(&own);
        let w = tangent.absorbed(&a);
        let mut left = &tangent.columns * &w;
        left.neg_mut();
        let mut tail = left.rows_mut(from, n - from);
        tail += own;
        let mut noise = Vec::with_capacity(self.edges.len() * self.tracks.len());
        let mut products = Vec::with_capacity(self.edges.len());
        for e in self.edges.windows(2) {
            let here = left.rows(e[0], e[1] - e[0]);
            products.push(here.dot(&tangent.residual.rows(e[0], e[1] - e[0])));
            for t in &self.tracks {
                noise.push(here.dot(&t.rows(e[0], e[1] - e[0])));
            }
        }
        Column {
            // Less what the rest of the way to the plain fit's minimum would take away.
            score: own.dot(&tangent.residual.rows(from, n - from)) - w.dot(tangent.slope()),
            own: products,
            noise,
            prior: w.component_mul(tangent.prior_roots()),
            square: tangent.projected(own.norm_squared(), &a, &a),
            left,
        }
    }

    /// Products of columns in each block.
    fn products(&self, columns: &[Column], own: &[usize]) -> Vec<DMatrix<f64>> {
        let n = own.len();
        self.edges
            .windows(2)
            .map(|e| {
                let part = |i: usize| columns[own[i]].left.rows(e[0], e[1] - e[0]);
                DMatrix::from_fn(n, n, |i, j| part(i).dot(&part(j)))
            })
            .collect()
    }
}

/// Scores every hypothesis at the fitted plain model against noise.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(super) fn chance<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
    tangent: &Tangent,
    groups: &[Group],
    units: &[Unit],
) -> Result<Chance, Locked> {
    let blocks = Blocks::new(problem, plain, tangent)?;
    let tracks = blocks.tracks.len();
    if tracks == 0 {
        return Ok(Chance::default());
    }
    let independent = blocks.independent(problem);
    let rows: Vec<f64> = (0..independent.len())
        .map(|number| (S::CHAINS * problem.train.kept_times_s(number).len()) as f64)
        .collect();
    let all: f64 = rows.iter().sum();
    let scatter: f64 = rows.iter().zip(&independent).map(|(r, n)| r * r / n).sum();
    let mut columns: Vec<Column> = Vec::new();
    let mut hypotheses: Vec<Hypothesis> = Vec::new();
    for g in groups {
        let q = g.effect.parameters();
        let one_sided = q
            .iter()
            .filter(|q| q.size)
            .all(|q| q.lower == q.off || q.off.is_infinite());
        for &on in g.effect.reach().sets() {
            let own = g.columns_on(on);
            let first = columns.len();
            columns.extend(own.iter().map(|f| blocks.column(tangent, f, 0)));
            let own: Vec<usize> = (first..columns.len()).collect();
            push(
                &mut hypotheses,
                &blocks,
                &columns,
                own,
                g.effect.id(),
                on,
                one_sided,
            );
            columns[first..].iter_mut().for_each(Column::forget);
        }
    }
    for unit in units {
        let (id, q) = (unit.acting.effect.id(), &unit.acting.effect.parameters()[0]);
        let column = DVector::from_column_slice(&unit.column);
        // A long recording has no more moments than a short one: its cost would else grow with the square of
        // its length.
        let apart = MOMENTS.max(column.len() / (S::CHAINS * MOST_MOMENTS));
        for from in (0..column.len()).step_by(S::CHAINS * apart) {
            let at = columns.len();
            columns.push(blocks.column(tangent, &column, from));
            push(
                &mut hypotheses,
                &blocks,
                &columns,
                vec![at],
                id,
                unit.acting.on,
                q.lower == q.off,
            );
            columns[at].forget();
        }
    }
    let scale = believed_scale(problem, &tangent.residual);
    let own: Vec<f64> = columns.iter().map(|c| c.score / scale.sqrt()).collect();
    let mut colours: Vec<f64> = hypotheses
        .iter()
        .filter(|h| h.columns.len() == 1)
        .map(|h| 1.0 / (h.inverse[(0, 0)] * columns[h.columns[0]].square))
        .filter(|c| c.is_finite())
        .collect();
    colours.sort_by(f64::total_cmp);
    let colour = colours.get(colours.len() / 2).copied().unwrap_or(1.0);
    let mut out = Chance {
        scale,
        colour,
        most: noise_makes(all * all / scatter),
        blocks: super::blocks::Blocks {
            counts: blocks.shares(&rows, &independent),
            edges: blocks.edges.clone(),
        },
        ..Chance::default()
    };
    for h in &hypotheses {
        let scatter = (h.scatter(&columns) / scale).max(1.0);
        let s = h.surprise(&own, scatter, h.freedom);
        let design = (h.white(&own) / h.robust(&own) * scatter).max(1.0);
        match out.designs.iter_mut().find(|d| d.0 == h.id && d.1 == h.on) {
            Some(d) if d.2 < s => (d.2, d.3) = (s, design),
            Some(_) => {}
            None => out.designs.push((h.id, h.on, s, design)),
        }
        match out.each.iter_mut().find(|e| e.0 == h.id) {
            Some(e) => e.1 = e.1.max(s),
            None => out.each.push((h.id, s)),
        }
        if s > out.largest {
            (out.largest, out.whose) = (s, h.id);
        }
    }
    let mut generator = ChaCha12Rng::seed_from_u64(0x0dea_ca12);
    let count = blocks.edges.len() - 1;
    let priors = columns.first().map_or(0, |c| c.prior.len());
    let mut scores = vec![0.0; columns.len()];
    for _ in 0..DRAWS {
        let pick: Vec<(usize, f64)> = (0..count)
            .map(|b| {
                let m = generator.random_range(0..tracks);
                let sign = if generator.random::<bool>() {
                    1.0
                } else {
                    -1.0
                };
                (b * tracks + m, sign)
            })
            .collect();
        let known = DVector::from_fn(priors, |_, _| StandardNormal.sample(&mut generator));
        for (s, c) in scores.iter_mut().zip(&columns) {
            *s = pick
                .iter()
                .map(|(at, sign)| sign * c.noise[*at])
                .sum::<f64>()
                + c.prior.dot(&known);
        }
        let largest = hypotheses
            .iter()
            .map(|h| h.surprise(&scores, 1.0, f64::INFINITY))
            .fold(0.0, f64::max);
        out.drawn.push(largest);
    }
    out.drawn.sort_by(f64::total_cmp);
    Ok(out)
}

/// Variance of the noise over the promised one, as far as that is believed.
fn believed_scale<S: Subject>(problem: &Problem<S>, residual: &DVector<f64>) -> f64 {
    problem.noise_scale(residual).clamp(SCALES[0], SCALES[1])
}

/// The same of what a fitted model leaves, where it is more than promised.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(super) fn shown_noise<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
) -> Result<f64, Locked> {
    Ok(believed_scale(problem, &problem.left(fitted)?).max(1.0))
}

/// How many of so many rows count as independent, from their sum of squares on each drawn track; 1 of none.
fn independent_rows(squares: &[f64], rows: usize) -> f64 {
    let count = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / count;
    let scatter: f64 = squares.iter().map(|s| (s / mean - 1.0).powi(2)).sum();
    let variance = scatter / (count - 1.0).max(1.0);
    // f64::max takes the number where there is none
    (2.0 / variance)
        .max(1.0)
        .min(INDEPENDENT * rows.max(2) as f64)
}

/// Mean square that as many independent residuals exceed once in a thousand times.
fn noise_makes(independent: f64) -> f64 {
    ChiSquared::new(independent).map_or(1.0, |d| d.inverse_cdf(0.999) / independent)
}

impl Column {
    /// Lets go of the rows, once all products are known.
    fn forget(&mut self) {
        self.left = DVector::zeros(0);
    }
}

fn push(
    list: &mut Vec<Hypothesis>,
    blocks: &Blocks,
    columns: &[Column],
    own: Vec<usize>,
    id: &'static str,
    on: [bool; 3],
    one_sided: bool,
) {
    let tracks = blocks.tracks.len();
    let n = own.len();
    let mut v = DMatrix::from_fn(n, n, |i, j| {
        let (a, b) = (&columns[own[i]], &columns[own[j]]);
        let noise: f64 = a.noise.iter().zip(&b.noise).map(|(x, y)| x * y).sum();
        noise / tracks as f64 + a.prior.dot(&b.prior)
    });
    // Few drawn tracks may by chance do less than white noise would.
    for i in 0..n {
        let white = columns[own[i]].square.max(0.0);
        if v[(i, i)] < white {
            let grow = (white / v[(i, i)].max(1e-3 * white + f64::MIN_POSITIVE)).sqrt();
            for j in 0..n {
                v[(i, j)] *= grow;
                v[(j, i)] *= grow;
            }
        }
        if v[(i, i)] <= 0.0 {
            return;
        }
    }
    for i in 0..n {
        v[(i, i)] *= 1.0 + 1e-6;
    }
    let each = blocks.products(columns, &own);
    let mut whole: DMatrix<f64> = each.iter().sum();
    for i in 0..n {
        whole[(i, i)] *= 1.0 + 1e-9;
    }
    if let (Some(v), Some(whole)) = (v.cholesky(), whole.cholesky()) {
        // Squares of the noise's whitened scores, block by block: they add up to n, less what the priors
        // make.
        let squares = (0..blocks.edges.len() - 1).map(|b| {
            let square = |m: usize| {
                let noise = |i: usize| columns[own[i]].noise[b * tracks + m];
                let s = DVector::from_fn(n, |i, _| noise(i));
                s.dot(&v.solve(&s))
            };
            let mean = (0..tracks).map(square).sum::<f64>() / tracks as f64;
            mean * mean
        });
        let squares: f64 = squares.sum();
        list.push(Hypothesis {
            freedom: tracks as f64 * (n * n) as f64 / squares.max(1e-9),
            id,
            on,
            columns: own,
            one_sided: one_sided && n == 1,
            inverse: v.inverse(),
            whole: whole.inverse(),
            blocks: each,
        });
    }
}

impl Hypothesis {
    /// How much more the score scatters from block to block than the noise should make it, once the effect is
    /// fitted: 1 or above. What stands out in one block only, and is not the effect's own course there, is no
    /// evidence for it.
    fn scatter(&self, columns: &[Column]) -> f64 {
        let n = self.columns.len();
        let s = DVector::from_fn(n, |i, _| columns[self.columns[i]].own.iter().sum::<f64>());
        let direction = &self.inverse * &s;
        let size = &self.whole * &s;
        let model = s.dot(&direction);
        if model <= 0.0 {
            return 1.0;
        }
        let sum: f64 = self
            .blocks
            .iter()
            .enumerate()
            .map(|(b, g)| {
                let own = DVector::from_fn(n, |i, _| columns[self.columns[i]].own[b]);
                direction.dot(&(own - g * &size)).powi(2)
            })
            .sum();
        (sum / model).max(1.0)
    }

    fn own(&self, scores: &[f64]) -> DVector<f64> {
        DVector::from_iterator(self.columns.len(), self.columns.iter().map(|&c| scores[c]))
    }

    /// s'V^-1 s.
    fn robust(&self, scores: &[f64]) -> f64 {
        let s = self.own(scores);
        s.dot(&(&self.inverse * &s))
    }

    /// The fall of the sum of squares that the scores promise.
    fn white(&self, scores: &[f64]) -> f64 {
        let s = self.own(scores);
        s.dot(&(&self.whole * &s))
    }

    /// How much scores surprise; noise that is drawn from the tracks that V is from knows V.
    fn surprise(&self, scores: &[f64], scatter: f64, freedom: f64) -> f64 {
        let scatter = scatter.max(1.0);
        let n = self.columns.len();
        let mut more = 0.0;
        if n == 1 && self.one_sided {
            // A positive size lowers the sum of squares where the residual and its column point against each
            // other.
            if scores[self.columns[0]] >= 0.0 {
                return 0.0;
            }
            more = std::f64::consts::LN_2;
        }
        let t = match self.columns[..] {
            [only] => scores[only] * scores[only] * self.inverse[(0, 0)],
            _ => self.robust(scores),
        };
        surprise_of_estimated(t / scatter, n, freedom) + more
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_count_by_how_their_squares_scatter() {
        // chi-squared of n degrees of freedom scatters by 2/n
        let squares: Vec<f64> = [-1.0, 1.0, -1.0, 1.0].map(|s| 1.0 + 0.1 * s).to_vec();
        let n = independent_rows(&squares, 1000);
        assert!((n - 150.0).abs() < 1e-9, "{n}");
        assert_eq!(independent_rows(&squares, 100), INDEPENDENT * 100.0);
        assert_eq!(independent_rows(&[0.0; 4], 0), 1.0);
    }

    #[test]
    fn an_estimated_covariance_has_the_tail_of_the_f_distribution() {
        use statrs::distribution::FisherSnedecor;
        for (n, freedom) in [(1, 6.0), (1, 40.0), (2, 25.0), (4, 200.0)] {
            let rest = freedom - n as f64 + 1.0;
            let table = FisherSnedecor::new(n as f64, rest).unwrap();
            for t in [0.5, 4.0, 20.0] {
                let want = -table.sf(t * rest / (freedom * n as f64)).ln();
                let got = surprise_of_estimated(t, n, freedom);
                assert!(
                    (got - want).abs() < 1e-6 * want.max(1.0),
                    "{n} {freedom} {t}: {got} {want}"
                );
            }
        }
        assert_eq!(
            surprise_of_estimated(9.0, 2, f64::INFINITY),
            surprise(9.0, 2)
        );
    }

    #[test]
    fn surprises_are_those_of_the_chi_squared_distribution() {
        for n in [1, 2, 3, 4, 6] {
            let table = ChiSquared::new(n as f64).unwrap();
            for t in [0.1, 1.0, 7.0, 30.0] {
                let want = -table.sf(t).ln();
                assert!(
                    (surprise(t, n) - want).abs() < 1e-6 * want.max(1.0),
                    "{n} {t}"
                );
            }
        }
    }
}
