// Limits of a scale: a round number times a power of ten. They grow at once, and shrink only after
// much less was needed for some seconds.

/** The smallest of the round numbers ..1, 2, 5, 10.. (or of other steps) that is not less than `value`. */
export function roundUp(value, steps = [1, 2, 5, 10]) {
  if (!(value > 0)) return 1e-3;
  const power = 10 ** Math.floor(Math.log10(value));
  return steps.map((step) => step * power).find((limit) => limit >= value * (1 - 1e-9));
}

export class SteadyLimit {
  constructor(patience_s = 3) {
    this.patience_s = patience_s;
    this.limit = 0;
    this.neededSince = 0;
  }

  /** The limit for what is needed now; `now` in seconds. */
  of(needed, now) {
    const wanted = roundUp(needed, [1, 1.5, 2, 3, 5, 7, 10]);
    if (wanted >= this.limit || now < this.neededSince) {
      this.limit = wanted;
      this.neededSince = now;
    } else if (needed > 0.35 * this.limit) {
      this.neededSince = now;
    } else if (now - this.neededSince > this.patience_s) {
      this.limit = wanted;
      this.neededSince = now;
    }
    return this.limit;
  }
}
