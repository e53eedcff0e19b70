/** What was typed and not yet signed: it survives a reload and a sign-in that ends mid-form, in this tab. */
import type { Typed } from "./values";

const PREFIX = "wonderland.draft.";
export type Draft = Readonly<Record<string, Typed>>;

export function readDraft(name: string): Draft | undefined {
  try {
    const kept: unknown = JSON.parse(sessionStorage.getItem(PREFIX + name) ?? "null");
    return typeof kept === "object" && kept !== null ? (kept as Draft) : undefined;
  } catch {
    return undefined;
  }
}

export function keepDraft(name: string, draft: Draft | undefined): void {
  try {
    if (draft === undefined) sessionStorage.removeItem(PREFIX + name);
    else sessionStorage.setItem(PREFIX + name, JSON.stringify(draft));
  } catch {
    // A browser that keeps nothing: it holds until the page is closed.
  }
}
