// The controls of the next drop. A slider covers what is usual, its number field all that may be.
import { DIGITS, fitted, mark } from "./typed.js";

const $ = (id) => document.getElementById(id);
const GROUPS = { impactor: "Impactor", block: "Block", foam: "Foam" };
const SOON = 150; // after the last movement of a slider the others are told [ms]
const NOTCHES = 1000; // of a slider that goes by ratios

export class Controls {
  constructor(send) {
    this.send = send;
    this.knobs = new Map(); // by key: what the server told, and the elements
    this.values = {}; // of the server, SI
    this.shape = null;
    // What is set here and the server has not confirmed, by key [SI]; undefined for a text that
    // cannot be a value. Whatever comes meanwhile, it stays in its field, and it is what drops.
    this.own = new Map();
    this.built = "";
    this.timer = null;
    this.unsent = false; // whether what was pressed last could not be sent
    $("controls").addEventListener("submit", (event) => { event.preventDefault(); this.drop(); });
    $("reset").addEventListener("click", () => {
      if (!this.order({ do: "reset" })) return;
      this.own.clear();
      this.problem("");
      this.take(null);
    });
  }

  // Send what drops something, or say that it cannot be sent; whether it went.
  order(message) {
    this.unsent = !this.send(message);
    if (this.unsent) {
      this.problem("Nothing was dropped: the page has no connection to taichi-foam serve. " +
        "It keeps trying to reconnect, and your settings are kept; press the button again once it is connected.");
    }
    return !this.unsent;
  }

  connected() {
    if (this.unsent) this.problem("");
    this.unsent = false;
  }

  build(told) {
    // the same server again after a lost connection: what is typed here stays
    if (JSON.stringify(told) === this.built) return;
    this.built = JSON.stringify(told);
    const { shapes, knobs } = told;
    this.knobs.clear();
    this.own.clear();
    $("shapes").replaceChildren($("shapes").firstElementChild, ...shapes.map((shape) => {
      const label = document.createElement("label");
      label.innerHTML = `<input type="radio" name="shape"> `;
      label.firstChild.value = shape;
      label.append(shape);
      label.firstChild.addEventListener("change", () => { this.shape = shape; this.fit(); this.tell(); });
      return label;
    }));
    const wide = matchMedia("(min-width: 740px)").matches;
    $("groups").replaceChildren(...Object.entries(GROUPS).map(([group, title]) => {
      const details = document.createElement("details");
      details.open = wide && group === "impactor";
      details.innerHTML = `<summary>${title}</summary>`;
      details.append(...knobs.filter((knob) => knob.group === group).map((knob) => this.row(knob)));
      return details;
    }));
  }

  row(knob) {
    const row = document.createElement("div"), id = knob.key.replace(".", "-");
    row.className = "knob";
    // a field of type number would drop a comma without a word, and hide what it cannot read
    row.innerHTML = `<label for="${id}"></label><input type="text" id="${id}" inputmode="decimal" autocomplete="off"
      aria-describedby="${id}-wrong ${id}-hint"><span class="unit"></span><small class="wrong" id="${id}-wrong" hidden></small>
      <input type="range"><small id="${id}-hint"></small>`;
    const [label, number, unit, wrong, slider, hint] = row.children;
    label.textContent = knob.label;
    unit.textContent = knob.unit;
    hint.textContent = knob.about === knob.label ? knob.allowed : `${knob.about}; ${knob.allowed}`;
    number.name = knob.key;
    if (knob.min < 0) number.inputMode = "text"; // keyboards for decimals have no minus
    if (knob.optional) number.placeholder = "none";
    slider.setAttribute("aria-label", `${knob.label}, usual range`);
    Object.assign(slider, knob.log ? { min: 0, max: NOTCHES, step: 1 } : { min: knob.low, max: knob.high, step: knob.step });
    Object.assign(knob, { row, number, wrong, slider });
    this.knobs.set(knob.key, knob);
    number.addEventListener("input", () => this.touch(knob));
    number.addEventListener("change", () => this.tell());
    number.addEventListener("blur", () => this.take(null));
    slider.addEventListener("input", () => {
      const share = slider.value / NOTCHES;
      number.value = knob.log ? Number((knob.low * (knob.high / knob.low) ** share).toPrecision(3)) : Number(slider.value);
      this.touch(knob);
    });
    slider.addEventListener("change", () => this.tell());
    return row;
  }

  // What stands in a field [SI], null for none. What cannot be is marked, and undefined.
  read(knob) {
    const { value, problem } = fitted(knob.number.value, knob);
    mark(knob, problem ?? "");
    return value;
  }

  touch(knob) {
    const value = this.read(knob);
    this.own.set(knob.key, value);
    if (value === undefined) return;
    this.slide(knob, value);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.tell(), SOON);
  }

  slide(knob, value) {
    const shown = value === null ? null : this.shown(knob, value);
    // a slider that goes by ratios holds a number of notches, which is nothing to read out
    knob.slider.setAttribute("aria-valuetext", shown === null ? "none" : `${shown} ${knob.unit}`.trim());
    if (shown === null) return;
    knob.slider.value = knob.log ? NOTCHES * Math.log(Math.max(shown, 1e-9) / knob.low) / Math.log(knob.high / knob.low) : shown;
  }

  shown(knob, value) {
    return Number((value / knob.factor).toPrecision(DIGITS));
  }

  // Tell the server, and through it all viewers, what has been set here.
  tell() {
    clearTimeout(this.timer);
    const values = Object.fromEntries([...this.own].filter(([, value]) => value !== undefined));
    this.send({ do: "set", shape: this.shape, values });
  }

  // What the server holds: shown wherever nobody here is at work.
  take(message) {
    if (message) ({ shape: this.shape, values: this.values } = message);
    for (const input of $("shapes").querySelectorAll("input")) input.checked = input.value === this.shape;
    for (const [key, knob] of this.knobs) {
      const value = this.values[key];
      if (this.own.get(key) === value && document.activeElement !== knob.number) this.own.delete(key);
      if (value === undefined || this.own.has(key)) continue;
      const shown = value === null ? "" : String(this.shown(knob, value));
      if (knob.number.value !== shown) knob.number.value = shown; // else a caret would jump
      mark(knob, "");
      if (document.activeElement !== knob.slider || !message) this.slide(knob, value);
    }
    this.fit();
  }

  // Only what the shape has.
  fit() {
    for (const knob of this.knobs.values()) knob.row.hidden = !knob.shapes.includes(this.shape);
  }

  drop() {
    const values = {}, wrong = [];
    for (const [key, knob] of this.knobs) {
      if (knob.row.hidden) continue;
      values[key] = this.own.has(key) ? this.own.get(key) : this.values[key];
      if (values[key] === undefined) wrong.push(knob);
    }
    if (wrong.length) {
      this.problem(`Nothing was dropped. ${wrong.map(({ label, wrong: { textContent } }) => `${label} ${textContent}.`).join("\n")}`);
      wrong[0].row.closest("details").open = true;
      wrong[0].number.focus();
      return;
    }
    if (!this.order({ do: "drop", shape: this.shape, values })) return;
    this.blur();
    this.problem("");
    clearTimeout(this.timer);
  }

  blur() {
    if ($("controls").contains(document.activeElement)) document.activeElement.blur();
  }

  problem(text) {
    $("problem").textContent = text;
    $("problem").hidden = !text;
  }
}
