import math

OK = 0
NO_VOLTAGE = 1  # no voltage holds the pose: a film_squared_v2 is negative, 0 V was taken
NO_COMMAND = 2  # no command makes the voltage on a film: that command is nan
OUT_OF_REACH = 3  # the mechanism cannot take the pose: the results are nan
SINGULAR = 4  # the actuators hold no force in one direction: voltages are nan
LOCKED = 5  # the film is at its locking stretch: the results are nan from here on

@DATA@

GRAVITY = 9.80665
NAN = float("nan")


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _left(x):
    return math.exp(-x)


def _mean(x):
    return 1.0 - 0.5 * x if x < 1e-6 else (1.0 - math.exp(-x)) / x


def _soft_plus(x):
    return x if x > 30.0 else 0.0 if x < -100.0 else math.log1p(math.exp(x))


def _sign(x):
    return -1.0 if x < 0.0 else 1.0


def _cell(knots, x):
    i = 0
    while i < len(knots) - 2 and knots[i + 1] <= x:
        i += 1
    return i


def _curve(knots, values, bend, x):
    """A natural cubic spline that stays at its ends beyond them."""
    x = min(max(x, knots[0]), knots[-1])
    i = _cell(knots, x)
    h = knots[i + 1] - knots[i]
    b = (x - knots[i]) / h
    a = 1.0 - b
    return (
        a * values[i]
        + b * values[i + 1]
        + (a * a * a - a) * h * h / 6.0 * bend[i]
        + (b * b * b - b) * h * h / 6.0 * bend[i + 1]
    )


def _forearm(x):
    """T(theta_FA): the same, going on straight beyond its ends."""
    knots, values, bend = MODEL["nodes_rad"], MODEL["torque_N_m"], MODEL["torque_bend"]
    inside = min(max(x, knots[0]), knots[-1])
    i = _cell(knots, inside)
    h = knots[i + 1] - knots[i]
    b = (inside - knots[i]) / h
    a = 1.0 - b
    slope = (
        (values[i + 1] - values[i]) / h
        + (1.0 - 3.0 * a * a) * h / 6.0 * bend[i]
        + (3.0 * b * b - 1.0) * h / 6.0 * bend[i + 1]
    )
    return _curve(knots, values, bend, inside) + slope * (x - inside)


class _Pose:
    """The pose of a chain; raises ValueError where it cannot take it."""

    def __init__(self, c, u):
        r0, r1 = c["radial"]
        nx = u[2]
        ny = c["base_radius"] - c["effector_radius"] - (u[0] * r0 + u[1] * r1)
        nz = u[0] * r1 - u[1] * r0
        n0, q = c["forearm"], c["bicep"]
        if not abs(nz) < n0:
            raise ValueError("forearm")
        np2 = n0 * n0 - nz * nz
        l2 = nx * nx + ny * ny
        length = math.sqrt(l2)
        cosine = (q * q + l2 - np2) / (2.0 * q * length)
        if not abs(cosine) <= 1.0:
            raise ValueError("bicep")
        sine = math.sqrt((1.0 - cosine) * (1.0 + cosine))
        cb = (nx * cosine - ny * sine) / length
        sb = (nx * sine + ny * cosine) / length
        turn = math.atan2(sb, cb)
        s1 = sb * c["input"][1] - cb * c["input"][0]
        c1 = cb * c["input"][1] + sb * c["input"][0]
        # the four-bar, Eq 11
        a, b, coupler, d = c["bar"]
        p0, p1 = a - b * c1, -b * s1
        pp = p0 * p0 + p1 * p1
        length = math.sqrt(pp)
        cosine = (coupler * coupler - d * d - pp) / (2.0 * d * length)
        if not abs(cosine) <= 1.0:
            raise ValueError("four-bar")
        sine = math.sqrt((1.0 - cosine) * (1.0 + cosine))
        sp = (p1 * cosine + p0 * sine) / length
        cp = (p0 * cosine - p1 * sine) / length
        w0, w1 = p0 + d * cp, p1 + d * sp
        sd = -(sp * c["dea"][1] + cp * c["dea"][0])
        cd = sp * c["dea"][0] - cp * c["dea"][1]
        theta = math.atan2(sd, cd)
        if not 0.0 < theta < math.pi:
            raise ValueError("lozenge")
        if cd < 0.0:
            half = math.sqrt(0.5 * (1.0 - cd))
            self.half = (half, 0.5 * sd / half)
        else:
            half = math.sqrt(0.5 * (1.0 + cd))
            self.half = (0.5 * sd / half, half)
        self.theta_b = turn + 2.0 * math.pi if turn < 0.0 else turn
        self.theta_dea = theta
        self.theta_fa = math.asin(nz / n0)
        self.lever = b * (-w0 * s1 + w1 * c1) / (d * (-w0 * sp + w1 * cp))
        self.sine_b = sb
        self.q = (q * cb, q * sb, 0.0)
        self.q_prime = (-q * sb, q * cb, 0.0)
        self.n = n = (self.q[0] - nx, self.q[1] - ny, -nz)
        pull = 1.0 / _dot(n, self.q_prime)
        self.db = [(-n[1] * r0 + n[2] * r1) * pull, (-n[1] * r1 - n[2] * r0) * pull, n[0] * pull]
        root = math.sqrt(np2)
        self.dfa = [r1 / root, -r0 / root, 0.0]
        self.ddea = [x * self.lever for x in self.db]

    def acceleration(self, c, rate, v, a):
        """theta_b'' along a motion."""
        r0, r1 = c["radial"]
        nv = (v[2], -(v[0] * r0 + v[1] * r1), v[0] * r1 - v[1] * r0)
        na = (a[2], -(a[0] * r0 + a[1] * r1), a[0] * r1 - a[1] * r0)
        swing = pull = 0.0
        for i in range(3):
            d = self.q_prime[i] * rate - nv[i]
            swing += d * d
            pull += self.n[i] * (self.q[i] * rate * rate + na[i])
        return (pull - swing) / _dot(self.n, self.q_prime)


class _Along:
    """One actuator at one sample."""

    next_v = previous_v = 0.0

    def after(self, recording, time_s):
        return self.recording > recording or (self.recording == recording and self.time_s >= time_s)


def _lagging(m, key, now, tau_s, x):
    """z of z' = (x - z)/tau, where x is straight between samples."""
    far, left = _mean(x.step_s / tau_s), _left(x.step_s / tau_s)
    if x.first:
        z = now
    else:
        z, before = m[key]
        z = left * z + (far - left) * before + (1.0 - far) * now
    m[key] = (z, now)
    return z


def _variable(name, m, key, x, phi):
    """A coordinate of a learnt term."""
    if name == "bicep angle":
        return x.theta_b[0]
    if name == "bicep rate":
        return x.theta_b[1]
    if name == "lozenge angle":
        return x.theta_dea
    if name == "area stretch":
        return x.area
    if name == "largest stretch so far":
        m[key] = x.area if x.first else max(m[key], x.area)
        return m[key]
    if name == "time in the series":
        return x.series_s
    if name == "voltage":
        return abs(phi)
    if name == "squared voltage":
        return phi * phi
    if name == "cubed voltage":
        return abs(phi) * phi * phi
    if name == "voltage rate":
        return (abs(phi) - _lagging(m, key, abs(phi), 0.02, x)) / 0.02
    return 1.0


def _sum(e, m, x, phi):
    """What a learnt term that is no force makes, in the unit of its place."""
    of, by = _variable(e["of"], m, "of", x, phi), _variable(e["by"], m, "by", x, phi)
    c, form = e["c"], e["form"]
    if form == "spline":
        return _curve(e["x"], c, e["bend"], of) * by
    if form == "presliding":
        d = 0.0 if x.first else of - m["last"]
        m["last"] = of
        z = [0.0] * len(c) if x.first else m["z"]
        m["z"] = [z + (_sign(d) - z) * (1.0 - math.exp(-abs(d) / w)) for z, w in zip(z, e["x"])]
        return sum(c * z for c, z in zip(c, m["z"]))
    if form == "lag":
        return sum(c[j] * _lagging(m, j, of, e["x"][j], x) for j in range(len(c))) * by
    if form == "wave":
        turn = 2.0 * math.pi * e["p"][0] * x.time_s
        return (c[0] * math.sin(turn) + c[1] * math.cos(turn)) * by
    return phi * (c[0] * x.next_v + c[1] * x.previous_v)  # neighbours


def _added(e, m, x, phi):
    """What it adds there: torque on theta_DEA, N m, or squared voltage, V^2."""
    s = _sum(e, m, x, phi)
    if e["at"] == "bicep":
        return s if e["electrical"] else s / x.lever
    if e["at"] == "film":
        return s / x.half if e["electrical"] else s
    return s * phi * phi if e["at"] == "capacitance" else s


def _symmetric(c, d):
    """A symmetric matrix (xx, yy, zz, xy, xz, yz) times a vector."""
    return [
        c[0] * d[0] + c[3] * d[1] + c[4] * d[2],
        c[3] * d[0] + c[1] * d[1] + c[5] * d[2],
        c[4] * d[0] + c[5] * d[1] + c[2] * d[2],
    ]


def _swing(omega, zeta, s, v):
    rate = s[1] - v
    return rate, -omega * omega * s[0] - 2.0 * zeta * omega * rate


def _swing_step(omega, zeta, step_s):
    """What counts of b, p and both speeds in a step of that swing: a column each."""
    parts = max(1, math.ceil(20.0 * omega * step_s * (1.0 + zeta)))
    h = step_s / parts
    columns = []
    for which in range(4):
        s = [float(which == 0), float(which == 1)]
        for part in range(parts):

            def speed(x):
                x = (part + x) / parts
                return (1.0 - x) * float(which == 2) + x * float(which == 3)

            def on(k, x):
                return [s[0] + x * h * k[0], s[1] + x * h * k[1]]

            k1 = _swing(omega, zeta, s, speed(0.0))
            k2 = _swing(omega, zeta, on(k1, 0.5), speed(0.5))
            k3 = _swing(omega, zeta, on(k2, 0.5), speed(0.5))
            k4 = _swing(omega, zeta, on(k3, 1.0), speed(1.0))
            s = [s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) for i in range(2)]
        columns.append(s)
    return columns


def _push(e, m, x):
    """The force of a learnt term on the end effector, N."""
    c, p, form = e["c"], e["p"], e["form"]
    if form == "potential":
        size = p[0] * p[0]
        f = [0.0] * 3
        for j, c in enumerate(c):
            d = [x.u[i] - e["x"][3 * j + i] for i in range(3)]
            each = c / size * math.exp(-0.5 * _dot(d, d) / size)
            f = [f[i] + each * d[i] for i in range(3)]
        return f
    if form == "ridge":
        size = _curve(e["x"], c, e["bend"], _dot(p, x.u))
        return [size * p[i] for i in range(3)]
    if form == "affine":
        more = _symmetric(c[3:], [x.u[i] - p[i] for i in range(3)])
        return [c[i] + more[i] for i in range(3)]
    if form == "drag":
        size = math.sqrt(_dot(x.v, x.v))
        return [(c[i] + c[3 + i] * size) * x.v[i] for i in range(3)]
    omega = 2.0 * math.pi * p[0]  # oscillator
    if x.first:
        m["step"] = _swing_step(omega, p[1], x.step_s)
        m["s"] = [[0.0, 0.0] for _ in range(3)]
    else:
        k = m["step"]
        for i in range(3):
            (b, q), was, now = m["s"][i], m["v"][i], x.v[i]
            m["s"][i] = [k[0][r] * b + k[1][r] * q + k[2][r] * was + k[3][r] * now for r in range(2)]
    m["v"] = list(x.v)
    return _symmetric(c, [-_swing(omega, p[1], m["s"][i], x.v[i])[1] for i in range(3)])


def _leak(p, x, phi):
    """The current through the leak over the one that phi would drive, and how that grows."""
    field = abs(phi) / 3000.0 * x.area / 1.2
    power = max(p[1], 2.0)
    share, loss = p[1] / power, p[0] / (1.0 - p[0])
    growing = loss * share * field**power
    return loss * (1.0 - share) + growing, power * growing


def _at_rest(p, x, phi):
    y = 1.0
    for _ in range(4):
        g, more = _leak(p, x, phi * y)
        y = max(y - (y * (1.0 + g) - 1.0) / (1.0 + g + more), 1e-3)
    return phi * y


def _charged(p, m, x, phi, ohm, rounds):
    """The voltage on a film that a wire feeds; how fast it is charged is 1/(R C)."""
    c1 = x.capacitance_f
    rate = 1.0 / (ohm * c1)
    if x.first:
        at = _at_rest(p, x, phi) if rounds else phi
        charge = c1 * at
    else:
        charge, before, c0, earlier = m["charge"]
        start, at = charge, charge / c0
        for _ in range(rounds + 1):
            k = 1.0 + _leak(p, x, at)[0] if rounds else 1.0
            z = k * x.step_s * 0.5 * (earlier + rate)
            left, mean = _left(z), _mean(z)
            charge = start * left + (c0 * before * (mean - left) + c1 * phi * (1.0 - mean)) / k
            at = charge / c1
    m["charge"] = (charge, phi, c1, rate)
    return at


_ELECTRICAL = (
    "series_resistance",
    "leakage",
    "amplifier_gain",
    "amplifier_deadband",
    "amplifier_saturation",
    "slew_limit",
    "dielectric_relaxation",
    "x_space_charge",
)


def _is_electrical(e):
    return e["electrical"] if e["kind"] == "learnt" else e["kind"] in _ELECTRICAL


def _electrical(e, m, x, phi):
    """From the voltage before an electrical cause to the one after it."""
    kind, p = e["kind"], e["p"]
    size = abs(phi)
    if kind == "series_resistance":
        ohm = p[0] * (x.area / 1.2) ** p[1]
        return _charged(p, m, x, phi, ohm, 0) if p[0] > 0.0 else phi
    if kind == "leakage":
        if p[0] == 0.0:
            return phi
        return _charged(p, m, x, phi, p[2], 3) if p[2] > 0.0 else _at_rest(p, x, phi)
    if kind == "amplifier_gain":
        return phi + p[0] * phi + p[1] * (1.0 - math.exp(-((phi / 50.0) ** 2))) * _sign(phi)
    if kind == "amplifier_deadband":
        if p[0] == 0.0:
            return phi
        return phi / (1.0 + math.exp(min(-(size - p[0]) / p[1], 700.0)))
    if kind == "amplifier_saturation":
        return _sign(phi) * (size - p[1] * _soft_plus((size - p[0]) / p[1]))
    if kind == "slew_limit":
        if not x.first:
            sign = _sign(m["last"]) if phi == 0.0 else _sign(phi)
            before = m["last"] * sign
            low, high = before - p[1] * x.step_s, before + p[0] * x.step_s
            phi = sign * min(max(sign * phi, low), high)
        m["last"] = phi
        return phi
    if kind == "dielectric_relaxation":
        square = (1.0 - p[0] - p[2]) * phi * phi
        for j, t in ((0, p[1]), (2, 15.0 * p[1])):
            psi = _lagging(m, j, phi, t, x)
            square += p[j] * psi * psi
        return phi if p[0] == 0.0 and p[2] == 0.0 else math.sqrt(max(square, 0.0))
    if kind == "x_space_charge":
        left, mean = _left(x.step_s / p[1]), _mean(x.step_s / p[1])
        held = 0.0
        if not x.first:
            held, before = m["held"]
            held = held * left + p[0] * (before * (mean - left) + phi * (1.0 - mean))
        m["held"] = (held, phi)
        return phi - held
    more = _added(e, m, x, phi)
    return phi if more == 0.0 else _sign(phi) * math.sqrt(max(phi * phi + more, 0.0))


def _capacitance(e, x):
    """What a cause multiplies 1/2 dC/d theta_DEA with."""
    kind, p = e["kind"], e["p"]
    if kind == "permittivity_stretch":
        y = x.area - 1.0
        return 1.0 - p[0] * (y - p[1] * y * y) - 0.5 * p[0] * (1.0 - 2.0 * p[1] * y) * x.area
    if kind == "electrode_failure" and x.after(p[2], p[1]):
        return 1.0 - p[0]
    return 1.0 / p[0] if kind == "actuator_asymmetry" else 1.0


def _stress(e, m, x):
    """What a cause multiplies the stress of the equilibrium spring and of the branches with."""
    kind, p = e["kind"], e["p"]
    if kind == "mullins_softening":
        a, b = x.stretch[0] ** 2, x.stretch[1] ** 2
        d = 1.0 - (a + b + 1.0 / (a * b) - 3.0) / MODEL["J"]
        w = -0.5 * MODEL["mu_Pa"][0] * MODEL["J"] * math.log(max(d, 1e-9))
        m["largest"] = w if x.first else max(m["largest"], w)
        return 1.0 - p[0] * math.erf((m["largest"] - w) / p[1]), 1.0
    if kind == "actuator_asymmetry":
        return p[0], p[0]
    if kind == "temperature_drift":
        t = x.series_s / p[2]
        both = 1.0 + p[0] * (1.0 - math.exp(-t)) + p[1] * (1.0 - math.exp(-4.0 * t))
        return both, both
    return 1.0, 1.0


def _creep(time_s, l, x):
    """d ln xi/dt of a neo-Hookean branch, and its stress over its modulus."""
    a, b = l[0] * math.exp(-2.0 * x[0]), l[1] * math.exp(-2.0 * x[1])
    c = 1.0 / (a * b)
    s = (a - c, b - c)
    rate = 1.0 / (3.0 * time_s)
    return (rate * (s[0] - 0.5 * s[1]), rate * (s[1] - 0.5 * s[0])), s


def _fast(p, l, x):
    """The same of one that flows the faster the more it carries; also how fast it relaxes."""
    rate, s = _creep(p[1], l, x)
    faster = (math.sqrt(s[0] * s[0] - s[0] * s[1] + s[1] * s[1]) / 0.1) ** (p[2] - 1.0)
    steep = 3.0 * l[0] * math.exp(-2.0 * x[0]) - 2.0 * s[0] + s[1]
    return (faster * rate[0], faster * rate[1]), s, faster / p[1] * p[2] * steep


def _torque(e, m, x):
    """The torque of a cause on theta_DEA, N m, positive where it opens the lozenge."""
    kind, p, c = e["kind"], e["p"], x.chain
    volume = c["films"] * c["l1"] * c["l2"] * c["l3"]
    l = (x.stretch[0] ** 2, x.stretch[1] ** 2)

    def pull(s):
        return -p[0] * volume * (s[0] * x.slope[0] + s[1] * x.slope[1])

    if kind == "electrode_stiffness":
        a, b = l[0] / (1.5 * 1.5), l[1] / (0.816496580927726 * 0.816496580927726)
        return pull((a - 1.0 / (a * b), b - 1.0 / (a * b)))
    if kind == "hinge_stiffness":
        d = x.theta_dea - p[1]
        return -p[0] * (d + p[2] * d * d * d)
    if kind == "slow_creep":
        if p[0] == 0.0:
            return 0.0
        if x.first:
            m["x"] = [0.0, 0.0]
            rest = p[2] + x.series_s
            steps = max(1, math.ceil(rest / 5.0))
            for _ in range(steps):
                rate, _s = _creep(p[1], l, m["x"])
                m["x"] = [m["x"][i] + rest / steps * rate[i] for i in range(2)]
        rate, s = _creep(p[1], l, m["x"])
        m["x"] = [m["x"][i] + x.step_s * rate[i] for i in range(2)]
        return pull(s)
    if kind == "joint_friction":
        z, angle = (0.0, x.theta_b[0]) if x.first else m["z"]
        d = x.theta_b[0] - angle
        level = 1.0 + p[2] * math.exp(-((d / x.step_s / 0.1) ** 2))
        z += (_sign(d) * level - z) * (1.0 - math.exp(-abs(d) / (p[1] * level)))
        m["z"] = (z, x.theta_b[0])
        return -p[0] * z / x.lever
    if kind == "joint_damping":
        return -p[0] * x.theta_b[1] / x.lever
    if kind == "end_stop":
        depth = p[2] * _soft_plus((x.theta_b[0] - p[0]) / p[2])
        return -p[1] * depth * max(1.0 + p[3] * x.theta_b[1], 0.0) / x.lever
    if kind == "actuator_mass":
        return -p[0] * (c["bicep"] * x.theta_b[2] - GRAVITY * math.sin(x.theta_b[0])) / x.lever
    if kind == "payload_change" and x.after(p[2], p[1]):
        return -p[0] * (_dot(x.force_lever, x.a) + x.force_lever[2] * GRAVITY)
    if kind == "x_electrode_viscosity":
        z = x.slope[0] * x.slope[0] + x.slope[1] * x.slope[1]
        return -p[0] * volume * z * x.theta_b[1] * x.lever
    if kind == "x_nonlinear_flow":
        if p[0] == 0.0:
            return 0.0
        if x.first:
            xi, before, left = [math.log(s) for s in x.stretch], l, 0.0
        else:
            (xi, before), left = m["x"], x.step_s
        while left > 0.0:
            on = 1.0 - left / x.step_s
            rate, _s, fast = _fast(p, [before[i] + on * (l[i] - before[i]) for i in range(2)], xi)
            h = min(left, max(0.1 / max(fast, 2.2250738585072014e-308), 1e-3 * x.step_s))
            on = 1.0 - (left - 0.5 * h) / x.step_s
            half = [xi[i] + 0.5 * h * rate[i] for i in range(2)]
            rate, _s, _f = _fast(p, [before[i] + on * (l[i] - before[i]) for i in range(2)], half)
            xi = [xi[i] + h * rate[i] for i in range(2)]
            left -= h
        m["x"] = (xi, l)
        return pull(_fast(p, l, xi)[1])
    if kind == "x_backlash":
        d = x.theta_b[0]
        s, first = (d, d) if x.first else m["s"]
        s = min(max(s, d - p[1]), d + p[1])
        m["s"] = (s, first)
        return -p[0] * (s - first) / x.lever
    if kind == "learnt" and not e["electrical"]:
        if e["at"] == "force":
            return _dot(_push(e, m, x), x.force_lever)
        return _added(e, m, x, 0.0)
    return 0.0


def _turned(w, v):
    """What v gains where it is turned by the vector w."""
    angle = math.sqrt(_dot(w, w))
    if angle == 0.0:
        return [0.0] * 3
    axis = [w / angle for w in w]
    once = _cross(axis, v)
    twice = _cross(axis, once)
    return [math.sin(angle) * once[i] + (1.0 - math.cos(angle)) * twice[i] for i in range(3)]


def _spring(rate, l, rest, w):
    """Stress over modulus and flow of a spring at w, and whether it is short of its locking stretch."""
    a, b = l[0] * w[0], l[1] * w[1]
    ab, j = a * b, 1.0 / MODEL["J"]
    abd = ab * (1.0 + 3.0 * j) - j * (ab * (a + b) + 1.0)
    inverse = 1.0 / (ab * abd) if ab * abd != 0.0 else NAN
    c, over_d = abd * inverse, ab * ab * inverse
    s = ((a - c) * over_d, (b - c) * over_d)
    flow = (
        rate * (w[0] - rest[0]) - rate / 3.0 * w[0] * (2.0 * s[0] - s[1]),
        rate * (w[1] - rest[1]) - rate / 3.0 * w[1] * (2.0 * s[1] - s[0]),
    )
    return s, flow, abd > 0.0


def _phi(z):
    """phi_0 .. phi_3 of z."""
    at_zero = (1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0)
    phi = [math.exp(-z)]
    for k in range(1, 4):
        if z < 1.0:
            term = value = at_zero[k]
            for j in range(1, 24):
                term *= -z / (j + k)
                value += term
            phi.append(value)
        else:
            phi.append((at_zero[k - 1] - phi[k - 1]) / z)
    return phi


class _Film:
    """The film of one chain."""

    def __init__(self, step_s):
        self.step_s = step_s
        self.stretch = None
        self.constants = []
        for t in MODEL["T_s"]:
            z = step_s / t
            phi = _phi(z)
            drive = (
                z * (phi[1] - 3.0 * phi[2] + 4.0 * phi[3]),
                z * (4.0 * phi[2] - 8.0 * phi[3]),
                z * (4.0 * phi[3] - phi[2]),
            )
            stage = (step_s * phi[1], step_s * phi[2], step_s * (phi[3] + 0.5 * phi[2]))
            self.constants.append((1.0 / t, phi[0], drive, stage))

    def torque(self, stretch, rate, lever):
        """Of the equilibrium spring and of the branches, N m, and whether none is locked."""
        first = self.stretch is None
        l = [s * s for s in stretch]
        rest = [1.0 / l[0], 1.0 / l[1]]
        if first:
            self.branches = [[rest, None, None] for _ in self.constants]
        else:
            bend = [(rate[i] - self.rate[i]) * self.step_s / 4.0 for i in range(2)]
            mid = [math.exp(bend[i]) / (self.stretch[i] * stretch[i]) for i in range(2)]
        s, _flow, whole = _spring(0.0, l, rest, (1.0, 1.0))
        mu = MODEL["mu_Pa"]
        out = [mu[0] * (lever[0] * s[0] + lever[1] * s[1]), 0.0]
        for n, (r, decay, drive, stage) in enumerate(self.constants):
            w, now, was = self.branches[n]
            if not first:
                change = [now[i] - was[i] for i in range(2)]
                w = [
                    decay * w[i]
                    + drive[0] * self.rest[i]
                    + drive[1] * mid[i]
                    + drive[2] * rest[i]
                    + stage[0] * now[i]
                    + stage[1] * change[i]
                    for i in range(2)
                ]
            s, flow, sound = _spring(r, l, rest, w)
            whole = whole and sound
            out[1] += mu[n + 1] * (lever[0] * s[0] + lever[1] * s[1])
            if first:
                now = flow
            else:
                w = [w[i] + stage[2] * (flow[i] - now[i] - change[i]) for i in range(2)]
            self.branches[n] = [w, flow, now]
        self.stretch, self.rate, self.rest = stretch, rate, rest
        return out, whole


def _told(e, m, x, wanted):
    """The voltage before an electrical cause that makes `wanted` after it: Chandrupatla's method, from a
    bracket as wide as twice what the cause takes where that holds it. Where none does, the end that comes
    nearer."""

    def left(told):
        return _electrical(e, dict(m), x, told) - wanted

    high = 20000.0
    low = 0.0 if e["kind"] == "dielectric_relaxation" or not e["remembers"] else -high
    b, fb = wanted, left(wanted)
    if fb == 0.0:
        return wanted
    a = min(max(b - 2.0 * fb, low), high)
    fa = left(a)
    if (fa < 0.0) == (fb < 0.0):
        a, b = high, low
        fa, fb = left(a), left(b)
        if fa <= 0.0 or fb >= 0.0:
            return a if abs(fa) < abs(fb) else b
    t = fa / (fa - fb)
    for _ in range(100):
        at = a + t * (b - a)
        f = left(at)
        if (f < 0.0) == (fa < 0.0):
            c, fc = a, fa
        else:
            c, b, fc, fb = b, a, fb, fa
        a, fa = at, f
        at = a if abs(fa) < abs(fb) else b
        least = (4.5e-16 * abs(at) + 1e-12) / abs(b - a)
        if fa == 0.0 or least > 0.5:
            return at
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        t = 0.5
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        t = min(max(t, least), 1.0 - least)
    return a if abs(fa) < abs(fb) else b


class Controller:
    """A stream of samples every `step_s` seconds, its films relaxed at the first.

    Take one for each stream. May be set: `payload_kg` before any call; before the first `recording` (number
    of this run in the series, for what happens at a moment), `series_s` (time of the first sample in the
    series, for what drifts), `start_s` (its time on its own clock) and `pivot_m` (the point about which the
    capture's axes are tilted). `status` says how the last call went: OK and the other words above.
    """

    def __init__(self, step_s):
        self.step_s = step_s
        self.payload_kg = 0.0
        self.recording = float(MODEL["recording"])
        self.series_s = self.start_s = 0.0
        self.pivot_m = [0.0, 0.0, 0.0]
        self.status = OK
        self._sample = 0
        self._locked = False
        self._films = [_Film(step_s) for _ in range(3)]
        self._memory = [[{}, {}, {}] for _ in EFFECTS]

    def _next(self, u_m, v_m_s, a_m_s2):
        """Takes the next sample; none where there is none yet that the mechanism can take, or no more."""
        if self._locked:
            self.status = LOCKED
            return None
        u, v, a = list(u_m), list(v_m_s), list(a_m_s2)
        for e in EFFECTS:
            if e["kind"] == "frame_tilt":
                u = [
                    u + d
                    for u, d in zip(u, _turned(e["p"], [u[i] - self.pivot_m[i] for i in range(3)]))
                ]
                v = [v + d for v, d in zip(v, _turned(e["p"], v))]
                a = [a + d for a, d in zip(a, _turned(e["p"], a))]
            elif e["kind"] == "marker_offset":
                u = [u - d for u, d in zip(u, e["p"])]
        try:
            self._poses = [_Pose(c, u) for c in CHAINS]
            reached = True
        except (ValueError, ZeroDivisionError):
            reached = False
            if self._sample == 0:
                self.status = OUT_OF_REACH
                return None
        poses = self._poses
        rows = [_cross(poses[(k + 1) % 3].ddea, poses[(k + 2) % 3].ddea) for k in range(3)]
        determinant = _dot(poses[0].ddea, rows[0])
        usable = False
        if reached and determinant != 0.0:
            rows = [[x / determinant for x in row] for row in rows]
            size = sum(_dot(p.ddea, p.ddea) for p in poses)
            usable = math.sqrt(size) * math.sqrt(sum(_dot(r, r) for r in rows)) < 1e3
        mass = MODEL["effector_kg"] + self.payload_kg
        all_three = []
        bicep_force = [0.0] * 3
        whole = True
        for k in range(3):
            c, p, x = CHAINS[k], poses[k], _Along()
            volume = c["films"] * c["l1"] * c["l2"] * c["l3"]
            x.chain, x.first, x.step_s = c, self._sample == 0, self.step_s
            x.time_s = self.start_s + self.step_s * self._sample
            x.series_s = self.series_s + self.step_s * self._sample
            x.recording = self.recording
            x.u, x.v, x.a = u, v, a
            x.theta_dea, x.lever = p.theta_dea, p.lever
            rate = _dot(p.db, v)
            x.theta_b = (p.theta_b, rate, p.acceleration(c, rate, v, a))
            x.force_lever = rows[k] if usable else [0.0] * 3
            s, co = p.half
            x.stretch = (2.0 * c["side"] / c["l1"] * s, 2.0 * c["side"] / c["l2"] * co)
            x.slope = (0.5 * co / s, -0.5 * s / co)
            x.area = x.stretch[0] * x.stretch[1]
            x.capacitance_f = MODEL["eps_F_m"] * c["films"] * c["l1"] * c["l2"] / c["l3"] * x.area * x.area
            x.half = x.capacitance_f * (x.slope[0] + x.slope[1])
            theta_rate = _dot(p.ddea, v) if reached else 0.0
            film, sound = self._films[k].torque(
                x.stretch, [g * theta_rate for g in x.slope], [g * volume for g in x.slope]
            )
            whole = whole and sound
            q = c["bicep"]
            bicep = MODEL["bicep_tip_kg"] * (q * q * x.theta_b[2] - GRAVITY * q * p.sine_b)
            bicep_force = [bicep_force[i] + bicep * p.db[i] for i in range(3)]
            x.load = 0.0
            if usable:
                weight = _dot(x.force_lever, a) + x.force_lever[2] * GRAVITY
                x.load = mass * weight + bicep / p.lever
            x.forearm = _forearm(p.theta_fa)
            x.made = x.half
            x.torque = 0.0
            for e, m in zip(EFFECTS, self._memory):
                if e["on"][k]:
                    x.made *= _capacitance(e, x)
                    factor = _stress(e, m[k], x)
                    film = [film[i] * factor[i] for i in range(2)]
                    x.torque += _torque(e, m[k], x)
            x.film = film[0] + film[1]
            all_three.append(x)
        self._sample += 1
        self._locked = self._locked or not whole
        self.status = OK
        if self._locked:
            self.status = LOCKED
        elif not reached:
            self.status = OUT_OF_REACH
        elif not usable:
            self.status = SINGULAR
        force = [mass * (a[i] + (GRAVITY if i == 2 else 0.0)) + bicep_force[i] for i in range(3)]
        return all_three, force

    def _command(self, k, x, film_v, last):
        """The command of one actuator that makes the voltage `film_v`; nan where none does."""
        told = film_v
        for e, m in reversed(list(zip(EFFECTS, self._memory))):
            if e["on"][k] and _is_electrical(e):
                wanted = 0.0 if math.isnan(told) else told
                found = _told(e, m[k], x, wanted)
                made = _electrical(e, m[k] if last else dict(m[k]), x, found)
                far = not abs(made - wanted) <= 2.0 + 2e-3 * wanted
                told = NAN if math.isnan(told) or far else found
        return told

    def voltage(self, u_m, v_m_s, a_m_s2):
        """f_ID: the next sample of a motion (m, m/s, m/s^2, world axes) to what the amplifiers have to be
        told, V, and the squares of the voltages that the films need, V^2, negative where none holds the
        pose."""
        taken = self._next(u_m, v_m_s, a_m_s2)
        squared, film_v = [NAN] * 3, [NAN] * 3
        if taken is None:
            return film_v, squared
        along, _force = taken
        if self.status == OK:
            for k, x in enumerate(along):
                needed = x.film + x.load - x.torque
                for p, other in zip(self._poses, along):
                    needed += _dot(x.force_lever, p.dfa) * other.forearm
                squared[k] = needed / x.made
                film_v[k] = math.sqrt(max(squared[k], 0.0))
            if min(squared) < 0.0:
                self.status = NO_VOLTAGE
        command = list(film_v)
        # what one actuator needs may depend on what the others are told
        rounds = 8 if any(e.get("form") == "neighbours" for e in EFFECTS) else 1
        for number in range(1, rounds + 1):
            before = list(command)
            for k, x in enumerate(along):
                x.next_v, x.previous_v = before[(k + 1) % 3], before[(k + 2) % 3]
                command[k] = self._command(k, x, film_v[k], number == rounds)
        if self.status == OK and any(math.isnan(c) for c in command):
            self.status = NO_COMMAND
        return command, squared

    def force(self, u_m, v_m_s, a_m_s2, command_v, squared_v2=None):
        """F_FP: the next sample of a motion and of the commands (V) to the force of the surroundings on the
        end effector, N, world axes. `squared_v2`: the mean square of each command over the step about the
        sample, V^2, where it changes within a step."""
        taken = self._next(u_m, v_m_s, a_m_s2)
        if taken is None or self.status in (OUT_OF_REACH, LOCKED):
            return [NAN] * 3
        along, force = taken
        for k, x in enumerate(along):
            told = film_v = command_v[k]
            x.next_v, x.previous_v = command_v[(k + 1) % 3], command_v[(k + 2) % 3]
            for e, m in zip(EFFECTS, self._memory):
                if e["on"][k] and _is_electrical(e):
                    film_v = _electrical(e, m[k], x, film_v)
            square = told * told if squared_v2 is None else squared_v2[k]
            net = x.made * (square + (film_v * film_v - told * told)) + x.torque - x.film
            p = self._poses[k]
            force = [force[i] + x.forearm * p.dfa[i] - net * p.ddea[i] for i in range(3)]
        return force


def _try():
    """Reads and writes what the program of the C export reads and writes."""
    import sys

    numbers = [float(word) for word in sys.stdin.read().split()]
    streams = Controller(numbers[0]), Controller(numbers[0])
    for s in streams:
        s.series_s, s.start_s, s.recording = numbers[1:4]
        s.pivot_m = numbers[4:7]
    inverse, forward = streams
    for at in range(7, len(numbers) - 15, 16):
        x = numbers[at : at + 16]
        inverse.payload_kg = forward.payload_kg = x[9]
        command, squared = inverse.voltage(x[0:3], x[3:6], x[6:9])
        force = forward.force(x[0:3], x[3:6], x[6:9], x[10:13], x[13:16])
        line = [*squared, *command, inverse.status, forward.status, *force]
        print(" ".join(repr(number) for number in line))


if __name__ == "__main__":
    _try()
