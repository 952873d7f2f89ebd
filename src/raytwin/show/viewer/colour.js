// Values as colours: exposure, maps of the difference, silhouettes; each kept until what it depends on changes.

import { BITS, FLOAT, clamp, distance, el, farther, mapped, single, table } from "./values.js";

const MAPS = {
  signed: { title: "Difference", unit: "radiance" },
  relative: { title: "Relative difference", unit: "of |r| + 0.01" },
  sigmas: { title: "Difference in σ", unit: "standard deviations" },
};
const PART = "part: "; // how a map is called that is a part of the error
const CHANNELS = ["RGB", "R", "G", "B", "luminance"];
// Linear Rec. 709, from no error to the largest; far enough apart to differ by lightness as well as by hue.
const NIGHT = globalThis.matchMedia?.("(prefers-color-scheme: dark)").matches;
const [DARKER, BRIGHTER] = NIGHT // around what agrees: the page's own ground
  ? [[[0.01, 0.013, 0.02], [0.03, 0.16, 0.6], [0.5, 0.78, 1]], [[0.01, 0.013, 0.02], [0.62, 0.09, 0.03], [1, 0.74, 0.5]]]
  : [[[1, 1, 1], [0.25, 0.55, 0.95], [0.01, 0.06, 0.45]], [[1, 1, 1], [0.95, 0.42, 0.22], [0.42, 0.005, 0.02]]];
const ALLOWED = NIGHT ? [[0.01, 0.013, 0.02], [0.1, 0.1, 0.1]] : [[1, 1, 1], [0.5, 0.5, 0.5]]; // within the tolerance: no colour of an error
const LOST = [0, 203, 0]; // NaN and infinity
const GREYS = [206, 178, 221, 190, 168, 213, 184, 198].map((v) => (NIGHT ? v - 110 : v));
const OBJECTS = [NIGHT ? [24, 29, 37] : [250, 250, 250], ...GREYS.map((v) => [v, v, v]), NIGHT ? [206, 212, 220] : [59, 66, 76], [230, 97, 0], [93, 58, 155], [214, 0, 110]];
const MAPPING = ["map", "channel"]; // parts of the state, and what depends on them

const rgba = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
const mix = (stops, t) => {
  const at = clamp(t, 0, 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2), f = at - i;
  return stops[i].map((v, c) => v + f * (stops[i + 1][c] - v));
};

const quantile = (sorted, share) => sorted[Math.ceil(share * sorted.length) - 1] ?? 0;
// The noise's standard deviation from sizes in order, by the median of those that differ: few outliers do not move it.
const deviation = (sorted) => quantile(sorted.subarray(sorted.findIndex((size) => size > 0)), 0.5) / 0.6745;

// `data`, `values`, `state` and `cache` are those of Viewer in page.js.
class Colours {
  // What `make` gave, as long as the named parts of the state are what they were.
  remember(name, on, make) {
    const key = on.map((part) => this.state[part] ?? part).join();
    if (this.cache.get(name)?.key !== key) this.cache.set(name, { key, value: make() });
    return this.cache.get(name).value;
  }

  // Bytes by the upper bits of a radiance.
  tones() {
    const gain = 2 ** this.state.exposure;
    return this.remember("tones", ["exposure"], () => table(Uint8Array, (x) => (x > 0 ? Math.round(255 * encode(Math.min(x * gain, 1))) : 0)));
  }

  // What the chosen map is: a row of MAPS, or a part of the error by its name.
  about() {
    const { map } = this.state;
    return MAPS[map] ?? { title: map.slice(PART.length), unit: "radiance", part: this.parts.get(map) };
  }

  // Float32Array of the chosen map.
  map() {
    const { r, d, s } = this.values, { part } = this.about();
    return this.remember("map", MAPPING, () => this.errors(part ?? d, r, s));
  }

  // Errors d of r with deviations s in the map's unit and the chosen channel; of all three, that which is farthest off.
  errors(d, r, s) {
    const { map, channel } = this.state, made = new Float32Array(d ? d.length / 3 : this.values.count);
    const unit = { signed: (e) => e, relative: (e, at) => e / (Math.abs(r[at]) + 0.01), sigmas: (e, at) => this.sigmas(e, s ? s[at] : 0, r[at]) }[map] ?? ((e) => e);
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
    const { d, r, s } = this.values, { part } = this.about();
    if (k > 1 && part) return this.errors(this.mean(part, k));
    if (k === 1 || !this.data.noisy || !d) return this.worst(this.map(), k);
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
    const { map, scale } = this.state, { bound, noisy } = this.data, factor = 10 ** (scale / 2), evenly = (high) => ({ low: 0, high: high * factor, log: false, allowed: 0 });
    return this.remember("scale", [...MAPPING, "scale"], () => {
      if (map === "sigmas") return evenly(5);
      const all = this.map();
      if (noisy || this.about().part) {
        const step = Math.max(1, Math.floor(all.length / 3e4)), some = all.filter((v, i) => i % step === 0 && Number.isFinite(v)).map(Math.abs).sort();
        const q = (this.about().part ? quantile(some, 0.999) : deviation(some)) || 1, decade = 10 ** Math.floor(Math.log10(q));
        return evenly(decade * [1, 2, 5, 10].find((step) => step * decade >= q * 0.999));
      }
      const worst = all.reduce((most, v) => (Number.isFinite(v) ? Math.max(most, Math.abs(v)) : most), 0);
      const allowed = (bound?.share ?? 1e-5) * (map === "signed" ? bound?.scale ?? 1 : 1);
      const low = 10 ** (Math.floor(Math.log10(allowed)) - 2), high = Math.max(10 ** Math.ceil(Math.log10(worst || low) - 1e-9), 1e3 * low);
      return { low: low * factor, high: high * factor, log: true, allowed: bound?.held ? allowed : 0 };
    });
  }

  // -1 to 1, where 1 is the full colour.
  position(v) {
    const { low, high, log } = this.scale(), size = Math.abs(v);
    return Math.sign(v) * Math.min(log ? Math.log10(Math.max(size, low) / low) / Math.log10(high / low) : size / high, 1);
  }

  shade(v) {
    if (!Number.isFinite(v) && (Number.isNaN(v) || this.state.map !== "sigmas")) return LOST;
    const t = this.position(v), { allowed } = this.scale();
    if (allowed && Math.abs(v) <= allowed) return mix(ALLOWED, Math.abs(t) / this.position(allowed)).map((x) => Math.round(255 * encode(x)));
    return mix(t < 0 ? DARKER : BRIGHTER, Math.abs(t)).map((x) => Math.round(255 * encode(x)));
  }

  // The colours of 255 equal steps over the map's scale, and of what is lost: R, G, B, alpha.
  ramp() {
    return this.remember("ramp", [this.state.map, ...Object.values(this.scale())], () => {
      const { low, high, log } = this.scale(), value = (t) => Math.sign(t) * (log ? low * (high / low) ** Math.abs(t) : high * Math.abs(t));
      return [...Array.from({ length: 255 }, (_, i) => [...this.shade(value((i - 127) / 127)), 255]), [...LOST, 255]];
    });
  }

  // A canvas for a pane, each of its pixels k x k of the planes'.
  layer(pane, k) {
    const on = { radiance: ["exposure", "channel"], map: [...MAPPING, "scale"], objects: [] }[pane.kind], key = [k, ...on.map((part) => this.state[part])].join();
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
}

export { CHANNELS, Colours, MAPPING, OBJECTS, PART, encode };
