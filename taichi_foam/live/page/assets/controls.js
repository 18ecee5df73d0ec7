// The controls of the next drop. A slider covers what is usual, its number field all that may be.
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
    this.moved = new Set(); // keys that the server has yet to hear of
    this.timer = null;
    $("controls").addEventListener("submit", (event) => { event.preventDefault(); this.drop(); });
    $("reset").addEventListener("click", () => { this.blur(); this.problem(""); send({ do: "reset" }); });
  }

  build({ shapes, knobs }) {
    this.knobs.clear();
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
    row.innerHTML = `<label for="${id}"></label><input type="number" id="${id}" inputmode="decimal" step="any"
      aria-describedby="${id}-hint"><span class="unit"></span><input type="range"><small id="${id}-hint"></small>`;
    const [label, number, unit, slider, hint] = row.children;
    label.textContent = knob.label;
    unit.textContent = knob.unit;
    hint.textContent = knob.about === knob.label ? knob.allowed : `${knob.about}; ${knob.allowed}`;
    number.name = knob.key;
    if (knob.optional) number.placeholder = "none";
    slider.setAttribute("aria-label", `${knob.label}, usual range`);
    Object.assign(slider, knob.log ? { min: 0, max: NOTCHES, step: 1 } : { min: knob.low, max: knob.high, step: knob.step });
    Object.assign(knob, { row, number, slider });
    this.knobs.set(knob.key, knob);
    number.addEventListener("input", () => this.touch(knob, this.read(knob)));
    number.addEventListener("change", () => this.tell());
    number.addEventListener("blur", () => this.take(null));
    slider.addEventListener("input", () => {
      const share = slider.value / NOTCHES;
      const shown = knob.log ? Number((knob.low * (knob.high / knob.low) ** share).toPrecision(3)) : Number(slider.value);
      number.value = shown;
      this.touch(knob, this.read(knob));
    });
    slider.addEventListener("change", () => this.tell());
    return row;
  }

  // The value of a number field [SI]: null for none, undefined for what is not allowed.
  read(knob) {
    const { number } = knob;
    const shown = number.value === "" ? null : Number(number.value);
    const open = (word) => knob.open.includes(word);
    const fits = number.validity.badInput ? false
      : shown === null ? knob.optional
      : !(shown < knob.min || shown > knob.max || (open("above") && shown <= knob.min) ||
          (open("below") && shown >= knob.max) || (knob.whole && !Number.isInteger(shown)));
    number.setAttribute("aria-invalid", String(!fits));
    if (!fits) return undefined;
    return shown === null ? null : knob.whole ? shown : Number((shown * knob.factor).toPrecision(12));
  }

  touch(knob, value) {
    if (value === undefined) return;
    this.slide(knob, value);
    this.moved.add(knob.key);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.tell(), SOON);
  }

  slide(knob, value) {
    const shown = value === null ? null : Number((value / knob.factor).toPrecision(9));
    // a slider that goes by ratios holds a number of notches, which is nothing to read out
    knob.slider.setAttribute("aria-valuetext", shown === null ? "none" : `${shown} ${knob.unit}`.trim());
    if (shown === null) return;
    knob.slider.value = knob.log ? NOTCHES * Math.log(Math.max(shown, 1e-9) / knob.low) / Math.log(knob.high / knob.low) : shown;
  }

  // Tell the server, and through it all viewers, what has been moved.
  tell() {
    clearTimeout(this.timer);
    const values = {};
    for (const key of this.moved) {
      const value = this.read(this.knobs.get(key));
      if (value !== undefined) values[key] = value;
    }
    this.moved.clear();
    this.send({ do: "set", shape: this.shape, values });
  }

  // What the server holds: shown wherever nobody here is at work.
  take(message) {
    if (message) ({ shape: this.shape, values: this.values } = message);
    for (const input of $("shapes").querySelectorAll("input")) input.checked = input.value === this.shape;
    for (const knob of this.knobs.values()) {
      const value = this.values[knob.key];
      if (value === undefined || document.activeElement === knob.number || this.moved.has(knob.key)) continue;
      knob.number.value = value === null ? "" : Number((value / knob.factor).toPrecision(9));
      knob.number.setAttribute("aria-invalid", "false");
      if (document.activeElement !== knob.slider || !message) this.slide(knob, value);
    }
    this.fit();
  }

  // Only what the shape has.
  fit() {
    for (const knob of this.knobs.values()) {
      knob.row.hidden = (knob.shapes.length > 0 && !knob.shapes.includes(this.shape)) ||
        (knob.group === "impactor" && this.shape === "none");
    }
  }

  drop() {
    const values = {};
    for (const [key, knob] of this.knobs) {
      if (knob.row.hidden) continue;
      const value = this.read(knob);
      if (value === undefined) {
        this.problem(`${knob.label}: must be ${knob.allowed}${knob.whole ? ", a whole number" : ""}`);
        knob.row.closest("details").open = true;
        knob.number.focus();
        return;
      }
      values[key] = value;
    }
    this.blur();
    this.problem("");
    clearTimeout(this.timer);
    this.moved.clear();
    this.send({ do: "drop", shape: this.shape, values });
  }

  blur() {
    if ($("controls").contains(document.activeElement)) document.activeElement.blur();
  }

  problem(text) {
    $("problem").textContent = text;
    $("problem").hidden = !text;
  }
}
