// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from "vitest";
import { HeldCommand } from "../src/held";

const ahead = { robot: 0, device: "position2d:0", x: 1, y: 0, w: 0 };

describe("HeldCommand", () => {
  it("says nothing when nothing is held", () => {
    expect(new HeldCommand().step(0)).toBeNull();
  });
  it("sends at once, then never more than 50 times a second, the newest", () => {
    const held = new HeldCommand();
    let sent = 0;
    for (let now = 0; now < 1000; now += 1) {
      const command = { ...ahead, x: now };
      held.hold(command, now);
      const action = held.step(now);
      if (action) {
        sent += 1;
        expect(action).toEqual(command);
      }
    }
    expect(sent).toBe(50);
  });
  it("lets go at once, and once", () => {
    const held = new HeldCommand();
    held.hold(ahead, 0);
    expect(held.step(0)).toEqual(ahead);
    held.hold(null, 1);
    expect(held.step(1)).toBe("release");
    expect(held.step(2)).toBeNull();
  });
  it("takes a page that hangs for one that let go", () => {
    const held = new HeldCommand();
    held.hold(ahead, 0);
    expect(held.step(HeldCommand.PATIENCE_MS)).toEqual(ahead);
    expect(held.step(HeldCommand.PATIENCE_MS + 1)).toBe("release");
    expect(held.step(HeldCommand.PATIENCE_MS + 100)).toBeNull();
  });
  it("forgives a hiccup, but drives after a hang only once nothing was held", () => {
    const held = new HeldCommand();
    held.hold(ahead, 0);
    expect(held.step(300)).toBe("release");
    expect(held.hold(ahead, 300)).toBe(true);
    expect(held.step(300)).toEqual(ahead);
    expect(held.hold(ahead, 301 + HeldCommand.HUNG_MS)).toBe(false);
    expect(held.step(301 + HeldCommand.HUNG_MS)).toBe("release");
    expect(held.hold(ahead, 1000)).toBe(false);
    expect(held.step(1000)).toBeNull();
    expect(held.hold(null, 1020)).toBe(true);
    expect(held.hold(ahead, 1040)).toBe(true);
    expect(held.step(1040)).toEqual(ahead);
  });
  it("lets go of one robot before it holds another", () => {
    const held = new HeldCommand();
    held.hold(ahead, 0);
    held.step(0);
    held.hold({ ...ahead, robot: 1 }, 30);
    expect(held.step(30)).toBe("release");
    expect(held.step(30)).toEqual({ ...ahead, robot: 1 });
  });
  it("forgets what it held when the connection is gone", () => {
    const held = new HeldCommand();
    held.hold(ahead, 0);
    held.forget();
    expect(held.step(30)).toBeNull();
  });
});
