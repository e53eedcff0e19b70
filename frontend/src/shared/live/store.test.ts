import { describe, expect, it, vi } from "vitest";
import type { SessionSummary, Track, VerdictSummary } from "../api/records";
import { TrackPacker } from "./columns";
import { MAX_VERDICTS, LiveStore, TRACK_AGE_MS } from "./store";
import { TRAIL_S } from "./tracks";
import type { LiveFrame } from "./protocol";

const track = (uav_id: string, t_ms: number, lat_e7 = 604_500_000): Track => ({
  uav_id,
  lat_e7,
  lon_e7: 222_600_000,
  t_ms,
  pad_id: "p",
  transport: "wifi",
  verified: false,
});

function send(store: LiveStore, frame: LiveFrame, received_ms = 0): void {
  store.receive({ kind: "frame", frame, received_ms });
}

const verdict = (n: number): VerdictSummary =>
  ({ session_id: `s${n}`, uav_id: "u", decided_ms: n, block: n, tx_index: 0, tx_id: `t${n}` }) as VerdictSummary;

describe("the live store", () => {
  it("tells subscribers only of what they asked for", () => {
    const store = new LiveStore();
    const [tracks, pads] = [vi.fn(), vi.fn()];
    const end = store.subscribe(["tracks"], tracks);
    store.subscribe(["pads"], pads);
    send(store, { type: "delta", seq: 1, t_ms: 1, tracks: [track("a", 1)] });
    expect(tracks).toHaveBeenCalledTimes(1);
    expect(pads).not.toHaveBeenCalled();
    end();
    send(store, { type: "delta", seq: 2, t_ms: 2, tracks: [track("a", 2)] });
    expect(tracks).toHaveBeenCalledTimes(1);
  });

  it("keeps a minute of trail, a point a second", () => {
    const store = new LiveStore();
    for (let i = 0; i <= 500; i++) send(store, { type: "delta", seq: i, t_ms: i, tracks: [track("a", 1_000_000 + i * 200, 600_000_000 + i)] });
    const trail = store.tracks.trail("a");
    expect(trail).toHaveLength(TRAIL_S + 2);
    expect(trail.at(-1)?.lat_e7).toBe(600_000_500);
    expect(trail[0]?.lat_e7).toBe(600_000_500 - TRAIL_S * 5);
  });

  it("takes columns for what it takes objects for", () => {
    const [one, other] = [new LiveStore(), new LiveStore()];
    const packer = new TrackPacker();
    const drip = { state: "verified", det: "2001:30::1", format: 1, t_ms: 5 } as never;
    for (let i = 0; i < 5; i++) {
      const tracks = Array.from({ length: 3_000 }, (_, k) => ({
        ...track(`d${(k * 7 + i) % 4_000}`, 1_000_000 + i * 1000, 600_000_000 + k),
        ...(k % 3 === 0 && { height_mm: k, accuracy_mm: 0 }),
        ...(k % 5 === i && { operator_id: `op${i}`, drip }),
      }));
      send(one, { type: "delta", seq: i, t_ms: i, tracks });
      other.receive({ kind: "frame", frame: { type: "delta", seq: i, t_ms: i }, columns: structuredClone(packer.pack(tracks)), received_ms: 0 });
    }
    expect([...other.tracks.keys()]).toEqual([...one.tracks.keys()]);
    for (const id of one.tracks.keys()) {
      expect(other.tracks.get(id)).toEqual(one.tracks.get(id));
      expect(other.tracks.trail(id)).toEqual(one.tracks.trail(id));
    }
  });

  it("forgets drones that nobody hears, uses their slots again, and their trails are not the next one's", () => {
    const store = new LiveStore();
    send(store, { type: "delta", seq: 1, t_ms: 1_000_000, tracks: [track("a", 1_000_000), track("b", 1_000_000)] });
    const t_ms = 1_000_000 + TRACK_AGE_MS + 1;
    send(store, { type: "delta", seq: 2, t_ms: t_ms - 1, tracks: [track("b", t_ms - 1)] });
    send(store, { type: "delta", seq: 3, t_ms: t_ms + 40_000, tracks: [track("c", t_ms + 40_000)] });
    expect([...store.tracks.keys()]).toEqual(["b", "c"]);
    expect(store.tracks.extent).toBe(2);
    expect(store.tracks.trail("c")).toHaveLength(2);
    expect([...store.tracks.slots()].map((slot) => store.tracks.nameAt(slot))).toEqual(["b", "c"]);
  });

  it("shows another time than now where it is given one, and begins anew when told to", () => {
    let now_ms = 5_000;
    const store = new LiveStore(() => now_ms);
    send(store, { type: "delta", seq: 1, t_ms: 99_000, tracks: [track("a", 4_000)], verdicts: [verdict(1)] }, 1);
    expect(store.serverNow_ms()).toBe(5_000);
    now_ms = 1_000;
    const heard = vi.fn();
    store.subscribe(["verdicts"], heard);
    store.clear();
    expect([store.tracks.size, store.verdictsByTime().length, store.ready]).toEqual([0, 0, false]);
    expect(heard).toHaveBeenCalledTimes(1);
    expect(store.serverNow_ms()).toBe(1_000);
  });

  it("forgets drones that a new snapshot does not know, only once it is complete; keeps verdicts", () => {
    const store = new LiveStore();
    send(store, { type: "hello", epoch: "a", seq: 0, t_ms: 0, resumed: false });
    send(store, { type: "snapshot", part: 1, of: 1, tracks: [track("a", 1), track("b", 1)], verdicts: [verdict(1)] });
    expect(store.ready).toBe(true);
    store.gapFilled();
    send(store, { type: "hello", epoch: "b", seq: 0, t_ms: 0, resumed: false });
    expect(store.gap).toBe(true);
    send(store, { type: "snapshot", part: 1, of: 2, tracks: [track("b", 2)] });
    expect([...store.tracks.keys()]).toEqual(["a", "b"]);
    send(store, { type: "snapshot", part: 2, of: 2 });
    expect([...store.tracks.keys()]).toEqual(["b"]);
    expect(store.verdicts.size).toBe(1);
  });

  it("keeps what it has when a connection resumes", () => {
    const store = new LiveStore();
    send(store, { type: "hello", epoch: "a", seq: 0, t_ms: 0, resumed: false });
    send(store, { type: "snapshot", part: 1, of: 1, tracks: [track("a", 1)] });
    store.gapFilled();
    send(store, { type: "hello", epoch: "a", seq: 3, t_ms: 0, resumed: true });
    expect(store.gap).toBe(false);
    expect(store.tracks.size).toBe(1);
  });

  it("drops an estimate when its session is decided", () => {
    const store = new LiveStore();
    const session = { session_id: "s", uav_id: "a", state: "requested", requested_ms: 1, steps: [] } as unknown as SessionSummary;
    send(store, { type: "delta", seq: 1, t_ms: 1, sessions: [session], estimates: [{ uav_id: "a", session_id: "s" } as never] });
    expect(store.estimates.size).toBe(1);
    send(store, { type: "delta", seq: 2, t_ms: 2, sessions: [{ ...session, state: "decided" }] });
    expect(store.estimates.size).toBe(0);
  });

  it("stays bounded, keeping the newest verdicts", () => {
    const store = new LiveStore();
    const total = MAX_VERDICTS + 2_000;
    for (let n = 0; n < total; n += 100) {
      store.merge({ verdicts: Array.from({ length: 100 }, (_, i) => verdict(n + i)) });
    }
    expect(store.verdicts.size).toBeLessThanOrEqual(MAX_VERDICTS * 1.1);
    expect(store.verdictsByTime()[0]?.decided_ms).toBe(total - 1);
  });

  it("learns the server's clock from the least delayed frame", () => {
    const store = new LiveStore();
    send(store, { type: "delta", seq: 1, t_ms: 10_000, tracks: [] }, 5_400);
    send(store, { type: "delta", seq: 2, t_ms: 10_200, tracks: [] }, 5_250);
    send(store, { type: "delta", seq: 3, t_ms: 10_400, tracks: [] }, 5_900);
    expect(store.serverNow_ms(6_000)).toBe(6_000 + 4_950);
    expect(store.delay_ms).toBe(450);
  });
});
