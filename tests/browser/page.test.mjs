// The page in a real browser, on a real daemon that replays a recording.
import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { createSocket } from "node:dgram";
import { dirname, join } from "node:path";
import { after, before, test } from "node:test";
import { promisify } from "node:util";
import { changes, launch, live, open, picture, shows } from "./browser.mjs";
import { Daemon } from "./daemon.mjs";

const { SERVOTWIND: program, SERVOTWIN_RECORDING: recording } = process.env;
const run = promisify(execFile);
const token = "a token of the test";
const recordings = Array(20).fill(recording);
const rest = "[identify]\nwindow_s = 600\nmemory_s = 600\n"; // for as long as the test lasts nothing is identified
let browser;
let daemon; // replays a recording
let diagnosed; // has models and diagnoses
let learning; // has models, learns programs and may be armed

/** A daemon of its own machine with this configuration. */
const configured = (name, configuration, given = {}) => Daemon.start(program, { recordings, configuration, machine: `${name}-${process.pid}`, ...given });

// A browser that paints takes the processor from the identification, which runs at idle priority: models come first.
// Then nothing is identified any more, which takes it from the browser where the host knows no such priority.
before(async () => {
  const identify = `[identify]\nmethod = "pole-search"\n`;
  const http = `[http]\ntoken = "${token}"\n`;
  const axis = (name) => `[[axis]]\nname = "${name}"\ncorrection = { peak = 2e-3, rate = 0.05, bandwidth = 60 }\n`;
  const asked = `${http}[diagnose]\nrecord_s = 10\n`;
  const learns = `${http}[diagnose]\nevery_s = 0\n[ilc]\nlive = true\nrecognise = "off"\nmatch_tolerance = 1e-4\n${axis("X")}${axis("Y")}`;
  [diagnosed, learning] = await Promise.all([configured("diagnosed", identify + asked), configured("learning", identify + learns)]);
  await Promise.all([...[diagnosed, learning].flatMap((one) => [one.says(/X: model \d+ is in force/), one.says(/Y: model \d+ is in force/)]), diagnosed.says(/X: diagnosis of/)]);
  await Promise.all([diagnosed.read(rest + asked), learning.read(rest + learns)]);
  [browser, daemon] = await Promise.all([launch(), Daemon.start(program, { recordings, configuration: rest })]);
});
after(async () => {
  await browser?.close();
  for (const one of [daemon, diagnosed, learning]) {
    await one?.stop("SIGKILL");
    one?.forget();
  }
});

test("shows live cycles of the axes, and asks nobody else", async () => {
  const { page, complaints, requests } = await open(browser, daemon.url);
  await live(page);
  await shows(page, "#machine", /^page-\d+$/);
  assert.deepEqual(await page.locator("#axes input").evaluateAll((all) => all.map((one) => one.value)), ["X", "Y"]);
  await shows(page, "#figure-measured", /\d µm RMS/);
  for (const chart of ["#chart-command canvas", "#chart-error canvas", "#path canvas"]) {
    await changes(page, chart, await picture(page, chart));
  }
  await shows(page, "#contour", /measured[\d.]+ µm RMS/);
  assert.deepEqual(requests.filter((url) => !url.startsWith(daemon.url)), []);
  assert.deepEqual(complaints, []);
  // The whole view fits a tablet: nothing is cut off, nothing scrolls.
  for (const size of [{ width: 1024, height: 768 }, { width: 1280, height: 800 }]) {
    await page.setViewportSize(size);
    const overflow = await page.evaluate(() => [document.documentElement.scrollWidth - innerWidth, document.documentElement.scrollHeight - innerHeight]);
    assert.deepEqual(overflow, [0, 0], JSON.stringify(size));
  }
  for (const box of await page.locator("header a, button:visible, select:visible, #axes label").evaluateAll((all) => all.map((one) => one.getBoundingClientRect().height)))
    assert.ok(box >= 44, `a touch target of ${box} pixels`);
  await page.setViewportSize({ width: 390, height: 844 });
  await page.waitForFunction(() => document.documentElement.scrollWidth <= 390); // once all is drawn anew
  await page.close();
});

test("what the page shows is what the stream says", async () => {
  const { page } = await open(browser, daemon.url);
  await live(page);
  const batch = await page.evaluate(() => new Promise((resolve) => {
    const source = new EventSource("/api/v1/stream");
    source.addEventListener("live", (message) => { source.close(); resolve(JSON.parse(message.data)); });
  }));
  assert.equal(batch.schema, "servotwin.live/1");
  assert.equal(batch.axes.length, 2);
  assert.equal(batch.cycles_per_point, 1);
  const [x] = batch.axes;
  x.residual.forEach((value, i) => { if (value !== null) assert.ok(Math.abs(value - (x.measured[i] - x.predicted[i])) < 2e-9); });
  await page.getByRole("button", { name: "Pause" }).click();
  await page.waitForFunction(() => /command/.test(document.querySelector("#chart-command").getAttribute("aria-label") ?? ""));
  const label = await page.locator("#chart-command").getAttribute("aria-label");
  assert.match(label, /Command of axis X, last 10 s: now command -?[\d.]+ mm/);
  await page.close();
});

test("everything can be done with the keyboard, and focus is seen", async () => {
  const { page } = await open(browser, daemon.url);
  await live(page);
  const reached = new Set();
  for (let i = 0; i < 32; ++i) {
    await page.keyboard.press("Tab");
    reached.add(await page.evaluate(() => {
      const one = document.activeElement;
      const style = getComputedStyle(one.matches("#axes input") ? one.nextElementSibling : one);
      if (one !== document.body && (style.outlineStyle === "none" || parseFloat(style.outlineWidth) < 2)) return `no focus on ${one.id || one.outerHTML}`;
      return one.id || one.textContent.trim() || one.name;
    }));
  }
  const missing = ["Live", "Models", "Diagnosis", "Corrections", "Service", "theme", "window", "pause", "chart-error", "path-factor"].filter((name) => !reached.has(name));
  assert.deepEqual(missing, []);
  assert.deepEqual([...reached].filter((name) => name.startsWith("no focus")), []);
  await page.locator("#axes input[value=X]").focus();
  await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => document.querySelector("#axes input:checked").value === "Y");
  await page.locator("#chart-error").focus();
  await page.keyboard.press("ArrowLeft");
  await shows(page, "#readout", /measured -?[\d.]+ µm/);
  await page.getByRole("link", { name: "Service" }).focus();
  await page.keyboard.press("Enter");
  await page.locator("#losses").waitFor();
  assert.equal(await page.locator("nav a[aria-current]").textContent(), "Service");
  await page.close();
});

test("is light or dark as the system says, and as the button says", async () => {
  const { page, complaints } = await open(browser, daemon.url, { colorScheme: "dark" });
  const brightness = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor.match(/\d+/g).slice(0, 3).reduce((sum, part) => sum + Number(part), 0));
  await page.waitForFunction(() => document.documentElement.dataset.theme === "dark");
  assert.ok((await brightness()) < 150);
  await page.locator("#theme").click();
  assert.ok((await brightness()) > 600);
  await page.reload();
  await page.waitForFunction(() => document.documentElement.dataset.theme === "light");
  assert.deepEqual(complaints, []);
  await page.close();
});

test("words stand out from what is behind them", async () => {
  for (const colorScheme of ["light", "dark"]) {
    const { page } = await open(browser, daemon.url, { colorScheme });
    await page.waitForFunction((theme) => document.documentElement.dataset.theme === theme, colorScheme);
    const ratios = await page.evaluate(() => {
      const style = getComputedStyle(document.documentElement);
      const luminance = (name) => {
        const probe = document.createElement("i");
        probe.style.color = style.getPropertyValue(`--${name}`);
        document.body.append(probe);
        const parts = getComputedStyle(probe).color.match(/\d+/g).slice(0, 3).map((part) => part / 255);
        probe.remove();
        const [r, g, b] = parts.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
      };
      const ratio = (a, b) => (Math.max(luminance(a), luminance(b)) + 0.05) / (Math.min(luminance(a), luminance(b)) + 0.05);
      return {
        words: ["text", "soft", "strong", "good", "warn", "bad"].flatMap((name) => [["panel", name, ratio(name, "panel")], ["back", name, ratio(name, "back")]]),
        lines: ["command", "measured", "predicted", "residual"].map((name) => ["panel", name, ratio(name, "panel")]),
      };
    });
    for (const one of ratios.words) assert.ok(one[2] >= 4.5, `${colorScheme} ${one}`); // WCAG 1.4.3
    for (const one of ratios.lines) assert.ok(one[2] >= 3, `${colorScheme} ${one}`); // WCAG 1.4.11
    await page.close();
  }
});

test("models and diagnoses come with their reasons and pictures", async () => {
  const { page, complaints } = await open(browser, `${diagnosed.url}#models`);
  await shows(page, "#versions tbody", /in force.*model 1 is in force: residual/);
  await page.getByRole("link", { name: "Live" }).click();
  await shows(page, "#contour", /by the daemon-?[\d.]+ µm predicted, -?[\d.]+ µm measured/);
  await page.getByRole("link", { name: "Diagnosis" }).click();
  await shows(page, "#verdict", /The residual of the simulation is [\d.]+ µm RMS/);
  await shows(page, "#causes", /check.+/);
  await shows(page, "#doubt", /Not observable here.*: ./);
  await page.frameLocator("#report").locator("figure svg").first().waitFor();
  await page.locator("#ask summary").click();
  await page.locator("#token").fill("a wrong token");
  await page.getByRole("button", { name: "Ask" }).click();
  await shows(page, "#asked", /^Not asked: needs Authorization/);
  complaints.length = 0; // the browser complains of the 401, which was wanted
  await page.locator("#token").fill(token);
  await page.keyboard.press("Enter");
  await shows(page, "#asked", /^Asked: a diagnosis is made/);
  await page.getByRole("link", { name: "Service" }).click();
  await shows(page, "#events", /diagnosis of/);
  assert.deepEqual(complaints, []);
  await page.close();
});

test("shows what was learned of a program, and what became of it", async () => {
  const { page, complaints } = await open(browser, `${learning.url}#corrections`);
  await shows(page, "#sending", /Not armed: nothing goes to the drives/);
  await shows(page, "#programs", /No program has been received yet/);
  await run(join(dirname(program), "servotwin"), ["preview", recording, "--dds", "--learn", "--name", "part", "--machine", learning.machine, "--domain", "97"]);
  await page.reload();
  await shows(page, "#programs", /learnedprogram 'part'.*axis X[\d.]+ µm[\d.]+ µm–axis Y[\d.]+ µm[\d.]+ µm–path[\d.]+ µm[\d.]+ µm–/);
  await page.locator("#do-arm").click();
  await shows(page, "#arm-said", /^Not done: needs Authorization/);
  complaints.length = 0; // the browser complains of the 401, which was wanted
  await page.locator("#arm-token").fill(token);
  await page.locator("#do-arm").click();
  await shows(page, "#sending", /Armed: offsets go to the drives/);
  await page.locator("#do-disarm").click();
  await shows(page, "#sending", /Not armed/);
  // Who arms elsewhere is seen here with the next status, and not only when the page asks again.
  await page.route("**/api/v1/offsets", (route) => route.fulfill({ json: { live: true, armed: false } }));
  const elsewhere = await fetch(`${learning.url}api/v1/offsets/arm`, { method: "POST", headers: { Authorization: `Bearer ${token}` } });
  assert.equal(elsewhere.status, 200);
  await shows(page, "#sending", /Armed: offsets go to the drives/);
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth - innerWidth), 0);
  assert.deepEqual(complaints, []);
  await page.close();
});

test("shows how long predictions take, as a histogram too", async () => {
  const { page, complaints } = await open(browser, `${daemon.url}#service`);
  await shows(page, "#latency", /frame to prediction sent(\s*[\d.]+ [µm]?s){4}/);
  await shows(page, "#octaves", /below [\d.]+ [µm]?s\d/);
  assert.equal(await page.locator("#buses-part").isVisible(), false);
  const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  assert.equal(overflow, 0);
  assert.deepEqual(complaints, []);
  await page.close();
});

/** A packet of CAN over UDP, as cannelloni sends it, with one frame that has no data. */
const packet = (sequence, id) => Buffer.from([2, 0, sequence, 0, 1, 0, 0, id >> 8, id & 0xff, 0]);

test("shows what was lost on every bus", async () => {
  const port = 20_000 + (process.pid % 10_000);
  const map = join(dirname(recording), "can_machine.toml");
  const other = await configured("udp", `[source.udp]\nmap = "${map}"\nlisten = "127.0.0.1:${port}"\n`, { recordings: [] });
  const { page, complaints } = await open(browser, `${other.url}#service`);
  const socket = createSocket("udp4");
  try {
    await shows(page, "#buses", /interfaceup/);
    socket.send(packet(0, 0x7ff), port, "127.0.0.1");
    socket.send(packet(5, 0x80), port, "127.0.0.1"); // four packets never came
    await shows(page, "#buses", /frames received2/);
    await shows(page, "#buses", /packets lost4/);
    await shows(page, "#buses", /frames not in the mapping1/);
    await shows(page, "#buses th[scope=col]", new RegExp(`127.0.0.1:${port}`));
    assert.deepEqual(complaints, []);
  } finally {
    socket.close();
    await page.close();
    await other.stop("SIGKILL");
    other.forget();
  }
});

test("says when the daemon is gone, and goes on when it is back", async () => {
  let other = await Daemon.start(program, { recordings, configuration: rest });
  const { port, store } = other;
  const { page } = await open(browser, other.url);
  await live(page);
  await page.evaluate(() => { window.same = true; });
  await other.stop("SIGKILL");
  await page.waitForFunction(() => document.querySelector("#state").dataset.state === "lost");
  await shows(page, "#banner", /No connection to the daemon since .* Trying again/);
  assert.ok(await page.locator("#banner").isVisible());
  assert.equal(await page.locator("#banner").getAttribute("role"), "status");
  other = await Daemon.start(program, { recordings, configuration: rest, port, store });
  await live(page);
  assert.equal(await page.locator("#banner").isVisible(), false);
  assert.equal(await page.evaluate(() => window.same), true); // by itself, without a new page
  await changes(page, "#chart-command canvas", await picture(page, "#chart-command canvas"));
  await page.close();
  await other.stop("SIGKILL");
  other.forget();
});

test("says when the machine falls silent", async () => {
  const other = await configured("waiting", "[[axis]]\nname = 'X'\n[[axis]]\nname = 'Y'\n", { recordings: [] });
  const { page } = await open(browser, other.url);
  try {
    await shows(page, "#state", /waiting for the machine/);
    await shows(page, "#banner", /The daemon is waiting for its machine/);
    await shows(page, "#unheard", /No machine has been heard yet[^]*waiting for machine '.+' on DDS domain 97/);
    assert.equal(await page.locator("#charts, #plane").filter({ visible: true }).count(), 0); // no empty plots
    await run(join(dirname(program), "servotwin"), ["replay", recording, "--dds", "--to", "1", "--machine", other.machine, "--domain", "97"]);
    await page.locator("#chart-error canvas").waitFor();
    assert.equal(await page.locator("#unheard").isVisible(), false);
  } finally {
    await page.close();
    await other.stop("SIGKILL");
    other.forget();
  }
});

test("says since when to who opens it later", async () => {
  const machine = `silent-${process.pid}`;
  const other = await Daemon.start(program, { recordings: [], machine });
  try {
    await run(join(dirname(program), "servotwin"), ["replay", recording, "--dds", "--to", "3", "--machine", machine, "--domain", "97"]);
    const end = Date.now();
    await new Promise((resolve) => setTimeout(resolve, 5000));
    const { page } = await open(browser, other.url);
    await shows(page, "#banner", /No cycles have been received from the machine since/);
    await new Promise((resolve) => setTimeout(resolve, 1500)); // until the stream's past is read
    const said = /since (\d+):(\d+):(\d+)/.exec(await page.locator("#banner").textContent());
    const since = new Date(end).setHours(...said.slice(1).map(Number), 0);
    assert.ok(Math.abs(since - end) < 2500, `${said[0]}, the last cycle at ${new Date(end).toISOString()}`);
    await page.close();
  } finally {
    await other.stop("SIGKILL");
    other.forget();
  }
});
