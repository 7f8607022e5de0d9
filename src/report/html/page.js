// Values under the pointer, zoom and hiding in drawings; without it the page is the same, still. A drawing
// with `data-axes` says where its axes lie; values are read from the lines that are drawn.
"use strict";
(() => {
  let plots = [];
  let clips = 0;
  const box = (className) =>
    document.body.appendChild(Object.assign(document.createElement("div"), { className, hidden: true }));
  const [tip, band] = [box("tip"), box("drag")];

  const tidy = (v) => String(Number(v.toPrecision(4))).replace("-", "\u2212");
  const words = (title, v) => {
    const [name, unit] = title.split(/, (?=[^,]*$)/);
    return [name, tidy(v) + (unit ? "\u00a0" + unit : "")];
  };
  const points = (e) => e.getAttribute("points").trim().split(/\s+/).map((p) => p.split(",").map(Number));

  // The shapes of the kind and colour that an entry of a legend stands for, in its figure.
  function shapes(entry) {
    const sign = entry.querySelector("i").classList;
    const role = [...sign].find((c) => c.startsWith("k-")).slice(2);
    const line = `polyline.s-${role}`;
    const [dot, faint, area] = ["circle", "polygon", "rect"].map((tag) => `${tag}.f-${role}`);
    const kinds = { dot, faint, area, dashed: `${line}.dash` };
    const kind = Object.keys(kinds).find((k) => sign.contains(k));
    const found = [...entry.closest("figure").querySelectorAll(kind ? kinds[kind] : `${line}:not(.dash)`)];
    const broad = (e) => Number(e.getAttribute("stroke-width")) > 6;
    return kind ? found : found.filter((e) => broad(e) === sign.contains("broad"));
  }

  function hides(entry) {
    if (!shapes(entry).length) return;
    const toggle = () => {
      const off = entry.classList.toggle("off");
      entry.setAttribute("aria-pressed", String(!off));
      shapes(entry).forEach((e) => e.classList.toggle("gone", off));
    };
    const state = { role: "button", tabindex: "0", "aria-pressed": "true" };
    Object.entries(state).forEach(([k, v]) => entry.setAttribute(k, v));
    entry.addEventListener("click", toggle);
    entry.addEventListener("keydown", (e) => {
      if ([" ", "Enter"].includes(e.key)) (e.preventDefault(), toggle());
    });
  }

  function ticks([low, high]) {
    const raw = (high - low) / 6;
    const decade = 10 ** Math.floor(Math.log10(raw));
    const step = decade * [1, 2, 5, 10].find((s) => s * decade >= 0.7 * raw);
    const first = Math.ceil(low / step);
    return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => (first + i) * step);
  }

  const add = (parent, tag, attributes) => {
    const e = parent.appendChild(document.createElementNS(parent.namespaceURI, tag));
    Object.entries(attributes).forEach(([k, v]) => e.setAttribute(k, v));
    return e;
  };

  // What moves in a drawing, how, and what is there only while it is whole.
  function prepare(plot, number) {
    const { svg, at: [left, right] } = plot;
    const clip = add(add(svg, "defs", {}), "clipPath", { id: `clip-${number}` });
    add(clip, "rect", { x: left, y: 0, width: right - left, height: svg.viewBox.baseVal.height });
    const still = ["s-rule", "s-grid"];
    const drawn = [...svg.querySelectorAll(":scope > :is(polyline, polygon, circle, rect)")];
    plot.moves = drawn.filter((e) => !still.some((c) => e.classList.contains(c))).map((e) => {
      e.setAttribute("clip-path", `url(#clip-${number})`);
      const [cx, x, width] = ["cx", "x", "width"].map((n) => Number(e.getAttribute(n)));
      if (e.tagName === "circle") return (to) => e.setAttribute("cx", to(cx));
      if (e.tagName === "rect") {
        return (to) => [["x", to(x)], ["width", to(x + width) - to(x)]].forEach((a) => e.setAttribute(...a));
      }
      const path = points(e);
      return (to) => e.setAttribute("points", path.map(([x, y]) => `${to(x)},${y}`).join(" "));
    });
    const upright = (e) => points(e).every((p, _, all) => p[0] === all[0][0]);
    plot.whole = drawn.filter((e) => e.classList.contains("s-grid") && upright(e))
      .concat([...svg.querySelectorAll("text[text-anchor=middle]:not([dy='-0.5ex'])")]);
  }

  // Draws a plot between two values of x; all of it where there are none.
  function draw(plot, range) {
    const { svg, at: [left, right], panels } = plot;
    if (!plot.moves) prepare(plot, (clips += 1));
    plot.range = range;
    const [from, to] = range || plot.x;
    const place = (v) => left + ((v - from) / (to - from)) * (right - left);
    const scale = (plot.x[1] - plot.x[0]) / (right - left);
    plot.moves.forEach((move) => move((at) => (range ? place(plot.x[0] + (at - left) * scale) : at)));
    plot.whole.forEach((e) => e.classList.toggle("gone", !!range));
    svg.querySelectorAll(".fresh").forEach((e) => e.remove());
    (range ? ticks(range) : []).forEach((v) => {
      const x = place(v);
      panels.forEach(({ at: [top, foot] }) => {
        const points = `${x},${top} ${x},${foot}`;
        svg.prepend(add(svg, "polyline", { class: "fresh s-grid", "stroke-width": 3, points }));
      });
      const at = { x, y: panels[panels.length - 1].at[1] + 24, dy: "0.76em", "text-anchor": "middle" };
      add(svg, "text", { class: "fresh f-muted", ...at }).textContent = tidy(v);
    });
  }

  // The value of x at a place, and its way back from a panel's height.
  const across = ({ at, range, x }, place) => {
    const [from, to] = range || x;
    return from + (Math.min(Math.max((place - at[0]) / (at[1] - at[0]), 0), 1)) * (to - from);
  };
  const upwards = ({ at, y }, place) => y[0] + ((at[1] - place) / (at[1] - at[0])) * (y[1] - y[0]);

  // The height of a line at a place, where that is within the panel.
  function height(line, { at }, x) {
    const path = points(line);
    const i = path.findIndex((p, i) => i && path[i - 1][0] <= x && x <= p[0]);
    if (i < 1) return null;
    const [[x0, y0], [x1, y1]] = [path[i - 1], path[i]];
    const y = x1 === x0 ? y1 : y0 + ((x - x0) / (x1 - x0)) * (y1 - y0);
    return y >= at[0] - 1 && y <= at[1] + 1 ? y : null;
  }

  // What is under the pointer: x, and the lines there by their names; y where there are none.
  function told(plot, { x, y }) {
    const panel = plot.panels.find((p) => y >= p.at[0] && y <= p.at[1]);
    if (!panel || x < plot.at[0] || x > plot.at[1]) return [];
    const rows = [words(plot.title, across(plot, x))];
    const entries = plot.loops ? [] : plot.svg.closest("figure").querySelectorAll(".key li:not(.off)");
    entries.forEach((entry) => {
      const lines = shapes(entry).filter((e) => e.tagName === "polyline" && plot.svg.contains(e));
      const found = lines.map((e) => height(e, panel, x)).find((v) => v !== null);
      if (found !== undefined) rows.push([entry.textContent, words(panel.title, upwards(panel, found))[1]]);
    });
    return rows.length > 1 ? rows : [...rows, words(panel.title, upwards(panel, y))];
  }

  function looks(plot) {
    const { svg } = plot;
    const same = (p) => p.title === plot.title && String(p.x) === String(plot.x);
    const all = (range) => {
      plots.filter(same).forEach((p) => draw(p, range));
      // pages that can draw it finer listen
      svg.dispatchEvent(new CustomEvent("looked", { bubbles: true, detail: range }));
    };
    const where = (e) => new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
    let begun = null;
    svg.addEventListener("pointerdown", (e) => (begun = e.button ? null : e));
    svg.addEventListener("pointermove", (e) => {
      const rows = told(plot, where(e));
      tip.hidden = !rows.length;
      tip.textContent = rows.map((r) => r.join(" ")).join("\n");
      tip.style.left = `${Math.max(0, Math.min(e.clientX + 14, innerWidth - tip.offsetWidth - 4))}px`;
      tip.style.top = `${Math.max(0, e.clientY - tip.offsetHeight - 10)}px`;
      band.hidden = !begun;
      if (!begun) return;
      const [a, b] = [begun.clientX, e.clientX].sort((a, b) => a - b);
      const { top, height } = svg.getBoundingClientRect();
      Object.entries({ left: a, width: b - a, top, height }).forEach(([k, v]) => (band.style[k] = `${v}px`));
    });
    const end = (e) => {
      tip.hidden = tip.hidden || e.type !== "pointerup";
      band.hidden = true;
      if (begun && e.type === "pointerup" && Math.abs(e.clientX - begun.clientX) > 8) {
        const range = [begun, e].map((p) => across(plot, where(p).x)).sort((a, b) => a - b);
        if (range[1] > range[0]) all(range);
      }
      begun = null;
    };
    ["pointerup", "pointerleave", "pointercancel"].forEach((type) => svg.addEventListener(type, end));
    svg.addEventListener("dblclick", () => all(null));
  }

  // Drawings and legends below `root`, at the beginning and where they come later.
  window.awake = (root) => {
    const fresh = [...root.querySelectorAll("svg[data-axes]")];
    plots = plots.filter((p) => p.svg.isConnected);
    const begun = fresh.map((svg) => ({ svg, ...JSON.parse(svg.dataset.axes) }));
    plots.push(...begun);
    root.querySelectorAll("figure .key li").forEach(hides);
    begun.forEach(looks);
  };
  window.awake(document);
})();
