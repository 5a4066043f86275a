// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from "vitest";
import {
  Grip,
  keysVelocity,
  NORMAL,
  padVelocity,
  pressed,
  readMapping,
  SLOW,
  shape,
  stickVelocity,
  XBOX,
} from "../src/input";

const limits = { speed: 2, turn: 4 };

function pad(axes: number[], ...down: number[]) {
  return { axes, buttons: Array.from({ length: 16 }, (_, i) => down.includes(i)) };
}

describe("shape", () => {
  it("is dead near the middle and everything at the rim", () => {
    expect(shape(0.09, 0.6)).toBe(0);
    expect(shape(1, 0.6)).toBeCloseTo(1, 12);
    expect(shape(-1, 0.6)).toBeCloseTo(-1, 12);
    expect(shape(1.5, 0.6)).toBeCloseTo(1, 12);
  });
  it("grows all the way, and never beyond the line", () => {
    for (let v = 0; v < 1; v += 0.01) {
      expect(shape(v + 0.01, 0.6)).toBeGreaterThanOrEqual(shape(v, 0.6));
      expect(shape(v, 0.6)).toBeLessThanOrEqual(v);
    }
  });
});

describe("keysVelocity", () => {
  const keys = (...codes: string[]) => keysVelocity(new Set(codes), limits);
  it("is nothing when no direction is held", () => {
    expect(keys()).toBeNull();
    expect(keys("ShiftLeft", "KeyC", "KeyX")).toBeNull();
  });
  it("drives ahead, left and counter-clockwise with positive numbers", () => {
    expect(keys("KeyW")).toEqual({ x: 2 * NORMAL, y: 0, w: 0 });
    expect(keys("KeyQ")).toEqual({ x: 0, y: 2 * NORMAL, w: 0 });
    expect(keys("ArrowLeft")).toEqual({ x: 0, y: 0, w: 4 * NORMAL });
  });
  it("holds zero, rather than nothing, when directions cancel", () => {
    expect(keys("KeyW", "KeyS")).toEqual({ x: 0, y: 0, w: 0 });
  });
  it("is not faster in the diagonal", () => {
    const v = keys("KeyW", "KeyQ", "ShiftLeft");
    expect(Math.hypot(v?.x ?? 0, v?.y ?? 0)).toBeCloseTo(2, 12);
  });
  it("is not faster with two keys of one direction", () => {
    expect(keys("KeyW", "ArrowUp")?.x).toBe(2 * NORMAL);
  });
  it("knows fast and slow", () => {
    expect(keys("KeyW", "ShiftRight")?.x).toBe(2);
    expect(keys("KeyW", "KeyC")?.x).toBe(2 * SLOW);
  });
});

describe("stickVelocity", () => {
  it("turns clockwise to the right, and slides right when asked to", () => {
    expect(stickVelocity(1, 0, limits, false)).toEqual({ x: 0, y: 0, w: -4 });
    expect(stickVelocity(1, 0, limits, true)).toEqual({ x: 0, y: -2, w: 0 });
    expect(stickVelocity(0, 1, limits, false)).toEqual({ x: 2, y: 0, w: 0 });
  });
});

describe("padVelocity", () => {
  it("is nothing without the dead-man button, whatever the sticks say", () => {
    expect(padVelocity(pad([1, 1, 1, 1]), XBOX, limits)).toBeNull();
    expect(padVelocity(pad([1, 1, 1, 1], XBOX.turbo), XBOX, limits)).toBeNull();
  });
  it("drives ahead when the left stick is up", () => {
    expect(padVelocity(pad([0, -1, 0, 0], XBOX.hold, XBOX.turbo), XBOX, limits)).toEqual({ x: 2, y: 0, w: 0 });
    expect(padVelocity(pad([0, -1, 0, 0], XBOX.hold), XBOX, limits)?.x).toBe(2 * NORMAL);
    expect(padVelocity(pad([0, -1, 0, 0], XBOX.hold, XBOX.slow), XBOX, limits)?.x).toBe(2 * SLOW);
  });
  it("slides left and turns left when sticks are left", () => {
    expect(padVelocity(pad([-1, 0, 0, 0], XBOX.hold, XBOX.turbo), XBOX, limits)?.y).toBe(2);
    expect(padVelocity(pad([0, 0, -1, 0], XBOX.hold, XBOX.turbo), XBOX, limits)?.w).toBe(4);
  });
  it("stands when a pad has fewer axes than the mapping", () => {
    expect(padVelocity(pad([], XBOX.hold), XBOX, limits)).toEqual({ x: 0, y: 0, w: 0 });
  });
});

describe("pressed", () => {
  it("tells what went down, once", () => {
    expect(pressed(pad([]), pad([], 1, 3))).toEqual([1, 3]);
    expect(pressed(pad([], 1), pad([], 1, 3))).toEqual([3]);
  });
  it("has pressed nothing when the pad has just come", () => {
    expect(pressed(null, pad([], 1))).toEqual([]);
  });
});

describe("readMapping", () => {
  it("keeps what is a mapping and leaves the rest", () => {
    expect(readMapping('{"hold":7,"turbo":"x","stop":-1,"expo":9}')).toEqual({ ...XBOX, hold: 7 });
    expect(readMapping("nonsense")).toEqual(XBOX);
    expect(readMapping(null)).toEqual(XBOX);
    expect(readMapping("null")).toEqual(XBOX);
  });
});

describe("Grip", () => {
  const v = { x: 1, y: 0, w: 0 };
  const other = { x: 0, y: 1, w: 0 };
  it("holds what the first hand holds", () => {
    const grip = new Grip();
    grip.set("keys", v);
    grip.set("pad", other);
    expect(grip.velocity).toEqual(v);
    grip.set("keys", null);
    expect(grip.velocity).toEqual(other);
  });
  it("does not take up again what was held when it was lost", () => {
    const grip = new Grip();
    grip.set("pad", v);
    grip.lose();
    expect(grip.velocity).toBeNull();
    grip.set("pad", v);
    expect(grip.velocity).toBeNull();
    grip.set("pad", null);
    grip.set("pad", v);
    expect(grip.velocity).toEqual(v);
  });
});
