// SPDX-License-Identifier: Apache-2.0
// The gamepad, and the editor of its mapping.
import { button, element, make, setText } from "./dom";
import {
  AXES,
  BUTTONS,
  type Limits,
  type PadMapping,
  type PadState,
  padVelocity,
  pressed,
  readMapping,
  XBOX,
} from "./input";
import type { Velocity } from "./protocol";

const NAMES: Record<string, string> = {
  ahead: "Ahead, back",
  side: "Sideways",
  turn: "Turn",
  hold: "Dead-man button",
  turbo: "Fast",
  slow: "Slow",
  stop: "STOP",
  kick: "Kick",
  chip: "Chip",
  dribble: "Dribble",
};
const XBOX_BUTTONS = ["A", "B", "X", "Y", "LB", "RB", "LT", "RT", "View", "Menu", "L stick", "R stick"];
const XBOX_AXES = ["left stick across", "left stick along", "right stick across", "right stick along"];
const ACTIONS = ["stop", "kick", "chip", "dribble"] as const;

function isAxis(name: string): boolean {
  return (AXES as readonly string[]).includes(name);
}

export class Pad {
  #mapping: PadMapping = readMapping(localStorage.getItem("mapping"));
  #before: PadState | null = null;
  #index: number | null = null;
  #learns: keyof PadMapping | null = null;

  /** `onPress`: a button for that went down. */
  constructor(readonly onPress: (action: (typeof ACTIONS)[number]) => void) {
    element("mapping-reset").addEventListener("click", () => {
      this.#mapping = { ...XBOX };
      localStorage.removeItem("mapping");
      this.#draw();
    });
    this.#draw();
  }

  /** Look at it: what it holds; null: nothing, or there is none. */
  poll(limits: Limits): Velocity | null {
    const pad = this.#read();
    if (pad) {
      const went = pressed(this.#before, pad);
      if (this.#learns) this.#learn(pad, went);
      else for (const action of ACTIONS) if (went.includes(this.#mapping[action])) this.onPress(action);
    }
    this.#before = pad;
    return pad && padVelocity(pad, this.#mapping, limits);
  }

  #read(): PadState | null {
    const pads = navigator.getGamepads().filter((pad) => pad?.connected);
    const pad = pads.find((one) => one?.index === this.#index) ?? pads[0] ?? null;
    this.#index = pad?.index ?? null;
    setText("pad-name", pad ? pad.id.replace(/\s*\(.*$/, "") : "none");
    return pad ? { axes: [...pad.axes], buttons: pad.buttons.map((one) => one.pressed) } : null;
  }

  #learn(pad: PadState, went: number[]): void {
    const name = this.#learns as keyof PadMapping;
    const axis = pad.axes.findIndex((value, i) => Math.abs(value) > 0.7 && Math.abs(this.#before?.axes[i] ?? 1) <= 0.7);
    const found = isAxis(name) ? axis : (went[0] ?? -1);
    if (found < 0) return;
    this.#mapping = { ...this.#mapping, [name]: found };
    this.#learns = null;
    this.#store();
    this.#draw();
  }

  #store(): void {
    localStorage.setItem("mapping", JSON.stringify(this.#mapping));
  }

  #draw(): void {
    const names: (keyof PadMapping)[] = [...AXES, ...BUTTONS];
    setText("pad-hold", XBOX_BUTTONS[this.#mapping.hold] ?? `button ${this.#mapping.hold}`);
    const rows = names.flatMap((name) => {
      const number = this.#mapping[name];
      const has = isAxis(name) ? (XBOX_AXES[number] ?? `axis ${number}`) : (XBOX_BUTTONS[number] ?? `button ${number}`);
      const text = this.#learns !== name ? has : isAxis(name) ? "move it …" : "press it …";
      const change = button(text, `${NAMES[name]}: ${text}`, () => {
        this.#learns = this.#learns === name ? null : name;
        this.#draw();
      });
      return [make("span", NAMES[name] as string), change];
    });
    const expo = make("input") as HTMLInputElement;
    Object.assign(expo, { type: "range", min: "0", max: "1", step: "0.05", value: String(this.#mapping.expo) });
    expo.setAttribute("aria-label", "Expo: fine near the middle");
    expo.addEventListener("input", () => {
      this.#mapping.expo = Number(expo.value);
      this.#store();
    });
    element("mapping").replaceChildren(...rows, make("span", "Expo"), expo);
  }
}
