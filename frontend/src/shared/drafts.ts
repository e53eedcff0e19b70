/**
 * What was typed and not yet sent: it survives a reload and a sign-in that ends mid-form, in this tab only (session
 * storage), because a draft may hold personal data. Whoever signs in next in this tab does not find another's.
 */
const PREFIX = "wonderland.draft.";
const OWNER = "wonderland.drafts-of";

function attempt<T>(work: () => T): T | undefined {
  try {
    return work();
  } catch {
    // A browser that keeps nothing: it holds until the page is closed.
    return undefined;
  }
}

export function readDraft(name: string): unknown {
  return attempt(() => JSON.parse(sessionStorage.getItem(PREFIX + name) ?? "null") as unknown) ?? undefined;
}

export function keepDraft(name: string, draft: unknown): void {
  attempt(() => {
    if (draft === undefined) sessionStorage.removeItem(PREFIX + name);
    else sessionStorage.setItem(PREFIX + name, JSON.stringify(draft));
  });
}

/** Drafts of anybody else are thrown away; all of them for nobody, who has signed out. */
export function keepDraftsOf(person_id: string | undefined): void {
  attempt(() => {
    if (person_id !== undefined && sessionStorage.getItem(OWNER) === person_id) return;
    for (const key of Object.keys(sessionStorage)) if (key.startsWith(PREFIX)) sessionStorage.removeItem(key);
    if (person_id === undefined) sessionStorage.removeItem(OWNER);
    else sessionStorage.setItem(OWNER, person_id);
  });
}
