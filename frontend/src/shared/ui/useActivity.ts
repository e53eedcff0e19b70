import { useEffect } from "react";

/** What only a person does; a page that stands open does none of it. */
const SIGNS = ["pointerdown", "keydown", "wheel", "touchstart"] as const;
/** The server notes a use at most this often, too. */
export const TELL_EVERY_MS = 60_000;

/** Calls back when somebody does something on the page, at most once a minute. `tell` must stay the same function. */
export function useActivity(tell: () => void): void {
  useEffect(() => {
    let told_ms = -Infinity;
    const seen = (): void => {
      const now_ms = performance.now();
      if (now_ms - told_ms < TELL_EVERY_MS) return;
      told_ms = now_ms;
      tell();
    };
    for (const sign of SIGNS) addEventListener(sign, seen, { capture: true, passive: true });
    return () => {
      for (const sign of SIGNS) removeEventListener(sign, seen, { capture: true });
    };
  }, [tell]);
}
