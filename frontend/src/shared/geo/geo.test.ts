import { describe, expect, it } from "vitest";
import type { Frame } from "../api/records";
import { circle, ellipse, outline } from "./ellipse";
import { direction, distance_mm, plainFrame, toGlobe, toLocal } from "./frame";

const TURKU = { lat_e7: 604_514_800, lon_e7: 222_686_800 };

describe("a pad's frame", () => {
  it("goes to the globe and back within a hundredth of a millimetre, second-order terms included", () => {
    const frame: Frame = { ...plainFrame(TURKU), e2: -123_456_789, n2: 3_000_000, n3: 98_765_432 };
    for (const local of [
      { east_mm: 0, north_mm: 0 },
      { east_mm: 12_345, north_mm: -67_890 },
      { east_mm: -990_000, north_mm: 870_000 },
    ]) {
      const [lon, lat] = toGlobe(frame, local);
      const back = toLocal(frame, { lat_e7: lat * 1e7, lon_e7: lon * 1e7 });
      expect(back.east_mm).toBeCloseTo(local.east_mm, 2);
      expect(back.north_mm).toBeCloseTo(local.north_mm, 2);
    }
  });

  it("knows how long a degree is at 60.45° north (WGS-84: 111.422 km of latitude, 55.038 km of longitude)", () => {
    const north = distance_mm(TURKU, { ...TURKU, lat_e7: TURKU.lat_e7 + 100_000 });
    const east = distance_mm(TURKU, { ...TURKU, lon_e7: TURKU.lon_e7 + 100_000 });
    expect(north / 1e6).toBeCloseTo(1.11422, 3);
    expect(east / 1e6).toBeCloseTo(0.55038, 3);
  });

  it("names eight directions", () => {
    expect(direction({ east_mm: 0, north_mm: 5 })).toBe("north");
    expect(direction({ east_mm: 5, north_mm: 5 })).toBe("north-east");
    expect(direction({ east_mm: -5, north_mm: 0.1 })).toBe("west");
    expect(direction({ east_mm: -0.1, north_mm: 5 })).toBe("north");
    expect(direction({ east_mm: 0.1, north_mm: -5 })).toBe("south");
  });
});

describe("the 99 % ellipse", () => {
  it("of an isotropic covariance is a circle of 3.035 σ", () => {
    const shape = ellipse({ ee_mm2: 10_000, en_mm2: 0, nn_mm2: 10_000 });
    expect(shape.major_mm).toBeCloseTo(303.5, 1);
    expect(shape.minor_mm).toBeCloseTo(303.5, 1);
  });

  it("points along the larger variance", () => {
    const shape = ellipse({ ee_mm2: 5_000, en_mm2: 4_000, nn_mm2: 5_000 });
    expect(shape.angle_rad).toBeCloseTo(Math.PI / 4, 6);
    expect(shape.major_mm ** 2 / shape.minor_mm ** 2).toBeCloseTo(9, 6);
    expect(ellipse({ ee_mm2: 1, en_mm2: 0, nn_mm2: 4 }).angle_rad).toBeCloseTo(Math.PI / 2, 6);
  });

  it("survives a covariance that rounding made indefinite", () => {
    expect(ellipse({ ee_mm2: 100, en_mm2: 101, nn_mm2: 100 }).minor_mm).toBe(0);
  });

  it("is drawn closed, every point at its Mahalanobis distance", () => {
    const covariance = { ee_mm2: 9_000, en_mm2: -2_500, nn_mm2: 4_000 };
    const points = outline(ellipse(covariance), { east_mm: 10, north_mm: 20 });
    expect(points.at(-1)).toEqual(points[0]);
    const det = covariance.ee_mm2 * covariance.nn_mm2 - covariance.en_mm2 ** 2;
    for (const { east_mm, north_mm } of points) {
      const [x, y] = [east_mm - 10, north_mm - 20];
      const d2 = (covariance.nn_mm2 * x * x - 2 * covariance.en_mm2 * x * y + covariance.ee_mm2 * y * y) / det;
      expect(d2).toBeCloseTo(9.2103, 3);
    }
    for (const { east_mm, north_mm } of circle(500, { east_mm: 0, north_mm: 0 })) {
      expect(Math.hypot(east_mm, north_mm)).toBeCloseTo(500, 6);
    }
  });
});
