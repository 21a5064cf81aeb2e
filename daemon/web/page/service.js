// Losses, latencies, alarms and events.
import { get } from "./api.js";
import { at, fill, make, write } from "./dom.js";
import { clock, count, span } from "./units.js";

const kLosses = [
  ["lost", "cycles lost"],
  ["repeated", "frames received twice"],
  ["malformed", "frames refused"],
  ["time_jumps", "jumps of the time stamps"],
  ["not_finite", "values that are not finite"],
  ["overruns", "cycles with too much work"],
  ["predictions_dropped", "predictions not sent"],
  ["rows_dropped", "cycles not recorded"],
];

/** Counters of a bus that should be 0. */
const kBusLosses = [
  ["missing", "messages missing"],
  ["late", "messages late"],
  ["dropped", "frames dropped by the kernel"],
  ["packets_lost", "packets lost"],
  ["error_frames", "error frames"],
  ["unexpected", "frames not in the mapping"],
  ["downs", "times down or removed"],
];

const kAlarms = {
  off: ["off", "soft"],
  learning: ["learning the normal residual", "soft"],
  watching: ["residual is normal", "good"],
  raised: ["the residual has grown", "bad"],
};

/** Of two joined sources: cycles for which the second had nothing, and how its clock goes. */
function clockRows(clocks) {
  if (!clocks) return [];
  const row = (words, value, shown) => make("tr", {}, make("th", { scope: "row" }, words), make("td", { class: "number" }, value), make("td", {}, shown));
  return [
    row("cycles without the second source", count(clocks.absent), make("span", { class: clocks.absent > 0 ? "tag warn" : "good" }, clocks.absent > 0 ? "some" : "none")),
    row("clock of the second source", clocks.known ? `${span(Math.abs(clocks.ahead_s))} ${clocks.ahead_s < 0 ? "behind" : "ahead"}` : "not known yet",
      clocks.known ? `${clocks.drift_ppm.toFixed(1)} us a second` : ""),
  ];
}

export function showService(status) {
  fill(at("losses"), make("tbody", {},
    make("tr", {}, make("th", { scope: "row" }, "cycles received"), make("td", { class: "number" }, count(status.frames)), make("td", {}, "")),
    ...kLosses.map(([key, words]) =>
      make("tr", {}, make("th", { scope: "row" }, words), make("td", { class: "number" }, count(status[key])),
        make("td", {}, make("span", { class: status[key] > 0 ? "tag warn" : "good" }, status[key] > 0 ? "some" : "none")))),
    ...clockRows(status.clocks)));
  write(at("not-recording"), status.not_recording);
  showBuses(status.buses);
  const row = (words, ...spans) => make("tr", {}, make("th", { scope: "row" }, words), ...spans.map((value) => make("td", { class: "number" }, span(value))));
  fill(at("latency"),
    make("thead", {}, make("tr", {}, make("th", {}, "quantile"), ...["50 %", "99 %", "99.9 %", "maximum"].map((name) => make("th", { scope: "col", class: "number" }, name)))),
    make("tbody", {}, row("frame sent to loop", status.wake_p50_s, status.wake_p99_s, null, null),
      row("work of the loop", status.work_p50_s, status.work_p99_s, null, status.work_max_s),
      row("frame to prediction sent", status.publish_p50_s, status.publish_p99_s, status.publish_p999_s, status.publish_max_s)));
  showOctaves(status.publish_octaves ?? []);
  fill(at("alarms"), make("tbody", {}, ...status.axes.map((axis) => {
    const [words, kind] = kAlarms[axis.alarm];
    return make("tr", {}, make("th", { scope: "row" }, `axis ${axis.name}`), make("td", {}, make("span", { class: `tag ${kind}` }, words)));
  })));
}

/** A column per bus. */
function showBuses(buses) {
  at("buses-part").hidden = buses.length === 0;
  const number = (value, bad) => make("td", { class: bad ? "number warn" : "number" }, count(value));
  fill(at("buses"),
    make("thead", {}, make("tr", {}, make("th", {}, ""), ...buses.map((bus) => make("th", { scope: "col", class: "number" }, bus.name)))),
    make("tbody", {},
      make("tr", {}, make("th", { scope: "row" }, "interface"), ...buses.map((bus) =>
        make("td", { class: "number" }, make("span", { class: `tag ${bus.up ? "good" : "bad"}` }, bus.up ? "up" : "down")))),
      make("tr", {}, make("th", { scope: "row" }, "frames received"), ...buses.map((bus) => number(bus.frames, false))),
      ...kBusLosses.map(([key, words]) =>
        make("tr", {}, make("th", { scope: "row" }, words), ...buses.map((bus) => number(bus[key], bus[key] > 0))))));
}

/** A histogram with logarithmic bars, so that rare long times remain visible. */
function showOctaves(octaves) {
  at("octaves-part").hidden = octaves.length === 0;
  const most = Math.max(1, ...octaves.map((one) => one.count));
  fill(at("octaves"), make("tbody", {}, ...octaves.map((one, i) => {
    const words = one.below_s === null ? `${span(octaves[i - 1]?.below_s)} and more` : `below ${span(one.below_s)}`;
    const bar = Math.log(1 + one.count) / Math.log(1 + most);
    return make("tr", {}, make("th", { scope: "row" }, words),
      make("td", {}, make("meter", { min: "0", max: "1", value: String(bar), "aria-hidden": "true" })),
      make("td", { class: "number" }, count(one.count)));
  })));
}

/** What the daemon has said last about its source since it was started: where it waits, what it has refused. */
export async function lastOfSource() {
  const { events } = await get("/api/v1/events?most=100");
  const started = events.findIndex((event) => event.kind === "started");
  return events.slice(0, started).find((event) => event.kind === "source")?.text;
}

export async function showEvents() {
  const { events } = await get("/api/v1/events?most=100");
  fill(at("events"), ...events.map((event) =>
    make("li", {}, make("time", { datetime: event.time }, clock(event.time)), make("b", {}, event.axis), make("span", {}, event.text))));
}
