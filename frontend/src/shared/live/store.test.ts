import { describe, expect, it, vi } from "vitest";
import type { SessionState, Track, VerdictSummary } from "../api/records";
import { MAX_VERDICTS, LiveStore, TRAIL_MS } from "./store";
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

  it("keeps a minute of trail and leaves out what came late", () => {
    const store = new LiveStore();
    for (let i = 0; i <= 100; i++) send(store, { type: "delta", seq: i, t_ms: i, tracks: [track("a", i * 1000)] });
    send(store, { type: "delta", seq: 200, t_ms: 200, tracks: [track("a", 50_000)] });
    const trail = store.trails.get("a") ?? [];
    expect(trail.at(-1)?.t_ms).toBe(100_000);
    expect(trail[0]?.t_ms).toBe(100_000 - TRAIL_MS);
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
    const session = { session_id: "s", uav_id: "a", state: "requested", requested_ms: 1, steps: [] } as unknown as SessionState;
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
  });
});
