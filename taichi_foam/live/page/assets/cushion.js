// The cushion chart: its inputs, the formula's curve, the simulated drops, and the table of them.
import { css, roundUp } from "./curve.js";
import { dash, row } from "./tables.js";
import { fitted, mark } from "./typed.js";

const $ = (id) => document.getElementById(id);
const CAP = 3.5; // beyond the optimum, the highest of the chart over the least peak: bottomed out may be far above
const EXAMPLE = "height [cm],thickness [mm],static stress [kPa],peak [g]\n76,50,5.2,41";
const X = "static stress (kPa)", Y = "peak deceleration (g, raw)";

export class Cushion {
  constructor(send, watch) {
    this.send = send;
    this.watch = watch; // shows the drop
    this.fields = []; // what the server told, and the elements
    this.foam = null;
    this.tests = null; // where own tests are pasted
    this.chart = null;
    this.built = "";
    this.due = false;
    $("ask").addEventListener("submit", (event) => { event.preventDefault(); this.ask(); });
    new ResizeObserver(() => this.paint()).observe($("chart-plot"));
  }

  build(told) {
    // the same server again after a lost connection: what is typed here stays
    if (JSON.stringify(told) === this.built) return;
    this.built = JSON.stringify(told);
    this.foam = this.row({ key: "foam", label: "foam", unit: "", about: told.about, value: told.foam });
    const names = document.createElement("datalist");
    names.id = "foams";
    names.append(...told.foams.map((name) => new Option("", name)));
    this.foam.number.setAttribute("list", "foams");
    this.foam.row.classList.add("words");
    this.fields = told.inputs.map((input) => this.row({ ...input, about: `${input.about}; ${input.min} to ${input.max} ${input.unit}` }));
    this.tests = this.row({ key: "tests", label: "own tests", unit: "", most: told.most_pasted,
      about: "rows of a table or CSV file, pasted with their header; those of this drop height and thickness are drawn" }, "textarea");
    Object.assign(this.tests.number, { rows: 3, placeholder: EXAMPLE });
    this.tests.row.classList.add("pasted");
    $("inputs").replaceChildren(this.foam.row, names, ...this.fields.map((field) => field.row), this.tests.row);
  }

  row(field, kind = "input") {
    const row = document.createElement("div"), id = `cushion-${field.key}`;
    row.className = "knob";
    row.innerHTML = `<label for="${id}"></label><${kind} id="${id}" autocomplete="off" spellcheck="false"
      aria-describedby="${id}-wrong ${id}-hint"></${kind}><span class="unit"></span><small class="wrong" id="${id}-wrong" hidden></small>
      <small id="${id}-hint"></small>`;
    const [label, number, unit, wrong, hint] = row.children;
    label.textContent = field.label;
    unit.textContent = field.unit;
    hint.textContent = field.about;
    if (kind === "input") number.type = "text";
    number.value = field.value ?? "";
    if (field.unit) number.inputMode = "decimal";
    if (field.optional) number.placeholder = "by formula";
    number.addEventListener("input", () => mark({ number, wrong }, ""));
    return { ...field, row, number, wrong };
  }

  // Ask for the chart of what stands in the fields.
  ask() {
    const message = { do: "cushion", foam: this.foam.number.value.trim(), tests: this.tests.number.value }, wrong = [];
    for (const field of this.fields) {
      const { value, problem } = fitted(field.number.value, field);
      mark(field, problem ?? "");
      if (problem) wrong.push(field);
      message[field.key] = value;
    }
    const { most } = this.tests, long = message.tests.length > most;
    mark(this.tests, long ? `more than ${most.toLocaleString("en")} characters; leave rows out` : "");
    if (long) wrong.push(this.tests);
    this.problem("");
    if (wrong.length) wrong[0].number.focus();
    else this.order(message);
  }

  // Send what has the server compute, or say that it cannot be sent; whether it went.
  order(message) {
    const went = this.send(message);
    this.problem(went ? "" : "The page has no connection to the program (taichi-foam serve). It keeps trying; " +
      "press again once it is connected.");
    return went;
  }

  // What the server has refused: beside the field that it names, or below them all.
  problem(text) {
    const starts = (each) => (each === this.tests ? "own tests" : `${each?.key} = `);
    const field = this.foam && [this.foam, ...this.fields, this.tests].find((each) => text.startsWith(starts(each)));
    if (field) {
      mark(field, field === this.tests ? text : text.slice(starts(field).length));
      field.number.focus();
    }
    $("cushion-problem").textContent = field ? "" : text;
    $("cushion-problem").hidden = Boolean(field) || !text;
  }

  take(chart) {
    this.chart = chart;
    $("chart-conditions").textContent = `${chart.about}; ${shown(chart.thickness, 1e3)} mm thick, drop height ` +
      `${shown(chart.drop_height, 1e2)} cm. Simulated is a strip of the pad, which stops as the whole one does.`;
    $("chart-state").textContent = this.words();
    $("chart-plot").hidden = false;
    this.list();
    this.paint();
  }

  words() {
    const { points, waits, problem, least, tests } = this.chart;
    const done = points.filter(({ state }) => state === "simulated").length;
    const failed = points.filter(({ state }) => state === "failed");
    const way = least[0] < points[0].static ? "rises" : least[0] > points.at(-1).static ? "falls" : "";
    const words = [way ? `By formula the peak ${way} throughout this range.`
      : `By formula the least is ${dash(least[1], 1)} g, at ${shown(Number(least[0].toPrecision(3)), 1e-3)} kPa.`];
    words.push(waits ? `${done} of ${points.length} drops simulated, the others are being computed.` : `${done} of ${points.length} drops simulated.`);
    if (failed.length) words.push(`${failed.length} gave no peak: ${failed[0].why}.`);
    if (problem) words.push(`The others will not come: ${problem}.`);
    if (tests) words.push(`${tests.g.length} of ${tests.all} own tests have this drop height and thickness.`);
    if (done) words.push("Click a point, or Watch in the table, to watch that drop.");
    return words.join(" ");
  }

  // A row per point. Rows stay while points come: a press of a button must not fall between two of them.
  list() {
    const { points, watched, waits } = this.chart, { rows } = $("points-table").tBodies[0];
    $("points").hidden = false;
    if (rows.length !== points.length) $("points-table").tBodies[0].replaceChildren(...points.map((_, n) => this.point(n)));
    points.forEach((point, n) => {
      const empty = { waiting: waits ? "…" : "–", failed: "none", simulated: "" }[point.state];
      const figure = (key, digits, factor) => empty || dash(point[key], digits, factor);
      const words = [shown(point.static, 1e-3), point.by_hand === null ? "used up" : dash(point.by_hand, 1),
        figure("g", 1), figure("g_cfc180", 1), figure("strain", 1, 1e2)];
      const { cells } = rows[n];
      words.forEach((text, k) => { cells[k].textContent = text; });
      if (point.bottomed) cells[4].append(small("bottomed out"));
      cells[5].firstChild.setAttribute("aria-label", `Watch the drop at ${words[0]} kPa`);
      rows[n].ariaCurrent = String(n === watched);
    });
  }

  point(n) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: "Watch" });
    button.dataset.point = n;
    button.addEventListener("click", () => this.choose(n));
    return row("", "", "", "", "", button);
  }

  choose(n) {
    if (this.order({ do: "point", chart: this.chart.number, point: n })) this.watch();
  }

  // Soon, and once for all that has changed until then.
  paint() {
    if (this.due || !this.chart) return;
    this.due = true;
    requestAnimationFrame(() => { this.due = false; this.plot(); });
  }

  plot() {
    const element = $("chart-plot");
    if (!window.Plotly || !element.clientWidth) return;
    const ink = css("--ink"), soft = css("--soft"), line = css("--line"), blue = css("--curve"), accent = css("--accent"), bad = css("--bad");
    const { formula, points, least } = this.chart, tests = this.chart.tests ?? { static: [], g: [] }, kPa = (value) => 1e-3 * value;
    const simulated = points.map((point, n) => ({ ...point, n })).filter(({ state }) => state === "simulated");
    const before = formula.g.filter((g, k) => g !== null && formula.static[k] <= least[0]);
    const beyond = [...formula.g, ...simulated.map(({ g }) => g)].filter((g) => g !== null);
    const sound = simulated.filter(({ bottomed }) => !bottomed).map(({ g }) => g);
    const top = roundUp(1.05 * Math.max(...before, ...sound, ...tests.g, Math.min(CAP * least[1], Math.max(...beyond))));
    const place = (g) => Math.min(g, top); // what is higher stands at the edge, with its number
    const marks = (bottomed_out, name, marker) => {
      const these = simulated.filter(({ bottomed }) => bottomed === bottomed_out);
      return { x: these.map((each) => kPa(each.static)), y: these.map(({ g }) => place(g)), customdata: these.map(({ n }) => n), name,
        text: these.map(({ g }) => (g > top ? `${dash(g, 0)} g ↑` : "")), textposition: "bottom center", textfont: { size: 11, color: bad }, mode: "markers+text", cliponaxis: false,
        hovertext: these.map((each) => `${shown(each.static, 1e-3)} kPa: ${dash(each.g, 1)} g raw, ${dash(each.g_cfc180, 1)} g CFC 180, strain ${dash(each.strain, 0, 1e2)} %`), hoverinfo: "text", marker };
    };
    const traces = [
      { x: formula.static.map(kPa), y: formula.g, name: "formula (energy balance)", mode: "lines", line: { width: 2, color: blue, simplify: false },
        hovertemplate: "formula: %{y:.1f} g at %{x:.2f} kPa<extra></extra>" },
      marks(false, "simulated, raw", { size: 11, color: accent, line: { width: 1, color: css("--card") } }),
      marks(true, "simulated, bottomed out", { size: 11, symbol: "x", color: bad }),
    ];
    if (tests.g.length) {
      traces.push({ x: tests.static.map(kPa), y: tests.g, name: "own tests", mode: "markers", marker: { size: 10, symbol: "diamond", color: ink },
        hovertemplate: "own test: %{y:.1f} g at %{x:.2f} kPa<extra></extra>" });
    }
    const statics = [points[0].static, points.at(-1).static, ...tests.static];
    const ends = [kPa(Math.min(...statics)), kPa(Math.max(...statics))], room = (ends[1] / ends[0]) ** 0.04;
    const range = [Math.log10(ends[0] / room), Math.log10(ends[1] * room)], steps = ticks(ends[0] / room, ends[1] * room);
    const axis = { color: soft, gridcolor: line, linecolor: line, zeroline: false, fixedrange: true, tickfont: { size: 11 } };
    const title = (text) => ({ text, font: { size: 12, color: ink }, standoff: 6 });
    const layout = {
      margin: { l: 52, r: 14, t: 8, b: 46 }, height: element.clientHeight, width: element.clientWidth,
      paper_bgcolor: "transparent", plot_bgcolor: "transparent", hovermode: "closest", dragmode: false,
      showlegend: true, legend: { x: 0.5, xanchor: "center", y: 1, yanchor: "top", bgcolor: `${css("--card")}d0`, font: { size: 11 } },
      font: { family: "system-ui, sans-serif", color: ink },
      xaxis: { ...axis, type: "log", range, title: title(X), tickvals: steps, ticktext: steps.map(String) },
      yaxis: { ...axis, range: [0, top], title: title(Y) },
    };
    window.Plotly.react(element, traces, layout, { displayModeBar: false, responsive: false, doubleClick: false });
    if (!element.dataset.listens) {
      element.dataset.listens = "true";
      element.on("plotly_click", ({ points: [{ customdata }] }) => { if (customdata !== undefined) this.choose(customdata); });
    }
    element.setAttribute("aria-label", `Peak deceleration over static stress. ${this.words()} All points are in the table.`);
  }
}

const shown = (value, factor) => String(Number((value * factor).toPrecision(6)));

function small(words) {
  const element = document.createElement("small");
  element.textContent = words;
  return element;
}

// Where the logarithmic axis has its numbers.
function ticks(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
    for (const n of [1, 2, 3, 5, 7]) found.push(Number((n * 10 ** power).toPrecision(6)));
  }
  return found.filter((value) => value >= low && value <= high);
}
