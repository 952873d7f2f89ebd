// The live page: controls on the left, the viewer, the chart and the ledger. What is wanted goes to the server as JSON
// whenever it changes; pictures come back one at a time, each answered when it is shown.

import { digits, el, encode, mount } from "/viewer.js";

const $ = (id) => document.getElementById(id);

// The address brings the token behind its #, which no request carries. The origin's storage, which knows ports, keeps it
// for reloads and copied links.
const address = new URLSearchParams(location.hash.slice(1));
const link = address.get("view") ?? "";
history.replaceState(null, "", link ? `/#view=${link}` : "/");
const stored = "raytwin-token";
let token = null, about = null;
for (token of [address.get("token"), localStorage.getItem(stored)]) {
  const answer = token && await fetch("/about", { headers: { "X-Raytwin-Token": token } });
  if (answer && answer.ok) {
    about = await answer.json();
    localStorage.setItem(stored, token);
    break;
  }
}
if (!about) {
  $("state").textContent = "this page has no valid token: open the address that raytwin explore printed";
  $("state").className = "bad";
  throw new Error("no valid token");
}
$("name").textContent = about.scene;
document.title = `${about.scene} · raytwin explore`;

const SVG = "http://www.w3.org/2000/svg";
let wanted = structuredClone(about.first);
let selected = wanted.spheres.length ? 0 : -1;
let sample = 0, way = null, number = 0, shown = 0, socket = null;
const points = { now: [], past: [] };

const seconds = (s) => (s >= 1 ? `${s.toFixed(2)} s` : `${(1000 * s).toPrecision(s < 0.01 ? 2 : 3)} ms`);

// ------------------------------------------------------------------------------------------ the viewer

const viewer = mount($("viewer"), {
  width: about.width, height: about.height, names: { test: "tracer", reference: "twin" }, surfaces: true,
  objects: names(), overlay,
  panes: [
    { key: "test", kind: "radiance", title: "Tracer", tab: "tracer", alt: `${about.scene} by the tracer` },
    { key: "reference", kind: "radiance", title: "Twin", tab: "twin", alt: `${about.scene} by the twin` },
    { key: "map", kind: "map", title: "Difference", tab: "difference", alt: "Difference of the two" },
    { key: "objects", kind: "objects", title: "Silhouettes", tab: "silhouettes", alt: "What each pixel sees in both" },
  ],
});

function names() {
  return [...wanted.spheres.map((_, i) => `sphere ${i}`), ...wanted.planes.map((_, i) => `plane ${i}`)];
}

// ------------------------------------------------------------------------------------------ the socket

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`, ["raytwin", token]);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => ask();
  socket.onmessage = ({ data }) => receive(data).catch((error) => say(`the page failed: ${error.message}`, true));
  socket.onclose = () => say("raytwin explore has ended, or another page has taken over: reload to go on", true);
}

// One wish a frame at most: the newest. `began`: when a wish's first change came, by its number.
let asking = null, change = 0;
const began = new Map();
function ask(moving = false) {
  if (!asking) change = performance.now();
  wanted.moving = moving;
  const { exposure, gamma, tone } = viewer.state;
  wanted.look = { exposure, gamma, tone };
  asking ??= requestAnimationFrame(() => {
    asking = null;
    if (socket.readyState !== 1) return;
    number += 1;
    began.set(number, change);
    socket.send(JSON.stringify({ number, wanted }));
    $("viewer").classList.add("stale");
    if (!wanted.moving) keep_link();
    ask_way();
  });
}

function ask_way() {
  if (viewer.kept && $("show-way")?.checked) socket.send(JSON.stringify({ pixel: viewer.kept, sample }));
}

const unsent = [];
let busy = false;
async function receive(data) {
  unsent.push(data);
  if (busy) return;
  busy = true;
  try {
    while (unsent.length) await handle(unsent.shift());
  } finally {
    busy = false;
  }
}

async function handle(data) {
  const length = new DataView(data).getUint32(0, true), event = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  let at = 4 + length;
  const blobs = event.sizes.map((size) => { const from = at; at += size + ((4 - (size % 4)) % 4); return [from, size]; });
  const old = event.number !== undefined && event.number < number;
  if (event.number > shown) {
    shown = event.number;
    points.past = points.now;
    points.now = [];
  }
  await (handlers[event.kind] ?? (() => {}))(event, data, blobs, old);
  if (event.sent) socket.send(JSON.stringify({ answered: event.sent }));
}

const handlers = {
  async picture(event, data, [[from, size]]) {
    const bitmap = await createImageBitmap(new Blob([new Uint8Array(data, from, size)], { type: "image/jpeg" }));
    viewer.update(event.pane, bitmap);
    viewer.drawn();
    const side = event.pane === "test" ? "tracer" : "twin";
    tell("picture", side, event.number);
    say(`${side}: ${seconds(event.seconds)}`);
  },
  async pair(event, data, blobs, old) {
    if (old) return;
    await viewer.feed(event.planes.map((plane, i) => ({ ...plane, words: new Uint16Array(data, blobs[i][0], blobs[i][1] / 2) })));
    viewer.drawn();
    tell("pair", "both", event.number);
    $("viewer").classList.remove("stale");
    say(`${event.samples[0]} sample${event.samples[0] === 1 ? "" : "s"} a pixel by the tracer, ${event.samples[1]} by the twin`);
  },
  point(event) {
    points.now.push(event);
    chart();
  },
  ledger(event) {
    ledger(event.parts);
  },
  way(event) {
    way = event;
    tell_way();
    viewer.show();
  },
  refused(event) {
    say(event.text, true);
  },
  rest() {
    $("state").textContent += "; at rest";
    document.body.dataset.rest = String(shown);
  },
};

// For whoever measures: what has come to be seen, and how many milliseconds after the change that asked for it.
function tell(kind, side, of) {
  document.dispatchEvent(new CustomEvent("seen", { detail: { kind, side, ms: performance.now() - (began.get(of) ?? NaN) } }));
  for (const old of began.keys()) if (old < of) began.delete(old);
}

function say(text, bad = false) {
  $("state").textContent = text;
  $("state").classList.toggle("bad", bad);
}

// ------------------------------------------------------------------------------------------ controls

const updates = []; // bring the controls to what is wanted

function range(label, low, high, step, get, set, show = (x) => digits(x)) {
  const input = el("input", { type: "range", min: low, max: high, step }), said = el("output");
  input.oninput = () => { set(input.valueAsNumber); refresh(); ask(true); };
  input.onchange = () => ask();
  let last;
  updates.push(() => {
    const x = get();
    input.disabled = x === null;
    if (x !== null && x !== last) [input.value, said.textContent, last] = [x, show(x), x];
  });
  return el("label", {}, label, input, said);
}

function choice(label, options, get, set, disabled = false) {
  const input = el("select", { disabled }, ...options.map((x) => el("option", { value: String(x), textContent: x })));
  input.onchange = () => { set(input.value); refresh(); ask(); };
  updates.push(() => { input.value = String(get()); });
  return el("label", { className: "wide" }, label, input);
}

const button = (text, title, onclick) => el("button", { type: "button", textContent: text, title, onclick });
const group = (title, ...children) => el("fieldset", {}, el("legend", { textContent: title }), ...children);
const degrees = (x) => `${Math.round(x)}°`, centimetres = (x) => `${(100 * x).toFixed(1)} cm`;
const brightest = (colour) => Math.max(...colour);
const scaled = (colour, to) => (brightest(colour) > 0 ? colour.map((c) => (c * to) / brightest(colour)) : [to, to, to]);
const decode = (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
const hex = (colour) => `#${colour.map((c) => Math.round(255 * encode(c)).toString(16).padStart(2, "0")).join("")}`;
const unhex = (text) => [1, 3, 5].map((i) => Number(decode(parseInt(text.slice(i, i + 2), 16) / 255).toFixed(4)));
const sphere = () => wanted.spheres[selected] ?? null;

// The sun's place in the board's frame: azimuth from +X to +Y, elevation above the board.
function sun(azimuth, elevation) {
  const [a, e] = [azimuth, elevation].map((x) => (x * Math.PI) / 180);
  wanted.sun.to_light = [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
}
const azimuth = () => (Math.atan2(wanted.sun.to_light[1], wanted.sun.to_light[0]) * 180) / Math.PI;
const elevation = () => (Math.atan2(wanted.sun.to_light[2], Math.hypot(...wanted.sun.to_light.slice(0, 2))) * 180) / Math.PI;

function build() {
  const reach = Math.max(...wanted.spheres.map((s) => Math.hypot(...s.center) + s.radius), ...wanted.planes.map((p) => Math.hypot(...p.center) + Math.hypot(...p.half_u)), 0.1);
  const place = (axis) => range("xyz"[axis], -reach, reach, reach / 500, () => sphere()?.center[axis] ?? null, (x) => { sphere().center[axis] = x; }, centimetres);
  const which = el("select", { id: "which" });
  which.onchange = () => { selected = Number(which.value); refresh(); };
  updates.push(() => {
    if (which.options.length !== wanted.spheres.length) which.replaceChildren(...wanted.spheres.map((_, i) => el("option", { value: i, textContent: `sphere ${i}` })));
    which.value = selected;
  });
  const colour = el("input", { type: "color" });
  colour.oninput = () => { if (sphere()) { sphere().albedo = unhex(colour.value); ask(true); } };
  colour.onchange = () => ask();
  updates.push(() => { colour.disabled = !sphere(); if (sphere()) colour.value = hex(sphere().albedo); });
  const mine = about.subject !== null;
  const tick = el("input", { type: "checkbox", id: "show-way", onchange: () => { if (tick.checked) ask_way(); else { way = null; tell_way(); viewer.show(); } } });
  $("controls").onsubmit = (event) => event.preventDefault();
  const fold = el("button", { type: "button", className: "fold", textContent: "Controls", ariaExpanded: "true" }); // of a phone's sheet
  fold.onclick = () => { fold.ariaExpanded = String($("controls").classList.toggle("folded") === false); };
  $("controls").append(fold,
    group("Tracer", ...(mine ? [el("p", { textContent: about.subject })] : []),
      choice("rung", about.rungs, () => wanted.rung, (x) => { wanted.rung = x; }),
      choice("engine", about.engines, () => wanted.engine, (x) => { wanted.engine = x; }, mine),
      choice("solver", about.solvers, () => wanted.solver, (x) => { wanted.solver = x; }, mine)),
    group("Twin", choice("rung", about.rungs, () => wanted.twin_rung, (x) => { wanted.twin_rung = x; })),
    group("Where light is followed", range("depth", 2, 16, 1, () => wanted.depth, (x) => { wanted.depth = x; }, String),
      range("samples", 0, 12, 1, () => Math.log2(wanted.samples), (x) => { wanted.samples = 2 ** x; }, (x) => String(2 ** x))),
    group("Sun and sky", range("azimuth", -180, 180, 1, azimuth, (x) => sun(x, elevation()), degrees),
      range("elevation", -90, 90, 1, elevation, (x) => sun(azimuth(), x), degrees),
      range("sun", 0, 10, 0.05, () => brightest(wanted.sun.irradiance), (x) => { wanted.sun.irradiance = scaled(wanted.sun.irradiance, x); }),
      ...(about.map
        ? [range("sky's map", 0, 4, 0.02, () => wanted.sky.scale, (x) => { wanted.sky.scale = x; }, (x) => `× ${digits(x)}`), range("its turn", -180, 180, 1, () => wanted.sky.rotation, (x) => { wanted.sky.rotation = x; }, degrees)]
        : [range("sky", 0, 2, 0.01, () => brightest(wanted.sky.radiance), (x) => { wanted.sky.radiance = scaled(wanted.sky.radiance, x); })])),
    group("Spheres", el("label", { className: "wide" }, "which", which), place(0), place(1), place(2),
      range("radius", reach / 500, reach / 2, reach / 1000, () => sphere()?.radius ?? null, (x) => { sphere().radius = x; }, centimetres),
      el("label", { className: "wide" }, "albedo", colour),
      el("div", { className: "buttons" }, button("Add", "One more sphere", add), button("Remove", "The chosen sphere", remove)),
      el("p", { textContent: "Or drag one in a picture: over the board, with Shift up and down." })),
    group("One pixel", el("label", { className: "wide" }, "its light", tick),
      el("div", { className: "buttons" }, button("Another sample", "Other random numbers", () => { sample += 1; ask_way(); })),
      el("p", { textContent: "Click a pixel: the way of the light that makes it is drawn." })),
    el("div", { className: "buttons" }, button("Save scene.toml", "The scene as it is now", save), button("Copy link", "To this view: reload it, or pass it to raytwin explore --view", copy), button("Reset", "As it was first", () => restore(structuredClone(about.first)))),
  );
  refresh();
}

function refresh() {
  selected = Math.min(selected, wanted.spheres.length - 1);
  for (const update of updates) update();
}

function restore(to) {
  wanted = to;
  viewer.data.objects = names();
  refresh();
  ask();
}

function add() {
  const like = sphere() ?? { center: [0, 0, 0.05], radius: 0.05, albedo: [0.8, 0.8, 0.8] }, [x, y, z] = like.center;
  wanted.spheres.push({ ...structuredClone(like), center: [x + 2.2 * like.radius, y, z] });
  selected = wanted.spheres.length - 1;
  restore(wanted);
}

function remove() {
  if (!sphere()) return;
  wanted.spheres.splice(selected, 1);
  restore(wanted);
}

async function save() {
  const answer = await fetch("/scene.toml", { method: "POST", headers: { "X-Raytwin-Token": token }, body: JSON.stringify(wanted) });
  if (!answer.ok) return say(`no scene.toml: ${answer.status} ${answer.statusText}`, true);
  const link = el("a", { href: URL.createObjectURL(await answer.blob()), download: "scene.toml" });
  link.click();
  URL.revokeObjectURL(link.href);
  say("scene.toml saved");
}

// ------------------------------------------------------------------------------------------ a view as a link

const pack = (value) => btoa(String.fromCharCode(...new TextEncoder().encode(JSON.stringify(value)))).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
const unpack = (text) => JSON.parse(new TextDecoder().decode(Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (c) => c.charCodeAt(0))));

function keep_link() {
  history.replaceState(null, "", `/#view=${pack(wanted)}`);
}

async function copy() {
  keep_link();
  try {
    await navigator.clipboard.writeText(location.href);
    say("the link is copied");
  } catch {
    say("the link stands in the address");
  }
}

// ------------------------------------------------------------------------------------------ dragging a sphere

const rows = about.camera.R_cam_board, T = about.camera.t_cam_board, [[fx, , cx], [, fy, cy]] = about.camera.K;
const turn = (v) => [0, 1, 2].map((k) => rows[0][k] * v[0] + rows[1][k] * v[1] + rows[2][k] * v[2]); // camera -> board
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const eye = turn(T).map((x) => -x), forward = turn([0, 0, 1]);
const ray = ([x, y]) => turn([(x - cx) / fx, (y - cy) / fy, 1]);

// Where a pixel's ray meets the plane through `point`; null where it runs along it.
function meet(pixel, point, normal) {
  const d = ray(pixel), slope = dot(d, normal), t = dot(point.map((p, k) => p - eye[k]), normal) / slope;
  return Math.abs(slope) > 1e-6 * Math.hypot(...d) && t > 0 ? eye.map((e, k) => e + t * d[k]) : null;
}

// The nearest sphere under a pixel, by the pinhole alone: near enough for a hand.
function sphere_at(pixel) {
  const d = ray(pixel), a = dot(d, d);
  let [best, found] = [Infinity, -1];
  wanted.spheres.forEach(({ center, radius }, i) => {
    const f = eye.map((e, k) => e - center[k]), b = dot(f, d), disc = b * b - a * (dot(f, f) - radius * radius), t = (-b - Math.sqrt(disc)) / a;
    if (disc > 0 && t > 0 && t < best) [best, found] = [t, i];
  });
  return found;
}

function pixel_of(event) {
  const pane = [...viewer.panes.values()].find((p) => p.canvas === event.target);
  if (!pane) return null;
  const box = pane.canvas.getBoundingClientRect(), f = viewer.frame_of(pane);
  return [f.left + (event.clientX - box.left) / f.s, f.top + (event.clientY - box.top) / f.s];
}

let held = null;
// A finger on a sphere drags it; anywhere else it scrolls the page.
$("viewer").addEventListener("touchstart", (event) => {
  const pixel = event.touches.length === 1 ? pixel_of(event.touches[0]) : null;
  if (pixel && sphere_at(pixel) >= 0) event.preventDefault();
}, { passive: false, capture: true });
$("viewer").addEventListener("pointerdown", (event) => {
  const pixel = event.button ? null : pixel_of(event), index = pixel ? sphere_at(pixel) : -1;
  if (index < 0 || event.pointerType === "touch" && !event.isPrimary) return;
  selected = index;
  held = { index, from: [...wanted.spheres[index].center], pixel, moved: false, id: event.pointerId, canvas: event.target };
  refresh();
}, true);
$("viewer").addEventListener("pointermove", (event) => {
  const pixel = pixel_of(event);
  if (!held) {
    $("viewer").classList.toggle("grab", Boolean(pixel) && sphere_at(pixel) >= 0);
    return;
  }
  if (!pixel) return;
  if (!held.moved && Math.hypot(pixel[0] - held.pixel[0], pixel[1] - held.pixel[1]) < 2) return;
  event.stopPropagation();
  held.moved = true;
  $("viewer").classList.add("grabbed");
  const ball = wanted.spheres[held.index];
  if (event.shiftKey) {
    const side = [forward[0], forward[1], 0], a = meet(held.pixel, held.from, side), b = meet(pixel, held.from, side);
    if (a && b) ball.center = [held.from[0], held.from[1], held.from[2] + b[2] - a[2]];
  } else {
    const normal = Math.abs(forward[2]) > 0.15 ? [0, 0, 1] : forward, a = meet(held.pixel, held.from, normal), b = meet(pixel, held.from, normal);
    if (a && b) ball.center = held.from.map((x, k) => x + b[k] - a[k]);
  }
  refresh();
  ask(true);
}, true);
for (const type of ["pointerup", "pointercancel"])
  $("viewer").addEventListener(type, (event) => {
    if (held?.moved) {
      event.stopPropagation();
      ask();
    }
    held = null;
    $("viewer").classList.remove("grabbed");
  }, true);
const keep = viewer.keep.bind(viewer);
viewer.keep = (x, y) => { keep(x, y); sample = 0; ask_way(); };

// ------------------------------------------------------------------------------------------ one pixel's light

const WAYS = { eye: ["#ffffff", "seen"], bounce: ["#7c3aed", "on to"], sun: ["#f59e0b", "the sun"], shadow: ["#111827", "the sun, hidden"], sky: ["#0ea5e9", "the sky"] };

function overlay(g, pane, f) {
  if (!way || !["test", "reference"].includes(pane.key)) return;
  for (const { kind, start, end } of way.legs) {
    const [a, b] = [f.at(...start), f.at(...end)];
    for (const [colour, width] of [["#fffc", 5], [WAYS[kind][0], 2]]) {
      g.strokeStyle = colour;
      g.lineWidth = width;
      g.setLineDash(kind === "shadow" || kind === "sky" ? [6, 5] : []);
      g.beginPath();
      if (kind === "eye") g.arc(...a, 5, 0, 2 * Math.PI);
      else { g.moveTo(...a); g.lineTo(...b); }
      g.stroke();
    }
    g.setLineDash([]);
  }
}

function tell_way() {
  $("way").hidden = !way;
  if (!way) return;
  const light = (colour) => colour.map((c) => digits(c)).join(", ");
  const lines = way.legs.filter(({ kind }) => kind !== "eye" && kind !== "bounce").map(({ kind, light: brought }) => el("li", { textContent: `${WAYS[kind][1]}: ${light(brought)}` }));
  $("way").querySelector("div").replaceChildren(
    el("p", { textContent: `Pixel ${way.pixel.join(", ")}, sample ${way.sample}: ${way.met.join(" → ")}` }), el("ol", {}, ...lines),
    el("p", { textContent: `In all ${light(way.light)} (radiance in red, green, blue)` }));
}

// ------------------------------------------------------------------------------------------ chart and ledger

function chart() {
  const all = [...points.past, ...points.now].filter((p) => p.seconds > 0), w = 560, h = 300, box = { left: 62, right: w - 12, top: 14, bottom: h - 38 };
  if (!all.length) return;
  const error = (p) => p.error ?? p.floor, decades = (values) => [Math.floor(Math.log10(Math.min(...values))), Math.ceil(Math.log10(Math.max(...values)) + 1e-9)];
  let [x0, x1] = decades(all.map((p) => p.seconds)), [y0, y1] = decades(all.map(error).filter((e) => e > 0).concat(1e-3));
  if (x1 === x0) x1 += 1;
  const x = (s) => box.left + ((Math.log10(s) - x0) / (x1 - x0)) * (box.right - box.left), y = (e) => box.bottom - ((Math.log10(Math.max(e, 10 ** y0)) - y0) / (y1 - y0)) * (box.bottom - box.top);
  const made = (tag, attributes, text) => { const node = document.createElementNS(SVG, tag); for (const [k, v] of Object.entries(attributes)) node.setAttribute(k, v); if (text !== undefined) node.textContent = text; return node; };
  const parts = [];
  for (let d = x0; d <= x1; d++) parts.push(made("line", { x1: x(10 ** d), x2: x(10 ** d), y1: box.top, y2: box.bottom }), made("text", { x: x(10 ** d), y: box.bottom + 17, "text-anchor": d === x1 ? "end" : "middle" }, seconds(10 ** d).replace(/\.0+ /, " ")));
  for (let d = y0; d <= y1; d++) parts.push(made("line", { x1: box.left, x2: box.right, y1: y(10 ** d), y2: y(10 ** d) }), made("text", { x: box.left - 7, y: y(10 ** d) + 4, "text-anchor": "end" }, d >= -3 ? String(Number((10 ** d).toPrecision(1))) : `1e${d}`));
  parts.push(made("text", { x: box.right, y: h - 5, "text-anchor": "end" }, "seconds"), made("text", { x: box.left + 6, y: box.top + 12 }, "RMSE"));
  for (const [list, age] of [[points.past, "past"], [points.now, ""]])
    for (const side of ["tracer", "twin"]) {
      const own = list.filter((p) => p.side === side && p.seconds > 0), colour = `var(--${side})`;
      if (!own.length) continue;
      if (own.length > 1) parts.push(made("path", { class: age, stroke: colour, d: `M${own.map((p) => `${x(p.seconds)} ${y(error(p))}`).join("L")}` }));
      for (const p of own) {
        const dot = made("circle", { class: age, cx: x(p.seconds), cy: y(error(p)), r: 4.5, stroke: colour, "stroke-width": 2, fill: p.error === null ? "var(--ground)" : colour });
        dot.append(made("title", {}, `${p.name}, ${p.samples} sample${p.samples === 1 ? "" : "s"}: ${seconds(p.seconds)}, RMSE ${p.error === null ? "below " : ""}${digits(error(p))}`));
        parts.push(dot);
      }
      const last = own.at(-1), left = x(last.seconds) > w - 110;
      if (!age) parts.push(made("text", { class: "name", x: x(last.seconds) + (left ? -9 : 9), y: y(error(last)) + (left ? 17 : -8), "text-anchor": left ? "end" : "start" }, `${side} ${last.samples > 1 ? last.samples : ""}`));
    }
  const svg = made("svg", { viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": points.now.map((p) => `${p.side}, ${p.samples} samples: ${seconds(p.seconds)}, error ${p.error === null ? "below " : ""}${digits(error(p))}`).join("; ") });
  svg.append(...parts);
  $("chart").querySelector("div").replaceChildren(svg);
}

function ledger(parts) {
  const most = Math.max(...parts.map((p) => p.rmse ?? 0)) || 1;
  const row = (p) => {
    const bar = el("i");
    bar.style.width = `${(100 * (p.rmse ?? 0)) / most}%`;
    const percent = (x) => (x === null || x === undefined ? "" : `${digits(100 * x, 0, { most: 2 })} %`);
    return el("tr", {}, el("td", { textContent: p.part }), el("td", { className: "bar" }, bar), ...[digits(p.rmse), percent(p.share_of_light), percent(p.share_of_error)].map((textContent) => el("td", { textContent })));
  };
  const head = el("tr", {}, ...["part", "", "RMSE", "of the light", "of the error²"].map((textContent) => el("th", { scope: "col", textContent })));
  $("ledger").querySelector("div").replaceChildren(el("table", {}, el("thead", {}, head), el("tbody", {}, ...parts.map(row))));
}

// ------------------------------------------------------------------------------------------ begin

try {
  if (link) wanted = unpack(link);
} catch {
  say("the link says nothing that can be shown", true);
}
build();
viewer.ready.then(() => {
  document.body.dataset.ready = "true";
  connect();
});
