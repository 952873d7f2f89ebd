// Charts in a page: the one that is chosen, a point's numbers on hover, zoom. Everything is drawn already.
"use strict";
(() => {
  const names = ["size", "truth", "metric"];
  const choice = (name) => document.getElementById(`choose-${name}`);

  function show() {
    const key = names.map((name) => choice(name).value).join("/");
    const all = [...document.querySelectorAll("[data-chart]")];
    for (const element of all) element.hidden = element.dataset.chart !== key;
    document.getElementById("none").hidden = all.some((element) => !element.hidden);
    box.hidden = true;
  }

  const box = document.createElement("div");
  box.className = "hover";
  box.hidden = true;

  function hover(event) {
    const point = event.target.closest?.("svg [data-name]");
    box.hidden = !point;
    if (!point) return;
    const title = point.querySelector("title");
    if (title) {  // or the browser would show it a second time
      point.setAttribute("aria-label", title.textContent);
      title.remove();
    }
    box.textContent = point.getAttribute("aria-label");
    const { clientX: x, clientY: y } = event;
    box.style.left = `${Math.min(x + 14, innerWidth - box.offsetWidth - 8)}px`;
    box.style.top = `${y + 18 + box.offsetHeight > innerHeight ? y - box.offsetHeight - 10 : y + 18}px`;
  }

  function zoomable(svg) {
    const view = svg.viewBox.baseVal, whole = [view.x, view.y, view.width, view.height];
    const set = (...rect) => svg.setAttribute("viewBox", rect.join(" "));
    svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      const frame = svg.getBoundingClientRect(), by = Math.exp(event.deltaY / 400);
      const width = Math.min(whole[2], view.width * by), height = width / whole[2] * whole[3];
      const u = (event.clientX - frame.left) / frame.width, v = (event.clientY - frame.top) / frame.height;
      set(view.x + u * (view.width - width), view.y + v * (view.height - height), width, height);
    }, { passive: false });
    svg.addEventListener("pointermove", (event) => {
      if (!(event.buttons & 1) || view.width >= whole[2]) return;
      const step = view.width / svg.getBoundingClientRect().width;
      set(view.x - event.movementX * step, view.y - event.movementY * step, view.width, view.height);
    });
    svg.addEventListener("dblclick", () => set(...whole));
  }

  document.addEventListener("DOMContentLoaded", () => {
    document.body.append(box);
    document.addEventListener("pointerover", hover);
    document.querySelectorAll(".view > svg").forEach(zoomable);
    for (const name of names) choice(name)?.addEventListener("change", show);
    document.body.dataset.ready = "true";
  });
})();
