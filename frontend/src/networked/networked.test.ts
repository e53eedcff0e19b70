import { describe, expect, it } from "vitest";
import { viewOf, type Flight } from "./calls";
import { diagonal_m, flightAt, foreign, networkedOverlay } from "./overlay";

function flight(change: Partial<Flight> = {}): Flight {
  return {
    flight_id: "f1",
    provider: "other.example",
    aircraft_type: "Helicopter",
    status: "Airborne",
    lat_e7: 604_518_000,
    lon_e7: 222_666_000,
    t_ms: 1,
    trail: [],
    simulated: false,
    verified: false,
    ...change,
  };
}

describe("networked flights", () => {
  it("asks by latitude first", () => {
    expect(viewOf([22.25, 60.44, 22.29, 60.46])).toBe("60.44000,22.25000,60.46000,22.29000");
  });

  it("measures a view from corner to corner", () => {
    expect(diagonal_m([22.25, 60.44, 22.29, 60.46])).toBeCloseTo(3_132.55, 1);
    expect(diagonal_m([179.99, 0, 180.01, 0.01])).toBe(Infinity);
  });

  it("leaves out our own flights, which are drones of the map already", () => {
    const own = flight({ flight_id: "own" });
    delete own.provider;
    expect(foreign([own, flight()]).map(({ flight_id }) => flight_id)).toEqual(["f1"]);
    expect(networkedOverlay({ flights: [own], clusters: [] }, undefined).features).toEqual([]);
  });

  it("points a mark to where the flight will be, unless it hardly moves", () => {
    const parts = (change: Partial<Flight>): unknown[] => networkedOverlay({ flights: [flight(change)], clusters: [] }, "f1").features.map(({ properties }) => properties?.["part"] as unknown);
    expect(parts({ speed_mm_s: 10_000, track_cdeg: 9_000 })).toEqual(["place", "ahead"]);
    expect(parts({ speed_mm_s: 100, track_cdeg: 9_000 })).toEqual(["place"]);
    expect(parts({ trail: [{ lat_e7: 1, lon_e7: 1, t_ms: 1 }, { lat_e7: 2, lon_e7: 2, t_ms: 2 }] })).toEqual(["place", "trail"]);
    const [, ahead] = networkedOverlay({ flights: [flight({ speed_mm_s: 10_000, track_cdeg: 9_000 })], clusters: [] }, undefined).features;
    const [from, to] = (ahead?.geometry as GeoJSON.LineString).coordinates;
    // A hundred metres to the east.
    expect(((to?.[0] ?? 0) - (from?.[0] ?? 0)) * 111_195 * Math.cos((60.4518 * Math.PI) / 180)).toBeCloseTo(100, 0);
    expect(to?.[1]).toBeCloseTo(from?.[1] ?? 0, 6);
  });

  it("finds the nearest mark under the pointer, and none further away", () => {
    const near = flight();
    const far = flight({ flight_id: "f2", lon_e7: 222_668_000 });
    expect(flightAt([far, near], [22.26661, 60.4518], 16)?.flight_id).toBe("f1");
    expect(flightAt([far, near], [22.27, 60.4518], 16)).toBeUndefined();
  });
});
