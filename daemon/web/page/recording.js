// The received cycles, ready to be drawn. For the charts a point of several cycles is two rows, its
// minimum and its maximum; for the path it is the last cycle of all axes, which belong together.
import { History } from "./history.js";

const kKept_s = 32;
const kQuantities = ["command", "measured", "predicted", "residual"];

export class Recording {
  constructor() {
    this.clear([]);
  }

  clear(axes) {
    this.axes = axes;
    this.charts = null;
    this.path = null;
    this.next = undefined;
    this.contour = [];
    this.measuredContour = [];
  }

  get now() {
    return this.charts?.last("time");
  }

  add(batch) {
    if (batch.axes.length !== this.axes.length) return;
    if (!this.charts) this.start(batch.point_s);
    const start = this.timeOf(batch);
    if (batch.after_gap && this.charts.length > 0) this.cut(start);
    this.next = start + batch.contour.length * batch.point_s;
    const several = batch.cycles_per_point > 1;
    for (let i = 0; i < batch.contour.length; ++i) {
      const time = start + i * batch.point_s;
      this.path.push([time, ...batch.axes.flatMap((a) => [a.command[i], a.measured[i], a.predicted[i]])]);
      if (!several) {
        this.charts.push([time, ...batch.axes.flatMap((a) => kQuantities.map((q) => a[q][i]))]);
        continue;
      }
      for (const [end, part] of [["_min", 0], ["_max", 0.5]])
        this.charts.push([time + part * batch.point_s, ...batch.axes.flatMap((a) => kQuantities.map((q) => a[q + end][i]))]);
    }
    if (batch.contour.some((value) => value !== null)) this.contour = batch.contour;
    if (batch.measured_contour.some((value) => value !== null)) this.measuredContour = batch.measured_contour;
  }

  start(point_s) {
    this.point_s = point_s;
    const points = Math.ceil(kKept_s / point_s);
    this.charts = new History(["time", ...this.axes.flatMap((a) => kQuantities.map((q) => `${a}.${q}`))], 2 * points);
    this.path = new History(
      ["time", ...this.axes.flatMap((a) => ["command", "measured", "predicted"].map((q) => `${a}.${q}`))],
      points,
    );
  }

  /** The time of a batch [s], always growing: cycles are counted; over a gap the time stamps decide. */
  timeOf(batch) {
    const stamp = batch.first_time_ns * 1e-9;
    if (this.next === undefined) this.offset = stamp;
    else if (!batch.after_gap) return this.next;
    const time = stamp - this.offset;
    if (this.next === undefined || (time > this.next && time < this.next + kKept_s)) return time;
    // The machine's clock was set: time continues 0.1 s later.
    this.offset = stamp - (this.next + 0.1);
    return this.next + 0.1;
  }

  /** Adds an empty row, so that no line is drawn across lost cycles. */
  cut(time) {
    const nothing = (history) => history.push([time - 1e-6, ...Array(history.names.length - 1).fill(null)]);
    nothing(this.charts);
    nothing(this.path);
  }
}
