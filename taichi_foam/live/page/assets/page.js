// The page: one socket, the picture, the readouts and the transport. Numbers come in SI units.
import { Controls } from "./controls.js";
import { Curve } from "./curve.js";
import { Cushion } from "./cushion.js";
import { Tables, dash } from "./tables.js";

const $ = (id) => document.getElementById(id);
const dark = matchMedia("(prefers-color-scheme: dark)");

let socket = null;
let waits = 500; // until the next try to connect [ms]
let settings = { theme: "auto", pace: null };
let scene = null;
let paces = [];
let step = null; // [s]
let state = "";
const TABS = ["run", "cushion"];
let tab = "run";

// Whether it went: there may be no connection.
const send = (message) => {
  const open = socket !== null && socket.readyState === WebSocket.OPEN;
  if (open) socket.send(JSON.stringify(message));
  return open;
};
const controls = new Controls(send);
const curve = new Curve($("curve"));
const tables = new Tables(send);
const cushion = new Cushion(send, () => openTab("run"));

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onopen = watch;
  socket.onmessage = ({ data }) => (typeof data === "string" ? hear(JSON.parse(data)) : draw(data));
  socket.onclose = ({ reason }) => {
    lost(reason || "connection lost");
    setTimeout(connect, waits);
    waits = Math.min(2 * waits, 8000);
  };
}

function hear(message) {
  switch (message.kind) {
    case "hello": // only now: a server may open a socket to say why it closes it
      waits = 500;
      lost(null);
      controls.connected();
      paces = message.paces;
      step = message.step;
      $("step").title = `${Number((1e3 * step).toPrecision(3))} ms forward, then pause`;
      $("pace").replaceChildren(...paces.map((rate, n) => new Option(paceWords(rate), n)));
      $("mode").replaceChildren(...message.modes.map(([name, about]) => new Option(about, name)));
      controls.build(message.controls);
      tables.build(message);
      cushion.build(message.cushion);
      break;
    case "settings": take(message); break;
    case "scene": show(message); break;
    case "numbers": tell(message); break;
    case "curve": curve.add(message); break;
    case "curves": curve.former(message.curves); break;
    case "drops": tables.list(message.drops); break;
    case "chart": cushion.take(message); break;
    case "problem": (tab === "cushion" ? cushion : controls).problem(message.text); break;
  }
}

function take(message) {
  settings = message;
  controls.take(message);
  $("mode").value = message.mode;
  $("theme").value = message.theme;
  $("grid").checked = message.grid;
  const n = paces.indexOf(message.pace);
  if (n < 0) { // a pace that somebody has set without this page
    paces.push(message.pace);
    $("pace").append(new Option(paceWords(message.pace), paces.length - 1));
  }
  $("pace").value = paces.indexOf(message.pace);
  $("slower").disabled = n === 0;
  $("faster").disabled = n === paces.length - 1;
  dress();
}

const tone = () => (settings.theme === "auto" ? (dark.matches ? "dark" : "light") : settings.theme);

function dress() {
  if (document.documentElement.dataset.theme === tone()) return;
  document.documentElement.dataset.theme = tone();
  curve.paint();
  cushion.paint();
  watch();
}

const watch = () => send({ do: "watch", on: !document.hidden && tab === "run", tone: tone() });

// Show the one tab or the other.
function openTab(name) {
  tab = name;
  for (const each of TABS) {
    $(each).hidden = each !== name;
    $(`${each}-tab`).setAttribute("aria-selected", String(each === name));
    $(`${each}-tab`).tabIndex = each === name ? 0 : -1;
  }
  watch();
}

function show(message) {
  if (scene && scene.drop !== message.drop) controls.problem(""); // what was refused is another matter
  scene = message;
  const changes = message.changes.join(", ");
  $("name").textContent = message.name;
  $("changes").textContent = changes && `with ${changes}`;
  document.title = changes ? `${message.name} with ${changes}` : message.name;
  $("picture").style.aspectRatio = `${message.size[0]} / ${message.size[1]}`;
  $("key-words").textContent = message.key.words;
  $("key-bar").style.background = `linear-gradient(90deg, ${message.key.colours.join(", ")})`;
  $("key-ticks").replaceChildren(...message.key.ticks.map(([share, text]) => {
    const tick = document.createElement("span");
    tick.style.left = `${100 * share}%`;
    tick.textContent = text;
    return tick;
  }));
  $("apart").hidden = message.controlled;
  curve.begin(message);
  tables.begin(message);
}

// A picture, after the length and the JSON of what is read out beside it: all of one instant.
async function draw(data) {
  try {
    const start = 4 + new DataView(data).getUint32(0, true);
    const now = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, start - 4)));
    const canvas = $("picture");
    if (!canvas.clientWidth) return; // it is behind the other tab
    const blob = new Blob([new Uint8Array(data, start)]);
    let image = await createImageBitmap(blob);
    const shown = Math.min(canvas.clientWidth, (canvas.clientHeight * image.width) / image.height);
    const width = Math.min(image.width, Math.round(shown * devicePixelRatio));
    if (!width) return; // the other tab has been opened meanwhile
    if (width < image.width) { // browsers shrink canvases roughly, and thin lines would flicker
      const height = Math.round((width * image.height) / image.width);
      image = await createImageBitmap(image, { resizeWidth: width, resizeHeight: height, resizeQuality: "high" });
    }
    Object.assign(canvas, { width: image.width, height: image.height });
    canvas.getContext("2d").drawImage(image, 0, 0);
    image.close();
    const falls = scene && scene.falls;
    $("time").textContent = dash(now.time, 2, 1e3);
    $("displacement").textContent = falls ? dash(now.displacement, 2, 1e2) : "–";
    $("velocity").textContent = falls ? dash(now.velocity, 2) : "–";
    $("deceleration").textContent = falls ? dash(now.deceleration, 1) : "–";
    tables.instant(now);
  } finally {
    send({ do: "next" });
  }
}

function tell(message) {
  if (message.state !== state || $("state").dataset.state === "lost") {
    state = message.state;
    $("state").dataset.state = state;
    $("state").textContent = state === "died" ? "stopped" : state;
    $("pause").textContent = state === "paused" ? "Resume" : "Pause";
    for (const id of ["pause", "step"]) $(id).disabled = !["running", "paused", "preparing"].includes(state);
  }
  const remedy = state === "died" ? ". Drop starts it again." : "";
  alarm(message.message ? `${message.message}${remedy}` : "");
  $("fraction").value = message.fraction;
  const stands = message.waiting || `${message.steps.toLocaleString("en")} steps`;
  $("speed").textContent = state === "running" ? speedWords(message) : stands;
  tables.tell(message);
}

function speedWords({ pace, steps, steps_per_s }) {
  const words = [`${steps.toLocaleString("en")} steps`];
  if (pace > 0) words.push(`running at ${paceWords(pace)}`);
  if (steps_per_s) words.push(`${Number(steps_per_s.toPrecision(2)).toLocaleString("en")} steps/s while computing`);
  return words.join(" · ");
}

function paceWords(rate) {
  if (rate === null) return "fastest";
  const ratio = 1 / rate;
  return `1 : ${ratio < 10 ? Number(ratio.toPrecision(2)) : Math.round(ratio).toLocaleString("en")}`;
}

function alarm(text) {
  if ($("alert").textContent !== text) $("alert").textContent = text;
  $("alert").hidden = !text;
}

function lost(reason) {
  document.body.classList.toggle("lost", Boolean(reason));
  if (!reason) return;
  for (const id of ["pause", "step"]) $(id).disabled = true;
  $("state").dataset.state = "lost";
  $("state").textContent = `${reason}; reconnecting`;
}

const look = () => send({ do: "look", mode: $("mode").value, theme: $("theme").value, grid: $("grid").checked });
for (const id of ["mode", "theme", "grid"]) $(id).addEventListener("change", look);
const pace = (n) => send({ do: "pace", rate: paces[n] });
$("pace").addEventListener("change", () => pace(Number($("pace").value)));
$("slower").addEventListener("click", () => pace(Math.max(0, Number($("pace").value) - 1)));
$("faster").addEventListener("click", () => pace(Math.min(paces.length - 1, Number($("pace").value) + 1)));
$("pause").addEventListener("click", () => send({ do: "pause", on: state !== "paused" }));
$("step").addEventListener("click", () => send({ do: "step", seconds: step }));
for (const name of TABS) {
  $(`${name}-tab`).addEventListener("click", () => openTab(name));
  $(`${name}-tab`).addEventListener("keydown", ({ key }) => {
    if (!["ArrowLeft", "ArrowRight"].includes(key)) return;
    const other = TABS.find((each) => each !== name); // there are two: either way leads to the other
    openTab(other);
    $(`${other}-tab`).focus();
  });
}
document.addEventListener("visibilitychange", watch);
dark.addEventListener("change", dress);

if (location.search) history.replaceState(null, "", location.pathname); // the cookie has the token now
dress();
connect();
