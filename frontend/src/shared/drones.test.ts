import { beforeEach, describe, expect, it } from "vitest";
import { countByGroup, drones, GONE_MS, SILENT_MS, VERDICT_HOLDS_MS, type Drone } from "./drones";
import { ACTORS, PADS } from "./fake/cast";
import { seeded } from "./fake/random";
import { FakeWorld } from "./fake/world";
import { LiveStore } from "./live/store";
import { rowText } from "../sessions/words";

const START_MS = 1_700_000_000_000;
let store: LiveStore;

function play(to_s: number): Map<string, Drone> {
  const world = new FakeWorld(START_MS, seeded(1));
  store.merge({ pads: [...PADS] });
  for (let t_s = 0; t_s <= to_s; t_s += 0.2) store.merge(world.tick(t_s));
  return at(to_s * 1000);
}

const at = (ms: number): Map<string, Drone> =>
  new Map(drones(store, START_MS + ms).map((drone) => [drone.uav_id, drone]));

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
      ["OH-DRN-0640", "broadcast-refuted"],
      ["OH-DRN-0871", "inconclusive"],
      ["OH-DRN-0512", "not-authorised"],
      ["OH-DRN-0733", "no-verdict"],
    ]);
    expect(countByGroup(found)["needs-you"]).toBe(5);
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

  it("gives each row its two texts", () => {
    const found = play(58);
    const text = (id: string): { right: string; second: string } => {
      const drone = found.get(id) ?? expect.fail(`${id} is not there`);
      const { right, second } = rowText(drone, (pad) => PADS.find(({ pad_id }) => pad_id === pad)?.name ?? pad);
      return { right: right.replaceAll("\u00a0", " "), second: second.replaceAll("\u00a0", " ") };
    };
    expect(text("OH-DRN-0417")).toEqual({ right: "4.3 m off", second: "Refuted at Aurajoki 2 · landing refused" });
    expect(text("OH-DRN-0640")).toEqual({ right: "31 m off", second: "Broadcast differs from what it told Kupittaa" });
    expect(text("OH-DRN-0512")).toEqual({ right: "refused", second: "Verified at Satama 1 · not authorised" });
    expect(text("OH-DRN-0733")).toEqual({ right: "no verdict", second: "Session at Kupittaa ended · codes did not match" });
    expect(text("OH-DRN-0925").second).toMatch(/^Ranging at Kupittaa, \d+ rounds$/);
    expect(text("OH-DRN-0233")).toEqual({ right: "0.03 m", second: "Verified at Aurajoki 2 · landed" });
  });
});
