// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { LiveStore } from "../shared/live/store";
import { warning } from "./Banner";
import { parsePlace, placeHash, type Place } from "../shared/address/location";

describe("the address", () => {
  it.each<Place>([
    { room: "live" },
    { room: "live", drone: "OH-DRN-0417", camera: { lat: 60.4514812, lon: -22.2686812, zoom: 20.25 } },
    { room: "live", session: "ab".repeat(32) },
    { room: "live", filter: { look: "out-of-range", pad: "p 1&x", operator: "FIN87astrdge12k8", action: "dock", minutes: 5 }, list: "pads" },
    { room: "live", drone: "a", follow: true, measure: [[22.25, 60.5], [-22.125, -60.5]], as: "table" },
    { room: "live", measure: [], as: "wall" },
    { room: "live", zone: ["FIN:P20", "FIN:A+B 1"], zones: "off" },
    { room: "sessions", filters: {} },
    { room: "sessions", filters: { outcome: "refuted", operator: "a&b", since: "2026-11-21", state: "cancelled" } },
    { room: "sessions", session: "cd".repeat(32) },
    { room: "verdicts", filters: {} },
    { room: "registry", path: [], query: {} },
    { room: "registry", path: ["drones", "OH/1"], query: { tab: "history" } },
    { room: "verdicts", filters: { outcome: "refuted", pad: "p 1&x" } },
  ])("holds %o", (place) => expect(parsePlace(placeHash(place))).toEqual(place));

  it.each(["", "#", "#/", "#/nowhere", "#/live?at=nonsense", "#/live?at=1,2", "#/live?at=999,0,3", "#/live?look=handsome&minutes=1e9&action=dance&list=x&follow", "#token=abc"])(
    "falls back to the live map for %s",
    (hash) => expect(parsePlace(hash)).toEqual({ room: "live" }),
  );

  it("takes of a broken measure what makes sense", () => {
    expect(parsePlace("#/live?measure=1,2;x,y;91,0;3,4,5;6,7")).toEqual({ room: "live", measure: [[2, 1], [7, 6]] });
  });

  it("survives a broken percent-encoding", () => {
    expect(parsePlace("#/sessions/%E0%A4%A")).toEqual({ room: "sessions", session: "%E0%A4%A" });
  });
});

describe("the banner", () => {
  const fine = {
    server: {},
    ledger: { kind: "embedded", notice: "", channel: "c", height: 1, mirrored: 1, lag_ms: 0, connected: true, halted: null, organisations: [] },
  } as unknown as NonNullable<LiveStore["status"]>;

  function store(change: Partial<LiveStore["status"] extends infer S | undefined ? (S & { ledger: object })["ledger"] : never> = {}): LiveStore {
    const made = new LiveStore();
    made.connection = { phase: "open", since_ms: 0 };
    made.lastFrame_ms = 1_000;
    made.status = { ...fine, ledger: { ...fine.ledger, ...change } };
    return made;
  }

  it("says nothing while all is well", () => expect(warning(store(), 2_000)).toBeUndefined());
  it("says what a halted mirror means", () => expect(warning(store({ halted: "a gap" }), 2_000)?.text).toContain("halted just now; it said: “a gap”"));
  it("says since when it is halted", () =>
    expect(warning(store({ halted: "a gap", halted_since_ms: 2_000 }), 182_000)?.text.replaceAll("\u00a0", " ")).toContain("halted 3 min ago; it said"));
  it("says that the mirror lags", () => expect(warning(store({ lag_ms: 14_300 }), 2_000)?.tone).toBe("maybe"));
  it("says that the connection is congested, but not while frames are a moment late", () => {
    const late = store();
    late.delay_ms = 2_000;
    expect(warning(late, 2_000)).toBeUndefined();
    late.delay_ms = 9_300;
    expect(warning(late, 2_000)?.text.replaceAll("\u00a0", " ")).toBe("The connection is congested: what you see is 9 s old.");
  });
  it("says that the ledger is away", () => expect(warning(store({ connected: false }), 2_000)?.text).toContain("no connection to the ledger"));

  it("says how old the state is that a following backend serves without its leader", () => {
    const followed = store();
    followed.status = { ...fine, server: { ...fine.server, stale_since_ms: 1_000 } };
    const told = warning(followed, 21_000);
    expect(told?.tone).toBe("bad");
    expect(told?.text.replaceAll("\u00a0", " ")).toContain("20 s");
  });

  it("says how old the picture is, and offers to try again, but not for a hiccup", () => {
    const lost = store();
    lost.connection = { phase: "waiting", attempt: 3, retry_ms: 20_000, reason: "unreachable" };
    expect(warning(lost, 2_000)).toBeUndefined();
    const told = warning(lost, 13_000);
    expect(told?.text.replaceAll("\u00a0", " ")).toBe("Not connected: the server cannot be reached. What you see is 12 s old. Trying again in 7 s.");
    expect(told?.retry).toBe(true);
  });

  it("stays while the first new try hangs, and is not there before anything came", () => {
    const lost = store();
    lost.connection = { phase: "connecting", attempt: 1 };
    expect(warning(lost, 13_000)?.text).toContain("Not connected");
    lost.lastFrame_ms = undefined;
    expect(warning(lost, 13_000)).toBeUndefined();
  });
});
