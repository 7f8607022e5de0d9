// Opens the page of `deacal view` on a phone and a desk and uses it: zoom, actuators, causes, legend, playing.
"use strict";
const WIDTHS = [390, 1280];
const told = {};
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
async function until(what, holds) {
  for (let i = 0; i < 600; i += 1) {
    if (holds()) return;
    await wait(50);
  }
  throw new Error(`never: ${what}`);
}

async function used(doc, view, causes) {
  const all = (query) => [...doc.querySelectorAll(query)];
  const axes = () => all("#figures svg[data-axes]").map((svg) => JSON.parse(svg.dataset.axes));
  const first = axes().length;
  await until("a first picture", () => axes().length > 0);
  if (causes) await until("causes", () => all("#causes input").length === causes);
  if (causes) await until("a prediction", () => doc.querySelector("#figures").textContent.includes("predicted"));
  const drawings = axes().length;
  const whole = axes()[0].x;
  // zoom: the program draws what is looked at anew
  const svg = doc.querySelector("#figures svg[data-axes]");
  const at = (type, share) => {
    const [left, right] = axes()[0].at;
    const [top, foot] = axes()[0].panels[0].at;
    const p = new view.DOMPoint(left + share * (right - left), (top + foot) / 2).matrixTransform(svg.getScreenCTM());
    svg.dispatchEvent(new view.PointerEvent(type, { clientX: p.x, clientY: p.y, button: 0, bubbles: true }));
  };
  at("pointerdown", 0.25);
  at("pointermove", 0.5);
  at("pointerup", 0.5);
  await until("a closer look", () => axes()[0].x[1] - axes()[0].x[0] < 0.3 * (whole[1] - whole[0]));
  doc.querySelector("#whole").click();
  await until("all of it again", () => String(axes()[0].x) === String(whole));
  // an actuator, a cause, a curve
  const drawn = () => doc.querySelector("#figures").innerHTML;
  const boxes = all("#actuators input");
  if (boxes.length) {
    boxes[1].click();
    await until("without actuator 2", () => axes().length === drawings - 1);
    boxes[1].click();
    await until("with actuator 2", () => axes().length === drawings);
  }
  if (causes) {
    const before = drawn();
    all("#causes input")[0].click();
    await until("without a cause", () => drawn() !== before);
    const without = drawn();
    all("#causes input")[0].click();
    await until("with it", () => drawn() !== without);
  }
  const entry = doc.querySelector("#figures .key li[role=button]");
  const gone = () => all("#figures .gone").length;
  entry.click();
  if (!gone()) throw new Error("no curve is hidden");
  // playing: time goes on, the robot is drawn, and it turns
  const canvas = doc.querySelector("#robot");
  let moves = false;
  if (!doc.querySelector("#moving").hidden) {
    const picture = () => canvas.toDataURL();
    const now = () => parseFloat(doc.querySelector("#now").textContent);
    await until("a robot", () => !doc.querySelector("#now").textContent.includes("no position"));
    const [begun, still] = [now(), picture()];
    doc.querySelector("#play").click();
    await until("playing", () => now() > begun + 0.5);
    doc.querySelector("#play").click();
    if (picture() === still) throw new Error("nothing moves");
    moves = true;
  }
  const requests = view.performance.getEntriesByType("resource").map((e) => e.name);
  return {
    first,
    drawings,
    moves,
    wide: doc.documentElement.scrollWidth,
    requests: requests.length,
    elsewhere: requests.filter((r) => !r.startsWith(view.location.origin) && !r.startsWith("data:")),
  };
}

WIDTHS.forEach((width) => {
  const frame = document.createElement("iframe");
  frame.style = `width:${width}px;height:844px;border:0`;
  frame.onload = async () => {
    const [doc, view] = [frame.contentDocument, frame.contentWindow];
    told[width] = await used(doc, view, CAUSES).catch((why) => ({ fault: String(why) }));
    if (Object.keys(told).length === WIDTHS.length) fetch("/", { method: "POST", body: JSON.stringify(told) });
  };
  frame.src = URL_OF_PAGE;
  document.body.append(frame);
});
