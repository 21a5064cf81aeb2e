// Contour error of two axes: the distance from every measured point to the nearest point of the
// commanded path.

/** The nearest point to (px, py) on the segment from (ax, ay) to (bx, by), and which share of it lies before. */
export function nearestOnSegment(px, py, ax, ay, bx, by) {
  const dx = bx - ax;
  const dy = by - ay;
  const square = dx * dx + dy * dy;
  const share = square > 0 ? Math.min(1, Math.max(0, ((px - ax) * dx + (py - ay) * dy) / square)) : 0;
  const x = ax + share * dx;
  const y = ay + share * dy;
  return { x, y, share, distance: Math.hypot(px - x, py - y) };
}

/**
 * The nearest point to (pu, pv) of the path through us[j], vs[j], of the segments that end at `first`
 * to `last`; null marks a gap. {u, v, du, dv, distance}: the nearest point and the vector from it. Null
 * where the nearest point is an end of the known path: the true nearest point may lie beyond it, and the
 * distance to an end is mostly lag.
 */
export function nearestOnPath(pu, pv, us, vs, first, last) {
  const known = (j) => j >= Math.max(1, first) && j <= last && us[j] !== null && us[j - 1] !== null && vs[j] !== null && vs[j - 1] !== null;
  let best = null;
  for (let j = Math.max(1, first); j <= last; ++j) {
    if (!known(j)) continue;
    const near = nearestOnSegment(pu, pv, us[j - 1], vs[j - 1], us[j], vs[j]);
    if (best === null || near.distance <= best.distance) best = { ...near, j };
  }
  if (best === null || (best.share === 0 && !known(best.j - 1)) || (best.share === 1 && !known(best.j + 1))) return null;
  return { u: best.x, v: best.y, du: pu - best.x, dv: pv - best.y, distance: best.distance };
}

/**
 * Deviations from the path, row by row of a History, each computed once. `quantity`: the error that is
 * subtracted from the command to get the position. The path of a row is the commands from `back` rows
 * before it to `ahead` rows after it.
 */
export class Deviations {
  constructor(history, u, v, quantity, { back, ahead = 20 }) {
    Object.assign(this, { history, u, v, quantity, back, ahead });
    this.first = history.forgotten; // row of found[0], counted from the start
    this.found = [];
  }

  /** Of the rows from this one on; the newest `ahead` rows have to wait. */
  from(row) {
    const { history, ahead } = this;
    const column = (axis, name) => history.columns[`${axis}.${name}`];
    const us = column(this.u, "command");
    const vs = column(this.v, "command");
    const eu = column(this.u, this.quantity);
    const ev = column(this.v, this.quantity);
    if (this.first + this.found.length < history.forgotten) {
      this.first = history.forgotten;
      this.found = [];
    }
    for (let k = this.first + this.found.length - history.forgotten; k < history.length - ahead; ++k) {
      const there = us[k] !== null && vs[k] !== null && eu[k] !== null && ev[k] !== null;
      this.found.push(there ? nearestOnPath(us[k] - eu[k], vs[k] - ev[k], us, vs, k - this.back, k + ahead) : null);
    }
    if (history.forgotten > this.first) {
      this.found.splice(0, history.forgotten - this.first);
      this.first = history.forgotten;
    }
    return this.found.slice(row);
  }
}

/** {rms, max} of the distances that are not null; null if there are none. */
export function figures(distances) {
  let squares = 0;
  let max = 0;
  let count = 0;
  for (const one of distances) {
    if (one === null) continue;
    squares += one.distance ** 2;
    max = Math.max(max, one.distance);
    ++count;
  }
  return count === 0 ? null : { rms: Math.sqrt(squares / count), max };
}
