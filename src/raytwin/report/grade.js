"use strict";
// Of a class's pages: the matrix's sorting, filtering and searching; the viewers, mounted when they are opened.
const table = document.getElementById("matrix");
if (table) {
  const body = table.tBodies[0], rows = [...body.rows];
  const search = document.getElementById("search"), show = document.getElementById("show"), count = document.getElementById("count");
  const filter = () => {
    const text = search.value.trim().toLowerCase(), [kind, value] = show.value.split(/:(.*)/s);
    let shown = 0;
    for (const row of rows) {
      const fits = kind === "all" || (kind === "cause" ? row.dataset.causes.split("|").includes(value) : row.dataset.state.split(" ").includes(value));
      row.hidden = !(fits && row.textContent.toLowerCase().includes(text));
      shown += !row.hidden;
    }
    count.textContent = `${shown} of ${rows.length}`;
  };
  search.addEventListener("input", filter);
  show.addEventListener("change", filter);
  [...table.tHead.rows[0].cells].forEach((head, column) => head.querySelector("button")?.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const value = row => row.cells[column].dataset.value ?? row.cells[column].textContent.trim().toLowerCase();
    const numeric = rows.every(row => row.cells[column].dataset.value !== undefined);
    const order = (a, b) => numeric ? value(a) - value(b) : value(a).localeCompare(value(b));
    rows.sort((a, b) => up ? order(a, b) : order(b, a));
    body.append(...rows);
  }));
  filter();
}
for (const look of document.querySelectorAll("details.look")) {
  const open = () => {
    const data = look.querySelector("script");
    if (!look.open || !data || !globalThis.raytwin) return;
    raytwin.mount(look.querySelector(".viewer"), JSON.parse(data.textContent));
    data.remove();
  };
  look.addEventListener("toggle", open);
  open();
}
