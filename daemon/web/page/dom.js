// Creates elements from values. Received text is always inserted as text, never as HTML.

/** The element with this id. */
export const at = (id) => document.getElementById(id);

/** make("td", {class: "number"}, "3"); children are strings or elements. */
export function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** Replaces the children of an element. */
export const fill = (element, ...children) => element.replaceChildren(...children);

/** Sets the text of an element if it differs: screen readers announce every change. */
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
