// The page of `deacal view`: asks the program for drawings between two times, and for the robot as it moves.
"use strict";
(() => {
  const look = document.getElementById("look");
  if (!look) return;
  const by = (id) => document.getElementById(id);
  const [figures, says, form, causes] = ["figures", "says", "controls", "causes"].map(by);
  const recordings = JSON.parse(look.dataset.recordings);
  let [number, range, drawn, told] = [0, null, 0, null];
  const shown = () => recordings[number];
  const span = () => range || shown().span;
  const json = async (path) => {
    const answer = await fetch(path);
    if (!answer.ok) throw new Error(await answer.text());
    return answer.json();
  };
  const query = (more) => new URLSearchParams({ recording: number, ...more });

  // Which boxes of a group are ticked, as 1 and 0.
  const ticked = (group) => [...group.querySelectorAll("input")].map((box) => Number(box.checked)).join("");
  function boxes(group, names, change) {
    group.querySelectorAll("label").forEach((label) => label.remove());
    group.hidden = !names.length;
    names.forEach((name) => {
      const label = group.appendChild(document.createElement("label"));
      const box = label.appendChild(document.createElement("input"));
      Object.assign(box, { type: "checkbox", checked: true });
      label.append(name);
      box.addEventListener("change", change);
    });
  }

  // Puts drawings in place; curves that were hidden stay so.
  function show(html) {
    const entries = () => [...figures.querySelectorAll(".key li")];
    const off = entries().filter((e) => e.classList.contains("off")).map((e) => e.textContent);
    figures.innerHTML = html;
    window.awake(figures);
    entries().filter((e) => off.includes(e.textContent)).forEach((e) => e.click());
    by("whole").hidden = !range;
    mark();
  }

  // The drawings of what is looked at: as measured until it is known what the parameters make of it.
  async function draw() {
    const mine = (drawn += 1);
    const [from, to] = span();
    const more = { from, to, actuators: ticked(by("actuators")) };
    if (told) more.causes = ticked(causes);
    try {
      const answer = await fetch(`/figures?${query(more)}`);
      const text = await answer.text();
      if (mine !== drawn) return;
      if (!answer.ok) throw new Error(text);
      show(text);
      says.textContent = told ? told.says : says.textContent;
    } catch (why) {
      says.textContent = why.message;
    }
  }

  // What the parameters make of a recording takes a while: it comes after what was measured.
  async function predict() {
    const mine = number;
    told = null;
    boxes(causes, [], draw);
    says.textContent = shown().predicted ? "Predicting\u2026" : "";
    if (!shown().predicted) return;
    try {
      const found = await json(`/prediction?${query()}`);
      if (mine !== number) return;
      told = found;
      boxes(causes, found.causes, draw);
      await draw();
    } catch (why) {
      if (mine === number) says.textContent = why.message;
    }
  }

  document.addEventListener("looked", (e) => {
    range = e.detail;
    draw();
  });
  by("whole").addEventListener("click", () => ((range = null), draw()));
  by("which").hidden = recordings.length < 2;
  form.recording.addEventListener("change", () => {
    number = Number(form.recording.value);
    begin();
    draw();
  });

  // The robot as it moves, in pieces of so many seconds.
  const PIECE = 10;
  const canvas = by("robot");
  const pen = canvas.getContext("2d");
  const pieces = new Map();
  let [at, playing, turn, last] = [0, false, [-1.26, 0.38], 0];
  async function piece(n) {
    const key = `${number}/${n}`;
    if (!pieces.has(key)) {
      pieces.set(key, null);
      const from = shown().span[0] + n * PIECE;
      pieces.set(key, await json(`/motion?${query({ from, to: from + PIECE })}`).catch(() => null));
      paint();
    }
    return pieces.get(key);
  }

  // The frame at a time: nothing where the capture has a gap or the piece is under way.
  function frame() {
    const n = Math.floor((at - shown().span[0]) / PIECE);
    const found = pieces.get(`${number}/${n}`);
    piece(n);
    if (playing) piece(n + 1);
    if (!found || !found.frames.length) return null;
    const i = Math.round((at - found.from) / found.step);
    return found.frames[Math.max(0, Math.min(i, found.frames.length - 1))];
  }

  const POINTS = 10; // of a chain: pivot, elbow, wrist, three of the four-bar, four of the lozenge
  const [PIVOT, ELBOW, WRIST, BAR, LOZENGE] = [0, 1, 2, 3, 6];
  let middle = null;
  function paint() {
    const points = shown().moves && frame();
    by("now").textContent = `${at.toFixed(2)} s${points ? "" : " (no position)"}`;
    if (!points) return;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    pen.clearRect(0, 0, width, height);
    const all = [];
    for (let i = 0; i < points.length; i += 3) all.push(points.slice(i, i + 3));
    const chain = (k, i) => all[k * POINTS + i];
    if (!middle) {
      const mean = [0, 1, 2].map((i) => all.reduce((sum, p) => sum + p[i], 0) / all.length);
      const far = Math.max(...all.map((p) => Math.hypot(...p.map((v, i) => v - mean[i]))));
      middle = { mean, far };
    }
    const [a, h] = turn;
    const [right, up] = [
      [-Math.sin(a), Math.cos(a), 0],
      [-Math.cos(a) * Math.sin(h), -Math.sin(a) * Math.sin(h), Math.cos(h)],
    ];
    const size = (0.46 * Math.min(width, height)) / middle.far;
    const place = (p) => {
      const v = p.map((x, i) => x - middle.mean[i]);
      const along = (axis) => axis.reduce((sum, x, i) => sum + x * v[i], 0);
      return [width / 2 + size * along(right), height / 2 - size * along(up)];
    };
    const style = getComputedStyle(document.documentElement);
    const colour = (role) => style.getPropertyValue(`--${role}`).trim();
    const path = (list, role, thick, faint) => {
      pen.beginPath();
      list.map(place).forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.lineJoin = "round";
      if (faint) {
        pen.closePath();
        pen.globalAlpha = faint;
        pen.fillStyle = colour(role);
        pen.fill();
        pen.globalAlpha = 1;
      }
      pen.strokeStyle = colour(role);
      pen.lineWidth = thick * ratio;
      pen.stroke();
    };
    const chains = [0, 1, 2];
    path(chains.map((k) => chain(k, PIVOT)), "base", 1, 0.3);
    path(chains.map((k) => chain(k, WRIST)), "three", 1, 0.4);
    const picked = [...by("actuators").querySelectorAll("input")].map((box) => box.checked);
    chains.forEach((k) => {
      const corners = [0, 1, 2, 3].map((i) => chain(k, LOZENGE + i));
      path([...corners, corners[0]], picked[k] ? ["one", "four", "three"][k] : "grid", 1.5, 0.3);
      path([PIVOT, BAR, BAR + 1, BAR + 2, PIVOT].map((i) => chain(k, i)), "muted", 1);
      path([PIVOT, ELBOW].map((i) => chain(k, i)), "ink", 3);
      path([ELBOW, WRIST].map((i) => chain(k, i)), "ink", 1.5);
      const [x, y] = place(chain(k, LOZENGE + 2));
      pen.fillStyle = colour("ink");
      pen.font = `${13 * ratio}px system-ui, sans-serif`;
      pen.fillText(String(k + 1), x + 4 * ratio, y);
    });
  }

  // Where the motion is, in every drawing.
  function mark() {
    figures.querySelectorAll(".now").forEach((e) => e.remove());
    if (!shown().moves) return;
    const [from, to] = span();
    if (at < from || at > to) return;
    figures.querySelectorAll("svg[data-axes]").forEach((svg) => {
      const axes = JSON.parse(svg.dataset.axes);
      const x = axes.at[0] + ((at - from) / (to - from)) * (axes.at[1] - axes.at[0]);
      axes.panels.forEach((panel) => {
        const line = svg.appendChild(document.createElementNS(svg.namespaceURI, "line"));
        const ends = { class: "now", x1: x, x2: x, y1: panel.at[0], y2: panel.at[1], "stroke-width": 4 };
        Object.entries(ends).forEach(([k, v]) => line.setAttribute(k, v));
      });
    });
  }

  function go(to) {
    const [from, end] = span();
    at = to > end || to < from ? from : to;
    by("time").value = (1000 * (at - from)) / (end - from);
    paint();
    mark();
  }
  function play(on) {
    playing = on;
    by("play").textContent = on ? "Pause" : "Play";
    by("play").setAttribute("aria-pressed", String(on));
    last = performance.now();
    if (on) requestAnimationFrame(step);
  }
  function step(now) {
    if (!playing) return;
    go(at + (now - last) / 1000);
    last = now;
    requestAnimationFrame(step);
  }
  by("play").addEventListener("click", () => play(!playing));
  by("time").addEventListener("input", () => {
    const [from, end] = span();
    go(from + (by("time").value / 1000) * (end - from));
  });
  let held = null;
  canvas.addEventListener("pointerdown", (e) => {
    held = [e.clientX, e.clientY];
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointermove", (e) => {
    if (!held) return;
    turn = [turn[0] - (e.clientX - held[0]) / 150, Math.max(-1.5, Math.min(1.5, turn[1] + (e.clientY - held[1]) / 150))];
    held = [e.clientX, e.clientY];
    paint();
  });
  ["pointerup", "pointercancel"].forEach((type) => canvas.addEventListener(type, () => (held = null)));
  window.addEventListener("resize", paint);

  // What belongs to the recording that is looked at.
  function begin() {
    range = null;
    middle = null;
    play(false);
    const names = Array.from({ length: shown().actuators }, (_, k) => String(k + 1));
    boxes(by("actuators"), names, () => (draw(), paint()));
    by("moving").hidden = !shown().moves;
    at = shown().span[0];
    if (shown().moves) paint();
    predict();
  }
  begin();
  mark();
})();
