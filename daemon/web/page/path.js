// The path of two axes in their plane. The deviation perpendicular to the commanded path is drawn
// magnified; the deviation along the path is left out.
import { Deviations, figures } from "./contour.js";
import { at, fill, make, write } from "./dom.js";
import { roundUp } from "./scale.js";
import { colour } from "./theme.js";
import { digits, error } from "./units.js";

const kShare = 0.06; // share of the picture that the largest deviation takes with the automatic factor
const kBack_s = 0.4; // how far the axes may lag

export class PathPicture {
  constructor(recording, changed) {
    this.recording = recording;
    this.window_s = 10;
    this.factor = 0;
    this.canvas = at("path").querySelector("canvas");
    for (const id of ["path-u", "path-v"]) at(id).addEventListener("change", changed);
    at("path-factor").addEventListener("change", changed);
    new ResizeObserver(() => this.draw()).observe(at("path"));
  }

  /** `axes`: [{name, rotary}]. */
  offer(axes) {
    this.linear = axes.filter((axis) => !axis.rotary).map((axis) => axis.name);
    for (const [id, which] of [["path-u", 0], ["path-v", 1]]) {
      fill(at(id), ...this.linear.map((name) => make("option", { value: name }, name)));
      at(id).selectedIndex = Math.min(which, this.linear.length - 1);
      at(id).disabled = this.linear.length < 2;
    }
  }

  draw() {
    const columns = this.recording.path;
    const u = at("path-u").value;
    const v = at("path-v").value;
    const context = this.prepare();
    if (!this.linear) return; // no machine is known
    if (this.linear.length < 2 || u === v) {
      this.say(context, this.linear.length < 2 ? "A path needs two linear axes." : "Choose two axes that differ.");
      fill(at("contour"));
      return;
    }
    if (!columns || columns.length < 2) return;
    const row = columns.rowAt(columns.last("time") - this.window_s);
    const command = { u: columns.from(row, `${u}.command`), v: columns.from(row, `${v}.command`) };
    if (this.tracked !== columns || this.u !== u || this.v !== v) this.track(columns, u, v);
    const measured = this.measured.from(row);
    const predicted = this.predicted.from(row);
    this.paint(context, command, measured, predicted);
    this.tell(measured, predicted);
  }

  track(columns, u, v) {
    Object.assign(this, { tracked: columns, u, v });
    const options = { back: Math.ceil(kBack_s / this.recording.point_s) };
    this.measured = new Deviations(columns, u, v, "measured", options);
    this.predicted = new Deviations(columns, u, v, "predicted", options);
  }

  prepare() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = devicePixelRatio;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    context.font = "12px system-ui, sans-serif";
    context.fillStyle = colour("text");
    return context;
  }

  say(context, words) {
    context.fillText(words, 12, 24);
    this.canvas.setAttribute("aria-label", words);
  }

  paint(context, command, measured, predicted) {
    const width = this.canvas.clientWidth;
    const height = this.canvas.clientHeight;
    const [lowU, highU] = extent(command.u);
    const [lowV, highV] = extent(command.v);
    if (lowU > highU || lowV > highV) return;
    const margin = 34;
    const reach = Math.max(highU - lowU, highV - lowV, 1e-5);
    const scale = Math.min((width - 2 * margin) / Math.max(highU - lowU, 0.2 * reach), (height - 2 * margin - 18) / Math.max(highV - lowV, 0.2 * reach));
    const x = (value) => width / 2 + scale * (value - (lowU + highU) / 2);
    const y = (value) => (height - 18) / 2 - scale * (value - (lowV + highV) / 2);
    const factor = this.factorFor(measured, (kShare * Math.min(width, height)) / scale);

    line(context, command.u.map((value, i) => (value === null || command.v[i] === null ? null : [x(value), y(command.v[i])])), colour("command"), 1, []);
    const aside = (list) => list.map((one) => (one === null ? null : [x(one.u + factor * one.du), y(one.v + factor * one.dv)]));
    line(context, aside(measured), colour("measured"), 3.5, []);
    line(context, aside(predicted), colour("predicted"), 1.75, [7, 5]);
    const tip = aside(measured).at(-1);
    if (tip) {
      context.fillStyle = colour("measured");
      context.beginPath();
      context.arc(...tip, 5, 0, 2 * Math.PI);
      context.fill();
    }
    this.scaleBar(context, 12, height - 8, "path", scale, 1e3, "mm", width / 4);
    this.scaleBar(context, width / 2, height - 8, `deviation ×${factor}`, scale * factor, 1e6, "µm", width / 4);
    const rms = figures(measured);
    this.canvas.setAttribute("aria-label", `Path in the plane, deviation magnified ${factor} times; ${rms ? `largest ${error(rms.max)}` : "nothing measured"}`);
  }

  factorFor(measured, room) {
    const chosen = Number(at("path-factor").value);
    if (chosen > 0) return chosen;
    const most = figures(measured)?.max ?? 0;
    // Keeps the factor while it fits, so that the picture does not jump.
    const fits = (factor) => factor * most <= 1.6 * room && factor * most >= 0.3 * room;
    if (!(most > 0)) return this.factor || 1;
    if (!this.factor || !fits(this.factor)) this.factor = Math.max(1, roundUp(room / most / 2.5));
    return this.factor;
  }

  scaleBar(context, left, bottom, words, pixelsPerMetre, perMetre, unit, most) {
    let length = roundUp((most / pixelsPerMetre) * perMetre);
    while ((length / perMetre) * pixelsPerMetre > most) length = roundUp(length / 2.5);
    const pixels = (length / perMetre) * pixelsPerMetre;
    context.strokeStyle = context.fillStyle = colour("text");
    context.lineWidth = 2;
    context.setLineDash([]);
    context.beginPath();
    context.moveTo(left, bottom - 4);
    context.lineTo(left, bottom);
    context.lineTo(left + pixels, bottom);
    context.lineTo(left + pixels, bottom - 4);
    context.stroke();
    context.fillText(`${words}: ${digits(length)} ${unit}`, left, bottom - 8);
  }

  tell(measured, predicted) {
    const last = (series) => {
      const live = series.filter((value) => value !== null);
      return live.length > 0 ? error(live.at(-1)) : null;
    };
    const foreseen = last(this.recording.contour);
    const now = last(this.recording.measuredContour) ?? "–";
    const pair = (name, found) => make("div", {}, make("dt", {}, name), make("dd", {}, found ? `${error(found.rms)} RMS, max ${error(found.max)}` : "–"));
    write(at("contour-title"), `Contour error, ${this.window_s} s`);
    fill(at("contour"),
      pair("measured", figures(measured)),
      pair("predicted axes", figures(predicted)),
      make("div", {}, make("dt", {}, "by the daemon"), make("dd", {}, foreseen ? `${foreseen} predicted, ${now} measured` : `no prediction yet; measured ${now}`)));
  }
}

function extent(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value === null) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return [low, high];
}

function line(context, points, stroke, width, dash) {
  context.strokeStyle = stroke;
  context.lineWidth = width;
  context.lineJoin = "round";
  context.setLineDash(dash);
  context.beginPath();
  let down = false;
  for (const point of points) {
    if (point === null) {
      down = false;
    } else if (down) {
      context.lineTo(...point);
    } else {
      context.moveTo(...point);
      down = true;
    }
  }
  context.stroke();
}
