// SPDX-License-Identifier: Apache-2.0
// The page's elements.

export function element<T extends HTMLElement = HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

export function setText(id: string, text: string): void {
  const found = element(id);
  if (found.textContent !== text) found.textContent = text;
}

export function press(id: string, on: boolean): void {
  element(id).setAttribute("aria-pressed", String(on));
}

export function isPressed(button: string | Element): boolean {
  const found = typeof button === "string" ? element(button) : button;
  return found.getAttribute("aria-pressed") === "true";
}

export function make(tag: string, text = "", className = ""): HTMLElement {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = className;
  return made;
}

/** `label` says more than `text` to those who do not see it. */
export function button(text: string, label: string, click: () => void): HTMLElement {
  const made = make("button", text, "quiet") as HTMLButtonElement;
  made.type = "button";
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", click);
  return made;
}
