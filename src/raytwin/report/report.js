// The pixel inspector: decodes the values that values.py packed, shows those of one pixel, moves the crosses.
"use strict";
window.raytwin = (() => {
  const meta = JSON.parse(document.getElementById("meta").textContent);
  const planes = {};
  let kept = null; // the clicked pixel, which stays when the pointer leaves
  let ready = false;

  // ---------------------------------------------------------------- values

  async function decode(plane) {
    const element = document.getElementById(`plane-${plane.name}`);
    const bytes = Uint8Array.from(atob(element.textContent), (c) => c.charCodeAt(0));
    element.remove();
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const raw = new Uint8Array(await new Response(stream).arrayBuffer());
    const count = meta.columns * meta.lines;
    if (raw.length !== 2 * count) throw new Error(`plane ${plane.name}: ${raw.length} bytes, not ${2 * count}`);
    const words = new Uint16Array(count);
    for (let i = 0; i < count; i++) words[i] = (raw[i] << 8) | raw[count + i];
    if (plane.differences)
      for (let y = 0; y < meta.lines; y++)
        for (let i = y * meta.columns + 1; i < (y + 1) * meta.columns; i++) words[i] += words[i - 1];
    planes[plane.name] = { ...plane, words };
  }

  function half(word) {
    const sign = word & 0x8000 ? -1 : 1, exponent = (word >> 10) & 31, fraction = word & 1023;
    if (exponent === 31) return fraction ? NaN : sign * Infinity;
    return sign * (exponent ? 2 ** (exponent - 25) * (1024 + fraction) : 2 ** -24 * fraction);
  }

  function value(name, i) {
    const plane = planes[name];
    if (!plane) return null;
    const word = plane.words[i];
    if (plane.kind === "whole") return (word << 16) >> 16;
    return plane.kind === "even" ? word * plane.step : half(word) * 2 ** plane.shift;
  }

  // ---------------------------------------------------------------- one pixel in words

  function number(x, digits, sign = false) {
    if (x === null) return "–";
    if (!Number.isFinite(x)) return String(x).replace("-", "−");
    if (x === 0) return "0";
    const small = Math.abs(x) < 1e-3 || Math.abs(x) >= 1e5;
    const text = small ? x.toExponential(digits - 1) : x.toPrecision(digits);
    return (sign && x > 0 ? "+" : "") + text.replaceAll("-", "−").replace("e+", "e");
  }

  function fill(row, object, colour, depth) {
    const cells = document.querySelectorAll(`#row-${row} td`), error = row === "error";
    const texts = [...colour.map((x) => number(x, 3, error)), number(depth, error ? 3 : 4, error)];
    [object, ...texts].forEach((text, i) => { cells[i].textContent = text; });
    if (error && meta.tolerance !== null)
      colour.forEach((x, i) => cells[i + 1].classList.toggle("over", !(Math.abs(x) <= meta.tolerance)));
  }

  function show(x, y) {
    if (!ready) return;
    const thinned = (at, most) => Math.min(Math.round(at / meta.thin), most - 1);
    const column = thinned(x, meta.columns), line = thinned(y, meta.lines), i = line * meta.columns + column;
    const name = (id) => (id === null ? "–" : id < 0 ? "background" : meta.objects[id] ?? `object ${id}`);
    const plus = (a, b) => (a === null ? null : a + b);
    const reference = ["R", "G", "B"].map((c) => value(c, i)), error = ["dR", "dG", "dB"].map((c) => value(c, i));
    const a = value("id", i), b = value("id_reference", i), depth = value("depth", i), apart = value("ddepth", i);
    fill("test", name(a), reference.map((r, k) => r + error[k]), plus(depth, apart));
    fill("reference", name(b), reference, depth);
    fill("error", a === null ? "–" : a === b ? "the same" : "another", error, apart);
    document.getElementById("at-x").value = x;
    document.getElementById("at-y").value = y;
    const away = column * meta.thin !== x || line * meta.thin !== y;
    say(away ? `values of its neighbour ${column * meta.thin}, ${line * meta.thin}`
      : kept && kept[0] === x && kept[1] === y ? "kept; in the page's address" : "");
    model("cross_width").location = y;
    model("cross_height").location = x;
  }

  const say = (text) => { document.getElementById("status").textContent = text; };

  // ---------------------------------------------------------------- pointer, keys, address

  const model = (name) => Bokeh.documents[0].get_model_by_name(name);
  const inside = (x, y) => x >= 0 && y >= 0 && x < meta.width && y < meta.height;

  function hover(x, y) {
    const at = [Math.round(x), Math.round(y)];
    if (inside(...at)) show(...at);
  }

  function leave() {
    if (kept) show(...kept);
  }

  function keep(x, y) {
    if (!inside(x, y)) return;
    kept = [x, y];
    history.replaceState(null, "", `#pixel=${x},${y}`);
    show(x, y);
  }

  const pin = (x, y) => keep(Math.round(x), Math.round(y));

  function look(x, y, width) {
    const height = (width * meta.height) / meta.width;
    model("columns").setv({ start: x - width / 2, end: x + width / 2 });
    model("lines").setv({ start: y + height / 2, end: y - height / 2 });
  }

  function zoom(factor) {
    const c = model("columns"), l = model("lines");
    look((c.start + c.end) / 2, (l.start + l.end) / 2, Math.min(Math.max((c.end - c.start) * factor, 4), 2 * meta.width));
  }

  function follow(address, scroll) {
    const match = /#pixel=(\d+),(\d+)(?:,(\d+))?$/.exec(address);
    if (!match) return;
    const [x, y, width] = match.slice(1).map(Number);
    if (!inside(x, y)) return say(`there is no pixel ${x}, ${y}`);
    keep(x, y);
    if (width) look(x, y, width);
    if (scroll) document.querySelector(".look").scrollIntoView({ block: "start" });
  }

  function key(event) {
    const step = event.shiftKey ? 10 : 1;
    const move = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (move) {
      const [x, y] = kept ?? [meta.width >> 1, meta.height >> 1];
      keep(Math.min(Math.max(x + move[0], 0), meta.width - 1), Math.min(Math.max(y + move[1], 0), meta.height - 1));
    } else if (event.key === "+" || event.key === "=") zoom(1 / 1.5);
    else if (event.key === "-") zoom(1.5);
    else if (event.key === "0") look((meta.width - 1) / 2, (meta.height - 1) / 2, meta.width);
    else return;
    event.preventDefault();
  }

  // ---------------------------------------------------------------- start

  // Bokeh blurs a magnified picture; here its pixels are the subject. Reduced pictures stay smooth.
  function sharpen() {
    const view = Bokeh.Models.get("ImageURL").prototype.default_view.prototype;
    const paint = view._render_image;
    view._render_image = function (context, i, image, ...rest) {
      context.imageSmoothingEnabled = this.sw[i] < 1.5 * image.naturalWidth;
      context.imageSmoothingQuality = "high";
      return paint.call(this, context, i, image, ...rest);
    };
  }

  const drawn = () => new Promise((resolve) => {
    const look = () => (Bokeh.documents[0]?.is_idle ? resolve() : setTimeout(look, 20));
    look();
  });

  async function start() {
    for (const view of document.querySelectorAll(".view")) view.addEventListener("keydown", key);
    document.getElementById("where").addEventListener("submit", (event) => event.preventDefault());
    for (const id of ["at-x", "at-y"])
      document.getElementById(id).addEventListener("change", () => {
        const [x, y] = ["at-x", "at-y"].map((name) => document.getElementById(name).valueAsNumber);
        if (inside(x, y)) keep(x, y);
        else say(`x: 0 to ${meta.width - 1}, y: 0 to ${meta.height - 1}`);
      });
    document.addEventListener("click", (event) => {
      const link = event.target.closest('a[href^="#pixel="]');
      if (!link) return;
      event.preventDefault();
      follow(link.getAttribute("href"), true);
    });
    window.addEventListener("hashchange", () => follow(location.hash, true));
    await Promise.all([drawn(), ...meta.planes.map(decode)]);
    ready = true;
    say("point at a pixel, or click one");
    follow(location.hash, false);
    document.body.dataset.ready = "true";
  }

  sharpen();
  document.addEventListener("DOMContentLoaded", () => start().catch((error) => {
    document.body.dataset.ready = "failed";
    say(`the values cannot be shown: ${error.message}`);
    console.error(error);
  }));
  return { hover, leave, pin };
})();
