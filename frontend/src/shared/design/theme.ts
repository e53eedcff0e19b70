import { useSyncExternalStore } from "react";

export type Theme = "light" | "dark";
export type Choice = Theme | "system";

const KEY = "wonderland.theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set<() => void>();

function stored(): Choice {
  try {
    const value = localStorage.getItem(KEY);
    return value === "light" || value === "dark" ? value : "system";
  } catch {
    return "system"; // Storage may be forbidden; then the system's theme holds.
  }
}

let choice: Choice = stored();
// Kept, and never asked again: Chromium fires no "change" for what `matches` has already told, and a page that draws
// something else just then would stay in the old theme.
let system: Theme = dark.matches ? "dark" : "light";

function resolved(): Theme {
  return choice === "system" ? system : choice;
}

function apply(): void {
  document.documentElement.dataset["theme"] = resolved();
  for (const listener of listeners) listener();
}

dark.addEventListener("change", (event) => {
  system = event.matches ? "dark" : "light";
  apply();
});
apply();

export function setThemeChoice(next: Choice): void {
  choice = next;
  try {
    localStorage.setItem(KEY, next);
  } catch {
    // It holds until the page is closed.
  }
  apply();
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function useTheme(): { theme: Theme; choice: Choice } {
  const theme = useSyncExternalStore(subscribe, resolved);
  const chosen = useSyncExternalStore(subscribe, () => choice);
  return { theme, choice: chosen };
}
