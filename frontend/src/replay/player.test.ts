import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { ConnectionEvent } from "../shared/live/connection";
import { Player, TICK_MS, type FilmLine, type FilmQuery } from "./player";

const END = 2_000_000;

/** A past in which each second has a delta, and a player with clocks in the hand. */
function setUp(options: { fail?: boolean } = {}) {
  let elapsed = 0;
  const asked: FilmQuery[] = [];
  const received: ConnectionEvent[] = [];
  const cleared = vi.fn(() => received.splice(0));
  async function* film(query: FilmQuery, signal: AbortSignal): AsyncGenerator<FilmLine> {
    asked.push(query);
    await Promise.resolve();
    if (options.fail) throw new Error("the server cannot be reached");
    if (query.snapshot) {
      yield { type: "hello", epoch: "replay", seq: 0, t_ms: query.from_ms, resumed: false };
      yield { type: "snapshot", part: 1, of: 1 };
    }
    for (let t_ms = query.from_ms + query.step_ms; t_ms <= query.until_ms; t_ms += query.step_ms) {
      if (signal.aborted) return;
      yield { type: "delta", seq: t_ms, t_ms };
    }
    yield { type: "end", t_ms: query.until_ms, complete: true };
  }
  const player = new Player(
    { film, receive: (event) => received.push(event), clear: cleared, elapsed_ms: () => elapsed, end_ms: () => END },
    1_000_000,
  );
  player.start();
  const pass = async (ms: number): Promise<void> => {
    for (let at = 0; at < ms; at += TICK_MS) {
      elapsed += TICK_MS;
      await vi.advanceTimersByTimeAsync(TICK_MS);
    }
  };
  const shown = (): number => Math.max(0, ...received.map((event) => (event.kind === "frame" && event.frame.type === "delta" ? event.frame.t_ms : 0)));
  return { player, asked, received, cleared, pass, shown };
}

beforeEach(() => vi.useFakeTimers());
afterEach(() => vi.useRealTimers());

describe("the player", () => {
  it("shows a time with the minute before it, and waits", async () => {
    const { player, asked, shown, pass } = setUp();
    await pass(500);
    expect(asked).toEqual([{ from_ms: 940_000, until_ms: 1_000_000, step_ms: 1_000, snapshot: true }]);
    expect(shown()).toBe(1_000_000);
    expect(player.read()).toMatchObject({ t_ms: 1_000_000, playing: false, waiting: false });
  });

  it.each([1, 10, 60] as const)("plays at %d times, showing nothing before its time", async (speed) => {
    const { player, pass, shown } = setUp();
    await pass(500);
    player.setSpeed(speed);
    player.play();
    await pass(5_000);
    const { t_ms } = player.read();
    expect(t_ms).toBeGreaterThan(1_000_000 + 4_000 * speed);
    expect(t_ms).toBeLessThanOrEqual(1_000_000 + 5_000 * speed);
    expect(shown()).toBeLessThanOrEqual(t_ms);
    expect(shown()).toBeGreaterThan(t_ms - 2 * 200 * speed - 1);
  });

  it("goes back: what came later is forgotten", async () => {
    const { player, pass, shown, cleared } = setUp();
    await pass(500);
    player.play();
    await pass(2_000);
    player.pause();
    player.seek(970_000);
    await pass(500);
    expect(cleared).toHaveBeenCalledTimes(2);
    expect(shown()).toBe(970_000);
  });

  it("fetches where the scrubber rests, not wherever it was dragged over", async () => {
    const { player, asked, pass } = setUp();
    await pass(500);
    for (let i = 0; i < 20; i++) {
      player.seek(900_000 + i);
      await vi.advanceTimersByTimeAsync(20);
    }
    await pass(500);
    expect(asked.length).toBe(2);
    expect(asked.at(-1)?.until_ms).toBe(900_019);
  });

  it("stops at now, and does not play on from there", async () => {
    const { player, pass } = setUp();
    player.seek(END - 3_000);
    await pass(500);
    player.setSpeed(60);
    player.play();
    await pass(2_000);
    expect(player.read()).toMatchObject({ t_ms: END, playing: false, waiting: false });
    player.play();
    expect(player.read().playing).toBe(false);
    player.seek(END + 50_000);
    expect(player.read().t_ms).toBe(END);
  });

  it("says what went wrong, and gets over it", async () => {
    const options = { fail: true };
    const { player, pass } = setUp(options);
    await pass(500);
    expect(player.read().problem).toBe("the server cannot be reached");
    options.fail = false;
    player.seek(player.read().t_ms);
    await pass(500);
    expect(player.read()).toMatchObject({ problem: undefined, waiting: false });
  });
});
