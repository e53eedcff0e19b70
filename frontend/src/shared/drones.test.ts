import { beforeEach, describe, expect, it } from "vitest";
import { GONE_MS, SILENT_MS, VERDICT_HOLDS_MS, type Drone } from "./drones";
import { ACTORS, PADS } from "./fake/cast";
import { seeded } from "./fake/random";
import { FakeWorld } from "./fake/world";
import { droneOf, Fleet, type Filter } from "./fleet";
import { LiveStore } from "./live/store";

const START_MS = 1_700_000_000_000;
let store: LiveStore;

function play(to_s: number): Map<string, Drone> {
  const world = new FakeWorld(START_MS, seeded(1));
  store.merge({ pads: [...PADS] });
  for (let t_s = 0; t_s <= to_s; t_s += 0.2) store.merge(world.tick(t_s));
  return at(to_s * 1000);
}

function listed(ms: number, filter: Filter = {}): Drone[] {
  const rows = new Fleet(store, START_MS + ms, filter).rows("all");
  return Array.from({ length: rows.length }, (_, i) => rows.at(i) ?? expect.fail(`there is no row ${i}`));
}

const at = (ms: number): Map<string, Drone> => new Map(listed(ms).map((drone) => [drone.uav_id, drone]));

beforeEach(() => {
  store = new LiveStore();
});

describe("drones, sorted by need", () => {
  it("puts each into its group, worst first", () => {
    const found = [...play(58).values()];
    const order = found.map(({ group }) => group);
    expect(order).toEqual([...order].sort((a, b) => ["needs-you", "proving", "verified", "other"].indexOf(a) - ["needs-you", "proving", "verified", "other"].indexOf(b)));
    const needs = found.filter(({ group }) => group === "needs-you").map(({ uav_id, need }) => [uav_id, need]);
    expect(needs).toEqual([
      ["OH-DRN-0417", "refuted"],
      ["OH-DRN-0640", "impersonation"],
      ["OH-DRN-0871", "inconclusive"],
      ["OH-DRN-0512", "not-authorised"],
      ["OH-DRN-0733", "no-verdict"],
    ]);
    expect(new Fleet(store, START_MS + 58_000).counts).toMatchObject({ "needs-you": 5, all: ACTORS.length });
    expect(found).toHaveLength(ACTORS.length);
  });

  it("tells far, near, silent and proving apart", () => {
    const found = play(58);
    expect(found.get("SE-UAS-7715")?.look).toBe("out-of-range");
    expect(found.get("OH-DRN-0559")?.look).toBe("silent");
    expect(found.get("OH-DRN-0925")?.look).toBe("proving");
    expect(found.get("OH-DRN-0233")?.look).toBe("verified");
  });

  it("lets a verdict speak of its moment only, and forgets drones that nobody hears", () => {
    play(20);
    const later = at(20_000 + SILENT_MS + 1);
    expect(later.get("OH-DRN-0102")?.look).toBe("silent");
    expect(later.get("OH-DRN-0417")?.look).toBe("refuted");
    const gone = at(20_000 + GONE_MS + 1_000);
    expect(gone.has("OH-DRN-0102")).toBe(false);
    expect(gone.get("OH-DRN-0417")?.look).toBe("refuted");
    expect(at(20_000 + VERDICT_HOLDS_MS + 1_000).has("OH-DRN-0417")).toBe(false);
  });

  it("takes a session that nobody decided before its end for over", () => {
    play(56);
    expect(at(56_000).get("OH-DRN-0925")?.look).toBe("proving");
    expect(at(55_200 + 60_001 + 1_000).get("OH-DRN-0925")).toMatchObject({
      need: "no-verdict",
      session: { state: "cancelled", end: "expired" },
    });
  });

  it("shows what a filter asks for, and knows the others all the same", () => {
    play(58);
    const ids = (filter: Filter): string[] => listed(58_000, filter).map(({ uav_id }) => uav_id);
    expect(ids({ look: "refuted" })).toEqual(["OH-DRN-0417"]);
    expect(ids({ look: "inconclusive", pad: "kupittaa" })).toEqual(["OH-DRN-0640"]);
    expect(ids({ action: "dock" }).sort()).toEqual(["OH-DRN-0118", "OH-DRN-0377"]);
    expect(ids({ look: "silent" })).toEqual(["OH-DRN-0559"]);
    expect(ids({ operator: "FIN87astrdge12k8" })).toEqual([]);
    // Asked 31 s in, decided 37 s in: 21 s ago.
    expect(ids({ minutes: 0.3 })).not.toContain("OH-DRN-0233");
    expect(ids({ minutes: 0.5 })).toContain("OH-DRN-0233");
    const fleet = new Fleet(store, START_MS + 58_000, { look: "refuted" });
    expect(fleet.total).toBe(ACTORS.length);
    expect(fleet.find("OH-DRN-0559")?.look).toBe("silent");
    expect(fleet.rows("all").indexOf("OH-DRN-0559")).toBe(-1);
  });

  it("finds one drone as the list has it", () => {
    for (const [uav_id, drone] of play(58)) expect(droneOf(store, uav_id, START_MS + 58_000)).toEqual(drone);
  });
});
