// RMS and maximum of one axis over the last second, and the peak error since the last reset.
import { at, fill, make, write } from "./dom.js";
import { digits, error } from "./units.js";

export class Figures {
  constructor() {
    this.peaks = new Map(); // of every axis: {value, since}
    this.tiles = {};
    const tile = (key, name, ...more) => {
      const value = make("dd", {}, "–");
      const note = make("dd", {}, "");
      this.tiles[key] = { value, note };
      return make("div", { id: `figure-${key}` }, make("dt", {}, name), value, note, ...more);
    };
    const reset = make("button", { type: "button", "aria-label": "Forget the peak error" }, "Reset");
    reset.addEventListener("click", () => {
      this.peaks.clear();
      this.show(this.last, this.axis);
    });
    fill(at("figures"), tile("measured", "Tracking error, 1 s"), tile("residual", "Residual, 1 s"),
      tile("model", "Model in force"), tile("peak", "Peak error", reset));
  }

  /** Remembers the peaks of all axes, and shows one axis. */
  show(status, axis) {
    this.last = status;
    this.axis = axis;
    if (!status) return;
    if (!(status.silent_s > 1)) for (const one of status.axes) this.remember(one); // silent for longer: the figures are old
    const one = status.axes.find((candidate) => candidate.name === axis);
    if (!one) return;
    const { measured, residual } = one.last_second;
    this.set("measured", `${error(measured.rms_m, one.rotary)} RMS`, `max ${error(measured.max_m, one.rotary)}`);
    this.set("residual", residual.rms_m === null ? "no prediction" : `${error(residual.rms_m, one.rotary)} RMS`,
      residual.rms_m === null ? one.activity : `max ${error(residual.max_m, one.rotary)}, ${digits(measured.rms_m / residual.rms_m)}× smaller`);
    this.set("model", one.model_version > 0 ? `version ${one.model_version}` : "none yet",
      one.model_version > 0 ? `held-out RMS ${error(one.holdout_rms_m, one.rotary)}` : one.activity);
    const peak = this.peaks.get(axis);
    this.set("peak", peak ? error(peak.value, one.rotary) : "–", peak ? `since ${peak.since}` : "");
  }

  remember(axis) {
    const value = axis.last_second.measured.max_m;
    if (value === null) return;
    const peak = this.peaks.get(axis.name) ?? { value: 0, since: new Date().toLocaleTimeString("sv") };
    peak.value = Math.max(peak.value, value);
    this.peaks.set(axis.name, peak);
  }

  set(key, value, note) {
    write(this.tiles[key].value, value);
    write(this.tiles[key].note, note);
  }
}
