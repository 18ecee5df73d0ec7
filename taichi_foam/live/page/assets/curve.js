// The deceleration over time: the drop that goes on, the last ones as thin lines, what was measured.
const NICE = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10];
const SOME = 5000; // between two descriptions in words, which are read out [ms]
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(Math.max(value, 1e-9)));
  return (NICE.find((n) => n * power >= value * (1 - 1e-9)) ?? 10) * power;
}

const most = ({ a }) => a.reduce((top, value) => Math.max(top, value ?? 0), 0); // [m/s2]

export class Curve {
  constructor(element) {
    this.element = element;
    this.t = []; // [ms]
    this.a = []; // [m/s2]
    this.drop = 0;
    this.others = [];
    this.measured = null;
    this.due = false;
    this.told = -Infinity; // when it was described last [ms]
    this.later = null; // the timer of the next description
    new ResizeObserver(() => this.paint()).observe(element);
  }

  begin({ drop, measured, falls }) {
    this.measured = measured;
    this.element.closest("section").hidden = !falls;
    if (drop !== this.drop) [this.drop, this.t, this.a, this.told] = [drop, [], [], -Infinity];
    this.paint();
  }

  // A part that replaces everything from a point on.
  add({ drop, from, t, a }) {
    if (drop !== this.drop) [this.drop, this.t, this.a] = [drop, [], []];
    this.t = this.t.slice(0, from).concat(t);
    this.a = this.a.slice(0, from).concat(a);
    this.paint();
  }

  former(curves) {
    this.others = curves;
    this.paint();
  }

  // Soon, and once for all that has changed until then.
  paint() {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => { this.due = false; this.plot(); this.describe(); });
  }

  // In words, for those who do not see; rarely, so that it can be read to its end.
  describe() {
    const early = this.told + SOME - performance.now();
    if (early > 0) {
      this.later ??= setTimeout(() => { this.later = null; this.describe(); }, early);
      return;
    }
    const known = this.a.findLastIndex((value) => value !== null);
    if (known < 0) return;
    this.told = performance.now();
    const m = this.measured;
    const words = [`Deceleration over time: ${this.a[known].toFixed(1)} m/s² at ${this.t[known].toFixed(1)} ms`,
      `at most ${most(this).toFixed(1)} m/s² so far`];
    if (m) words.push(`measured plateau ${m.plateau_deceleration_m_s2} m/s²`);
    this.element.setAttribute("aria-label", words.join(", "));
  }

  plot() {
    if (!window.Plotly || !this.element.clientWidth) return;
    const ink = css("--ink"), soft = css("--soft"), line = css("--line"), blue = css("--curve"), accent = css("--accent");
    const others = this.others.filter(({ drop }) => drop !== this.drop);
    const traces = others.map(({ drop, t, a }, n) => ({ x: t, y: a, name: `drop ${drop}`, mode: "lines",
      line: { width: 1, color: soft }, opacity: 0.75 - 0.1 * n, hovertemplate: `drop ${drop}: %{y:.1f} m/s² at %{x:.2f} ms<extra></extra>` }));
    traces.push({ x: this.t, y: this.a, name: "now", mode: "lines", line: { width: 2.2, color: blue },
      hovertemplate: "%{y:.1f} m/s² at %{x:.2f} ms<extra></extra>" });
    const m = this.measured;
    const all = [...others, this];
    const last = roundUp(Math.max(5, m ? 1e3 * m.impact_duration_s : 0, ...all.map(({ t }) => t.at(-1) ?? 0)));
    const top = roundUp(1.08 * Math.max(10, m ? m.plateau_deceleration_m_s2 : 0, ...all.map(most)));
    const least = ({ a }) => a.reduce((low, value) => Math.min(low, value ?? 0), 0); // in free fall it is -g
    const bottom = Math.min(-0.04 * top, 1.1 * Math.min(...all.map(least)));
    const axis = { color: soft, gridcolor: line, linecolor: line, zeroline: false, fixedrange: true, tickfont: { size: 11 } };
    const rule = (shape) => ({ type: "line", line: { color: accent, width: 1.2, dash: "dash" }, ...shape });
    const words = (text, place) => ({ text, showarrow: false, bgcolor: `${css("--card")}d0`, borderpad: 1, font: { size: 11, color: accent }, ...place });
    const layout = {
      margin: { l: 38, r: 10, t: 6, b: 26 }, height: this.element.clientHeight, width: this.element.clientWidth,
      paper_bgcolor: "transparent", plot_bgcolor: "transparent", showlegend: false, hovermode: "closest",
      font: { family: "system-ui, sans-serif", color: ink },
      xaxis: { ...axis, range: [0, last] }, yaxis: { ...axis, range: [bottom, top] },
      shapes: m ? [
        rule({ xref: "paper", x0: 0, x1: 1, y0: m.plateau_deceleration_m_s2, y1: m.plateau_deceleration_m_s2 }),
        rule({ yref: "paper", y0: 0, y1: 1, x0: 1e3 * m.impact_duration_s, x1: 1e3 * m.impact_duration_s }),
      ] : [],
      annotations: m ? [
        words(`measured plateau ${m.plateau_deceleration_m_s2}`, { xref: "paper", x: 0.995, xanchor: "right", y: m.plateau_deceleration_m_s2, yanchor: "bottom" }),
        words(`duration ${Math.round(1e3 * m.impact_duration_s)}`, { yref: "paper", y: 0.02, yanchor: "bottom", x: 1e3 * m.impact_duration_s, xanchor: "right" }),
      ] : [],
    };
    window.Plotly.react(this.element, traces, layout, { displayModeBar: false, responsive: false, doubleClick: false });
  }
}
