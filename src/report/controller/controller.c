/* ---- how to use it ------------------------------------------------------------------------------- */

/* What a call says. */
enum {
    DEACAL_OK = 0,
    DEACAL_NO_VOLTAGE = 1,   /* no voltage holds the pose: a film_squared_v2 is negative, 0 V was taken */
    DEACAL_NO_COMMAND = 2,   /* no command makes the voltage on a film: that command is NaN */
    DEACAL_OUT_OF_REACH = 3, /* the mechanism cannot take the pose: the results are NaN */
    DEACAL_SINGULAR = 4,     /* the actuators hold no force in one direction: voltages are NaN */
    DEACAL_LOCKED = 5        /* the film is at its locking stretch: the results are NaN until the next init */
};

/* One chain at one sample. */
typedef struct {
    double theta_b, lever, theta_dea, theta_fa;
    double sine_b, q[2], q_prime[2], n[3], half[2];
    double db[3], ddea[3], dfa[3];
} deacal_pose;

/* Everything that is carried from one sample to the next: one state for each stream of samples. */
typedef struct {
    double payload_kg;  /* on the end effector; may be set before any call */
    double recording;   /* number of this run in the series, for what happens at a moment */
    double series_s;    /* time of the first sample in the series, s, for what drifts */
    double start_s;     /* time of the first sample on its own clock, s */
    double pivot_m[3];  /* the point about which the capture's axes are tilted: the base marker */
    double step_s, sample;
    int locked;
    deacal_pose pose[3];
    double stretch[3][2], rate[3][2], rest[3][2];
    double w[3][DEACAL_BRANCHES + 1][2], flow[3][DEACAL_BRANCHES + 1][2];
    double before[3][DEACAL_BRANCHES + 1][2];
    double decay[DEACAL_BRANCHES + 1], drive[DEACAL_BRANCHES + 1][3], stage[DEACAL_BRANCHES + 1][3];
    double memory[DEACAL_MEMORY];
} deacal_state;

/* Begins a stream of samples every step_s seconds, its films relaxed at the first. Set what differs from
   the usual (payload_kg, recording, series_s, start_s, pivot_m) after this. */
void deacal_init(deacal_state *s, double step_s);

/* f_ID: the next sample of a motion (m, m/s, m/s^2, world axes) to the voltages. film_squared_v2: the
   square of the voltage that each film needs, V^2, negative where none holds the pose. command_v: what each
   amplifier has to be told, V. */
int deacal_voltage(deacal_state *s, const double u_m[3], const double v_m_s[3], const double a_m_s2[3],
                   double film_squared_v2[3], double command_v[3]);

/* F_FP: the next sample of a motion and of the commands (V) to the force of the surroundings on the end
   effector (N, world axes). squared_v2: the mean square of each command over the step about the sample,
   V^2, where it changes within a step; NULL takes the square of command_v. */
int deacal_force(deacal_state *s, const double u_m[3], const double v_m_s[3], const double a_m_s2[3],
                 const double command_v[3], const double *squared_v2, double force_n[3]);

#endif

#ifdef DEACAL_IMPLEMENTATION
#ifndef DEACAL_IMPLEMENTED
#define DEACAL_IMPLEMENTED

#include <math.h>
#include <stddef.h>

/* ---- the robot ----------------------------------------------------------------------------------- */

typedef struct {
    double radial[2];                   /* cosine and sine of the azimuth */
    double base_radius, effector_radius, bicep, forearm;
    double input[2], dea[2];            /* sine and cosine of both angles of the drawing */
    double bar[4];                      /* a, b, c, d */
    double side, l1, l2, l3, films;
} deacal_chain;

enum {
    DEACAL_SERIES_RESISTANCE, DEACAL_LEAKAGE, DEACAL_AMPLIFIER_GAIN, DEACAL_AMPLIFIER_DEADBAND,
    DEACAL_AMPLIFIER_SATURATION, DEACAL_SLEW_LIMIT, DEACAL_PERMITTIVITY_STRETCH,
    DEACAL_DIELECTRIC_RELAXATION, DEACAL_ELECTRODE_FAILURE, DEACAL_ELECTRODE_STIFFNESS,
    DEACAL_HINGE_STIFFNESS, DEACAL_MULLINS_SOFTENING, DEACAL_SLOW_CREEP, DEACAL_ACTUATOR_ASYMMETRY,
    DEACAL_TEMPERATURE_DRIFT, DEACAL_JOINT_FRICTION, DEACAL_JOINT_DAMPING, DEACAL_END_STOP,
    DEACAL_ACTUATOR_MASS, DEACAL_PAYLOAD_CHANGE, DEACAL_FRAME_TILT, DEACAL_MARKER_OFFSET,
    DEACAL_X_SPACE_CHARGE, DEACAL_X_ELECTRODE_VISCOSITY, DEACAL_X_NONLINEAR_FLOW, DEACAL_X_BACKLASH,
    DEACAL_LEARNT
};
enum { DEACAL_AT_BICEP, DEACAL_AT_FILM, DEACAL_AT_FORCE, DEACAL_AT_ELECTRICAL, DEACAL_AT_CAPACITANCE };
enum {
    DEACAL_SPLINE, DEACAL_PRESLIDING, DEACAL_LAG, DEACAL_WAVE, DEACAL_NEIGHBOURS, DEACAL_POTENTIAL,
    DEACAL_RIDGE, DEACAL_AFFINE, DEACAL_DRAG, DEACAL_OSCILLATOR
};
enum {
    DEACAL_NONE, DEACAL_BICEP_ANGLE, DEACAL_BICEP_RATE, DEACAL_LOZENGE_ANGLE, DEACAL_AREA_STRETCH,
    DEACAL_LARGEST_STRETCH, DEACAL_SERIES_TIME, DEACAL_VOLTAGE, DEACAL_SQUARED_VOLTAGE,
    DEACAL_CUBED_VOLTAGE, DEACAL_VOLTAGE_RATE
};

/* A cause. Of the learnt alone: where it acts, its form, its variables, its coefficients c, and what its
   form has beside them (p: numbers, x: knots, widths, times or centres, bend: second derivatives). */
typedef struct {
    int kind, on[3], memory, places;
    double p[4];
    int electrical, at, form, of, by, count;
    const double *c, *x, *bend;
} deacal_effect;

@DATA@
/* ---- small things -------------------------------------------------------------------------------- */

static const double deacal_turn = 6.283185307179586;

static double deacal_dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void deacal_cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double deacal_nothing(void)
{
    return nan("");
}

/* What is left of a state after x of its time constants, and its mean along the way. */
static double deacal_left(double x)
{
    return exp(-x);
}

static double deacal_mean(double x)
{
    return x < 1e-6 ? 1.0 - 0.5 * x : (1.0 - exp(-x)) / x;
}

static double deacal_soft_plus(double x)
{
    return x > 30.0 ? x : x < -100.0 ? 0.0 : log1p(exp(x));
}

/* The place of x among rising knots: the one before it. */
static int deacal_cell(const double *knots, int count, double x)
{
    int i = 0;
    while (i < count - 2 && knots[i + 1] <= x) {
        i++;
    }
    return i;
}

/* A natural cubic spline through values, with its second derivatives, that stays at its ends beyond them. */
static double deacal_curve(const double *knots, const double *values, const double *bend, int count, double x)
{
    double h, a, b;
    int i;
    x = x < knots[0] ? knots[0] : x > knots[count - 1] ? knots[count - 1] : x;
    i = deacal_cell(knots, count, x);
    h = knots[i + 1] - knots[i];
    b = (x - knots[i]) / h;
    a = 1.0 - b;
    return a * values[i] + b * values[i + 1] + (a * a * a - a) * h * h / 6.0 * bend[i]
           + (b * b * b - b) * h * h / 6.0 * bend[i + 1];
}

/* T(theta_FA): the same, going on straight beyond its ends. */
static double deacal_forearm(double x)
{
    const double *knots = deacal_nodes_rad, *value = deacal_torque_n_m, *bend = deacal_torque_bend;
    const int n = DEACAL_NODES;
    double inside = x < knots[0] ? knots[0] : x > knots[n - 1] ? knots[n - 1] : x;
    int i = deacal_cell(knots, n, inside);
    double h = knots[i + 1] - knots[i], b = (inside - knots[i]) / h, a = 1.0 - b;
    double slope = (value[i + 1] - value[i]) / h + (1.0 - 3.0 * a * a) * h / 6.0 * bend[i]
                   + (3.0 * b * b - 1.0) * h / 6.0 * bend[i + 1];
    return deacal_curve(knots, value, bend, n, inside) + slope * (x - inside);
}

/* ---- the mechanism ------------------------------------------------------------------------------- */

/* The pose of a chain; 0 where it cannot take it. */
static int deacal_pose_of(const deacal_chain *c, const double *u, deacal_pose *p)
{
    double r0 = c->radial[0], r1 = c->radial[1];
    double nx = u[2], ny = c->base_radius - c->effector_radius - (u[0] * r0 + u[1] * r1);
    double nz = u[0] * r1 - u[1] * r0, n0 = c->forearm, q = c->bicep;
    double np2 = n0 * n0 - nz * nz, l2 = nx * nx + ny * ny, l = sqrt(l2);
    double cosine, sine, cb, sb, turn, s1, c1, a, b, cc, d, p0, p1, pp, length, sp, cp, w0, w1;
    double in, out, sd, cd, theta, pull, lever;
    if (!(fabs(nz) < n0)) {
        return 0;
    }
    cosine = (q * q + l2 - np2) / (2.0 * q * l);
    if (!(fabs(cosine) <= 1.0)) {
        return 0;
    }
    sine = sqrt((1.0 - cosine) * (1.0 + cosine));
    cb = (nx * cosine - ny * sine) / l;
    sb = (nx * sine + ny * cosine) / l;
    turn = atan2(sb, cb);
    s1 = sb * c->input[1] - cb * c->input[0];
    c1 = cb * c->input[1] + sb * c->input[0];
    /* the four-bar, Eq 11 */
    a = c->bar[0];
    b = c->bar[1];
    cc = c->bar[2];
    d = c->bar[3];
    p0 = a - b * c1;
    p1 = -b * s1;
    pp = p0 * p0 + p1 * p1;
    length = sqrt(pp);
    cosine = (cc * cc - d * d - pp) / (2.0 * d * length);
    if (!(fabs(cosine) <= 1.0)) {
        return 0;
    }
    sine = sqrt((1.0 - cosine) * (1.0 + cosine));
    sp = (p1 * cosine + p0 * sine) / length;
    cp = (p0 * cosine - p1 * sine) / length;
    w0 = p0 + d * cp;
    w1 = p1 + d * sp;
    in = b * (-w0 * s1 + w1 * c1);
    out = d * (-w0 * sp + w1 * cp);
    sd = -(sp * c->dea[1] + cp * c->dea[0]);
    cd = sp * c->dea[0] - cp * c->dea[1];
    theta = atan2(sd, cd);
    if (!(theta > 0.0 && theta < 0.5 * deacal_turn)) {
        return 0;
    }
    if (cd < 0.0) {
        p->half[0] = sqrt(0.5 * (1.0 - cd));
        p->half[1] = 0.5 * sd / p->half[0];
    } else {
        p->half[1] = sqrt(0.5 * (1.0 + cd));
        p->half[0] = 0.5 * sd / p->half[1];
    }
    p->theta_b = turn < 0.0 ? turn + deacal_turn : turn;
    p->theta_dea = theta;
    p->theta_fa = asin(nz / n0);
    p->lever = in / out;
    p->sine_b = sb;
    p->q[0] = q * cb;
    p->q[1] = q * sb;
    p->q_prime[0] = -q * sb;
    p->q_prime[1] = q * cb;
    p->n[0] = p->q[0] - nx;
    p->n[1] = p->q[1] - ny;
    p->n[2] = -nz;
    lever = p->n[0] * p->q_prime[0] + p->n[1] * p->q_prime[1];
    pull = 1.0 / lever;
    p->db[0] = (-p->n[1] * r0 + p->n[2] * r1) * pull;
    p->db[1] = (-p->n[1] * r1 - p->n[2] * r0) * pull;
    p->db[2] = p->n[0] * pull;
    p->dfa[0] = r1 / sqrt(np2);
    p->dfa[1] = -r0 / sqrt(np2);
    p->dfa[2] = 0.0;
    p->ddea[0] = p->db[0] * p->lever;
    p->ddea[1] = p->db[1] * p->lever;
    p->ddea[2] = p->db[2] * p->lever;
    return 1;
}

/* theta_b'' along a motion. */
static double deacal_bicep_acceleration(const deacal_chain *c, const deacal_pose *p, double rate,
                                        const double *v, const double *a)
{
    double r0 = c->radial[0], r1 = c->radial[1], swing = 0.0, pull = 0.0;
    double nv[3], na[3], q[3], qp[3];
    int i;
    nv[0] = v[2];
    nv[1] = -(v[0] * r0 + v[1] * r1);
    nv[2] = v[0] * r1 - v[1] * r0;
    na[0] = a[2];
    na[1] = -(a[0] * r0 + a[1] * r1);
    na[2] = a[0] * r1 - a[1] * r0;
    q[0] = p->q[0];
    q[1] = p->q[1];
    q[2] = 0.0;
    qp[0] = p->q_prime[0];
    qp[1] = p->q_prime[1];
    qp[2] = 0.0;
    for (i = 0; i < 3; i++) {
        double d = qp[i] * rate - nv[i];
        swing += d * d;
        pull += p->n[i] * (q[i] * rate * rate + na[i]);
    }
    return (pull - swing) / deacal_dot(p->n, qp);
}

/* ---- causes -------------------------------------------------------------------------------------- */

/* One actuator at one sample. */
typedef struct {
    const deacal_chain *chain;
    int first;
    double step_s, time_s, series_s, recording;
    double theta_dea, theta_b[3], lever, force_lever[3];
    double stretch[2], slope[2], area, capacitance_f, half;
    const double *u, *v, *a;
    double next_v, previous_v;
} deacal_along;

static int deacal_after(const deacal_along *x, double recording, double time_s)
{
    return x->recording > recording || (x->recording == recording && x->time_s >= time_s);
}

/* z of z' = (x - z)/tau, where x is straight between samples; m: z and x at the sample before. */
static double deacal_lagging(double *m, double now, double tau_s, int first, double step_s)
{
    double x = step_s / tau_s, left = deacal_left(x), far = deacal_mean(x);
    m[0] = first ? now : left * m[0] + (far - left) * m[1] + (1.0 - far) * now;
    m[1] = now;
    return m[0];
}

/* A coordinate of a learnt term; m: two places. */
static double deacal_variable(int which, double *m, const deacal_along *x, double phi)
{
    switch (which) {
    case DEACAL_BICEP_ANGLE:
        return x->theta_b[0];
    case DEACAL_BICEP_RATE:
        return x->theta_b[1];
    case DEACAL_LOZENGE_ANGLE:
        return x->theta_dea;
    case DEACAL_AREA_STRETCH:
        return x->area;
    case DEACAL_LARGEST_STRETCH:
        m[0] = x->first || x->area > m[0] ? x->area : m[0];
        return m[0];
    case DEACAL_SERIES_TIME:
        return x->series_s;
    case DEACAL_VOLTAGE:
        return fabs(phi);
    case DEACAL_SQUARED_VOLTAGE:
        return phi * phi;
    case DEACAL_CUBED_VOLTAGE:
        return fabs(phi) * phi * phi;
    case DEACAL_VOLTAGE_RATE:
        return (fabs(phi) - deacal_lagging(m, fabs(phi), 0.02, x->first, x->step_s)) / 0.02;
    default:
        return 1.0;
    }
}

/* What a learnt term that is no force makes, in the unit of its place. */
static double deacal_sum(const deacal_effect *e, double *m, const deacal_along *x, double phi)
{
    double of = deacal_variable(e->of, m, x, phi), by = deacal_variable(e->by, m + 2, x, phi);
    double sum = 0.0, d;
    int j;
    switch (e->form) {
    case DEACAL_SPLINE:
        return deacal_curve(e->x, e->c, e->bend, e->count, of) * by;
    case DEACAL_PRESLIDING:
        d = x->first ? 0.0 : of - m[4];
        m[4] = of;
        for (j = 0; j < e->count; j++) {
            double z = x->first ? 0.0 : m[5 + j];
            z += ((d < 0.0 ? -1.0 : 1.0) - z) * (1.0 - exp(-fabs(d) / e->x[j]));
            m[5 + j] = z;
            sum += e->c[j] * z;
        }
        return sum;
    case DEACAL_LAG:
        for (j = 0; j < e->count; j++) {
            sum += e->c[j] * deacal_lagging(m + 4 + 2 * j, of, e->x[j], x->first, x->step_s);
        }
        return sum * by;
    case DEACAL_WAVE:
        d = deacal_turn * e->p[0] * x->time_s;
        return (e->c[0] * sin(d) + e->c[1] * cos(d)) * by;
    case DEACAL_NEIGHBOURS:
        return phi * (e->c[0] * x->next_v + e->c[1] * x->previous_v);
    default:
        return 0.0;
    }
}

/* What it adds there: torque on theta_DEA, N m, or squared voltage, V^2. */
static double deacal_added(const deacal_effect *e, double *m, const deacal_along *x, double phi)
{
    double sum = deacal_sum(e, m, x, phi);
    switch (e->at) {
    case DEACAL_AT_BICEP:
        return e->electrical ? sum : sum / x->lever;
    case DEACAL_AT_FILM:
        return e->electrical ? sum / x->half : sum;
    case DEACAL_AT_CAPACITANCE:
        return sum * phi * phi;
    default:
        return sum;
    }
}

/* Adds a symmetric matrix (xx, yy, zz, xy, xz, yz) times a vector. */
static void deacal_symmetric(const double *c, const double *d, double *f)
{
    f[0] += c[0] * d[0] + c[3] * d[1] + c[4] * d[2];
    f[1] += c[3] * d[0] + c[1] * d[1] + c[5] * d[2];
    f[2] += c[4] * d[0] + c[5] * d[1] + c[2] * d[2];
}

/* b' = p - v, p' = -omega^2 b - 2 zeta omega b'. */
static void deacal_swing(double omega, double zeta, const double *s, double v, double *rate)
{
    rate[0] = s[1] - v;
    rate[1] = -omega * omega * s[0] - 2.0 * zeta * omega * rate[0];
}

/* A step of that swing: two rows of what counts of b, p and both speeds. */
static void deacal_swing_step(double omega, double zeta, double step_s, double *row)
{
    double parts = ceil(20.0 * omega * step_s * (1.0 + zeta)), h, part;
    int which, i;
    parts = parts < 1.0 ? 1.0 : parts;
    h = step_s / parts;
    for (which = 0; which < 4; which++) {
        double s[2], t[2], k1[2], k2[2], k3[2], k4[2];
        double from = which == 2 ? 1.0 : 0.0, to = which == 3 ? 1.0 : 0.0;
        s[0] = which == 0 ? 1.0 : 0.0;
        s[1] = which == 1 ? 1.0 : 0.0;
        for (part = 0.0; part < parts; part += 1.0) {
            double x0 = part / parts, xm = (part + 0.5) / parts, x1 = (part + 1.0) / parts;
            deacal_swing(omega, zeta, s, (1.0 - x0) * from + x0 * to, k1);
            for (i = 0; i < 2; i++) {
                t[i] = s[i] + 0.5 * h * k1[i];
            }
            deacal_swing(omega, zeta, t, (1.0 - xm) * from + xm * to, k2);
            for (i = 0; i < 2; i++) {
                t[i] = s[i] + 0.5 * h * k2[i];
            }
            deacal_swing(omega, zeta, t, (1.0 - xm) * from + xm * to, k3);
            for (i = 0; i < 2; i++) {
                t[i] = s[i] + h * k3[i];
            }
            deacal_swing(omega, zeta, t, (1.0 - x1) * from + x1 * to, k4);
            for (i = 0; i < 2; i++) {
                s[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
        }
        row[which] = s[0];
        row[4 + which] = s[1];
    }
}

/* The force of a learnt term on the end effector, N. */
static void deacal_push(const deacal_effect *e, double *m, const deacal_along *x, double *f)
{
    double d[3], size, omega;
    int i, j;
    for (i = 0; i < 3; i++) {
        f[i] = 0.0;
    }
    switch (e->form) {
    case DEACAL_POTENTIAL:
        size = e->p[0] * e->p[0];
        for (j = 0; j < e->count; j++) {
            double each;
            for (i = 0; i < 3; i++) {
                d[i] = x->u[i] - e->x[3 * j + i];
            }
            each = e->c[j] / size * exp(-0.5 * deacal_dot(d, d) / size);
            for (i = 0; i < 3; i++) {
                f[i] += each * d[i];
            }
        }
        break;
    case DEACAL_RIDGE:
        size = deacal_curve(e->x, e->c, e->bend, e->count, deacal_dot(e->p, x->u));
        for (i = 0; i < 3; i++) {
            f[i] = size * e->p[i];
        }
        break;
    case DEACAL_AFFINE:
        for (i = 0; i < 3; i++) {
            d[i] = x->u[i] - e->p[i];
            f[i] = e->c[i];
        }
        deacal_symmetric(e->c + 3, d, f);
        break;
    case DEACAL_DRAG:
        size = sqrt(deacal_dot(x->v, x->v));
        for (i = 0; i < 3; i++) {
            f[i] = (e->c[i] + e->c[3 + i] * size) * x->v[i];
        }
        break;
    case DEACAL_OSCILLATOR:
        /* m: two states and the last speed of each axis, then the step */
        omega = deacal_turn * e->p[0];
        if (x->first) {
            deacal_swing_step(omega, e->p[1], x->step_s, m + 9);
        }
        for (i = 0; i < 3; i++) {
            double *s = m + 3 * i, rate[2];
            const double *row = m + 9;
            if (x->first) {
                s[0] = 0.0;
                s[1] = 0.0;
            } else {
                double b = s[0], p = s[1];
                s[0] = row[0] * b + row[1] * p + row[2] * s[2] + row[3] * x->v[i];
                s[1] = row[4] * b + row[5] * p + row[6] * s[2] + row[7] * x->v[i];
            }
            s[2] = x->v[i];
            deacal_swing(omega, e->p[1], s, x->v[i], rate);
            d[i] = -rate[1];
        }
        deacal_symmetric(e->c, d, f);
        break;
    default:
        break;
    }
}

/* The current through the leak over the one that phi would drive through the wire, and how that grows. */
static void deacal_leak(const deacal_effect *e, const deacal_along *x, double phi, double out[2])
{
    double field = fabs(phi) / 3000.0 * x->area / 1.2, power = e->p[1] < 2.0 ? 2.0 : e->p[1];
    double share = e->p[1] / power, loss = e->p[0] / (1.0 - e->p[0]);
    double growing = loss * share * pow(field, power);
    out[0] = loss * (1.0 - share) + growing;
    out[1] = power * growing;
}

/* What is left of a command that is held. */
static double deacal_at_rest(const deacal_effect *e, const deacal_along *x, double phi)
{
    double y = 1.0, g[2];
    int i;
    for (i = 0; i < 4; i++) {
        deacal_leak(e, x, phi * y, g);
        y -= (y * (1.0 + g[0]) - 1.0) / (1.0 + g[0] + g[1]);
        y = y < 1e-3 ? 1e-3 : y;
    }
    return phi * y;
}

/* The voltage on a film that a wire feeds; m: charge, command and capacitance at the sample before. */
static double deacal_charged(const deacal_effect *e, double *m, const deacal_along *x, double phi,
                             double ohm, int rounds)
{
    double c1 = x->capacitance_f, rate = 1.0 / (ohm * c1);
    if (x->first) {
        double first = rounds > 0 ? deacal_at_rest(e, x, phi) : phi;
        m[0] = c1 * first;
        m[1] = phi;
        m[2] = c1;
        m[3] = rate;
        return first;
    } else {
        double c0 = m[2], at = m[0] / c0, next = 0.0, g[2];
        int i;
        for (i = 0; i <= rounds; i++) {
            double k = 1.0, z, decay, mean;
            if (rounds > 0) {
                deacal_leak(e, x, at, g);
                k += g[0];
            }
            z = k * x->step_s * 0.5 * (m[3] + rate);
            decay = deacal_left(z);
            mean = deacal_mean(z);
            next = m[0] * decay + (c0 * m[1] * (mean - decay) + c1 * phi * (1.0 - mean)) / k;
            at = next / c1;
        }
        m[0] = next;
        m[1] = phi;
        m[2] = c1;
        m[3] = rate;
        return next / c1;
    }
}

static int deacal_is_electrical(const deacal_effect *e)
{
    switch (e->kind) {
    case DEACAL_SERIES_RESISTANCE:
    case DEACAL_LEAKAGE:
    case DEACAL_AMPLIFIER_GAIN:
    case DEACAL_AMPLIFIER_DEADBAND:
    case DEACAL_AMPLIFIER_SATURATION:
    case DEACAL_SLEW_LIMIT:
    case DEACAL_DIELECTRIC_RELAXATION:
    case DEACAL_X_SPACE_CHARGE:
        return 1;
    case DEACAL_LEARNT:
        return e->electrical;
    default:
        return 0;
    }
}

/* From the voltage before an electrical cause to the one after it. */
static double deacal_electrical(const deacal_effect *e, double *m, const deacal_along *x, double phi)
{
    double sign = phi < 0.0 ? -1.0 : 1.0, size = fabs(phi), square, before, low, high, left, mean, ohm;
    int j;
    switch (e->kind) {
    case DEACAL_SERIES_RESISTANCE:
        ohm = e->p[0] * pow(x->area / 1.2, e->p[1]);
        return e->p[0] > 0.0 ? deacal_charged(e, m, x, phi, ohm, 0) : phi;
    case DEACAL_LEAKAGE:
        if (e->p[0] == 0.0) {
            return phi;
        }
        return e->p[2] > 0.0 ? deacal_charged(e, m, x, phi, e->p[2], 3) : deacal_at_rest(e, x, phi);
    case DEACAL_AMPLIFIER_GAIN:
        return phi + e->p[0] * phi + e->p[1] * (1.0 - exp(-(phi / 50.0) * (phi / 50.0))) * sign;
    case DEACAL_AMPLIFIER_DEADBAND:
        return e->p[0] == 0.0 ? phi : phi / (1.0 + exp(-(size - e->p[0]) / e->p[1]));
    case DEACAL_AMPLIFIER_SATURATION:
        return sign * (size - e->p[1] * deacal_soft_plus((size - e->p[0]) / e->p[1]));
    case DEACAL_SLEW_LIMIT:
        if (!x->first) {
            sign = phi == 0.0 ? (m[0] < 0.0 ? -1.0 : 1.0) : sign;
            before = m[0] * sign;
            low = before - e->p[1] * x->step_s;
            high = before + e->p[0] * x->step_s;
            size = sign * phi;
            phi = sign * (size < low ? low : size > high ? high : size);
        }
        m[0] = phi;
        return phi;
    case DEACAL_DIELECTRIC_RELAXATION:
        square = (1.0 - e->p[0] - e->p[2]) * phi * phi;
        for (j = 0; j < 2; j++) {
            double t = j == 0 ? e->p[1] : 15.0 * e->p[1];
            double psi = deacal_lagging(m + 2 * j, phi, t, x->first, x->step_s);
            square += e->p[2 * j] * psi * psi;
        }
        return e->p[0] == 0.0 && e->p[2] == 0.0 ? phi : sqrt(square > 0.0 ? square : 0.0);
    case DEACAL_X_SPACE_CHARGE:
        left = deacal_left(x->step_s / e->p[1]);
        mean = deacal_mean(x->step_s / e->p[1]);
        m[0] = x->first ? 0.0 : m[0] * left + e->p[0] * (m[1] * (mean - left) + phi * (1.0 - mean));
        m[1] = phi;
        return phi - m[0];
    default:
        square = deacal_added(e, m, x, phi);
        if (square == 0.0) {
            return phi;
        }
        square += phi * phi;
        return sign * sqrt(square > 0.0 ? square : 0.0);
    }
}

/* What a cause multiplies 1/2 dC/d theta_DEA with. */
static double deacal_capacitance(const deacal_effect *e, const deacal_along *x)
{
    double y = x->area - 1.0;
    switch (e->kind) {
    case DEACAL_PERMITTIVITY_STRETCH:
        return 1.0 - e->p[0] * (y - e->p[1] * y * y) - 0.5 * e->p[0] * (1.0 - 2.0 * e->p[1] * y) * x->area;
    case DEACAL_ELECTRODE_FAILURE:
        return deacal_after(x, e->p[2], e->p[1]) ? 1.0 - e->p[0] : 1.0;
    case DEACAL_ACTUATOR_ASYMMETRY:
        return 1.0 / e->p[0];
    default:
        return 1.0;
    }
}

/* What a cause multiplies the stress of the equilibrium spring and of the branches with. */
static void deacal_stress(const deacal_effect *e, double *m, const deacal_along *x, double factor[2])
{
    double a, b, d, w, t, change;
    switch (e->kind) {
    case DEACAL_MULLINS_SOFTENING:
        a = x->stretch[0] * x->stretch[0];
        b = x->stretch[1] * x->stretch[1];
        d = 1.0 - (a + b + 1.0 / (a * b) - 3.0) / deacal_locking;
        w = -0.5 * deacal_mu_pa[0] * deacal_locking * log(d > 1e-9 ? d : 1e-9);
        m[0] = x->first || w > m[0] ? w : m[0];
        factor[0] *= 1.0 - e->p[0] * erf((m[0] - w) / e->p[1]);
        break;
    case DEACAL_ACTUATOR_ASYMMETRY:
        factor[0] *= e->p[0];
        factor[1] *= e->p[0];
        break;
    case DEACAL_TEMPERATURE_DRIFT:
        t = x->series_s / e->p[2];
        change = e->p[0] * (1.0 - exp(-t)) + e->p[1] * (1.0 - exp(-4.0 * t));
        factor[0] *= 1.0 + change;
        factor[1] *= 1.0 + change;
        break;
    default:
        break;
    }
}

/* d ln xi/dt of a neo-Hookean branch, and its stress over its modulus. */
static void deacal_creep(double time_s, const double *l, const double *x, double *rate, double *s)
{
    double a = l[0] * exp(-2.0 * x[0]), b = l[1] * exp(-2.0 * x[1]), c = 1.0 / (a * b);
    s[0] = a - c;
    s[1] = b - c;
    rate[0] = (s[0] - 0.5 * s[1]) / (3.0 * time_s);
    rate[1] = (s[1] - 0.5 * s[0]) / (3.0 * time_s);
}

/* The same of one that flows the faster the more it carries; also the rate with which it relaxes. */
static double deacal_fast(const deacal_effect *e, const double *l, const double *x, double *rate, double *s)
{
    double faster, steep;
    deacal_creep(e->p[1], l, x, rate, s);
    faster = pow(sqrt(s[0] * s[0] - s[0] * s[1] + s[1] * s[1]) / 0.1, e->p[2] - 1.0);
    steep = 3.0 * l[0] * exp(-2.0 * x[0]) - 2.0 * s[0] + s[1];
    rate[0] *= faster;
    rate[1] *= faster;
    return faster / e->p[1] * e->p[2] * steep;
}

/* The torque of a cause on theta_DEA, N m, positive where it opens the lozenge. */
static double deacal_torque(const deacal_effect *e, double *m, const deacal_along *x)
{
    const deacal_chain *chain = x->chain;
    double volume = chain->films * chain->l1 * chain->l2 * chain->l3, g = 9.80665;
    double l[2], s[2], rate[2], d, z, rest, steps, step, left, fast, depth, push;
    int i;
    l[0] = x->stretch[0] * x->stretch[0];
    l[1] = x->stretch[1] * x->stretch[1];
    switch (e->kind) {
    case DEACAL_ELECTRODE_STIFFNESS: {
        double a = l[0] / (1.5 * 1.5), b = l[1] / (0.816496580927726 * 0.816496580927726);
        double c = 1.0 / (a * b);
        return -e->p[0] * volume * ((a - c) * x->slope[0] + (b - c) * x->slope[1]);
    }
    case DEACAL_HINGE_STIFFNESS:
        d = x->theta_dea - e->p[1];
        return -e->p[0] * (d + e->p[2] * d * d * d);
    case DEACAL_SLOW_CREEP:
        if (e->p[0] == 0.0) {
            return 0.0;
        }
        if (x->first) {
            m[0] = 0.0;
            m[1] = 0.0;
            rest = e->p[2] + x->series_s;
            steps = ceil(rest / 5.0);
            steps = steps < 1.0 ? 1.0 : steps;
            for (step = 0.0; step < steps; step += 1.0) {
                deacal_creep(e->p[1], l, m, rate, s);
                m[0] += rest / steps * rate[0];
                m[1] += rest / steps * rate[1];
            }
        }
        deacal_creep(e->p[1], l, m, rate, s);
        m[0] += x->step_s * rate[0];
        m[1] += x->step_s * rate[1];
        return -e->p[0] * volume * (s[0] * x->slope[0] + s[1] * x->slope[1]);
    case DEACAL_JOINT_FRICTION:
        if (x->first) {
            m[0] = 0.0;
        } else {
            double level;
            d = x->theta_b[0] - m[1];
            rest = d / x->step_s / 0.1;
            level = 1.0 + e->p[2] * exp(-rest * rest);
            m[0] += ((d < 0.0 ? -1.0 : 1.0) * level - m[0]) * (1.0 - exp(-fabs(d) / (e->p[1] * level)));
        }
        m[1] = x->theta_b[0];
        return -e->p[0] * m[0] / x->lever;
    case DEACAL_JOINT_DAMPING:
        return -e->p[0] * x->theta_b[1] / x->lever;
    case DEACAL_END_STOP:
        depth = e->p[2] * deacal_soft_plus((x->theta_b[0] - e->p[0]) / e->p[2]);
        push = 1.0 + e->p[3] * x->theta_b[1];
        return push > 0.0 ? -e->p[1] * depth * push / x->lever : 0.0;
    case DEACAL_ACTUATOR_MASS:
        return -e->p[0] * (chain->bicep * x->theta_b[2] - g * sin(x->theta_b[0])) / x->lever;
    case DEACAL_PAYLOAD_CHANGE:
        if (!deacal_after(x, e->p[2], e->p[1])) {
            return 0.0;
        }
        return -e->p[0] * (deacal_dot(x->force_lever, x->a) + x->force_lever[2] * g);
    case DEACAL_X_ELECTRODE_VISCOSITY:
        z = x->slope[0] * x->slope[0] + x->slope[1] * x->slope[1];
        return -e->p[0] * volume * z * x->theta_b[1] * x->lever;
    case DEACAL_X_NONLINEAR_FLOW:
        /* m: ln xi, and the squared stretches at the sample before */
        if (e->p[0] == 0.0) {
            return 0.0;
        }
        if (x->first) {
            m[0] = log(x->stretch[0]);
            m[1] = log(x->stretch[1]);
            m[2] = l[0];
            m[3] = l[1];
        }
        left = x->first ? 0.0 : x->step_s;
        while (left > 0.0) {
            double at[2], half[2], h, on = 1.0 - left / x->step_s;
            for (i = 0; i < 2; i++) {
                at[i] = m[2 + i] + on * (l[i] - m[2 + i]);
            }
            fast = deacal_fast(e, at, m, rate, s);
            h = 0.1 / (fast > 2.2250738585072014e-308 ? fast : 2.2250738585072014e-308);
            h = h < 1e-3 * x->step_s ? 1e-3 * x->step_s : h;
            h = h > left ? left : h;
            on = 1.0 - (left - 0.5 * h) / x->step_s;
            for (i = 0; i < 2; i++) {
                half[i] = m[i] + 0.5 * h * rate[i];
                at[i] = m[2 + i] + on * (l[i] - m[2 + i]);
            }
            deacal_fast(e, at, half, rate, s);
            m[0] += h * rate[0];
            m[1] += h * rate[1];
            left -= h;
        }
        m[2] = l[0];
        m[3] = l[1];
        deacal_fast(e, l, m, rate, s);
        return -e->p[0] * volume * (s[0] * x->slope[0] + s[1] * x->slope[1]);
    case DEACAL_X_BACKLASH:
        /* m: where the play is, and where it was at first */
        d = x->theta_b[0];
        if (x->first) {
            m[0] = d;
            m[1] = d;
        }
        m[0] = m[0] < d - e->p[1] ? d - e->p[1] : m[0];
        m[0] = m[0] > d + e->p[1] ? d + e->p[1] : m[0];
        return -e->p[0] * (m[0] - m[1]) / x->lever;
    case DEACAL_LEARNT:
        if (e->electrical) {
            return 0.0;
        }
        if (e->at == DEACAL_AT_FORCE) {
            double f[3];
            deacal_push(e, m, x, f);
            return deacal_dot(f, x->force_lever);
        }
        return deacal_added(e, m, x, 0.0);
    default:
        return 0.0;
    }
}

/* Adds v turned by the vector w, less v. */
static void deacal_turned(const double *w, const double *v, double *to)
{
    double angle = sqrt(deacal_dot(w, w)), axis[3], once[3], twice[3];
    int i;
    if (angle == 0.0) {
        return;
    }
    for (i = 0; i < 3; i++) {
        axis[i] = w[i] / angle;
    }
    deacal_cross(axis, v, once);
    deacal_cross(axis, once, twice);
    for (i = 0; i < 3; i++) {
        to[i] += sin(angle) * once[i] + (1.0 - cos(angle)) * twice[i];
    }
}

/* Changes what was read of the motion back to the true one. */
static void deacal_reading(const deacal_state *s, double *u, double *v, double *a)
{
    int j, i;
    for (j = 0; j < DEACAL_EFFECTS; j++) {
        const deacal_effect *e = &deacal_effects[j];
        if (e->kind == DEACAL_FRAME_TILT) {
            double arm[3], vel[3], acc[3];
            for (i = 0; i < 3; i++) {
                arm[i] = u[i] - s->pivot_m[i];
                vel[i] = v[i];
                acc[i] = a[i];
            }
            deacal_turned(e->p, arm, u);
            deacal_turned(e->p, vel, v);
            deacal_turned(e->p, acc, a);
        } else if (e->kind == DEACAL_MARKER_OFFSET) {
            for (i = 0; i < 3; i++) {
                u[i] -= e->p[i];
            }
        }
    }
}

/* ---- the film ------------------------------------------------------------------------------------ */

/* Stress over modulus and flow of a spring at w; 0 at its locking stretch. */
static int deacal_spring(double rate, const double *l, const double *rest, const double *w, double *s,
                         double *flow)
{
    double a = l[0] * w[0], b = l[1] * w[1], ab = a * b, j = 1.0 / deacal_locking;
    double abd = ab * (1.0 + 3.0 * j) - j * (ab * (a + b) + 1.0), inverse = 1.0 / (ab * abd);
    double c = abd * inverse, over_d = ab * ab * inverse;
    s[0] = (a - c) * over_d;
    s[1] = (b - c) * over_d;
    flow[0] = rate * (w[0] - rest[0]) - rate / 3.0 * w[0] * (2.0 * s[0] - s[1]);
    flow[1] = rate * (w[1] - rest[1]) - rate / 3.0 * w[1] * (2.0 * s[1] - s[0]);
    return abd > 0.0;
}

/* phi_0 .. phi_3 of z. */
static void deacal_phi(double z, double phi[4])
{
    static const double at_zero[4] = {1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0};
    int k, j;
    phi[0] = exp(-z);
    for (k = 1; k < 4; k++) {
        if (z < 1.0) {
            double term = at_zero[k];
            phi[k] = term;
            for (j = 1; j < 24; j++) {
                term *= -z / (double)(j + k);
                phi[k] += term;
            }
        } else {
            phi[k] = (at_zero[k - 1] - phi[k - 1]) / z;
        }
    }
}

/* The torque of the film of a chain over one step, N m: equilibrium spring, branches. 0 where it locks. */
static int deacal_film(deacal_state *s, int k, const double *stretch, const double *rate, const double *lever,
                       double out[2])
{
    double l[2], rest[2], mid[2], one[2], flow[2], stress[2];
    int i, n, whole, first = s->sample == 0.0;
    for (i = 0; i < 2; i++) {
        l[i] = stretch[i] * stretch[i];
        rest[i] = 1.0 / l[i];
        one[i] = 1.0;
        mid[i] = first ? 0.0
                       : exp((rate[i] - s->rate[k][i]) * s->step_s / 4.0) / (s->stretch[k][i] * stretch[i]);
    }
    whole = deacal_spring(0.0, l, rest, one, stress, flow);
    out[0] = deacal_mu_pa[0] * (lever[0] * stress[0] + lever[1] * stress[1]);
    out[1] = 0.0;
    for (n = 0; n < DEACAL_BRANCHES; n++) {
        double *w = s->w[k][n], *now = s->flow[k][n], *was = s->before[k][n], change[2] = {0.0, 0.0};
        double r = 1.0 / deacal_relaxation_s[n];
        const double *drive = s->drive[n], *stage = s->stage[n];
        for (i = 0; i < 2; i++) {
            if (first) {
                w[i] = rest[i];
            } else {
                change[i] = now[i] - was[i];
                w[i] = s->decay[n] * w[i] + drive[0] * s->rest[k][i] + drive[1] * mid[i] + drive[2] * rest[i]
                       + stage[0] * now[i] + stage[1] * change[i];
            }
        }
        whole = deacal_spring(r, l, rest, w, stress, flow) && whole;
        out[1] += deacal_mu_pa[n + 1] * (lever[0] * stress[0] + lever[1] * stress[1]);
        for (i = 0; i < 2; i++) {
            if (first) {
                was[i] = flow[i];
            } else {
                w[i] += stage[2] * (flow[i] - now[i] - change[i]);
                was[i] = now[i];
            }
            now[i] = flow[i];
        }
    }
    for (i = 0; i < 2; i++) {
        s->rest[k][i] = rest[i];
        s->stretch[k][i] = stretch[i];
        s->rate[k][i] = rate[i];
    }
    return whole;
}

/* ---- the balance --------------------------------------------------------------------------------- */

/* All that both predictions are made of, at one sample. */
typedef struct {
    int reached, usable, whole;
    double u[3], v[3], a[3];
    double film[3], torque[3], load[3], half[3], forearm[3], inverse[3][3];
    double bicep_force[3], mass;
    deacal_along along[3];
} deacal_balance;

static double *deacal_memory_of(deacal_state *s, const deacal_effect *e, int k)
{
    return s->memory + e->memory + k * e->places;
}

/* Takes the next sample; 0 where there is none yet that the mechanism can take, or no more. */
static int deacal_next(deacal_state *s, const double *u_m, const double *v_m_s, const double *a_m_s2,
                       deacal_balance *b)
{
    deacal_pose pose[3];
    double g = 9.80665, determinant, size = 0.0, inverse_size = 0.0;
    int k, i, j;
    if (s->locked) {
        return 0;
    }
    for (i = 0; i < 3; i++) {
        b->u[i] = u_m[i];
        b->v[i] = v_m_s[i];
        b->a[i] = a_m_s2[i];
    }
    deacal_reading(s, b->u, b->v, b->a);
    b->reached = 1;
    for (k = 0; k < 3; k++) {
        b->reached = deacal_pose_of(&deacal_chains[k], b->u, &pose[k]) && b->reached;
    }
    if (!b->reached && s->sample == 0.0) {
        return 0;
    }
    for (k = 0; k < 3; k++) {
        if (b->reached) {
            s->pose[k] = pose[k];
        } else {
            pose[k] = s->pose[k];
        }
    }
    for (k = 0; k < 3; k++) {
        deacal_cross(pose[(k + 1) % 3].ddea, pose[(k + 2) % 3].ddea, b->inverse[k]);
    }
    determinant = deacal_dot(pose[0].ddea, b->inverse[0]);
    for (k = 0; k < 3; k++) {
        for (i = 0; i < 3; i++) {
            b->inverse[k][i] /= determinant;
        }
        size += deacal_dot(pose[k].ddea, pose[k].ddea);
        inverse_size += deacal_dot(b->inverse[k], b->inverse[k]);
    }
    b->usable = b->reached && sqrt(size) * sqrt(inverse_size) < 1e3;
    b->mass = deacal_effector_kg + s->payload_kg;
    b->whole = 1;
    for (i = 0; i < 3; i++) {
        b->bicep_force[i] = 0.0;
    }
    for (k = 0; k < 3; k++) {
        const deacal_chain *c = &deacal_chains[k];
        const deacal_pose *p = &pose[k];
        deacal_along *x = &b->along[k];
        double film[2], rate[2], lever[2], factor[2] = {1.0, 1.0};
        double volume = c->films * c->l1 * c->l2 * c->l3, q = c->bicep, bicep, half, theta_rate;
        x->chain = c;
        x->first = s->sample == 0.0;
        x->step_s = s->step_s;
        x->time_s = s->start_s + s->step_s * s->sample;
        x->series_s = s->series_s + s->step_s * s->sample;
        x->recording = s->recording;
        x->u = b->u;
        x->v = b->v;
        x->a = b->a;
        x->next_v = 0.0;
        x->previous_v = 0.0;
        x->theta_dea = p->theta_dea;
        x->theta_b[0] = p->theta_b;
        x->theta_b[1] = deacal_dot(p->db, b->v);
        x->theta_b[2] = deacal_bicep_acceleration(c, p, x->theta_b[1], b->v, b->a);
        x->lever = p->lever;
        for (i = 0; i < 3; i++) {
            x->force_lever[i] = b->usable ? b->inverse[k][i] : 0.0;
        }
        x->stretch[0] = 2.0 * c->side / c->l1 * p->half[0];
        x->stretch[1] = 2.0 * c->side / c->l2 * p->half[1];
        x->slope[0] = 0.5 * p->half[1] / p->half[0];
        x->slope[1] = -0.5 * p->half[0] / p->half[1];
        x->area = x->stretch[0] * x->stretch[1];
        x->capacitance_f = deacal_eps_f_m * c->films * c->l1 * c->l2 / c->l3 * x->area * x->area;
        x->half = x->capacitance_f * (x->slope[0] + x->slope[1]);
        theta_rate = b->reached ? deacal_dot(p->ddea, b->v) : 0.0;
        for (i = 0; i < 2; i++) {
            rate[i] = x->slope[i] * theta_rate;
            lever[i] = x->slope[i] * volume;
        }
        b->whole = deacal_film(s, k, x->stretch, rate, lever, film) && b->whole;
        bicep = deacal_bicep_tip_kg * (q * q * x->theta_b[2] - g * q * p->sine_b);
        for (i = 0; i < 3; i++) {
            b->bicep_force[i] += bicep * p->db[i];
        }
        b->load[k] = b->usable ? b->mass * (deacal_dot(x->force_lever, b->a) + x->force_lever[2] * g)
                                     + bicep / p->lever
                               : 0.0;
        b->forearm[k] = deacal_forearm(p->theta_fa);
        b->torque[k] = 0.0;
        half = x->half;
        for (j = 0; j < DEACAL_EFFECTS; j++) {
            const deacal_effect *e = &deacal_effects[j];
            if (e->on[k]) {
                double *m = deacal_memory_of(s, e, k);
                half *= deacal_capacitance(e, x);
                deacal_stress(e, m, x, factor);
                b->torque[k] += deacal_torque(e, m, x);
            }
        }
        b->film[k] = film[0] * factor[0] + film[1] * factor[1];
        b->half[k] = half;
    }
    s->sample += 1.0;
    s->locked = s->locked || !b->whole;
    return 1;
}

/* ---- from the voltage on a film back to the command ---------------------------------------------- */

static double deacal_try(const deacal_effect *e, const double *m, const deacal_along *x, double told)
{
    double copy[DEACAL_LARGEST];
    int i;
    for (i = 0; i < e->places; i++) {
        copy[i] = m[i];
    }
    return deacal_electrical(e, copy, x, told);
}

/* The voltage before an electrical cause that makes `wanted` after it: Chandrupatla's method, from a bracket
   as wide as twice what the cause takes where that holds it. Where none does, the end that comes nearer. */
static double deacal_told(const deacal_effect *e, const double *m, const deacal_along *x, double wanted)
{
    double high = 20000.0, low = e->places == 0 || e->kind == DEACAL_DIELECTRIC_RELAXATION ? 0.0 : -high;
    double b = wanted, fb = deacal_try(e, m, x, b) - wanted, a = b - 2.0 * fb, fa, c, fc, t;
    int i;
    if (fb == 0.0) {
        return wanted;
    }
    a = a < low ? low : a > high ? high : a;
    fa = deacal_try(e, m, x, a) - wanted;
    if ((fa < 0.0) == (fb < 0.0)) {
        a = high;
        b = low;
        fa = deacal_try(e, m, x, a) - wanted;
        fb = deacal_try(e, m, x, b) - wanted;
        if (fa <= 0.0 || fb >= 0.0) {
            return fabs(fa) < fabs(fb) ? a : b;
        }
    }
    t = fa / (fa - fb);
    for (i = 0; i < 100; i++) {
        double x_t = a + t * (b - a), f = deacal_try(e, m, x, x_t) - wanted;
        double xi, phi, least, at;
        if ((f < 0.0) == (fa < 0.0)) {
            c = a;
            fc = fa;
        } else {
            c = b;
            b = a;
            fc = fb;
            fb = fa;
        }
        a = x_t;
        fa = f;
        at = fabs(fa) < fabs(fb) ? a : b;
        least = (4.5e-16 * fabs(at) + 1e-12) / fabs(b - a);
        if (fa == 0.0 || least > 0.5) {
            return at;
        }
        xi = (a - b) / (c - b);
        phi = (fa - fb) / (fc - fb);
        if (phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi) {
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb);
        } else {
            t = 0.5;
        }
        t = t < least ? least : t > 1.0 - least ? 1.0 - least : t;
    }
    return fabs(fa) < fabs(fb) ? a : b;
}

/* The command of one actuator that makes the voltage `film_v`; NaN where none does. */
static double deacal_command(deacal_state *s, int k, const deacal_along *x, double film_v, int last)
{
    double told = film_v;
    int j;
    for (j = DEACAL_EFFECTS - 1; j >= 0; j--) {
        const deacal_effect *e = &deacal_effects[j];
        if (e->on[k] && deacal_is_electrical(e)) {
            double *m = deacal_memory_of(s, e, k), wanted = isnan(told) ? 0.0 : told, made;
            double found = deacal_told(e, m, x, wanted);
            made = last ? deacal_electrical(e, m, x, found) : deacal_try(e, m, x, found);
            told = isnan(told) || !(fabs(made - wanted) <= 2.0 + 2e-3 * wanted) ? deacal_nothing() : found;
        }
    }
    return told;
}

/* ---- what a controller calls --------------------------------------------------------------------- */

void deacal_init(deacal_state *s, double step_s)
{
    static const deacal_state none;
    int n;
    *s = none;
    s->recording = DEACAL_RECORDING;
    s->step_s = step_s;
    for (n = 0; n < DEACAL_BRANCHES; n++) {
        double z = step_s / deacal_relaxation_s[n], phi[4];
        deacal_phi(z, phi);
        s->decay[n] = phi[0];
        s->drive[n][0] = z * (phi[1] - 3.0 * phi[2] + 4.0 * phi[3]);
        s->drive[n][1] = z * (4.0 * phi[2] - 8.0 * phi[3]);
        s->drive[n][2] = z * (4.0 * phi[3] - phi[2]);
        s->stage[n][0] = step_s * phi[1];
        s->stage[n][1] = step_s * phi[2];
        s->stage[n][2] = step_s * (phi[3] + 0.5 * phi[2]);
    }
}

static int deacal_status(const deacal_state *s, const deacal_balance *b)
{
    if (s->locked) {
        return DEACAL_LOCKED;
    }
    return !b->reached ? DEACAL_OUT_OF_REACH : !b->usable ? DEACAL_SINGULAR : DEACAL_OK;
}

int deacal_voltage(deacal_state *s, const double u_m[3], const double v_m_s[3], const double a_m_s2[3],
                   double film_squared_v2[3], double command_v[3])
{
    deacal_balance b;
    double film_v[3], before[3];
    int k, j, round, rounds = 1, status;
    for (k = 0; k < 3; k++) {
        film_squared_v2[k] = command_v[k] = deacal_nothing();
    }
    if (!deacal_next(s, u_m, v_m_s, a_m_s2, &b)) {
        return s->locked ? DEACAL_LOCKED : DEACAL_OUT_OF_REACH;
    }
    status = deacal_status(s, &b);
    for (k = 0; k < 3; k++) {
        double needed = b.film[k] + b.load[k] - b.torque[k], squared;
        for (j = 0; j < 3; j++) {
            if (b.usable) {
                needed += deacal_dot(b.inverse[k], s->pose[j].dfa) * b.forearm[j];
            }
        }
        squared = needed / b.half[k];
        if (status == DEACAL_OK || status == DEACAL_NO_VOLTAGE) {
            film_squared_v2[k] = squared;
            status = squared < 0.0 ? DEACAL_NO_VOLTAGE : status;
        }
        film_v[k] = isnan(film_squared_v2[k]) ? deacal_nothing() : squared > 0.0 ? sqrt(squared) : 0.0;
        command_v[k] = film_v[k];
    }
    for (j = 0; j < DEACAL_EFFECTS; j++) {
        if (deacal_effects[j].kind == DEACAL_LEARNT && deacal_effects[j].form == DEACAL_NEIGHBOURS) {
            rounds = 8; /* what one actuator needs depends on what the others are told */
        }
    }
    for (round = 1; round <= rounds; round++) {
        for (k = 0; k < 3; k++) {
            before[k] = command_v[k];
        }
        for (k = 0; k < 3; k++) {
            b.along[k].next_v = before[(k + 1) % 3];
            b.along[k].previous_v = before[(k + 2) % 3];
            command_v[k] = deacal_command(s, k, &b.along[k], film_v[k], round == rounds);
        }
    }
    for (k = 0; k < 3; k++) {
        if (status == DEACAL_OK && isnan(command_v[k])) {
            status = DEACAL_NO_COMMAND;
        }
    }
    return status;
}

int deacal_force(deacal_state *s, const double u_m[3], const double v_m_s[3], const double a_m_s2[3],
                 const double command_v[3], const double *squared_v2, double force_n[3])
{
    deacal_balance b;
    int k, j, i;
    for (i = 0; i < 3; i++) {
        force_n[i] = deacal_nothing();
    }
    if (!deacal_next(s, u_m, v_m_s, a_m_s2, &b)) {
        return s->locked ? DEACAL_LOCKED : DEACAL_OUT_OF_REACH;
    }
    if (!b.reached || s->locked) {
        return deacal_status(s, &b);
    }
    for (i = 0; i < 3; i++) {
        force_n[i] = b.mass * (b.a[i] + (i == 2 ? 9.80665 : 0.0)) + b.bicep_force[i];
    }
    for (k = 0; k < 3; k++) {
        double told = command_v[k], film_v = told, squared = told * told, net;
        b.along[k].next_v = command_v[(k + 1) % 3];
        b.along[k].previous_v = command_v[(k + 2) % 3];
        for (j = 0; j < DEACAL_EFFECTS; j++) {
            const deacal_effect *e = &deacal_effects[j];
            if (e->on[k] && deacal_is_electrical(e)) {
                film_v = deacal_electrical(e, deacal_memory_of(s, e, k), &b.along[k], film_v);
            }
        }
        if (squared_v2 != NULL) {
            squared = squared_v2[k];
        }
        net = b.half[k] * (squared + (film_v * film_v - told * told)) + b.torque[k] - b.film[k];
        for (i = 0; i < 3; i++) {
            force_n[i] += b.forearm[k] * s->pose[k].dfa[i] - net * s->pose[k].ddea[i];
        }
    }
    return deacal_status(s, &b);
}

#endif
#endif

/* ---- a program to try it ------------------------------------------------------------------------- */

/* cc -std=c99 -O2 -DDEACAL_IMPLEMENTATION -DDEACAL_PROGRAM -x c THIS_FILE -lm -o try
   Reads lines of numbers: first step_s, series_s, start_s, recording and the pivot's x, y, z; then a line a
   sample: u, v, a (x, y, z each), payload_kg, three commands in V, three mean squares of them in V^2. Writes
   a line a sample: three film_squared_v2, three command_v, status of both, three force_n; and says the time
   of a call. */
#if defined(DEACAL_PROGRAM) && defined(DEACAL_IMPLEMENTATION)
#include <stdio.h>
#include <time.h>

#define DEACAL_MOST 5000

static double deacal_samples[DEACAL_MOST][16];

static void deacal_begin(deacal_state *s, const double *first)
{
    int i;
    deacal_init(s, first[0]);
    s->series_s = first[1];
    s->start_s = first[2];
    s->recording = first[3];
    for (i = 0; i < 3; i++) {
        s->pivot_m[i] = first[4 + i];
    }
}

int main(void)
{
    static deacal_state inverse, forward;
    double first[7], squared[3], command[3], force[3], spent, longest = 0.0;
    int count = 0, i, j, repeats = 0;
    clock_t from;
    for (i = 0; i < 7; i++) {
        if (scanf("%lf", &first[i]) != 1) {
            fprintf(stderr, "the first line has no seven numbers\n");
            return 1;
        }
    }
    while (count < DEACAL_MOST) {
        for (j = 0; j < 16; j++) {
            if (scanf("%lf", &deacal_samples[count][j]) != 1) {
                break;
            }
        }
        if (j < 16) {
            break;
        }
        count++;
    }
    if (count == 0) {
        fprintf(stderr, "there is no sample\n");
        return 1;
    }
    deacal_begin(&inverse, first);
    deacal_begin(&forward, first);
    for (i = 0; i < count; i++) {
        const double *x = deacal_samples[i];
        int a, b;
        inverse.payload_kg = forward.payload_kg = x[9];
        a = deacal_voltage(&inverse, x, x + 3, x + 6, squared, command);
        b = deacal_force(&forward, x, x + 3, x + 6, x + 10, x + 13, force);
        printf("%.17g %.17g %.17g ", squared[0], squared[1], squared[2]);
        printf("%.17g %.17g %.17g ", command[0], command[1], command[2]);
        printf("%d %d %.17g %.17g %.17g\n", a, b, force[0], force[1], force[2]);
    }
    from = clock();
    do {
        clock_t begun = clock();
        deacal_begin(&inverse, first);
        for (i = 0; i < count; i++) {
            const double *x = deacal_samples[i];
            inverse.payload_kg = x[9];
            deacal_voltage(&inverse, x, x + 3, x + 6, squared, command);
        }
        spent = (double)(clock() - begun) / CLOCKS_PER_SEC;
        longest = spent > longest ? spent : longest;
        repeats++;
        spent = (double)(clock() - from) / CLOCKS_PER_SEC;
    } while (spent < 0.1);
    fprintf(stderr, "deacal_voltage: %.2f us a call on average, %.2f us in the slowest of %d passes\n",
            1e6 * spent / repeats / count, 1e6 * longest / count, repeats);
    from = clock();
    repeats = 0;
    do {
        deacal_begin(&forward, first);
        for (i = 0; i < count; i++) {
            const double *x = deacal_samples[i];
            forward.payload_kg = x[9];
            deacal_force(&forward, x, x + 3, x + 6, x + 10, x + 13, force);
        }
        repeats++;
        spent = (double)(clock() - from) / CLOCKS_PER_SEC;
    } while (spent < 0.1);
    fprintf(stderr, "deacal_force: %.2f us a call on average\n", 1e6 * spent / repeats / count);
    return 0;
}
#endif
