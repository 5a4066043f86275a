// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from "vitest";
import { toEarth, toPlane, World } from "../src/robots";

function world(): World {
  const made = new World();
  made.take(
    {
      t: "robot",
      robot: 3,
      label: "robot3",
      connected: true,
      why: "",
      devices: [
        { address: "position2d:0", driver: "base" },
        { address: "position2d:1", driver: "base" },
      ],
      streams: [
        { device: "position2d:0", name: "STATE", paths: ["pose.x", "pose.y", "pose.heading"] },
        { device: "power:0", name: "STATE", paths: ["voltage_v"] },
      ],
    },
    0,
  );
  return made;
}

describe("World", () => {
  it("chooses the first robot that comes", () => {
    expect(world().robot?.label).toBe("robot3");
  });
  it("keeps of each stream what came last", () => {
    const made = world();
    made.take({ t: "frame", at: 1, robots: [[3, [[0, 0.01, 1, 2, 0.5]]]] }, 100);
    made.take({ t: "frame", at: 2, robots: [[3, [[1, 0, 15.9]]]] }, 116);
    expect(made.robot?.pose).toEqual({ x: 1, y: 2, heading: 0.5 });
    expect(made.robot?.get("power:0", "voltage_v")).toBe(15.9);
    expect(made.robot?.age("position2d:0", 600)).toBeCloseTo(0.51, 9);
    expect(made.robot?.age("gps:0", 600)).toBeNull();
  });
  it("has no pose where a number is missing", () => {
    const made = world();
    made.take({ t: "frame", at: 1, robots: [[3, [[0, 0.01, null, 2, 0.5]]]] }, 100);
    expect(made.robot?.pose).toBeNull();
  });
  it("drives the base that somebody may own, not the one that takes measurements", () => {
    const made = world();
    expect(made.robot?.base).toBe("position2d:0");
    const motion = {
      group: "motion",
      state: "stopped",
      owner: "",
      owner_priority: 0,
      lease_s: 0.5,
      reason: "",
    } as const;
    const driver = {
      name: "base",
      open: true,
      hung: false,
      rate_hz: 100,
      beats_missed: 0,
      faults: 0,
      jitter_us: { p50: 0, p99: 0, max: 0 },
      devices: [
        { device: "position2d:0", motion: [] },
        { device: "position2d:1", motion: [motion] },
      ],
    };
    made.take({ t: "status", robot: 3, round_trip_s: 0.001, drivers: [driver] }, 0);
    expect(made.robot?.base).toBe("position2d:1");
  });
  it("goes by the localizer where a planner drives, and by the wheels where none does", () => {
    const made = new World();
    const devices = [
      { address: "position2d:0", driver: "simulated_base" },
      { address: "position2d:2", driver: "localizer" },
      { address: "localize:0", driver: "simulated_gps" },
      { address: "localize:1", driver: "localizer" },
    ];
    const streams = ["position2d:0", "position2d:2"].map((device) => ({
      device,
      name: "STATE",
      paths: ["pose.x", "pose.y", "pose.heading"],
    }));
    streams.push({ device: "localize:1", name: "STATE", paths: ["mean.x", "mean.y", "var.x", "var.y", "cov.xy"] });
    const rows = [
      [0, 0, 1, 1, 0],
      [1, 0, 2, 2, 0],
      [2, 0, 2, 2, 0.04, 0.01, 0],
    ];
    const robot = { t: "robot", robot: 0, label: "field", connected: true, why: "", streams } as const;
    made.take({ ...robot, devices }, 0);
    made.take({ t: "frame", at: 1, robots: [[0, rows]] }, 0);
    expect(made.robot?.pose?.x).toBe(1);
    expect(made.robot?.destined).toBe("position2d:0");
    made.take({ ...robot, devices: [...devices, { address: "planner:0", driver: "waypoint" }] }, 0);
    made.take({ t: "frame", at: 1, robots: [[0, rows]] }, 0);
    expect(made.robot?.pose?.x).toBe(2);
    expect(made.robot?.destined).toBe("planner:0");
    expect(made.robot?.bases()).toEqual(["position2d:0"]);
    expect(made.robot?.belief).toEqual({ x: 2, y: 2, xx: 0.04, yy: 0.01, xy: 0 });
  });
  it("chooses another robot when the chosen one is gone", () => {
    const made = world();
    made.take({ t: "gone", robot: 3 }, 0);
    expect(made.robot).toBeNull();
  });
  it("does not care for robots that it has not been told of", () => {
    const made = world();
    made.take({ t: "frame", at: 1, robots: [[7, [[0, 0, 1]]]] }, 0);
    made.take({ t: "frame", at: 1, robots: [[3, [[9, 0, 1]]]] }, 0);
    expect(made.robot?.pose).toBeNull();
  });
});

describe("toPlane", () => {
  it("knows how long a degree is (NIMA TR8350.2: 110 574 m and 111 320 m at the equator)", () => {
    const { x, y } = toPlane(0.01, 0.01, { latitude: 0, longitude: 0 });
    expect(x).toBeCloseTo(1113.2, 1);
    expect(y).toBeCloseTo(1105.74, 1);
  });
  it("is undone by toEarth", () => {
    const origin = { latitude: 52.5, longitude: 13.4 };
    const { x, y } = toPlane(52.503, 13.407, origin);
    const { latitude, longitude } = toEarth(x, y, origin);
    expect(latitude).toBeCloseTo(52.503, 12);
    expect(longitude).toBeCloseTo(13.407, 12);
  });
});

describe("short names", () => {
  const named = (...labels: string[]) => {
    const made = new World();
    labels.forEach((label, robot) => {
      made.take({ t: "robot", robot, label, connected: false, why: "", devices: [], streams: [] }, 0);
    });
    return [...made.robots.values()].map((robot) => made.short(robot));
  };
  it("are ports where all have the same host, of both kinds of address, whatever is played", () => {
    expect(named("10.0.0.1:6665", "10.0.0.1:6666")).toEqual(["6665", "6666"]);
    expect(named("[::1]:6665", "[::1]:6666", "lap.mcap")).toEqual(["6665", "6666", "lap.mcap"]);
  });
  it("are whole otherwise", () => {
    for (const labels of [["robot1"], ["[::1]:6665"], ["[::1]:6665", "[::2]:6665"], ["a:6665", "b"], ["::1", "::2"]])
      expect(named(...labels)).toEqual(labels);
  });
});
