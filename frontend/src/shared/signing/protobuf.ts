/**
 * A strict reader of protocol buffers, for bytes that are about to be signed: each field is known, stands once and has
 * the type that it must have. What a lenient reader would pass over in silence must not be signed unseen.
 */

export class ProtobufError extends Error {
  override readonly name = "ProtobufError";
}

/** How a field is read; `many` may stand any number of times. */
export type Field = { name: string; kind: "bytes" | "number"; many?: true };
export type Message = Readonly<Record<number, Field>>;
type Found = { bytes: ReadonlyMap<string, readonly Uint8Array[]>; numbers: ReadonlyMap<string, number> };

const VARINT = 0;
const LENGTH_DELIMITED = 2;

class Reader {
  private at = 0;

  constructor(private readonly data: Uint8Array) {}

  get done(): boolean {
    return this.at >= this.data.length;
  }

  varint(): number {
    let value = 0;
    for (let shift = 0; shift < 56; shift += 7) {
      const byte = this.data[this.at++];
      if (byte === undefined) throw new ProtobufError("ends within a number");
      value += (byte & 0x7f) * 2 ** shift;
      if (byte < 0x80) {
        if (!Number.isSafeInteger(value)) break;
        return value;
      }
    }
    throw new ProtobufError("a number that is too large");
  }

  take(length: number): Uint8Array {
    if (length > this.data.length - this.at) throw new ProtobufError("ends within a field");
    const part = this.data.subarray(this.at, this.at + length);
    this.at += length;
    return part;
  }
}

/** The fields of a message. Throws `ProtobufError` for whatever is not as the description says. */
export function read(what: string, data: Uint8Array, fields: Message): Found {
  const reader = new Reader(data);
  const bytes = new Map<string, Uint8Array[]>();
  const numbers = new Map<string, number>();
  while (!reader.done) {
    const tag = reader.varint();
    const field = fields[Math.floor(tag / 8)];
    const wire = tag % 8;
    if (field === undefined) throw new ProtobufError(`${what}: an unknown field ${Math.floor(tag / 8)}`);
    if (wire !== (field.kind === "number" ? VARINT : LENGTH_DELIMITED)) throw new ProtobufError(`${what}: ${field.name} has another type`);
    if (field.kind === "number") {
      if (numbers.has(field.name)) throw new ProtobufError(`${what}: ${field.name} stands twice`);
      numbers.set(field.name, reader.varint());
      continue;
    }
    const before = bytes.get(field.name) ?? [];
    if (before.length > 0 && field.many !== true) throw new ProtobufError(`${what}: ${field.name} stands twice`);
    bytes.set(field.name, [...before, reader.take(reader.varint())]);
  }
  return { bytes, numbers };
}

/** The one value of a field; empty where it is left out, as protocol buffers have it. */
export function one(found: Found, name: string): Uint8Array {
  return found.bytes.get(name)?.[0] ?? new Uint8Array();
}
