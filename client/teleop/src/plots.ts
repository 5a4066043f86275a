// SPDX-License-Identifier: Apache-2.0
// Fields over time.
import uPlot from "uplot";
import { color } from "./map";
import type { World } from "./robots";
import { fixed } from "./standing";
import "uplot/dist/uPlot.min.css";

const SECONDS = 60;
const SAMPLES = 60 * SECONDS;
const MOST = 6; // series

export interface Series {
  robot: number;
  device: string;
  path: string;
}

export class Plots {
  paused = false;
  series: Series[] = [];
  #times: number[] = [];
  #values: (number | null)[][] = [];
  #plot: uPlot | null = null;
  #last = 0;

  constructor(
    readonly parent: HTMLElement,
    readonly world: World,
  ) {
    new ResizeObserver(() => this.#plot?.setSize(this.#size())).observe(parent);
  }

  toggle(series: Series): void {
    const at = this.series.findIndex(
      (one) => one.robot === series.robot && one.device === series.device && one.path === series.path,
    );
    if (at >= 0) this.#remove(at);
    else this.#add(series);
    this.rebuild();
  }

  #remove(at: number): void {
    this.series.splice(at, 1);
    this.#values.splice(at, 1);
  }

  #add(series: Series): void {
    if (this.series.length === MOST) this.#remove(0);
    this.series.push(series);
    this.#values.push(new Array(this.#times.length).fill(null));
  }

  /** Take what the newest frame brought; `at` is the gateway's time [s]. */
  sample(at: number): void {
    if (this.series.length === 0 || at <= this.#last) return;
    this.#last = at;
    this.#times.push(at);
    this.series.forEach((one, i) => {
      this.#values[i]?.push(this.world.robots.get(one.robot)?.get(one.device, one.path) ?? null);
    });
    if (this.#times.length > SAMPLES * 1.2) {
      this.#times.splice(0, SAMPLES * 0.2);
      for (const values of this.#values) values.splice(0, SAMPLES * 0.2);
    }
  }

  draw(): void {
    if (!this.#plot || this.paused || this.#times.length === 0) return;
    const end = this.#times[this.#times.length - 1] as number;
    this.#plot.setData(this.#data(), false);
    this.#plot.setScale("x", { min: end - 20, max: end });
  }

  /** All that is kept, in view. */
  reset(): void {
    this.#plot?.setData(this.#data(), true);
  }

  #data(): uPlot.AlignedData {
    return [this.#times, ...this.#values] as uPlot.AlignedData;
  }

  #size(): { width: number; height: number } {
    return { width: Math.max(200, this.parent.clientWidth), height: 170 };
  }

  /** After series or theme have changed. */
  rebuild(): void {
    this.#plot?.destroy();
    this.#plot = null;
    this.parent.classList.toggle("empty", this.series.length === 0);
    if (this.series.length === 0) return;
    const style = getComputedStyle(document.documentElement);
    const axis = {
      stroke: style.getPropertyValue("--muted").trim(),
      grid: { stroke: style.getPropertyValue("--grid").trim(), width: 1 },
      ticks: { stroke: style.getPropertyValue("--grid").trim(), width: 1 },
      font: "12px system-ui, sans-serif",
    };
    const ago = (_: uPlot, splits: number[]) => splits.map((at) => `${fixed(at - this.#last, 0)} s`);
    this.#plot = new uPlot(
      {
        ...this.#size(),
        scales: { x: { time: false } },
        axes: [{ ...axis, values: ago }, axis],
        legend: { live: true },
        cursor: { drag: { x: true, y: false } },
        series: [
          { label: "Time", value: (_, at) => (at == null ? "" : `${fixed(at - this.#last, 2)} s`) },
          ...this.series.map((one, i) => ({
            label: `${this.world.robots.get(one.robot)?.label ?? ""} ${one.device} ${one.path}`,
            stroke: color(i),
            width: 2,
            spanGaps: true,
            value: (_: uPlot, value: number | null) => (value == null ? "–" : value.toPrecision(4)),
          })),
        ],
      },
      this.#data(),
      this.parent,
    );
  }
}
