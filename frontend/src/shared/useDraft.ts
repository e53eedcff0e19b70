import { useCallback, useEffect, useRef, useState } from "react";
import { keepDraft, readDraft } from "./drafts";

/**
 * State of a form that survives a session that ends mid-form (`drafts.ts`), by a name that no other form has.
 *
 * `start` is what an untouched form holds. `clear` is for when it was sent, or given up: it is untouched again.
 */
export function useDraft<T>(name: string, start: T): [draft: T, set: (draft: T) => void, clear: () => void] {
  const [typed, setTyped] = useState(() => ({ name, draft: known(name, start) }));
  const begin = useRef(start);
  useEffect(() => {
    begin.current = start;
  });
  // The same form, now of another thing.
  const current = typed.name === name ? typed.draft : known(name, start);
  const set = useCallback(
    (draft: T): void => {
      setTyped({ name, draft });
      keepDraft(name, draft);
    },
    [name],
  );
  const clear = useCallback((): void => {
    setTyped({ name, draft: begin.current });
    keepDraft(name, undefined);
  }, [name]);
  return [current, set, clear];
}

/** What was kept, where it has the shape of what the form holds now. */
function known<T>(name: string, start: T): T {
  const kept = readDraft(name);
  if (typeof kept !== typeof start || kept === null || Array.isArray(kept) !== Array.isArray(start)) return start;
  return typeof start === "object" ? { ...start, ...(kept as T) } : (kept as T);
}
