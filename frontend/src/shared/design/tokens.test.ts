import { describe, expect, it } from "vitest";
import css from "./tokens.css?raw";

function tokens(selector: string): Map<string, string> {
  const block = css.slice(css.indexOf(selector)).split("}")[0] ?? "";
  return new Map([...block.matchAll(/--([\w-]+):\s*(#[0-9a-f]{6});/g)].map(([, name = "", value = ""]) => [name, value]));
}

/** WCAG 2.2 relative luminance. */
function luminance(hex: string): number {
  const [r = 0, g = 0, b = 0] = [1, 3, 5].map((i) => {
    const c = Number.parseInt(hex.slice(i, i + 2), 16) / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(a: string, b: string): number {
  const [light = 0, dark = 0] = [luminance(a), luminance(b)].sort((x, y) => y - x);
  return (light + 0.05) / (dark + 0.05);
}

/** Text and the grounds it stands on. */
const PAIRS: readonly (readonly [text: string, grounds: readonly string[]])[] = [
  ["ink", ["bg", "panel", "sunk", "land", "ok-bg", "bad-bg", "maybe-bg"]],
  ["ink2", ["bg", "panel", "sunk", "land", "ok-bg", "bad-bg", "maybe-bg", "none-bg"]],
  ["ink3", ["panel", "sunk", "land"]],
  ["ok", ["panel", "ok-bg", "sunk"]],
  ["bad", ["panel", "bad-bg", "sunk"]],
  ["maybe", ["panel", "maybe-bg", "sunk"]],
  ["none", ["panel", "sunk"]],
  ["accent", ["panel", "sunk", "ok-bg"]],
  ["accent-ink", ["accent"]],
  ["place-ink", ["land", "quay"]],
  ["water-ink", ["water"]],
];

describe.each([
  ["light", ":root {"],
  ["dark", ':root[data-theme="dark"]'],
])("the %s theme", (_name, selector) => {
  const colours = tokens(selector);
  it.each(PAIRS.flatMap(([text, grounds]) => grounds.map((ground) => [text, ground] as const)))("%s on %s reaches AA", (text, ground) => {
    expect(contrast(colours.get(text) ?? "", colours.get(ground) ?? "")).toBeGreaterThanOrEqual(4.5);
  });
  it("shows the edges of controls", () => {
    expect(contrast(colours.get("control") ?? "", colours.get("panel") ?? "")).toBeGreaterThanOrEqual(3);
  });
});
