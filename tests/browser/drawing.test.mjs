// What the page draws: the geometry of the path against closed forms, scales, breaks.
import assert from "node:assert/strict";
import { test } from "node:test";

const page = process.env.SERVOTWIN_PAGE;
const { Deviations, figures, nearestOnSegment } = await import(`${page}/contour.js`);
const { History } = await import(`${page}/history.js`);
const { Recording } = await import(`${page}/recording.js`);
const { SteadyLimit, roundUp } = await import(`${page}/scale.js`);

/** A circle of radius `r`, cut by axes that lag it by an angle and run on a radius larger by `wide`. */
function circle({ r, wide, lag, rows, step = 0.01 }) {
  const names = ["time", ...["X", "Y"].flatMap((a) => [`${a}.command`, `${a}.measured`])];
  const history = new History(names, 10_000);
  for (let k = 0; k < rows; ++k) {
    const command = [r * Math.cos(k * step), r * Math.sin(k * step)];
    const actual = [(r + wide) * Math.cos(k * step - lag), (r + wide) * Math.sin(k * step - lag)];
    history.push([k * 1e-3, command[0], command[0] - actual[0], command[1], command[1] - actual[1]]);
  }
  return history;
}

test("the nearest point of a segment is its foot, or an end", () => {
  assert.deepEqual(nearestOnSegment(1, 1, 0, 0, 4, 0), { x: 1, y: 0, share: 0.25, distance: 1 });
  assert.deepEqual(nearestOnSegment(-3, 4, 0, 0, 4, 0), { x: 0, y: 0, share: 0, distance: 5 });
  assert.deepEqual(nearestOnSegment(3, 4, 0, 0, 0, 0), { x: 0, y: 0, share: 0, distance: 5 });
});

test("on a circle the deviation is the radius' difference, however far the axes lag along it", () => {
  const r = 0.025;
  const wide = 4e-6;
  for (const lag of [0, 0.05, 0.4]) {
    const found = new Deviations(circle({ r, wide, lag, rows: 900 }), "X", "Y", "measured", { back: 100 }).from(0).slice(100);
    const sagitta = r * (1 - Math.cos(0.005)); // of the chords between commands
    for (const one of found) assert.ok(Math.abs(one.distance - wide) <= sagitta + 1e-12, `${one.distance}`);
    const { rms, max } = figures(found);
    assert.ok(Math.abs(rms - wide) < sagitta && Math.abs(max - wide) <= sagitta + 1e-12);
  }
});

test("where the path before is not known, the lag along it is no deviation", () => {
  const r = 0.025;
  const wide = 4e-6;
  const lag = 0.4; // 40 rows
  const sagitta = r * (1 - Math.cos(0.005));
  const gone = circle({ r, wide, lag, rows: 900 }); // and a gap in it
  for (let k = 400; k < 405; ++k) gone.columns["X.command"][k] = null;
  const found = new Deviations(gone, "X", "Y", "measured", { back: 100 }).from(0);
  const { max } = figures(found);
  assert.ok(max <= wide + sagitta + 1e-12, `${max}`);
  for (const [first, last, there] of [[0, 39, false], [41, 399, true], [405, 438, true], [440, 444, false], [446, 879, true]])
    for (let k = first; k <= last; ++k) assert.equal(found[k] !== null, there, `row ${k}`);
});

test("an axis that stands is off the path by what it is off", () => {
  const history = new History(["time", "X.command", "X.measured", "Y.command", "Y.measured"], 10_000);
  for (let k = 0; k < 500; ++k) history.push([k * 1e-3, 0.1, 3e-6, 0.2, -4e-6]);
  const found = new Deviations(history, "X", "Y", "measured", { back: 400 }).from(0);
  for (const one of found) assert.ok(Math.abs(one.distance - 5e-6) < 1e-12);
});

test("after a long rest it finds the path again", () => {
  const history = new History(["time", "X.command", "X.measured", "Y.command", "Y.measured"], 10_000);
  for (let k = 0; k < 2000; ++k) {
    const x = 1e-4 * (Math.min(k, 300) + Math.max(0, k - 1300)); // moves, rests for a second, moves on
    const lag = 2e-4 * (k <= 300 ? 1 : k <= 1300 ? Math.exp((300 - k) / 30) : 1 - Math.exp((1300 - k) / 30));
    history.push([k * 1e-3, x, lag, 0, -3e-6]);
  }
  const found = new Deviations(history, "X", "Y", "measured", { back: 400 }).from(500);
  for (const one of found) assert.ok(Math.abs(one.distance - 3e-6) < 1e-12, `${one.distance}`);
});

test("rows that have been forgotten do not move the others", () => {
  const long = circle({ r: 0.01, wide: 1e-6, lag: 0.1, rows: 900 });
  const short = circle({ r: 0.01, wide: 1e-6, lag: 0.1, rows: 0 });
  short.most = 200;
  const tracked = new Deviations(short, "X", "Y", "measured", { back: 60 });
  const names = short.names;
  for (let k = 0; k < 900; ++k) {
    short.push(names.map((name) => long.columns[name][k]));
    if (k % 37 === 0) tracked.from(0);
  }
  const all = new Deviations(long, "X", "Y", "measured", { back: 60 }).from(short.forgotten);
  const found = tracked.from(0);
  assert.equal(found.length, short.length - 20);
  for (const i of [100, 150, found.length - 1]) assert.ok(Math.abs(found[i].distance - all[i].distance) < 1e-15);
});

test("scales are round, grow at once and shrink late", () => {
  assert.equal(roundUp(0.021), 0.05);
  assert.equal(roundUp(5), 5);
  const limit = new SteadyLimit(3);
  assert.equal(limit.of(0.9, 0), 1);
  assert.equal(limit.of(4.4, 1), 5);
  assert.equal(limit.of(0.9, 2), 5);
  assert.equal(limit.of(0.9, 4.5), 1);
});

/** A batch of one axis, as the daemon sends it. */
function batch(first, values, { several = false, gap = false, time_s = first * 1e-3 } = {}) {
  const axis = {};
  for (const name of ["command", "measured", "predicted", "residual"]) {
    axis[name] = values;
    if (several) Object.assign(axis, { [`${name}_min`]: values.map((v) => v - 1), [`${name}_max`]: values.map((v) => v + 1) });
  }
  return { first_sequence: first, first_time_ns: time_s * 1e9, point_s: 1e-3, cycles_per_point: several ? 4 : 1, after_gap: gap, contour: values.map(() => null), measured_contour: values.map(() => null), axes: [axis] };
}

test("where a point is several cycles its least and greatest values are drawn", () => {
  const recording = new Recording();
  recording.clear(["X"]);
  recording.add(batch(0, [10, 20], { several: true, gap: true }));
  assert.deepEqual(recording.charts.columns["X.measured"], [9, 11, 19, 21]);
  assert.deepEqual(recording.path.columns["X.measured"], [10, 20]);
});

test("a gap is a break in the line, and time only grows", () => {
  const recording = new Recording();
  recording.clear(["X"]);
  recording.add(batch(0, [1, 2], { gap: true }));
  recording.add(batch(2, [3], { time_s: 0.0019 })); // a stamp that jitters
  recording.add(batch(500, [4], { gap: true }));
  recording.add(batch(0, [5], { gap: true, time_s: -9 })); // the machine's clock was set back
  assert.deepEqual(recording.charts.columns["X.command"], [1, 2, 3, null, 4, null, 5]);
  const { time } = recording.charts.columns;
  assert.ok(Math.abs(time[2] - 0.002) < 1e-12 && Math.abs(time[4] - 0.5) < 1e-6, String(time));
  time.slice(1).forEach((t, i) => assert.ok(t > time[i], String(time)));
});
