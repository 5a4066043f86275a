// SPDX-License-Identifier: Apache-2.0
// The map: a field or a grid of metres, what is on it, and the mouse or fingers that point at it.
import type { Field, Point } from "./protocol";
import type { Pose, Robot, World } from "./robots";

export type Tool = "look" | "go" | "points";

const ROBOT_SIZE = 0.18; // m, of a robot that does not tell
// Rules of the Small Size League 2025, 2.1: fields of divisions A and B [m].
const CIRCLE = 0.5;
const GOAL_DEPTH = 0.18;
const LARGE = 10.5; // between the lengths of B and A
const DIVISION_A = { depth: 1.8, span: 3.6, goal: 1.8 };
const DIVISION_B = { depth: 1.0, span: 2.0, goal: 1.0 };
const SMALLEST = 12; // px: a robot is never drawn smaller
const TOOLS_PX = 52; // of the map, under the buttons at its top
const COLORS = ["#3b9cff", "#ffb02e", "#35c28d", "#ff6b8b", "#b38cff", "#2cc5d2", "#e58a3a", "#9bc53d"];

export function color(number: number): string {
  return COLORS[number % COLORS.length] as string;
}

/** Half axes [m] and direction [rad] of the ellipse that holds 95 % of a normal distribution. */
export function ellipse(c: { xx: number; yy: number; xy: number }): { a: number; b: number; angle: number } {
  const mean = (c.xx + c.yy) / 2;
  const difference = Math.hypot((c.xx - c.yy) / 2, c.xy);
  const quantile = 5.991; // of chi-squared with two degrees of freedom
  return {
    a: Math.sqrt(Math.max(0, mean + difference) * quantile),
    b: Math.sqrt(Math.max(0, mean - difference) * quantile),
    angle: Math.atan2(2 * c.xy, c.xx - c.yy) / 2,
  };
}

/** A round number of metres near to `wanted`: 1, 2 or 5 times a power of ten. */
export function roundLength(wanted: number): number {
  const power = 10 ** Math.floor(Math.log10(wanted));
  const factor = wanted / power;
  return power * (factor < 1.5 ? 1 : factor < 3.5 ? 2 : factor < 7.5 ? 5 : 10);
}

export class FieldMap {
  tool: Tool = "look";
  /** Way-points that are being drawn. */
  draft: Point[] = [];
  onGo: (point: Point) => void = () => {};
  onDraft: () => void = () => {};
  onChoose: (robot: number) => void = () => {};

  #context: CanvasRenderingContext2D;
  #centre = { x: 0, y: 0 }; // m, in the middle
  #scale = 100; // px/m
  #fitted = false;
  #pitch: Field | null = null; // that was fitted
  #width = 0; // px
  #height = 0;
  #pointers = new Map<number, { x: number; y: number }>();
  #aim: { from: { x: number; y: number }; to: { x: number; y: number } } | null = null; // m
  #moved = false;
  #style!: Record<string, string>;

  constructor(
    readonly canvas: HTMLCanvasElement,
    readonly world: World,
  ) {
    this.#context = canvas.getContext("2d") as CanvasRenderingContext2D;
    this.restyle();
    new ResizeObserver(() => this.#resize()).observe(canvas);
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#up(event));
    canvas.addEventListener("pointercancel", (event) => this.#cancel(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
      },
      { passive: false },
    );
  }

  /** After the theme has changed. */
  restyle(): void {
    const style = getComputedStyle(document.documentElement);
    const names = ["field", "on-field", "card", "grid", "grid-strong", "line", "text", "muted", "accent", "on-accent"];
    this.#style = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }

  zoom(factor: number, x = this.#width / 2, y = this.#height / 2): void {
    const before = this.#toWorld(x, y);
    this.#scale = Math.max(2, Math.min(2000, this.#scale * factor));
    const after = this.#toWorld(x, y);
    this.#centre.x += before.x - after.x;
    this.#centre.y += before.y - after.y;
  }

  /** Everything that is known, in view. */
  fit(): void {
    const points: { x: number; y: number }[] = [];
    for (const robot of this.world.around) {
      if (robot.pose) points.push(robot.pose);
      for (const mission of robot.missions.values()) for (const [x, y] of mission.points) points.push({ x, y });
    }
    const field = this.world.pitch;
    if (field) {
      const [x, y] = [field.length_m / 2 + field.boundary_m, field.width_m / 2 + field.boundary_m];
      points.push({ x, y }, { x: -x, y: -y });
    }
    if (points.length === 0) points.push({ x: 0, y: 0 });
    const [left, right] = [Math.min(...points.map((p) => p.x)), Math.max(...points.map((p) => p.x))];
    const [bottom, top] = [Math.min(...points.map((p) => p.y)), Math.max(...points.map((p) => p.y))];
    this.#centre = { x: (left + right) / 2, y: (bottom + top) / 2 };
    const margin = field ? 0.05 : 1.2; // m
    const across = Math.max(right - left + 2 * margin, field ? 0 : 4);
    const along = Math.max(top - bottom + 2 * margin, field ? 0 : 3);
    const above = field ? TOOLS_PX : 0;
    this.#scale = Math.max(2, Math.min(2000, this.#width / across, (this.#height - above) / along));
    this.#centre.y += above / 2 / this.#scale;
  }

  /** Where on the page a place of the world is [CSS px from the canvas]. */
  toScreen(x: number, y: number): { x: number; y: number } {
    return {
      x: this.#width / 2 + (x - this.#centre.x) * this.#scale,
      y: this.#height / 2 - (y - this.#centre.y) * this.#scale,
    };
  }

  #toWorld(x: number, y: number): { x: number; y: number } {
    return {
      x: this.#centre.x + (x - this.#width / 2) / this.#scale,
      y: this.#centre.y - (y - this.#height / 2) / this.#scale,
    };
  }

  #resize(): void {
    const ratio = window.devicePixelRatio || 1;
    this.#width = this.canvas.clientWidth;
    this.#height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.#width * ratio);
    this.canvas.height = Math.round(this.#height * ratio);
    this.#context.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (this.#fitted) this.fit();
  }

  // Pointers

  #down(event: PointerEvent): void {
    this.canvas.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
    this.#moved = false;
    this.#aim = null;
    if (this.#pointers.size === 1 && event.button === 0 && this.tool !== "look") {
      const at = this.#toWorld(event.offsetX, event.offsetY);
      this.#aim = { from: at, to: at };
    }
  }

  #move(event: PointerEvent): void {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const now = { x: event.offsetX, y: event.offsetY };
    if (Math.hypot(now.x - before.x, now.y - before.y) > 3) this.#moved = true;
    if (this.#aim) {
      this.#aim.to = this.#toWorld(now.x, now.y);
      return;
    }
    if (!this.#moved) return;
    if (this.#pointers.size === 2) {
      const [other] = [...this.#pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (other) {
        const factor =
          Math.hypot(now.x - other.x, now.y - other.y) / Math.hypot(before.x - other.x, before.y - other.y);
        if (Number.isFinite(factor) && factor > 0) this.zoom(factor, other.x, other.y);
      }
    } else {
      this.#centre.x -= (now.x - before.x) / this.#scale;
      this.#centre.y += (now.y - before.y) / this.#scale;
    }
    this.#pointers.set(event.pointerId, now);
  }

  #up(event: PointerEvent): void {
    if (!this.#pointers.delete(event.pointerId)) return;
    if (this.#aim) {
      const { from, to } = this.#aim;
      this.#aim = null;
      const drag = Math.hypot(to.x - from.x, to.y - from.y) * this.#scale;
      const point: Point = [from.x, from.y, drag > 12 ? Math.atan2(to.y - from.y, to.x - from.x) : null];
      if (this.tool === "go") this.onGo(point);
      else {
        this.draft.push(point);
        this.onDraft();
      }
    } else if (!this.#moved) {
      const robot = this.#at(event.offsetX, event.offsetY);
      if (robot) this.onChoose(robot.number);
    }
  }

  #cancel(event: PointerEvent): void {
    this.#pointers.delete(event.pointerId);
    this.#aim = null;
  }

  #at(x: number, y: number): Robot | null {
    for (const robot of this.world.around) {
      if (!robot.pose) continue;
      const at = this.toScreen(robot.pose.x, robot.pose.y);
      if (Math.hypot(at.x - x, at.y - y) < Math.max(20, ROBOT_SIZE * this.#scale)) return robot;
    }
    return null;
  }

  // Drawing

  draw(now: number): void {
    const context = this.#context;
    if (this.#pitch !== this.world.pitch) {
      this.#pitch = this.world.pitch;
      this.#fitted = false;
    }
    if (!this.#fitted && this.#width > 0 && (this.world.pitch || this.world.around.some((r) => r.pose))) {
      this.#fitted = true;
      this.fit();
    }
    context.clearRect(0, 0, this.#width, this.#height);
    if (this.world.pitch) this.#field();
    else this.#grid();
    for (const robot of this.world.around) this.#trace(robot);
    for (const robot of this.world.around) this.#missions(robot);
    this.#points(this.draft, -1, this.#style.accent as string, null);
    if (this.world.pitch) this.#ball(now);
    for (const robot of this.world.around) this.#robot(robot, now);
    if (this.#aim) this.#goal([this.#aim.from.x, this.#aim.from.y, this.#heading()], this.#style.accent as string);
    this.#ruler();
  }

  #heading(): number | null {
    if (!this.#aim) return null;
    const { from, to } = this.#aim;
    if (Math.hypot(to.x - from.x, to.y - from.y) * this.#scale <= 12) return null;
    return Math.atan2(to.y - from.y, to.x - from.x);
  }

  #grid(): void {
    const context = this.#context;
    const step = roundLength(60 / this.#scale);
    const low = this.#toWorld(0, this.#height);
    const high = this.#toWorld(this.#width, 0);
    context.lineWidth = 1;
    for (let i = Math.ceil(low.x / step); i * step <= high.x; i += 1) {
      context.strokeStyle = (i % 5 === 0 ? this.#style["grid-strong"] : this.#style.grid) as string;
      const x = Math.round(this.toScreen(i * step, 0).x) + 0.5;
      this.#line(x, 0, x, this.#height);
    }
    for (let i = Math.ceil(low.y / step); i * step <= high.y; i += 1) {
      context.strokeStyle = (i % 5 === 0 ? this.#style["grid-strong"] : this.#style.grid) as string;
      const y = Math.round(this.toScreen(0, i * step).y) + 0.5;
      this.#line(0, y, this.#width, y);
    }
    const origin = this.toScreen(0, 0);
    context.lineWidth = 2;
    context.strokeStyle = "#e5484d";
    this.#line(origin.x, origin.y, origin.x + 24, origin.y);
    context.strokeStyle = "#35c28d";
    this.#line(origin.x, origin.y, origin.x, origin.y - 24);
  }

  #field(): void {
    const field = this.world.pitch;
    if (!field) return;
    const context = this.#context;
    const scale = this.#scale;
    const [length, width, boundary] = [field.length_m, field.width_m, field.boundary_m];
    const box = (x: number, y: number, across: number, along: number): [number, number, number, number] => {
      const corner = this.toScreen(x, y);
      return [corner.x, corner.y, across * scale, along * scale];
    };
    context.fillStyle = this.#style.field as string;
    context.beginPath();
    context.roundRect(
      ...box(-length / 2 - boundary, width / 2 + boundary, length + 2 * boundary, width + 2 * boundary),
      8,
    );
    context.fill();
    context.strokeStyle = this.#style.line as string;
    context.lineWidth = Math.max(1, 0.01 * scale);
    context.strokeRect(...box(-length / 2, width / 2, length, width));
    const [top, bottom] = [this.toScreen(0, width / 2), this.toScreen(0, -width / 2)];
    this.#line(top.x, top.y, bottom.x, bottom.y);
    const middle = this.toScreen(0, 0);
    context.beginPath();
    context.arc(middle.x, middle.y, CIRCLE * scale, 0, 2 * Math.PI);
    context.stroke();
    const { depth, span, goal } = length > LARGE ? DIVISION_A : DIVISION_B;
    for (const side of [-1, 1]) {
      context.strokeStyle = this.#style.line as string;
      context.lineWidth = Math.max(1, 0.01 * scale);
      context.strokeRect(...box((side * length) / 2, span / 2, -side * depth, span));
      context.strokeStyle = side < 0 ? "#ffd23f" : "#3b9cff";
      context.lineWidth = Math.max(2, 0.02 * scale);
      context.strokeRect(...box((side * length) / 2, goal / 2, side * GOAL_DEPTH, goal));
    }
  }

  #line(x1: number, y1: number, x2: number, y2: number): void {
    this.#context.beginPath();
    this.#context.moveTo(x1, y1);
    this.#context.lineTo(x2, y2);
    this.#context.stroke();
  }

  #trace(robot: Robot): void {
    if (robot.trace.length < 2) return;
    const context = this.#context;
    context.strokeStyle = color(robot.number);
    context.globalAlpha = robot.number === this.world.chosen ? 0.65 : 0.3;
    context.lineWidth = 2;
    context.lineJoin = "round";
    context.beginPath();
    for (const point of robot.trace) {
      const at = this.toScreen(point.x, point.y);
      context.lineTo(at.x, at.y);
    }
    if (robot.pose) {
      const at = this.toScreen(robot.pose.x, robot.pose.y);
      context.lineTo(at.x, at.y);
    }
    context.stroke();
    context.globalAlpha = 1;
  }

  #missions(robot: Robot): void {
    for (const [device, mission] of robot.missions) {
      if (mission.state === "done") continue;
      const start = device === robot.destined ? robot.pose : null;
      this.#points(mission.points, mission.index, color(robot.number), start);
    }
  }

  #points(points: Point[], next: number, paint: string, start: Pose | null): void {
    const context = this.#context;
    if (points.length === 0) return;
    context.strokeStyle = paint;
    context.lineWidth = 2;
    context.setLineDash([6, 6]);
    context.beginPath();
    if (start) {
      const at = this.toScreen(start.x, start.y);
      context.moveTo(at.x, at.y);
    }
    for (const [x, y] of points.slice(Math.max(0, next))) {
      const at = this.toScreen(x, y);
      context.lineTo(at.x, at.y);
    }
    context.stroke();
    context.setLineDash([]);
    points.forEach((point, i) => {
      context.globalAlpha = i < next ? 0.35 : 1;
      this.#goal(point, paint, points.length > 1 ? String(i + 1) : "");
      context.globalAlpha = 1;
    });
  }

  #goal([x, y, heading]: Point, paint: string, text = ""): void {
    const context = this.#context;
    const at = this.toScreen(x, y);
    context.strokeStyle = paint;
    context.fillStyle = paint;
    context.lineWidth = 2;
    context.beginPath();
    context.arc(at.x, at.y, text ? 11 : 9, 0, 2 * Math.PI);
    if (text) context.fill();
    else context.stroke();
    if (heading !== null) {
      const [dx, dy] = [Math.cos(heading), -Math.sin(heading)];
      this.#line(at.x + dx * 9, at.y + dy * 9, at.x + dx * 26, at.y + dy * 26);
      context.beginPath();
      context.moveTo(at.x + dx * 30, at.y + dy * 30);
      context.lineTo(at.x + dx * 22 - dy * 5, at.y + dy * 22 + dx * 5);
      context.lineTo(at.x + dx * 22 + dy * 5, at.y + dy * 22 - dx * 5);
      context.fill();
    }
    if (text) {
      context.fillStyle = paint === this.#style.accent ? (this.#style["on-accent"] as string) : "#0b0f14";
      context.font = "700 11px system-ui, sans-serif";
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.fillText(text, at.x, at.y + 0.5);
    }
  }

  #ball(now: number): void {
    const ball = this.world.ball;
    if (!ball || now - ball.at > 2000) return;
    const context = this.#context;
    const at = this.toScreen(ball.x, ball.y);
    context.globalAlpha = now - ball.at > 200 ? 0.4 : 1;
    context.fillStyle = "#ff8a1f";
    context.strokeStyle = "#7a3a00";
    context.lineWidth = 1;
    context.beginPath();
    context.arc(at.x, at.y, Math.max(4, 0.0215 * this.#scale), 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    context.globalAlpha = 1;
  }

  #robot(robot: Robot, now: number): void {
    const pose = robot.pose;
    if (!pose || !robot.base) return;
    const context = this.#context;
    const at = this.toScreen(pose.x, pose.y);
    const size = robot.devices.find((device) => device.address === robot.base)?.size ?? [ROBOT_SIZE, ROBOT_SIZE];
    const [length, width] = size.map((side) => Math.max(SMALLEST, ((side || ROBOT_SIZE) / 2) * this.#scale)) as [
      number,
      number,
    ];
    const chosen = robot.number === this.world.chosen;
    const age = robot.age(robot.placed ?? robot.base, now);
    const stale = !robot.connected || age === null || age > 0.5;

    const belief = robot.belief;
    if (belief) {
      const { a, b, angle } = ellipse(belief);
      const centre = this.toScreen(belief.x, belief.y);
      context.beginPath();
      context.ellipse(centre.x, centre.y, a * this.#scale, b * this.#scale, -angle, 0, 2 * Math.PI);
      context.fillStyle = color(robot.number);
      context.globalAlpha = 0.15;
      context.fill();
      context.globalAlpha = 0.8;
      context.strokeStyle = color(robot.number);
      context.lineWidth = 1.5;
      context.stroke();
      context.globalAlpha = 1;
    }

    const fix = robot.fix;
    if (fix) {
      const there = this.toScreen(fix.x, fix.y);
      context.strokeStyle = color(robot.number);
      context.lineWidth = 1.5;
      this.#line(there.x - 6, there.y, there.x + 6, there.y);
      this.#line(there.x, there.y - 6, there.x, there.y + 6);
      context.setLineDash([3, 4]);
      context.beginPath();
      context.arc(there.x, there.y, fix.error * this.#scale, 0, 2 * Math.PI);
      context.stroke();
      context.setLineDash([]);
    }

    context.save();
    context.translate(at.x, at.y);
    context.rotate(-pose.heading);
    context.globalAlpha = stale ? 0.35 : 1;
    if (chosen) {
      context.beginPath();
      context.arc(0, 0, Math.max(length, width) * 1.3 + 5, 0, 2 * Math.PI);
      context.strokeStyle = this.#style.accent as string;
      context.lineWidth = 2;
      context.stroke();
    }
    context.fillStyle = color(robot.number);
    context.beginPath();
    if (Math.abs(length - width) < 1) {
      const flat = 0.65; // rad: half of the front that is cut off
      context.arc(0, 0, length, flat, 2 * Math.PI - flat);
      context.closePath();
    } else {
      context.roundRect(-length, -width, 2 * length, 2 * width, Math.min(length, width) * 0.3);
    }
    context.fill();
    context.strokeStyle = "#0b0f14";
    context.lineWidth = 1.5;
    context.stroke();
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(length * 0.1, -width * 0.35);
    context.lineTo(length * 0.6, 0);
    context.lineTo(length * 0.1, width * 0.35);
    context.stroke();
    context.restore();

    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "top";
    const ink = this.world.pitch ? "on-field" : stale ? "muted" : "text";
    context.fillStyle = this.#style[ink] as string;
    const seconds = age === null ? "" : ` · ${age < 10 ? age.toFixed(1) : age.toFixed(0)} s old`;
    const label = this.world.short(robot) + (stale ? seconds : "");
    context.strokeStyle = (this.world.pitch ? this.#style.field : this.#style.card) as string;
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeText(label, at.x, at.y + Math.max(length, width) * 1.3 + 9);
    context.fillText(label, at.x, at.y + Math.max(length, width) * 1.3 + 9);
  }

  #ruler(): void {
    const context = this.#context;
    const metres = roundLength(90 / this.#scale);
    const [x, y, pixels] = [14, this.#height - 14, metres * this.#scale];
    context.strokeStyle = this.#style.text as string;
    context.fillStyle = this.#style.text as string;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x, y - 5);
    context.lineTo(x, y);
    context.lineTo(x + pixels, y);
    context.lineTo(x + pixels, y - 5);
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "bottom";
    context.fillText(metres >= 1 ? `${metres} m` : `${Math.round(metres * 100)} cm`, x + 5, y - 5);
  }
}
