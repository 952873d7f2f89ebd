// Where the panes look and what is painted in them; what a pixel's values are; pointer, fingers and keys.

import { CHANNELS, Colours, PART } from "./colour.js";
import { EPSILON, HALVES, clamp, decode, digits, el, mapped, values } from "./values.js";

const MOST = 256; // CSS pixels a pixel is magnified to at most
const NUMBERS = 46; // from here on its values are written into it

class View extends Colours {
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

  // All that is known of both images, anew: planes as `values` takes them. `noisy`: though no variance says so.
  async feed(planes, noisy = false) {
    this.values = await values({ ...this.data, planes });
    this.data.noisy = noisy || Boolean(this.values.s);
    for (const pane of this.panes.values()) if (pane.kind !== "picture") pane.picture = null;
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

  // Parts of the error, [{ name, step, columns, lines, planes }], each a map; of every step-th pixel.
  async divide(parts) {
    const { columns, lines, thin } = this.data, cell = (i, from, all) => Math.min(Math.floor((i * thin) / from), all - 1);
    const made = await Promise.all(parts.map(async (part) => {
      const few = new Float32Array(3 * part.columns * part.lines), all = new Float32Array(3 * columns * lines);
      await Promise.all(part.planes.map((plane, c) => decode(plane, part.columns, part.lines, few, c, 3)));
      for (let y = 0, at = 0; y < lines; y++)
        for (let x = 0, row = cell(y, part.step, part.lines) * part.columns; x < columns; x++, at += 3) {
          const from = 3 * (row + cell(x, part.step, part.columns));
          for (let c = 0; c < 3; c++) all[at + c] = few[from + c];
        }
      return [PART + part.name, all];
    }));
    this.parts = new Map(made);
    if (this.state.map.startsWith(PART) && !this.parts.has(this.state.map)) this.state.map = "signed";
    this.refresh();
  }

  // One map beside the pictures, or large where only one is shown.
  show_map(map) {
    this.set({ map, ...(this.state.mode === "grid" ? {} : { mode: "one", solo: "map" }) });
    if (this.at) this.inspect(...this.at);
    this.root.scrollIntoView({ block: "start" });
  }

  // Any of `state`.
  set(changes) {
    const s = Object.assign(this.state, changes);
    s.exposure = clamp(s.exposure, -20, 20);
    s.scale = clamp(s.scale, -8, 8);
    s.wipe = clamp(s.wipe, 0, 1);
    this.show();
  }

  refresh() {
    for (const name of this.cache.keys()) if (name !== "tones" && name !== "colours") this.cache.delete(name);
    for (const pane of this.panes.values()) pane.drawn = "";
    if (this.area) this.inspect_area();
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
    if (this.area) {
      const [left, top, right, bottom] = this.area;
      this.twice(g, () => g.rect(...f.at(left - 0.5, top - 0.5), (right - left + 1) * f.s, (bottom - top + 1) * f.s));
    }
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
    const { columns, lines, thin, width, height } = this.data, { r, d, t, s, id, did, depth, ddepth, at, step } = this.values;
    const column = Math.min(Math.floor(x / thin), columns - 1), line = Math.min(Math.floor(y / thin), lines - 1), i = line * columns + column;
    const meant = at ? [Math.min(column * thin + (at[i] % thin), width - 1), Math.min(line * thin + Math.floor(at[i] / thin), height - 1)] : [x, y];
    const channels = [0, 1, 2].map((c) => {
      const k = 3 * i + c, sigma = s ? s[k] : 0, noise = sigma > 0 ? 2 ** (Math.floor(Math.log2(sigma)) - 4) : 0;
      const b = r ? r[k] : NaN, e = d ? d[k] : NaN, eb = Math.abs(b) * EPSILON + noise, ee = Math.abs(e) * EPSILON + noise, z = sigma > 0 ? e / sigma : null;
      return { reference: [b, eb], test: [t ? t[k] : NaN, eb + ee], error: [e, ee], sigmas: [z, ee / sigma + Math.abs(z) / 63], relative: [e / (Math.abs(b) + 0.01), (ee + (Math.abs(e) * eb) / (Math.abs(b) + 0.01)) / (Math.abs(b) + 0.01)] };
    });
    const of = (key) => channels.map((channel) => channel[key]), name = (n) => (n < 0 ? "background" : this.data.objects[n] ?? `object ${n}`);
    const { map } = this.state, { part } = this.about(), v = this.map()[i], key = map === "signed" ? "error" : map, known = part ? null : of(key).find(([value]) => Math.fround(value) === v);
    return {
      meant, reference: of("reference"), test: of("test"), error: of("error"), sigmas: of("sigmas"), relative: of("relative"),
      part: part ? [0, 1, 2].map((c) => [part[3 * i + c], Math.abs(part[3 * i + c]) / 40]) : null,
      map: digits(v, known ? known[1] : Math.abs(v) / 40, { sign: true }),
      objects: id ? [name(id[i] + did[i]), name(id[i])] : [], same: id ? did[i] === 0 : null,
      depths: depth ? [[depth[i] + ddepth[i], step / 2], [depth[i], step / 2], [ddepth[i], step]] : [],
    };
  }

  // Means over pixels [left, top, right, bottom], both ends included, of each channel: test, reference, error and, by the
  // variances of pixels that are independent, its size in sigmas. Null where only the worst pixel of each block is known.
  means([left, top, right, bottom]) {
    const { columns, lines, thin } = this.data, { r, t, d, s, at } = this.values, cell = (x, all) => Math.min(Math.floor(x / thin), all - 1);
    if (at) return null;
    const first = cell(left, columns), last = cell(right, columns), sums = [0, 1, 2].map(() => ({ test: 0, reference: 0, error: 0, square: 0 }));
    for (let y = cell(top, lines); y <= cell(bottom, lines); y++)
      for (let x = first; x <= last; x++)
        sums.forEach((sum, c) => {
          const k = 3 * (y * columns + x) + c;
          sum.test += t ? t[k] : NaN;
          sum.reference += r ? r[k] : NaN;
          sum.error += d ? d[k] : NaN;
          sum.square += s ? s[k] ** 2 : 0;
        });
    const count = (last - first + 1) * (cell(bottom, lines) - cell(top, lines) + 1);
    return sums.map((sum) => ({ test: sum.test / count, reference: sum.reference / count, error: sum.error / count, sigmas: sum.square > 0 ? sum.error / Math.sqrt(sum.square) : null }));
  }

  // The rectangle between two pixels, or none.
  choose(a, b) {
    const { width, height } = this.data, [x, y] = [0, 1].map((k) => [a, b].map((at) => clamp(Math.round(at[k]), 0, (k ? height : width) - 1)));
    this.area = [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
    this.inspect_area();
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
      const area = (event.shiftKey || this.state.area) && !wipe && spot(event);
      held = down.size > 1 ? null : { x: event.clientX, y: event.clientY, moved: false, wipe, area, from: { ...this.view }, s: f.s };
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
        else if (held.moved && held.area) this.choose([held.area.x, held.area.y], [spot(event).x, spot(event).y]);
        else if (held.moved) pan(held.from, by, held.s);
        if (held.moved) return;
      }
      const at = inside(event);
      if (event.pointerType !== "touch" && at && !this.area) this.inspect(...at);
    });
    on(["pointerup", "pointercancel", "lostpointercapture"], (event) => {
      const at = event.type === "pointerup" && held && !held.moved && !held.wipe && inside(event);
      down.delete(event.pointerId);
      held = null;
      if (!at) return;
      this.area = null;
      this.keep(...at);
    });
    on(["pointerleave"], () => {
      if (this.area && !held) this.inspect_area();
      else if (this.kept && !held) this.inspect(...this.kept);
    });
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
      s: () => this.set({ scale: s.scale - 1 }), S: () => this.set({ scale: s.scale + 1 }),
      c: () => this.set({ channel: next(CHANNELS, s.channel) }),
      m: () => this.set({ map: next(this.maps(), s.map) }), f: () => this.flip(), w: () => this.data.names.reference && this.set({ mode: s.mode === "wipe" ? "grid" : "wipe" }),
      "[": () => this.set({ wipe: s.wipe - 0.02 }), "]": () => this.set({ wipe: s.wipe + 0.02 }),
      o: () => this.set({ outlines: !s.outlines }), a: () => this.set({ mode: s.mode === "grid" ? "one" : "grid" }),
      n: () => this.go(1), p: () => this.go(-1), r: () => this.reset(), x: () => this.corner(),
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

  // By keys: the kept pixel is one corner, then the other one; a third time, there is no rectangle.
  corner() {
    const [x, y] = this.kept ?? [this.data.width >> 1, this.data.height >> 1];
    const one = this.area && this.area[0] === this.area[2] && this.area[1] === this.area[3] && this.area;
    if (this.area && !one) {
      this.area = null;
      this.inspect(x, y);
    } else this.choose(one || [x, y], [x, y]);
  }

  reset() {
    this.area = null;
    this.set({ exposure: this.data.exposure, channel: "RGB", scale: 0 });
    this.whole();
  }

  maps() {
    const { s } = this.values;
    return ["signed", "relative", ...(s || this.state.map === "sigmas" ? ["sigmas"] : []), ...this.parts.keys()];
  }
}

export { View };
