// The model versions of an axis with their reasons, the newest first.
import { get } from "./api.js";
import { at, fill, make, write } from "./dom.js";
import { clock, error, words } from "./units.js";

export async function showModels(axis, rotary) {
  const { versions } = await get(`/api/v1/models/${encodeURIComponent(axis)}`);
  const heads = ["Version", "In force since", "Residual on held-out motion", "Structure", "Reason"];
  const rows = versions.map((one, i) =>
    make("tr", i === 0 ? { class: "in-force" } : {},
      make("td", {}, `${one.version} `, i === 0 ? make("span", { class: "tag good" }, "in force") : ""),
      make("td", {}, clock(one.created)),
      make("td", {}, `${error(one.fit.holdout.rms_m, rotary)} RMS, ${error(one.fit.holdout.max_m, rotary)} max`),
      make("td", {}, `order ${one.loop.order}${one.effects.map((effect) => `, ${words(effect.id)}`).join("")}`),
      make("td", {}, one.reason)));
  if (rows.length === 0) rows.push(make("tr", {}, make("td", { colspan: heads.length }, "No model has come into force yet.")));
  fill(at("versions"), make("thead", {}, make("tr", {}, ...heads.map((name) => make("th", { scope: "col" }, name)))), make("tbody", {}, ...rows));
}

export function showActivity(axis) {
  const refused = axis.refused > 0 ? ` ${axis.refused} candidates refused, last: ${axis.last_refusal}` : "";
  write(at("activity"), `Now: ${axis.activity || "nothing"}.${refused}`);
}
