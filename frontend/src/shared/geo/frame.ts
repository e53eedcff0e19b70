import type { Frame, Pad } from "../api/records";

/** A place in a pad's frame: east and north, millimetres. */
export type Local = { east_mm: number; north_mm: number };
/** A place on the globe: [longitude, latitude], degrees, as GeoJSON orders them. */
export type LonLat = [lon: number, lat: number];

export type Place = { lat_e7: number; lon_e7: number };

const TWO_32 = 2 ** 32;
const TWO_52 = 2 ** 52;
/** WGS-84. */
const SEMI_MAJOR_M = 6_378_137;
const ECCENTRICITY_2 = 0.00669437999014;

export function lonLat(place: Place): LonLat {
  return [place.lon_e7 / 1e7, place.lat_e7 / 1e7];
}

/**
 * WGS-84 to the pad's frame, by the coefficients that the ledger records (libraries/core/wonderland/proofs/frame.py has the exact,
 * integer form; this one is for drawing).
 */
export function toLocal(frame: Frame, place: Place): Local {
  const dLat = place.lat_e7 - frame.lat_e7;
  const dLon = place.lon_e7 - frame.lon_e7;
  return {
    east_mm: (frame.e1 * dLon) / TWO_32 + (frame.e2 * dLat * dLon) / TWO_52,
    north_mm: (frame.n1 * dLat) / TWO_32 + (frame.n2 * dLat * dLat + frame.n3 * dLon * dLon) / TWO_52,
  };
}

/** The pad's frame to WGS-84: the inverse of `toLocal`, by fixed-point iteration to well below a millimetre. */
export function toGlobe(frame: Frame, local: Local): LonLat {
  let dLon = (local.east_mm * TWO_32) / frame.e1;
  let dLat = (local.north_mm * TWO_32) / frame.n1;
  for (let i = 0; i < 4; i++) {
    const at = toLocal(frame, { lat_e7: frame.lat_e7 + dLat, lon_e7: frame.lon_e7 + dLon });
    dLon += ((local.east_mm - at.east_mm) * TWO_32) / frame.e1;
    dLat += ((local.north_mm - at.north_mm) * TWO_32) / frame.n1;
  }
  return [(frame.lon_e7 + dLon) / 1e7, (frame.lat_e7 + dLat) / 1e7];
}

/** Millimetres of one 10⁻⁷ degree at a latitude, east and north, from the ellipsoid's radii of curvature. */
function millimetresPerE7(lat_e7: number): { east: number; north: number } {
  const phi = (lat_e7 / 1e7) * (Math.PI / 180);
  const w2 = 1 - ECCENTRICITY_2 * Math.sin(phi) ** 2;
  const prime = SEMI_MAJOR_M / Math.sqrt(w2);
  const meridian = (SEMI_MAJOR_M * (1 - ECCENTRICITY_2)) / w2 ** 1.5;
  const perE7 = (Math.PI / 180) * 1e-7 * 1000;
  return { east: prime * Math.cos(phi) * perE7, north: meridian * perE7 };
}

/** A first-order frame about a place: enough to draw where no survey is on the ledger. */
export function plainFrame(place: Place): Frame {
  const scale = millimetresPerE7(place.lat_e7);
  return {
    lat_e7: place.lat_e7,
    lon_e7: place.lon_e7,
    height_mm: 0,
    e1: scale.east * TWO_32,
    e2: 0,
    e3: 0,
    n1: scale.north * TWO_32,
    n2: 0,
    n3: 0,
    n4: 0,
    u2: 0,
    u3: 0,
  };
}

/** The frame of a pad: the surveyed one where there is one. */
export function frameOf(pad: Pad): Frame {
  return pad.commissioning?.frame ?? plainFrame(pad);
}

/** Horizontal distance between two places, millimetres: good to 0.1 % within some kilometres, for words and sorting. */
export function distance_mm(a: Place, b: Place): number {
  const scale = millimetresPerE7((a.lat_e7 + b.lat_e7) / 2);
  return Math.hypot((b.lon_e7 - a.lon_e7) * scale.east, (b.lat_e7 - a.lat_e7) * scale.north);
}

const DIRECTIONS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"] as const;

/** The direction from the origin to a local place, in words. */
export function direction(local: Local): (typeof DIRECTIONS)[number] {
  const turn = Math.atan2(local.east_mm, local.north_mm) / (2 * Math.PI);
  return DIRECTIONS[(Math.round(turn * 8) + 8) % 8] ?? "north";
}
