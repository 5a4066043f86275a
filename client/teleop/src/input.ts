// SPDX-License-Identifier: Apache-2.0
// What hands mean, without the browser: keys, sticks and gamepads to velocities.
import type { Velocity } from "./protocol";

export interface Limits {
  speed: number; // m/s
  turn: number; // rad/s
}

export const NORMAL = 0.5; // of the limits
export const SLOW = 0.2;

/** Dead near the middle, fine around it, everything at the rim; `expo` is the share of the cubic part. */
export function shape(value: number, expo: number, dead = 0.1): number {
  const beyond = Math.max(0, Math.min(1, Math.abs(value)) - dead) / (1 - dead);
  return Math.sign(value) * ((1 - expo) * beyond + expo * beyond ** 3);
}

function scaled(x: number, y: number, w: number, limits: Limits, factor: number): Velocity {
  const longest = Math.max(1, Math.hypot(x, y)); // not faster in the diagonal
  const clean = (value: number) => (value === 0 ? 0 : value); // no -0
  return {
    x: clean((x / longest) * limits.speed * factor),
    y: clean((y / longest) * limits.speed * factor),
    w: clean(w * limits.turn * factor),
  };
}

/** By the place on the keyboard (KeyboardEvent.code), as `regista drive` has them. */
const DIRECTIONS: Record<string, [x: number, y: number, w: number]> = {
  KeyW: [1, 0, 0],
  ArrowUp: [1, 0, 0],
  KeyS: [-1, 0, 0],
  ArrowDown: [-1, 0, 0],
  KeyA: [0, 0, 1],
  ArrowLeft: [0, 0, 1],
  KeyD: [0, 0, -1],
  ArrowRight: [0, 0, -1],
  KeyQ: [0, 1, 0],
  KeyE: [0, -1, 0],
};

export function isDirection(code: string): boolean {
  return code in DIRECTIONS;
}

/** null: no direction is held. Shift is everything, C is slow. */
export function keysVelocity(held: ReadonlySet<string>, limits: Limits): Velocity | null {
  let [x, y, w, any] = [0, 0, 0, false];
  for (const code of held) {
    const direction = DIRECTIONS[code];
    if (!direction) continue;
    any = true;
    x += direction[0];
    y += direction[1];
    w += direction[2];
  }
  if (!any) return null;
  const unit = (value: number) => Math.max(-1, Math.min(1, value));
  const turbo = held.has("ShiftLeft") || held.has("ShiftRight");
  return scaled(unit(x), unit(y), unit(w), limits, turbo ? 1 : held.has("KeyC") ? SLOW : NORMAL);
}

/** A stick on the screen: `right` and `up` in [-1, 1]. It turns, or with `sideways` it slides. */
export function stickVelocity(right: number, up: number, limits: Limits, sideways: boolean): Velocity {
  const x = shape(up, 0.4);
  const across = -shape(right, 0.4);
  return scaled(x, sideways ? across : 0, sideways ? 0 : across, limits, 1);
}

export interface PadMapping {
  ahead: number; // axis, up is ahead
  side: number; // axis, left is left
  turn: number; // axis, left is counter-clockwise
  hold: number; // buttons
  turbo: number;
  slow: number;
  stop: number;
  kick: number;
  chip: number;
  dribble: number;
  expo: number;
}

/** The standard gamepad of the W3C: an Xbox pad. Left stick drives, right stick turns, LB is the dead-man button. */
export const XBOX: PadMapping = {
  ahead: 1,
  side: 0,
  turn: 2,
  hold: 4,
  turbo: 5,
  slow: 6,
  stop: 1,
  kick: 0,
  chip: 2,
  dribble: 3,
  expo: 0.6,
};

export const AXES = ["ahead", "side", "turn"] as const;
export const BUTTONS = ["hold", "turbo", "slow", "stop", "kick", "chip", "dribble"] as const;

/** A mapping that was stored, as far as it is one. */
export function readMapping(text: string | null): PadMapping {
  const mapping = { ...XBOX };
  try {
    const stored = JSON.parse(text ?? "{}") as Record<string, unknown>;
    for (const name of [...AXES, ...BUTTONS]) {
      const value = stored[name];
      if (typeof value === "number" && Number.isInteger(value) && value >= 0 && value < 64) mapping[name] = value;
    }
    const expo = stored.expo;
    if (typeof expo === "number" && expo >= 0 && expo <= 1) mapping.expo = expo;
  } catch {
    // Not ours: the standard will do.
  }
  return mapping;
}

export interface PadState {
  axes: readonly number[];
  buttons: readonly boolean[];
}

/** null: the dead-man button is not held. */
export function padVelocity(pad: PadState, mapping: PadMapping, limits: Limits): Velocity | null {
  if (!pad.buttons[mapping.hold]) return null;
  const axis = (number: number) => -shape(pad.axes[number] ?? 0, mapping.expo);
  const factor = pad.buttons[mapping.turbo] ? 1 : pad.buttons[mapping.slow] ? SLOW : NORMAL;
  return scaled(axis(mapping.ahead), axis(mapping.side), axis(mapping.turn), limits, factor);
}

/** Buttons that went down between two looks; a pad that has just come has pressed nothing. */
export function pressed(before: PadState | null, now: PadState): number[] {
  if (!before) return [];
  return now.buttons.flatMap((down, number) => (down && !before.buttons[number] ? [number] : []));
}

/**
 * A hand that holds something, out of several. What was held when the page lost its grip (blur, hidden, another robot
 * chosen) counts again only after it was let go.
 */
export class Grip {
  #held = new Map<string, Velocity>();
  #blocked = new Set<string>();

  /** null: the source holds nothing. */
  set(source: string, velocity: Velocity | null): void {
    if (velocity === null) {
      this.#held.delete(source);
      this.#blocked.delete(source);
    } else if (!this.#blocked.has(source)) {
      this.#held.set(source, velocity);
    }
  }

  /** Everything is let go, and stays so until each source has really let go. */
  lose(): void {
    for (const source of this.#held.keys()) this.#blocked.add(source);
    this.#held.clear();
  }

  /** Of the source that was first. */
  get velocity(): Velocity | null {
    return this.#held.values().next().value ?? null;
  }

  get source(): string | null {
    return this.#held.keys().next().value ?? null;
  }
}
