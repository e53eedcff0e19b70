import type { Pad, Track } from "../api/records";
import type { LiveSource } from "../live/source";
import type { ConnectionEvent } from "../live/connection";
import { PADS } from "./cast";
import { FakeWorld } from "./world";
import { seeded } from "./random";

/** What `?fake=` may ask for, apart by commas: seconds already played, and states to look at. */
export type FakeOptions = { played_s: number; flags: ReadonlySet<string> };

export function fakeOptions(search: string): FakeOptions | undefined {
  const value = new URLSearchParams(search).get("fake");
  if (value === null) return undefined;
  const parts = value.split(",").filter((part) => part !== "");
  return {
    played_s: Number(parts.find((part) => /^\d+(\.\d+)?$/.test(part)) ?? 57),
    flags: new Set(parts.filter((part) => !/^\d/.test(part))),
  };
}

/** How many more `many` adds, to see how the console bears them. */
const CROWD = 1_000;

function crowd(t_s: number, t_ms: number): Track[] {
  return Array.from({ length: CROWD }, (_, i) => ({
    uav_id: `SE-MANY-${String(i).padStart(4, "0")}`,
    lat_e7: Math.round(604_400_000 + 500_000 * Math.sin(i * 2.399 + t_s / 60) * Math.sqrt(i / CROWD)),
    lon_e7: Math.round(222_500_000 + 1_000_000 * Math.cos(i * 2.399 + t_s / 60) * Math.sqrt(i / CROWD)),
    t_ms,
    pad_id: "aurajoki-2",
    transport: "wifi_beacon",
    verified: false,
  }));
}

/** Pads tell how they are every ten seconds: fifty ticks. */
const HEALTH_TICKS = 50;

function pads(t_ms: number): Pad[] {
  return PADS.map((pad) => ({ ...pad, ...(pad.health && { health: { ...pad.health, t_ms } }) }));
}

/**
 * The scripted world as a source of live events: `frozen` stops it after what was already played, `many`
 * adds a thousand drones, `halted`, `lagging` and `lost` show the states of ledger and connection.
 */
export function fakeSource(options: FakeOptions): { source: LiveSource; world: FakeWorld } {
  const start_ms = Date.now() - options.played_s * 1000;
  const world = new FakeWorld(start_ms, seeded(7));
  let timer: ReturnType<typeof setInterval> | undefined;
  let seq = 0;
  const t_ms = (t_s: number): number => start_ms + Math.round(t_s * 1000);
  const source: LiveSource = {
    start(receive) {
      const send = (event: ConnectionEvent): void => receive(event);
      const frame = (frame: Extract<ConnectionEvent, { kind: "frame" }>["frame"]): void =>
        send({ kind: "frame", frame, received_ms: Date.now() });
      send({ kind: "state", state: { phase: "open", since_ms: Date.now() } });
      frame({ type: "hello", epoch: "fake", seq: 0, t_ms: Date.now(), resumed: false });
      frame({ type: "snapshot", part: 1, of: 1, pads: pads(Date.now()), verdicts: world.history(), status: world.status() });
      const tick = (t_s: number): void => {
        seq += 1;
        const changes = world.tick(t_s);
        if (options.flags.has("many")) changes.tracks = [...(changes.tracks ?? []), ...crowd(t_s, t_ms(t_s))];
        const status = changes.status;
        if (status !== undefined && options.flags.has("halted")) {
          status.ledger.halted = "block 18 007 does not follow block 18 006: its previous hash is another";
        }
        if (status !== undefined && options.flags.has("lagging")) status.ledger.lag_ms = 14_300;
        frame({ type: "delta", seq, t_ms: t_ms(t_s), ...changes, ...(seq % HEALTH_TICKS === 0 && { pads: pads(t_ms(t_s)) }) });
      };
      for (let t_s = 0; t_s < options.played_s; t_s += 0.2) tick(t_s);
      if (options.flags.has("lost")) {
        send({
          kind: "state",
          state: { phase: "waiting", attempt: 4, retry_ms: Date.now() + 8_000, reason: "unreachable" },
        });
        return;
      }
      if (!options.flags.has("frozen")) {
        timer = setInterval(() => tick((Date.now() - start_ms) / 1000), 200);
      }
    },
    retry: () => undefined,
    stop: () => clearInterval(timer),
  };
  return { source, world };
}
