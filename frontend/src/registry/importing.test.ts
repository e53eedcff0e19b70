import { afterEach, describe, expect, it, vi } from "vitest";
import { keepDraftsOf } from "../shared/drafts";
import { keepRun, keptRun, type Run } from "./importing";

/** What a browser has for a tab. */
class Tab {
  [key: string]: unknown;

  getItem(key: string): string | null {
    return (this[key] as string | undefined) ?? null;
  }

  setItem(key: string, value: string): void {
    this[key] = value;
  }

  removeItem(key: string): void {
    Reflect.deleteProperty(this, key);
  }
}

const RUN: Run = { name: "drones.csv", kind: "drones", transaction: "RegisterUav", lines: [] };

afterEach(() => vi.unstubAllGlobals());

describe("a list on its way to the ledger", () => {
  it("survives a reload, and is gone for the next person and when somebody signs out", () => {
    for (const next of ["bob", undefined]) {
      vi.stubGlobal("sessionStorage", new Tab());
      keepDraftsOf("ada");
      keepRun(RUN);
      keepDraftsOf("ada");
      expect(keptRun()).toEqual(RUN);
      keepDraftsOf(next);
      expect(keptRun()).toBeUndefined();
      expect(JSON.stringify(sessionStorage)).not.toContain("drones.csv");
    }
  });
});
