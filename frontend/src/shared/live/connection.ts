import type { TrackColumns } from "./columns";
import { ProtocolError, parseFrame, type LiveFrame } from "./protocol";

/** Why there is no connection: what this end saw, or what was said. */
export type Loss = "unreachable" | "unanswered" | "silent" | { said: string };

/** How the connection stands, for the banner. */
export type ConnectionState =
  | { phase: "connecting"; attempt: number }
  | { phase: "open"; since_ms: number }
  | { phase: "waiting"; attempt: number; retry_ms: number; reason: Loss }
  | { phase: "signed-out" };

export type ConnectionEvent =
  | { kind: "state"; state: ConnectionState }
  /** `columns`: the frame's tracks, where the source packs them. */
  | { kind: "frame"; frame: LiveFrame; columns?: TrackColumns; received_ms: number }
  /** The server dropped us because we fell behind: verdicts may be missing and must be fetched by block. */
  | { kind: "fell-behind" };

/** The part of a WebSocket that the connection uses. */
export type Socket = {
  onopen: (() => void) | null;
  onmessage: ((text: string) => void) | null;
  onclose: ((code: number, reason: string) => void) | null;
  close: () => void;
};

export type Environment = {
  /** Opens a socket to the live address, resuming after `since` where it is given. */
  open: (since: string | undefined) => Socket;
  now: () => number;
  random: () => number;
  /** Calls back once after a time; returns its cancellation. */
  after: (delay_ms: number, callback: () => void) => () => void;
  emit: (event: ConnectionEvent) => void;
};

export const FELL_BEHIND = 4408;
export const NOT_SIGNED_IN = 4401;
export const FIRST_RETRY_MS = 500;
export const LAST_RETRY_MS = 30_000;
/** A socket that neither opens nor fails in this time is given up. */
export const OPEN_TIMEOUT_MS = 10_000;
/** The server sends something every two seconds; an open socket without three of these and their way here is dead. */
export const SILENCE_MS = 7_000;

/** Waits double from half a second to thirty, each spread over its upper half so that clients do not come in step. */
export function retryDelay(attempt: number, random: number): number {
  const whole = Math.min(LAST_RETRY_MS, FIRST_RETRY_MS * 2 ** Math.min(attempt - 1, 16));
  return Math.round(whole / 2 + (whole / 2) * random);
}

/**
 * Keeps the live connection: opens, resumes where it was, and tries again with growing waits.
 *
 * It performs no I/O itself; clock, randomness, timers and socket come with the environment.
 */
export class LiveConnection {
  private socket: Socket | undefined;
  /** Ends the one timer: for an answer, the next frame, or the next try. */
  private cancel: (() => void) | undefined;
  private attempt = 0;
  private epoch: string | undefined;
  private seq = 0;
  /** A snapshot under way covers everything before its hello; resuming in the middle of it would lose the rest. */
  private complete = false;
  private parts = 0;
  private stopped = true;

  constructor(private readonly environment: Environment) {}

  start(): void {
    if (!this.stopped) return;
    this.stopped = false;
    this.attempt = 0;
    this.connect();
  }

  stop(): void {
    this.stopped = true;
    this.drop();
  }

  /** Tries at once instead of waiting; does nothing while a connection is open or opening. */
  retryNow(): void {
    if (this.stopped || this.socket !== undefined) return;
    this.cancel?.();
    this.connect();
  }

  /** Where a new connection resumes; undefined where it needs a snapshot. */
  get since(): string | undefined {
    return this.complete && this.epoch !== undefined ? `${this.epoch}:${this.seq}` : undefined;
  }

  private drop(): void {
    this.cancel?.();
    this.cancel = undefined;
    const socket = this.socket;
    this.socket = undefined;
    if (socket !== undefined) {
      socket.onopen = socket.onmessage = socket.onclose = null;
      socket.close();
    }
  }

  private connect(): void {
    this.attempt += 1;
    const { environment } = this;
    environment.emit({ kind: "state", state: { phase: "connecting", attempt: this.attempt } });
    const socket = environment.open(this.since);
    this.socket = socket;
    this.cancel = environment.after(OPEN_TIMEOUT_MS, () => this.lost("unanswered"));
    socket.onmessage = (text) => this.received(text);
    socket.onclose = (code, reason) => this.closed(code, reason);
  }

  private received(text: string): void {
    let frame: LiveFrame;
    try {
      frame = parseFrame(text);
    } catch (error) {
      if (!(error instanceof ProtocolError)) throw error;
      this.complete = false;
      this.lost({ said: error.message });
      return;
    }
    const received_ms = this.environment.now();
    this.cancel?.();
    this.cancel = this.environment.after(SILENCE_MS, () => this.lost("silent"));
    if (frame.type === "hello") {
      this.attempt = 0;
      if (!frame.resumed) this.complete = false;
      this.parts = 0;
      this.epoch = frame.epoch;
      this.seq = frame.seq;
      this.environment.emit({ kind: "state", state: { phase: "open", since_ms: received_ms } });
    } else if (frame.type === "snapshot") {
      this.parts += 1;
      if (this.parts >= frame.of) this.complete = true;
    } else {
      this.seq = frame.seq;
    }
    this.environment.emit({ kind: "frame", frame, received_ms });
  }

  private closed(code: number, reason: string): void {
    if (code === FELL_BEHIND) this.environment.emit({ kind: "fell-behind" });
    if (code === NOT_SIGNED_IN) {
      this.stop();
      this.environment.emit({ kind: "state", state: { phase: "signed-out" } });
      return;
    }
    if (reason === "" && code === 1006) this.lost("unreachable");
    else this.lost({ said: reason || `WebSocket ${code}` });
  }

  private lost(reason: Loss): void {
    this.drop();
    const attempt = Math.max(1, this.attempt);
    const delay = retryDelay(attempt, this.environment.random());
    const retry_ms = this.environment.now() + delay;
    this.environment.emit({ kind: "state", state: { phase: "waiting", attempt, retry_ms, reason } });
    this.cancel = this.environment.after(delay, () => this.connect());
  }
}
