// Charts in a page: the one that is chosen, a point's numbers by pointer, tap and arrow keys. Everything is drawn already.
"use strict";
(() => {
  // Shows the chart that is chosen among those of a section.
  function show(section) {
    const key = [...section.querySelectorAll("[data-choice]")].map((select) => select.value).join("/");
    const all = [...section.querySelectorAll("[data-chart]")];
    for (const element of all) element.hidden = element.dataset.chart !== key;
    section.querySelector(".none").hidden = all.some((element) => !element.hidden);
    box.hidden = true;
  }

  const box = document.createElement("div");
  box.className = "hover";
  box.setAttribute("role", "status");
  box.hidden = true;

  // Shows a point's numbers beside (x, y) of the window, or nothing.
  let at = null;
  function tell(point, x, y) {
    at?.classList.remove("at");
    at = point;
    box.hidden = !point;
    if (!point) return;
    point.classList.add("at");
    const title = point.querySelector("title");
    if (title) {  // or the browser would show it a second time
      point.setAttribute("aria-label", title.textContent);
      title.remove();
    }
    box.textContent = point.getAttribute("aria-label");
    box.style.left = `${Math.max(4, Math.min(x + 14, innerWidth - box.offsetWidth - 8))}px`;
    box.style.top = `${y + 18 + box.offsetHeight > innerHeight ? y - box.offsetHeight - 10 : y + 18}px`;
  }

  const points_of = (svg) => [...svg.querySelectorAll("[data-name]")].map((point) => {
    const { left, right, top, bottom } = point.getBoundingClientRect();
    return { point, x: (left + right) / 2, y: (top + bottom) / 2 };
  });

  function hover(event) {
    if (event.pointerType === "touch") return;
    const point = event.target.closest?.("svg [data-name]");
    if (point || !document.activeElement?.matches(".view")) tell(point, event.clientX, event.clientY);
  }

  // A tap finds the nearest point: fingers are wider than points.
  function tap(event) {
    const svg = event.target.closest?.(".view svg");
    if (!svg) return event.pointerType === "touch" && tell(null);
    const far = ({ x, y }) => Math.hypot(x - event.clientX, y - event.clientY);
    const nearest = points_of(svg).sort((a, b) => far(a) - far(b))[0];
    if (nearest && far(nearest) < 28) tell(nearest.point, nearest.x, nearest.y);
    else tell(null);
  }

  // Left and right step through a chart's points, from the left.
  function key(event) {
    const svg = event.target.matches?.(".view") && event.target.querySelector("svg");
    if (!svg) return;
    if (event.key === "Escape") return tell(null);
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], all = points_of(svg).sort((a, b) => a.x - b.x || a.y - b.y);
    if (!step || !all.length) return;
    event.preventDefault();
    const now = all.findIndex(({ point }) => point === at), next = all[now < 0 ? (step > 0 ? 0 : all.length - 1) : (now + step + all.length) % all.length];
    tell(next.point, next.x, next.y);
  }

  document.addEventListener("DOMContentLoaded", () => {
    document.body.append(box);
    document.addEventListener("pointerover", hover);
    document.addEventListener("click", tap);
    document.addEventListener("keydown", key);
    for (const section of document.querySelectorAll("[data-choices]"))
      for (const select of section.querySelectorAll("[data-choice]")) select.addEventListener("change", () => show(section));
    document.body.dataset.ready = "true";
  });
})();
