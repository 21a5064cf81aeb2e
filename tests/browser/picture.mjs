// node picture.mjs OUT.png: the page as it looks on a tablet, once both axes have a model.
import { live, launch, open, shows } from "./browser.mjs";
import { Daemon } from "./daemon.mjs";

const { SERVOTWIND: program, SERVOTWIN_RECORDING: recording } = process.env;
const browser = await launch();
const daemon = await Daemon.start(program, { recordings: [recording, recording], machine: "mill-7" });
try {
  await daemon.says(/Y: model 1 is in force/);
  await daemon.says(/X: model 1 is in force/);
  const { page } = await open(browser, daemon.url, { viewport: { width: 1280, height: 800 }, colorScheme: "light" });
  await live(page);
  await shows(page, "#figure-residual", /× smaller/);
  // Until the window is full of cycles that were predicted.
  const now = Number(await page.evaluate(() => performance.now()));
  await page.waitForFunction((since) => performance.now() - since > 11_000, now);
  await page.getByRole("button", { name: "Pause" }).click();
  await page.screenshot({ path: process.argv[2] });
} finally {
  await browser.close();
  await daemon.stop("SIGKILL");
  daemon.forget();
}
