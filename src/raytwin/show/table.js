"use strict";
// A long table: a click on a column's head sorts, a word searches, a choice filters by a row's data.
{
  const table = document.querySelector("table.sortable");
  const body = table?.tBodies[0], rows = [...(body?.rows ?? [])];
  const search = document.getElementById("search"), show = document.getElementById("show"), count = document.getElementById("count");
  const filter = () => {
    const text = search.value.trim().toLowerCase(), [kind, value] = show.value.split(/:(.*)/s);
    let shown = 0;
    for (const row of rows) {
      const fits = kind === "all" || row.dataset[kind].split("|").includes(value);
      row.hidden = !(fits && row.textContent.toLowerCase().includes(text));
      shown += !row.hidden;
    }
    count.textContent = `${shown} of ${rows.length}`;
  };
  const sort = (head, column) => () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const value = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim().toLowerCase();
    const numeric = rows.every((row) => row.cells[column].dataset.value !== undefined);
    const order = (a, b) => (numeric ? value(a) - value(b) : value(a).localeCompare(value(b)));
    rows.sort((a, b) => (up ? order(a, b) : order(b, a)));
    body.append(...rows);
  };
  if (table) {
    search.addEventListener("input", filter);
    show.addEventListener("change", filter);
    [...table.tHead.rows[0].cells].forEach((head, column) => head.querySelector("button")?.addEventListener("click", sort(head, column)));
    filter();
  }
}
