//! The production kernel: one pass along a sampled stretch history that gives the stress of every spring, and
//! its exact derivatives with respect to ln T (own branch only) and ln J, projected on the two levers of the
//! sample.
//!
//! Branches do not interact once the stretch history is known, so a spring is a lane: lane 0 of the first
//! eight is the equilibrium spring, the others are branches. A lane group is as wide as the machine's vectors
//! (chosen when the program runs), and the same source serves all widths.
//!
//! # Scheme
//! With w_i = xi_i^-2, so that A = lambda_1^2 w_1, and G_i = lambda_i^-2 (where w_i ends when the film
//! rests), r = 1/T, the flow rule reads
//!
//! ```text
//! w_1' = -r (w_1 - G_1) + N_1,   N_1 = r (w_1 - G_1) - (r/3) w_1 (2 s_1 - s_2)        (w_2: 1 and 2 exchanged)
//! ```
//!
//! where N is of second order in A - 1, B - 1. The linear part with its drive G (quadratic within a step) is
//! integrated exactly by phi functions, N by exponential Adams methods (Cox and Matthews 2002, J. Comput.
//! Phys. 176:430): the two-step formula predicts, the quadratic through the last three N corrects, and the
//! stress is evaluated once a step, at the prediction. The elastic response is exact, because A and B take
//! the sampled stretch itself; the equilibrium spring is a lane with r = 0. Derivatives are those of this
//! discrete scheme, so they agree with differences of its own result to rounding.
//! `tests/model/golden_film.rs` states the errors that this leaves at 100 Hz.
//!
//! No exponential in the loop, one division a stage: C = 1/(A B) and 1/D share the reciprocal of A B (A B D).

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use super::{InitialState, Locked};

/// Springs that one pass of lanes holds.
pub const LANES: usize = 8;
/// Numbers that the kernel writes for each sample and eight springs: stress, d/d ln T, d/d ln J.
pub const ROW: usize = 3 * LANES;

/// One node of a stretch history, and the way to it from the node before.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Node {
    /// lambda_1^2, lambda_2^2.
    pub lambda_squared: [f64; 2],
    /// lambda_1^-2, lambda_2^-2.
    pub rest: [f64; 2],
    /// lambda_1^-2, lambda_2^-2 in the middle of the step that ends here.
    pub mid_rest: [f64; 2],
    /// What the kernel writes is `lever[0] s_1 + lever[1] s_2`: m^3/rad for a torque, 1/lambda_1 for a
    /// nominal stress.
    pub lever: [f64; 2],
}

/// A node that only carries the history on: what a [`Node`] has beside it follows from this.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// lambda_1^2, lambda_2^2.
    pub lambda_squared: [f64; 2],
    /// lambda_1^-2, lambda_2^-2 in the middle of the step that ends here.
    pub mid_rest: [f64; 2],
}

/// Nodes at equal distances.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Distance of the nodes, s.
    pub step_s: f64,
    /// What is passed before the nodes, at the same distance, without a sample.
    pub through: Arc<[Waypoint]>,
    /// Every `stride`-th node is a sample; the others only carry the history there.
    pub stride: usize,
    /// The nodes after the one at which the segment begins (after `through`, where there is something).
    pub nodes: Vec<Node>,
}

/// A stretch history: the first sample and the segments that follow it.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// State of the branches at the first sample.
    pub initial: InitialState,
    /// The first sample; its `mid_rest` is not used.
    pub first: Node,
    /// What follows.
    pub segments: Vec<Segment>,
}

/// Sub-steps of each of the first samples of a virgin film: a jump at the start wants them (performance
/// notes: without them T = 0.02 s came out as 0.0251 s).
const LEAD_IN_SUBSTEPS: usize = 16;
/// Samples over which a virgin film's start is sub-stepped.
const LEAD_IN_SAMPLES: usize = 32;
/// Waypoints that are worked on at a time.
const WAYPOINTS: usize = 256;

/// lambda^-2 in the middle of the step between two samples, from stretches and the rates of their logarithms
/// (1/s): the cubic's middle is (v0 + v1)/2 + (r0 - r1) step/8.
fn middle(stretch: [[f64; 2]; 2], rate: [[f64; 2]; 2], step_s: f64) -> [f64; 2] {
    [0, 1].map(|j| {
        let bend = (rate[1][j] - rate[0][j]) * step_s / 4.0;
        bend.exp() / (stretch[0][j] * stretch[1][j])
    })
}

/// The way from one sample to a later one, over those in between.
#[derive(Debug, Clone, PartialEq)]
pub struct Way {
    through: Arc<[Waypoint]>,
    /// lambda_1^-2, lambda_2^-2 in the middle of the last step.
    mid_rest: [f64; 2],
}

impl Way {
    /// From `stretch` and `rate`, as in [`History::sampled`], at both samples and all in between.
    ///
    /// # Panics
    /// With fewer than two samples.
    pub fn over(step_s: f64, stretch: &[[f64; 2]], rate: &[[f64; 2]]) -> Self {
        let middle =
            |i: usize| middle([stretch[i - 1], stretch[i]], [rate[i - 1], rate[i]], step_s);
        let last = stretch.len() - 1;
        Way {
            through: (1..last)
                .map(|i| Waypoint {
                    lambda_squared: stretch[i].map(|l| l * l),
                    mid_rest: middle(i),
                })
                .collect(),
            mid_rest: middle(last),
        }
    }
}

impl History {
    /// A history sampled every `step_s`: `stretch` (lambda_1, lambda_2), the `rate` of its logarithm (1/s)
    /// and the `lever` at each sample. Between samples ln lambda is the cubic through both values and rates.
    /// A virgin start is sub-stepped over the first samples.
    ///
    /// # Panics
    /// When the slices differ in length or are empty.
    pub fn sampled(
        initial: InitialState,
        step_s: f64,
        stretch: &[[f64; 2]],
        rate: &[[f64; 2]],
        lever: &[[f64; 2]],
    ) -> Self {
        assert!(!stretch.is_empty());
        assert!(stretch.len() == rate.len() && rate.len() == lever.len());
        let node = |stretch: [f64; 2], mid_rest: [f64; 2], lever: [f64; 2]| {
            let lambda_squared = stretch.map(|l| l * l);
            Node {
                lambda_squared,
                rest: lambda_squared.map(f64::recip),
                mid_rest,
                lever,
            }
        };
        // The Hermite cubic at the fraction f of the step that ends at sample i.
        let log_at = |i: usize, f: f64, j: usize| {
            let (v0, v1) = (stretch[i - 1][j].ln(), stretch[i][j].ln());
            let (r0, r1) = (rate[i - 1][j] * step_s, rate[i][j] * step_s);
            let (f2, f3) = (f * f, f * f * f);
            v0 * (2.0 * f3 - 3.0 * f2 + 1.0)
                + r0 * (f3 - 2.0 * f2 + f)
                + v1 * (3.0 * f2 - 2.0 * f3)
                + r1 * (f3 - f2)
        };
        let lead = match initial {
            InitialState::Relaxed => 0,
            InitialState::Virgin => LEAD_IN_SAMPLES.min(stretch.len() - 1),
        };
        let mut segments = Vec::new();
        if lead > 0 {
            let n = LEAD_IN_SUBSTEPS as f64;
            let nodes = (1..=lead)
                .flat_map(|i| (1..=LEAD_IN_SUBSTEPS).map(move |k| (i, k)))
                .map(|(i, k)| {
                    let at = |f: f64, power: f64| [0, 1].map(|j| (power * log_at(i, f, j)).exp());
                    let (f, middle) = (k as f64 / n, (k as f64 - 0.5) / n);
                    let lever = if k == LEAD_IN_SUBSTEPS {
                        lever[i]
                    } else {
                        [0.0; 2]
                    };
                    node(at(f, 1.0), at(middle, -2.0), lever)
                })
                .collect();
            segments.push(Segment {
                step_s: step_s / n,
                through: Arc::default(),
                stride: LEAD_IN_SUBSTEPS,
                nodes,
            });
        }
        let nodes: Vec<Node> = (lead + 1..stretch.len())
            .map(|i| {
                let middle = middle([stretch[i - 1], stretch[i]], [rate[i - 1], rate[i]], step_s);
                node(stretch[i], middle, lever[i])
            })
            .collect();
        if !nodes.is_empty() {
            segments.push(Segment {
                step_s,
                through: Arc::default(),
                stride: 1,
                nodes,
            });
        }
        History {
            initial,
            first: node(stretch[0], [0.0; 2], lever[0]),
            segments,
        }
    }

    /// Lets the history come to some samples, in rising order, not right after the ones before them but over
    /// a way between.
    ///
    /// # Panics
    /// When a sample lies within a virgin film's sub-stepped start or beyond the last one.
    pub fn pass_over(&mut self, ways: &[(usize, Way)]) {
        let Some(mut first) = self.segments.pop() else {
            assert!(ways.is_empty());
            return;
        };
        let from = self.samples();
        let mut after = Vec::with_capacity(ways.len());
        for (sample, way) in ways.iter().rev() {
            let mut nodes = first.nodes.split_off(sample - from);
            nodes[0].mid_rest = way.mid_rest;
            after.push(Segment {
                step_s: first.step_s,
                through: way.through.clone(),
                stride: 1,
                nodes,
            });
        }
        if !ways.is_empty() {
            first.nodes.shrink_to_fit();
        }
        self.segments.push(first);
        self.segments.extend(after.into_iter().rev());
    }

    /// Number of samples, the first included.
    pub fn samples(&self) -> usize {
        1 + self
            .segments
            .iter()
            .map(|s| s.nodes.len() / s.stride)
            .sum::<usize>()
    }
}

/// The nonlinear parameters of the film: everything that the inelastic history depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape<'a> {
    /// Relaxation times, s.
    pub relaxation_time_s: &'a [f64],
    /// Locking constant J.
    pub locking: f64,
}

impl Shape<'_> {
    /// Number of springs: the equilibrium spring and the branches.
    pub fn springs(&self) -> usize {
        1 + self.relaxation_time_s.len()
    }

    /// Groups of eight lanes that hold the springs.
    pub fn packs(&self) -> usize {
        self.springs().div_ceil(LANES)
    }
}

/// phi functions of a step and their derivatives with respect to z = step/T: (phi_0 .. phi_3), (d phi_0 .. d
/// phi_3).
fn phi_functions(z: f64) -> ([f64; 4], [f64; 4]) {
    let mut phi = [(-z).exp(), 0.0, 0.0, 0.0];
    let mut slope = [-phi[0], 0.0, 0.0, 0.0];
    if z < 1.0 {
        // phi_k(z) = sum_j (-z)^j / (j + k)!
        for k in 1..4 {
            let mut term = 1.0 / [1.0, 1.0, 2.0, 6.0][k];
            let (mut value, mut derivative) = (term, 0.0);
            for j in 1..24 {
                let next = term / (j + k) as f64; // z^(j-1) / (j + k)! with alternating sign
                derivative -= next * j as f64;
                term = -next * z;
                value += term;
            }
            (phi[k], slope[k]) = (value, derivative);
        }
    } else {
        for k in 1..4 {
            let inverse_factorial = [1.0, 1.0, 1.0, 0.5][k];
            phi[k] = (inverse_factorial - phi[k - 1]) / z;
            slope[k] = -(slope[k - 1] + phi[k]) / z;
        }
    }
    (phi, slope)
}

/// Constants of eight lanes for one step size; each an array of lanes.
#[derive(Clone)]
struct Constants {
    decay: [f64; LANES],
    d_decay: [f64; LANES],
    /// Weights of G at the beginning, middle and end of the step.
    drive: [[f64; LANES]; 3],
    d_drive: [[f64; LANES]; 3],
    /// Weights of N and of its first and second backward difference.
    stage: [[f64; LANES]; 3],
    d_stage: [[f64; LANES]; 3],
    rate: [f64; LANES],
    third_rate: [f64; LANES],
}

impl Constants {
    fn new(shape: &Shape, pack: usize, step_s: f64) -> Self {
        let zero = [0.0; LANES];
        let mut c = Constants {
            decay: [1.0; LANES],
            d_decay: zero,
            drive: [zero; 3],
            d_drive: [zero; 3],
            stage: [zero; 3],
            d_stage: [zero; 3],
            rate: zero,
            third_rate: zero,
        };
        for lane in 0..LANES {
            let spring = pack * LANES + lane;
            if spring == 0 || spring > shape.relaxation_time_s.len() {
                continue; // the equilibrium spring never relaxes; an unused lane repeats it
            }
            let relaxation = shape.relaxation_time_s[spring - 1];
            let z = step_s / relaxation;
            let (phi, slope) = phi_functions(z);
            let d = |k: usize| -z * slope[k]; // d phi_k / d ln T
            c.rate[lane] = 1.0 / relaxation;
            c.third_rate[lane] = 1.0 / (3.0 * relaxation);
            c.decay[lane] = phi[0];
            c.d_decay[lane] = d(0);
            // Integral of exp(-z (1 - s)) times the quadratic through (0, G_0), (1/2, G_m), (1, G_1).
            let weights = |p: [f64; 4]| {
                [
                    p[1] - 3.0 * p[2] + 4.0 * p[3],
                    4.0 * p[2] - 8.0 * p[3],
                    4.0 * p[3] - p[2],
                ]
            };
            let (w, dw) = (weights(phi), weights([d(0), d(1), d(2), d(3)]));
            for i in 0..3 {
                c.drive[i][lane] = z * w[i];
                c.d_drive[i][lane] = z * (dw[i] - w[i]);
            }
            // N through the last nodes by its backward differences (Newton): weights phi_1, phi_2, phi_3 +
            // phi_2/2.
            let stages = |p: [f64; 4]| [p[1], p[2], p[3] + 0.5 * p[2]];
            let (w, dw) = (stages(phi), stages([d(0), d(1), d(2), d(3)]));
            for i in 0..3 {
                c.stage[i][lane] = step_s * w[i];
                c.d_stage[i][lane] = step_s * dw[i];
            }
        }
        c
    }
}

/// State of eight lanes: w, N at the same node, N at the node before, each a pair with its tangents (value,
/// d/d ln T, d/d ln J); last the smallest A B D so far.
#[derive(Clone, Debug)]
struct State([[f64; LANES]; 19]);

/// Place of the smallest A B D in a [`State`].
const LEAST: usize = 18;

/// A pair of quantities (directions 1, 2) with tangents with respect to ln T and ln J.
#[derive(Clone, Copy)]
struct Tangent<V> {
    value: [V; 2],
    d_t: [V; 2],
    d_j: [V; 2],
}

/// One block of nodes through one pack of lanes, with the derivatives or without.
struct Block<'a, const SLOPES: bool> {
    constants: &'a Constants,
    inverse_locking: f64,
    state: &'a mut State,
    previous: Node,
    nodes: &'a [Node],
    stride: usize,
    /// Also writes the node before the block (the first sample), whose N is not known yet.
    first: bool,
    rows: &'a mut [f64],
    row_width: usize,
    row_offset: usize,
}

#[inline(always)]
fn load<S: Simd>(lanes: &[f64; LANES], at: usize) -> S::f64s {
    S::as_simd_f64s(&lanes[at..at + S::F64_LANES]).0[0]
}

/// Three rows of lanes.
#[inline(always)]
fn load_three<S: Simd>(lanes: &[[f64; LANES]; 3], at: usize) -> [S::f64s; 3] {
    [
        load::<S>(&lanes[0], at),
        load::<S>(&lanes[1], at),
        load::<S>(&lanes[2], at),
    ]
}

#[inline(always)]
fn tangent<S: Simd>(state: &State, at: usize, group: usize) -> Tangent<S::f64s> {
    Tangent {
        value: [
            load::<S>(&state.0[at], group),
            load::<S>(&state.0[at + 1], group),
        ],
        d_t: [
            load::<S>(&state.0[at + 2], group),
            load::<S>(&state.0[at + 3], group),
        ],
        d_j: [
            load::<S>(&state.0[at + 4], group),
            load::<S>(&state.0[at + 5], group),
        ],
    }
}

/// The other way round than [`tangent`].
#[inline(always)]
fn store_tangent<S: Simd>(state: &mut State, at: usize, group: usize, v: &Tangent<S::f64s>) {
    for (part, v) in [v.value, v.d_t, v.d_j].into_iter().enumerate() {
        for i in 0..2 {
            let lanes = &mut state.0[at + 2 * part + i][group..group + S::F64_LANES];
            S::as_mut_simd_f64s(lanes).0[0] = v[i];
        }
    }
}

impl<const SLOPES: bool> WithSimd for Block<'_, SLOPES> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // Without derivatives two groups of four lanes have room side by side, and hide each other's latency.
        if !SLOPES && 2 * S::F64_LANES == LANES {
            advance::<S, SLOPES, 2>(simd, 0, &mut self);
            return;
        }
        let mut group = 0;
        while group < LANES {
            advance::<S, SLOPES, 1>(simd, group, &mut self);
            group += S::F64_LANES;
        }
    }
}

/// Arithmetic on the lanes of one group. Everything here must be inlined into the function that was compiled
/// for the machine's vectors; a closure that is not would run without them.
#[derive(Clone, Copy)]
struct Group<S: Simd> {
    simd: S,
    one: S::f64s,
    two: S::f64s,
    three: S::f64s,
    inverse_j: S::f64s,
    one_three_j: S::f64s,
    rate: S::f64s,
    third: S::f64s,
}

impl<S: Simd> Group<S> {
    #[inline(always)]
    fn new(simd: S, at: usize, k: &Constants, inverse_locking: f64) -> Self {
        Group {
            simd,
            one: simd.splat_f64s(1.0),
            two: simd.splat_f64s(2.0),
            three: simd.splat_f64s(3.0),
            inverse_j: simd.splat_f64s(inverse_locking),
            one_three_j: simd.splat_f64s(1.0 + 3.0 * inverse_locking),
            rate: load::<S>(&k.rate, at),
            third: load::<S>(&k.third_rate, at),
        }
    }

    #[inline(always)]
    fn splat(self, v: f64) -> S::f64s {
        self.simd.splat_f64s(v)
    }
    #[inline(always)]
    fn add(self, a: S::f64s, b: S::f64s) -> S::f64s {
        self.simd.add_f64s(a, b)
    }
    #[inline(always)]
    fn sub(self, a: S::f64s, b: S::f64s) -> S::f64s {
        self.simd.sub_f64s(a, b)
    }
    #[inline(always)]
    fn mul(self, a: S::f64s, b: S::f64s) -> S::f64s {
        self.simd.mul_f64s(a, b)
    }
    /// a b + c
    #[inline(always)]
    fn fma(self, a: S::f64s, b: S::f64s, c: S::f64s) -> S::f64s {
        self.simd.mul_add_e_f64s(a, b, c)
    }
    /// c - a b
    #[inline(always)]
    fn fnma(self, a: S::f64s, b: S::f64s, c: S::f64s) -> S::f64s {
        self.simd.negate_mul_add_e_f64s(a, b, c)
    }

    /// Stress, N and what is written, at one node.
    ///
    /// With p = C/A, q = C/B the derivatives of the stress are
    ///
    /// ```text
    /// ds_1/dA = (1 + p + s_1 (1 - p)/J)/D,  ds_1/dB = (q + s_1 (1 - q)/J)/D     (s_2: A and B exchanged)
    /// ds_i/d ln J = -s_i (1 - D)/D
    /// ```
    #[inline(always)]
    fn node<const SLOPES: bool>(
        self,
        x: &Tangent<S::f64s>,
        node: &Node,
        least: &mut S::f64s,
        out: Option<&mut [f64]>,
    ) -> Tangent<S::f64s> {
        let l = [
            self.splat(node.lambda_squared[0]),
            self.splat(node.lambda_squared[1]),
        ];
        let [a, b] = [self.mul(l[0], x.value[0]), self.mul(l[1], x.value[1])];
        let ab = self.mul(a, b);
        // A B D = A B (1 + 3/J) - (A B (A + B) + 1)/J
        let cubic = self.fma(ab, self.add(a, b), self.one);
        let abd = self.fnma(self.inverse_j, cubic, self.mul(ab, self.one_three_j));
        *least = self.simd.min_f64s(*least, abd);
        let inverse = self.simd.div_f64s(self.one, self.mul(ab, abd));
        let c = self.mul(abd, inverse);
        let inverse_d = self.mul(self.mul(ab, ab), inverse);
        let s = [
            self.mul(self.sub(a, c), inverse_d),
            self.mul(self.sub(b, c), inverse_d),
        ];
        let c2 = self.mul(c, c);
        let [p, q] = [self.mul(c2, b), self.mul(c2, a)];
        let scaled = [self.mul(l[0], inverse_d), self.mul(l[1], inverse_d)];
        let s_over_j = [
            self.mul(s[0], self.inverse_j),
            self.mul(s[1], self.inverse_j),
        ];
        let [one_p, one_q] = [self.sub(self.one, p), self.sub(self.one, q)];
        // ds_i/dw_j
        let slope = [
            [
                self.mul(
                    self.fma(s_over_j[0], one_p, self.add(self.one, p)),
                    scaled[0],
                ),
                self.mul(self.fma(s_over_j[0], one_q, q), scaled[1]),
            ],
            [
                self.mul(self.fma(s_over_j[1], one_p, p), scaled[0]),
                self.mul(
                    self.fma(s_over_j[1], one_q, self.add(self.one, q)),
                    scaled[1],
                ),
            ],
        ];
        // (1 - D)/D = (A + B + C - 3)/(J D)
        let invariant = self.sub(self.add(self.add(a, b), c), self.three);
        let explicit = self.mul(self.mul(self.inverse_j, invariant), inverse_d);
        if let Some(out) = out {
            let lever = [self.splat(node.lever[0]), self.splat(node.lever[1])];
            let value = self.fma(lever[0], s[0], self.mul(lever[1], s[1]));
            let width = S::F64_LANES;
            S::as_mut_simd_f64s(&mut out[..width]).0[0] = value;
            let g = [
                self.fma(lever[0], slope[0][0], self.mul(lever[1], slope[1][0])),
                self.fma(lever[0], slope[0][1], self.mul(lever[1], slope[1][1])),
            ];
            let d_t = self.fma(g[0], x.d_t[0], self.mul(g[1], x.d_t[1]));
            let d_j = self.fma(g[0], x.d_j[0], self.mul(g[1], x.d_j[1]));
            let d_j = self.fnma(value, explicit, d_j);
            if SLOPES {
                S::as_mut_simd_f64s(&mut out[LANES..LANES + width]).0[0] = d_t;
                S::as_mut_simd_f64s(&mut out[2 * LANES..2 * LANES + width]).0[0] = d_j;
            }
        }
        let mut n = *x;
        for i in 0..2 {
            let o = 1 - i;
            let flow = self.sub(self.mul(self.two, s[i]), s[o]);
            let third_w = self.mul(self.third, x.value[i]);
            let lost = self.mul(third_w, flow);
            let value = self.sub(
                self.mul(self.rate, self.sub(x.value[i], self.splat(node.rest[i]))),
                lost,
            );
            // dN_i/dw_i at fixed stress, and through the stress
            let own = self.fnma(self.third, flow, self.rate);
            let own = self.fnma(
                third_w,
                self.sub(self.mul(self.two, slope[i][i]), slope[o][i]),
                own,
            );
            let other = self.mul(
                third_w,
                self.sub(self.mul(self.two, slope[i][o]), slope[o][o]),
            );
            n.value[i] = value;
            if !SLOPES {
                continue;
            }
            n.d_t[i] = self.fnma(other, x.d_t[o], self.mul(own, x.d_t[i]));
            n.d_t[i] = self.sub(n.d_t[i], value);
            n.d_j[i] = self.fnma(other, x.d_j[o], self.mul(own, x.d_j[i]));
            n.d_j[i] = self.fma(lost, explicit, n.d_j[i]);
        }
        n
    }
}

/// One lane group on its way: its constants, its state, and the change of N over the last step.
#[derive(Clone, Copy)]
struct Steps<S: Simd> {
    g: Group<S>,
    decay: S::f64s,
    d_decay: S::f64s,
    drive: [S::f64s; 3],
    d_drive: [S::f64s; 3],
    stage: [S::f64s; 3],
    d_stage: [S::f64s; 3],
    x: Tangent<S::f64s>,
    n: Tangent<S::f64s>,
    before: Tangent<S::f64s>,
    change: Tangent<S::f64s>,
    least: S::f64s,
}

impl<S: Simd> Steps<S> {
    #[inline(always)]
    fn new(simd: S, group: usize, k: &Constants, inverse_locking: f64, state: &State) -> Self {
        let n = tangent::<S>(state, 6, group);
        Steps {
            g: Group::new(simd, group, k, inverse_locking),
            decay: load::<S>(&k.decay, group),
            d_decay: load::<S>(&k.d_decay, group),
            drive: load_three::<S>(&k.drive, group),
            d_drive: load_three::<S>(&k.d_drive, group),
            stage: load_three::<S>(&k.stage, group),
            d_stage: load_three::<S>(&k.d_stage, group),
            x: tangent::<S>(state, 0, group),
            n,
            before: tangent::<S>(state, 12, group),
            change: n,
            least: load::<S>(&state.0[LEAST], group),
        }
    }

    /// Predicts the state at the end of the step from a node at which the film would rest at `rest`.
    #[inline(always)]
    fn predict<const SLOPES: bool>(&mut self, rest: [f64; 2], node: &Node) {
        let (g, n, before) = (self.g, &self.n, &self.before);
        let (w, dw) = (self.drive, self.d_drive);
        let ([p1, p2, _], [dp1, dp2, _]) = (self.stage, self.d_stage);
        let (x, change) = (&mut self.x, &mut self.change);
        for i in 0..2 {
            let g0 = g.splat(rest[i]);
            let gm = g.splat(node.mid_rest[i]);
            let g1 = g.splat(node.rest[i]);
            let drive = g.fma(w[2], g1, g.fma(w[1], gm, g.mul(w[0], g0)));
            let d_drive = g.fma(dw[2], g1, g.fma(dw[1], gm, g.mul(dw[0], g0)));
            change.value[i] = g.sub(n.value[i], before.value[i]);
            let explicit = g.fma(dp1, n.value[i], g.fma(self.d_decay, x.value[i], d_drive));
            let explicit = g.fma(dp2, change.value[i], explicit);
            let value = g.fma(p1, n.value[i], g.fma(self.decay, x.value[i], drive));
            x.value[i] = g.fma(p2, change.value[i], value);
            if SLOPES {
                change.d_t[i] = g.sub(n.d_t[i], before.d_t[i]);
                change.d_j[i] = g.sub(n.d_j[i], before.d_j[i]);
                let d_t = g.fma(p1, n.d_t[i], g.fma(self.decay, x.d_t[i], explicit));
                let d_j = g.fma(p1, n.d_j[i], g.mul(self.decay, x.d_j[i]));
                x.d_t[i] = g.fma(p2, change.d_t[i], d_t);
                x.d_j[i] = g.fma(p2, change.d_j[i], d_j);
            }
        }
        self.before = self.n;
    }

    /// Stress and N at a node.
    #[inline(always)]
    fn see<const SLOPES: bool>(&mut self, node: &Node, out: Option<&mut [f64]>) {
        self.n = self.g.node::<SLOPES>(&self.x, node, &mut self.least, out);
    }

    /// The quadratic through the last three N corrects the step.
    #[inline(always)]
    fn correct<const SLOPES: bool>(&mut self) {
        let (g, n, before, change) = (self.g, &self.n, &self.before, &self.change);
        let ([_, _, p3], [_, _, dp3]) = (self.stage, self.d_stage);
        let x = &mut self.x;
        for i in 0..2 {
            let bend = g.sub(g.sub(n.value[i], before.value[i]), change.value[i]);
            x.value[i] = g.fma(p3, bend, x.value[i]);
            if SLOPES {
                let bend_t = g.sub(g.sub(n.d_t[i], before.d_t[i]), change.d_t[i]);
                let bend_j = g.sub(g.sub(n.d_j[i], before.d_j[i]), change.d_j[i]);
                x.d_t[i] = g.fma(p3, bend_t, g.fma(dp3, bend, x.d_t[i]));
                x.d_j[i] = g.fma(p3, bend_j, x.d_j[i]);
            }
        }
    }

    #[inline(always)]
    fn store(&self, group: usize, state: &mut State) {
        store_tangent::<S>(state, 0, group, &self.x);
        store_tangent::<S>(state, 6, group, &self.n);
        store_tangent::<S>(state, 12, group, &self.before);
        let lanes = &mut state.0[LEAST][group..group + S::F64_LANES];
        S::as_mut_simd_f64s(lanes).0[0] = self.least;
    }
}

/// The steps of so many lane groups along a block's nodes.
#[inline(always)]
fn advance<S: Simd, const SLOPES: bool, const GROUPS: usize>(
    simd: S,
    group: usize,
    block: &mut Block<'_, SLOPES>,
) {
    let width = S::F64_LANES;
    let (k, inverse_locking) = (block.constants, block.inverse_locking);
    let mut steps = [Steps::<S>::new(simd, group, k, inverse_locking, block.state); GROUPS];
    for j in 1..GROUPS {
        let at = group + j * width;
        steps[j] = Steps::<S>::new(simd, at, k, inverse_locking, block.state);
    }
    let long = match SLOPES {
        true => 2 * LANES + width,
        false => width,
    };
    let mut row = block.row_offset + group;
    if block.first {
        for j in 0..GROUPS {
            let at = row + j * width;
            steps[j].see::<SLOPES>(&block.previous, Some(&mut block.rows[at..at + long]));
            steps[j].before = steps[j].n;
        }
        row += block.row_width;
    }
    let mut rest = block.previous.rest;
    let mut until_sample = block.stride;
    for node in block.nodes {
        for steps in &mut steps {
            steps.predict::<SLOPES>(rest, node);
        }
        until_sample -= 1;
        if until_sample == 0 {
            for j in 0..GROUPS {
                let at = row + j * width;
                steps[j].see::<SLOPES>(node, Some(&mut block.rows[at..at + long]));
            }
            row += block.row_width;
            until_sample = block.stride;
        } else {
            for steps in &mut steps {
                steps.see::<SLOPES>(node, None);
            }
        }
        for steps in &mut steps {
            steps.correct::<SLOPES>();
        }
        rest = node.rest;
    }
    for (j, steps) in steps.iter().enumerate() {
        steps.store(group + j * width, block.state);
    }
}

/// A pass along a history, block by block, so that nothing of the recording's length is held.
pub struct Pass<'a> {
    arch: Arch,
    history: &'a History,
    shape: Shape<'a>,
    /// Whether derivatives are wanted.
    slopes: bool,
    states: Vec<State>,
    constants: Vec<Constants>,
    segment: usize,
    node: usize,
    previous: Node,
    started: bool,
    samples: usize,
    time_s: f64,
}

impl<'a> Pass<'a> {
    /// Begins at the first sample.
    pub fn new(history: &'a History, shape: Shape<'a>) -> Self {
        let mut states = vec![State([[0.0; LANES]; 19]); shape.packs()];
        for (pack, state) in states.iter_mut().enumerate() {
            for lane in 0..LANES {
                let spring = pack * LANES + lane;
                let branch = spring > 0 && spring < shape.springs();
                let relaxed = branch && history.initial == InitialState::Relaxed;
                for i in 0..2 {
                    state.0[i][lane] = if relaxed { history.first.rest[i] } else { 1.0 };
                }
            }
            state.0[LEAST] = [f64::INFINITY; LANES];
        }
        let mut pass = Pass {
            arch: Arch::new(),
            history,
            shape,
            slopes: true,
            states,
            constants: Vec::new(),
            segment: 0,
            node: 0,
            previous: history.first,
            started: false,
            samples: 0,
            time_s: 0.0,
        };
        pass.enter_segment();
        pass
    }

    /// The same without derivatives: their places in a row are left as they are.
    pub fn of_stress(history: &'a History, shape: Shape<'a>) -> Self {
        Pass {
            slopes: false,
            ..Pass::new(history, shape)
        }
    }

    fn enter_segment(&mut self) {
        if let Some(segment) = self.history.segments.get(self.segment) {
            self.constants = (0..self.shape.packs())
                .map(|pack| Constants::new(&self.shape, pack, segment.step_s))
                .collect();
            // The node before lies at another distance: the difference of N begins anew.
            if segment.through.is_empty() {
                for state in &mut self.states {
                    for i in 0..6 {
                        state.0[12 + i] = state.0[6 + i];
                    }
                }
            }
        }
    }

    /// Width of a row: [`ROW`] numbers for each eight springs.
    pub fn row_width(&self) -> usize {
        ROW * self.shape.packs()
    }

    /// The next samples: fills rows of `rows` (each [`Pass::row_width`] long) and says how many; 0 at the
    /// end. A row holds, for each eight springs, the stress over modulus times the levers, then d/d ln T,
    /// then d/d ln J.
    ///
    /// # Errors
    /// [`Locked`] names spring, invariant and time (from the first sample) where a spring reaches its locking
    /// stretch.
    ///
    /// # Panics
    /// When `rows` has no room for one row.
    pub fn next_block(&mut self, rows: &mut [f64]) -> Result<usize, Locked> {
        let capacity = rows.len() / self.row_width();
        assert!(capacity > 0);
        if self.segment >= self.history.segments.len() {
            if self.started {
                return Ok(0);
            }
            self.constants = (0..self.shape.packs())
                .map(|pack| Constants::new(&self.shape, pack, 1.0))
                .collect();
            return self.run(&[], 1, 0.0, rows);
        }
        let history = self.history;
        let segment = &history.segments[self.segment];
        if self.node == 0 {
            self.go_through(&segment.through, segment.step_s)?;
        }
        let room = capacity - usize::from(!self.started);
        let end = (self.node + room * segment.stride).min(segment.nodes.len());
        let nodes = &segment.nodes[self.node..end];
        let written = self.run(nodes, segment.stride, segment.step_s, rows)?;
        self.node = end;
        if end == segment.nodes.len() {
            self.segment += 1;
            self.node = 0;
            self.enter_segment();
        }
        Ok(written)
    }

    /// Carries the state along waypoints.
    fn go_through(&mut self, waypoints: &[Waypoint], step_s: f64) -> Result<(), Locked> {
        let mut nodes = Vec::with_capacity(WAYPOINTS.min(waypoints.len()));
        for block in waypoints.chunks(WAYPOINTS) {
            nodes.clear();
            nodes.extend(block.iter().map(|w| Node {
                lambda_squared: w.lambda_squared,
                rest: w.lambda_squared.map(f64::recip),
                mid_rest: w.mid_rest,
                lever: [0.0; 2],
            }));
            self.run(&nodes, usize::MAX, step_s, &mut [])?;
        }
        Ok(())
    }

    fn run(
        &mut self,
        nodes: &[Node],
        stride: usize,
        step_s: f64,
        rows: &mut [f64],
    ) -> Result<usize, Locked> {
        let before = self.states.clone();
        self.sweep(nodes, stride, rows);
        if !self.sound() {
            self.states = before;
            return Err(self.find_lock(nodes, step_s));
        }
        let written = nodes.len() / stride + usize::from(!self.started);
        self.started = true;
        self.samples += written;
        self.time_s += step_s * nodes.len() as f64;
        if let Some(&last) = nodes.last() {
            self.previous = last;
        }
        Ok(written)
    }

    fn sweep(&mut self, nodes: &[Node], stride: usize, rows: &mut [f64]) {
        match self.slopes {
            true => self.sweep_with::<true>(nodes, stride, rows),
            false => self.sweep_with::<false>(nodes, stride, rows),
        }
    }

    fn sweep_with<const SLOPES: bool>(&mut self, nodes: &[Node], stride: usize, rows: &mut [f64]) {
        let row_width = self.row_width();
        for (pack, state) in self.states.iter_mut().enumerate() {
            self.arch.dispatch(Block::<SLOPES> {
                constants: &self.constants[pack],
                inverse_locking: 1.0 / self.shape.locking,
                state,
                previous: self.previous,
                nodes,
                stride,
                first: !self.started,
                rows: &mut *rows,
                row_width,
                row_offset: pack * ROW,
            });
        }
    }

    fn sound(&self) -> bool {
        self.states.iter().all(|s| {
            s.0[LEAST].iter().all(|&q| q > 0.0)
                && s.0[..2]
                    .iter()
                    .flatten()
                    .all(|v| *v > -1.0 && v.is_finite())
        })
    }

    /// Repeats a failed block node by node: where it fails, and in which spring.
    fn find_lock(&mut self, nodes: &[Node], step_s: f64) -> Locked {
        let mut scratch = vec![0.0; 2 * self.row_width()];
        let mut at_s = self.time_s;
        self.sweep(&[], 1, &mut scratch);
        if self.sound() {
            self.started = true;
            for node in nodes {
                at_s += step_s;
                self.sweep(std::slice::from_ref(node), 1, &mut scratch);
                self.previous = *node;
                if !self.sound() {
                    break;
                }
            }
        }
        let locking = self.shape.locking;
        let mut found = Locked {
            spring: 1,
            invariant: f64::NAN,
            locking,
            at_s: Some(at_s),
        };
        for spring in 0..self.shape.springs() {
            let (state, lane) = (&self.states[spring / LANES].0, spring % LANES);
            if state[LEAST][lane] > 0.0 && state[0][lane].is_finite() {
                continue;
            }
            let [l1, l2] = self.previous.lambda_squared;
            let (a, b) = (l1 * state[0][lane], l2 * state[1][lane]);
            found.spring = spring + 1;
            found.invariant = a + b + 1.0 / (a * b) - 3.0;
            break;
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phi_functions_agree_across_the_switch() {
        for z in [1e-6_f64, 0.3, 0.999_999] {
            let (phi, slope) = phi_functions(z);
            assert!((phi[1] - (1.0 - (-z).exp()) / z).abs() < 1e-9);
            let h = 1e-5 * z.max(1e-3);
            for k in 0..4 {
                let difference =
                    (phi_functions(z + h).0[k] - phi_functions(z - h).0[k]) / (2.0 * h);
                assert!((difference - slope[k]).abs() < 1e-7, "{z} {k}");
            }
        }
        let (below, above) = (phi_functions(1.0 - 1e-12), phi_functions(1.0 + 1e-12));
        for k in 0..4 {
            assert!((below.0[k] - above.0[k]).abs() < 1e-11);
            assert!((below.1[k] - above.1[k]).abs() < 1e-11);
        }
    }
}
