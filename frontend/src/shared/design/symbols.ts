import type { Look } from "../drones";

/** The names of colours in tokens.css that symbols use. */
export type Tone = "ok" | "bad" | "maybe" | "none" | "accent" | "panel" | "line" | "land" | "ink" | "ink2";

/** One stroke or area of a symbol, in a box of 20 × 20. */
export type Part = {
  d: string;
  fill?: Tone;
  stroke?: Tone;
  width?: number;
  dash?: readonly [number, number];
  /** Turns while something is being proved. */
  turning?: true;
};

const CIRCLE = (r: number): string => `M${10 - r} 10a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;
const DIAMOND = "M10 2.4l7.6 7.6-7.6 7.6L2.4 10z";

/** Shape and colour of each state, the same in list, map and report. */
export const SYMBOLS: Record<Look, readonly Part[]> = {
  verified: [
    { d: CIRCLE(8.5), fill: "ok" },
    { d: "M6 10.3l2.7 2.7L14 7.4", stroke: "panel", width: 2.2 },
  ],
  refuted: [
    { d: "M6.3 1h7.4L19 6.3v7.4L13.7 19H6.3L1 13.7V6.3z", fill: "bad" },
    { d: "M6.8 6.8l6.4 6.4M13.2 6.8l-6.4 6.4", stroke: "panel", width: 2.2 },
  ],
  inconclusive: [
    { d: "M10 1.6L19 17.6H1z", fill: "maybe", stroke: "maybe", width: 1.5 },
    { d: "M7.4 11.7c.9-1.2 1.8-1.2 2.6-.4s1.7.8 2.6-.4", stroke: "panel", width: 1.8 },
  ],
  unproved: [{ d: CIRCLE(7.4), stroke: "none", width: 2.2 }],
  "out-of-range": [{ d: CIRCLE(7.4), stroke: "none", width: 2.2, dash: [2.6, 2.8] }],
  silent: [
    { d: CIRCLE(7.4), stroke: "none", width: 2.2 },
    { d: "M5 15L15 5", stroke: "none", width: 2.2 },
  ],
  proving: [
    { d: CIRCLE(7.4), stroke: "line", width: 2.6 },
    { d: "M10 2.6a7.4 7.4 0 0 1 7.4 7.4", stroke: "accent", width: 2.6, turning: true },
  ],
};

export const TONE_OF: Record<Look, Tone> = {
  verified: "ok",
  refuted: "bad",
  inconclusive: "maybe",
  unproved: "none",
  "out-of-range": "none",
  silent: "none",
  proving: "accent",
};

/** The ring of a claim and the diamond of a measurement. */
export function claimRing(tone: Tone): readonly Part[] {
  return [{ d: CIRCLE(6.4), fill: "land", stroke: tone, width: 2.6 }];
}

export function measuredDiamond(tone: Tone, verified: boolean): readonly Part[] {
  return verified ? [{ d: DIAMOND, fill: tone }] : [{ d: DIAMOND, fill: "land", stroke: tone, width: 2 }];
}
