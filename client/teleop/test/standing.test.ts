// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from "vitest";
import type { Motion } from "../src/protocol";
import { World } from "../src/robots";
import { fixed, milliseconds, type Seat, standing } from "../src/standing";

const SEAT: Seat = { connected: true, everConnected: true, myName: "teleop me", drives: false, played: null };
const MOTION: Motion = { group: "motion", state: "stopped", owner: "", owner_priority: 0, lease_s: 0.5, reason: "" };

/** A robot whose base is in this motion. */
function world(motion: Partial<Motion> = {}, hung = false): World {
  const made = new World();
  const devices = [{ address: "position2d:0", driver: "base" }];
  made.take({ t: "robot", robot: 0, label: "robot0", connected: true, why: "", devices, streams: [] }, 0);
  const driver = {
    name: "base",
    open: true,
    hung,
    rate_hz: 100,
    beats_missed: 0,
    jitter_us: { p50: 0, p99: 0, max: 0 },
    faults: 0,
    devices: [{ device: "position2d:0", motion: [{ ...MOTION, ...motion }] }],
  };
  made.take({ t: "status", robot: 0, round_trip_s: 0.001, drivers: [driver] }, 0);
  return made;
}

describe("standing", () => {
  it("names who drives", () => {
    const of = (owner: string) => standing(world({ state: "driving", owner, owner_priority: 10 }), SEAT, 0).driver;
    expect(of("")).toBe("robot0 · driven by nobody");
    expect(of("teleop me")).toBe("robot0 · driven by you");
    expect(of("nav@laptop")).toBe("robot0 · driven by nav@laptop (priority 10)");
  });
  it("tells why it stands, and of a robot that drives nothing", () => {
    expect(standing(world({ reason: "no command for 512 ms (lease 500 ms)" }), SEAT, 0)).toMatchObject({
      state: "STOPPED",
      reason: "no command for 512 ms (lease 500 ms)",
      level: "warn",
    });
    expect(standing(world({ state: "driving", reason: "old" }), SEAT, 0)).toMatchObject({ reason: "", level: "good" });
    expect(standing(world({ state: "fault", reason: "EMCY 0x3210" }, true), SEAT, 0)).toMatchObject({
      reason: "its driver hangs · EMCY 0x3210",
      level: "bad",
    });
  });
  it("names the referee, and only while he halts the game", () => {
    const halted = world({ reason: '"vision-bridge" asked for a stop' });
    halted.take({ t: "vision", why: "", halt: true }, 0);
    expect(standing(halted, SEAT, 0).reason).toBe("HALT: the referee stopped it");
    halted.take({ t: "vision", why: "" }, 0);
    expect(standing(halted, SEAT, 0).reason).toBe('"vision-bridge" asked for a stop');
  });
  it("shows a refusal as long as it counts", () => {
    const refused = world();
    refused.take({ t: "event", robot: 0, severity: 1, text: 'position2d:0 refused: "nav" drives' }, 1000);
    expect(standing(refused, SEAT, 2000).reason).toContain('"nav" drives');
    expect(standing(refused, SEAT, 9000).reason).toBe("");
  });
  it("says what is missing before anything else", () => {
    expect(standing(world(), { ...SEAT, connected: false }, 0).state).toBe("NO GATEWAY");
    expect(standing(world(), { ...SEAT, connected: false, everConnected: false }, 0).state).toBe("CONNECTING");
    expect(standing(new World(), SEAT, 0).state).toBe("NO ROBOT");
    expect(standing(world(), { ...SEAT, played: 0 }, 0).state).toBe("PLAYBACK");
  });
});

describe("numbers", () => {
  it("have no minus before a zero", () => {
    expect([-0.001, -0.4, -0.006, 1.5].map((value) => fixed(value, 2))).toEqual(["0.00", "-0.40", "-0.01", "1.50"]);
    expect(fixed(-0.4, 0)).toBe("0");
  });
  it("of milliseconds have a unit", () => {
    expect([0.2, 12.4, 1530].map(milliseconds)).toEqual(["<1 ms", "12 ms", "1.5 s"]);
  });
});
