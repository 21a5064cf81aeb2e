// The last diagnosis of an axis: verdict, causes with their confidence and what to check, and the report.
import { get, post } from "./api.js";
import { at, fill, make, write } from "./dom.js";
import { clock, error, percent, quantity, words } from "./units.js";

const kVerdicts = {
  explained: "Explained: the causes of the residual are named below.",
  nothing_significant: "Nothing significant: the remaining residual is at the noise floor.",
  unexplained: "Unexplained: there is a residual that no cause in the catalogue explains.",
};

export async function showDiagnosis(axis, rotary) {
  const { diagnoses } = await get(`/api/v1/diagnoses/${encodeURIComponent(axis)}?most=1`);
  at("report-panel").hidden = diagnoses.length === 0;
  fill(at("causes"));
  fill(at("doubt"));
  if (diagnoses.length === 0) {
    fill(at("verdict"), "No diagnosis has been made yet. One is due as soon as the axis has moved long enough.");
    at("report").removeAttribute("src");
    return;
  }
  const [{ time, reason, diagnosis }] = diagnoses;
  const { baseline, extended, causes } = diagnosis;
  const floor = baseline.noise_floor_interval_m;
  fill(at("verdict"), make("b", {}, kVerdicts[diagnosis.verdict] ?? diagnosis.verdict),
    make("p", {}, `The residual of the simulation is ${error(baseline.rms_m, rotary)} RMS on held-out motion` +
      (causes.length > 0 ? `, and ${error(extended.rms_m, rotary)} with the causes named below` : "") +
      `; the noise floor is ${error(baseline.noise_floor_rms_m, rotary)}` +
      (floor ? ` (${error(floor[0], rotary)} to ${error(floor[1], rotary)}).` : ".")),
    make("p", {}, `${clock(time)}, ${reason}`));
  fill(at("causes"), ...causes.map((cause) => causeItem(cause, rotary)));
  fill(at("doubt"), ...doubts(diagnosis));
  showReport(axis, time);
}

/** Suspected causes, causes that this motion does not make observable, and the test that would. */
function doubts({ suspected = [], not_observable: hidden = [], suggested_test: test }) {
  const part = (title, list) => list.length === 0 ? [] : [make("h3", {}, title), make("ul", {}, ...list.map((line) => make("li", {}, line)))];
  return [
    ...part("Suspected, with too little confidence to be named", suspected.map((one) =>
      [`${words(one.id)}, confidence ${percent(one.confidence)}`, ...one.ambiguous_with.map(words)].join(", or "))),
    ...part("Not observable here", hidden.map((one) => `${words(one.id)}: ${one.why}`)),
    ...(test ? [make("h3", {}, "Suggested test"), make("p", {}, test)] : []),
  ];
}

function causeItem(cause, rotary) {
  const { gain } = cause;
  const facts = [];
  const fact = (name, ...value) => facts.push(make("dt", {}, name), make("dd", {}, ...value));
  fact("confidence", make("meter", { min: "0", max: "1", value: String(cause.confidence), "aria-hidden": "true" }), ` ${percent(cause.confidence)}`);
  const sizes = Object.entries(cause.parameters).filter(([, value]) => value !== null).map(([name, value]) => quantity(name, value));
  if (sizes.length > 0) fact("size", sizes.join(", "));
  if (gain.holdout_rms_before_m !== null)
    fact("residual", `${error(gain.holdout_rms_before_m, rotary)} without it, ${error(gain.holdout_rms_after_m, rotary)} with it`);
  if (cause.check) fact("check", cause.check);
  if (cause.page) fact("see", cause.page);
  if (cause.ambiguous_with.length > 0) fact("ambiguous with", cause.ambiguous_with.map(words).join(", "));
  return make("li", {}, make("h3", {}, words(cause.id)), make("dl", {}, ...facts));
}

/** Gives the frame the height of the report, so that only the page has a scroll bar. */
function showReport(axis, time) {
  const frame = at("report");
  const source = `/api/v1/report/${encodeURIComponent(axis)}?of=${encodeURIComponent(time)}`;
  if (frame.getAttribute("src") === source) return;
  frame.onload = () => {
    const page = frame.contentDocument;
    if (!page?.body) return;
    const fit = () => { frame.style.height = `${page.documentElement.scrollHeight + 8}px`; };
    new ResizeObserver(fit).observe(page.body);
    fit();
    colourReport();
  };
  frame.setAttribute("src", source);
}

/** Gives the report the theme of the page. */
export function colourReport() {
  const page = at("report").contentDocument;
  if (page?.documentElement) page.documentElement.style.colorScheme = document.documentElement.dataset.theme;
}

/** `axis()` returns the name of the axis shown. */
export function startAsking(axis) {
  at("ask-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const answer = await post(`/api/v1/diagnoses/${encodeURIComponent(axis())}`, at("token").value);
      write(at("asked"), `Asked: ${answer.text}.`);
    } catch (problem) {
      write(at("asked"), `Not asked: ${problem.message}`);
    }
  });
}
