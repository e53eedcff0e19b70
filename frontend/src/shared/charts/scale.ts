/** Round numbers for an axis: at most `most` steps from 0 to at least `value`. */
export function ticks(value: number, most = 4): number[] {
  if (!(value > 0)) return [0, 1];
  const raw = value / most;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= raw - 1e-9) ?? 10 * power;
  const whole = Math.max(step, 1);
  const result: number[] = [];
  for (let at = 0; at < value + whole - 1e-9; at += whole) result.push(at);
  return result;
}

const LETTER_PX = 6.2;
const GAP_PX = 8;

/** Of so many bars one has its label: every `wished`, or as many more as labels of that length need side by side. */
export function apart(wished: number, step_px: number, letters: number): number {
  const needed = Math.ceil((letters * LETTER_PX + GAP_PX) / Math.max(0.1, step_px));
  return needed <= wished ? wished : wished * Math.ceil(needed / wished);
}
