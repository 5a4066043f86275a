// SPDX-License-Identifier: Apache-2.0
// What the page knows of the robots.
import type { Device, Driver, Field, FromGateway, Mission, Motion } from "./protocol";

export interface Pose {
  x: number; // m
  y: number; // m
  heading: number; // rad
}

export interface Geographic {
  latitude: number; // degrees, north
  longitude: number; // degrees, east
}

/** Radii of curvature [m] of the ellipsoid WGS 84: along the meridian, and across it times the cosine of latitude. */
function radii(latitude: number): { north: number; east: number } {
  const [a, e2, phi] = [6378137, 6.69437999014e-3, (latitude * Math.PI) / 180];
  const w = Math.sqrt(1 - e2 * Math.sin(phi) ** 2);
  return { north: (a * (1 - e2)) / w ** 3, east: (a / w) * Math.cos(phi) };
}

/** East and north of `origin` [m]; within kilometres. */
export function toPlane(latitude: number, longitude: number, origin: Geographic): { x: number; y: number } {
  const { north, east } = radii(origin.latitude);
  const radians = Math.PI / 180;
  return { x: (longitude - origin.longitude) * radians * east, y: (latitude - origin.latitude) * radians * north };
}

/** The reverse. */
export function toEarth(x: number, y: number, origin: Geographic): Geographic {
  const { north, east } = radii(origin.latitude);
  const degrees = 180 / Math.PI;
  return { latitude: origin.latitude + (y / north) * degrees, longitude: origin.longitude + (x / east) * degrees };
}

interface Stream {
  device: string;
  name: string;
  paths: string[];
  row: (number | null)[] | null; // age [s] when it was sent, then a value for each path
  at: number; // performance.now() when it came [ms]
}

const TRACE_POINTS = 1500;
const TRACE_STEP = 0.03; // m
const TRACE_JUMP = 0.5; // m

export class Robot {
  connected = false;
  extended = true;
  why = "";
  devices: Device[] = [];
  streams: Stream[] = [];
  drivers: Driver[] = [];
  roundTrip: number | null = null; // s
  vision = ""; // what the base says of its camera
  place = ""; // what the localizer says of its sensors
  refusal: { text: string; at: number } | null = null; // the last command that was, and when [ms]
  motorsRefused = false; // a command, because they were off
  missions = new Map<string, Mission>();
  trace: { x: number; y: number }[] = [];
  chosenBase: string | null = null;
  /** In the gateway's time [s], of the newest frame with news of this robot. */
  at = 0;

  constructor(
    readonly number: number,
    public label: string,
  ) {}

  /** The newest value of a field, such as get("power:0", "voltage_v"). */
  get(device: string, path: string): number | null {
    for (const stream of this.streams) {
      if (stream.device !== device || !stream.row) continue;
      const place = stream.paths.indexOf(path);
      if (place >= 0) return stream.row[place + 1] ?? null;
    }
    return null;
  }

  /** [s] since the newest data of the device arrived at the gateway; null: none has. */
  age(device: string, now: number): number | null {
    let youngest: number | null = null;
    for (const stream of this.streams) {
      if (stream.device !== device || !stream.row) continue;
      const age = (stream.row[0] ?? 0) + (now - stream.at) / 1000;
      youngest = youngest === null ? age : Math.min(youngest, age);
    }
    return youngest;
  }

  /** Every number that it says: [device, path]. */
  fields(): [device: string, path: string][] {
    return this.streams.flatMap((stream) => stream.paths.map((path): [string, string] => [stream.device, path]));
  }

  /** The bases that may be driven: those that can belong to somebody; of a stock server, all. */
  bases(): string[] {
    const sees = [this.camera, this.localizer?.pose];
    const bases = this.devices
      .map((device) => device.address)
      .filter((address) => address.startsWith("position2d:") && !sees.includes(address));
    // Of those that can belong to somebody, a driver drives the first, and sees by the others.
    const driven = bases.filter((address) => {
      const own = this.driver(address)?.devices.filter((d) => bases.includes(d.device) && d.motion.length > 0);
      return own?.[0]?.device === address;
    });
    return driven.length > 0 ? driven : bases;
  }

  /** What fuses sensors: the devices that tell where the robot is, and how well that is known. */
  get localizer(): { pose: string; covariance: string } | null {
    const [pose, covariance] = ["position2d:", "localize:"].map(
      (start) => this.devices.find((d) => d.driver === "localizer" && d.address.startsWith(start))?.address,
    );
    return pose && covariance ? { pose, covariance } : null;
  }

  /** What drives lists of way-points; a base does it with the gateway's help. */
  get planner(): string | null {
    return this.devices.find((d) => d.address.startsWith("planner:") && !d.trouble)?.address ?? null;
  }

  /** To whom destinations go. */
  get destined(): string | null {
    return this.planner ?? this.base;
  }

  get mission(): Mission | undefined {
    return this.destined ? this.missions.get(this.destined) : undefined;
  }

  /** What tells where it is, in the frame of its destinations. */
  get placed(): string | null {
    return (this.planner && this.localizer?.pose) ?? this.base;
  }

  /** What tells where a camera saw the robot: the second base of the driver ssl_robot. */
  get camera(): string | null {
    const bases = this.devices.filter((d) => d.driver === "ssl_robot" && d.address.startsWith("position2d:"));
    return bases[1]?.address ?? null;
  }

  get base(): string | null {
    const bases = this.bases();
    return this.chosenBase && bases.includes(this.chosenBase) ? this.chosenBase : (bases[0] ?? null);
  }

  device(interface_: string): Device | undefined {
    return this.devices.find((device) => device.address.startsWith(`${interface_}:`));
  }

  driver(device: string): Driver | undefined {
    return this.drivers.find((driver) => driver.devices.some((one) => one.device === device));
  }

  motion(device: string, group = "motion"): Motion | undefined {
    const found = this.driver(device)?.devices.find((one) => one.device === device);
    return found?.motion.find((one) => one.group === group);
  }

  get pose(): Pose | null {
    const placed = this.placed;
    if (!placed) return null;
    const [x, y, heading] = ["pose.x", "pose.y", "pose.heading"].map((path) => this.get(placed, path));
    return x == null || y == null || heading == null ? null : { x, y, heading };
  }

  /** As its joints tell; of a base without, as far as it refused to drive for that. */
  get motorsOff(): boolean {
    const joints = this.device("actarray")?.address;
    const on = joints ? this.get(joints, "motors_on") : null;
    return on === null ? this.motorsRefused : on === 0;
  }

  get moves(): boolean {
    const { base } = this;
    return base !== null && ["x", "y", "w"].some((axis) => Math.abs(this.get(base, `velocity.${axis}`) ?? 0) > 0.05);
  }

  /** Where it may be: mean [m] and covariance [m²] of its position. */
  get belief(): { x: number; y: number; xx: number; yy: number; xy: number } | null {
    const device = this.localizer?.covariance ?? this.device("localize")?.address;
    if (!device) return null;
    const [x, y, xx, yy, xy] = ["mean.x", "mean.y", "var.x", "var.y", "cov.xy"].map((path) => this.get(device, path));
    return x == null || y == null || xx == null || yy == null || xy == null ? null : { x, y, xx, yy, xy };
  }

  /**
   * What its satellite receiver says [m], on a plane that touches the earth at the first fix, x east and y north; `error`:
   * its own, [m]. The receiver's driver knows that place in its field's frame; if not, the robot was there.
   */
  get fix(): { x: number; y: number; error: number } | null {
    const device = this.device("gps")?.address;
    if (!device || !this.#anchor) return null;
    const [latitude, longitude, error, quality] = ["latitude", "longitude", "horizontal_error_m", "quality"].map(
      (path) => this.get(device, path),
    );
    if (latitude == null || longitude == null || !quality) return null;
    const { x, y } = toPlane(latitude / 1e7, longitude / 1e7, this.#anchor);
    return { x: this.#anchor.x + x, y: this.#anchor.y + y, error: Math.max(0, error ?? 0) };
  }

  /** Latitude and longitude [degrees] of a place in the base's frame. */
  geographic(x: number, y: number): { latitude: number; longitude: number } | null {
    return this.#anchor && toEarth(x - this.#anchor.x, y - this.#anchor.y, this.#anchor);
  }

  #anchor: (Geographic & { x: number; y: number }) | null = null;

  #find(): void {
    const gps = this.device("gps");
    if (this.#anchor || !gps || !this.get(gps.address, "quality")) return;
    const [latitude, longitude] = [this.get(gps.address, "latitude"), this.get(gps.address, "longitude")];
    const plane = this.devices.find((d) => d.driver === gps.driver && d.address.startsWith("localize:"))?.address;
    const pose = this.pose;
    const x = plane ? this.get(plane, "mean.x") : (pose?.x ?? null);
    const y = plane ? this.get(plane, "mean.y") : (pose?.y ?? null);
    if (latitude === null || longitude === null || x === null || y === null) return;
    this.#anchor = { latitude: latitude / 1e7, longitude: longitude / 1e7, x, y };
  }

  follow(): void {
    this.#find();
    const pose = this.pose;
    if (!pose) return;
    const last = this.trace[this.trace.length - 1];
    const step = last ? Math.hypot(pose.x - last.x, pose.y - last.y) : Number.POSITIVE_INFINITY;
    if (step < TRACE_STEP) return;
    if (step > TRACE_JUMP) this.trace = []; // it was put elsewhere, or learnt where it is
    this.trace.push({ x: pose.x, y: pose.y });
    if (this.trace.length > TRACE_POINTS) this.trace.shift();
  }
}

export interface Entry {
  time: Date;
  label: string;
  severity: number; // 0 info, 1 warning, 2 error
  text: string;
}

/** All robots, and the field around them. */
export class World {
  readonly robots = new Map<number, Robot>();
  readonly log: Entry[] = [];
  field: Field | null = null;
  ball: { x: number; y: number; at: number } | null = null;
  visionTrouble = "";
  halt = false; // as the referee says
  chosen: number | null = null;

  get robot(): Robot | null {
    return this.chosen === null ? null : (this.robots.get(this.chosen) ?? null);
  }

  /** The playing field, unless the chosen robot drives elsewhere: by satellites. */
  get pitch(): Field | null {
    return this.robot?.device("gps") ? null : this.field;
  }

  /** Those on the same map as the chosen one. */
  get around(): Robot[] {
    const all = [...this.robots.values()];
    return this.field ? all.filter((robot) => !robot.device("gps") === !this.robot?.device("gps")) : all;
  }

  /** A robot's label, without the host where all have the same. */
  short(robot: Robot): string {
    const split = (label: string) => /^(\[.*\]|[^:]*):(\d+)$/.exec(label); // HOST:PORT, [IPv6]:PORT
    const [, host, port] = split(robot.label) ?? [];
    const hosts = [...this.robots.values()].map((other) => split(other.label)?.[1]).filter(Boolean);
    const same = hosts.length > 1 && hosts.every((other) => other === host);
    return port && same ? port : robot.label;
  }

  note(label: string, severity: number, text: string): void {
    this.log.push({ time: new Date(), label, severity, text });
    if (this.log.length > 200) this.log.shift();
  }

  /** Take in what the gateway says; what concerns no robot is left to the caller. */
  take(message: FromGateway, now: number): void {
    switch (message.t) {
      case "robot": {
        let robot = this.robots.get(message.robot);
        if (!robot) {
          robot = new Robot(message.robot, message.label);
          this.robots.set(message.robot, robot);
          this.chosen ??= message.robot;
        }
        if (robot.connected !== message.connected) {
          this.note(message.label, message.connected ? 0 : 2, message.connected ? "connected" : message.why);
        }
        robot.connected = message.connected;
        robot.why = message.why;
        robot.extended = message.extended ?? true;
        robot.devices = message.devices;
        robot.streams = message.streams.map((stream) => ({ ...stream, row: null, at: 0 }));
        if (!message.connected) {
          robot.drivers = [];
          robot.roundTrip = null;
        }
        break;
      }
      case "gone":
        this.robots.delete(message.robot);
        if (this.chosen === message.robot) this.chosen = this.robots.keys().next().value ?? null;
        break;
      case "status": {
        const robot = this.robots.get(message.robot);
        if (!robot) break;
        robot.drivers = message.drivers;
        robot.roundTrip = message.round_trip_s;
        robot.vision = message.vision ?? "";
        robot.place = message.place ?? "";
        if (robot.moves) robot.motorsRefused = false;
        break;
      }
      case "event": {
        const robot = this.robots.get(message.robot);
        this.note(robot?.label ?? "", message.severity, message.text);
        if (robot && [robot.base, robot.planner].some((device) => message.text.startsWith(`${device} refused: `))) {
          robot.refusal = { text: message.text, at: now };
          robot.motorsRefused ||= /motors are off/.test(message.text);
        }
        break;
      }
      case "mission": {
        const missions = this.robots.get(message.robot)?.missions;
        if (message.points.length > 0) missions?.set(message.device, message);
        else missions?.delete(message.device);
        break;
      }
      case "frame":
        for (const [number, rows] of message.robots) {
          const robot = this.robots.get(number);
          if (!robot) continue;
          robot.at = message.at;
          for (const [place, ...row] of rows) {
            const stream = robot.streams[place ?? -1];
            if (!stream) continue;
            stream.row = row;
            stream.at = now;
          }
          robot.follow();
        }
        break;
      case "vision":
        if (message.field) this.field = message.field;
        if (message.ball) this.ball = { x: message.ball[0], y: message.ball[1], at: now };
        this.visionTrouble = message.why;
        this.halt = message.halt ?? false;
        break;
    }
  }
}
