// One viewer for two images of radiance and what belongs to them: mount(element, data) -> { update, set, look, ... }.
//
// Pixel (x, y) covers x - 1/2 .. x + 1/2, y down. `data` is what packing.py makes, with `names` {test, reference},
// `panes` [{key, kind, title, alt, note}], `objects`, `bound` {share, scale, held} or null, `noisy`, `places` [{x, y,
// width, height}], `failing` [[x, y, width, height]], `marks` [[x, y]], `overlay(g, pane, frame, viewer)` (draws more),
// `exposure` (stops), `address` (whether the page's address says where to look).
// Kinds of panes: radiance (key test or reference), map (of their difference), objects (what each pixel sees), picture
// (8 bits: `url`, perhaps drawn `over` another pane at `box`). All panes show the same part of the frame.

const MAPS = {
  signed: { title: "Difference", unit: "radiance", signed: true },
  relative: { title: "Relative difference", unit: "of |r| + 0.01", signed: true },
  sigmas: { title: "Difference in σ", unit: "standard deviations", signed: true },
  flip: { title: "FLIP", unit: "0: alike, 1: as different as can be", signed: false },
};
const TONES = {
  sRGB: (x) => x,
  Reinhard: (x) => x / (1 + x),
  filmic: (x) => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), // Narkowicz's fit of ACES
};
const CHANNELS = ["RGB", "R", "G", "B", "luminance"];
// Linear Rec. 709, from no error to the largest; far enough apart to differ by lightness as well as by hue.
const NIGHT = globalThis.matchMedia?.("(prefers-color-scheme: dark)").matches;
const [DARKER, BRIGHTER] = NIGHT // around what agrees: the page's own ground
  ? [[[0.01, 0.013, 0.02], [0.03, 0.16, 0.6], [0.5, 0.78, 1]], [[0.01, 0.013, 0.02], [0.62, 0.09, 0.03], [1, 0.74, 0.5]]]
  : [[[1, 1, 1], [0.25, 0.55, 0.95], [0.01, 0.06, 0.45]], [[1, 1, 1], [0.95, 0.42, 0.22], [0.42, 0.005, 0.02]]];
const MAGMA = [0x000004, 0x1d1147, 0x51127c, 0x832681, 0xb73779, 0xe75263, 0xfc8961, 0xfec488, 0xfcfdbf].map((hex) => [hex >> 16, (hex >> 8) & 255, hex & 255]);
const LOST = [0, 203, 0]; // NaN and infinity
const OBJECTS = [[250, 250, 250], ...[206, 178, 221, 190, 168, 213, 184, 198].map((v) => [v, v, v]), [59, 66, 76], [230, 97, 0], [93, 58, 155], [214, 0, 110]];
const TONING = ["exposure", "gamma", "tone"], MAPPING = ["map", "channel"]; // parts of the state, and what depends on them
const MOST = 256; // CSS pixels a pixel is magnified to at most
const NUMBERS = 46; // from here on its values are written into it
const EPSILON = 2 ** -11; // relative rounding of a half float

const rgba = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
const signed = (x) => (x < 0 ? "-" : "+") + Math.abs(x).toFixed(2);
const mix = (stops, t) => {
  const at = clamp(t, 0, 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2), f = at - i;
  return stops[i].map((v, c) => v + f * (stops[i + 1][c] - v));
};

const single = (channel, x, y, z) => (channel === "R" ? x : channel === "G" ? y : channel === "B" ? z : 0.2126 * x + 0.7152 * y + 0.0722 * z);
const distance = (x) => (Number.isNaN(x) ? Infinity : Math.abs(x));
const farther = (x, y) => (distance(y) > distance(x) ? y : x);

const FLOAT = new Float32Array(1), BITS = new Uint32Array(FLOAT.buffer);
const HALVES = (() => {
  const table = new Float32Array(65536);
  for (let word = 0; word < 65536; word++) {
    const sign = word & 0x8000 ? -1 : 1, exponent = (word >> 10) & 31, fraction = word & 1023;
    table[word] = exponent === 31 ? (fraction ? NaN : sign * Infinity)
      : sign * (exponent ? 2 ** (exponent - 25) * (1024 + fraction) : 2 ** -24 * fraction);
  }
  return table;
})();

function mapped(Kind, from, of) {
  const made = new Kind(from.length);
  for (let i = 0; i < made.length; i++) made[i] = of(from[i], i);
  return made;
}

// A table over the upper 17 bits of a float32: sign, exponent, 8 bits of fraction.
function table(Kind, of) {
  const made = new Kind(1 << 17);
  for (let i = 0; i < made.length; i++) {
    BITS[0] = (i << 15) | 0x4000;
    made[i] = of(FLOAT[0]);
  }
  return made;
}

// One spelling of numbers everywhere: 1.5e-07, as Python has it.
const spelled = (text) => text.replace(/e([+-])(\d)$/, (_, sign, digit) => `e${sign}0${digit}`);

// v as it is known to +- e: its last digit is right but for one. At most `most` significant digits.
function digits(v, e, { sign = false, most = 3 } = {}) {
  if (v === null || v === undefined) return "–";
  if (!Number.isFinite(v)) return String(v);
  if (v === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(v))), place = e > 0 ? Math.ceil(Math.log10(2 * e) - 1e-9) : -99;
  const count = Math.min(size - place + 1, most);
  let text = "0";
  if (count >= 1) text = size < -3 || size > 4 ? v.toExponential(count - 1) : count > size ? v.toPrecision(count) : String(Number(v.toPrecision(count)));
  else if (Math.round(v / 10 ** place)) text = size < -3 || size > 4 ? (Math.sign(v) * 10 ** place).toExponential(0) : (Math.sign(v) * 10 ** place).toFixed(Math.max(0, -place));
  return (sign && v > 0 && text !== "0" ? "+" : "") + spelled(text);
}

const short = (v) => {
  const [m, e] = (v && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e4) ? v.toExponential(2) : String(Number(v.toPrecision(6)))).split("e");
  return spelled((m.includes(".") ? m.replace(/\.?0+$/, "") : m) + (e ? `e${e}` : ""));
};

function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) name in made ? (made[name] = value) : made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// ------------------------------------------------------------------------------------------ values

async function inflate(plane, count) {
  const packed = await fetch(`data:application/octet-stream;base64,${plane.data}`);
  const raw = new Uint8Array(await new Response(packed.body.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
  if (raw.length !== 2 * count) throw new Error(`plane ${plane.name}: ${raw.length} bytes, not ${2 * count}`);
  const words = new Uint16Array(count);
  for (let i = 0; i < count; i++) words[i] = (raw[i] << 8) | raw[count + i];
  return words;
}

async function decode(plane, columns, lines, into, offset, stride) {
  const words = plane.words ?? (await inflate(plane, columns * lines)), half = plane.kind === "half", scale = half ? 2 ** plane.shift : plane.step;
  for (let y = 0, i = 0; y < lines; y++)
    for (let x = 0, before = 0; x < columns; x++, i++) {
      const word = plane.left ? (before = (before + words[i]) & 0xffff) : words[i];
      into[offset + i * stride] = (half ? HALVES[word] : (word << 16) >> 16) * scale;
    }
}

// What is known of both images: interleaved r, t - r, t and σ; ids and depths; each null where there is none.
async function values(data) {
  const n = data.columns * data.lines, found = { count: n }, jobs = [];
  const named = Object.fromEntries((data.planes ?? []).map((plane) => [plane.name, plane]));
  for (const [key, prefix] of [["r", ""], ["d", "d"], ["s", "s"]])
    if (named[`${prefix}R`]) {
      found[key] = new Float32Array(3 * n);
      [..."RGB"].forEach((c, k) => jobs.push(decode(named[prefix + c], data.columns, data.lines, found[key], k, 3)));
    }
  for (const [key, Kind] of [["id", Int16Array], ["did", Int16Array], ["depth", Float32Array], ["ddepth", Float32Array], ["flip", Float32Array], ["at", Uint16Array]])
    if (named[key]) jobs.push(decode(named[key], data.columns, data.lines, (found[key] = new Kind(n)), 0, 1));
  await Promise.all(jobs);
  if (found.d) found.t = mapped(Float32Array, found.r, (x, i) => x + found.d[i]);
  found.step = named.depth?.step ?? 0;
  return found;
}

// ------------------------------------------------------------------------------------------ the viewer

class Viewer {
  constructor(root, data) {
    this.root = root;
    this.data = { columns: data.width, lines: data.height, thin: 1, panes: [], places: [], failing: [], marks: [], objects: [], exposure: 0, noisy: false, binned: false, bound: null, ...data };
    const { width, height, columns, lines, exposure } = this.data, sigmas = (this.data.planes ?? []).some((plane) => plane.name === "sR");
    this.values = { count: columns * lines };
    this.kept = this.at = null; // the clicked pixel, which stays when the pointer leaves; the one that is shown
    this.place = -1;
    this.state = {
      mode: root.clientWidth < 700 ? "one" : "grid", solo: this.data.panes[0]?.key, wipe: 0.5, exposure, gamma: 1, tone: "sRGB",
      channel: "RGB", map: sigmas ? "sigmas" : "signed", scale: 0, outlines: true,
    };
    this.view = { x: (width - 1) / 2, y: (height - 1) / 2, span: Infinity };
    this.cache = new Map();
    this.frame = null;
    this.build();
    this.ready = this.load();
  }

  async load() {
    const pictures = this.data.panes.filter((pane) => pane.url).map(async (pane) => {
      const image = new Image();
      image.src = pane.url;
      await image.decode();
      this.panes.get(pane.key).picture = image;
    });
    const [stored] = await Promise.all([values(this.data), ...pictures]);
    Object.assign(this.values, stored); // what was pushed meanwhile stays
    this.refresh();
    this.say("point at a pixel, or click one");
    const [first] = this.data.places, start = first ? [first.x + (first.width >> 1), first.y + (first.height >> 1)] : this.data.start;
    if (start && this.panes.size) this.inspect(...start);
    this.at = null;
    if (this.data.address) this.follow(location.hash, false);
    this.drawn();
    this.root.dataset.ready = "true";
  }

  // New pixels of a pane: Float32Array or Uint16Array (half floats), R, G, B of each pixel; or anything that a canvas
  // draws (an image, a bitmap), which is shown as it is.
  update(name, pixels) {
    const v = this.values, pane = this.panes.get(name);
    pane.picture = ArrayBuffer.isView(pixels) ? null : pixels;
    if (pane.picture) return void (pane.figure.hidden || this.paint_pane(pane)); // nothing else has changed
    v[name === "test" ? "t" : "r"] = pixels instanceof Uint16Array ? mapped(Float32Array, pixels, (word) => HALVES[word]) : pixels;
    if (v.t && v.r) v.d = mapped(Float32Array, v.t, (x, i) => x - v.r[i]);
    this.refresh();
  }

  // All that is known of both images, anew: planes as `values` takes them.
  async feed(planes) {
    this.values = await values({ ...this.data, planes });
    this.data.noisy = Boolean(this.values.s);
    for (const pane of this.panes.values()) if (pane.kind === "radiance") pane.picture = null;
    if (this.state.map === "sigmas" && !this.values.s) this.state.map = "signed";
    this.refresh();
    if (this.at) this.inspect(...this.at);
  }

  // Planes R, G, B of another picture of this size, as `update` takes them.
  async decode(planes) {
    const { columns, lines } = this.data, into = new Float32Array(3 * columns * lines);
    await Promise.all(planes.map((plane, c) => decode(plane, columns, lines, into, c, 3)));
    return into;
  }

  // Any of `state`.
  set(changes) {
    const s = Object.assign(this.state, changes);
    s.exposure = clamp(s.exposure, -20, 20);
    s.gamma = clamp(s.gamma, 0.2, 5);
    s.scale = clamp(s.scale, -8, 8);
    s.wipe = clamp(s.wipe, 0, 1);
    this.show();
  }

  refresh() {
    for (const name of this.cache.keys()) if (name !== "tones" && name !== "colours") this.cache.delete(name);
    for (const pane of this.panes.values()) pane.drawn = "";
    this.show();
  }

  show() {
    this.arrange();
    this.frame ??= requestAnimationFrame(() => this.drawn());
  }

  // What was asked for is drawn now, and not at the screen's next frame.
  drawn() {
    if (!this.frame) return;
    cancelAnimationFrame(this.frame);
    this.frame = null;
    this.paint();
  }

  // ---------------------------------------------------------------- layers: values as colours

  // What `make` gave, as long as the named parts of the state are what they were.
  remember(name, on, make) {
    const key = on.map((part) => this.state[part] ?? part).join();
    if (this.cache.get(name)?.key !== key) this.cache.set(name, { key, value: make() });
    return this.cache.get(name).value;
  }

  // Bytes by the upper bits of a radiance.
  tones() {
    const { exposure, gamma, tone } = this.state, gain = 2 ** exposure, curve = TONES[tone];
    return this.remember("tones", TONING, () => table(Uint8Array, (x) => {
      if (!(x > 0)) return 0;
      const y = clamp(curve(Math.min(x * gain, 1e9)), 0, 1);
      return Math.round(255 * (gamma === 1 ? encode(y) : encode(y) ** (1 / gamma)));
    }));
  }

  // Float32Array of one of MAPS.
  map() {
    const { r, d, s, flip, count } = this.values;
    return this.remember("map", MAPPING, () => (this.state.map === "flip" ? flip ?? new Float32Array(count) : this.errors(d, r, s)));
  }

  // Errors d of r with deviations s in the map's unit and the chosen channel; of all three, that which is farthest off.
  errors(d, r, s) {
    const { map, channel } = this.state, made = new Float32Array(d ? d.length / 3 : this.values.count);
    const unit = { signed: (e) => e, relative: (e, at) => e / (Math.abs(r[at]) + 0.01), sigmas: (e, at) => this.sigmas(e, s ? s[at] : 0, r[at]) }[map];
    for (let i = 0, at = 0; d && i < made.length; i++, at += 3) {
      const x = unit(d[at], at), y = unit(d[at + 1], at + 1), z = unit(d[at + 2], at + 2);
      made[i] = channel === "RGB" ? farther(farther(x, y), z) : single(channel, x, y, z);
    }
    return made;
  }

  // Without noise there is no σ: an error is none within the tolerance, and beyond all of them else.
  sigmas(e, s, r) {
    const { share, scale } = this.data.bound ?? { share: 1e-5, scale: 1 };
    return s > 0 || !Number.isFinite(e) ? e / s : Math.abs(e) <= share * Math.max(scale, Math.abs(r)) ? 0 : e * Infinity;
  }

  // The map with k x k pixels in one: of exact images the worst of them, of noise their mean.
  reduced(k) {
    const { d, r, s } = this.values;
    if (k === 1 || !this.data.noisy || !d || this.state.map === "flip") return this.worst(this.map(), k);
    return this.errors(this.mean(d, k), this.mean(r, k), s && this.mean(s, k, true));
  }

  // k x k pixels in one: `into(i, at)` for pixel i, which goes into `at`.
  blocks(k, into) {
    const { columns, lines } = this.data, w = Math.ceil(columns / k);
    for (let y = 0, i = 0; y < lines; y++)
      for (let x = 0, row = Math.floor(y / k) * w; x < columns; x++, i++) into(i, row + Math.floor(x / k));
    return w;
  }

  // Of each k x k values the farthest from 0.
  worst(from, k) {
    if (k === 1) return from;
    const { columns, lines } = this.data, made = new from.constructor(Math.ceil(columns / k) * Math.ceil(lines / k)), far = new Float32Array(made.length).fill(-1);
    this.blocks(k, (i, at) => {
      const size = distance(from[i]);
      if (size > far[at]) { far[at] = size; made[at] = from[i]; }
    });
    return made;
  }

  // The mean of k x k pixels' R, G, B, as if it had been rendered smaller; of deviations, the mean's.
  mean(from, k, deviations = false) {
    if (k === 1) return from;
    const { columns, lines } = this.data, n = new Float32Array(Math.ceil(columns / k) * Math.ceil(lines / k)), made = new Float32Array(3 * n.length);
    this.blocks(k, (i, at) => {
      n[at]++;
      for (let c = 0; c < 3; c++) made[3 * at + c] += deviations ? from[3 * i + c] ** 2 : from[3 * i + c];
    });
    return made.map((sum, i) => (deviations ? Math.sqrt(sum) : sum) / n[Math.floor(i / 3)]);
  }

  // From which value on a map has which colour: equal ratios between low and high where the images are exact.
  scale() {
    const { map, scale } = this.state, { bound, noisy } = this.data, factor = 10 ** (scale / 2), evenly = (high) => ({ low: 0, high: high * factor, log: false });
    return this.remember("scale", [...MAPPING, "scale"], () => {
      if (map === "flip" || map === "sigmas") return evenly(map === "flip" ? 1 : 5);
      const all = this.map();
      if (noisy) {
        const step = Math.max(1, Math.floor(all.length / 3e4)), some = all.filter((v, i) => i % step === 0 && Number.isFinite(v)).map(Math.abs).sort();
        const q = some[Math.ceil(0.999 * some.length) - 1] || 1, decade = 10 ** Math.floor(Math.log10(q));
        return evenly(decade * [1, 2, 5, 10].find((step) => step * decade >= q * 0.999));
      }
      const worst = all.reduce((most, v) => (Number.isFinite(v) ? Math.max(most, Math.abs(v)) : most), 0);
      const allowed = (bound?.share ?? 1e-5) * (map === "signed" ? bound?.scale ?? 1 : 1);
      const low = 10 ** (Math.floor(Math.log10(allowed)) - 2), high = Math.max(10 ** Math.ceil(Math.log10(worst || low) - 1e-9), 1e3 * low);
      return { low: low * factor, high: high * factor, log: true };
    });
  }

  // -1 to 1, where 1 is the full colour.
  position(v) {
    const { low, high, log } = this.scale(), size = Math.abs(v);
    return Math.sign(v) * Math.min(log ? Math.log10(Math.max(size, low) / low) / Math.log10(high / low) : size / high, 1);
  }

  shade(v) {
    if (!Number.isFinite(v) && (Number.isNaN(v) || this.state.map !== "sigmas")) return LOST;
    const t = this.position(v);
    if (this.state.map === "flip") return mix(MAGMA, t).map(Math.round);
    return mix(t < 0 ? DARKER : BRIGHTER, Math.abs(t)).map((x) => Math.round(255 * encode(x)));
  }

  // A canvas for a pane, each of its pixels k x k of the planes'.
  layer(pane, k) {
    const on = { radiance: [...TONING, "channel"], map: [...MAPPING, "scale"], objects: [] }[pane.kind], key = [k, ...on.map((part) => this.state[part])].join();
    if (pane.drawn === key) return pane.layer;
    const w = Math.ceil(this.data.columns / k), h = Math.ceil(this.data.lines / k), made = { radiance: () => this.expose(pane.key, k), map: () => this.colours(k), objects: () => this.silhouettes(k) }[pane.kind]();
    pane.layer ??= el("canvas");
    if (pane.layer.width !== w || pane.layer.height !== h) Object.assign(pane.layer, { width: w, height: h });
    if (made) pane.layer.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(made.buffer), w), 0, 0);
    pane.drawn = key;
    return pane.layer;
  }

  expose(key, k) {
    const all = this.values[key === "test" ? "t" : "r"], { channel } = this.state, byte = this.tones(), lost = rgba(LOST);
    if (!all) return null;
    const from = this.remember(`mean ${key}`, [String(k)], () => this.mean(all, k)), out = new Uint32Array(from.length / 3);
    for (let i = 0, at = 0; i < out.length; i++, at += 3) {
      let x = from[at], y = from[at + 1], z = from[at + 2];
      if (!(Math.abs(x + y + z) < Infinity)) { out[i] = lost; continue; }
      if (channel !== "RGB") x = y = z = single(channel, x, y, z);
      FLOAT[0] = x; const a = byte[BITS[0] >>> 15];
      FLOAT[0] = y; const b = byte[BITS[0] >>> 15];
      FLOAT[0] = z; const c = byte[BITS[0] >>> 15];
      out[i] = 0xff000000 | (c << 16) | (b << 8) | a;
    }
    return out;
  }

  colours(k) {
    const colour = this.remember("colours", [this.state.map, ...Object.values(this.scale())], () => table(Uint32Array, (v) => rgba(this.shade(v))));
    return mapped(Uint32Array, this.reduced(k), (v) => { FLOAT[0] = v; return colour[BITS[0] >>> 15]; });
  }

  // Greys where both see the same, with the reference's outlines; colours where they do not, which always show.
  silhouettes(k) {
    const { id, did } = this.values, { columns } = this.data, colours = OBJECTS.map(rgba), { length } = id ?? [];
    if (!id) return null;
    const codes = this.remember("objects", [], () => mapped(Uint8Array, id, (b, i) => {
      if (did[i]) return b < 0 ? 10 : b + did[i] < 0 ? 11 : 12;
      const edge = ((i + 1) % columns && id[i + 1] !== b) || (i + columns < length && id[i + columns] !== b);
      return edge ? 9 : b < 0 ? 0 : (b % 8) + 1;
    }));
    return mapped(Uint32Array, this.worst(codes, k), (code) => colours[code]);
  }

  // ---------------------------------------------------------------- painting

  // CSS pixels of the panes, all alike; CSS pixels a pixel; the frame's edge that is seen; where in the pane a place is.
  frame_of(pane) {
    const { width, height } = this.data, w = pane.canvas.clientWidth || 1, h = pane.canvas.clientHeight || 1, v = this.view;
    const widest = Math.max(width, (height * w) / h);
    v.span = clamp(v.span, w / MOST, widest);
    const seen = (v.span * h) / w, keep = (at, all, part) => (part >= all ? (all - 1) / 2 : clamp(at, part / 2 - 0.5, all - 0.5 - part / 2));
    v.x = keep(v.x, width, v.span);
    v.y = keep(v.y, height, seen);
    const s = w / v.span, left = v.x - v.span / 2, top = v.y - seen / 2;
    return { w, h, s, left, top, at: (x, y) => [(x - left) * s, (y - top) * s] };
  }

  paint() {
    for (const pane of this.panes.values()) if (!pane.figure.hidden) this.paint_pane(pane);
    this.legend();
    this.histogram();
  }

  paint_pane(pane) {
    const f = this.frame_of(pane), dots = globalThis.devicePixelRatio || 1, c = pane.canvas, g = c.getContext("2d");
    const w = Math.round(f.w * dots), h = Math.round(f.h * dots);
    if (c.width !== w || c.height !== h) Object.assign(c, { width: w, height: h });
    g.setTransform(dots, 0, 0, dots, 0, 0);
    g.clearRect(0, 0, f.w, f.h);
    this.draw(g, pane, f, dots);
    if (this.state.mode === "wipe") {
      const at = Math.round(f.w * this.state.wipe), other = this.panes.get("reference");
      g.save();
      g.beginPath();
      g.rect(at, 0, f.w - at, f.h);
      g.clip();
      g.clearRect(at, 0, f.w - at, f.h);
      this.draw(g, other, f, dots);
      g.restore();
      this.twice(g, () => { g.moveTo(at, 0); g.lineTo(at, f.h); });
      this.label(g, this.data.names.test, at - 8, 8, "right");
      this.label(g, this.data.names.reference, at + 8, 8, "left");
    }
    if (f.s >= NUMBERS) this.numbers(g, pane, f);
    if (this.state.outlines) this.outlines(g, pane, f);
    this.data.overlay?.(g, pane, f, this);
    this.cross(g, f);
  }

  draw(g, pane, f, dots) {
    const { width, height, thin } = this.data;
    const size = (image) => [image.naturalWidth || image.width, image.naturalHeight || image.height];
    let source = pane.picture, cw, ch;
    if (source) [cw, ch] = [width / size(source)[0], height / size(source)[1]];
    else {
      const fewer = 1 / (f.s * dots * thin), k = Math.max(1, pane.kind === "radiance" ? Math.floor(fewer + 1e-6) : Math.ceil(fewer - 1e-6));
      if (pane.kind === "picture") return;
      source = this.layer(pane, k);
      cw = ch = thin * k;
    }
    if (pane.over) {
      this.draw(g, this.panes.get(pane.over), f, dots);
      const [x, y, w, h] = pane.box;
      return g.drawImage(source, ...f.at(x - 0.5, y - 0.5), w * f.s, h * f.s);
    }
    g.imageSmoothingEnabled = pane.kind !== "map" && pane.kind !== "objects" && f.s * dots * cw < 1;
    g.imageSmoothingQuality = source instanceof ImageBitmap ? "low" : "medium"; // one of many that move
    const most = size(source), part = (from, size, cell, all) => {
      const first = clamp(Math.floor((from + 0.5) / cell), 0, all), last = clamp(Math.ceil((from + 0.5 + size) / cell), 0, all);
      return [first, last - first];
    };
    const [sx, sw] = part(f.left, f.w / f.s, cw, most[0]), [sy, sh] = part(f.top, f.h / f.s, ch, most[1]);
    if (sw > 0 && sh > 0) g.drawImage(source, sx, sy, sw, sh, ...f.at(sx * cw - 0.5, sy * ch - 0.5), sw * cw * f.s, sh * ch * f.s);
  }

  // Light on dark: seen on every ground.
  twice(g, path) {
    for (const [colour, width] of [["#fffc", 3], ["#111827", 1]]) {
      g.strokeStyle = colour;
      g.lineWidth = width;
      g.beginPath();
      path();
      g.stroke();
    }
  }

  label(g, text, x, y, align = "left", size = 12) {
    g.font = `${size}px system-ui, "DejaVu Sans", sans-serif`;
    g.textAlign = align;
    g.textBaseline = "top";
    g.lineWidth = 3;
    g.strokeStyle = "#fffd";
    g.fillStyle = "#111827";
    g.strokeText(text, x, y);
    g.fillText(text, x, y);
  }

  numbers(g, pane, f) {
    const { width, height, thin } = this.data, lines = pane.kind === "radiance" ? 3 : 1, line = this.state.mode === "wipe" ? this.state.wipe * f.w : Infinity;
    if (pane.picture) return;
    const from = (edge) => Math.max(0, Math.floor(edge + 0.5)), size = Math.min(12, f.s / 4.6);
    for (let y = from(f.top); y < Math.min(height, f.top + f.h / f.s + 1); y++)
      for (let x = from(f.left); x < Math.min(width, f.left + f.w / f.s + 1); x++) {
        const here = this.read(x, y), [left, top] = f.at(x, y);
        g.strokeStyle = "#8888";
        g.lineWidth = 1;
        g.strokeRect(left - f.s / 2, top - f.s / 2, f.s, f.s);
        if (thin > 1 && (x % thin || y % thin)) continue;
        const said = pane.kind === "radiance" ? here[left > line ? "reference" : pane.key].map(([v, e]) => digits(v, e)) : pane.kind === "map" ? [here.map] : [here.objects.join(" / ")];
        said.forEach((text, i) => this.label(g, text, left + ((thin - 1) / 2) * f.s, top + ((thin - 1) / 2) * f.s + (i - lines / 2) * 1.25 * size, "center", size));
      }
  }

  // Where the reasons are, all tiles that fail, and pixels that see another object.
  outlines(g, pane, f) {
    if (pane.kind === "map" || pane.kind === "objects")
      for (const mark of this.data.marks) this.twice(g, () => g.arc(...f.at(...mark), Math.max(7, 0.75 * f.s), 0, 2 * Math.PI));
    this.regions(g, f);
    this.data.places.forEach(({ x, y, width, height }, i) => {
      const [u, v] = f.at(x - 0.5, y - 0.5), grow = Math.max(0, 6 - (width * f.s) / 2), w = width * f.s + 2 * grow, h = height * f.s + 2 * grow;
      if (width >= this.data.width && height >= this.data.height) return;
      this.twice(g, () => g.rect(u - grow, v - grow, w, h));
      this.label(g, String(i + 1), u - grow + w + 4, v - grow - 2);
    });
  }

  // The outline of all tiles that fail, where they touch or overlap as one region: their frames less what lies inside.
  regions(g, f) {
    if (!this.data.failing.length) return;
    const dots = globalThis.devicePixelRatio || 1, sheet = el("canvas", { width: Math.ceil(f.w * dots), height: Math.ceil(f.h * dots) }), on = sheet.getContext("2d");
    on.setTransform(dots, 0, 0, dots, 0, 0);
    on.strokeStyle = "#fff";
    on.fillStyle = "#b42318";
    for (const [paint, grow] of [["strokeRect", 1.5], ["fillRect", 1.5], ["clear", 0]]) {
      on.globalCompositeOperation = paint === "clear" ? "destination-out" : "source-over";
      on.lineWidth = 2;
      for (const [x, y, width, height] of this.data.failing) {
        const whole = (at) => Math.round(at * dots) / dots; // tiles that touch share their edge to the screen's pixel
        const [u, v] = f.at(x - 0.5, y - 0.5).map(whole), [right, low] = f.at(x + width - 0.5, y + height - 0.5).map(whole);
        on[paint === "clear" ? "fillRect" : paint](u - grow, v - grow, right - u + 2 * grow, low - v + 2 * grow);
      }
    }
    g.drawImage(sheet, 0, 0, f.w, f.h);
  }

  cross(g, f) {
    if (!this.at) return;
    const [u, v] = f.at(...this.at), gap = Math.max(f.s / 2, 4);
    g.globalAlpha = 0.75;
    this.twice(g, () => {
      for (const [a, b, c, d] of [[0, v, u - gap, v], [u + gap, v, f.w, v], [u, 0, u, v - gap], [u, v + gap, u, f.h]]) { g.moveTo(a, b); g.lineTo(c, d); }
      g.rect(u - gap, v - gap, 2 * gap, 2 * gap);
    });
    g.globalAlpha = 1;
  }

  // ---------------------------------------------------------------- one pixel in words

  // What is known of pixel (x, y): [value, largest error of it] of each channel of each image.
  read(x, y) {
    const { columns, lines, thin, width, height } = this.data, { r, d, t, s, id, did, depth, ddepth, flip, at, step } = this.values;
    const column = Math.min(Math.floor(x / thin), columns - 1), line = Math.min(Math.floor(y / thin), lines - 1), i = line * columns + column;
    const meant = at ? [Math.min(column * thin + (at[i] % thin), width - 1), Math.min(line * thin + Math.floor(at[i] / thin), height - 1)] : [x, y];
    const channels = [0, 1, 2].map((c) => {
      const k = 3 * i + c, sigma = s ? s[k] : 0, noise = sigma > 0 ? 2 ** (Math.floor(Math.log2(sigma)) - 4) : 0;
      const b = r ? r[k] : NaN, e = d ? d[k] : NaN, eb = Math.abs(b) * EPSILON + noise, ee = Math.abs(e) * EPSILON + noise, z = sigma > 0 ? e / sigma : null;
      return { reference: [b, eb], test: [t ? t[k] : NaN, eb + ee], error: [e, ee], sigmas: [z, ee / sigma + Math.abs(z) / 63], relative: [e / (Math.abs(b) + 0.01), (ee + (Math.abs(e) * eb) / (Math.abs(b) + 0.01)) / (Math.abs(b) + 0.01)] };
    });
    const of = (key) => channels.map((channel) => channel[key]), name = (n) => (n < 0 ? "background" : this.data.objects[n] ?? `object ${n}`);
    const { map } = this.state, v = this.map()[i], key = map === "signed" ? "error" : map, known = map === "flip" ? null : of(key).find(([value]) => Math.fround(value) === v);
    return {
      meant, reference: of("reference"), test: of("test"), error: of("error"), sigmas: of("sigmas"), relative: of("relative"),
      map: map === "flip" ? digits(flip?.[i], 1 / 510, { most: 2 }) : digits(v, known ? known[1] : Math.abs(v) / 40, { sign: true }),
      objects: id ? [name(id[i] + did[i]), name(id[i])] : [], same: id ? did[i] === 0 : null,
      depths: depth ? [[depth[i] + ddepth[i], step / 2], [depth[i], step / 2], [ddepth[i], step]] : [],
    };
  }

  inspect(x, y) {
    if (!this.values.r && !this.values.t) return;
    const here = this.read(x, y), { bound } = this.data, further = this.values.s ? "sigmas" : "relative";
    this.at = here.meant;
    const row = (name, colours, object, depth, sign = false) => {
      if (!this.cells[name]) return;
      const cells = this.cells[name], texts = colours.map(([v, e]) => digits(v, e, { sign }));
      if (cells.object) texts.push(object, depth ? digits(...depth, { sign }) : "–");
      cells.list.forEach((cell, i) => { cell.textContent = texts[i]; });
    };
    row("test", here.test, here.objects[0], here.depths[0]);
    row("reference", here.reference, here.objects[1], here.depths[1]);
    row("error", here.error, here.same ? "the same" : "another", here.depths[2], true);
    row("further", here[further], "", null, true);
    if (this.cells.further) this.cells.further.head.textContent = this.values.s ? "in σ" : "relative";
    if (bound?.held && this.cells.error)
      here.error.forEach(([e], c) => this.cells.error.list[c].classList.toggle("rt-over", !(Math.abs(e) <= bound.share * Math.max(bound.scale, Math.abs(here.reference[c][0])))));
    [this.x.value, this.y.value] = here.meant;
    const away = here.meant[0] !== x || here.meant[1] !== y, { thin, binned } = this.data, block = `${thin} × ${thin} pixels`;
    this.say(binned ? `means of ${block}` : away ? `of ${block}, the one that errs most` : this.kept && this.kept[0] === x && this.kept[1] === y ? (this.data.address ? "kept; in the page's address" : "kept") : "");
    this.show();
  }

  say(text) {
    this.status.textContent = text;
  }

  // ---------------------------------------------------------------- where to look

  inside(x, y) {
    return x >= 0 && y >= 0 && x < this.data.width && y < this.data.height;
  }

  keep(x, y) {
    this.kept = [x, y];
    if (this.data.address) history.replaceState(null, "", `#pixel=${x},${y}`);
    this.inspect(x, y);
  }

  look(x, y, span = this.view.span) {
    Object.assign(this.view, { x, y, span });
    this.show();
  }

  // By a factor, so that what is at (x, y) stays where it is.
  zoom(factor, x, y) {
    const v = this.view, f = this.frame_of(this.shown()[0]), span = clamp(v.span / factor, f.w / MOST, Math.max(this.data.width, (this.data.height * f.w) / f.h));
    [x, y] = x === undefined ? this.kept ?? [v.x, v.y] : [x, y];
    this.look(x + ((v.x - x) * span) / v.span, y + ((v.y - y) * span) / v.span, span);
  }

  whole() {
    this.look(0, 0, Infinity);
  }

  go(step) {
    const { places } = this.data, n = places.length;
    if (!n) return;
    this.place = (this.place + step + n) % n;
    const { x, y, width, height } = places[this.place], px = x + (width >> 1), py = y + (height >> 1);
    this.keep(px, py);
    this.look(px, py, Math.max(24, 3 * Math.max(width, height)));
    this.arrange();
  }

  follow(address, scroll) {
    if (address === "#whole") this.whole();
    const match = /#pixel=(\d+),(\d+)(?:,(\d+))?$/.exec(address);
    if (match) {
      const [x, y, span] = match.slice(1).map(Number);
      if (!this.inside(x, y)) return this.say(`there is no pixel ${x}, ${y}`);
      this.keep(x, y);
      if (span) this.look(x, y, span);
    }
    if (scroll) this.root.scrollIntoView({ block: "start" });
  }

  shown() {
    return [...this.panes.values()].filter((pane) => !pane.figure.hidden);
  }

  flip() {
    if (!this.data.names.reference) return;
    this.set({ mode: "one", solo: this.state.solo === "test" ? "reference" : "test" });
  }

  // ---------------------------------------------------------------- pointer, fingers, keys

  listen(pane) {
    const c = pane.canvas, down = new Map(); // pointers that are down: one drags, two zoom
    const spot = (event) => {
      const box = c.getBoundingClientRect(), f = this.frame_of(pane), u = event.clientX - box.left;
      return { x: f.left + u / f.s, y: f.top + (event.clientY - box.top) / f.s, u: u / f.w, f };
    };
    const inside = (event) => {
      const { x, y } = spot(event), at = [Math.round(x), Math.round(y)];
      return this.inside(...at) && at;
    };
    const between = () => {
      const [a, b] = down.values();
      return { clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2, apart: Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) };
    };
    const pan = (from, by, s) => this.look(from.x - by[0] / s, from.y - by[1] / s);
    let held = null;
    const on = (types, act) => types.forEach((type) => c.addEventListener(type, act, { passive: false }));
    on(["pointerdown"], (event) => {
      if (event.button) return;
      const { u, f } = spot(event), wipe = this.state.mode === "wipe" && Math.abs(u - this.state.wipe) * f.w < 14;
      down.set(event.pointerId, event);
      held = down.size > 1 ? null : { x: event.clientX, y: event.clientY, moved: false, wipe, from: { ...this.view }, s: f.s };
      try { c.setPointerCapture(event.pointerId); } catch { /* a pointer made up by a test */ }
    });
    on(["pointermove"], (event) => {
      if (down.size > 1) {
        const before = between();
        down.set(event.pointerId, event);
        const now = between(), { x, y, f } = spot(now);
        pan(this.view, [now.clientX - before.clientX, now.clientY - before.clientY], f.s);
        return this.zoom(now.apart / before.apart, x, y);
      }
      if (held) {
        const by = [event.clientX - held.x, event.clientY - held.y];
        held.moved ||= Math.hypot(...by) > 4;
        if (held.wipe) this.set({ wipe: spot(event).u });
        else if (held.moved) pan(held.from, by, held.s);
        if (held.moved) return;
      }
      const at = inside(event);
      if (event.pointerType !== "touch" && at) this.inspect(...at);
    });
    on(["pointerup", "pointercancel", "lostpointercapture"], (event) => {
      const at = event.type === "pointerup" && held && !held.moved && !held.wipe && inside(event);
      down.delete(event.pointerId);
      held = null;
      if (at) this.keep(...at);
    });
    on(["pointerleave"], () => { if (this.kept && !held) this.inspect(...this.kept); });
    on(["dblclick"], (event) => { const { x, y } = spot(event); this.zoom(2, x, y); });
    on(["wheel"], (event) => {
      if (!event.ctrlKey && !event.shiftKey) return; // without a key, the wheel scrolls the page
      event.preventDefault();
      const { x, y } = spot(event), turn = event.deltaY || event.deltaX;
      if (event.ctrlKey) this.zoom(Math.exp(-turn / 300), x, y);
      else this.set({ exposure: this.state.exposure - Math.sign(turn) / 4 });
    });
    on(["touchstart", "touchmove"], (event) => { if (event.touches.length > 1) event.preventDefault(); }); // one finger scrolls the page
    on(["keydown"], (event) => this.key(event));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { key, shiftKey } = event, step = shiftKey ? 10 : 1, s = this.state, { width, height } = this.data;
    const next = (all, now) => all[(all.indexOf(now) + 1) % all.length], keys = [...this.panes.keys()];
    const move = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[key];
    const act = {
      "+": () => this.zoom(1.5), "=": () => this.zoom(1.5), "-": () => this.zoom(1 / 1.5), 0: () => this.whole(),
      e: () => this.set({ exposure: s.exposure + 0.5 }), E: () => this.set({ exposure: s.exposure - 0.5 }),
      g: () => this.set({ gamma: s.gamma * 1.1 }), G: () => this.set({ gamma: s.gamma / 1.1 }),
      s: () => this.set({ scale: s.scale - 1 }), S: () => this.set({ scale: s.scale + 1 }),
      t: () => this.set({ tone: next(Object.keys(TONES), s.tone) }), c: () => this.set({ channel: next(CHANNELS, s.channel) }),
      m: () => this.set({ map: next(this.maps(), s.map) }), f: () => this.flip(), w: () => this.data.names.reference && this.set({ mode: s.mode === "wipe" ? "grid" : "wipe" }),
      "[": () => this.set({ wipe: s.wipe - 0.02 }), "]": () => this.set({ wipe: s.wipe + 0.02 }),
      o: () => this.set({ outlines: !s.outlines }), a: () => this.set({ mode: s.mode === "grid" ? "one" : "grid" }),
      n: () => this.go(1), p: () => this.go(-1), r: () => this.reset(),
    }[key];
    if (move) {
      const [x, y] = this.kept ?? [width >> 1, height >> 1], at = [clamp(x + move[0], 0, width - 1), clamp(y + move[1], 0, height - 1)];
      this.keep(...at);
      const v = this.view, f = this.frame_of(this.shown()[0]), seen = (v.span * f.h) / f.w;
      if (Math.abs(at[0] - v.x) > v.span / 2 - 1 || Math.abs(at[1] - v.y) > seen / 2 - 1) this.look(...at);
    } else if (act) act();
    else if (keys[Number(key) - 1]) this.set({ mode: "one", solo: keys[Number(key) - 1] });
    else return;
    event.preventDefault();
  }

  reset() {
    this.set({ exposure: this.data.exposure, gamma: 1, tone: "sRGB", channel: "RGB", scale: 0 });
    this.whole();
  }

  maps() {
    const { s, flip } = this.values;
    return ["signed", "relative", ...(s || this.state.map === "sigmas" ? ["sigmas"] : []), ...(flip ? ["flip"] : [])];
  }

  // ---------------------------------------------------------------- the page around the pictures

  build() {
    const { names, panes, places, width, height } = this.data, s = this.state;
    const button = (text, title, act) => el("button", { type: "button", textContent: text, title, ...(text.length === 1 ? { ariaLabel: title } : {}), onclick: act });
    const group = (label, ...children) => el("div", { className: "rt-group", role: "group", ariaLabel: label }, ...children);
    const mode = (name, text, title) => Object.assign(button(text, title, () => this.set({ mode: name })), { of: name });
    this.modes = panes.length < 2 ? [] : [mode("grid", "All", "All pictures (a)"), mode("one", "One", "One large picture (1, 2, ...)")];
    if (names.reference) this.modes.push(mode("wipe", "Wipe", `${names.test} left of the line, ${names.reference} right of it (w)`));
    this.tabs = panes.map((pane, i) => Object.assign(button(pane.tab ?? pane.title, `${pane.title} (${i + 1})`, () => this.set({ mode: "one", solo: pane.key })), { of: pane.key }));
    this.tab_group = group("Picture", ...this.tabs);
    this.count = el("span", { className: "rt-count" });
    const range = (label, name, low, high, step, shown) => {
      const input = el("input", { type: "range", min: low, max: high, step, oninput: () => this.set({ [name]: input.valueAsNumber }) }), said = el("output");
      input.addEventListener("wheel", (event) => {
        event.preventDefault();
        this.set({ [name]: clamp(s[name] - Math.sign(event.deltaY) * step * 5, low, high) });
      }, { passive: false });
      this.controls.push(() => { input.value = s[name]; said.textContent = shown(s[name]); });
      return el("label", {}, `${label} `, input, said);
    };
    const choice = (label, name, options, title = (x) => x) => {
      const input = el("select", { onchange: () => this.set({ [name]: input.value }) });
      this.controls.push(() => {
        const all = options();
        if (input.options.length !== all.length) input.replaceChildren(...all.map((x) => el("option", { value: x, textContent: title(x) })));
        input.value = s[name];
      });
      return el("label", {}, `${label} `, input);
    };
    this.controls = [];
    const tick = el("input", { type: "checkbox", onchange: () => this.set({ outlines: tick.checked }) });
    this.controls.push(() => { tick.checked = s.outlines; });
    const adjust = el("details", { className: "rt-adjust" }, el("summary", { textContent: "Exposure, tone, maps" }), el("div", {},
      range("Exposure", "exposure", -12, 12, 0.05, signed), range("Gamma", "gamma", 0.4, 3, 0.05, (x) => x.toFixed(2)),
      choice("Tone", "tone", () => Object.keys(TONES)), choice("Channel", "channel", () => CHANNELS),
      ...(names.reference ? [choice("Map", "map", () => this.maps(), (x) => ({ signed: "signed", relative: "relative", sigmas: "in sigmas", flip: "FLIP" })[x]),
        range("Range", "scale", -8, 8, 1, (x) => `× ${short(Number((10 ** (x / 2)).toPrecision(2)))}`), el("label", {}, tick, " Outlines")] : []),
      button("Reset", "As it was (r)", () => this.reset())));
    const step = (text, title, by) => button(text, title, () => this.go(by));
    const bar = el("div", { className: "rt-bar" }, group("Layout", ...this.modes), this.tab_group,
      group("Zoom", button("−", "Zoom out (−)", () => this.zoom(1 / 1.5)), button("+", "Zoom in (+)", () => this.zoom(1.5)), button("Whole", "The whole picture (0)", () => this.whole())));
    if (names.reference) bar.insertBefore(button("A ⇄ B", `Flip between ${names.test} and ${names.reference} (f)`, () => this.flip()), bar.lastChild);
    if (places.length) bar.append(group("Places", step("‹", "Place before (p)", -1), this.count, step("›", "Next place (n)", 1)));

    this.panes = new Map(panes.map((pane) => [pane.key, this.pane(pane)]));
    this.box = el("div", { className: "rt-panes" }, ...[...this.panes.values()].map((pane) => pane.figure));

    const number = (max, label) => el("input", { type: "number", min: 0, max, step: 1, ariaLabel: label, onchange: () => {
      const at = [this.x.valueAsNumber, this.y.valueAsNumber];
      if (this.inside(...at)) this.keep(...at);
      else this.say(`x: 0 to ${width - 1}, y: 0 to ${height - 1}`);
    } });
    [this.x, this.y] = [number(width - 1, "x of the pixel"), number(height - 1, "y of the pixel")];
    this.status = el("p", { className: "rt-status", ariaLive: "polite", textContent: "unpacking the values …" });
    const surfaces = this.data.surfaces ?? (this.data.planes ?? []).some((plane) => plane.name === "id"), heads = ["R", "G", "B", ...(surfaces ? ["object", "depth, m"] : [])];
    this.cells = {};
    const row = (name, title) => {
      const list = heads.map(() => el("td", { textContent: "–" }));
      const head = el("th", { scope: "row", textContent: title });
      this.cells[name] = { list, head, object: surfaces };
      return el("tr", { className: `rt-${name}` }, head, ...list);
    };
    const rows = names.reference ? [row("test", names.test), row("reference", names.reference), row("error", `${names.test} − ${names.reference}`), row("further", "")] : [row("test", names.test)];
    const table = el("table", {}, el("thead", {}, el("tr", {}, el("td"), ...heads.map((text) => el("th", { scope: "col", textContent: text })))), el("tbody", {}, ...rows));
    this.bars = el("canvas", { className: "rt-histogram", role: "img", ariaLabel: `Histogram of the chosen channel in stops around white: ${names.test} filled, ${names.reference ?? ""} as a line` });
    const where = el("form", { onsubmit: (event) => event.preventDefault() }, el("b", { textContent: "Pixel " }), el("span", {}, "x ", this.x, " y ", this.y), this.status);
    const inspector = el("div", { className: "rt-inspector", role: "region", ariaLabel: "Pixel inspector" }, where, el("div", { className: "rt-scroll", tabIndex: 0, role: "group", ariaLabel: "Values of the pixel" }, table), this.bars);
    const keys = "Drag pans, Ctrl + wheel zooms, Shift + wheel exposes; two fingers zoom and pan. In a picture: arrows move by a pixel (Shift: ten), + − 0 zoom, e E exposure, g G gamma, t tone, c channel, m map, s S its range, f flip, w wipe ([ ] move it), a all, 1 to 9 one picture, n p places, o outlines, r reset.";
    this.root.classList.add("rt");
    bar.append(adjust);
    this.box.append(inspector);
    this.root.append(bar, this.box, el("details", { className: "rt-keys" }, el("summary", { textContent: "Mouse, fingers and keys" }), el("p", { textContent: keys })));
    let wide = this.root.clientWidth;
    new ResizeObserver(() => {
      if (wide === this.root.clientWidth) return;
      wide = this.root.clientWidth;
      requestAnimationFrame(() => this.show());
    }).observe(this.root);
  }

  pane(given) {
    const { width, height } = this.data, pane = { ...given, drawn: "" };
    pane.canvas = el("canvas", { tabIndex: 0, role: "img", ariaLabel: pane.alt });
    pane.canvas.style.aspectRatio = `${width} / ${height}`;
    pane.said = el("p", { textContent: pane.note ?? "" });
    pane.caption = el("figcaption", {}, pane.said);
    if (pane.kind === "map") {
      pane.legend = el("canvas", { className: "rt-legend", role: "img", ariaLabel: "Histogram of the map over its colours" });
      pane.ticks = el("div", { className: "rt-ticks" });
      pane.caption.prepend(pane.legend, pane.ticks);
    }
    if (pane.kind === "objects") {
      const { test, reference } = this.data.names, colour = (k) => `rgb(${OBJECTS[k]})`;
      const key = [["agree", 5], [`only ${test}`, 10], [`only ${reference}`, 11], ["another object", 12]];
      pane.caption.prepend(el("p", { className: "rt-key" }, ...key.map(([text, k]) => { const i = el("i"); i.style.background = colour(k); return el("span", {}, i, text); })));
    }
    pane.head = el("h3", { textContent: pane.title });
    pane.figure = el("figure", {}, pane.head, pane.canvas, pane.caption);
    this.listen(pane);
    return pane;
  }

  // What is shown where, by the state.
  arrange() {
    const s = this.state, { names, places } = this.data;
    const solo = s.mode === "wipe" ? "test" : s.solo;
    this.box.dataset.mode = s.mode === "grid" ? "grid" : "one";
    for (const pane of this.panes.values()) {
      pane.figure.hidden = s.mode !== "grid" && pane.key !== solo;
      if (pane.kind === "radiance") {
        pane.head.textContent = s.mode === "wipe" ? `${names.test} | ${names.reference}` : pane.title;
        pane.said.textContent = `${signed(s.exposure)} stops, ${s.tone}${s.gamma === 1 ? "" : `, gamma ${s.gamma.toFixed(2)}`}${s.channel === "RGB" ? "" : `, ${s.channel}`}`;
      } else if (pane.kind === "map") pane.head.textContent = MAPS[s.map].title;
    }
    for (const [list, now] of [[this.modes, s.mode], [this.tabs, s.mode === "one" ? s.solo : ""]])
      for (const button of list) button.ariaPressed = String(button.of === now);
    this.tab_group.hidden = s.mode !== "one" || this.tabs.length < 2;
    this.count.textContent = this.place < 0 ? `${places.length} place${places.length === 1 ? "" : "s"}` : `${this.place + 1} of ${places.length}`;
    for (const update of this.controls) update();
  }

  sheet(canvas) {
    const dots = globalThis.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight, g = canvas.getContext("2d");
    Object.assign(canvas, { width: Math.round(w * dots), height: Math.round(h * dots) });
    g.setTransform(dots, 0, 0, dots, 0, 0);
    return { g, w, h, ink: getComputedStyle(canvas).color };
  }

  legend() {
    const pane = [...this.panes.values()].find((p) => p.kind === "map");
    if (!pane || pane.figure.hidden || !pane.legend.clientWidth) return;
    const { g, w, h, ink } = this.sheet(pane.legend), { map } = this.state, { low, high, log } = this.scale(), from = MAPS[map].signed ? -1 : 0;
    const { names, bound } = this.data, bar = 14, top = h - bar, n = 101;
    const value = (t) => Math.sign(t) * (log ? low * (high / low) ** Math.abs(t) : high * Math.abs(t)), at = (t) => ((t - from) / (1 - from)) * w;
    const bins = this.remember(`bins ${w}`, [...MAPPING, "scale"], () => {
      const made = new Float64Array(n), all = this.map(), step = Math.max(1, Math.floor(all.length / 1e5));
      for (let i = 0; i < all.length; i += step) if (Number.isFinite(all[i])) made[Math.round(((this.position(all[i]) - from) / (1 - from)) * (n - 1))]++;
      return made;
    });
    const most = Math.log1p(Math.max(...bins));
    bins.forEach((count, i) => {
      const tall = (Math.log1p(count) / (most || 1)) * (top - 3), x = (i / n) * w;
      g.fillStyle = ink;
      g.globalAlpha = 0.45;
      g.fillRect(x, top - 2 - tall, w / n - 0.5, tall);
      g.globalAlpha = 1;
      g.fillStyle = `rgb(${this.shade(value(from + ((1 - from) * i) / (n - 1)))})`;
      g.fillRect(x, top, w / n + 0.5, bar);
    });
    const held = bound?.held && map === "signed" ? this.position(bound.share * bound.scale) : 0;
    for (const t of held ? [-held, held] : []) this.twice(g, () => { g.moveTo(at(t), top - 3); g.lineTo(at(t), h); });
    const decades = Math.log10(high / low), each = Math.max(1, Math.ceil(decades / (w < 420 ? 2 : 4)));
    const sizes = log ? Array.from({ length: Math.floor((decades - 1e-9) / each) + 1 }, (_, k) => 1 - (k * each) / decades).filter((t) => t > 0.12) : [1, 0.5];
    const marks = [...(from < 0 ? sizes.map((t) => -t).concat(0) : [0]), ...sizes].sort((a, b) => a - b);
    pane.ticks.replaceChildren(...marks.map((t) => {
      const span = el("span", { textContent: (t > 0 && from < 0 ? "+" : "") + short(Number(value(t).toPrecision(4))) });
      span.style.left = `${at(t)}px`;
      if (Math.abs(t) === 1) span.style.transform = t < 0 ? "none" : "translateX(-100%)";
      if (t === 0 && from === 0) span.style.transform = "none";
      return span;
    }));
    const words = map === "flip" ? "dark: alike" : `blue: ${names.test} darker, red: brighter${log ? `; below ${short(low)} white` : ""}${held ? `; lines: the tolerance, ${short(bound.share * bound.scale)}` : ""}`;
    const seen = log || map === "flip" ? "; zoomed out, the worst pixel shows" : this.data.noisy ? "; zoomed out, means show" : "";
    pane.said.textContent = `${map === "flip" ? "FLIP" : `${names.test} − ${names.reference}`}, ${MAPS[map].unit}; ${words}${seen}`;
  }

  histogram() {
    if (!this.bars.clientWidth) return;
    const { g, w, h, ink } = this.sheet(this.bars), low = -10, high = 4, n = 84, { channel, exposure } = this.state;
    const count = (key) => this.remember(`histogram ${key}`, ["exposure", "channel"], () => {
      const made = new Float64Array(n), all = this.values[key] ?? [], step = 3 * Math.max(1, Math.floor(all.length / 2e5));
      const add = (v) => { if (v > 0) made[clamp(Math.floor(((Math.log2(v) + exposure - low) / (high - low)) * n), 0, n - 1)]++; };
      for (let i = 0; i < all.length; i += step)
        if (channel === "RGB") for (let c = 0; c < 3; c++) add(all[i + c]);
        else add(single(channel, all[i], all[i + 1], all[i + 2]));
      return made;
    });
    const test = count("t"), reference = this.data.names.reference ? count("r") : test, most = Math.log1p(Math.max(...test, ...reference)) || 1;
    const tall = (x) => (Math.log1p(x) / most) * (h - 16), bottom = h - 13;
    g.fillStyle = g.strokeStyle = ink;
    g.globalAlpha = 0.35;
    test.forEach((x, i) => g.fillRect((i / n) * w, bottom - tall(x), w / n - 0.5, tall(x)));
    g.globalAlpha = 0.9;
    g.beginPath();
    reference.forEach((x, i) => { g.lineTo((i / n) * w, bottom - tall(x)); g.lineTo(((i + 1) / n) * w, bottom - tall(x)); });
    g.stroke();
    g.font = '10px system-ui, "DejaVu Sans", sans-serif';
    g.textBaseline = "bottom";
    for (const stop of [-8, -4, 0]) {
      const x = ((stop - low) / (high - low)) * w;
      g.fillRect(x, bottom, 1, 3);
      g.textAlign = "center";
      g.fillText(stop ? `${stop} stops` : "white", x, h);
    }
  }
}

function mount(element, data) {
  const viewer = (element.viewer = new Viewer(element, data));
  if (data.address) {
    document.addEventListener("click", (event) => {
      const link = event.target.closest?.('a[href^="#pixel="], a[href="#whole"]');
      if (!link) return;
      event.preventDefault();
      viewer.follow(link.getAttribute("href"), true);
    });
    addEventListener("hashchange", () => viewer.follow(location.hash, true));
  }
  viewer.ready.catch((error) => {
    element.dataset.ready = "failed";
    viewer.say(`the values cannot be shown: ${error.message}`);
    console.error(error);
  });
  return viewer;
}

export { digits, el, encode, mount };
