// Corrections of programs: whether they are sent to the drives, the predicted errors of each program, and the errors that
// were measured afterwards.
import { get, post } from "./api.js";
import { at, fill, make, write } from "./dom.js";
import { clock, error, words } from "./units.js";

const kKinds = {
  correction_learned: ["learned", "good"],
  correction_used: ["used", "good"],
  correction_kept: ["kept", "good"],
  correction_withdrawn: ["withdrawn", "bad"],
  motion_repeats: ["recognised", "soft"],
  program_previewed: ["previewed", "soft"],
  program_received: ["received", "soft"],
  program_removed: ["removed", "soft"],
  program_refused: ["refused", "bad"],
  offsets_armed: ["armed", "warn"],
  offsets_disarmed: ["disarmed", "soft"],
};
const kRulings = { keep: "good", learn_anew: "warn", withdraw: "bad" };
const kHeads = ["When", "What", "Error of", "Without correction", "With correction", "Measured"];

export async function showCorrections() {
  showSending(await get("/api/v1/offsets"));
  const { events } = await get("/api/v1/events?most=1000");
  const rows = events.filter((event) => event.kind in kKinds).flatMap(rowsOf);
  if (rows.length === 0)
    rows.push(make("tr", {}, make("td", { colspan: kHeads.length }, "No program has been received yet: servotwin preview sends one, with --learn to have a correction learned.")));
  fill(at("programs"),
    make("thead", {}, make("tr", {}, ...kHeads.map((name, i) => make("th", { scope: "col", ...(i > 2 && { class: "number" }) }, name)))),
    make("tbody", {}, ...rows));
}

export function showSending({ live, armed }) {
  const [text, kind] = !live ? ["Dry run: by configuration nothing is sent to the drives; predicted and measured errors are compared all the same.", "soft"]
    : armed ? ["Armed: offsets go to the drives, beginning with the next run of a known program.", "warn"]
    : ["Not armed: nothing goes to the drives until a person arms it.", "good"];
  fill(at("sending"), make("span", { class: `tag ${kind}` }, !live ? "dry run" : armed ? "armed" : "not armed"), ` ${text}`);
  at("arm").hidden = !live;
}

/** The rows of an event: one with its text, and one for every axis and path with figures. */
function rowsOf({ time, kind, text, detail }) {
  // A run that ended before its correction was fully faded in has no figures.
  const figures = detail?.cycles === 0 ? [] : figuresOf(detail ?? {});
  const [what, tag] = detail?.ruling in kRulings ? [words(detail.ruling), kRulings[detail.ruling]] : kKinds[kind];
  const lines = [
    make("tr", {}, make("td", { colspan: kHeads.length - 2 }, text)),
    ...figures.map(({ name, rotary, before, after, measured }) => make("tr", {}, make("td", {}, name),
      ...[before, after, measured].map((value) => make("td", { class: "number" }, error(value, rotary))))),
  ];
  lines[0].prepend(make("td", { rowspan: lines.length }, clock(time)),
    make("td", { rowspan: lines.length }, make("span", { class: `tag ${tag}` }, what), detail?.live === false ? " dry run" : ""));
  return lines;
}

/** The RMS figures of every axis and of the path. */
function figuresOf({ axes = [], contour, contour_before_rms_m, contour_after_rms_m }) {
  const figure = (name, one) => {
    const rotary = "before_rms_rad" in one;
    const value = (key) => one[`${key}_rms_${rotary ? "rad" : "m"}`];
    return { name, rotary, before: value("before"), after: value("after"), measured: value("measured") };
  };
  const path = contour ?? (contour_before_rms_m === undefined ? undefined : { before_rms_m: contour_before_rms_m, after_rms_m: contour_after_rms_m });
  return [...axes.map((one) => figure(`axis ${one.axis}`, one)), ...(path ? [figure("path", path)] : [])];
}

export function startArming() {
  for (const [id, done] of [["arm", "Armed."], ["disarm", "Disarmed."]]) {
    at(`do-${id}`).addEventListener("click", async () => {
      try {
        showSending(await post(`/api/v1/offsets/${id}`, at("arm-token").value));
        write(at("arm-said"), done);
      } catch (problem) {
        write(at("arm-said"), `Not done: ${problem.message}`);
      }
    });
  }
}
