import type { Map as MapLibre } from "maplibre-gl";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { AWAY } from "./archiveSource";
import { Failures, type Failing } from "./failures";

type Listener = (event: unknown) => void;

let told: (readonly Failing[])[];
let first: number;
let asked: unknown[];
let fire: (name: string, event: unknown) => void;
let failures: Failures;

const tile = (x: number, state = "errored"): unknown => ({ state, tileID: { canonical: { x, y: 2, z: 3 } } });

beforeEach(() => {
  vi.useFakeTimers();
  const listeners = new Map<string, Listener>();
  [told, first, asked] = [[], 0, []];
  const map = {
    on: (name: string, listener: Listener) => listeners.set(name, listener),
    getSource: () => ({}),
    refreshTiles: (source: string, tiles: unknown) => asked.push([source, tiles]),
  } as unknown as MapLibre;
  fire = (name, event) => listeners.get(name)?.(event);
  failures = new Failures(map, (failing) => told.push(failing), () => first++);
});

afterEach(() => {
  failures.remove();
  vi.useRealTimers();
});

it("says what is away, asks for it again, and says so when it has come", () => {
  fire("error", { error: new Error(AWAY), sourceId: "place", tile: tile(1) });
  fire("error", { error: new Error(AWAY), sourceId: "place", tile: tile(2) });
  expect([told, first]).toEqual([[], 1]);
  vi.advanceTimersByTime(2_000);
  expect(told).toEqual([[{ what: "archive", why: "away" }]]);
  vi.advanceTimersByTime(10_000);
  expect(asked).toEqual([["place", [{ x: 1, y: 2, z: 3 }, { x: 2, y: 2, z: 3 }]]]);
  fire("sourcedata", { sourceId: "place", tile: tile(7, "loaded") });
  expect(told.at(-1)).toEqual([]);
});

it("says nothing of what comes a moment later, nor of what nobody wants any longer", () => {
  fire("error", { error: new Error(AWAY), sourceId: "place", tile: tile(1) });
  fire("sourcedata", { sourceId: "place", tile: tile(1, "loaded") });
  fire("error", { error: new DOMException("", "AbortError"), sourceId: "place", tile: tile(1) });
  vi.advanceTimersByTime(20_000);
  expect(told).toEqual([]);
});

it("calls a part damaged that came and cannot be read, until it can or the archive is another", () => {
  fire("error", { error: new Error("Failed to fetch"), sourceId: "place", tile: tile(1) });
  vi.advanceTimersByTime(20_000);
  fire("sourcedata", { sourceId: "place", tile: tile(7, "loaded") });
  expect([told, asked]).toEqual([[[{ what: "archive", why: "damaged" }]], []]);
  failures.forget();
  expect(told.at(-1)).toEqual([]);
});
