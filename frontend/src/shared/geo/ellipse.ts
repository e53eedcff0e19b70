import type { Covariance } from "../api/records";
import type { Local } from "./frame";

/** χ² with two degrees of freedom: the ellipse that holds 99 % of a planar normal distribution. */
export const CHI2_99_2DOF = 9.21034037197618;

export type Ellipse = {
  /** Half axes, millimetres. */
  major_mm: number;
  minor_mm: number;
  /** Of the major axis, from east towards north, radians. */
  angle_rad: number;
};

/** The 99 % ellipse of a covariance. A covariance that rounding made slightly indefinite gives a zero minor axis. */
export function ellipse(covariance: Covariance, chi2: number = CHI2_99_2DOF): Ellipse {
  const { ee_mm2, en_mm2, nn_mm2 } = covariance;
  const mean = (ee_mm2 + nn_mm2) / 2;
  const half = Math.hypot((ee_mm2 - nn_mm2) / 2, en_mm2);
  return {
    major_mm: Math.sqrt(Math.max(0, mean + half) * chi2),
    minor_mm: Math.sqrt(Math.max(0, mean - half) * chi2),
    angle_rad: 0.5 * Math.atan2(2 * en_mm2, ee_mm2 - nn_mm2),
  };
}

/** Its outline about a centre as a closed polygon. */
export function outline(shape: Ellipse, centre: Local, points = 64): Local[] {
  const cos = Math.cos(shape.angle_rad);
  const sin = Math.sin(shape.angle_rad);
  return Array.from({ length: points + 1 }, (_, i) => {
    const t = (2 * Math.PI * (i % points)) / points;
    const x = shape.major_mm * Math.cos(t);
    const y = shape.minor_mm * Math.sin(t);
    return { east_mm: centre.east_mm + x * cos - y * sin, north_mm: centre.north_mm + x * sin + y * cos };
  });
}

export function circle(radius_mm: number, centre: Local, points = 64): Local[] {
  return outline({ major_mm: radius_mm, minor_mm: radius_mm, angle_rad: 0 }, centre, points);
}
