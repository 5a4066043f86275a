// SPDX-License-Identifier: Apache-2.0
import "./style.css";
import { button, element, isPressed, make, press, setText } from "./dom";
import { Grip, isDirection, keysVelocity, type Limits, stickVelocity } from "./input";
import { color, FieldMap, type Tool } from "./map";
import { Pad } from "./pad";
import { Plots } from "./plots";
import type { FromGateway, FromWorker, Playing, Point, ToWorker, Velocity } from "./protocol";
import { type Entry, type Robot, World } from "./robots";
import { battery, fixed, milliseconds, owners, several, standing } from "./standing";

// ---- The gateway

const worker = new Worker(new URL("./worker.ts", import.meta.url), { type: "module" });
const world = new World();
const map = new FieldMap(element<HTMLCanvasElement>("canvas"), world);
const plots = new Plots(element("chart"), world);

let connected = false;
let everConnected = false;
let myName = "";
let yours = false;
let taken = false;
let pageRoundTrip: number | null = null; // ms
let recording: { files: string[]; bytes: number; dropped: number; trouble: string } | null = null;
let playable: string[] = [];
let playing: Playing | null = null;
let questions = 0;
const answers = new Map<number, (error: string | null) => void>();

function tellWorker(message: ToWorker): void {
  worker.postMessage(message);
}

/** What wants an answer; a refusal is shown. */
function ask(message: Record<string, unknown>, then: () => void = () => {}): void {
  questions += 1;
  answers.set(questions, (error) => {
    if (error) {
      world.note(world.robot?.label ?? "", 1, error);
      drawLog();
    } else then();
  });
  tellWorker({ send: { ...message, n: questions } });
}

/** Of the chosen robot. */
function askRobot(t: string, device: string | null | undefined, more: Record<string, unknown> = {}): void {
  if (world.robot && device) ask({ t, robot: world.robot.number, device, ...more });
}

worker.onmessage = (event: MessageEvent<FromWorker>) => {
  const from = event.data;
  if ("connected" in from) {
    connected = from.connected;
    everConnected ||= connected;
    if (!connected) {
      loseGrip();
      answers.clear();
      for (const robot of world.robots.values()) robot.connected = false;
    }
    drawPanels();
  } else if ("roundTrip" in from) {
    pageRoundTrip = from.roundTrip;
  } else if ("hung" in from) {
    loseGrip();
    world.note("", 1, "this page hung while it drove, and the robot stopped: let go, then drive again");
    drawLog();
  } else {
    take(from.message);
  }
};

function take(message: FromGateway): void {
  // What is held must not jump to the next robot.
  if (message.t === "gone" && message.robot === world.chosen) loseGrip();
  if (message.t === "hello") wanted = world.robot?.label ?? wanted;
  world.take(message, performance.now());
  switch (message.t) {
    case "hello":
      myName = message.name;
      world.robots.clear();
      world.chosen = null;
      playing = null;
      break;
    case "controls":
      yours = message.yours;
      taken = message.taken;
      if (!yours) loseGrip();
      drawPanels();
      break;
    case "robot":
    case "gone":
      if (message.t === "robot" && message.label === wanted) {
        wanted = "";
        if (world.chosen !== message.robot) choose(message.robot);
      }
      if (message.t === "gone" && message.robot === playing?.robot) playing = null;
      drawRobots();
      drawFields();
      drawPanels();
      drawRecording();
      drawPlayer();
      drawLog();
      if (message.t === "robot" && message.connected) suggestPlot();
      break;
    case "stopped":
      loseGrip();
      break;
    case "event":
      drawLog();
      break;
    case "mission":
      drawMission();
      break;
    case "frame":
      if (!plots.paused) plots.sample(message.at);
      break;
    case "recording":
      recording = message.files.length > 0 ? message : null;
      drawRecording();
      break;
    case "playing":
      playing = message;
      drawPlayer();
      break;
    case "playable":
      playable = message.files;
      drawRecording();
      break;
    case "reply": {
      const answer = answers.get(message.n);
      answers.delete(message.n);
      answer?.(message.error);
      break;
    }
  }
}

// ---- Driving by hand

const grip = new Grip();
const keys = new Set<string>();
const stick = { on: false, right: 0, up: 0 };
let drives: Velocity | null = null;
let wanted = ""; // the robot to choose again when the gateway is back

function limits(): Limits {
  return {
    speed: Number(element<HTMLInputElement>("speed").value),
    turn: Number(element<HTMLInputElement>("turn").value),
  };
}

/** The page hides, loses the keyboard, or another robot is chosen: nothing is held any more. */
function loseGrip(): void {
  grip.lose();
  keys.clear();
  stick.on = false;
  drawStick();
  hold();
}

/** Say what is held, now. */
function hold(): void {
  grip.set("keys", keysVelocity(keys, limits()));
  grip.set("stick", stick.on ? stickVelocity(stick.right, stick.up, limits(), isPressed("sideways")) : null);
  const robot = world.robot;
  const device = robot?.base;
  drives = robot && device && connected && yours && !document.hidden ? grip.velocity : null;
  tellWorker({ hold: drives && robot && device ? { robot: robot.number, device, ...drives } : null });
}

function stopAll(): void {
  loseGrip();
  if (!connected) {
    world.note("", 2, "STOP was not sent: there is no gateway");
    drawLog();
  }
  ask({ t: "stop", robot: null });
}

function types(target: EventTarget | null): boolean {
  return target instanceof HTMLInputElement || target instanceof HTMLSelectElement;
}

window.addEventListener(
  "keydown",
  (event) => {
    if (event.code === "Space") {
      // Whatever has the focus: enter presses buttons.
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) stopAll();
      return;
    }
    if (types(event.target) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (isDirection(event.code) || event.code.startsWith("Shift") || event.code === "KeyC") {
      if (isDirection(event.code)) event.preventDefault();
      if (event.repeat) return;
      keys.add(event.code);
      hold();
    }
  },
  true,
);
window.addEventListener("keyup", (event) => {
  if (event.code === "Space") event.preventDefault();
  if (keys.delete(event.code)) hold();
});
window.addEventListener("blur", loseGrip);
// A menu that is open keeps for itself that a key was let go.
window.addEventListener("contextmenu", loseGrip, true);
window.addEventListener("focusin", (event) => {
  if (types(event.target)) loseGrip();
});
window.addEventListener("pagehide", () => {
  loseGrip();
  tellWorker({ visible: false });
});
window.addEventListener("pageshow", () => tellWorker({ visible: !document.hidden }));
document.addEventListener("visibilitychange", () => {
  if (document.hidden) loseGrip();
  tellWorker({ visible: !document.hidden });
});

// The stick

const stickArea = element("stick");
function moveStick(event: PointerEvent): void {
  const box = stickArea.getBoundingClientRect();
  const [right, up] = [
    (event.clientX - box.left - box.width / 2) / (box.width * 0.36),
    -(event.clientY - box.top - box.height / 2) / (box.height * 0.36),
  ];
  const length = Math.max(1, Math.hypot(right, up));
  stick.right = right / length;
  stick.up = up / length;
  drawStick();
  hold();
}
function drawStick(): void {
  const [x, y] = stick.on ? [stick.right * 36, -stick.up * 36] : [0, 0];
  element("knob").style.transform = `translate(${x}px, ${y}px)`;
  stickArea.classList.toggle("held", stick.on);
}
let stickPointer = -1;
stickArea.addEventListener("contextmenu", (event) => event.preventDefault());
stickArea.addEventListener("pointerdown", (event) => {
  if (event.button !== 0 || stick.on) return;
  stickPointer = event.pointerId;
  stickArea.setPointerCapture(event.pointerId);
  grip.set("stick", null);
  stick.on = true;
  moveStick(event);
});
stickArea.addEventListener("pointermove", (event) => {
  if (stick.on && event.pointerId === stickPointer) moveStick(event);
});
for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
  stickArea.addEventListener(name, () => {
    stick.on = false;
    drawStick();
    hold();
  });
}

// The gamepad

const pad = new Pad((action) => {
  if (action === "stop") stopAll();
  else if (action === "dribble") element("dribble").click();
  else kick(action);
});
function pollPad(): void {
  grip.set("pad", pad.poll(limits()));
  hold();
}
window.addEventListener("gamepaddisconnected", pollPad);
setInterval(pollPad, 20);

// ---- Buttons

element("stop").addEventListener("click", stopAll);
element("controls").addEventListener("click", () => ask({ t: "controls" }));
element("take").addEventListener("click", () => askRobot("take", world.robot?.base));
element("give").addEventListener("click", () => askRobot("give", world.robot?.base));
element("base").addEventListener("change", () => {
  loseGrip();
  if (world.robot) {
    world.robot.chosenBase = element<HTMLSelectElement>("base").value;
    world.robot.trace = [];
  }
  drawPanels();
});
element("sideways").addEventListener("click", () => press("sideways", !isPressed("sideways")));
element("alone").addEventListener("click", () => press("alone", !isPressed("alone")));
element("motors").addEventListener("click", () => {
  const { robot } = world;
  if (!robot?.base) return;
  const on = robot.motorsOff;
  ask({ t: "motors", robot: robot.number, device: robot.base, on }, () => {
    robot.motorsRefused = !on;
    robot.refusal = null;
    drawPanels();
  });
});

function kick(action: string): void {
  const device = world.robot?.device("kicker");
  const speed = Number(element<HTMLInputElement>("kick-speed").value);
  askRobot("kick", device?.address, { action, speed, angle: Math.min(0.8, device?.limits?.chip_angle_max_rad || 0.8) });
}
element("kick").addEventListener("click", () => kick("kick"));
element("chip").addEventListener("click", () => kick("chip"));
for (const action of ["dribble", "charge"]) {
  element(action).addEventListener("click", () => {
    press(action, !isPressed(action));
    const device = world.robot?.device("kicker");
    const most = action === "charge" ? 1 : device?.limits?.dribbler_radps || 100;
    askRobot("kick", device?.address, { action, speed: isPressed(action) ? most : 0 });
  });
}

// The map

const HINTS: Record<Tool, string> = {
  look: "",
  go: "Click where the robot shall go; drag to set its heading",
  points: "Each click adds a way-point; drag to set its heading",
};
for (const tool of document.querySelectorAll<HTMLElement>("[data-tool]")) {
  tool.addEventListener("click", () => {
    map.tool = tool.dataset.tool as Tool;
    for (const other of document.querySelectorAll("[data-tool]"))
      other.setAttribute("aria-pressed", String(other === tool));
    setText("hint", HINTS[map.tool]);
    map.canvas.classList.toggle("aims", map.tool !== "look");
  });
}
element("in").addEventListener("click", () => map.zoom(1.4));
element("out").addEventListener("click", () => map.zoom(1 / 1.4));
element("fit").addEventListener("click", () => map.fit());
map.onChoose = choose;
map.onGo = (point) => go([point]);
map.onDraft = drawMission;

function choose(number: number): void {
  if (world.chosen === number) return;
  loseGrip();
  world.chosen = number;
  for (const action of ["dribble", "charge"]) press(action, false);
  map.draft = [];
  drawRobots();
  drawFields();
  drawPanels();
}

// Missions

function go(points: Point[]): void {
  const robot = world.robot;
  if (!robot?.destined || points.length === 0) return;
  ask({ t: "go", robot: robot.number, device: robot.destined, points, alone: isPressed("alone") });
}
function formPoint(): Point {
  const [x, y, heading] = ["go-x", "go-y", "go-heading"].map((id) => element<HTMLInputElement>(id).value);
  return [Number(x), Number(y), heading === "" ? null : (Number(heading) * Math.PI) / 180];
}
element("go").addEventListener("submit", (event) => {
  event.preventDefault();
  go([formPoint()]);
});
element("go-add").addEventListener("click", () => {
  map.draft.push(formPoint());
  drawMission();
});
element("mission-start").addEventListener("click", () => {
  go(map.draft);
  map.draft = [];
});
element("mission-pause").addEventListener("click", () => askRobot("pause", world.robot?.destined));
element("mission-resume").addEventListener("click", () =>
  askRobot("resume", world.robot?.destined, { alone: isPressed("alone") }),
);
element("mission-cancel").addEventListener("click", () => {
  map.draft = [];
  askRobot("cancel", world.robot?.destined);
  drawMission();
});

function describe([x, y, heading]: Point): string {
  const turn = heading === null ? "" : `, ${fixed((heading * 180) / Math.PI, 0)}°`;
  const place = world.robot?.geographic(x, y);
  const earth = place ? ` (${place.latitude.toFixed(6)}, ${place.longitude.toFixed(6)})` : "";
  return `${fixed(x, 2)}, ${fixed(y, 2)} m${turn}${earth}`;
}

function drawMission(): void {
  const robot = world.robot;
  const mission = robot?.mission;
  const drafting = map.draft.length > 0;
  const points = drafting ? map.draft : (mission?.points ?? []);
  const count = mission && mission.points.length > 1 ? ` ${mission.index} of ${mission.points.length}` : "";
  const reason = mission?.reason ? `: ${mission.reason}` : "";
  setText("mission-state", drafting ? "not sent yet" : mission ? `${mission.state}${count}${reason}` : "");
  element("mission-state").dataset.state = drafting ? "" : (mission?.state ?? "");
  element<HTMLProgressElement>("progress").hidden = drafting || !mission || mission.points.length < 2;
  element<HTMLProgressElement>("progress").value = mission ? mission.index / mission.points.length : 0;
  // Anew only when it changed: what has the focus keeps it.
  const first = drafting ? 0 : Math.max(0, (mission?.index ?? 0) - 3);
  const listed = drafting ? points : points.slice(first, first + MOST_LISTED);
  const now = JSON.stringify([drafting, first, mission?.index, listed, robot?.geographic(0, 0)]);
  if (now !== drawnPoints) drawPoints(listed, first, drafting, mission?.index ?? 0);
  drawnPoints = now;
  const show = (id: string, on: boolean) => {
    element(id).hidden = !on;
  };
  show("mission-start", drafting);
  show("mission-pause", !drafting && mission?.state === "running");
  show("mission-resume", !drafting && (mission?.state === "paused" || mission?.state === "failed"));
  show("mission-cancel", drafting || mission !== undefined);
}

const MOST_LISTED = 100;
let drawnPoints = "";
function drawPoints(points: Point[], first: number, drafting: boolean, index: number): void {
  const swap = (a: number, b: number) => {
    const [one, other] = [map.draft[a], map.draft[b]];
    if (!one || !other) return;
    map.draft[a] = other;
    map.draft[b] = one;
    drawMission();
    element("points").querySelectorAll<HTMLElement>(`[data-point="${b}"]`)[b < a ? 0 : 1]?.focus();
  };
  const list = element<HTMLOListElement>("points");
  list.start = first + 1;
  list.replaceChildren(
    ...points.map((point, i) => {
      const item = make("li");
      item.append(make("span", describe(point)));
      if (!drafting) {
        item.className = first + i < index ? "reached" : "";
        return item;
      }
      const up = button("↑", `Way-point ${i + 1} earlier`, () => swap(i, i - 1));
      const down = button("↓", `Way-point ${i + 1} later`, () => swap(i, i + 1));
      const away = button("×", `Remove way-point ${i + 1}`, () => {
        map.draft.splice(i, 1);
        drawMission();
        (element("points").querySelectorAll<HTMLElement>(`[data-point="${i}"]`)[2] ?? element("go-add")).focus();
      });
      for (const one of [up, down, away]) one.dataset.point = String(i);
      item.append(up, down, away);
      return item;
    }),
  );
}

// ---- Plots and recordings

function drawFields(): void {
  const robot = world.robot;
  const first = make("option", "Add a field …") as HTMLOptionElement;
  first.value = "";
  const options = (robot?.fields() ?? []).map(([device, path]) => {
    const option = make("option", `${device} ${path}`) as HTMLOptionElement;
    option.value = `${device} ${path}`;
    return option;
  });
  element("field").replaceChildren(first, ...options);
}
element("field").addEventListener("change", () => {
  const field = element<HTMLSelectElement>("field");
  const [device, path] = field.value.split(" ");
  if (world.robot && device && path) plots.toggle({ robot: world.robot.number, device, path });
  field.value = "";
});
function suggestPlot(): void {
  const robot = world.robot;
  if (plots.series.length > 0 || !robot?.base) return;
  for (const path of ["velocity.x", "velocity.w"]) plots.toggle({ robot: robot.number, device: robot.base, path });
}
element("plot-pause").addEventListener("click", () => {
  plots.paused = !plots.paused;
  press("plot-pause", plots.paused);
});
element("plot-reset").addEventListener("click", () => plots.reset());
element("record").addEventListener("click", () => ask({ t: "record", on: !recording }));
element("play").addEventListener("click", () => {
  const file = element<HTMLSelectElement>("recording").value;
  if (file) ask({ t: "play", file });
});
element("end-play").addEventListener("click", () => ask({ t: "end_play" }));

const playerAt = element<HTMLInputElement>("player-at");
let grabbed = false; // the slider is where the hand is
element("player-pause").addEventListener("click", () =>
  ask({ t: "steer", rate: playing?.rate === 0 ? Number(element<HTMLSelectElement>("player-rate").value) : 0 }),
);
element("player-rate").addEventListener("change", () => {
  if (playing?.rate !== 0) ask({ t: "steer", rate: Number(element<HTMLSelectElement>("player-rate").value) });
});
playerAt.addEventListener("input", () => {
  grabbed = true;
});
playerAt.addEventListener("change", () => {
  grabbed = false;
  ask({ t: "steer", at: Number(playerAt.value) });
});
function drawPlayer(): void {
  element("player").hidden = !playing;
  if (!playing) return;
  const { at, length, rate } = playing;
  press("player-pause", rate === 0);
  setText("player-pause", rate === 0 ? "Go on" : "Pause");
  playerAt.max = String(length);
  if (!grabbed) playerAt.value = String(at);
  const place = `${at.toFixed(1)} of ${length.toFixed(1)} s`;
  playerAt.setAttribute("aria-valuetext", place);
  setText("player-text", place);
}

function drawRecording(): void {
  press("record", recording !== null);
  setText("record", recording ? "■ End recording" : "● Record");
  const text = recording
    ? `${recording.files.join(", ")}: ${(recording.bytes / 1e6).toFixed(1)} MB` +
      `${recording.dropped ? `, ${recording.dropped} dropped` : ""}${recording.trouble ? `; ${recording.trouble}` : ""}`
    : "";
  setText("recorded", text);
  const select = element<HTMLSelectElement>("recording");
  const before = select.value;
  select.replaceChildren(
    ...playable.map((file) => {
      const option = make("option", file) as HTMLOptionElement;
      option.value = file;
      return option;
    }),
  );
  if (playable.includes(before)) select.value = before;
  select.hidden = playable.length === 0;
  element("play").hidden = playable.length === 0;
  element("end-play").hidden = ![...world.robots.values()].some((robot) => robot.label.endsWith(".mcap"));
}

// ---- What the page shows

function drawRobots(): void {
  element("robots").replaceChildren(
    ...[...world.robots.values()].map((robot) => {
      const chip = button("", "", () => choose(robot.number));
      chip.classList.add("chip");
      chip.dataset.robot = String(robot.number);
      chip.setAttribute("aria-pressed", String(robot.number === world.chosen));
      const dot = make("i");
      dot.style.background = color(robot.number);
      chip.append(dot, make("span", world.short(robot)), make("small"));
      chip.title = robot.label;
      return chip;
    }),
  );
}

function drawPanels(): void {
  const robot = world.robot;
  const seat = { connected, everConnected, myName, drives: drives !== null, played: playing?.robot ?? null };
  const now = standing(world, seat, performance.now());
  document.body.classList.toggle("plays", robot !== null && robot.number === playing?.robot);
  setText("state", now.state);
  element("state").dataset.level = now.level;
  setText("driver", now.driver);
  setText("reason", now.reason);
  const base = robot?.base ?? null;
  const mine = owners(robot).includes(myName);
  element("controls").hidden = !connected || yours;
  setText("controls", taken ? "Another page drives: take the controls" : "Take the controls");
  press("motors", !robot?.motorsOff);
  setText("motors", robot?.motorsOff ? "Motor power: off" : "Motor power: on");
  element("take").hidden = !yours || owners(robot).length === 0 || mine;
  element("give").hidden = !yours || !mine;
  const select = element<HTMLSelectElement>("base");
  const bases = robot?.bases() ?? [];
  select.hidden = bases.length < 2;
  if ([...select.options].map((option) => option.value).join() !== bases.join()) {
    select.replaceChildren(...bases.map((address) => new Option(address, address)));
  }
  if (base) select.value = base;
  document.body.classList.toggle("offline", !connected);

  const link = robot?.roundTrip != null ? milliseconds(robot.roundTrip * 1000) : "–";
  setText(
    "link",
    connected ? `robot ${link} · page ${pageRoundTrip === null ? "–" : milliseconds(pageRoundTrip)}` : "",
  );
  for (const chip of document.querySelectorAll<HTMLElement>("[data-robot]")) {
    const one = world.robots.get(Number(chip.dataset.robot));
    if (!one) continue;
    chip.classList.toggle("lost", !one.connected);
    const small = chip.querySelector("small") as HTMLElement;
    const percent = battery(one).percent;
    const text = !one.connected ? "lost" : percent === null ? "" : `${percent.toFixed(0)} %`;
    if (small.textContent !== text) small.textContent = text;
  }

  element("kicker").hidden = !robot?.device("kicker");
  element("relays").hidden = !robot?.device("dio");
  setText("speed-text", `${limits().speed.toFixed(1)} m/s`);
  setText("turn-text", `${limits().turn.toFixed(1)} rad/s`);
  setText("kick-text", `${Number(element<HTMLInputElement>("kick-speed").value).toFixed(1)} m/s`);
  drawMotion(robot, base);
  drawKicker(robot);
  drawRelays(robot);
  drawHealth(robot, base);
  drawMission();
}

function drawMotion(robot: Robot | null, base: string | null): void {
  const names: Record<string, string> = { keys: "keyboard", stick: "stick", pad: "gamepad" };
  const source = grip.source;
  setText(
    "source",
    drives && source ? `by ${names[source]}` : yours ? "nothing held" : "another page has the controls",
  );
  const pose = robot?.pose;
  if (!robot || !base || !pose) {
    setText("moving", "");
    return;
  }
  const [vx, vy, w] = ["velocity.x", "velocity.y", "velocity.w"].map((path) => robot.get(base, path) ?? 0);
  const place = `x ${fixed(pose.x, 2)}  y ${fixed(pose.y, 2)} m  ${fixed((pose.heading * 180) / Math.PI, 0)}°`;
  setText(
    "moving",
    `${place}   ${Math.hypot(vx as number, vy as number).toFixed(2)} m/s  ${fixed(w as number, 2)} rad/s`,
  );
}

function drawKicker(robot: Robot | null): void {
  const device = robot?.device("kicker")?.address;
  if (!robot || !device) return;
  const charged = robot.get(device, "charged") ? "charged" : "not charged";
  const ball = robot.get(device, "ball_detected") ? ", has the ball" : "";
  setText("kicker-state", `${charged}${ball}, ${several(robot.get(device, "kick_count") ?? 0, "kick")}`);
}

function drawRelays(robot: Robot | null): void {
  const device = robot?.device("dio")?.address;
  if (!robot || !device) return;
  const count = Math.min(32, robot.get(device, "count") ?? 0);
  const bits = robot.get(device, "bits") ?? 0;
  const parent = element("dio");
  if (parent.children.length !== count) {
    parent.replaceChildren(
      ...Array.from({ length: count }, (_, i) => {
        const relay = button(String(i), `Relay ${i}`, () => {
          const now = world.robot?.device("dio")?.address;
          const wanted = !isPressed(relay);
          const all = [...parent.children].map((one, k) => (k === i ? wanted : isPressed(one)));
          const sum = all.reduce((bits, on, k) => (on ? bits + 2 ** k : bits), 0);
          askRobot("outputs", now, { count, bits: sum });
        });
        relay.className = "relay";
        return relay;
      }),
    );
  }
  // As the robot says that they stand.
  [...parent.children].forEach((relay, i) => {
    relay.setAttribute("aria-pressed", String(((bits >>> i) & 1) === 1));
  });
}

function drawHealth(robot: Robot | null, base: string | null): void {
  const facts: [string, string, ("bad" | "warn" | "")?][] = [];
  const { percent, volts } = robot ? battery(robot) : { percent: null, volts: null };
  const bar = element("battery");
  bar.hidden = percent === null;
  (bar.firstElementChild as HTMLElement).style.width = `${percent ?? 0}%`;
  bar.dataset.level = (percent ?? 100) < 15 ? "bad" : (percent ?? 100) < 30 ? "warn" : "";
  if (robot && (percent !== null || volts !== null)) {
    const text = [percent === null ? "" : `${percent.toFixed(0)} %`, volts === null ? "" : `${volts.toFixed(1)} V`];
    const level = (percent ?? 100) < 10 ? "critical: charge it" : (percent ?? 100) < 20 ? "low" : "";
    facts.push(["Battery", [...text, level].filter(Boolean).join("  "), (percent ?? 100) < 15 ? "bad" : ""]);
  }
  if (robot && base) {
    const now = performance.now();
    const age = robot.age(base, now);
    facts.push([
      "Data age",
      age === null ? "none yet" : milliseconds(age * 1000),
      age !== null && age > 0.5 ? "warn" : "",
    ]);
    const seen = robot.camera ? robot.age(robot.camera, now) : null;
    if (robot.vision) {
      const age = seen === null ? "" : `, seen ${milliseconds(seen * 1000)} ago`;
      facts.push(["Vision", robot.vision + age, /good|unused/.test(robot.vision) ? "" : "warn"]);
    }
    if (robot.place) facts.push(["Place", robot.place, /^tracking/.test(robot.place) ? "" : "warn"]);
    if (world.visionTrouble && !robot.device("gps")) facts.push(["Cameras", world.visionTrouble, "warn"]);
    const gps = robot.device("gps")?.address;
    if (gps && robot.get(gps, "quality") !== null) {
      const fix = ["no fix", "GPS", "differential"][robot.get(gps, "quality") ?? 0] ?? "fix";
      const error = robot.get(gps, "horizontal_error_m");
      const within = error === null || fix === "no fix" ? "" : `, ±${error.toFixed(2)} m`;
      facts.push([
        "GPS",
        `${fix}, ${robot.get(gps, "satellites") ?? "?"} satellites${within}`,
        fix === "no fix" ? "bad" : "",
      ]);
      const degrees = ["latitude", "longitude"].map((path) => ((robot.get(gps, path) ?? 0) / 1e7).toFixed(6));
      if (fix !== "no fix") facts.push(["Position", degrees.join(", ")]);
    }
    if (robot.get(base, "stalled")) facts.push(["Wheels", "they turn, but the base does not move", "bad"]);
    const driver = robot.driver(base);
    if (driver && driver.rate_hz > 0) {
      const { p50, p99 } = driver.jitter_us;
      const number = (value: number | null) => value?.toFixed(0) ?? "?";
      facts.push(["Beat", `${number(driver.rate_hz)} Hz, jitter p50 ${number(p50)} p99 ${number(p99)} µs`]);
    }
  }
  for (const driver of robot?.drivers ?? []) {
    const address = driver.devices[0]?.device ?? driver.name;
    if (driver.hung) facts.push([address, "its driver hangs", "bad"]);
    else if (driver.faults > 0)
      facts.push([address, `${several(driver.faults, "fault")}${driver.open ? "" : ", not open"}`, "bad"]);
    if (driver.beats_missed > 0) facts.push([address, `${several(driver.beats_missed, "beat")} missed`, "warn"]);
  }
  for (const device of robot?.devices ?? []) if (device.trouble) facts.push([device.address, device.trouble, "bad"]);
  element("facts").replaceChildren(
    ...facts.map(([name, value, level]) => {
      const row = make("tr", "", level ?? "");
      row.append(make("th", name), make("td", value));
      (row.firstElementChild as HTMLElement).setAttribute("scope", "row");
      return row;
    }),
  );
}

let drawn: Entry | undefined;
function drawLog(): void {
  const last = world.log[world.log.length - 1];
  if (last === drawn) return;
  drawn = last;
  const newest = [...world.log].reverse().slice(0, 60);
  element("log").replaceChildren(
    ...newest.map((entry) => {
      const item = make("li", "", ["", "warn", "bad"][entry.severity] ?? "");
      item.append(
        make("time", entry.time.toLocaleTimeString("en-GB")),
        make("b", entry.label),
        make("span", entry.text),
      );
      return item;
    }),
  );
}

// ---- Dark and light

function setTheme(theme: string): void {
  document.documentElement.dataset.theme = theme;
  setText("theme", theme === "dark" ? "☀" : "☾");
  map.restyle();
  plots.rebuild();
}
setTheme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"));
element("theme").addEventListener("click", () => {
  const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  localStorage.setItem("theme", theme);
  setTheme(theme);
});

// ---- Go

drawPanels();
drawPlayer();
setInterval(drawPanels, 100);
function frame(now: number): void {
  requestAnimationFrame(frame);
  map.draw(now);
  plots.draw();
}
requestAnimationFrame(frame);

const token = encodeURIComponent(location.hash.slice(1));
tellWorker({ visible: !document.hidden });
tellWorker({ open: `${location.origin.replace(/^http/, "ws")}/socket?token=${token}` });
