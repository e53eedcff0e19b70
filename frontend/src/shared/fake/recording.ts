import type { LiveSource } from "../live/source";
import { ProtocolError, parseFrame, type LiveFrame } from "../live/protocol";

/** What `?source=fake:` names: the address of a recording, and how fast it plays (`…,4` is four times). */
export type RecordingOptions = { address: string; speed: number };

export function recordingOptions(search: string): RecordingOptions | undefined {
  const [, rest] = /^fake:(.+)$/.exec(new URLSearchParams(search).get("source") ?? "") ?? [];
  if (rest === undefined) return undefined;
  const [address = "", speed = ""] = rest.split(",");
  return { address, speed: Number(speed) > 0 ? Number(speed) : 1 };
}

export type Recorded = { at_ms: number; frame: LiveFrame };

/** A recording that is none. */
export class RecordingError extends Error {
  override readonly name = "RecordingError";
}

function parseLine(line: string, number: number): Recorded {
  const wrong = (why: string): RecordingError => new RecordingError(`line ${number} of the recording ${why}`);
  let parsed: unknown;
  try {
    parsed = JSON.parse(line);
  } catch {
    throw wrong("is not JSON");
  }
  const { at_ms, frame } = (typeof parsed === "object" && parsed !== null ? parsed : {}) as { at_ms?: unknown; frame?: unknown };
  if (typeof at_ms !== "number" || !(at_ms >= 0)) throw wrong('has no time "at_ms"');
  try {
    return { at_ms, frame: parseFrame(frame === undefined ? "" : JSON.stringify(frame)) };
  } catch (problem) {
    if (problem instanceof ProtocolError) throw wrong(`has no live frame: ${problem.message}`);
    throw problem;
  }
}

/**
 * A recording as scripts/record_live.py writes it: one JSON object a line, `at_ms` since its beginning and the `frame`.
 *
 * @throws RecordingError with the line that is wrong.
 */
export function parseRecording(text: string): Recorded[] {
  const lines = text.split("\n").flatMap((line, i) => (line.trim() === "" ? [] : [parseLine(line, i + 1)]));
  const [first] = lines;
  if (first?.frame.type !== "hello") throw new RecordingError("a recording begins with the server's hello");
  return lines;
}

type Environment = {
  read: (address: string) => Promise<string>;
  now: () => number;
  after: (delay_ms: number, callback: () => void) => () => void;
};

/** A recorded session as a source of live events, and the time that it shows. */
export class Recording implements LiveSource {
  private began_ms: number | undefined;
  private first_ms = 0;
  private cancel: (() => void) | undefined;

  constructor(
    private readonly options: RecordingOptions,
    private readonly environment: Environment,
  ) {}

  /** The time of the picture: the recording's own, by the server's clock. */
  readonly now_ms = (): number => {
    const elapsed_ms = this.began_ms === undefined ? 0 : this.environment.now() - this.began_ms;
    return this.first_ms + elapsed_ms * this.options.speed;
  };

  start(receive: Parameters<LiveSource["start"]>[0]): void {
    let stopped = false;
    this.cancel = () => {
      stopped = true;
    };
    receive({ kind: "state", state: { phase: "connecting", attempt: 1 } });
    this.environment.read(this.options.address).then(
      (text) => {
        if (!stopped) this.play(text, receive);
      },
      (problem: unknown) => receive(waiting(problem)),
    );
  }

  retry(): void {
    // A recording has nobody to reach.
  }

  stop(): void {
    this.cancel?.();
    this.began_ms = undefined;
  }

  private play(text: string, receive: Parameters<LiveSource["start"]>[0]): void {
    let lines: Recorded[];
    try {
      lines = parseRecording(text);
    } catch (problem) {
      receive(waiting(problem));
      return;
    }
    const { now, after } = this.environment;
    this.began_ms = now();
    const [first] = lines;
    this.first_ms = first?.frame.type === "hello" ? first.frame.t_ms : 0;
    receive({ kind: "state", state: { phase: "open", since_ms: this.began_ms } });
    let next = 0;
    const step = (): void => {
      const at_ms = (now() - (this.began_ms ?? 0)) * this.options.speed;
      for (let line = lines[next]; line !== undefined && line.at_ms <= at_ms; line = lines[++next]) {
        receive({ kind: "frame", frame: line.frame, received_ms: now() });
      }
      const coming = lines[next];
      if (coming !== undefined) this.cancel = after((coming.at_ms - at_ms) / this.options.speed, step);
    };
    step();
  }
}

function waiting(problem: unknown): Parameters<Parameters<LiveSource["start"]>[0]>[0] {
  const reason = { said: problem instanceof Error ? problem.message : String(problem) };
  return { kind: "state", state: { phase: "waiting", attempt: 1, retry_ms: 0, reason } };
}

/** A recording that the server of this page has. */
export function fetchedRecording(options: RecordingOptions): Recording {
  return new Recording(options, {
    read: async (address) => {
      const url = new URL(address, location.origin);
      if (url.origin !== location.origin) throw new RecordingError("a recording must be on the server that gave this page");
      const answer = await fetch(url);
      if (!answer.ok) throw new RecordingError(`${url.pathname}: the server answered ${answer.status}`);
      return answer.text();
    },
    now: () => Date.now(),
    after: (delay_ms, callback) => {
      const timer = setTimeout(callback, delay_ms);
      return () => clearTimeout(timer);
    },
  });
}
