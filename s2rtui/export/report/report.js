// A click or enter on the head of a column sorts the rows of its table by it, once more reverses.
for (const head of document.querySelectorAll("thead th")) {
  head.tabIndex = 0;
  head.addEventListener("click", () => sort(head));
  head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(head); });
}

function sort(head) {
  const body = head.closest("table").tBodies[0], place = head.cellIndex;
  const rising = head.getAttribute("aria-sort") === "descending";
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", rising ? "ascending" : "descending");
  const rows = [...body.rows].map((row) => [value(row.cells[place].textContent.trim()), row]);
  rows.sort(([a], [b]) => compare(a, b, rising ? 1 : -1));
  body.append(...rows.map(([, row]) => row));
}

function value(text) {
  const number = parseFloat(text.replace("−", "-"));
  return Number.isNaN(number) ? text : number;
}

function compare(a, b, sign) {
  if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;  // texts after numbers
  return sign * (typeof a === "number" ? a - b : a.localeCompare(b));
}
