// Debian's Chromium, and a page in it whose complaints and requests are kept.
import { chromium } from "playwright-core";

const kPatience_ms = 180_000;
// Without a graphics processor Chromium would emulate one, which takes twice the time of drawing without.
const kDrawing = ["--disable-gpu"];

export const launch = () =>
  chromium.launch({
    executablePath: process.env.SERVOTWIN_CHROMIUM ?? "/usr/bin/chromium",
    args: process.getuid() === 0 ? [...kDrawing, "--no-sandbox"] : kDrawing,
  });

/** `options` as of Playwright's newPage; `{page, complaints, requests}`. */
export async function open(browser, url, options = {}) {
  const page = await browser.newPage({ viewport: { width: 1024, height: 768 }, ...options });
  page.setDefaultTimeout(kPatience_ms); // a busy host is no failure; where all is well nothing waits that long
  const complaints = [];
  const requests = [];
  page.on("console", (message) => { if (["error", "warning"].includes(message.type())) complaints.push(message.text()); });
  page.on("pageerror", (error) => complaints.push(error.stack));
  page.on("request", (request) => requests.push(request.url()));
  await page.goto(url);
  return { page, complaints, requests };
}

/** Waits until the page says it gets cycles. */
export const live = (page) => page.waitForFunction(() => document.querySelector("#state")?.dataset.state === "live");

/** The text of an element, once it is what is wanted. */
export const shows = (page, selector, pattern) =>
  page.waitForFunction(([where, source]) => new RegExp(source).test(document.querySelector(where)?.textContent ?? ""), [selector, pattern.source]);

/** A picture of a canvas as text, to see that it changes. */
export const picture = (page, selector) => page.evaluate((where) => document.querySelector(where).toDataURL(), selector);

export const changes = (page, selector, from) =>
  page.waitForFunction(([where, before]) => document.querySelector(where).toDataURL() !== before, [selector, from]);
