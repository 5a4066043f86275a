// SPDX-License-Identifier: Apache-2.0
import type { Velocity } from "./protocol";

export type Command = { robot: number; device: string } & Velocity;

/** What the hand holds, on its way to the gateway: pure, time [ms] is handed in. */
export class HeldCommand {
  /** Never more than 50 commands a second. */
  static readonly SPACING_MS = 20;
  /** A page that does not say again what it holds hangs: that is letting go. */
  static readonly PATIENCE_MS = 150;
  /** After a longer silence nobody knows what the hand did meanwhile: it has to hold nothing once, first. */
  static readonly HUNG_MS = 500;

  #command: Command | null = null;
  #heard = Infinity; // not yet
  #sent = -Infinity;
  #releases = false;
  #hung = false;

  /** null: nothing is held. False: the page hung, and what it holds does not count until it has held nothing. */
  hold(command: Command | null, now: number): boolean {
    this.#hung = command !== null && (this.#hung || now - this.#heard > HeldCommand.HUNG_MS);
    this.#heard = now;
    const next = this.#hung ? null : command;
    const other = this.#command && (next?.robot !== this.#command.robot || next.device !== this.#command.device);
    if (other) this.#releases = true;
    this.#command = next;
    return !this.#hung;
  }

  /** The connection is gone, and with it all that was held. */
  forget(): void {
    this.#command = null;
    this.#releases = false;
  }

  /** What to send now, if anything; call it at each change, and by the clock. */
  step(now: number): Command | "release" | null {
    if (this.#command && now - this.#heard > HeldCommand.PATIENCE_MS) {
      this.#command = null;
      this.#releases = true;
    }
    if (this.#releases) {
      this.#releases = false;
      return "release";
    }
    if (!this.#command || now - this.#sent < HeldCommand.SPACING_MS) return null;
    this.#sent = now;
    return this.#command;
  }
}
