import { describe, expect, it } from "vitest";
import type { ConnectionEvent } from "../live/connection";
import { LiveStore } from "../live/store";
import { parseRecording, Recording, RecordingError, recordingOptions } from "./recording";

const track = (t_ms: number): object => ({ uav_id: "a", lat_e7: t_ms, lon_e7: 1, t_ms, pad_id: "p", transport: "wifi", verified: false });
const LINES = [
  { at_ms: 0, frame: { type: "hello", epoch: "e", seq: 1, t_ms: 5_000_000, resumed: false } },
  { at_ms: 3, frame: { type: "snapshot", part: 1, of: 1, tracks: [track(5_000_000)] } },
  { at_ms: 400, frame: { type: "delta", seq: 2, t_ms: 5_000_400, tracks: [track(5_000_400)] } },
  { at_ms: 8_000, frame: { type: "delta", seq: 3, t_ms: 5_008_000, tracks: [track(5_008_000)] } },
];
const text = (lines: readonly object[]): string => lines.map((line) => JSON.stringify(line)).join("\n");

describe("a recording", () => {
  it("plays at its own time, or faster, into a store that shows that time", async () => {
    let now = 100;
    let timer: { at: number; callback: () => void } | undefined;
    const recording = new Recording(
      { address: "/r", speed: 4 },
      {
        read: () => Promise.resolve(text(LINES)),
        now: () => now,
        after: (delay, callback) => {
          timer = { at: now + delay, callback };
          return () => {
            timer = undefined;
          };
        },
      },
    );
    const store = new LiveStore(recording.now_ms);
    recording.start((event) => store.receive(event));
    await Promise.resolve();
    await Promise.resolve();
    const run = (to: number): void => {
      while (timer !== undefined && timer.at <= to) {
        now = timer.at;
        timer.callback();
        if (timer.at <= now) break;
      }
      now = to;
    };
    run(110);
    expect(store.ready).toBe(true);
    expect(store.tracks.get("a")?.t_ms).toBe(5_000_000);
    run(205);
    expect(store.tracks.get("a")?.t_ms).toBe(5_000_400);
    expect(store.serverNow_ms()).toBe(5_000_420);
    run(100 + 2_001);
    expect(store.tracks.get("a")?.t_ms).toBe(5_008_000);
  });

  it("says which line is wrong, and that a file is not there", async () => {
    expect(() => parseRecording(text(LINES.slice(1)))).toThrow(RecordingError);
    expect(() => parseRecording(`${text(LINES)}\nnonsense`)).toThrow("line 5 of the recording is not JSON");
    expect(() => parseRecording(`${text(LINES)}\n{"frame":{}}`)).toThrow('line 5 of the recording has no time "at_ms"');
    expect(() => parseRecording(`${text(LINES)}\n{"at_ms":1}`)).toThrow("line 5 of the recording has no live frame");
    expect(() => parseRecording(`${text(LINES)}\n{"at_ms":1,"frame":{"type":"delta","seq":1}}`)).toThrow('no whole number "t_ms"');
    const events: ConnectionEvent[] = [];
    const environment = { read: () => Promise.reject(new Error("not there")), now: () => 0, after: () => () => undefined };
    new Recording({ address: "/r", speed: 1 }, environment).start((event) => events.push(event));
    await Promise.resolve();
    await Promise.resolve();
    expect(events.at(-1)).toMatchObject({ state: { phase: "waiting", reason: { said: "not there" } } });
  });

  it("is named in the address", () => {
    expect(recordingOptions("?source=fake:/recordings/a.jsonl,8")).toEqual({ address: "/recordings/a.jsonl", speed: 8 });
    expect(recordingOptions("?source=fake:/a.jsonl,-1")).toEqual({ address: "/a.jsonl", speed: 1 });
    expect(recordingOptions("?source=other:/a")).toBeUndefined();
    expect(recordingOptions("")).toBeUndefined();
  });
});
