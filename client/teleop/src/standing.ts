// SPDX-License-Identifier: Apache-2.0
// What the page says of a robot, in words.
import type { Motion } from "./protocol";
import type { Robot, World } from "./robots";

export function battery(robot: Robot): { percent: number | null; volts: number | null } {
  const device = robot.device("power")?.address;
  if (!device) return { percent: null, volts: null };
  const valid = robot.get(device, "valid") ?? 0; // power::Valid: 1 volts, 8 percent
  return {
    percent: valid & 8 ? robot.get(device, "charge_percent") : null,
    volts: valid & 1 ? robot.get(device, "voltage_v") : null,
  };
}

/** No minus before a zero. */
export function fixed(value: number, digits: number): string {
  return value.toFixed(digits).replace(/^-(?=[0.]*$)/, "");
}

export function several(count: number, what: string): string {
  return `${count} ${what}${count === 1 ? "" : "s"}`;
}

export function milliseconds(ms: number): string {
  return ms < 1 ? "<1 ms" : ms < 1000 ? `${ms.toFixed(0)} ms` : `${(ms / 1000).toFixed(1)} s`;
}

export interface Standing {
  state: string;
  driver: string;
  reason: string;
  level: "good" | "idle" | "warn" | "bad";
}

/** What the page itself knows. */
export interface Seat {
  connected: boolean; // with the gateway
  everConnected: boolean;
  myName: string; // to the robots
  drives: boolean; // by hand
  played: number | null; // the robot that is a recording
}

/** Who drives the chosen robot and why it stands, in words; `now`: of performance.now(). */
export function standing(world: World, seat: Seat, now: number): Standing {
  const { connected, everConnected, myName, drives } = seat;
  const { robot } = world;
  if (!connected) {
    const reason = everConnected ? "regista teleop has ended or cannot be reached: start it again" : "";
    return { state: everConnected ? "NO GATEWAY" : "CONNECTING", driver: "", reason, level: "bad" };
  }
  if (!robot) return { state: "NO ROBOT", driver: "", reason: "name one: regista teleop HOST[:PORT]", level: "bad" };
  if (!robot.connected) return { state: "NOT CONNECTED", driver: robot.label, reason: robot.why, level: "bad" };
  if (robot.number === seat.played) return { state: "PLAYBACK", driver: robot.label, reason: "", level: "idle" };
  const base = robot.base;
  if (!base) return { state: "NO BASE", driver: robot.label, reason: "it has no position2d device", level: "idle" };
  const trouble = robot.devices.find((device) => device.address === base)?.trouble;
  if (trouble) return { state: "FAULT", driver: robot.label, reason: trouble, level: "bad" };
  if (!robot.extended) {
    return { state: "STOCK PLAYER", driver: robot.label, reason: "it does not tell who drives", level: "idle" };
  }
  const motion = robot.motion(base);
  if (!motion) return { state: "…", driver: robot.label, reason: "", level: "idle" };
  const levels = { driving: "good", stopping: "warn", stopped: "idle", fault: "bad" } as const;
  const reasons = motion.state === "driving" ? [] : [motion.reason];
  if (world.halt && motion.reason.startsWith('"vision-bridge"')) reasons[0] = "HALT: the referee stopped it";
  if (robot.motorsOff) reasons.unshift("the motors are off: switch Motor power on, under Health");
  else if (robot.refusal && now - robot.refusal.at < REFUSAL_MS && (drives || motion.state === "stopped"))
    reasons.unshift(robot.refusal.text);
  if (robot.driver(base)?.hung) reasons.unshift("its driver hangs");
  const { mission, planner } = robot;
  if (planner && mission && motion.state === "stopped" && !motion.owner && mission.state !== "running")
    reasons.unshift(`mission ${mission.state}${mission.reason && `: ${mission.reason}`}`);
  return {
    state: motion.state.toUpperCase(),
    driver: `${robot.label} · driven by ${driverOf(robot, motion, myName)}`,
    reason: reasons.join(" · "),
    level: reasons.some((reason) => /^no command for| refused: |^the motors are off/.test(reason))
      ? "warn"
      : levels[motion.state],
  };
}
const REFUSAL_MS = 6000; // the server tells of refusals once in five seconds

function driverOf(robot: Robot, motion: Motion, myName: string): string {
  const { planner } = robot;
  const mission = planner ? robot.motion(planner, "mission") : undefined;
  const who = ({ owner, owner_priority }: Motion) =>
    owner === myName ? "you" : owner ? `${owner} (priority ${owner_priority})` : "nobody";
  if (planner && mission?.owner && motion.owner === robot.driver(planner)?.name)
    return `${planner} for ${who(mission)}`;
  return who(motion);
}

/** Whom to take it from, or to give it back: the base, or the mission that drives it, has an owner. */
export function owners(robot: Robot | null): string[] {
  if (!robot?.base) return [];
  const motions = [robot.motion(robot.base), robot.planner ? robot.motion(robot.planner, "mission") : undefined];
  return motions.flatMap((motion) => (motion?.owner ? [motion.owner] : []));
}
