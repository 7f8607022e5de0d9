function [state, a, b, c] = @NAME@(what, varargin)
% What a controller needs of a robot: f_ID and F_FP, sample by sample.
%
%   state = @NAME@('init', step_s)
%       begins a stream of samples every step_s seconds, its films relaxed at the first. Fields that may be
%       set: payload_kg before any call; before the first: recording (number of this run in the series, for
%       what happens at a moment), series_s (time of the first sample in the series, for what drifts),
%       start_s (its time on its own clock), pivot_m (the point about which the capture's axes are tilted).
%   [state, command_v, film_squared_v2, status] = @NAME@('voltage', state, u_m, v_m_s, a_m_s2)
%       f_ID: the next sample of a motion (world axes) to what the amplifiers have to be told, V, and the
%       squares of the voltages that the films need, V^2, negative where none holds the pose.
%   [state, force_n, status] = @NAME@('force', state, u_m, v_m_s, a_m_s2, command_v, squared_v2)
%       F_FP: the next sample of a motion and of the commands to the force of the surroundings on the end
%       effector. squared_v2 may be left out: the mean square of each command over the step about the sample,
%       where it changes within a step.
%
% status: 0 all is well; 1 no voltage holds the pose, 0 V was taken; 2 no command makes the voltage on a film,
% it is NaN; 3 out of reach, the results are NaN; 4 the actuators hold no force in one direction, voltages are
% NaN; 5 the film is at its locking stretch, the results are NaN from here on.
  switch what
    case 'init'
      state = begin_stream(varargin{1});
    case 'voltage'
      [state, a, b, c] = to_voltage(varargin{:});
    case 'force'
      [state, a, b] = to_force(varargin{:});
    otherwise
      error('the first argument is init, voltage or force');
  end
end

@DATA@

function state = begin_stream(step_s)
  [m, chains, effects] = model();
  state = struct('payload_kg', 0, 'recording', m.recording, 'series_s', 0, 'start_s', 0, 'pivot_m', [0 0 0]);
  state.step_s = step_s;
  state.sample = 0;
  state.locked = false;
  state.m = m;
  state.chains = chains;
  state.effects = effects;
  state.memory = cell(numel(effects), 3);
  for j = 1:numel(state.memory)
    state.memory{j} = struct();
  end
  state.poses = cell(1, 3);
  n = numel(m.T_s);
  film = struct('decay', zeros(1, n), 'drive', zeros(3, n), 'stage', zeros(3, n));
  for k = 1:n
    z = step_s / m.T_s(k);
    phi = phi_functions(z);
    film.decay(k) = phi(1);
    film.drive(:, k) = z * [phi(2) - 3 * phi(3) + 4 * phi(4); 4 * phi(3) - 8 * phi(4); 4 * phi(4) - phi(3)];
    film.stage(:, k) = step_s * [phi(2); phi(3); phi(4) + 0.5 * phi(3)];
  end
  state.film = film;
  state.branches = cell(1, 3);
end

function s = sign_of(x)
  s = 1 - 2 * (x < 0);
end

function y = mean_of(x)
  if x < 1e-6
    y = 1 - 0.5 * x;
  else
    y = (1 - exp(-x)) / x;
  end
end

function y = soft_plus(x)
  if x > 30
    y = x;
  elseif x < -100
    y = 0;
  else
    y = log1p(exp(x));
  end
end

function c = cross_of(a, b)
  c = [a(2) * b(3) - a(3) * b(2), a(3) * b(1) - a(1) * b(3), a(1) * b(2) - a(2) * b(1)];
end

function phi = phi_functions(z)
  at_zero = [1, 1, 1 / 2, 1 / 6];
  phi = [exp(-z), 0, 0, 0];
  for k = 1:3
    if z < 1
      term = at_zero(k + 1);
      value = term;
      for j = 1:23
        term = -term * z / (j + k);
        value = value + term;
      end
      phi(k + 1) = value;
    else
      phi(k + 1) = (at_zero(k) - phi(k)) / z;
    end
  end
end

% A natural cubic spline that stays at its ends beyond them; and its slope where it ends or is inside.
function [y, slope, inside] = curve(knots, values, bend, x)
  n = numel(knots);
  inside = min(max(x, knots(1)), knots(n));
  i = min(max(sum(knots <= inside), 1), n - 1);
  h = knots(i + 1) - knots(i);
  b = (inside - knots(i)) / h;
  a = 1 - b;
  y = a * values(i) + b * values(i + 1) + (a * a * a - a) * h * h / 6 * bend(i) ...
      + (b * b * b - b) * h * h / 6 * bend(i + 1);
  slope = (values(i + 1) - values(i)) / h + (1 - 3 * a * a) * h / 6 * bend(i) ...
          + (3 * b * b - 1) * h / 6 * bend(i + 1);
end

% The pose of a chain; whether it can take it.
function [p, reached] = pose_of(c, u)
  p = struct();
  reached = false;
  r0 = c.radial(1);
  r1 = c.radial(2);
  nx = u(3);
  ny = c.base_radius - c.effector_radius - (u(1) * r0 + u(2) * r1);
  nz = u(1) * r1 - u(2) * r0;
  n0 = c.forearm;
  q = c.bicep;
  if ~(abs(nz) < n0)
    return
  end
  np2 = n0 * n0 - nz * nz;
  l2 = nx * nx + ny * ny;
  len = sqrt(l2);
  cosine = (q * q + l2 - np2) / (2 * q * len);
  if ~(abs(cosine) <= 1)
    return
  end
  sine = sqrt((1 - cosine) * (1 + cosine));
  cb = (nx * cosine - ny * sine) / len;
  sb = (nx * sine + ny * cosine) / len;
  turn = atan2(sb, cb);
  s1 = sb * c.input(2) - cb * c.input(1);
  c1 = cb * c.input(2) + sb * c.input(1);
  % the four-bar, Eq 11
  b = c.bar(2);
  d = c.bar(4);
  p0 = c.bar(1) - b * c1;
  p1 = -b * s1;
  pp = p0 * p0 + p1 * p1;
  len = sqrt(pp);
  cosine = (c.bar(3) * c.bar(3) - d * d - pp) / (2 * d * len);
  if ~(abs(cosine) <= 1)
    return
  end
  sine = sqrt((1 - cosine) * (1 + cosine));
  sp = (p1 * cosine + p0 * sine) / len;
  cp = (p0 * cosine - p1 * sine) / len;
  w0 = p0 + d * cp;
  w1 = p1 + d * sp;
  sd = -(sp * c.dea(2) + cp * c.dea(1));
  cd = sp * c.dea(1) - cp * c.dea(2);
  theta = atan2(sd, cd);
  if ~(theta > 0 && theta < pi)
    return
  end
  if cd < 0
    half = sqrt(0.5 * (1 - cd));
    p.half = [half, 0.5 * sd / half];
  else
    half = sqrt(0.5 * (1 + cd));
    p.half = [0.5 * sd / half, half];
  end
  p.theta_b = turn + 2 * pi * (turn < 0);
  p.theta_dea = theta;
  p.theta_fa = asin(nz / n0);
  p.lever = b * (-w0 * s1 + w1 * c1) / (d * (-w0 * sp + w1 * cp));
  p.sine_b = sb;
  p.q = [q * cb, q * sb, 0];
  p.q_prime = [-q * sb, q * cb, 0];
  n = [p.q(1) - nx, p.q(2) - ny, -nz];
  p.n = n;
  p.db = [-n(2) * r0 + n(3) * r1, -n(2) * r1 - n(3) * r0, n(1)] / (n(1) * p.q_prime(1) + n(2) * p.q_prime(2));
  p.dfa = [r1, -r0, 0] / sqrt(np2);
  p.ddea = p.db * p.lever;
  reached = true;
end

% theta_b'' along a motion.
function y = acceleration(c, p, rate, v, a)
  r0 = c.radial(1);
  r1 = c.radial(2);
  nv = [v(3), -(v(1) * r0 + v(2) * r1), v(1) * r1 - v(2) * r0];
  na = [a(3), -(a(1) * r0 + a(2) * r1), a(1) * r1 - a(2) * r0];
  d = p.q_prime * rate - nv;
  y = (sum(p.n .* (p.q * rate * rate + na)) - sum(d .* d)) / sum(p.n .* p.q_prime);
end

function yes = after(x, recording, time_s)
  yes = x.recording > recording || (x.recording == recording && x.time_s >= time_s);
end

% z of z' = (x - z)/tau, where x is straight between samples; m: z and x at the sample before.
function [z, m] = lagging(m, now, tau_s, x)
  if x.first
    z = now;
  else
    left = exp(-x.step_s / tau_s);
    far = mean_of(x.step_s / tau_s);
    z = left * m(1) + (far - left) * m(2) + (1 - far) * now;
  end
  m = [z, now];
end

% A coordinate of a learnt term.
function [y, m] = variable(name, m, key, x, phi)
  switch name
    case 'bicep angle'
      y = x.theta_b(1);
    case 'bicep rate'
      y = x.theta_b(2);
    case 'lozenge angle'
      y = x.theta_dea;
    case 'area stretch'
      y = x.area;
    case 'largest stretch so far'
      y = x.area;
      if ~x.first
        y = max(y, m.(key));
      end
      m.(key) = y;
    case 'time in the series'
      y = x.series_s;
    case 'voltage'
      y = abs(phi);
    case 'squared voltage'
      y = phi * phi;
    case 'cubed voltage'
      y = abs(phi) * phi * phi;
    case 'voltage rate'
      if x.first
        m.(key) = [0, 0];
      end
      [z, m.(key)] = lagging(m.(key), abs(phi), 0.02, x);
      y = (abs(phi) - z) / 0.02;
    otherwise
      y = 1;
  end
end

% What a learnt term that is no force makes, in the unit of its place.
function [s, m] = sum_of(e, m, x, phi)
  [of, m] = variable(e.of, m, 'of', x, phi);
  [by, m] = variable(e.by, m, 'by', x, phi);
  c = e.c;
  switch e.form
    case 'spline'
      s = curve(e.x, c, e.bend, of) * by;
    case 'presliding'
      if x.first
        m.last = of;
        m.z = zeros(1, numel(c));
      end
      d = of - m.last;
      m.last = of;
      m.z = m.z + (sign_of(d) - m.z) .* (1 - exp(-abs(d) ./ e.x));
      s = sum(c .* m.z);
    case 'lag'
      if x.first
        m.lag = zeros(numel(c), 2);
      end
      s = 0;
      for j = 1:numel(c)
        [z, m.lag(j, :)] = lagging(m.lag(j, :), of, e.x(j), x);
        s = s + c(j) * z;
      end
      s = s * by;
    case 'wave'
      turn = 2 * pi * e.p(1) * x.time_s;
      s = (c(1) * sin(turn) + c(2) * cos(turn)) * by;
    otherwise % neighbours
      s = phi * (c(1) * x.next_v + c(2) * x.previous_v);
  end
end

% What it adds there: torque on theta_DEA, N m, or squared voltage, V^2.
function [s, m] = added(e, m, x, phi)
  [s, m] = sum_of(e, m, x, phi);
  switch e.at
    case 'bicep'
      if ~e.electrical
        s = s / x.lever;
      end
    case 'film'
      if e.electrical
        s = s / x.half;
      end
    case 'capacitance'
      s = s * phi * phi;
  end
end

% A symmetric matrix (xx, yy, zz, xy, xz, yz) times a vector.
function f = symmetric(c, d)
  f = [c(1) * d(1) + c(4) * d(2) + c(5) * d(3), c(4) * d(1) + c(2) * d(2) + c(6) * d(3), ...
       c(5) * d(1) + c(6) * d(2) + c(3) * d(3)];
end

function rate = swing(omega, zeta, s, v)
  rate = s(2) - v;
  rate = [rate, -omega * omega * s(1) - 2 * zeta * omega * rate];
end

% What counts of b, p and both speeds in a step of that swing.
function rows = swing_step(omega, zeta, step_s)
  parts = max(1, ceil(20 * omega * step_s * (1 + zeta)));
  h = step_s / parts;
  rows = zeros(2, 4);
  for which = 1:4
    s = [which == 1, which == 2];
    for part = 0:parts - 1
      x0 = part / parts;
      xm = (part + 0.5) / parts;
      x1 = (part + 1) / parts;
      k1 = swing(omega, zeta, s, (1 - x0) * (which == 3) + x0 * (which == 4));
      vm = (1 - xm) * (which == 3) + xm * (which == 4);
      k2 = swing(omega, zeta, s + 0.5 * h * k1, vm);
      k3 = swing(omega, zeta, s + 0.5 * h * k2, vm);
      k4 = swing(omega, zeta, s + h * k3, (1 - x1) * (which == 3) + x1 * (which == 4));
      s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    end
    rows(:, which) = s(:);
  end
end

% The force of a learnt term on the end effector, N.
function [f, m] = push(e, m, x)
  c = e.c;
  p = e.p;
  switch e.form
    case 'potential'
      square = p(1) * p(1);
      f = [0, 0, 0];
      for j = 1:numel(c)
        d = x.u - e.x(3 * j - 2:3 * j);
        f = f + c(j) / square * exp(-0.5 * sum(d .* d) / square) * d;
      end
    case 'ridge'
      f = curve(e.x, c, e.bend, sum(p(1:3) .* x.u)) * p(1:3);
    case 'affine'
      f = c(1:3) + symmetric(c(4:9), x.u - p(1:3));
    case 'drag'
      f = (c(1:3) + c(4:6) * sqrt(sum(x.v .* x.v))) .* x.v;
    otherwise % oscillator
      omega = 2 * pi * p(1);
      if x.first
        m.step = swing_step(omega, p(2), x.step_s);
        m.s = zeros(3, 2);
      else
        m.s = [m.s, m.v(:), x.v(:)] * m.step';
      end
      m.v = x.v;
      d = [0, 0, 0];
      for i = 1:3
        rate = swing(omega, p(2), m.s(i, :), x.v(i));
        d(i) = -rate(2);
      end
      f = symmetric(c, d);
  end
end

% The current through the leak over the one that phi would drive through the wire, and how that grows.
function [g, more] = leak(p, x, phi)
  field = abs(phi) / 3000 * x.area / 1.2;
  power = max(p(2), 2);
  share = p(2) / power;
  loss = p(1) / (1 - p(1));
  growing = loss * share * field ^ power;
  g = loss * (1 - share) + growing;
  more = power * growing;
end

function phi = at_rest(p, x, phi)
  y = 1;
  for i = 1:4
    [g, more] = leak(p, x, phi * y);
    y = max(y - (y * (1 + g) - 1) / (1 + g + more), 1e-3);
  end
  phi = phi * y;
end

% The voltage on a film that a wire feeds; m.charge: charge, command, capacitance
% and 1/(R C) at the sample before.
function [at, m] = charged(p, m, x, phi, ohm, rounds)
  c1 = x.capacitance_f;
  rate = 1 / (ohm * c1);
  if x.first
    at = phi;
    if rounds > 0
      at = at_rest(p, x, phi);
    end
    charge = c1 * at;
  else
    start = m.charge(1);
    c0 = m.charge(3);
    at = start / c0;
    for i = 0:rounds
      k = 1;
      if rounds > 0
        k = 1 + leak(p, x, at);
      end
      z = k * x.step_s * 0.5 * (m.charge(4) + rate);
      left = exp(-z);
      far = mean_of(z);
      charge = start * left + (c0 * m.charge(2) * (far - left) + c1 * phi * (1 - far)) / k;
      at = charge / c1;
    end
  end
  m.charge = [charge, phi, c1, rate];
end

function yes = is_electrical(e)
  yes = e.electrical || any(strcmp(e.kind, {'series_resistance', 'leakage', 'amplifier_gain', ...
      'amplifier_deadband', 'amplifier_saturation', 'slew_limit', 'dielectric_relaxation', ...
      'x_space_charge'}));
end

% From the voltage before an electrical cause to the one after it.
function [phi, m] = electrical(e, m, x, phi)
  p = e.p;
  volts = abs(phi);
  switch e.kind
    case 'series_resistance'
      if p(1) > 0
        [phi, m] = charged(p, m, x, phi, p(1) * (x.area / 1.2) ^ p(2), 0);
      end
    case 'leakage'
      if p(1) == 0
        return
      elseif p(3) > 0
        [phi, m] = charged(p, m, x, phi, p(3), 3);
      else
        phi = at_rest(p, x, phi);
      end
    case 'amplifier_gain'
      phi = phi + p(1) * phi + p(2) * (1 - exp(-(phi / 50) ^ 2)) * sign_of(phi);
    case 'amplifier_deadband'
      if p(1) ~= 0
        phi = phi / (1 + exp(-(volts - p(1)) / p(2)));
      end
    case 'amplifier_saturation'
      phi = sign_of(phi) * (volts - p(2) * soft_plus((volts - p(1)) / p(2)));
    case 'slew_limit'
      if ~x.first
        s = sign_of(phi);
        if phi == 0
          s = sign_of(m.last);
        end
        before = m.last * s;
        phi = s * min(max(s * phi, before - p(2) * x.step_s), before + p(1) * x.step_s);
      end
      m.last = phi;
    case 'dielectric_relaxation'
      if x.first
        m.psi = zeros(2, 2);
      end
      [fast, m.psi(1, :)] = lagging(m.psi(1, :), phi, p(2), x);
      [slow, m.psi(2, :)] = lagging(m.psi(2, :), phi, 15 * p(2), x);
      if p(1) ~= 0 || p(3) ~= 0
        phi = sqrt(max((1 - p(1) - p(3)) * phi * phi + p(1) * fast * fast + p(3) * slow * slow, 0));
      end
    case 'x_space_charge'
      held = 0;
      if ~x.first
        left = exp(-x.step_s / p(2));
        far = mean_of(x.step_s / p(2));
        held = m.held(1) * left + p(1) * (m.held(2) * (far - left) + phi * (1 - far));
      end
      m.held = [held, phi];
      phi = phi - held;
    otherwise % learnt
      [more, m] = added(e, m, x, phi);
      if more ~= 0
        phi = sign_of(phi) * sqrt(max(phi * phi + more, 0));
      end
  end
end

% What a cause multiplies 1/2 dC/d theta_DEA with.
function y = capacitance(e, x)
  p = e.p;
  y = 1;
  switch e.kind
    case 'permittivity_stretch'
      d = x.area - 1;
      y = 1 - p(1) * (d - p(2) * d * d) - 0.5 * p(1) * (1 - 2 * p(2) * d) * x.area;
    case 'electrode_failure'
      if after(x, p(3), p(2))
        y = 1 - p(1);
      end
    case 'actuator_asymmetry'
      y = 1 / p(1);
  end
end

% What a cause multiplies the stress of the equilibrium spring and of the branches with.
function [y, m] = stress(e, m, x, model)
  p = e.p;
  y = [1, 1];
  switch e.kind
    case 'mullins_softening'
      l = x.stretch .^ 2;
      d = 1 - (l(1) + l(2) + 1 / (l(1) * l(2)) - 3) / model.J;
      w = -0.5 * model.mu_Pa(1) * model.J * log(max(d, 1e-9));
      if x.first
        m.largest = w;
      end
      m.largest = max(m.largest, w);
      y = [1 - p(1) * erf((m.largest - w) / p(2)), 1];
    case 'actuator_asymmetry'
      y = [p(1), p(1)];
    case 'temperature_drift'
      t = x.series_s / p(3);
      y = [1, 1] * (1 + p(1) * (1 - exp(-t)) + p(2) * (1 - exp(-4 * t)));
  end
end

% d ln xi/dt of a neo-Hookean branch, and its stress over its modulus.
function [rate, s] = creep(time_s, l, x)
  a = l .* exp(-2 * x);
  s = a - 1 / (a(1) * a(2));
  rate = (s - 0.5 * s([2, 1])) / (3 * time_s);
end

% The same of one that flows the faster the more it carries; also the rate with which it relaxes.
function [rate, s, fast] = fast_creep(p, l, x)
  [rate, s] = creep(p(2), l, x);
  faster = (sqrt(s(1) * s(1) - s(1) * s(2) + s(2) * s(2)) / 0.1) ^ (p(3) - 1);
  rate = faster * rate;
  fast = faster / p(2) * p(3) * (3 * l(1) * exp(-2 * x(1)) - 2 * s(1) + s(2));
end

% The torque of a cause on theta_DEA, N m, positive where it opens the lozenge.
function [t, m] = torque(e, m, x)
  p = e.p;
  c = x.chain;
  volume = c.films * c.l1 * c.l2 * c.l3;
  l = x.stretch .^ 2;
  t = 0;
  switch e.kind
    case 'electrode_stiffness'
      a = l ./ [1.5, 0.816496580927726] .^ 2;
      t = -p(1) * volume * sum((a - 1 / (a(1) * a(2))) .* x.slope);
    case 'hinge_stiffness'
      d = x.theta_dea - p(2);
      t = -p(1) * (d + p(3) * d * d * d);
    case 'slow_creep'
      if p(1) == 0
        return
      end
      if x.first
        m.x = [0, 0];
        rest = p(3) + x.series_s;
        steps = max(1, ceil(rest / 5));
        for i = 1:steps
          m.x = m.x + rest / steps * creep(p(2), l, m.x);
        end
      end
      [rate, s] = creep(p(2), l, m.x);
      m.x = m.x + x.step_s * rate;
      t = -p(1) * volume * sum(s .* x.slope);
    case 'joint_friction'
      if x.first
        m.z = [0, x.theta_b(1)];
      end
      d = x.theta_b(1) - m.z(2);
      level = 1 + p(3) * exp(-(d / x.step_s / 0.1) ^ 2);
      z = m.z(1) + (sign_of(d) * level - m.z(1)) * (1 - exp(-abs(d) / (p(2) * level)));
      m.z = [z, x.theta_b(1)];
      t = -p(1) * z / x.lever;
    case 'joint_damping'
      t = -p(1) * x.theta_b(2) / x.lever;
    case 'end_stop'
      depth = p(3) * soft_plus((x.theta_b(1) - p(1)) / p(3));
      t = -p(2) * depth * max(1 + p(4) * x.theta_b(2), 0) / x.lever;
    case 'actuator_mass'
      t = -p(1) * (c.bicep * x.theta_b(3) - 9.80665 * sin(x.theta_b(1))) / x.lever;
    case 'payload_change'
      if after(x, p(3), p(2))
        t = -p(1) * (sum(x.force_lever .* x.a) + x.force_lever(3) * 9.80665);
      end
    case 'x_electrode_viscosity'
      t = -p(1) * volume * sum(x.slope .^ 2) * x.theta_b(2) * x.lever;
    case 'x_nonlinear_flow'
      if p(1) == 0
        return
      end
      left = x.step_s;
      if x.first
        m.x = log(x.stretch);
        m.before = l;
        left = 0;
      end
      while left > 0
        on = 1 - left / x.step_s;
        [rate, s, fast] = fast_creep(p, m.before + on * (l - m.before), m.x);
        h = min(left, max(0.1 / max(fast, realmin), 1e-3 * x.step_s));
        on = 1 - (left - 0.5 * h) / x.step_s;
        rate = fast_creep(p, m.before + on * (l - m.before), m.x + 0.5 * h * rate);
        m.x = m.x + h * rate;
        left = left - h;
      end
      m.before = l;
      [rate, s] = fast_creep(p, l, m.x);
      t = -p(1) * volume * sum(s .* x.slope);
    case 'x_backlash'
      d = x.theta_b(1);
      if x.first
        m.s = [d, d];
      end
      m.s(1) = min(max(m.s(1), d - p(2)), d + p(2));
      t = -p(1) * (m.s(1) - m.s(2)) / x.lever;
    case 'learnt'
      if e.electrical
        return
      elseif strcmp(e.at, 'force')
        [f, m] = push(e, m, x);
        t = sum(f .* x.force_lever);
      else
        [t, m] = added(e, m, x, 0);
      end
  end
end

% What v gains where it is turned by the vector w.
function d = turned(w, v)
  angle = sqrt(sum(w .* w));
  d = [0, 0, 0];
  if angle > 0
    once = cross_of(w / angle, v);
    d = sin(angle) * once + (1 - cos(angle)) * cross_of(w / angle, once);
  end
end

% Stress over modulus (2 rows) and flow of springs at w (a column each), and whether none is locked.
function [s, flow, whole] = springs(rate, l, rest, w, J)
  a = l(1) * w(1, :);
  b = l(2) * w(2, :);
  ab = a .* b;
  abd = ab * (1 + 3 / J) - (ab .* (a + b) + 1) / J;
  inverse = 1 ./ (ab .* abd);
  c = abd .* inverse;
  over_d = ab .* ab .* inverse;
  s = [(a - c) .* over_d; (b - c) .* over_d];
  flow = [rate .* (w(1, :) - rest(1)) - rate / 3 .* w(1, :) .* (2 * s(1, :) - s(2, :)); ...
          rate .* (w(2, :) - rest(2)) - rate / 3 .* w(2, :) .* (2 * s(2, :) - s(1, :))];
  whole = all(abd > 0);
end

% The torque of the film of chain k: equilibrium spring, branches, N m.
function [out, whole, state] = film_torque(state, k, stretch, rate, lever)
  model = state.m;
  film = state.film;
  n = numel(model.T_s);
  l = stretch .^ 2;
  rest = 1 ./ l;
  first = isempty(state.branches{k});
  if first
    w = rest(:) * ones(1, n);
    change = zeros(2, n);
  else
    b = state.branches{k};
    w = b.w;
    mid = exp((rate - b.rate) * state.step_s / 4) ./ (b.stretch .* stretch);
    change = b.now - b.was;
    for i = 1:2
      w(i, :) = film.decay .* w(i, :) + film.drive(1, :) * b.rest(i) + film.drive(2, :) * mid(i) ...
                + film.drive(3, :) * rest(i) + film.stage(1, :) .* b.now(i, :) ...
                + film.stage(2, :) .* change(i, :);
    end
  end
  [s, ignored, sound] = springs(0, l, rest, [1; 1], model.J);
  out = [model.mu_Pa(1) * (lever * s), 0];
  whole = sound;
  now = zeros(2, n);
  if n > 0
    [s, now, sound] = springs(1 ./ model.T_s, l, rest, w, model.J);
    out(2) = sum(model.mu_Pa(2:end) .* (lever * s));
    whole = whole && sound;
  end
  if first
    was = now;
  else
    was = b.now;
    for i = 1:2
      w(i, :) = w(i, :) + film.stage(3, :) .* (now(i, :) - b.now(i, :) - change(i, :));
    end
  end
  state.branches{k} = struct('w', w, 'now', now, 'was', was, 'rest', rest, 'stretch', stretch, 'rate', rate);
end

% Takes the next sample. x: what there is of each actuator, none where there is no sample yet or no more.
function [state, x, force, status] = next_sample(state, u, v, a)
  x = {};
  force = NaN(1, 3);
  if state.locked
    status = 5;
    return
  end
  u = reshape(u, 1, 3);
  v = reshape(v, 1, 3);
  a = reshape(a, 1, 3);
  for j = 1:numel(state.effects)
    e = state.effects{j};
    if strcmp(e.kind, 'frame_tilt')
      u = u + turned(e.p(1:3), u - reshape(state.pivot_m, 1, 3));
      v = v + turned(e.p(1:3), v);
      a = a + turned(e.p(1:3), a);
    elseif strcmp(e.kind, 'marker_offset')
      u = u - e.p(1:3);
    end
  end
  poses = cell(1, 3);
  reached = true;
  for k = 1:3
    [poses{k}, ok] = pose_of(state.chains{k}, u);
    reached = reached && ok;
  end
  if reached
    state.poses = poses;
  elseif state.sample == 0
    status = 3;
    return
  end
  poses = state.poses;
  g = [poses{1}.ddea; poses{2}.ddea; poses{3}.ddea];
  rows = [cross_of(g(2, :), g(3, :)); cross_of(g(3, :), g(1, :)); cross_of(g(1, :), g(2, :))];
  rows = rows / sum(g(1, :) .* rows(1, :));
  usable = reached && sqrt(sum(sum(g .* g))) * sqrt(sum(sum(rows .* rows))) < 1e3;
  mass = state.m.effector_kg + state.payload_kg;
  force = mass * (a + [0, 0, 9.80665]);
  whole = true;
  x = cell(1, 3);
  for k = 1:3
    c = state.chains{k};
    p = poses{k};
    y = struct('chain', c, 'first', state.sample == 0, 'step_s', state.step_s);
    y.time_s = state.start_s + state.step_s * state.sample;
    y.series_s = state.series_s + state.step_s * state.sample;
    y.recording = state.recording;
    y.u = u;
    y.v = v;
    y.a = a;
    y.next_v = 0;
    y.previous_v = 0;
    y.theta_dea = p.theta_dea;
    y.lever = p.lever;
    rate = sum(p.db .* v);
    y.theta_b = [p.theta_b, rate, acceleration(c, p, rate, v, a)];
    y.force_lever = [0, 0, 0];
    if usable
      y.force_lever = rows(k, :);
    end
    y.stretch = 2 * c.side ./ [c.l1, c.l2] .* p.half;
    y.slope = [0.5 * p.half(2) / p.half(1), -0.5 * p.half(1) / p.half(2)];
    y.area = y.stretch(1) * y.stretch(2);
    y.capacitance_f = state.m.eps_F_m * c.films * c.l1 * c.l2 / c.l3 * y.area * y.area;
    y.half = y.capacitance_f * (y.slope(1) + y.slope(2));
    theta_rate = 0;
    if reached
      theta_rate = sum(p.ddea .* v);
    end
    volume = c.films * c.l1 * c.l2 * c.l3;
    [film, sound, state] = film_torque(state, k, y.stretch, y.slope * theta_rate, y.slope * volume);
    whole = whole && sound;
    q = c.bicep;
    bicep = state.m.bicep_tip_kg * (q * q * y.theta_b(3) - 9.80665 * q * p.sine_b);
    force = force + bicep * p.db;
    y.load = 0;
    if usable
      y.load = mass * (sum(y.force_lever .* a) + y.force_lever(3) * 9.80665) + bicep / p.lever;
    end
    [t, slope, inside] = curve(state.m.nodes_rad, state.m.torque_N_m, state.m.torque_bend, p.theta_fa);
    y.forearm = t + slope * (p.theta_fa - inside);
    y.made = y.half;
    y.torque = 0;
    for j = 1:numel(state.effects)
      e = state.effects{j};
      if e.on(k)
        y.made = y.made * capacitance(e, y);
        [factor, state.memory{j, k}] = stress(e, state.memory{j, k}, y, state.m);
        film = film .* factor;
        [t, state.memory{j, k}] = torque(e, state.memory{j, k}, y);
        y.torque = y.torque + t;
      end
    end
    y.film = film(1) + film(2);
    x{k} = y;
  end
  state.sample = state.sample + 1;
  state.locked = state.locked || ~whole;
  status = 0;
  if state.locked
    status = 5;
  elseif ~reached
    status = 3;
  elseif ~usable
    status = 4;
  end
end

function f = left_of(e, m, x, told, wanted)
  f = electrical(e, m, x, told) - wanted;
end

% The voltage before an electrical cause that makes `wanted` after it: Chandrupatla's method, from a bracket
% as wide as twice what the cause takes where that holds it. Where none does, the end that comes nearer.
function at = told_of(e, m, x, wanted)
  high = 20000;
  low = -high;
  if strcmp(e.kind, 'dielectric_relaxation') || ~e.remembers
    low = 0;
  end
  b = wanted;
  fb = left_of(e, m, x, b, wanted);
  at = wanted;
  if fb == 0
    return
  end
  a = min(max(b - 2 * fb, low), high);
  fa = left_of(e, m, x, a, wanted);
  if (fa < 0) == (fb < 0)
    a = high;
    b = low;
    fa = left_of(e, m, x, a, wanted);
    fb = left_of(e, m, x, b, wanted);
  end
  if fa == 0 || fb == 0 || (fa < 0) ~= (fb < 0)
    t = fa / (fa - fb);
    for i = 1:100
      at = a + t * (b - a);
      f = left_of(e, m, x, at, wanted);
      if (f < 0) == (fa < 0)
        c = a;
        fc = fa;
      else
        c = b;
        b = a;
        fc = fb;
        fb = fa;
      end
      a = at;
      fa = f;
      if abs(fa) >= abs(fb)
        at = b;
      end
      least = (4.5e-16 * abs(at) + 1e-12) / abs(b - a);
      if fa == 0 || least > 0.5
        return
      end
      xi = (a - b) / (c - b);
      phi = (fa - fb) / (fc - fb);
      t = 0.5;
      if phi * phi < xi && (1 - phi) * (1 - phi) < 1 - xi
        t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb);
      end
      t = min(max(t, least), 1 - least);
    end
  end
  at = b;
  if abs(fa) < abs(fb)
    at = a;
  end
end

% The command of one actuator that makes the voltage film_v; NaN where none does.
function [state, told] = command_of(state, k, x, film_v, last)
  told = film_v;
  for j = numel(state.effects):-1:1
    e = state.effects{j};
    if e.on(k) && is_electrical(e)
      m = state.memory{j, k};
      wanted = told;
      if isnan(told)
        wanted = 0;
      end
      found = told_of(e, m, x, wanted);
      [made, m] = electrical(e, m, x, found);
      if last
        state.memory{j, k} = m;
      end
      if isnan(told) || ~(abs(made - wanted) <= 2 + 2e-3 * wanted)
        told = NaN;
      else
        told = found;
      end
    end
  end
end

function [state, command_v, film_squared_v2, status] = to_voltage(state, u, v, a)
  command_v = NaN(1, 3);
  film_squared_v2 = NaN(1, 3);
  [state, x, force, status] = next_sample(state, u, v, a);
  if isempty(x)
    return
  end
  film_v = NaN(1, 3);
  if status == 0
    for k = 1:3
      needed = x{k}.film + x{k}.load - x{k}.torque;
      for j = 1:3
        needed = needed + sum(x{k}.force_lever .* state.poses{j}.dfa) * x{j}.forearm;
      end
      film_squared_v2(k) = needed / x{k}.made;
    end
    film_v = sqrt(max(film_squared_v2, 0));
    if any(film_squared_v2 < 0)
      status = 1;
    end
  end
  command_v = film_v;
  rounds = 1;
  for j = 1:numel(state.effects)
    if strcmp(state.effects{j}.form, 'neighbours')
      rounds = 8; % what one actuator needs depends on what the others are told
    end
  end
  for number = 1:rounds
    before = command_v;
    for k = 1:3
      x{k}.next_v = before(mod(k, 3) + 1);
      x{k}.previous_v = before(mod(k + 1, 3) + 1);
      [state, command_v(k)] = command_of(state, k, x{k}, film_v(k), number == rounds);
    end
  end
  if status == 0 && any(isnan(command_v))
    status = 2;
  end
end

function [state, force_n, status] = to_force(state, u, v, a, command_v, squared_v2)
  [state, x, force_n, status] = next_sample(state, u, v, a);
  if isempty(x) || status == 3 || status == 5
    force_n = NaN(1, 3);
    return
  end
  if nargin < 6
    squared_v2 = command_v .^ 2;
  end
  for k = 1:3
    x{k}.next_v = command_v(mod(k, 3) + 1);
    x{k}.previous_v = command_v(mod(k + 1, 3) + 1);
    film_v = command_v(k);
    for j = 1:numel(state.effects)
      e = state.effects{j};
      if e.on(k) && is_electrical(e)
        [film_v, state.memory{j, k}] = electrical(e, state.memory{j, k}, x{k}, film_v);
      end
    end
    change = film_v * film_v - command_v(k) * command_v(k);
    net = x{k}.made * (squared_v2(k) + change) + x{k}.torque - x{k}.film;
    force_n = force_n + x{k}.forearm * state.poses{k}.dfa - net * state.poses{k}.ddea;
  end
end
