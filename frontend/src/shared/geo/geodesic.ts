import type { LonLat } from "./frame";

/** WGS-84. */
const A_M = 6_378_137;
const F = 1 / 298.257223563;
const B_M = A_M * (1 - F);
const RAD = Math.PI / 180;
const ITERATIONS = 200;
/** Points between the ends of a long leg, so that it is drawn as the curve that it is. */
const LONG_M = 20_000;
const BETWEEN = 32;

/** The shortest way over the ellipsoid, and the direction in which it begins (degrees from true north, 0 to 360). */
export type Leg = { distance_m: number; bearing: number };

/** Bearing of the great circle on a sphere: what is left to say of places on opposite sides of the globe. */
function onSphere(lat1: number, lat2: number, dLon: number): Leg {
  const y = Math.sin(dLon) * Math.cos(lat2);
  const x = Math.cos(lat1) * Math.sin(lat2) - Math.sin(lat1) * Math.cos(lat2) * Math.cos(dLon);
  const angle = Math.acos(Math.max(-1, Math.min(1, Math.sin(lat1) * Math.sin(lat2) + Math.cos(lat1) * Math.cos(lat2) * Math.cos(dLon))));
  return { distance_m: angle * 6_371_008.8, bearing: (Math.atan2(y, x) / RAD + 360) % 360 };
}

/**
 * Distance and first bearing from one place to another by Vincenty's inverse formula: to half a millimetre, but for places
 * almost opposite each other, where it does not converge and a sphere answers (to half a per cent).
 */
export function leg(from: LonLat, to: LonLat): Leg {
  const [lat1, lat2] = [from[1] * RAD, to[1] * RAD];
  const dLon = (((to[0] - from[0] + 540) % 360) - 180) * RAD;
  const [u1, u2] = [Math.atan((1 - F) * Math.tan(lat1)), Math.atan((1 - F) * Math.tan(lat2))];
  const [sin1, cos1, sin2, cos2] = [Math.sin(u1), Math.cos(u1), Math.sin(u2), Math.cos(u2)];
  let lambda = dLon;
  for (let i = 0; i < ITERATIONS; i++) {
    const [sinL, cosL] = [Math.sin(lambda), Math.cos(lambda)];
    const sinS = Math.hypot(cos2 * sinL, cos1 * sin2 - sin1 * cos2 * cosL);
    if (sinS === 0) return { distance_m: 0, bearing: 0 };
    const cosS = sin1 * sin2 + cos1 * cos2 * cosL;
    const sigma = Math.atan2(sinS, cosS);
    const sinA = (cos1 * cos2 * sinL) / sinS;
    const cos2A = 1 - sinA * sinA;
    const mid = cos2A === 0 ? 0 : cosS - (2 * sin1 * sin2) / cos2A;
    const c = (F / 16) * cos2A * (4 + F * (4 - 3 * cos2A));
    const next = dLon + (1 - c) * F * sinA * (sigma + c * sinS * (mid + c * cosS * (2 * mid * mid - 1)));
    if (Math.abs(next) > Math.PI) break;
    if (Math.abs(next - lambda) > 1e-12) {
      lambda = next;
      continue;
    }
    const k = (cos2A * (A_M * A_M - B_M * B_M)) / (B_M * B_M);
    const a = 1 + (k / 16384) * (4096 + k * (k * (320 - 175 * k) - 768));
    const b = (k / 1024) * (256 + k * (k * (74 - 47 * k) - 128));
    const correction =
      b * sinS * (mid + (b / 4) * (cosS * (2 * mid * mid - 1) - (b / 6) * mid * (4 * sinS * sinS - 3) * (4 * mid * mid - 3)));
    const bearing = Math.atan2(cos2 * sinL, cos1 * sin2 - sin1 * cos2 * cosL) / RAD;
    return { distance_m: B_M * a * (sigma - correction), bearing: (bearing + 360) % 360 };
  }
  return onSphere(lat1, lat2, dLon);
}

/** The way between two places for drawing: straight where it is short, a great circle's points where it is long. */
export function path(from: LonLat, to: LonLat): LonLat[] {
  if (leg(from, to).distance_m < LONG_M) return [from, to];
  const vector = ([lon, lat]: LonLat): [number, number, number] => [
    Math.cos(lat * RAD) * Math.cos(lon * RAD),
    Math.cos(lat * RAD) * Math.sin(lon * RAD),
    Math.sin(lat * RAD),
  ];
  const [a, b] = [vector(from), vector(to)];
  const angle = Math.acos(Math.max(-1, Math.min(1, a[0] * b[0] + a[1] * b[1] + a[2] * b[2])));
  let last = from[0];
  return Array.from({ length: BETWEEN + 1 }, (_, i): LonLat => {
    if (i === 0) return from;
    const [f, g] = [Math.sin((1 - i / BETWEEN) * angle), Math.sin((i / BETWEEN) * angle)];
    const [x, y, z] = [f * a[0] + g * b[0], f * a[1] + g * b[1], f * a[2] + g * b[2]];
    let lon = Math.atan2(y, x) / RAD;
    // Across the date line the line goes on, not back around the world.
    lon += 360 * Math.round((last - lon) / 360);
    last = lon;
    return [lon, Math.atan2(z, Math.hypot(x, y)) / RAD];
  });
}
