// SI numbers for people. Errors are shown in micrometres or microradians whatever their size, so
// that two of them can be compared at a glance.

export const kErrorScale = 1e6;
export const errorUnit = (rotary) => (rotary ? "µrad" : "µm");
export const commandUnit = (rotary) => (rotary ? "°" : "mm");
export const commandScale = (rotary) => (rotary ? 180 / Math.PI : 1e3);

/** Three significant digits: "1489", "35.2", "0.0353"; "–" where there is no number. */
export function digits(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 100) return value.toFixed(0);
  return value.toPrecision(3).includes("e") ? value.toExponential(1) : value.toPrecision(3);
}

/** An error in µm or µrad. Less than half a nanometre is rounding and is shown as 0. */
export const error = (metres, rotary) => {
  const value = metres === null || metres === undefined ? metres : metres * kErrorScale;
  return value === null || value === undefined ? "–" : `${Math.abs(value) < 5e-4 ? "0" : digits(value)} ${errorUnit(rotary)}`;
};

/** A time span: "36.9 µs". */
export function span(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds < 1e-3) return `${digits(seconds * 1e6)} µs`;
  return seconds < 1 ? `${digits(seconds * 1e3)} ms` : `${digits(seconds)} s`;
}

export const count = (value) => (value ?? 0).toLocaleString("en").replaceAll(",", "\u202f");
export const percent = (share) => (share >= 0.995 && share < 1 ? "over 99 %" : `${Math.round(share * 100)} %`);
/** A time of the daemon as local time of the browser. */
export const clock = (iso) => new Date(iso).toLocaleString("sv");
// Parameters carry their unit at the end of their name.
const kUnits = { m: ["µm", 1e6], rad: ["µrad", 1e6], s: ["ms", 1e3], hz: ["Hz", 1], n: ["N", 1], nm: ["N m", 1], mps2: ["m/s²", 1] };

/** A parameter by its name: "width 4.10 µm"; without a unit in the name as it is, in SI. */
export function quantity(name, value) {
  const [, stem, unit] = name.match(/^(.*)_([a-z0-9]+)$/) ?? [];
  if (!(unit in kUnits)) return `${words(name)} ${+value.toPrecision(3)}`;
  const [symbol, scale] = kUnits[unit];
  return `${words(stem)} ${digits(scale * value)} ${symbol}`;
}

export const words = (id) => id.replaceAll("_", " ");
