// SPDX-License-Identifier: Apache-2.0
// The socket, and the clock of commands: timers of a worker go on at full speed when those of a page do not.
import { HeldCommand } from "./held";
import type { FromGateway, FromWorker, ToWorker } from "./protocol";

const CLOCK_MS = 25;
const ALIVE_MS = 200;
const RETRY_MS = 500;
const HANGS_MS = 1000; // a page says fifty times a second what it holds

const held = new HeldCommand();
let url = "";
let socket: WebSocket | null = null;
let visible = true;
const asked = new Map<number, number>();
let questions = 0;
let heard = performance.now(); // the page

function post(message: FromWorker): void {
  self.postMessage(message);
}

function send(message: object): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function step(): void {
  const action = held.step(performance.now());
  if (action === "release") send({ t: "release" });
  else if (action) send({ t: "drive", ...action });
}

function connect(): void {
  socket = new WebSocket(url);
  socket.onopen = () => {
    post({ connected: true });
    send({ t: "visible", on: visible });
  };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data as string) as FromGateway;
    if (message.t !== "alive") {
      post({ message });
      return;
    }
    const at = asked.get(message.n);
    asked.delete(message.n);
    if (at !== undefined) post({ roundTrip: performance.now() - at });
  };
  socket.onclose = () => {
    held.forget();
    asked.clear();
    post({ connected: false });
    setTimeout(connect, RETRY_MS);
  };
}

self.onmessage = (event: MessageEvent<ToWorker>) => {
  const message = event.data;
  if ("open" in message) {
    url = message.open;
    connect();
    setInterval(step, CLOCK_MS);
    setInterval(() => {
      if (performance.now() - heard > HANGS_MS) return; // nobody can see or stop anything there
      questions += 1;
      asked.set(questions, performance.now());
      send({ t: "alive", n: questions });
    }, ALIVE_MS);
  } else if ("hold" in message) {
    heard = performance.now();
    if (!held.hold(message.hold, heard)) post({ hung: true });
    step();
  } else if ("visible" in message) {
    visible = message.visible;
    send({ t: "visible", on: visible });
  } else {
    send(message.send);
  }
};
