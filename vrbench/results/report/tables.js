// Tables that sort by a click or a key on a heading, and filter as one types.
"use strict";

/** What a cell is sorted by: its number where it has one, its text otherwise. */
function sortKey(cell) {
  const text = (cell.dataset.key ?? cell.textContent).trim();
  const value = Number.parseFloat(text.replace(/−/g, "-"));
  return Number.isNaN(value) || !/^[−+\-.\d]/.test(text) ? text : value;
}

/** Numbers before texts, what is empty last whichever way it is sorted. */
function compare(a, b, direction) {
  if (a === "" || b === "") return (a === "") - (b === "");
  if (typeof a === "number" && typeof b === "number") return direction * (a - b);
  if (typeof a !== typeof b) return direction * (typeof a === "number" ? -1 : 1);
  return direction * a.localeCompare(b, "en", { numeric: true });
}

function sortable(table) {
  const head = table.tHead.rows[0];
  const body = table.tBodies[0];
  [...body.rows].forEach((row, k) => { row.dataset.place = k; });
  [...head.cells].forEach((cell, column) => {
    const button = element("button", { type: "button" });
    button.append(...cell.childNodes);
    cell.append(button);
    button.addEventListener("click", () => {
      const now = cell.getAttribute("aria-sort");
      const next = now === "ascending" ? "descending" : now === "descending" ? null : "ascending";
      [...head.cells].forEach((other) => other.removeAttribute("aria-sort"));
      if (next) cell.setAttribute("aria-sort", next);
      const direction = next === "descending" ? -1 : 1;
      const rows = [...body.rows].map((row) => [next ? sortKey(row.cells[column]) : Number(row.dataset.place), row]);
      rows.sort((a, b) => compare(a[0], b[0], direction) || a[1].dataset.place - b[1].dataset.place);
      body.append(...rows.map(([, row]) => row));
    });
  });
}

/** Controls with data-table and data-column hide the rows that don't match them all. */
function filterable(form) {
  const table = document.getElementById(form.dataset.table);
  const count = form.querySelector("output");
  const rows = [...table.tBodies[0].rows];
  const apply = () => {
    let shown = 0;
    const wanted = [...form.querySelectorAll("input, select")].filter((one) => one.value.trim() !== "");
    for (const row of rows) {
      const fits = wanted.every((one) => {
        if (one.tagName === "SELECT") {
          const cell = row.cells[Number(one.dataset.column)];
          return (cell.dataset.key ?? cell.textContent.trim()) === one.value;
        }
        const text = row.textContent.toLowerCase();
        return one.value.toLowerCase().split(/\s+/).every((word) => text.includes(word));
      });
      row.hidden = !fits;
      shown += fits ? 1 : 0;
    }
    const all = `${rows.length} ${rows.length === 1 ? "row" : "rows"}`;
    count.textContent = shown === rows.length ? all : `${shown} of ${all}`;
  };
  form.addEventListener("input", apply);
  form.addEventListener("submit", (event) => event.preventDefault());
  apply();
}

document.querySelectorAll("table.sortable").forEach(sortable);
document.querySelectorAll("form.controls").forEach(filterable);
