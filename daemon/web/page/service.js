// What was lost, how long things take, and what happened.
import { get } from "./api.js";
import { at, fill, make } from "./dom.js";
import { clock, count, span } from "./units.js";

const kLosses = [
  ["lost", "cycles that never came"],
  ["repeated", "frames that came twice"],
  ["malformed", "frames refused"],
  ["time_jumps", "jumps of the machine's time"],
  ["not_finite", "values that were no numbers"],
  ["overruns", "cycles that took too long"],
  ["predictions_dropped", "predictions not sent"],
  ["rows_dropped", "cycles not recorded"],
];

const kAlarms = {
  off: ["not watched", "soft"],
  learning: ["learns what is normal", "soft"],
  watching: ["as it should be", "good"],
  raised: ["the residual has grown", "bad"],
};

export function showService(status) {
  fill(at("losses"), make("tbody", {},
    make("tr", {}, make("th", { scope: "row" }, "cycles that came"), make("td", { class: "number" }, count(status.frames)), make("td", {}, "")),
    ...kLosses.map(([key, words]) =>
      make("tr", {}, make("th", { scope: "row" }, words), make("td", { class: "number" }, count(status[key])),
        make("td", {}, make("span", { class: status[key] > 0 ? "tag warn" : "good" }, status[key] > 0 ? "some" : "none"))))));
  const row = (words, ...spans) => make("tr", {}, make("th", { scope: "row" }, words), ...spans.map((value) => make("td", { class: "number" }, span(value))));
  fill(at("latency"),
    make("thead", {}, make("tr", {}, make("th", {}, ""), ...["half below", "99 % below", "longest"].map((name) => make("th", { scope: "col", class: "number" }, name)))),
    make("tbody", {}, row("frame sent to loop", status.wake_p50_s, status.wake_p99_s, null),
      row("work of the loop", status.work_p50_s, status.work_p99_s, status.work_max_s)));
  fill(at("alarms"), make("tbody", {}, ...status.axes.map((axis) => {
    const [words, kind] = kAlarms[axis.alarm];
    return make("tr", {}, make("th", { scope: "row" }, `axis ${axis.name}`), make("td", {}, make("span", { class: `tag ${kind}` }, words)));
  })));
}

export async function showEvents() {
  const { events } = await get("/api/v1/events?most=100");
  fill(at("events"), ...events.map((event) =>
    make("li", {}, make("time", { datetime: event.time }, clock(event.time)), make("b", {}, event.axis), make("span", {}, event.text))));
}
