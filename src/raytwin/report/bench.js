// The frontier's chart: shows the size, the truth and the metric that are chosen, and a method's whole row on hover.
"use strict";
window.raytwinBench = (() => {
  const data = JSON.parse(document.getElementById("bench").textContent);
  const names = ["size", "truth", "metric"];
  let size = data.first.split("/")[0];

  const model = (name) => Bokeh.documents[0].get_model_by_name(name);
  const chosen = () => names.map((n) => document.getElementById(`choose-${n}`)?.value ?? "").join("/");

  function cell(text, tag = "td", kind = "") {
    const element = document.createElement(tag);
    element.textContent = text;
    element.className = kind;
    return element;
  }

  function show(key) {
    const chart = data.charts[key];
    const status = document.getElementById("status");
    status.textContent = chart ? chart.notes : "no method was held against this truth with this metric";
    if (!chart) return;
    size = key.split("/")[0];
    for (const name of ["points", "lines", "texts", "small", "leaders"]) model(name).data = chart[name];
    const floor = chart.floor ?? chart.y_range[0] / 1e6;
    model("floor").data = { left: [chart.x_range[0] / 1e6], right: [chart.x_range[1] * 1e6],
      bottom: [chart.y_range[0] / 1e6], top: [floor] };
    for (const name of ["x_range", "y_range"]) {
      const [start, end] = chart[name];
      model(name).setv({ start, end, reset_start: start, reset_end: end });
    }
    model("y_axis").axis_label = chart.y_label;
    model("title").text = chart.title;
    if (chart.unlabelled.length) status.textContent += `; without room for a label: ${chart.unlabelled.join(", ")}`;
    const p = chart.points, body = document.getElementById("frontier-rows");
    body.replaceChildren();
    p.method.map((_, i) => i).filter((i) => p.frontier[i]).sort((a, b) => p.x[a] - p.x[b]).forEach((i) => {
      const row = document.createElement("tr");
      row.append(cell(p.method[i], "th"), cell(number(p.x[i]), "td", "n"),
        cell((p.alpha[i] ? "" : "≤ ") + number(p.y[i]), "td", "n"));
      body.append(row);
    });
    document.body.dataset.chart = key;
  }

  const number = (x) => (x >= 1e-3 && x < 1e4 ? Number(x.toPrecision(3)).toString() : x.toExponential(1).replace("-", "−"));

  function row(method) {
    const texts = data.rows[`${method}@${size}`] ?? [];
    const table = document.createElement("table");
    data.shown.forEach((name, i) => {
      const line = document.createElement("tr");
      line.append(cell(name.replaceAll("_", " ")), cell(texts[i] ?? "–"));
      table.append(line);
    });
    const box = document.createElement("div");
    box.append(cell(method, "b"), table);
    return box.innerHTML;
  }

  const drawn = () => new Promise((resolve) => {
    const look = () => (window.Bokeh?.documents[0]?.is_idle ? resolve() : setTimeout(look, 20));
    look();
  });

  document.addEventListener("DOMContentLoaded", async () => {
    if (data.first) {
      await drawn();
      for (const name of names)
        document.getElementById(`choose-${name}`).addEventListener("change", () => show(chosen()));
      show(data.first);
    }
    document.body.dataset.ready = "true";
  });
  return { row, show };
})();
