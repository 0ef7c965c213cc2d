// The page around the player: light or dark, and tables that a person can sort.
const THEMES = ["auto", "light", "dark"];

function makeTheme() {
  const button = byId("theme");
  const kept = () => {
    try {
      return localStorage.getItem("realitygap-theme");
    } catch {
      return null; // a browser that lets no page from disk keep anything
    }
  };
  const wear = (theme) => {
    if (theme === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    button.textContent = `Colours: ${theme === "auto" ? "as the system" : theme}`;
    button.dataset.now = theme;
    document.dispatchEvent(new Event("themechange"));
  };
  wear(THEMES.includes(kept()) ? kept() : "auto");
  button.hidden = false;
  button.addEventListener("click", () => {
    const theme = THEMES[(THEMES.indexOf(button.dataset.now) + 1) % THEMES.length];
    try {
      localStorage.setItem("realitygap-theme", theme);
    } catch {
      // the next visit begins as the system is
    }
    wear(theme);
  });
}

// Paper is light: what is drawn is drawn so before it is printed, and as it was afterwards.
function onPrint(draw) {
  const { dataset } = document.documentElement;
  let worn;
  window.addEventListener("beforeprint", () => {
    worn = dataset.theme;
    dataset.theme = "light";
    draw();
  });
  window.addEventListener("afterprint", () => {
    if (worn === undefined) delete dataset.theme;
    else dataset.theme = worn;
    draw();
  });
}

// A cell's number, NaN for words: the first number in it, so that "0.71 ± 0.02" is 0.71.
function numberIn(cell) {
  const found = /^[^\d−-]{0,2}([−-]?\d[\d ]*(?:\.\d+)?)/.exec(cell.textContent.trim());
  return found ? Number(found[1].replace("−", "-").replace(/ /g, "")) : NaN;
}

function compareCells(a, b) {
  const [x, y] = [numberIn(a), numberIn(b)];
  if (Number.isNaN(x) && Number.isNaN(y)) return a.textContent.trim().localeCompare(b.textContent.trim());
  return x - y;
}

// Which column each heading stands over, spans counted: [heading, column], of those over one column only.
function leafHeadings(table) {
  const taken = [];
  const leaves = [];
  [...table.tHead.rows].forEach((row, r) => {
    let column = 0;
    for (const cell of row.cells) {
      while (taken[r]?.[column]) column++;
      for (let down = 0; down < cell.rowSpan; down++)
        for (let across = 0; across < cell.colSpan; across++) (taken[r + down] ??= [])[column + across] = true;
      const isLeaf = cell.tagName === "TH" && cell.colSpan === 1 && r + cell.rowSpan === table.tHead.rows.length;
      if (isLeaf) leaves.push([cell, column]);
      column += cell.colSpan;
    }
  });
  return leaves;
}

// The rows of a group that may change places: not its heading, not its average.
function freeRows(body) {
  return [...body.rows].filter((row) => !row.matches(".class, .average"));
}

function sortTable(table, column, direction) {
  for (const body of table.tBodies) {
    const rows = freeRows(body);
    const ordered = [...rows].sort((a, b) => {
      if (direction === "none") return Number(a.dataset.first) - Number(b.dataset.first);
      const [x, y] = [a.cells[column], b.cells[column]];
      const empty = (cell) => !cell || /^[–\s]*$/.test(cell.textContent);
      if (empty(x) || empty(y)) return Number(empty(x)) - Number(empty(y));
      return direction === "ascending" ? compareCells(x, y) : compareCells(y, x);
    });
    const rest = rows.length ? rows[rows.length - 1].nextSibling : null;
    ordered.forEach((row) => body.insertBefore(row, rest));
  }
}

function makeSortable(table) {
  if (!table.tHead || ![...table.tBodies].some((body) => freeRows(body).length > 1)) return;
  for (const body of table.tBodies) freeRows(body).forEach((row, i) => (row.dataset.first = i));
  const leaves = leafHeadings(table);
  leaves.forEach(([heading, column]) => {
    const button = made("button", { type: "button", class: "sort" });
    button.append(...heading.childNodes);
    heading.append(button);
    heading.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const before = heading.getAttribute("aria-sort");
      const next = { none: "ascending", ascending: "descending", descending: "none" }[before];
      leaves.forEach(([other]) => other.setAttribute("aria-sort", "none"));
      heading.setAttribute("aria-sort", next);
      sortTable(table, column, next);
    });
  });
}

makeTheme();
document.querySelectorAll("main table").forEach(makeSortable);
openPlayer();
