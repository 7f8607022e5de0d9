// What a reader sees of a page: its width, blank rows, text that is hard to read, axes without a unit.
// `tests/pages.rs` writes this into a page that shows the report in a frame of each width.

/// A blank row may be so high, px.
const BLANK = 60;
/// Text needs so much contrast to its ground (WCAG 2, level AA).
const CONTRAST = 4.5;
/// Axes of numbers without a unit.
const PLAIN = ["stretch", "row", "day", "number of the set", "rank of the start", "batch",
  "strength from 0 (barely visible) to 1 (strong)"];

function look(doc, view) {
  const of = (e) => view.getComputedStyle(e);
  const colour = (text) => {
    const parts = text.match(/[\d.]+/g).map(Number);
    return parts.length < 4 ? [...parts, 1] : parts;
  };
  const channel = (v) => (v / 255 <= 0.03928 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const light = (c) => 0.2126 * channel(c[0]) + 0.7152 * channel(c[1]) + 0.0722 * channel(c[2]);
  const ground = (e) => {
    for (; e; e = e.parentElement) {
      const c = colour(of(e).backgroundColor);
      if (c[3] > 0.99) return c;
    }
    return [255, 255, 255, 1];
  };
  const rows = [];
  const add = (r) => {
    if (r.width > 0 || r.height > 0) rows.push([r.top, r.bottom]);
  };

  const pale = new Set();
  const texts = doc.createTreeWalker(doc.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const e = texts.currentNode.parentElement;
    const says = texts.currentNode.data.trim();
    if (!says || ["STYLE", "SCRIPT"].includes(e.tagName)) continue;
    const range = doc.createRange();
    range.selectNodeContents(texts.currentNode);
    const boxes = [...range.getClientRects()].filter((r) => r.width > 0);
    boxes.forEach(add);
    if (!boxes.length) continue;
    const ink = colour(e.closest("svg") ? of(e).fill : of(e).color);
    const [a, b] = [light(ink), light(ground(e))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < CONTRAST) pale.add(`${contrast.toFixed(1)}: ${says.slice(0, 40)}`);
  }
  doc.querySelectorAll("svg :not(g), img").forEach((e) => add(e.getBoundingClientRect()));
  doc.querySelectorAll("body *").forEach((e) => {
    if (e.closest("svg")) return;
    const [style, r] = [of(e), e.getBoundingClientRect()];
    const seen = (side) => parseFloat(style[`border${side}Width`]) > 0 && colour(style[`border${side}Color`])[3] > 0;
    if (!r.width) return;
    if (seen("Top")) rows.push([r.top, r.top + 1]);
    if (seen("Bottom")) rows.push([r.bottom - 1, r.bottom]);
    if (colour(style.backgroundColor)[3] > 0.5) rows.push([r.top, r.bottom]);
  });
  rows.sort((a, b) => a[0] - b[0]);
  const blank = [];
  let end = rows.length ? rows[0][0] : 0;
  for (const [top, bottom] of rows) {
    if (top - end > BLANK) blank.push(`${Math.round(top - end)} px below ${Math.round(end)}`);
    end = Math.max(end, bottom);
  }

  const bare = new Set();
  doc.querySelectorAll("svg.plot:not(.heat):not(.free)").forEach((plot) => {
    const titles = (anchor) => [...plot.querySelectorAll(`text[dy='-0.5ex'][text-anchor='${anchor}']`)];
    const label = plot.getAttribute("aria-label");
    if (!titles("middle").length) bare.add(`no axis below: ${label}`);
    if (!plot.classList.contains("bars") && !titles("start").length) bare.add(`no axis upwards: ${label}`);
    const all = plot.classList.contains("bars") ? titles("middle") : [...titles("middle"), ...titles("start")];
    for (const says of all.map((t) => t.textContent.trim())) {
      if (!says.includes(",") && !PLAIN.includes(says)) bare.add(`no unit: ${says} (${label})`);
    }
  });

  return {
    wide: doc.documentElement.scrollWidth,
    dark: light(ground(doc.body)) < 0.1,
    blank,
    pale: [...pale],
    bare: [...bare],
  };
}

// What the page's own script does: a drag zooms in all drawings of the same axis and a double click brings them
// back, the pointer is told a value, and an entry of a legend hides its curve.
function tried(doc, view) {
  const faults = [];
  const want = (ok, says) => ok || faults.push(says);
  const plots = [...doc.querySelectorAll("svg[data-axes]")];
  const at = (type, svg, [x, y]) => {
    const p = new view.DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
    svg.dispatchEvent(new view.PointerEvent(type, { clientX: p.x, clientY: p.y, button: 0, bubbles: true }));
  };
  const seen = (svg) => [...svg.querySelectorAll("polyline")].map((e) => e.getAttribute("points")).join();
  let [zoomed, hidden, curves] = [0, 0, 0];
  for (const svg of plots) {
    const axes = JSON.parse(svg.dataset.axes);
    const label = svg.getAttribute("aria-label");
    const [left, right] = axes.at;
    const [top, bottom] = axes.panels[0].at;
    const place = (share) => [left + share * (right - left), (top + bottom) / 2];
    const same = (p) => ["title", "x"].every((k) => String(JSON.parse(p.dataset.axes)[k]) === String(axes[k]));
    const partner = plots.find((p) => p !== svg && same(p));
    const before = [svg, partner || svg].map(seen);
    at("pointermove", svg, place(0.5));
    const tip = doc.querySelector(".tip");
    const middle = (axes.x[0] + axes.x[1]) / 2;
    const number = Number(tip.textContent.replace("\u2212", "-").split("\n")[0].slice(axes.title.split(/, (?=[^,]*$)/)[0].length).split("\u00a0")[0]);
    want(!tip.hidden && Math.abs(number - middle) <= 2e-3 * (axes.x[1] - axes.x[0]) + 5e-4 * Math.abs(middle), `no value under the pointer: ${label}: ${tip.textContent}`);
    if (tip.textContent.split("\n").length > 1) curves += 1;
    const box = tip.getBoundingClientRect();
    want(box.left >= 0 && box.right <= view.innerWidth, `a value beside the screen: ${label}`);
    at("pointerdown", svg, place(0.25));
    at("pointermove", svg, place(0.5));
    at("pointerup", svg, place(0.5));
    const after = [svg, partner || svg].map(seen);
    const moves = svg.querySelector("polyline:not(.s-grid):not(.s-rule):not(.fresh)");
    if (moves) want(before.every((b, i) => b !== after[i]), `no zoom: ${label}`);
    want(svg.querySelectorAll("text.fresh").length >= 2, `no ticks where it is zoomed: ${label}`);
    zoomed += 1;
    svg.dispatchEvent(new view.MouseEvent("dblclick", { bubbles: true }));
    want([svg, partner || svg].every((s, i) => seen(s) === before[i]), `does not come back: ${label}`);
    at("pointerleave", svg, place(0.5));
    want(tip.hidden, `a value stays: ${label}`);
  }
  for (const entry of doc.querySelectorAll("figure .key li[role=button]")) {
    const gone = () => entry.closest("figure").querySelectorAll(".gone").length;
    const before = gone();
    entry.click();
    want(gone() > before, `nothing hidden: ${entry.textContent}`);
    entry.click();
    want(gone() === before, `stays hidden: ${entry.textContent}`);
    hidden += 1;
  }
  return { faults, zoomed, hidden, curves };
}

const WIDTHS = [390, 1280];
const told = {};
for (const width of WIDTHS) {
  const frame = document.createElement("iframe");
  frame.style = `width:${width}px;height:844px;border:0`;
  frame.onload = () => {
    const [doc, view] = [frame.contentDocument, frame.contentWindow];
    told[width] = { ...look(doc, view), ...tried(doc, view) };
    if (Object.keys(told).length === WIDTHS.length) {
      document.title = "looked";
      document.getElementById("told").textContent = JSON.stringify(told);
    }
  };
  frame.src = "report.html";
  document.body.append(frame);
}
