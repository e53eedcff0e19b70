import { PMTiles } from "pmtiles";
import { afterEach, expect, it, vi } from "vitest";
import { ArchiveSource, AWAY, Directories } from "./archiveSource";

afterEach(() => {
  vi.unstubAllGlobals();
  vi.useRealTimers();
});

const noAnswer = async (): Promise<never> => Promise.reject(new TypeError("Failed to fetch"));

it("calls what nobody wants any longer no failure, whatever the browser calls it", async () => {
  const wanted = new AbortController();
  vi.stubGlobal("fetch", () => {
    wanted.abort();
    return noAnswer();
  });
  await expect(new ArchiveSource("/a").getBytes(0, 1, wanted.signal)).rejects.toMatchObject({ name: "AbortError" });
});

it("asks once more, then says that the archive is away", async () => {
  vi.useFakeTimers();
  const fetch = vi.fn(noAnswer);
  vi.stubGlobal("fetch", fetch);
  const asked = expect(new ArchiveSource("/a").getBytes(0, 1)).rejects.toThrow(AWAY);
  await vi.runAllTimersAsync();
  await asked;
  expect(fetch).toHaveBeenCalledTimes(2);
});

it("reads an archive anew that could not be read before", async () => {
  vi.useFakeTimers();
  const fetch = vi.fn(noAnswer);
  vi.stubGlobal("fetch", fetch);
  const archive = new PMTiles(new ArchiveSource("/a"), new Directories());
  for (const times of [2, 4]) {
    const asked = expect(archive.getHeader()).rejects.toThrow(AWAY);
    await vi.runAllTimersAsync();
    await asked;
    expect(fetch).toHaveBeenCalledTimes(times);
  }
});
