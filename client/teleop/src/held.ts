// SPDX-License-Identifier: Apache-2.0
import type { Velocity } from "./protocol";

export type Command = { robot: number; device: string } & Velocity;

/** What the hand holds, on its way to the gateway: pure, time [ms] is handed in. */
export class HeldCommand {
  /** Never more than 50 commands a second. */
  static readonly SPACING_MS = 20;
  /** A page that does not say again what it holds hangs: that is letting go. */
  static readonly PATIENCE_MS = 150;

  #command: Command | null = null;
  #heard = -Infinity;
  #sent = -Infinity;
  #releases = false;

  /** null: nothing is held. */
  hold(command: Command | null, now: number): void {
    const other = this.#command && (command?.robot !== this.#command.robot || command.device !== this.#command.device);
    if (other) this.#releases = true;
    this.#command = command;
    this.#heard = now;
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
