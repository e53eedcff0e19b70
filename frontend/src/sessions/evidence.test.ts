import { describe, expect, it } from "vitest";
import { Api } from "../shared/api/api";
import { evidenceFile, FORMAT } from "./evidence";

const ANSWERS: Readonly<Record<string, unknown>> = {
  "/api/v1/sessions/s1": { session: { uav_id: "uav-1" }, transactions: [{ block: 7 }, { block: 5 }, { block: 7 }] },
  "/api/v1/status": { ledger: { channel: "wonderland" } },
  "/api/v1/blocks/5": { number: 5, header_hash: "h5", previous_hash: "h4", data_hash: "d5", more: 1 },
  "/api/v1/blocks/7": { number: 7, header_hash: "h7", previous_hash: "h6", data_hash: "d7" },
};

describe("the evidence file", () => {
  it("holds the session and each of its blocks once, byte for byte", async () => {
    const api = new Api("http://console.test", ({ url }) => {
      const path = new URL(url).pathname;
      if (path.endsWith("/data")) return Promise.resolve(new Response(Uint8Array.of(0, 255, Number(path.split("/").at(-2)))));
      const found = ANSWERS[path];
      return Promise.resolve(new Response(JSON.stringify(found), { status: found === undefined ? 404 : 200, headers: { "Content-Type": "application/json" } }));
    });
    const file = await evidenceFile(api, "s1", 12.4);
    expect(file).toMatchObject({ format: FORMAT, exported_ms: 12, channel: "wonderland", session: { session: { uav_id: "uav-1" } } });
    expect(file.blocks).toEqual([
      { number: 5, header_hash: "h5", previous_hash: "h4", data_hash: "d5", data_base64: "AP8F" },
      { number: 7, header_hash: "h7", previous_hash: "h6", data_hash: "d7", data_base64: "AP8H" },
    ]);
  });
});
