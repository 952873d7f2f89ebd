// One viewer for two images of radiance and what belongs to them: mount(element, data) -> { update, set, look, ... }.
//
// Pixel (x, y) covers x - 1/2 .. x + 1/2, y down. `data` is what packing.py makes, with `names` {test, reference},
// `panes` [{key, kind, title, alt, note, aside}] (aside: not among all, large alone), `objects`, `bound` {share, scale,
// held} or null, `noisy`, `places` [{x, y, width, height}], `failing` [[x, y, width, height]], `marks` [[x, y]],
// `parts` of the error, `overlay(g, pane, frame, viewer)` (draws more), `exposure` (stops), `address` (whether the
// page's address says where to look).
// Kinds of panes: radiance (key test or reference), map (of their difference), objects (what each pixel sees), picture
// (8 bits: `url`). All panes show the same part of the frame.

import { CHANNELS, MAPPING, OBJECTS, PART, encode } from "./colour.js";
import { clamp, digits, el, short, signed, single, values } from "./values.js";
import { View } from "./view.js";

class Viewer extends View {
  constructor(root, data) {
    super();
    this.root = root;
    this.data = { columns: data.width, lines: data.height, thin: 1, panes: [], parts: [], places: [], failing: [], marks: [], objects: [], exposure: 0, noisy: false, binned: false, bound: null, ...data };
    const { width, height, columns, lines, exposure } = this.data, sigmas = (this.data.planes ?? []).some((plane) => plane.name === "sR");
    this.values = { count: columns * lines };
    this.kept = this.at = this.area = null; // the clicked pixel, which stays when the pointer leaves; the one that is shown; pixels of a rectangle
    this.place = -1;
    this.state = {
      mode: root.clientWidth < 700 ? "one" : "grid", solo: this.data.panes[0]?.key, wipe: 0.5, exposure,
      channel: "RGB", map: sigmas ? "sigmas" : "signed", scale: 0, outlines: true, area: false,
    };
    this.view = { x: (width - 1) / 2, y: (height - 1) / 2, span: Infinity };
    this.cache = new Map();
    this.parts = new Map();
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
    await this.divide(this.data.parts);
    this.refresh();
    this.say("point at a pixel, or click one");
    const [first] = this.data.places, start = first ? [first.x + (first.width >> 1), first.y + (first.height >> 1)] : this.data.start;
    if (start && this.panes.size) this.inspect(...start);
    this.at = null;
    if (this.data.address) this.follow(location.hash, false);
    this.drawn();
    this.root.dataset.ready = "true";
  }

  // ---------------------------------------------------------------- one pixel in words

  inspect(x, y) {
    if (!this.values.r && !this.values.t) return;
    const here = this.read(x, y), { bound } = this.data, further = here.part ? "part" : this.values.s ? "sigmas" : "relative";
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
    if (this.cells.further) this.cells.further.head.textContent = here.part ? this.about().title : this.values.s ? "in σ" : "relative";
    if (bound?.held && this.cells.error)
      here.error.forEach(([e], c) => this.cells.error.list[c].classList.toggle("rt-over", !(Math.abs(e) <= bound.share * Math.max(bound.scale, Math.abs(here.reference[c][0])))));
    [this.x.value, this.y.value] = here.meant;
    const away = here.meant[0] !== x || here.meant[1] !== y, { thin, binned } = this.data, block = `${thin} × ${thin} pixels`;
    this.say(binned ? `means of ${block}` : away ? `of ${block}, the one that errs most` : this.kept && this.kept[0] === x && this.kept[1] === y ? (this.data.address ? "kept; in the page's address" : "kept") : "");
    this.show();
  }

  // The same of a rectangle: its means, and how far apart they are.
  inspect_area() {
    const [left, top, right, bottom] = this.area, found = this.means(this.area), size = `${right - left + 1} × ${bottom - top + 1} pixels`;
    this.at = null;
    this.show();
    if (!this.values.r && !this.values.t) return;
    if (!found) return this.say(`${size}: of each block this page holds one pixel, and no mean`);
    const row = (name, of, sign = false) => this.cells[name]?.list.forEach((cell, c) => { cell.textContent = c < 3 ? digits(of(found[c]), 0, { sign, most: 4 }) : "–"; });
    row("test", (c) => c.test);
    row("reference", (c) => c.reference);
    row("error", (c) => c.error, true);
    row("further", (c) => (this.values.s ? c.sigmas : c.test / c.reference), Boolean(this.values.s));
    this.cells.error?.list.forEach((cell) => cell.classList.remove("rt-over"));
    if (!this.cells.further) return this.say(`mean of ${size}`);
    this.cells.further.head.textContent = this.values.s ? "z, in σ" : "ratio";
    const sum = (key) => found.reduce((all, c) => all + c[key], 0), worst = Math.max(...found.map((c) => Math.abs(c.sigmas ?? 0)));
    this.say(`means of ${size}: ratio ${(sum("test") / sum("reference")).toPrecision(4)}${this.values.s ? `, |z| ${worst.toFixed(1)}` : ""}`);
  }

  say(text) {
    this.status.textContent = text;
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
      const all = el("div", { className: "rt-group", role: "group", ariaLabel: label });
      this.controls.push(() => {
        const now = options();
        if (all.dataset.all !== now.join()) all.replaceChildren(...now.map((x) => Object.assign(button(title(x), `${label}: ${title(x)}`, () => this.set({ [name]: x })), { of: x })));
        all.dataset.all = now.join();
        for (const one of all.children) one.ariaPressed = String(one.of === s[name]);
      });
      return el("div", { className: "rt-choice" }, el("span", { textContent: label }), all);
    };
    this.controls = [];
    const tick = el("input", { type: "checkbox", onchange: () => this.set({ outlines: tick.checked }) });
    this.controls.push(() => { tick.checked = s.outlines; });
    const adjust = el("details", { className: "rt-adjust" }, el("summary", { textContent: "Exposure, maps" }), el("div", {},
      range("Exposure", "exposure", -12, 12, 0.05, signed), choice("Channel", "channel", () => CHANNELS),
      ...(names.reference ? [choice("Map", "map", () => this.maps(), (x) => ({ signed: "signed", relative: "relative", sigmas: "in sigmas" })[x] ?? x.replace(PART, "")),
        range("Range", "scale", -8, 8, 1, (x) => `× ${short(Number((10 ** (x / 2)).toPrecision(2)))}`), el("label", {}, tick, " Outlines")] : []),
      button("Reset", "As it was (r)", () => this.reset())));
    const step = (text, title, by) => button(text, title, () => this.go(by));
    const bar = el("div", { className: "rt-bar" }, group("Layout", ...this.modes), this.tab_group,
      group("Zoom", button("−", "Zoom out (−)", () => this.zoom(1 / 1.5)), button("+", "Zoom in (+)", () => this.zoom(1.5)), button("Whole", "The whole picture (0)", () => this.whole())));
    if (names.reference) bar.insertBefore(button("A ⇄ B", `Flip between ${names.test} and ${names.reference} (f)`, () => this.flip()), bar.lastChild);
    const area = button("Area", "Dragging chooses a rectangle, whose means are compared (Shift + drag, x)", () => this.set({ area: !s.area }));
    this.controls.push(() => { area.ariaPressed = String(s.area); this.box.classList.toggle("rt-choosing", s.area); });
    bar.append(group("Rectangle", area));
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
    const keys = "Drag pans, Shift + drag chooses a rectangle, Ctrl + wheel zooms, Shift + wheel exposes; two fingers zoom and pan. In a picture: arrows move by a pixel (Shift: ten), + − 0 zoom, e E exposure, c channel, m map, s S its range, f flip, w wipe ([ ] move it), a all, 1 to 9 one picture, n p places, o outlines, x a corner of a rectangle, then the other, r reset.";
    this.root.classList.add("rt");
    bar.append(adjust);
    this.box.append(inspector);
    const heading = el("h2", { className: "rt-heading", textContent: "Pictures" }); // of the panes' own, for who listens
    this.root.append(heading, bar, this.box, el("details", { className: "rt-keys" }, el("summary", { textContent: "Mouse, fingers and keys" }), el("p", { textContent: keys })));
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
      pane.figure.hidden = s.mode === "grid" ? Boolean(pane.aside) : pane.key !== solo;
      if (pane.kind === "radiance") {
        pane.head.textContent = s.mode === "wipe" ? `${names.test} | ${names.reference}` : pane.title;
        pane.said.textContent = `${signed(s.exposure)} stops${s.channel === "RGB" ? "" : `, ${s.channel}`}`;
      } else if (pane.kind === "map") pane.head.textContent = this.about().title;
    }
    for (const [list, now] of [[this.modes, s.mode], [this.tabs, s.mode === "one" ? s.solo : ""]])
      for (const button of list) button.ariaPressed = String(button.of === now);
    this.tab_group.hidden = this.tabs.length < 2 || (s.mode !== "one" && !this.data.panes.some((pane) => pane.aside));
    this.count.textContent = this.place < 0 ? `${places.length} place${places.length === 1 ? "" : "s"}` : `${this.place + 1} of ${places.length}`;
    for (const update of this.controls) update();
    for (const button of document.querySelectorAll("[data-part]")) button.ariaPressed = String(PART + button.dataset.part === s.map);
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
    const { g, w, h, ink } = this.sheet(pane.legend), { low, high, log } = this.scale(), about = this.about();
    const { names } = this.data, { allowed } = this.scale(), bar = 14, top = h - bar, n = 101;
    const value = (t) => Math.sign(t) * (log ? low * (high / low) ** Math.abs(t) : high * Math.abs(t)), at = (t) => ((t + 1) / 2) * w;
    const bins = this.remember(`bins ${w}`, [...MAPPING, "scale"], () => {
      const made = new Float64Array(n), all = this.map(), step = Math.max(1, Math.floor(all.length / 1e5));
      for (let i = 0; i < all.length; i += step) if (Number.isFinite(all[i])) made[Math.round(((this.position(all[i]) + 1) / 2) * (n - 1))]++;
      return made;
    });
    const most = Math.log1p(Math.max(...bins));
    bins.forEach((count, i) => {
      const tall = (Math.log1p(count) / (most || 1)) * (top - 3), x = (i / n) * w;
      g.fillStyle = ink;
      g.globalAlpha = 0.45;
      g.fillRect(x, top - 2 - tall, w / n - 0.5, tall);
      g.globalAlpha = 1;
      g.fillStyle = `rgb(${this.shade(value((2 * i) / (n - 1) - 1))})`;
      g.fillRect(x, top, w / n + 0.5, bar);
    });
    const held = this.position(allowed);
    for (const t of held ? [-held, held] : []) this.twice(g, () => { g.moveTo(at(t), top - 3); g.lineTo(at(t), h); });
    const decades = Math.log10(high / low), each = Math.max(1, Math.ceil(decades / (w < 420 ? 2 : 4)));
    const sizes = log ? Array.from({ length: Math.floor((decades - 1e-9) / each) + 1 }, (_, k) => 1 - (k * each) / decades).filter((t) => t > 0.12) : [1, 0.5];
    const marks = [...sizes.map((t) => -t), 0, ...sizes].sort((a, b) => a - b);
    pane.ticks.replaceChildren(...marks.map((t) => {
      const span = el("span", { textContent: (t > 0 ? "+" : "") + short(Number(value(t).toPrecision(4))) });
      span.style.left = `${at(t)}px`;
      if (Math.abs(t) === 1) span.style.transform = t < 0 ? "none" : "translateX(-100%)";
      return span;
    }));
    this.thin_out([...pane.ticks.children]);
    const signs = about.part ? `Red: it makes the ${names.test} brighter. Blue: darker.` : `Blue: ${names.test} darker. Red: brighter.`;
    const faint = log && !about.part ? ` Differences below ${short(low)} are blank.` : "";
    const ticks = held ? ` Ticks mark the tolerance (${short(allowed)}), below it all is grey.` : "";
    const seen = about.part ? "" : log ? " Zoomed out, each point shows its worst pixel." : this.data.noisy ? " Zoomed out, each point shows a mean." : "";
    const what = about.part ? "A part of the error" : `${names.test} − ${names.reference}`;
    pane.said.textContent = `${what}, ${about.unit}. ${signs}${faint}${ticks}${seen}`;
  }

  // Hides what would touch another, on both sides alike; the ends and the middle stay.
  thin_out(spans) {
    const last = spans.length - 1, boxes = spans.map((span) => span.getBoundingClientRect()), kept = [];
    const free = (i) => kept.every((k) => boxes[i].right + 5 < boxes[k].left || boxes[i].left - 5 > boxes[k].right);
    for (const i of new Set([0, last / 2, ...spans.keys()])) {
      const pair = [...new Set([i, last - i])];
      if (pair.every(free)) kept.push(...pair);
      else for (const k of pair) spans[k].hidden = !kept.includes(k);
    }
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
  document.addEventListener("click", (event) => {
    const part = event.target.closest?.("[data-part]")?.dataset.part;
    if (part) viewer.show_map(viewer.state.map === PART + part ? "signed" : PART + part);
  });
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
