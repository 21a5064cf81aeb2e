// The page: passes the messages of the live stream to the views.
import { Charts } from "./charts.js";
import { showCorrections, showSending, startArming } from "./corrections.js";
import { colourReport, startAsking, showDiagnosis } from "./diagnosis.js";
import { at, fill, make, write } from "./dom.js";
import { Figures } from "./figures.js";
import { showActivity, showModels } from "./models.js";
import { PathPicture } from "./path.js";
import { Recording } from "./recording.js";
import { lastOfSource, showEvents, showService } from "./service.js";
import { Stream } from "./stream.js";
import { startTheme } from "./theme.js";
import { count } from "./units.js";

const kViews = ["live", "models", "diagnosis", "corrections", "service"];
const kPath_ms = 250; // the path is drawn less often than the charts: it costs more
const calm = matchMedia("(prefers-reduced-motion: reduce)");

const recording = new Recording();
const charts = new Charts(recording);
const path = new PathPicture(recording, () => path.draw());
const figures = new Figures();
let status = null;
let axis = null; // that is shown
let paused = false;
let drawn = false;
let pathDrawn_ms = 0;
let chartsDrawn_ms = 0;

const view = () => kViews.find((name) => `#${name}` === location.hash) ?? "live";
const axisNow = () => status?.axes.find((one) => one.name === axis);

function chooseAxis(name) {
  axis = name;
  const one = axisNow();
  for (const place of document.querySelectorAll(".axis-name")) place.textContent = name;
  charts.show(name, one.rotary);
  figures.show(status, name);
  refresh();
}

function offerAxes() {
  const names = status.axes.map((one) => one.name);
  if (names.join() === recording.axes.join()) return;
  recording.clear(names);
  fill(at("axes"), make("legend", {}, "Axis"), ...names.map((name) => {
    const input = make("input", { type: "radio", name: "axis", value: name });
    input.addEventListener("change", () => chooseAxis(name));
    return make("label", {}, input, make("span", {}, name));
  }));
  path.offer(status.axes);
  if (names.length === 0) return;
  const name = names.includes(axis) ? axis : names[0];
  at("axes").querySelector(`input[value="${CSS.escape(name)}"]`).checked = true;
  chooseAxis(name);
}

/** Fetches the data of the open view. */
async function refresh() {
  const one = axisNow();
  try {
    if (view() === "live" && waiting()) write(at("awaited"), (await lastOfSource()) ?? `waiting for machine '${status.machine}'`);
    if (view() === "models" && one) await showModels(axis, one.rotary);
    if (view() === "diagnosis" && one) await showDiagnosis(axis, one.rotary);
    if (view() === "corrections") await showCorrections();
    if (view() === "service") await showEvents();
  } catch (problem) {
    // A lost daemon is reported by the stream; the view keeps its content until the daemon is back.
    if (!(problem instanceof TypeError)) throw problem;
  }
}

function showView() {
  for (const name of kViews) at(name).hidden = name !== view();
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash === `#${view()}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  refresh();
  draw();
}

function draw() {
  if (drawn || paused || view() !== "live") return;
  drawn = true;
  requestAnimationFrame(() => {
    drawn = false;
    const now = performance.now();
    if (now - chartsDrawn_ms < (calm.matches ? 1000 : 0)) return;
    chartsDrawn_ms = now;
    charts.draw();
    if (now - pathDrawn_ms < kPath_ms) return;
    pathDrawn_ms = now;
    path.draw();
  });
}

const waiting = () => status?.state === "waiting" && !status.frames;

/** Plots of a machine that has not been heard would be empty boxes: words take their place. */
function showPanels() {
  const begun = waiting() && at("unheard").hidden;
  at("bar").hidden = status.axes.length === 0;
  at("unheard").hidden = !waiting();
  at("charts").hidden = at("plane").hidden = waiting();
  if (begun) refresh();
}

/** Shows the state in the header, and a fault in the banner. */
function showState(state, when = new Date()) {
  document.body.classList.toggle("stale", state !== "live");
  at("state").dataset.state = state;
  const words = {
    connecting: "connecting",
    live: `live, ${count(Math.round(status?.frame_rate_hz ?? 0))} Hz`,
    silent: waiting() ? "waiting for the machine" : "no cycles",
    lost: "no daemon",
  };
  write(at("state").querySelector("b"), words[state]);
  const since = when.toLocaleTimeString("sv");
  const banners = {
    silent: waiting() ? "The daemon is waiting for its machine." : `No cycles have been received from the machine since ${since}; the figures shown are old.`,
    lost: `No connection to the daemon since ${since}; the figures shown are old. Trying again.`,
  };
  at("banner").hidden = !(state in banners);
  if (state in banners) write(at("banner"), banners[state]);
}

const stream = new Stream({
  opened() {
    recording.clear([]);
    status = null;
  },
  live(batch) {
    recording.add(batch);
    draw();
  },
  status(now) {
    const version = status?.version ?? now.version;
    const known = status?.state;
    status = now;
    if (now.version !== version) location.reload();
    document.title = `${now.machine} – Servotwin`;
    write(at("machine"), now.machine);
    showPanels();
    offerAxes();
    figures.show(now, axis);
    const one = axisNow();
    if (one) showActivity(one);
    showService(now);
    showSending(now.offsets);
    if (stream.state === "live") write(at("state").querySelector("b"), `live, ${count(Math.round(now.frame_rate_hz))} Hz`);
    else if (known !== now.state) showState(stream.state, stream.since);
  },
  model: refresh,
  diagnosis: refresh,
  state: showState,
});

at("window").addEventListener("change", () => {
  charts.window_s = path.window_s = Number(at("window").value);
  charts.draw();
  path.draw();
});
at("pause").addEventListener("click", () => {
  paused = !paused;
  at("pause").setAttribute("aria-pressed", String(paused));
  write(at("pause"), paused ? "Resume" : "Pause");
  draw();
});
startAsking(() => axis);
startArming();
startTheme(() => {
  if (axisNow()) charts.show(axis, axisNow().rotary);
  path.draw();
  colourReport();
});
addEventListener("hashchange", showView);
setInterval(refresh, 10_000);
showView();
