import type { GeoJSONSourceDiff } from "maplibre-gl";
import { describe, expect, it } from "vitest";
import type { Drone } from "../../shared/drones";
import type { TrackPoint } from "./features";
import { TrackSource } from "./trackSource";

function made(): { source: TrackSource; sent: GeoJSONSourceDiff[] } {
  const sent: GeoJSONSourceDiff[] = [];
  const source = new TrackSource({
    updateData: (diff) => {
      sent.push(diff);
      return Promise.resolve();
    },
  });
  return { source, sent };
}

const point = (id: string, lat_e7: number, icon = "look-unproved"): TrackPoint => ({
  id,
  place: { lat_e7, lon_e7: 20 },
  properties: { id, icon },
});
const drone = (uav_id: string, lat_e7: number): Drone => ({ uav_id, track: { lat_e7, lon_e7: 20 } }) as Drone;

describe("the drones' symbols", () => {
  it("are added, moved, changed and removed one by one", () => {
    const { source, sent } = made();
    source.show([point("a", 1), point("b", 1)]);
    source.show([point("a", 2), point("b", 1, "look-refuted")]);
    source.show([point("b", 1, "look-refuted")]);
    expect(sent.map(({ add, update, remove }) => [add?.length, update?.length, remove])).toEqual([
      [2, 0, []],
      [0, 2, []],
      [0, 0, ["a"]],
    ]);
    expect(sent[1]?.update?.[0]).toEqual({ id: "a", newGeometry: { type: "Point", coordinates: [20 / 1e7, 2 / 1e7] } });
    expect(sent[1]?.update?.[1]).toHaveProperty("addOrUpdateProperties");
    expect(sent[1]?.update?.[1]).not.toHaveProperty("newGeometry");
  });

  it("are not sent when nothing changed, and at a tick only as places of those that are shown", () => {
    const { source, sent } = made();
    source.show([point("a", 1)]);
    source.show([point("a", 1)]);
    source.move([drone("a", 1), drone("never shown", 5)]);
    expect(sent).toHaveLength(1);
    source.move([drone("a", 3)]);
    source.show([point("a", 3)]);
    expect(sent).toHaveLength(2);
  });
});
