/** A pad's site plan: what its operator drew, in metres from the pad's origin. */
import { toGlobe, type Local, type LonLat } from "../shared/geo/frame";
import type { Frame } from "../shared/api/records";

export const PLAN_KINDS = ["surface", "fato", "tlof", "safety_area", "approach_sector", "departure_sector", "obstacle", "fence", "charger", "marking"] as const;
export type PlanKind = (typeof PLAN_KINDS)[number];
export type Metres = readonly [east_m: number, north_m: number];
export type PlanFeature = { kind: PlanKind; name: string; height_m?: number; shape: "Point" | "LineString" | "Polygon"; rings: readonly (readonly Metres[])[] };
export type PlanImage = { href: string; corners: readonly Metres[] };
export type Plan = { features: readonly PlanFeature[]; image?: PlanImage };

type Feature = { properties: { kind: PlanKind; name?: string; height_m?: number }; geometry: { type: PlanFeature["shape"]; coordinates: never } };

/** Reads a plan that the server has checked. Throws where it is none all the same. */
export function readPlan(text: string): Plan {
  const { features, image } = JSON.parse(text) as { features: Feature[]; image?: { data: string; corners: Metres[] } };
  return {
    features: features.map(({ properties: { kind, name = "", height_m }, geometry: { type, coordinates } }) => ({
      kind,
      name,
      shape: type,
      rings: type === "Point" ? [[coordinates as Metres]] : type === "LineString" ? [coordinates as Metres[]] : (coordinates as Metres[][]),
      ...(height_m !== undefined && { height_m }),
    })),
    ...(image !== undefined && { image: { href: `data:${image.data.startsWith("iVBOR") ? "image/png" : "image/jpeg"};base64,${image.data}`, corners: image.corners } }),
  };
}

/** How far from the pad what is marked on the ground reaches, metres; sectors go on beyond the drawing. */
export function reachOf({ features, image }: Plan): number {
  const ground = features.filter(({ kind }) => kind !== "approach_sector" && kind !== "departure_sector");
  const points = [...ground.flatMap(({ rings }) => rings.flat()), ...(image?.corners ?? [])];
  return Math.max(5, ...points.map(([east, north]) => Math.max(Math.abs(east), Math.abs(north))));
}

const POST_M = 0.6;

/** A square around a point, so that a mast has a size. */
export function around([east, north]: Metres, half_m = POST_M): Metres[] {
  const [west, right, south, top] = [east - half_m, east + half_m, north - half_m, north + half_m];
  return [
    [west, south],
    [right, south],
    [right, top],
    [west, top],
    [west, south],
  ];
}

/** The plan on the globe. Markings that are points stay words and are left out. */
export function planFeatures(plan: Plan, frame: Frame): GeoJSON.Feature[] {
  const place = ([east_m, north_m]: Metres): LonLat => toGlobe(frame, { east_mm: east_m * 1000, north_mm: north_m * 1000 } satisfies Local);
  return plan.features.flatMap(({ kind, shape, rings, height_m = 0 }): GeoJSON.Feature[] => {
    const properties = { kind, height_m };
    if (shape === "LineString") return [{ type: "Feature", properties, geometry: { type: "LineString", coordinates: (rings[0] ?? []).map(place) } }];
    if (shape === "Polygon") return [{ type: "Feature", properties, geometry: { type: "Polygon", coordinates: rings.map((ring) => ring.map(place)) } }];
    const [point] = rings[0] ?? [];
    if (point === undefined || kind === "marking") return [];
    return [{ type: "Feature", properties, geometry: { type: "Polygon", coordinates: [around(point).map(place)] } }];
  });
}
