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
let sample = 0, paths = 8, traced = false, way = null, number = 0, shown = 0, socket = null;
const points = { now: [], past: [] };

const seconds = (s) => (s >= 1 ? `${s.toFixed(2)} s` : `${(1000 * s).toPrecision(s < 0.01 ? 2 : 3)} ms`);

// ------------------------------------------------------------------------------------------ the viewer

const viewer = mount($("viewer"), {
  width: about.width, height: about.height, names: { test: "tracer", reference: "twin" }, surfaces: true,
  objects: about.names, overlay,
  panes: [
    { key: "test", kind: "radiance", title: "Tracer", tab: "tracer", alt: `${about.scene} by the tracer` },
    { key: "reference", kind: "radiance", title: "Twin", tab: "twin", alt: `${about.scene} by the twin` },
    { key: "map", kind: "map", title: "Difference", tab: "difference", alt: "Difference of the two" },
    { key: "objects", kind: "objects", title: "Silhouettes", tab: "silhouettes", aside: true, alt: "What each pixel sees in both" },
  ],
});

viewer.box.insertBefore($("found"), viewer.box.querySelector(".rt-inspector"));

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
  const { exposure, map } = viewer.state, { low, high, log } = map === "signed" && viewer.values.d ? viewer.scale() : { low: 0, high: 0.5, log: false };
  wanted.look = { exposure, low, high, log };
  if (!moving) remember();
  asking ??= requestAnimationFrame(() => {
    asking = null;
    if (socket.readyState !== 1) return;
    number += 1;
    began.set(number, change);
    socket.send(JSON.stringify({ number, wanted }));
    if (!wanted.moving) keep_link();
    ask_way();
  });
}

// The light paths of the clicked pixel, until they are cleared.
function ask_way() {
  if (traced && socket?.readyState === 1) socket.send(JSON.stringify({ pixel: viewer.kept, sample, paths: wanted.moving ? 1 : paths }));
}

function clear_way() {
  traced = false;
  way = null;
  tell_way();
  viewer.show();
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
  async picture(event, data, [[from, size], error]) {
    const bitmap = await createImageBitmap(new Blob([new Uint8Array(data, from, size)], { type: "image/jpeg" }));
    viewer.update(event.pane, bitmap);
    if (error) viewer.update("map", await recoloured(data, ...error));
    viewer.drawn();
    const side = event.pane === "test" ? "tracer" : "twin";
    tell("picture", side, event.number);
    say(`${side}: ${seconds(event.seconds)}`);
  },
  async pair(event, data, blobs, old) {
    if (old) return;
    await viewer.feed(event.planes.map((plane, i) => ({ ...plane, words: new Uint16Array(data, blobs[i][0], blobs[i][1] / 2) })), event.noisy);
    viewer.drawn();
    tell("pair", "both", event.number);
    if (viewer.data.objects.join() !== event.names.join()) {
      viewer.data.objects = event.names;
      refresh();
    }
    say(`${event.samples[0]} sample${event.samples[0] === 1 ? "" : "s"} per pixel by the tracer, ${event.samples[1]} by the twin`);
  },
  point(event) {
    points.now.push(event);
    chart();
  },
  async ledger(event, data, blobs) {
    let n = 0;
    const words = () => { const [from, size] = blobs[n++]; return new Uint16Array(data, from, size / 2); };
    await viewer.divide(event.maps.map((map) => ({ ...map, planes: map.planes.map((plane) => ({ ...plane, words: words() })) })));
    ledger(event.parts);
    viewer.arrange();
  },
  way(event) {
    if (!traced) return;
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

// A grey PNG of the difference in the colours that the map has at rest.
const screen = el("canvas"), pen = screen.getContext("2d", { willReadFrequently: true });
async function recoloured(data, from, size) {
  const grey = await createImageBitmap(new Blob([new Uint8Array(data, from, size)], { type: "image/png" }));
  Object.assign(screen, { width: grey.width, height: grey.height });
  pen.drawImage(grey, 0, 0);
  const picture = pen.getImageData(0, 0, grey.width, grey.height), bytes = picture.data, colours = viewer.ramp();
  for (let i = 0; i < bytes.length; i += 4) bytes.set(colours[bytes[i]], i);
  pen.putImageData(picture, 0, 0);
  return createImageBitmap(screen);
}

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

// `tell(moving)`: who is told of a change, the server by default.
function range(label, low, high, step, get, set, show = (x) => digits(x), tell = ask) {
  const input = el("input", { type: "range", min: low, max: high, step }), said = el("output");
  input.oninput = () => { set(input.valueAsNumber); refresh(); tell(true); };
  input.onchange = () => tell();
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

// The same with all options in sight.
function levels(get, set) {
  const all = about.rungs.map((level) => el("button", { type: "button", textContent: level, onclick: () => { set(level); refresh(); ask(); } }));
  updates.push(() => { for (const one of all) one.ariaPressed = String(one.textContent === get()); });
  return el("div", { className: "levels", role: "group", ariaLabel: "light level" }, ...all);
}

const button = (text, title, onclick) => el("button", { type: "button", textContent: text, title, onclick });
const group = (title, ...children) => el("fieldset", {}, el("legend", { textContent: title }), ...children);
const degrees = (x) => `${Math.round(x)}°`, centimetres = (x) => `${(100 * x).toFixed(1)} cm`;
const brightest = (colour) => Math.max(...colour);
const scaled = (colour, to) => (brightest(colour) > 0 ? colour.map((c) => few((c * to) / brightest(colour))) : [to, to, to]);
const decode = (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
const hex = (colour) => `#${colour.map((c) => Math.round(255 * encode(c)).toString(16).padStart(2, "0")).join("")}`;
const unhex = (text) => [1, 3, 5].map((i) => Number(decode(parseInt(text.slice(i, i + 2), 16) / 255).toFixed(4)));
const few = (x) => Number((Math.abs(x) < 1e-12 ? 0 : x).toPrecision(4)); // what a hand sets has four digits
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const step = (text, title, can, act) => { const made = button(text, title, act); updates.push(() => { made.disabled = !can(); }); return made; };
const sphere = () => wanted.spheres[selected] ?? null;

// The sun's place in the board's frame: azimuth from +X to +Y, elevation above the board.
function sun(azimuth, elevation) {
  const [a, e] = [azimuth, elevation].map((x) => (x * Math.PI) / 180);
  wanted.sun.to_light = [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)].map(few);
}
const azimuth = () => (Math.atan2(wanted.sun.to_light[1], wanted.sun.to_light[0]) * 180) / Math.PI;
const elevation = () => (Math.atan2(wanted.sun.to_light[2], Math.hypot(...wanted.sun.to_light.slice(0, 2))) * 180) / Math.PI;

// ------------------------------------------------------------------------------------------ the camera

const camera = () => wanted.camera ?? { R_cam_board: about.camera.R_cam_board, t_cam_board: about.camera.t_cam_board, zoom: 1 };
const eye_of = () => turn(camera().t_cam_board).map((x) => -x);
// What the camera goes round: the middle of the spheres as they were at first, or of the planes.
const pivot = (() => {
  const things = about.first.spheres.length ? about.first.spheres.filter((s) => s.radius < 10) : about.first.planes;
  return [0, 1, 2].map((k) => things.reduce((sum, thing) => sum + thing.center[k], 0) / (things.length || 1));
})();

// Where the camera stands around the pivot: degrees and metres.
function turned() {
  const away = eye_of().map((x, k) => x - pivot[k]), degree = 180 / Math.PI;
  return { azimuth: Math.atan2(away[1], away[0]) * degree, elevation: Math.atan2(away[2], Math.hypot(away[0], away[1])) * degree, distance: Math.hypot(...away) };
}

// Vectors v turned about a unit axis (Rodrigues).
function about_axis(axis, angle, v) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)], along = dot(axis, v) * (1 - c), [x, y, z] = axis;
  const cross = [y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]];
  return v.map((p, k) => p * c + cross[k] * s + axis[k] * along);
}

function stand(rows, eye) {
  wanted.camera = { R_cam_board: rows, t_cam_board: rows.map((row) => -dot(row, eye)), zoom: camera().zoom };
}

// Degrees about the board's normal, and up; the height stays between just below the board and above it.
function orbit(azimuth, up) {
  const { elevation } = turned(), radian = Math.PI / 180, rise = Math.min(Math.max(elevation + up, -10), 89) - elevation;
  const turns = (v) => about_axis([0, 0, 1], azimuth * radian, v);
  const side = turns([-Math.sin(turned().azimuth * radian), Math.cos(turned().azimuth * radian), 0]); // level, across the line of sight
  const all = (v) => about_axis(side, -rise * radian, turns(v));
  stand(camera().R_cam_board.map(all), all(eye_of().map((x, k) => x - pivot[k])).map((x, k) => x + pivot[k]));
}

function nearer(factor) {
  stand(camera().R_cam_board, eye_of().map((x, k) => pivot[k] + factor * (x - pivot[k])));
}

// ------------------------------------------------------------------------------------------ the sun on a dome

// Seen from above: the middle is the zenith, the ring the horizon, +X to the right.
function dome() {
  const size = 112, r = size / 2 - 8, disc = made("svg", { viewBox: `0 0 ${size} ${size}`, width: size, height: size, tabindex: 0, role: "slider", "aria-label": "The sun's direction" });
  const ball = made("circle", { r: 7, class: "sun" }), rings = [90, 60, 30].map((e) => made("circle", { cx: size / 2, cy: size / 2, r: (r * e) / 90, class: "ring" }));
  disc.append(...rings, made("text", { x: size - 7, y: size / 2 + 4, "text-anchor": "end" }, "x"), made("text", { x: size / 2, y: 16, "text-anchor": "middle" }, "y"), ball);
  updates.push(() => {
    const away = (r * Math.min(90 - elevation(), 98)) / 90, a = (azimuth() * Math.PI) / 180;
    ball.setAttribute("cx", size / 2 + away * Math.cos(a));
    ball.setAttribute("cy", size / 2 - away * Math.sin(a));
    ball.classList.toggle("below", elevation() < 0);
    for (const [name, value] of [["valuenow", Math.round(azimuth())], ["valuemin", -180], ["valuemax", 180], ["valuetext", `azimuth ${degrees(azimuth())}, elevation ${degrees(elevation())}`]]) disc.setAttribute(`aria-${name}`, value);
  });
  const move = (event) => {
    const box = disc.getBoundingClientRect(), k = size / box.width, x = (event.clientX - box.left) * k - size / 2, y = size / 2 - (event.clientY - box.top) * k;
    sun((Math.atan2(y, x) * 180) / Math.PI, 90 - (90 * Math.min(Math.hypot(x, y), r)) / r);
    refresh();
    ask(true);
  };
  disc.addEventListener("pointerdown", (event) => { disc.setPointerCapture(event.pointerId); move(event); });
  disc.addEventListener("pointermove", (event) => { if (event.buttons) move(event); });
  disc.addEventListener("pointerup", () => ask());
  disc.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: [5, 0], ArrowRight: [-5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[event.key];
    if (!by) return;
    event.preventDefault();
    sun(azimuth() + by[0], Math.min(Math.max(elevation() + by[1], -90), 90));
    refresh();
    ask();
  });
  return el("div", { className: "dome" }, disc);
}

function made(tag, attributes, text) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

function build() {
  const reach = Math.max(...wanted.spheres.map((s) => Math.hypot(...s.center) + s.radius), ...wanted.planes.map((p) => Math.hypot(...p.center) + Math.hypot(...p.half_u)), 0.1);
  const place = (axis) => range("xyz"[axis], -reach, reach, reach / 500, () => sphere()?.center[axis] ?? null, (x) => { sphere().center[axis] = x; }, centimetres);
  const which = el("select", { id: "which" });
  which.onchange = () => { selected = Number(which.value); refresh(); };
  updates.push(() => {
    if (which.options.length !== wanted.spheres.length) which.replaceChildren(...wanted.spheres.map((_, i) => el("option", { value: i })));
    [...which.options].forEach((option, i) => { option.textContent = viewer.data.objects[i] ?? `sphere ${i}`; });
    which.value = selected;
  });
  const colour = el("input", { type: "color" });
  colour.oninput = () => { if (sphere()) { sphere().albedo = unhex(colour.value); ask(true); } };
  colour.onchange = () => ask();
  updates.push(() => { colour.disabled = !sphere(); if (sphere()) colour.value = hex(sphere().albedo); });
  const mine = about.subject !== null;
  $("controls").onsubmit = (event) => event.preventDefault();
  const fold = el("button", { type: "button", className: "fold", textContent: "Controls", ariaExpanded: "true" }); // of a phone's sheet
  fold.onclick = () => { fold.ariaExpanded = String($("controls").classList.toggle("folded") === false); };
  $("controls").append(fold,
    group("Tracer", ...(mine ? [el("p", { textContent: about.subject })] : []),
      levels(() => wanted.rung, (x) => { wanted.rung = x; }),
      choice("engine", about.engines, () => wanted.engine, (x) => { wanted.engine = x; }, mine),
      choice("solver", about.solvers, () => wanted.solver, (x) => { wanted.solver = x; }, mine)),
    group("Twin", levels(() => wanted.twin_rung, (x) => { wanted.twin_rung = x; })),
    group("Sampled light", range("depth", 2, 16, 1, () => wanted.depth, (x) => { wanted.depth = x; }, String),
      range("samples", 0, 12, 1, () => Math.log2(wanted.samples), (x) => { wanted.samples = 2 ** x; }, (x) => String(2 ** x))),
    group("Camera", range("turn", -180, 180, 0.5, () => turned().azimuth, (x) => orbit(x - turned().azimuth, 0), degrees),
      range("height", -10, 89, 0.5, () => turned().elevation, (x) => orbit(0, x - turned().elevation), degrees),
      range("distance", Math.log10(turned().distance) - 1, Math.log10(turned().distance) + 1, 0.01, () => Math.log10(turned().distance), (x) => nearer(10 ** x / turned().distance), (x) => centimetres(10 ** x)),
      range("zoom", -2, 3, 0.05, () => Math.log2(camera().zoom), (x) => { wanted.camera = { ...camera(), zoom: 2 ** x }; }, (x) => `× ${digits(2 ** x, 0, { most: 2 })}`),
      el("p", { textContent: "Or drag the background of a picture." })),
    group("Sun and sky", dome(), range("azimuth", -180, 180, 1, azimuth, (x) => sun(x, elevation()), degrees),
      range("elevation", -90, 90, 1, elevation, (x) => sun(azimuth(), x), degrees),
      range("sun", 0, 10, 0.05, () => brightest(wanted.sun.irradiance), (x) => { wanted.sun.irradiance = scaled(wanted.sun.irradiance, x); }),
      ...(about.map
        ? []
        : [range("sky", 0, 2, 0.01, () => brightest(wanted.sky.radiance), (x) => { wanted.sky.radiance = scaled(wanted.sky.radiance, x); })])),
    group("Spheres", el("label", { className: "wide" }, "which", which), place(0), place(1), place(2),
      range("radius", reach / 500, reach / 2, reach / 1000, () => sphere()?.radius ?? null, (x) => { sphere().radius = x; }, centimetres),
      el("label", { className: "wide" }, "albedo", colour),
      el("div", { className: "buttons" }, button("Add", "One more sphere", add), button("Remove", "The chosen sphere", remove)),
      el("p", { textContent: "Or drag one in a picture: over the board, with Shift up and down." })),
    el("div", { className: "buttons" }, step("Undo", "Take the last change back (Ctrl + Z)", () => past.length > 1, undo), step("Redo", "Make it again (Ctrl + Shift + Z)", () => future.length, redo)),
    el("div", { className: "buttons" }, button("Save scene.toml", "The scene as it is now", save), button("Copy link", "To this view: reload it, or pass it to raytwin explore --view", copy), button("Reset", "As it was first", () => restore(structuredClone(about.first)))),
  );
  $("way").querySelector("form").append(
    range("paths", 0, 6, 1, () => Math.log2(paths), (x) => { paths = 2 ** x; ask_way(); }, (x) => String(2 ** x), () => {}),
    button("Other samples", "Other random numbers", () => { sample += paths; ask_way(); }), button("Clear", "Draw no light paths (Escape)", clear_way));
  $("way").querySelector("form").onsubmit = (event) => event.preventDefault();
  refresh();
}

function refresh() {
  selected = Math.min(selected, wanted.spheres.length - 1);
  for (const update of updates) update();
}

function restore(to) {
  wanted = to;
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

// ------------------------------------------------------------------------------------------ taking back

const past = [], future = []; // what was wanted, as JSON; the last of `past` is what is shown
const plain = () => JSON.stringify({ ...wanted, look: undefined, moving: false });
function remember() {
  if (plain() === past.at(-1)) return;
  past.push(plain());
  future.length = 0;
  refresh();
}
function undo() {
  if (past.length < 2) return;
  future.push(past.pop());
  restore(JSON.parse(past.at(-1)));
}
function redo() {
  if (!future.length) return;
  past.push(future.pop());
  restore(JSON.parse(past.at(-1)));
}
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
  event.preventDefault();
  event.shiftKey ? redo() : undo();
});

// ------------------------------------------------------------------------------------------ dragging a sphere

const [[fx, , cx], [, fy, cy]] = about.camera.K;
const turn = (v) => { const rows = camera().R_cam_board; return [0, 1, 2].map((k) => rows[0][k] * v[0] + rows[1][k] * v[1] + rows[2][k] * v[2]); }; // camera -> board
const ray = ([x, y]) => turn([(x - cx) / fx / camera().zoom, (y - cy) / fy / camera().zoom, 1]);

// Where a pixel's ray meets the plane through `point`; null where it runs along it.
function meet(pixel, point, normal) {
  const eye = eye_of(), d = ray(pixel), slope = dot(d, normal), t = dot(point.map((p, k) => p - eye[k]), normal) / slope;
  return Math.abs(slope) > 1e-6 * Math.hypot(...d) && t > 0 ? eye.map((e, k) => e + t * d[k]) : null;
}

// The nearest sphere under a pixel, by the pinhole alone: near enough for a hand.
function sphere_at(pixel) {
  const d = ray(pixel), eye = eye_of(), a = dot(d, d);
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
  if (!pixel || viewer.state.area || event.pointerType === "touch" && (index < 0 || !event.isPrimary)) return;
  if (index < 0) {
    // Beside the objects the camera turns, where the whole picture is seen: else the viewer pans.
    if (viewer.state.mode !== "wipe" && viewer.view.span >= about.width) held = { orbit: [event.clientX, event.clientY], moved: false };
    return;
  }
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
  if (held.orbit) {
    const [x, y] = held.orbit, by = [event.clientX - x, event.clientY - y];
    event.stopPropagation();
    if (!held.moved && Math.hypot(...by) < 4) return;
    Object.assign(held, { moved: true, orbit: [event.clientX, event.clientY] });
    orbit(-by[0] / 3, by[1] / 3);
    refresh();
    return ask(true);
  }
  if (!pixel) return;
  if (!held.moved && Math.hypot(pixel[0] - held.pixel[0], pixel[1] - held.pixel[1]) < 2) return;
  event.stopPropagation();
  held.moved = true;
  $("viewer").classList.add("grabbed");
  const ball = wanted.spheres[held.index];
  if (event.shiftKey) {
    const forward = turn([0, 0, 1]), side = [forward[0], forward[1], 0], a = meet(held.pixel, held.from, side), b = meet(pixel, held.from, side);
    if (a && b) ball.center = [held.from[0], held.from[1], held.from[2] + b[2] - a[2]].map(few);
  } else {
    const forward = turn([0, 0, 1]), normal = Math.abs(forward[2]) > 0.15 ? [0, 0, 1] : forward, a = meet(held.pixel, held.from, normal), b = meet(pixel, held.from, normal);
    if (a && b) ball.center = held.from.map((x, k) => (k === 2 && normal[2] === 1 ? x : few(x + b[k] - a[k])));
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
viewer.keep = (x, y) => { keep(x, y); sample = 0; traced = true; ask_way(); };
document.addEventListener("keydown", (event) => { if (event.key === "Escape") clear_way(); });

// ------------------------------------------------------------------------------------------ one pixel's light

const WAYS = { eye: ["#ffffff", "seen"], bounce: ["#7c3aed", "on to"], sun: ["#f59e0b", "the sun"], shadow: ["#111827", "the sun, hidden"], sky: ["#0ea5e9", "the sky"] };

function overlay(g, pane, f) {
  if (!way || !["test", "reference"].includes(pane.key)) return;
  const legs = way.ways.flatMap(({ legs }) => legs), many = way.ways.length > 1;
  g.globalAlpha = many ? Math.max(0.25, 1.6 / Math.sqrt(way.ways.length)) : 1;
  for (const { kind, start, end } of legs) {
    const [a, b] = [f.at(...start), f.at(...end)];
    for (const [colour, width] of [["#fffc", many ? 3 : 5], [WAYS[kind][0], many ? 1.4 : 2]]) {
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
  g.globalAlpha = 1;
}

// One path leg by leg; of many, what each kind of leg brings on average.
function tell_way() {
  $("way").hidden = !way;
  if (!way) return;
  const { ways } = way, light = (colour) => colour.map((c) => digits(c)).join(", "), mean = (list) => [0, 1, 2].map((c) => list.reduce((sum, l) => sum + l[c], 0) / ways.length);
  const brings = ways.flatMap(({ legs }) => legs).filter(({ kind }) => kind !== "eye" && kind !== "bounce");
  const kinds = ways.length > 1 ? [...new Set(brings.map(({ kind }) => kind))].map((kind) => ({ kind, light: mean(brings.filter((leg) => leg.kind === kind).map((leg) => leg.light)) })) : brings;
  const first = `Pixel ${way.pixel.join(", ")}, ${ways.length > 1 ? `${ways.length} samples from ${way.sample} on` : `sample ${way.sample}: ${ways[0].met.join(" → ")}`}`;
  $("way").querySelector("div").replaceChildren(
    el("p", { textContent: first }), el("ol", {}, ...kinds.map(({ kind, light: brought }) => el("li", { textContent: `${WAYS[kind][1]}: ${light(brought)}` }))),
    el("p", { textContent: `${ways.length > 1 ? "On average" : "In all"} ${light(mean(ways.map((one) => one.light)))} (radiance in red, green, blue)` }));
}

// ------------------------------------------------------------------------------------------ chart and ledger

// Powers of ten, with 2 and 5 between where there are fewer than three.
function ticks_of(low, high) {
  const all = (steps) => Array.from({ length: Math.ceil(high) - Math.floor(low) + 1 }, (_, k) => steps.map((m) => m * 10 ** (Math.floor(low) + k))).flat().filter((v) => Math.log10(v) >= low - 1e-9 && Math.log10(v) <= high + 1e-9);
  return all([1]).length > 2 ? all([1]) : all([1, 2, 5]);
}

function chart() {
  const all = [...points.past, ...points.now].filter((p) => p.seconds > 0), w = 480, h = 290, box = { left: 62, right: w - 12, top: 14, bottom: h - 40 };
  if (!all.length) return;
  const error = (p) => p.error ?? p.floor, around = (values) => { const logs = values.map(Math.log10), low = Math.min(...logs), high = Math.max(...logs), pad = Math.max(0.12 * (high - low), 0.35); return [low - pad, high + pad]; };
  const [x0, x1] = around(all.map((p) => p.seconds)), [y0, y1] = around(all.map(error).filter((e) => e > 0).concat(1e-3));
  const x = (s) => box.left + ((Math.log10(s) - x0) / (x1 - x0)) * (box.right - box.left), y = (e) => box.bottom - ((Math.log10(Math.max(e, 10 ** y0)) - y0) / (y1 - y0)) * (box.bottom - box.top);
  const parts = [];
  for (const v of ticks_of(x0, x1)) parts.push(made("line", { x1: x(v), x2: x(v), y1: box.top, y2: box.bottom }), made("text", { x: x(v), y: box.bottom + 17, "text-anchor": "middle" }, seconds(v).replace(/\.0+ /, " ")));
  for (const v of ticks_of(y0, y1)) parts.push(made("line", { x1: box.left, x2: box.right, y1: y(v), y2: y(v) }), made("text", { x: box.left - 7, y: y(v) + 4, "text-anchor": "end" }, v < 1e-3 ? v.toExponential(0).replace(/-(\d)$/, "-0$1") : String(Number(v.toPrecision(1)))));
  parts.push(made("text", { x: box.right, y: h - 5, "text-anchor": "end" }, "seconds"), made("text", { x: box.left + 6, y: box.top + 12 }, "RMSE"));
  const ends = ["tracer", "twin"].map((side) => points.now.filter((p) => p.side === side && p.seconds > 0).at(-1)).filter(Boolean);
  const upper = ends.sort((p, q) => y(error(p)) - y(error(q)))[0];  // its name stands above it, the other's below: they never meet
  for (const [list, age] of [[points.past, "past"], [points.now, ""]])
    for (const side of ["tracer", "twin"]) {
      const own = list.filter((p) => p.side === side && p.seconds > 0), colour = `var(--${side})`;
      if (!own.length) continue;
      if (own.length > 1) parts.push(made("path", { class: age, stroke: colour, d: `M${own.map((p) => `${x(p.seconds)} ${y(error(p))}`).join("L")}` }));
      for (const p of own) {
        const dot = made("circle", { class: age, cx: x(p.seconds), cy: y(error(p)), r: 4.5, stroke: colour, "stroke-width": 2, fill: p.error === null ? "var(--ground)" : colour, "data-name": p.name });
        dot.append(made("title", {}, `${p.name}\n${p.samples} sample${p.samples === 1 ? "" : "s"} per pixel\n${seconds(p.seconds)}, RMSE ${p.error === null ? "below " : ""}${digits(error(p))}`));
        parts.push(dot);
      }
      const last = own.at(-1), left = x(last.seconds) > w - 110;
      if (!age) parts.push(made("text", { class: "name", x: x(last.seconds) + (left ? -9 : 9), y: y(error(last)) + (last === upper ? -8 : 17), "text-anchor": left ? "end" : "start" }, `${side} ${last.samples > 1 ? last.samples : ""}`));
    }
  const svg = made("svg", { viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": points.now.map((p) => `${p.side}, ${p.samples} samples: ${seconds(p.seconds)}, error ${p.error === null ? "below " : ""}${digits(error(p))}`).join("; ") });
  svg.append(...parts);
  $("chart").querySelector("div").replaceChildren(svg);
}

const part_button = (name) => el("button", { type: "button", className: "part", "data-part": name, title: "Show this part as the difference", textContent: name });

function ledger(parts) {
  const most = Math.max(...parts.map((p) => p.rmse ?? 0)) || 1;
  const row = (p) => {
    const bar = el("i");
    bar.style.width = `${(100 * (p.rmse ?? 0)) / most}%`;
    const percent = (x) => (x === null || x === undefined ? "" : `${digits(100 * x, 0, { most: 2 })} %`);
    return el("tr", {}, el("td", {}, viewer.parts.has(`part: ${p.part}`) ? part_button(p.part) : p.part), el("td", { className: "bar" }, bar), ...[digits(p.rmse), percent(p.share_of_light), percent(p.share_of_error)].map((textContent) => el("td", { textContent })));
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
