/**
 * Frames of a socket as text, in the order they came: short ones come as text, long ones packed by zlib
 * (`docs/seams.md`, "Backend to browser: live").
 */
export class FramesInOrder {
  private last = Promise.resolve();
  private ended = false;

  /** `broken` is called once, if a frame cannot be unpacked; nothing is received after it. */
  constructor(
    private readonly receive: (text: string) => void,
    private readonly broken: () => void,
  ) {}

  take(data: unknown): void {
    const text = data instanceof ArrayBuffer ? unpacked(data) : Promise.resolve(typeof data === "string" ? data : "");
    // Handled below, when its turn comes; until then nobody waits for it.
    text.catch(() => undefined);
    this.afterAll(async () => {
      this.receive(await text);
    });
  }

  /** Runs when all frames taken so far were received: not before the last word of a socket is its end told. */
  afterAll(act: () => Promise<void> | void): void {
    this.last = this.last.then(async () => {
      if (this.ended) return;
      try {
        await act();
      } catch {
        this.ended = true;
        this.broken();
      }
    });
  }

  /** Nothing is received any more. */
  end(): void {
    this.ended = true;
  }
}

async function unpacked(data: ArrayBuffer): Promise<string> {
  const stream = new Blob([data]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).text();
}
