import { describe, expect, it } from "vitest";
import { mercatorX, mercatorY } from "../shared/geo/mercator";
import { placeAt, slantedCamera, spotOf, TILE, tiltOf, type View } from "./view";

const LAT = 43.7345;
const LON = 7.4279;

function view(bearing: number, pitch: number, zoom = 16): View {
  const scale = TILE * 2 ** zoom;
  const tilt = tiltOf(bearing, pitch, { fov: 36.87, height: 800, scale, lat: LAT });
  return { x: mercatorX(LON), y: mercatorY(LAT), left: 700, top: 420, scale, zoom, width: 1280, height: 800, ...(tilt !== undefined && { tilt }) };
}

const at = (of: View, lon: number, lat: number, up_m = 0): { left: number; top: number } => spotOf(of, mercatorX(lon), mercatorY(lat), up_m) ?? expect.fail("behind the camera");

describe("the view", () => {
  it("needs no tilt where the camera looks straight down with north up", () => {
    expect(view(0, 0).tilt).toBeUndefined();
    expect(at(view(0, 0), LON, LAT)).toEqual({ left: 700, top: 420 });
  });

  it("has east above when it looks east, and west on the left when it looks north", () => {
    const east = at(view(90, 0), LON + 0.001, LAT);
    expect(east.top).toBeLessThan(420);
    expect(east.left).toBeCloseTo(700, 6);
    expect(at(view(0, 40), LON - 0.001, LAT).left).toBeLessThan(700);
  });

  it("shows what is high above its place on the ground, and what is far smaller", () => {
    const slanted = view(-38, 52);
    expect(at(slanted, LON, LAT, 50).top).toBeLessThan(at(slanted, LON, LAT).top - 20);
    const flat = view(0, 52);
    const step = (lat: number): number => at(flat, LON + 0.001, lat).left - at(flat, LON, lat).left;
    expect(step(LAT + 0.002)).toBeLessThan(step(LAT));
    expect(step(LAT - 0.002)).toBeGreaterThan(step(LAT));
  });

  it.each([
    [0, 0],
    [30, 0],
    [-38, 52],
    [170, 70],
  ])("finds the place under a point again, bearing %d, pitch %d", (bearing, pitch) => {
    const now = view(bearing, pitch);
    const spot = at(now, LON + 0.0012, LAT - 0.0007);
    const [lon, lat] = placeAt(now, spot.left, spot.top);
    expect(lon).toBeCloseTo(LON + 0.0012, 7);
    expect(lat).toBeCloseTo(LAT - 0.0007, 7);
  });

  it("draws nothing that is behind the camera", () => {
    expect(spotOf(view(0, 70, 18), mercatorX(LON), mercatorY(LAT - 0.05))).toBeUndefined();
  });

  const PLACES: [number, number][] = [
    [7.4279, 43.73445],
    [7.43155, 43.73985],
    [7.41985, 43.72593],
  ];
  const ROOM = { width: 900, height: 500, fov: 36.87, screenHeight: 800 };

  it.each([-38, 35, 170])("fits all places into the room as the camera sees them, and fills it, bearing %d", (bearing) => {
    const seen = PLACES.map((place, i) => ({ at: place, up_m: i * 40 }));
    const { center, zoom } = slantedCamera(seen, { bearing, pitch: 52 }, ROOM, 20);
    const now = { ...view(bearing, 52, zoom), x: mercatorX(center[0]), y: mercatorY(center[1]) };
    const spots = seen.map(({ at: [lon, lat], up_m }) => at(now, lon, lat, up_m));
    const [lefts, tops] = [spots.map(({ left }) => left - 700), spots.map(({ top }) => top - 420)];
    const shares = [(Math.max(...lefts) - Math.min(...lefts)) / ROOM.width, (Math.max(...tops) - Math.min(...tops)) / ROOM.height];
    expect(Math.max(...shares)).toBeGreaterThan(0.98);
    expect(Math.max(...shares)).toBeLessThan(1.01);
    // In the middle of the room, not of the ground: what is far is small.
    expect(Math.abs(Math.max(...lefts) + Math.min(...lefts))).toBeLessThan(8);
    expect(Math.abs(Math.max(...tops) + Math.min(...tops))).toBeLessThan(8);
  });

  it("keeps what flies high and its shadow in the room, further away if need be", () => {
    const { center, zoom } = slantedCamera([{ at: [LON, LAT] }, { at: [LON, LAT], up_m: 65 }], { bearing: 20, pitch: 60 }, ROOM, 21);
    expect(zoom).toBeLessThan(21);
    expect(zoom).toBeGreaterThan(18);
    const now = { ...view(20, 60, zoom), x: mercatorX(center[0]), y: mercatorY(center[1]) };
    for (const up_m of [0, 65]) {
      const { left, top } = at(now, LON, LAT, up_m);
      expect(Math.abs(left - 700)).toBeLessThan(2);
      expect(Math.abs(top - 420)).toBeLessThan(ROOM.height / 2 + 2);
    }
  });

  it("comes no nearer than it may", () => {
    expect(slantedCamera([{ at: [LON, LAT] }], { bearing: 0, pitch: 52 }, ROOM, 18).zoom).toBe(18);
  });
});
