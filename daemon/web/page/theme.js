// Light or dark colours: those of the system until the button is used; the choice is stored.
import { at } from "./dom.js";

const kKey = "servotwin.theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const chosen = () => localStorage.getItem(kKey) ?? (dark.matches ? "dark" : "light");

/** `changed` is called after every change. */
export function startTheme(changed) {
  const apply = () => {
    const theme = chosen();
    document.documentElement.dataset.theme = theme;
    const button = at("theme");
    button.textContent = theme === "dark" ? "Light" : "Dark";
    button.setAttribute("aria-label", `Change to ${theme === "dark" ? "light" : "dark"} colours`);
    changed();
  };
  at("theme").addEventListener("click", () => {
    localStorage.setItem(kKey, chosen() === "dark" ? "light" : "dark");
    apply();
  });
  dark.addEventListener("change", apply);
  apply();
}

/** A colour of style.css as it is now. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
