import type { Course } from "../shared/api/records";

/** Certainty beyond this looks like certainty: one in a million, as far as likelihoods are told. */
const LIMIT = Math.log(999_999);

/** Log-odds of a likelihood in parts per million, held within what can be told. */
export function logOdds(likelihood_ppm: number): number {
  const odds = Math.log(likelihood_ppm / (1_000_000 - likelihood_ppm));
  return Math.min(LIMIT, Math.max(-LIMIT, odds));
}

/** Where a likelihood lies between the plot's bottom (0) and its top (1); even odds lie in the middle. */
export function heightOf(likelihood_ppm: number): number {
  return (logOdds(likelihood_ppm) + LIMIT) / (2 * LIMIT);
}

/** Rounds for the axis: the first, the last, and round numbers between that do not crowd them. */
export function roundsForAxis(points: Course["points"]): number[] {
  const last = points.at(-1)?.rounds ?? 1;
  const step = [1, 2, 5, 10, 20, 50, 100].find((each) => last / each <= 6) ?? 100;
  const found: number[] = [];
  for (let at = step; at < last - step / 2; at += step) found.push(at);
  return [...(step > 1 ? [1] : []), ...found.filter((at) => at > 1 || step === 1), last];
}

/** What a level of assurance excludes and what it leaves open, by the names of the texts (docs/method.md). */
export function bearing(level: number): { excluded: readonly string[]; open: readonly string[] } {
  const excluded = [level === 0 ? "measuredByDrone" : "measuredByPad", "keyed", "differences", "witness"] as const;
  const open = ["ownLie", "replayed", "falseStamps", "lyingPad"] as const;
  return { excluded: excluded.slice(0, Math.max(1, level)), open: [...open.slice(level), "sharedKeys"] };
}
