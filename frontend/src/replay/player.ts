import type { ConnectionEvent } from "../shared/live/connection";
import type { LiveFrame } from "../shared/live/protocol";
import { SPEEDS, type Speed } from "../shared/address/replayPlace";

/** A line of a film: a frame as a live client would have got it, or the end and how far it came. */
export type FilmLine = LiveFrame | { type: "end"; t_ms: number; complete: boolean };
export type FilmQuery = { from_ms: number; until_ms: number; step_ms: number; snapshot: boolean };

export type PlayerState = {
  t_ms: number;
  playing: boolean;
  speed: Speed;
  /** What is to be shown is on its way. */
  waiting: boolean;
  problem: string | undefined;
};

export type PlayerEnvironment = {
  film: (query: FilmQuery, signal: AbortSignal) => AsyncIterable<FilmLine>;
  /** Takes what is to be shown, as from a live connection. */
  receive: (event: ConnectionEvent) => void;
  /** Forgets what is shown. */
  clear: () => void;
  /** A clock that never goes back, for how fast to play. */
  elapsed_ms: () => number;
  /** Now: nothing is stored of later. */
  end_ms: () => number;
};

/** Trails are a minute long: a film begins so much before the time at which one looks. */
const TRAIL_MS = 60_000;
const TRAIL_STEP_MS = 1_000;
const LIVE_STEP_MS = 200;
/** So much of real time is fetched at once, and again when less than the other is left. */
const CHUNK_MS = 10_000;
const AHEAD_MS = 5_000;
/** While the scrubber is dragged, the past is fetched at rests of so long. */
const REST_MS = 90;
export const TICK_MS = 100;

/** Plays the past into a store, as the live connection would: no framework, its clock and its frames handed in. */
export class Player {
  private state: PlayerState;
  private readonly listeners = new Set<() => void>();
  private queue: Exclude<FilmLine, { type: "end" }>[] = [];
  private fetched_ms = 0;
  private fetching: AbortController | undefined;
  private timer: ReturnType<typeof setInterval> | undefined;
  private rest: ReturnType<typeof setTimeout> | undefined;
  private ticked_ms = 0;

  constructor(
    private readonly environment: PlayerEnvironment,
    t_ms: number,
    speed: Speed = 1,
  ) {
    this.state = { t_ms, playing: false, speed, waiting: true, problem: undefined };
  }

  read = (): PlayerState => this.state;

  subscribe = (listener: () => void): (() => void) => {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  };

  /** Begins to tick, and shows the time it stands at. */
  start(): void {
    this.ticked_ms = this.environment.elapsed_ms();
    this.timer = setInterval(() => this.tick(), TICK_MS);
    this.seek(this.state.t_ms);
  }

  stop(): void {
    clearInterval(this.timer);
    clearTimeout(this.rest);
    this.fetching?.abort();
    this.fetching = undefined;
  }

  /** Goes to a time; what was known then is shown as soon as it is here. */
  seek(t_ms: number): void {
    const bounded = Math.max(0, Math.min(t_ms, this.environment.end_ms()));
    this.fetching?.abort();
    this.fetching = undefined;
    this.queue = [];
    this.change({ t_ms: bounded, waiting: true, problem: undefined });
    clearTimeout(this.rest);
    this.rest = setTimeout(() => void this.show(bounded), REST_MS);
  }

  play(): void {
    if (this.state.t_ms >= this.environment.end_ms()) return;
    this.ticked_ms = this.environment.elapsed_ms();
    this.change({ playing: true });
  }

  pause(): void {
    this.change({ playing: false });
  }

  setSpeed(speed: Speed): void {
    this.change({ speed });
  }

  /** The next of the speeds, or the one before. */
  faster(by: 1 | -1): void {
    const index = SPEEDS.indexOf(this.state.speed) + by;
    this.setSpeed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, index))] ?? 1);
  }

  tick(): void {
    const elapsed_ms = this.environment.elapsed_ms() - this.ticked_ms;
    this.ticked_ms += elapsed_ms;
    const { playing, speed, waiting, problem } = this.state;
    // While the first picture is on its way there is nothing to play on from.
    if (!playing || (waiting && this.fetched_ms < this.state.t_ms) || problem !== undefined) return;
    const end_ms = this.environment.end_ms();
    const wanted_ms = this.state.t_ms + elapsed_ms * speed;
    const t_ms = Math.max(this.state.t_ms, Math.min(wanted_ms, this.fetched_ms, end_ms));
    while (this.queue[0] !== undefined && stamp(this.queue[0]) <= t_ms) this.send(this.queue.shift());
    this.change({ t_ms, waiting: t_ms < wanted_ms && t_ms < end_ms, ...(t_ms >= end_ms && { playing: false, waiting: false }) });
    if (this.fetching === undefined && this.fetched_ms < Math.min(t_ms + AHEAD_MS * speed, end_ms)) {
      void this.fetchOn();
    }
  }

  private async show(t_ms: number): Promise<void> {
    this.fetched_ms = 0;
    const from_ms = Math.max(0, t_ms - TRAIL_MS);
    const whole = await this.run({ from_ms, until_ms: Math.max(1, t_ms), step_ms: TRAIL_STEP_MS, snapshot: true }, (line) => {
      if (line.type === "hello") {
        // What is shown stays until there is something to show instead.
        this.environment.clear();
        this.environment.receive({ kind: "state", state: { phase: "open", since_ms: 0 } });
      }
      if (line.type !== "end") this.send(line);
    });
    if (whole) {
      this.fetched_ms = t_ms;
      this.change({ waiting: false });
    }
  }

  private async fetchOn(): Promise<void> {
    const { speed } = this.state;
    const from_ms = this.fetched_ms;
    const until_ms = Math.ceil(Math.min(from_ms + CHUNK_MS * speed, this.environment.end_ms()));
    if (until_ms <= from_ms) return;
    const step_ms = Math.min(60_000, LIVE_STEP_MS * speed);
    await this.run({ from_ms, until_ms, step_ms, snapshot: false }, (line) => {
      if (line.type !== "end") this.queue.push(line);
      this.fetched_ms = Math.max(this.fetched_ms, stamp(line));
    });
  }

  /** Fetches a film, to its end if it is not given up: of one that was, nothing more is taken. */
  private async run(query: FilmQuery, take: (line: FilmLine) => void): Promise<boolean> {
    const own = new AbortController();
    this.fetching = own;
    try {
      for await (const line of this.environment.film(query, own.signal)) {
        if (this.fetching !== own) return false;
        take(line);
      }
    } catch (error) {
      if (this.fetching !== own) return false;
      this.fetching = undefined;
      this.change({ problem: error instanceof Error ? error.message : String(error), waiting: false, playing: false });
      return false;
    }
    if (this.fetching !== own) return false;
    this.fetching = undefined;
    return true;
  }

  private send(frame: LiveFrame | undefined): void {
    if (frame !== undefined) this.environment.receive({ kind: "frame", frame, received_ms: stamp(frame) });
  }

  private change(change: Partial<PlayerState>): void {
    const before = this.state;
    const changed = (Object.keys(change) as (keyof PlayerState)[]).some((name) => before[name] !== change[name]);
    if (!changed) return;
    this.state = { ...before, ...change };
    for (const listener of this.listeners) listener();
  }
}

function stamp(line: FilmLine): number {
  return line.type === "snapshot" ? 0 : line.t_ms;
}
