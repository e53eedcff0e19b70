import { describe, expect, it } from "vitest";
import { FramesInOrder } from "./unpacking";

const packed = (text: string): Promise<ArrayBuffer> =>
  new Response(new Blob([text]).stream().pipeThrough(new CompressionStream("deflate"))).arrayBuffer();

function harness() {
  const got: string[] = [];
  const frames = new FramesInOrder(
    (text) => got.push(text),
    () => got.push("broken"),
  );
  const settled = () => new Promise<void>((resolve) => frames.afterAll(resolve));
  return { got, frames, settled };
}

describe("frames of the live socket", () => {
  it("keeps their order, packed or not", async () => {
    const { got, frames, settled } = harness();
    const long = "å".repeat(200_000);
    frames.take(await packed(long));
    frames.take("short");
    frames.take(await packed("{}"));
    frames.afterAll(() => void got.push("closed"));
    await settled();
    expect(got).toEqual([long, "short", "{}", "closed"]);
  });

  it("says once that a frame is broken, and receives nothing after it", async () => {
    const { got, frames } = harness();
    frames.take("first");
    frames.take((await packed("x".repeat(5_000))).slice(0, 20));
    frames.take("third");
    frames.afterAll(() => void got.push("closed"));
    await expect.poll(() => got).toEqual(["first", "broken"]);
    frames.take("fourth");
    await new Promise((resolve) => setTimeout(resolve, 20));
    expect(got).toEqual(["first", "broken"]);
  });

  it("receives nothing after its end", async () => {
    const { got, frames } = harness();
    frames.take(await packed("late"));
    frames.end();
    await new Promise((resolve) => setTimeout(resolve, 20));
    expect(got).toEqual([]);
  });

  it("treats a failing receiver as broken, not as an unhandled rejection", async () => {
    const said: string[] = [];
    const frames = new FramesInOrder(
      () => {
        throw new Error("no");
      },
      () => said.push("broken"),
    );
    frames.take("one");
    frames.take("two");
    await expect.poll(() => said).toEqual(["broken"]);
  });
});
