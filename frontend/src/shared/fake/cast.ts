import type { Action, Anchor, Outcome, Pad, Track } from "../api/records";
import { plainFrame, toGlobe, type Local } from "../geo/frame";

/** A drone of the script: where it flies in its pad's frame, where it says it is, and what it asks for when. */
export type Actor = {
  uav_id: string;
  pad_id: string;
  /** Seconds into each cycle at which it asks; undefined for one that only broadcasts. */
  asks_at_s?: number;
  action: Action;
  outcome: Outcome;
  /** Where it truly hovers while it is proved, and how far its signed and its broadcast claim are from there. */
  hover: Local;
  lie?: Local;
  broadcastLie?: Local;
  authorised?: boolean;
  cancelled?: string;
  silent?: boolean;
  rounds: number;
  sigma_mm: number;
  /** What its operator says (Self ID). */
  says?: Pick<Track, "description" | "description_type" | "area_count" | "area_radius_mm">;
};

/** The script begins again after this. */
export const CYCLE_S = 120;

export const at = (east_mm: number, north_mm: number): Local => ({ east_mm, north_mm });

/** Each lie once, honest drones around them. */
export const ACTORS: readonly Actor[] = [
  { uav_id: "OH-DRN-0417", pad_id: "aurajoki-2", asks_at_s: 8, action: "land", outcome: "refuted", hover: at(3_600, 10_700), lie: at(-3_400, 2_500), rounds: 24, sigma_mm: 90 },
  { uav_id: "OH-DRN-0640", pad_id: "kupittaa", asks_at_s: 14, action: "land", outcome: "inconclusive", hover: at(-6_200, -4_100), broadcastLie: at(24_000, 19_600), rounds: 42, sigma_mm: 70 },
  { uav_id: "OH-DRN-0871", pad_id: "aurajoki-2", asks_at_s: 24, action: "land", outcome: "inconclusive", hover: at(-14_800, 9_400), lie: at(420, -560), rounds: 160, sigma_mm: 620 },
  { uav_id: "OH-DRN-0118", pad_id: "satama-1", asks_at_s: 52, action: "dock", outcome: "verified", hover: at(5_100, -7_400), rounds: 80, sigma_mm: 60, says: { description: "Roof survey, 20 min", description_type: "text" } },
  { uav_id: "OH-DRN-0925", pad_id: "kupittaa", asks_at_s: 55.2, action: "takeoff", outcome: "verified", hover: at(400, 300), rounds: 30, sigma_mm: 40 },
  { uav_id: "OH-DRN-0233", pad_id: "aurajoki-2", asks_at_s: 31, action: "land", outcome: "verified", hover: at(-5_200, -8_300), rounds: 36, sigma_mm: 70 },
  { uav_id: "OH-DRN-0377", pad_id: "satama-1", asks_at_s: 2, action: "dock", outcome: "verified", hover: at(-2_100, 6_900), rounds: 33, sigma_mm: 60 },
  { uav_id: "OH-DRN-0512", pad_id: "satama-1", asks_at_s: 36, action: "land", outcome: "verified", authorised: false, hover: at(9_000, 3_000), rounds: 40, sigma_mm: 70 },
  { uav_id: "OH-DRN-0733", pad_id: "kupittaa", asks_at_s: 40, action: "land", outcome: "verified", cancelled: "codes_did_not_match", hover: at(12_000, -15_000), rounds: 0, sigma_mm: 70 },
  { uav_id: "OH-DRN-0102", pad_id: "aurajoki-2", action: "land", outcome: "verified", hover: at(310_000, 268_000), rounds: 0, sigma_mm: 70 },
  { uav_id: "SE-UAS-7715", pad_id: "kupittaa", action: "land", outcome: "verified", hover: at(-690_000, 420_000), rounds: 0, sigma_mm: 70, says: { description: "Low battery, landing", description_type: "emergency", area_count: 3, area_radius_mm: 120_000 } },
  { uav_id: "OH-DRN-0559", pad_id: "satama-1", action: "land", outcome: "verified", hover: at(120_000, -60_000), silent: true, rounds: 0, sigma_mm: 70 },
];

function pad(pad_id: string, name: string, lat: number, lon: number): Pad {
  const place = { lat_e7: Math.round(lat * 1e7), lon_e7: Math.round(lon * 1e7) };
  const frame = plainFrame(place);
  const corner = 1_200;
  const anchors: Anchor[] = (["A", "B", "C", "D"] as const).map((anchor_id, i) => ({
    anchor_id,
    east_mm: i === 1 || i === 2 ? corner : -corner,
    north_mm: i < 2 ? corner : -corner,
    up_mm: 300 + 150 * (i % 2),
    mac: 0x0a00 + i,
    survey_sigma_mm: 5,
    bias: [{ range_mm: 0, bias_mm: 0, sigma_mm: 20 }],
  }));
  return {
    pad_id,
    name,
    operator_id: "FIN87astrdge12k8",
    msp_id: "PadMSP",
    status: "commissioned",
    ...place,
    height_mm: 34_000,
    registered_ms: 0,
    updated_ms: 0,
    commissioning: {
      frame,
      anchors,
      range_sigma_mm: 100,
      installation_sigma_mm: 20,
      method: "scripted",
      max_range_mm: 60_000,
      valid_from_ms: 0,
      valid_until_ms: 4_102_444_800_000,
    },
    anchors: anchors.map((anchor) => {
      const [lon, lat] = toGlobe(frame, anchor);
      return { ...anchor, lat_e7: Math.round(lat * 1e7), lon_e7: Math.round(lon * 1e7) };
    }),
    health: {
      t_ms: 0,
      connected: true,
      verified: false,
      anchors: anchors.map(({ anchor_id }) => ({ anchor_id, state: "up" as const })),
    },
  };
}

export const PADS: readonly Pad[] = [
  pad("aurajoki-2", "Aurajoki 2", 60.45148, 22.26868),
  pad("satama-1", "Satama 1", 60.43552, 22.21874),
  pad("kupittaa", "Kupittaa", 60.45062, 22.29721),
];
