import { beforeEach, describe, expect, it } from "vitest";
import { LiveConnection, OPEN_TIMEOUT_MS, SILENCE_MS, retryDelay, type ConnectionEvent, type Socket } from "./connection";
import { ProtocolError, parseFrame } from "./protocol";

class FakeSocket implements Socket {
  onopen: (() => void) | null = null;
  onmessage: ((text: string) => void) | null = null;
  onclose: ((code: number, reason: string) => void) | null = null;
  closed = false;
  constructor(readonly since: string | undefined) {}
  close(): void {
    this.closed = true;
  }
  say(frame: object): void {
    this.onmessage?.(JSON.stringify(frame));
  }
}

let sockets: FakeSocket[];
let timers: { at: number; callback: () => void }[];
let now: number;
let events: ConnectionEvent[];
let connection: LiveConnection;

function advance(ms: number): void {
  const end = now + ms;
  for (;;) {
    const next = timers.filter(({ at }) => at <= end).sort((a, b) => a.at - b.at)[0];
    if (next === undefined) break;
    timers.splice(timers.indexOf(next), 1);
    now = next.at;
    next.callback();
  }
  now = end;
}

const socket = (): FakeSocket => sockets.at(-1) ?? expect.fail("no socket was opened");
const state = (): unknown => events.flatMap((event) => (event.kind === "state" ? [event.state] : [])).at(-1);
const hello = (seq: number, resumed: boolean): object => ({ type: "hello", epoch: "e1", seq, t_ms: 5, resumed });

beforeEach(() => {
  sockets = [];
  timers = [];
  events = [];
  now = 1_000;
  connection = new LiveConnection({
    open: (since) => {
      const made = new FakeSocket(since);
      sockets.push(made);
      return made;
    },
    now: () => now,
    random: () => 0.5,
    after: (delay, callback) => {
      const timer = { at: now + delay, callback };
      timers.push(timer);
      return () => {
        timers = timers.filter((each) => each !== timer);
      };
    },
    emit: (event) => events.push(event),
  });
  connection.start();
});

describe("the live connection", () => {
  it("resumes at the last delta after a complete snapshot", () => {
    socket().say(hello(7, false));
    socket().say({ type: "snapshot", part: 1, of: 2 });
    socket().say({ type: "snapshot", part: 2, of: 2 });
    socket().say({ type: "delta", seq: 8, t_ms: 9 });
    socket().onclose?.(1006, "");
    expect(state()).toMatchObject({ phase: "waiting", reason: "unreachable" });
    advance(1_000);
    expect(sockets).toHaveLength(2);
    expect(socket().since).toBe("e1:8");
  });

  it("does not resume in the middle of a snapshot", () => {
    socket().say(hello(7, false));
    socket().say({ type: "snapshot", part: 1, of: 2 });
    socket().onclose?.(1001, "going away");
    advance(30_000);
    expect(socket().since).toBeUndefined();
  });

  it("waits longer each time, up to half a minute, and begins anew after a success", () => {
    const waits: number[] = [];
    for (let i = 0; i < 9; i++) {
      const before = now;
      const had = sockets.length;
      socket().onclose?.(1006, "");
      while (sockets.length === had) advance(5);
      waits.push(now - before);
    }
    expect(waits[0]).toBeLessThanOrEqual(500);
    expect(waits[3]).toBeGreaterThan(waits[1] ?? 0);
    expect(waits[8]).toBeLessThanOrEqual(30_000);
    expect(waits[8]).toBeGreaterThanOrEqual(15_000);
    socket().say(hello(1, true));
    socket().onclose?.(1006, "");
    expect(state()).toMatchObject({ phase: "waiting", retry_ms: now + retryDelay(1, 0.5) });
  });

  it("gives up a socket that never says hello", () => {
    advance(OPEN_TIMEOUT_MS);
    expect(sockets[0]?.closed).toBe(true);
    expect(state()).toMatchObject({ phase: "waiting", reason: "unanswered" });
  });

  it("gives up an open socket on which nothing comes any more, and resumes", () => {
    socket().say(hello(7, false));
    socket().say({ type: "snapshot", part: 1, of: 1 });
    for (let seq = 8; seq < 20; seq++) {
      advance(SILENCE_MS - 1);
      socket().say({ type: "delta", seq, t_ms: now });
    }
    expect(sockets).toHaveLength(1);
    advance(SILENCE_MS);
    expect(sockets[0]?.closed).toBe(true);
    expect(state()).toMatchObject({ phase: "waiting", reason: "silent" });
    advance(1_000);
    expect(socket().since).toBe("e1:19");
  });

  it("gives up a socket that falls silent in the middle of a snapshot", () => {
    socket().say(hello(7, false));
    socket().say({ type: "snapshot", part: 1, of: 2 });
    advance(SILENCE_MS);
    expect(state()).toMatchObject({ phase: "waiting", reason: "silent" });
  });

  it("says when it fell behind, so that verdicts are fetched, and when it is signed out, so that nobody waits", () => {
    socket().say(hello(1, true));
    socket().onclose?.(4408, "");
    expect(events.some(({ kind }) => kind === "fell-behind")).toBe(true);
    advance(1_000);
    socket().onclose?.(4401, "sign in first");
    expect(state()).toEqual({ phase: "signed-out" });
    advance(100_000);
    expect(sockets).toHaveLength(2);
  });

  it("drops a server that breaks the protocol, and asks it for a snapshot next", () => {
    socket().say(hello(1, false));
    socket().say({ type: "snapshot", part: 1, of: 1 });
    socket().say({ type: "delta", seq: "8", t_ms: 9 });
    expect(sockets[0]?.closed).toBe(true);
    expect(state()).toMatchObject({ phase: "waiting" });
    advance(30_000);
    expect(socket().since).toBeUndefined();
  });

  it("retries at once when told to, but not beside an open connection", () => {
    connection.retryNow();
    expect(sockets).toHaveLength(1);
    socket().onclose?.(1006, "");
    connection.retryNow();
    expect(sockets).toHaveLength(2);
    advance(OPEN_TIMEOUT_MS - 1);
    expect(sockets).toHaveLength(2);
  });

  it("stays stopped", () => {
    connection.stop();
    expect(sockets[0]?.closed).toBe(true);
    advance(100_000);
    expect(sockets).toHaveLength(1);
  });
});

describe("frames", () => {
  it.each([
    ["", "not JSON"],
    ["[]", "not an object"],
    ['{"type":"surprise"}', "unknown type"],
    ['{"type":"hello","seq":1,"t_ms":1}', "epoch"],
    ['{"type":"hello","epoch":"a","seq":1.5,"t_ms":1}', "seq"],
    ['{"type":"delta","seq":1,"t_ms":1,"tracks":{}}', "tracks"],
    ['{"type":"delta","seq":1,"t_ms":1,"verdicts":[1]}', "verdicts"],
    ['{"type":"snapshot","part":1}', "of"],
    ['{"type":"delta","seq":1,"t_ms":1,"status":"fine"}', "status"],
  ])("refuses %s", (text, why) => {
    expect(() => parseFrame(text)).toThrow(ProtocolError);
    expect(() => parseFrame(text)).toThrow(why);
  });
});
