// Tables: key figures, where the energy is, and the drops that are over with their files.
const $ = (id) => document.getElementById(id);
export const dash = (value, digits, factor = 1) =>
  (value === null || value === undefined ? "–" : (factor * value).toFixed(digits).replace(/^-(0\.?0*)$/, "$1"));

export function row(head, ...cells) {
  const tr = document.createElement("tr"), th = document.createElement("th");
  th.scope = "row";
  th.textContent = head;
  tr.append(th, ...cells.map((content) => {
    const td = document.createElement("td");
    td.append(content);
    return td;
  }));
  return tr;
}

// Words with their unit, smaller, behind them.
function name(element, words, unit = "") {
  element.textContent = words;
  if (!unit) return;
  element.insertAdjacentHTML("beforeend", ` <span class="unit"></span>`);
  element.lastChild.textContent = unit;
}

export class Tables {
  constructor(send) {
    this.send = send;
    this.figures = [];
    this.energies = [];
    this.columns = []; // figures of the table of drops
    this.links = []; // files of a drop: name, words, and what they are
    this.falls = true;
    this.measured = null; // the instant that the key figures are of [s]
    this.shown = null; // that of the picture [s]
  }

  build({ figures, energies, drop_figures, files }) {
    this.figures = figures.map(([key, label, unit, factor, digits]) => {
      const tr = row("", "–", "");
      name(tr.firstChild, label, unit);
      tr.children[2].className = "measured";
      return { key, factor, digits, tr };
    });
    $("figures").tBodies[0].replaceChildren(...this.figures.map(({ tr }) => tr));
    this.energies = energies.map((label) => {
      const bar = document.createElement("i");
      return { key: label, bar, tr: row(label, "–", bar) };
    });
    $("energies").tBodies[0].replaceChildren(...this.energies.map(({ tr }) => tr));
    this.columns = drop_figures;
    this.links = files;
    const heads = [["drop"], ["changes"], ...drop_figures.map(([, label, unit]) => [label, unit]), ["ended by"], ["files"]];
    $("list").tHead.rows[0].replaceChildren(...heads.map((words) => {
      const th = document.createElement("th");
      th.scope = "col";
      name(th, ...words);
      return th;
    }));
  }

  begin({ measured, falls }) {
    $("figures").classList.toggle("known", Boolean(measured));
    for (const { key, factor, digits, tr } of this.figures) {
      tr.children[2].textContent = measured && measured[key] !== undefined ? dash(measured[key], digits, factor) : "";
    }
    this.falls = falls;
  }

  tell({ figures, figures_time, said }) {
    this.measured = figures_time ?? null;
    this.date();
    $("said").hidden = !said?.length;
    $("said").replaceChildren(...(said ?? []).map((text) => {
      const li = document.createElement("li");
      li.textContent = text;
      return li;
    }));
    const known = figures && Object.keys(figures).length > 0; // not before they are measured
    for (const { key, factor, digits, tr } of this.figures) {
      const value = figures && figures[key];
      tr.children[1].textContent = dash(value, digits, factor);
      // a question that this test does not ask
      tr.hidden = known && (value ?? null) === null && !tr.children[2].textContent;
    }
  }

  // Key figures take long to measure: while the run goes on they may be older than the picture.
  date() {
    $("figures").classList.toggle("stale", this.measured !== null && this.measured < this.shown);
    $("figures-time").textContent = this.measured === null ? "" : `at t = ${dash(this.measured, 2, 1e3)} ms`;
  }

  instant({ time, energies }) {
    this.shown = time;
    this.date();
    const all = energies ?? {};
    const most = Math.max(1e-12, ...Object.values(all).map(Math.abs));
    for (const { key, bar, tr } of this.energies) {
      tr.children[1].textContent = dash(all[key], 2);
      bar.style.width = `${(100 * Math.abs(all[key] ?? 0)) / most}%`;
    }
  }

  list(drops) {
    $("no-drops").hidden = drops.length > 0;
    $("list").parentElement.hidden = drops.length === 0;
    $("list").tBodies[0].replaceChildren(...drops.map((drop) => {
      const figures = this.columns.map(([key, , , factor, digits]) => dash(drop.figures[key], digits, factor));
      const tr = row(`${drop.number}`, drop.about.join(", ") || "as given", ...figures, drop.ended, this.files(drop));
      // a phone has no room for the head of the table: its words stand over each figure
      const labels = [...this.columns.map(([, label, unit]) => `${label}, ${unit}`), "ended by"];
      labels.forEach((label, n) => { tr.children[2 + n].dataset.label = label; });
      return tr;
    }));
  }

  files({ number, folder, problem, films }) {
    const content = document.createDocumentFragment(), says = document.createElement("span");
    if (folder) {
      for (const [name, label, about] of this.links) {
        const link = document.createElement("a");
        Object.assign(link, { href: `/drops/${number}/${name}`, textContent: label, title: about, download: "" });
        content.append(link);
      }
      const waits = Object.entries(films).filter(([, standing]) => standing !== "ready");
      says.className = waits.some(([, standing]) => !["waiting", "drawing"].includes(standing)) ? "bad" : "wait";
      says.textContent = waits.map(([name, standing]) =>
        ({ waiting: `${name} is waiting for its turn…`, drawing: `drawing ${name}…` })[standing] ?? standing).join(" ");
    } else if (problem) {
      const again = document.createElement("button");
      again.type = "button";
      again.textContent = "Save again";
      again.addEventListener("click", () => this.send({ do: "save" }));
      says.className = "bad";
      says.textContent = `not saved: ${problem} `;
      content.append(again);
    } else {
      says.className = "wait";
      says.textContent = "saving…";
    }
    content.append(says);
    return content;
  }
}
