"use strict";
// Tables that sort and filter, maps with a slider; without scripts all of it is there to be read.
document.documentElement.classList.add("scripted");

function element(name, about) {
  return Object.assign(document.createElement(name), about);
}

// A cell begins with its figure, "31 [24, 39]" or "+0.2 [...]"; without one it is text.
function compareCells(one, other) {
  const figures = [one, other].map((text) => parseFloat(text));
  if (figures.every(Number.isNaN)) return one.localeCompare(other);
  if (figures.some(Number.isNaN)) return Number.isNaN(figures[0]) ? 1 : -1;
  return figures[0] - figures[1];
}

function sortBy(table, column, down) {
  const text = (row) => row.cells[column]?.textContent.trim() ?? "";
  const rows = [...table.tBodies[0].rows];
  rows.sort((a, b) => (!text(a) - !text(b)) || compareCells(text(a), text(b)) * (down ? -1 : 1));
  table.tBodies[0].append(...rows);
}

function sortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = element("button", { textContent: "↕", type: "button" });
    button.setAttribute("aria-label", `sort by ${head.textContent}`);
    button.addEventListener("click", () => {
      // The largest figure comes first, names by their alphabet.
      const was = head.getAttribute("aria-sort");
      const down = was ? was === "ascending" : column > 0;
      heads.forEach((each) => each.removeAttribute("aria-sort"));
      heads.forEach((each) => (each.lastChild.textContent = "↕"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      button.textContent = down ? "↓" : "↑";
      sortBy(table, column, down);
    });
    head.append(button);
  });
}

function filterable(frame, table) {
  const rows = [...table.tBodies[0].rows];
  const box = element("input", { type: "search" });
  const count = element("output", {});
  const label = element("label", { textContent: "filter " });
  const tools = element("div", { className: "tools" });
  label.append(box);
  tools.append(label, count);
  frame.before(tools);
  box.addEventListener("input", () => {
    const words = box.value.toLowerCase().split(/\s+/);
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
    }
    count.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} rows`;
  });
}

function slide(pair) {
  const both = pair.querySelector(".both");
  const [before, after] = [...both.querySelectorAll("p")].map((each) => each.textContent);
  const range = element("input", { type: "range", min: 0, max: 100, value: 50 });
  const title = pair.querySelector("figcaption").textContent;
  range.setAttribute("aria-label", `${title}: share that shows every estimate, in %`);
  const told = element("output", { textContent: `left ${before}; right ${after}` });
  const move = () => both.style.setProperty("--cut", `${range.value}%`);
  range.addEventListener("input", move);
  both.after(range, told);
  move();
}

for (const frame of document.querySelectorAll(".wide")) {
  const table = frame.querySelector("table");
  sortable(table);
  if (table.tBodies[0].rows.length > 5) filterable(frame, table);
}
document.querySelectorAll(".pair").forEach(slide);
