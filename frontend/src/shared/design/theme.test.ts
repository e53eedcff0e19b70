// @vitest-environment happy-dom
import { renderHook } from "@testing-library/react";
import { expect, it, vi } from "vitest";

/** Chromium's list: asking it tells what has changed, and nobody is told of it once more. */
class AsChromium extends EventTarget {
  #now = false;
  #told = false;

  get matches(): boolean {
    this.#told = this.#now;
    return this.#told;
  }

  become(now: boolean): void {
    this.#now = now;
  }

  frame(): void {
    if (this.#told === this.#now) return;
    this.#told = this.#now;
    this.dispatchEvent(Object.assign(new Event("change"), { matches: this.#now }));
  }
}

it("follows the system's theme although the page was drawn just before it was told", async () => {
  const list = new AsChromium();
  vi.stubGlobal("matchMedia", () => list);
  vi.resetModules();
  const { useTheme } = await import("./theme");
  const { result, rerender } = renderHook(() => useTheme());
  expect(result.current.theme).toBe("light");
  list.become(true);
  rerender(); // Whatever else is drawn now.
  list.frame();
  expect(document.documentElement.dataset["theme"]).toBe("dark");
  rerender();
  expect(result.current.theme).toBe("dark");
});
