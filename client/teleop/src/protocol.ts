// SPDX-License-Identifier: Apache-2.0
// What page and gateway say to each other; client/python/regista/teleop is the other side.

export interface Velocity {
  x: number; // m/s ahead
  y: number; // m/s to the left
  w: number; // rad/s counter-clockwise
}

export type Point = [x: number, y: number, heading: number | null]; // m, m, rad

export interface Device {
  address: string;
  driver: string;
  trouble?: string;
  size?: [length: number, width: number]; // m
  limits?: { kick_speed_mps: number; chip_speed_mps: number; chip_angle_max_rad: number; dribbler_radps: number };
}

export interface Motion {
  group: string;
  state: "stopped" | "driving" | "stopping" | "fault";
  owner: string;
  owner_priority: number;
  lease_s: number;
  reason: string;
}

export interface Driver {
  name: string;
  open: boolean;
  hung: boolean;
  rate_hz: number;
  beats_missed: number;
  jitter_us: { p50: number; p99: number; max: number };
  faults: number;
  devices: { device: string; motion: Motion[] }[];
}

/** Of a planner, or else of a base. */
export interface Mission {
  points: Point[];
  index: number;
  state: "running" | "paused" | "done" | "failed";
  reason: string;
  alone: boolean;
}

export interface Field {
  length_m: number; // of the playing field, along x
  width_m: number; // along y
  boundary_m: number; // around it
}

/** A recording that is played as a robot. */
export interface Playing {
  robot: number;
  file: string;
  at: number; // s
  length: number; // s
  rate: number; // of the time that it took, 0: pause
}

type FromRobot = { robot: number };

export type FromGateway =
  | { t: "hello"; name: string; playable: string[] }
  | { t: "controls"; yours: boolean; taken: boolean }
  | (FromRobot & {
      t: "robot";
      label: string;
      connected: boolean;
      why: string;
      extended?: boolean;
      devices: Device[];
      streams: { device: string; name: string; paths: string[] }[];
    })
  | (FromRobot & { t: "gone" })
  | (FromRobot & { t: "status"; round_trip_s: number; drivers: Driver[]; vision?: string; place?: string })
  | (FromRobot & { t: "event"; severity: number; text: string })
  | (FromRobot & { t: "mission"; device: string } & Mission)
  // Of each stream that has news: its number, age [s] and values.
  | { t: "frame"; at: number; robots: [robot: number, rows: (number | null)[][]][] }
  | { t: "vision"; field?: Field; ball?: [x: number, y: number]; why: string; halt?: boolean }
  | { t: "recording"; files: string[]; bytes: number; dropped: number; trouble: string }
  | ({ t: "playing" } & Playing)
  | { t: "playable"; files: string[] }
  | { t: "stopped" } // somebody pressed STOP: what is held counts no more
  | { t: "reply"; n: number; error: string | null }
  | { t: "alive"; n: number };

/** Between the page and its worker. */
export type ToWorker =
  | { open: string }
  | { hold: ({ robot: number; device: string } & Velocity) | null }
  | { visible: boolean }
  | { send: Record<string, unknown> };

export type FromWorker = { message: FromGateway } | { connected: boolean } | { roundTrip: number } | { hung: true };
