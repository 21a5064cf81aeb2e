// A real daemon that replays a recording, on a store of its own.
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

// Whoever ends this ends the daemons with it.
process.once("SIGTERM", () => process.exit(1));

export class Daemon {
  /** `options`: {port, store, recordings, configuration, machine}; the configuration is a text */
  static async start(program, options) {
    const daemon = new Daemon();
    daemon.store = options.store ?? mkdtempSync(join(tmpdir(), "servotwin-page-"));
    daemon.machine = options.machine ?? `page-${process.pid}`;
    const given = ["--store", daemon.store, "--machine", daemon.machine, "--domain", "97", "--http", `127.0.0.1:${options.port ?? 0}`];
    if (options.configuration) {
      daemon.file = join(daemon.store, "servotwin.toml");
      writeFileSync(daemon.file, options.configuration);
      given.push("--config", daemon.file);
    }
    if (options.recordings.length > 0) given.push("--replay", ...options.recordings);
    daemon.process = spawn(program, given, { stdio: ["ignore", "ignore", "pipe"] });
    process.once("exit", () => daemon.process.kill("SIGKILL"));
    daemon.said = "";
    daemon.waiting = [];
    const wake = () => { for (const resolve of daemon.waiting.splice(0)) resolve(); };
    daemon.ended = new Promise((resolve) => daemon.process.once("exit", resolve));
    daemon.process.stderr.on("data", (text) => { daemon.said += text; wake(); });
    daemon.ended.then(wake);
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
      await new Promise((resolve) => this.waiting.push(resolve));
    }
  }

  /** Has it read another configuration. */
  async read(configuration) {
    writeFileSync(this.file, configuration);
    this.process.kill("SIGHUP");
    await this.says(/configuration read again/);
  }

  async stop(signal = "SIGTERM") {
    this.process.kill(signal);
    await this.ended;
  }

  forget() {
    rmSync(this.store, { recursive: true, force: true });
  }
}
