import type { Map as MapLibre } from "maplibre-gl";
import { describe, expect, it } from "vitest";
import { placeNames } from "./placeNames";
import { Occupied, place } from "./placing";

const feature = (id: string, properties: Record<string, unknown>, lon = 7.42): unknown => ({ layer: { id }, properties, geometry: { type: "Point", coordinates: [lon, 43.73] } });

function mapWith(...features: unknown[]): MapLibre {
  return { getLayer: (id: string) => (id === "place-towns" ? undefined : {}), queryRenderedFeatures: () => features } as unknown as MapLibre;
}

describe("names of the place", () => {
  it("are told once, in the reader's language, in lines of some length", () => {
    const port = { name: "Port Hercule de Monaco", "name:fi": "Monacon satama" };
    const found = placeNames(mapWith(feature("place-harbours", port), feature("place-harbours", port), feature("place-quarters", { name: "La Condamine" }), feature("place-quarters", {})), "fi");
    expect(found.map(({ lines }) => lines)).toEqual([
      [
        { text: "Monacon", look: "water" },
        { text: "satama", look: "water" },
      ],
      [{ text: "La Condamine", look: "quarter" }],
    ]);
    expect(placeNames(mapWith(feature("place-harbours", port)), "en")[0]?.lines.map(({ text }) => text)).toEqual(["Port Hercule", "de Monaco"]);
  });

  it("give way to what flies", () => {
    const label = { left: 100, top: 100, width: 60, height: 15, clear: 0, sides: ["middle"] as const };
    const drone = { ...label, id: "drone", rank: 10, top: 104 };
    const names = [{ ...label, id: "Port", rank: 1_000_000 }, { ...label, id: "Quai", rank: 1_000_001, top: 150 }];
    const placed = place([...names, drone], new Occupied(300, 300), new Map(), 10);
    expect(placed.map(({ label: { id }, left, top }) => [id, left, top])).toEqual([
      ["drone", 70, 96.5],
      ["Quai", 70, 142.5],
    ]);
  });
});
