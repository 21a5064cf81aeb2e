// A real daemon that replays a recording, on a store of its own.
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

// Whoever ends this ends the daemons with it.
process.once("SIGTERM", () => process.exit(1));

export class Daemon {
  /** `options`: {port, store, recordings, config, machine} */
  static async start(program, options) {
    const daemon = new Daemon();
    daemon.ownStore = options.store === undefined;
    daemon.store = options.store ?? mkdtempSync(join(tmpdir(), "servotwin-page-"));
    const given = ["--store", daemon.store, "--machine", options.machine ?? `page-${process.pid}`, "--domain", "97", "--http", `127.0.0.1:${options.port ?? 0}`];
    if (options.config) given.push("--config", options.config);
    if (options.recordings.length > 0) given.push("--replay", ...options.recordings);
    daemon.process = spawn(program, given, { stdio: ["ignore", "ignore", "pipe"] });
    process.once("exit", () => daemon.process.kill("SIGKILL"));
    daemon.said = "";
    daemon.ended = new Promise((resolve) => daemon.process.once("exit", resolve));
    daemon.process.stderr.on("data", (text) => { daemon.said += text; daemon.wake?.(); });
    daemon.ended.then(() => daemon.wake?.());
    const [, url] = await daemon.says(/page at (\S+)/);
    daemon.url = url;
    daemon.port = new URL(url).port;
    return daemon;
  }

  /** Waits until it has said this. */
  async says(pattern) {
    for (;;) {
      const found = this.said.match(pattern);
      if (found) return found;
      if (this.process.exitCode !== null) throw new Error(`the daemon ended without saying ${pattern}: ${this.said}`);
      await new Promise((resolve) => { this.wake = resolve; });
    }
  }

  async stop(signal = "SIGTERM") {
    this.process.kill(signal);
    await this.ended;
  }

  forget() {
    rmSync(this.store, { recursive: true, force: true });
  }
}
