// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from "vitest";
import { ellipse, roundLength } from "../src/map";

describe("ellipse", () => {
  it("has half axes of 2.448 standard deviations (chi-squared, 2 degrees of freedom, 95 %)", () => {
    const { a, b } = ellipse({ xx: 0.04, yy: 0.01, xy: 0 });
    expect(a).toBeCloseTo(0.2 * 2.4477, 3);
    expect(b).toBeCloseTo(0.1 * 2.4477, 3);
  });
  it("lies along the larger deviation", () => {
    expect(ellipse({ xx: 0.04, yy: 0.01, xy: 0 }).angle).toBeCloseTo(0, 12);
    expect(Math.abs(ellipse({ xx: 0.01, yy: 0.04, xy: 0 }).angle)).toBeCloseTo(Math.PI / 2, 12);
    expect(ellipse({ xx: 0.02, yy: 0.02, xy: 0.01 }).angle).toBeCloseTo(Math.PI / 4, 12);
  });
  it("turns with the covariance", () => {
    // R diag(a², b²) Rᵀ, with a = 0.3, b = 0.1, turned by 0.5 rad
    const [c, s] = [Math.cos(0.5), Math.sin(0.5)];
    const { a, b, angle } = ellipse({
      xx: 0.09 * c * c + 0.01 * s * s,
      yy: 0.09 * s * s + 0.01 * c * c,
      xy: (0.09 - 0.01) * s * c,
    });
    expect([a / 2.4477, b / 2.4477, angle]).toEqual([
      expect.closeTo(0.3, 4),
      expect.closeTo(0.1, 4),
      expect.closeTo(0.5, 12),
    ]);
  });
});

describe("roundLength", () => {
  it("is 1, 2 or 5 times a power of ten", () => {
    expect([0.04, 0.13, 0.9, 1.4, 2.9, 6, 80].map(roundLength)).toEqual([0.05, 0.1, 1, 1, 2, 5, 100]);
  });
});
