/** A number in [0, 1), repeatable from its seed. */
export type Random = () => number;

/** Mulberry32 (public domain, T. Ettinger): small and good enough for a script. */
export function seeded(seed: number): Random {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), state | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 4_294_967_296;
  };
}

/** About normal, mean 0, standard deviation 1. */
export function noise(random: Random): number {
  let sum = 0;
  for (let i = 0; i < 6; i++) sum += random() - 0.5;
  return sum * Math.SQRT2;
}

/** 64 hexadecimal digits that look like a hash and depend on the text alone; no hash. */
export function hex(text: string): string {
  let seed = 2_166_136_261;
  for (const character of text) seed = Math.imul(seed ^ (character.codePointAt(0) ?? 0), 16_777_619);
  const random = seeded(seed);
  return Array.from({ length: 64 }, () => Math.floor(random() * 16).toString(16)).join("");
}
