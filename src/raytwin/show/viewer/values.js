// Numbers and planes: half floats, digits that are known, values packed by packing.py, and means of blocks.

const EPSILON = 2 ** -11; // relative rounding of a half float
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const signed = (x) => (x < 0 ? "-" : "+") + Math.abs(x).toFixed(2);
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
  for (const [key, Kind] of [["id", Int16Array], ["did", Int16Array], ["depth", Float32Array], ["ddepth", Float32Array], ["at", Uint16Array]])
    if (named[key]) jobs.push(decode(named[key], data.columns, data.lines, (found[key] = new Kind(n)), 0, 1));
  await Promise.all(jobs);
  if (found.d) found.t = mapped(Float32Array, found.r, (x, i) => x + found.d[i]);
  found.step = named.depth?.step ?? 0;
  return found;
}

export { BITS, EPSILON, FLOAT, HALVES, clamp, decode, digits, distance, el, farther, mapped, short, signed, single, table, values };
