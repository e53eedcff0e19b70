import type { GeoJSONSource, GeoJSONSourceDiff } from "maplibre-gl";
import type { Drone } from "../../shared/drones";
import { lonLat } from "../../shared/geo/frame";
import type { TrackPoint } from "./features";

type Diff = Required<Pick<GeoJSONSourceDiff, "add" | "update" | "remove">>;
type Drawn = { lon_e7: number; lat_e7: number; look: string };

/**
 * The drones' symbols, sent to MapLibre as differences: with a thousand drones at 5 Hz, only places change at each tick,
 * and looks twice a second.
 */
export class TrackSource {
  private readonly drawn = new Map<string, Drawn>();

  constructor(private readonly source: Pick<GeoJSONSource, "updateData">) {}

  /** Everything: who is there, where, and what each looks like. */
  show(points: readonly TrackPoint[]): void {
    const diff: Diff = { add: [], update: [], remove: [] };
    const there = new Set<string>();
    for (const { id, place, properties } of points) {
      there.add(id);
      const look = JSON.stringify(properties);
      const before = this.drawn.get(id);
      const geometry = { type: "Point" as const, coordinates: lonLat(place) };
      if (before === undefined) {
        diff.add.push({ type: "Feature", geometry, properties });
      } else {
        const moved = before.lon_e7 !== place.lon_e7 || before.lat_e7 !== place.lat_e7;
        const changed = before.look !== look;
        if (!moved && !changed) continue;
        diff.update.push({
          id,
          ...(moved && { newGeometry: geometry }),
          ...(changed && { addOrUpdateProperties: Object.entries(properties).map(([key, value]) => ({ key, value })) }),
        });
      }
      this.drawn.set(id, { lon_e7: place.lon_e7, lat_e7: place.lat_e7, look });
    }
    for (const id of this.drawn.keys()) {
      if (there.has(id)) continue;
      diff.remove.push(id);
      this.drawn.delete(id);
    }
    this.send(diff);
  }

  /** New places of drones that are shown already. */
  move(drones: readonly Drone[]): void {
    const diff: Diff = { add: [], update: [], remove: [] };
    for (const { uav_id, track } of drones) {
      const before = this.drawn.get(uav_id);
      if (track === undefined || before === undefined) continue;
      if (before.lon_e7 === track.lon_e7 && before.lat_e7 === track.lat_e7) continue;
      before.lon_e7 = track.lon_e7;
      before.lat_e7 = track.lat_e7;
      diff.update.push({ id: uav_id, newGeometry: { type: "Point", coordinates: lonLat(track) } });
    }
    this.send(diff);
  }

  private send(diff: Diff): void {
    if (diff.add.length + diff.update.length + diff.remove.length > 0) void this.source.updateData(diff);
  }
}
