// The live stream of the daemon: opens it, detects silence, and reconnects.
//
// States: connecting, live, silent (connected, but no cycles), lost (no connection).

const kSilent_ms = 2000; // cycles come twenty times a second
const kDead_ms = 6000; // a status comes every second: without one the connection is dead
const kRetry_ms = 1500;

export class Stream {
  /** `on`: {opened(), live(batch), status(status), model(m), diagnosis(d), state(state, since)}; since: a Date. */
  constructor(on) {
    this.on = on;
    this.state = "connecting";
    this.lastLive = 0;
    this.open();
    setInterval(() => this.look(), 500);
    document.addEventListener("visibilitychange", () => this.look());
  }

  open() {
    this.source?.close();
    this.lastMessage = performance.now();
    const source = new EventSource("/api/v1/stream");
    this.source = source;
    source.onopen = () => {
      this.lastMessage = performance.now();
      this.on.opened();
    };
    source.onerror = () => {
      this.become("lost");
      // A browser reconnects by itself, except after a response that was not a stream.
      if (source.readyState === EventSource.CLOSED) setTimeout(() => this.open(), kRetry_ms);
    };
    for (const kind of ["live", "status", "model", "diagnosis"])
      source.addEventListener(kind, (message) => this.take(kind, JSON.parse(message.data)));
  }

  take(kind, value) {
    this.lastMessage = performance.now();
    if (kind === "live") {
      this.lastLive = this.lastMessage;
      this.become("live");
    } else if (kind === "status" && 1000 * value.silent_s > kSilent_ms) {
      this.become("silent", new Date(Date.now() - 1000 * value.silent_s));
    } else if (this.state !== "live") {
      this.become("silent");
    }
    this.on[kind](value);
  }

  look() {
    const now = performance.now();
    if (this.source.readyState === EventSource.OPEN && now - this.lastMessage > kDead_ms) {
      this.become("lost");
      this.open();
    } else if (this.state === "live" && now - this.lastLive > kSilent_ms) {
      this.become("silent", new Date(Date.now() - (now - this.lastLive)));
    }
  }

  become(state, since = new Date()) {
    // A delayed message may report its state too late, never too early: the earlier time is right.
    if (state === this.state && since >= this.since) return;
    this.state = state;
    this.since = since;
    this.on.state(state, since);
  }
}
