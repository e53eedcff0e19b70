import type { LiveDelta, LiveHello, LiveSnapshot } from "../api/records";

/** What a snapshot's part or a delta may bring. */
export type Changes = Omit<LiveDelta, "type" | "seq" | "t_ms">;
export type LiveFrame = LiveHello | LiveSnapshot | LiveDelta;

/** A frame that is not what the protocol promises. */
export class ProtocolError extends Error {
  override readonly name = "ProtocolError";
}

const LISTS = ["tracks", "estimates", "sessions", "verdicts", "pads", "alerts"] as const;

function isObject(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function whole(frame: Record<string, unknown>, field: string): void {
  if (!Number.isSafeInteger(frame[field])) {
    throw new ProtocolError(`the server's ${String(frame["type"])} frame has no whole number "${field}"`);
  }
}

/**
 * One text frame, checked in its outline: type, sequence numbers, and that what must be a list of objects is one.
 *
 * The records inside are the server's own and come over the session that it authenticated; they are not checked field
 * by field.
 *
 * @throws ProtocolError with what was wrong.
 */
export function parseFrame(text: string): LiveFrame {
  let frame: unknown;
  try {
    frame = JSON.parse(text);
  } catch {
    throw new ProtocolError("the server sent a frame that is not JSON");
  }
  if (!isObject(frame)) throw new ProtocolError("the server sent a frame that is not an object");
  switch (frame["type"]) {
    case "hello":
      whole(frame, "seq");
      whole(frame, "t_ms");
      if (typeof frame["epoch"] !== "string") throw new ProtocolError('the server\'s hello has no text "epoch"');
      break;
    case "snapshot":
      whole(frame, "part");
      whole(frame, "of");
      break;
    case "delta":
      whole(frame, "seq");
      whole(frame, "t_ms");
      break;
    default:
      throw new ProtocolError(`the server sent a frame of unknown type ${JSON.stringify(frame["type"])}`);
  }
  for (const name of LISTS) {
    const list = frame[name];
    if (list !== undefined && !(Array.isArray(list) && list.every(isObject))) {
      throw new ProtocolError(`"${name}" in the server's frame is not a list of objects`);
    }
  }
  if (frame["status"] !== undefined && !isObject(frame["status"])) {
    throw new ProtocolError('"status" in the server\'s frame is not an object');
  }
  return frame as LiveFrame;
}
