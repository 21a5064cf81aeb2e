// Command, errors and residual of one axis over the same seconds, on scales with units.
import uPlot from "/vendor/uplot/uPlot.esm.js";
import { at, fill, make, write } from "./dom.js";
import { SteadyLimit, roundUp } from "./scale.js";
import { colour } from "./theme.js";
import { commandScale, commandUnit, digits, errorUnit, kErrorScale } from "./units.js";

/** The charts and their series; lines differ in width and dashes, not only in colour. */
const kCharts = [
  { id: "chart-command", title: "Command", series: [["command", 1.5]], isCommand: true },
  { id: "chart-error", title: "Tracking error", series: [["measured", 4], ["predicted", 1.75, [7, 5]]] },
  { id: "chart-residual", title: "Residual, measured minus predicted", series: [["residual", 1.5]], isLast: true },
];

export class Charts {
  constructor(recording) {
    this.recording = recording;
    this.window_s = 10;
    this.plots = [];
    new ResizeObserver(() => this.resize()).observe(at("chart-error").parentElement);
    for (const { id } of kCharts) at(id).addEventListener("keydown", (event) => this.moveCursor(event));
  }

  /** Shows an axis; also called when the colours change. */
  show(axis, rotary) {
    this.axis = axis;
    this.rotary = rotary;
    for (const { plot } of this.plots) plot.destroy();
    this.plots = kCharts.map((chart) => this.make(chart));
    this.draw();
  }

  make(chart) {
    const figure = at(chart.id);
    const unit = chart.isCommand ? commandUnit(this.rotary) : errorUnit(this.rotary);
    const scale = chart.isCommand ? commandScale(this.rotary) : kErrorScale;
    const title = make("figcaption", { class: "title" }, make("b", {}, `${chart.title} [${unit}]`),
      ...chart.series.map(([name]) => make("span", { class: `swatch ${name}` }, name)));
    const place = make("div", { class: "plot" });
    fill(figure, title, place);
    const one = { chart, figure, place, unit, scale, limit: new SteadyLimit(), range: [-1, 1] };
    const axis = { stroke: colour("text"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1 }, font: "12px system-ui, sans-serif" };
    one.plot = new uPlot(
      {
        ...size(place),
        padding: [8, 14, 0, 0], // on the right, room for half of the label "0 s"
        legend: { show: false },
        cursor: { sync: { key: "live" }, drag: { x: false, y: false }, points: { show: false } },
        scales: { x: { time: false, range: () => [this.now - this.window_s, this.now] }, y: { range: () => one.range } },
        axes: [
          { ...axis, size: chart.isLast ? 26 : 8, splits: () => this.ticks(), values: (_, ticks) => ticks.map((t) => (chart.isLast ? this.ago(t) : "")) },
          { ...axis, size: 66, ...(chart.isCommand ? {} : { splits: () => quarters(one.range) }), values: (_, ticks) => ticks.map((t) => `${+t.toPrecision(6)}`.replace("-", "−")) },
        ],
        series: [{}, ...chart.series.map(([name, width, dash]) => ({ label: name, stroke: colour(name), width, dash, points: { show: false } }))],
        hooks: { setCursor: [(plot) => this.read(plot)] },
      },
      [[], ...chart.series.map(() => [])],
      place,
    );
    return one;
  }

  get now() {
    return this.recording.now ?? 0;
  }

  ticks() {
    return [0, 1, 2, 3, 4, 5].map((i) => this.now - this.window_s + (i * this.window_s) / 5);
  }

  /** A time relative to now, as text. */
  ago(time) {
    return `${Math.abs(time - this.now) < 1e-9 ? "" : "−"}${+Math.abs(time - this.now).toFixed(1)} s`;
  }

  draw() {
    const columns = this.recording.charts;
    if (!columns || this.axis === undefined) return;
    const row = columns.rowAt(this.now - this.window_s);
    const times = columns.from(row, "time");
    for (const one of this.plots) {
      const data = one.chart.series.map(([name]) =>
        columns.from(row, `${this.axis}.${name}`).map((value) => (value === null ? null : value * one.scale)));
      one.range = one.chart.isCommand ? spanOf(data[0]) : symmetric(data, one.limit, this.now);
      one.plot.setData([times, ...data]);
      this.describe(one, data);
    }
  }

  /** Describes the chart in words, for screen readers. */
  describe(one, data) {
    const parts = one.chart.series.map(([name], i) => `${name} ${digits(data[i].findLast((value) => value !== null))} ${one.unit}`);
    one.figure.setAttribute("aria-label", `${one.chart.title} of axis ${this.axis}, last ${this.window_s} s: now ${parts.join(", ")}. Arrow keys read single values.`);
    one.figure.setAttribute("role", "img");
  }

  read(plot) {
    const i = plot.cursor.idx;
    if (i === null || i === undefined || this.plots.length < kCharts.length || this.plots.some((one) => !one.plot)) return;
    const time = plot.data[0][i];
    if (time === undefined) return;
    const values = this.plots.flatMap((one) => one.chart.series.map(([name], s) => `${name} ${digits(one.plot.data[s + 1][i])} ${one.unit}`));
    write(at("readout"), `${(time - this.now).toFixed(3).replace("-", "−")} s: ${values.join(", ")}`);
  }

  moveCursor(event) {
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const plot = this.plots.find((one) => one.figure === event.currentTarget)?.plot;
    if (!way || !plot) return;
    event.preventDefault();
    const width = plot.over.clientWidth;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : width;
    at("readout").setAttribute("aria-live", "polite");
    plot.setCursor({ left: Math.min(width, Math.max(0, left + way * (event.shiftKey ? 20 : 2))), top: 10 });
  }

  resize() {
    for (const { plot, place } of this.plots) plot.setSize(size(place));
  }
}

const size = (place) => ({ width: Math.max(200, place.clientWidth), height: Math.max(80, place.clientHeight) });

const quarters = ([low, high]) => [low, low / 2, 0, high / 2, high];

function symmetric(data, limit, now) {
  let needed = 0;
  for (const values of data) for (const value of values) if (value !== null) needed = Math.max(needed, Math.abs(value));
  const most = limit.of(1.05 * needed, now);
  return [-most, most];
}

/** Round limits around the values. */
function spanOf(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value === null) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [-1, 1];
  const step = roundUp(Math.max(high - low, 0.01) / 4);
  return [Math.floor(low / step - 0.1) * step, Math.ceil(high / step + 0.1) * step];
}
