// A table of numbers that keeps the newest rows; null where there is no number.

export class History {
  /** `names`: of the columns; the first one is the time [s], which only grows. */
  constructor(names, most) {
    this.names = names;
    this.most = most;
    this.clear();
  }

  clear() {
    this.forgotten = 0; // rows that have been dropped
    this.columns = Object.fromEntries(this.names.map((name) => [name, []]));
  }

  get length() {
    return this.columns[this.names[0]].length;
  }

  /** `row`: values in the order of the names. */
  push(row) {
    this.names.forEach((name, i) => this.columns[name].push(row[i]));
    if (this.length <= 2 * this.most) return;
    for (const name of this.names) this.columns[name].splice(0, this.most);
    this.forgotten += this.most;
  }

  last(name) {
    return this.columns[name].at(-1);
  }

  /** The first row at this time or later. */
  rowAt(time) {
    const times = this.columns[this.names[0]];
    let low = 0;
    let high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  from(row, name) {
    return this.columns[name].slice(row);
  }
}
