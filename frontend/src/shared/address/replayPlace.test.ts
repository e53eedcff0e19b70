import { describe, expect, it } from "vitest";
import { parsePlace, placeHash } from "./location";
import { replayAddress, replayHash, replayPlace } from "./replayPlace";

describe("the replay's address", () => {
  it("comes back as it was written", () => {
    const place = {
      t_ms: 1_795_338_320_123,
      speed: 10,
      span: "day",
      live: { room: "live", drone: "FIN 1/2", session: "a".repeat(64), camera: { lat: 60.45, lon: 22.26, zoom: 12 }, list: "pads", follow: true, measure: [[22.25, 60.5]], zone: ["FIN:P20"], zones: "off", as: "table" },
    } as const;
    const parsed = parsePlace(placeHash(replayAddress(place)));
    expect(parsed.room).toBe("replay");
    expect(replayPlace(parsed.room === "replay" ? parsed.query : {})).toEqual(place);
  });

  it("makes do with nonsense", () => {
    expect(replayPlace({ t: "soon", speed: "7", span: "aeon", at: "1,2" })).toEqual({ t_ms: undefined, speed: 1, span: "hour", live: { room: "live" } });
  });

  it("links from other rooms", () => {
    expect(replayHash(0, { session: "s" })).toBe("#/replay?t=1970-01-01T00%3A00%3A00.000Z&session=s");
  });
});
