import { expect, it } from "vitest";
import { livePlace, liveQuery } from "../shared/address/livePlace";
import { wishesFrom } from "./mapWishes";

it("keeps what can be used of what was kept", () => {
  expect(wishesFrom(null)).toEqual({ flat: false, imagery: false, height: true, speed: false, operator: false });
  expect(wishesFrom('{"flat":true,"imagery":true,"speed":true,"height":"yes"}')).toEqual({ flat: true, imagery: true, height: true, speed: true, operator: false });
  expect(wishesFrom("not json")).toEqual(wishesFrom(null));
});

it("has the slant of the camera in the address, and reads it with care", () => {
  const camera = (at: string): unknown => livePlace(new URLSearchParams({ at })).camera;
  expect(camera("43.7,7.4,16,-38,52")).toEqual({ lat: 43.7, lon: 7.4, zoom: 16, bearing: -38, pitch: 52 });
  expect(camera("43.7,7.4,16")).toEqual({ lat: 43.7, lon: 7.4, zoom: 16 });
  expect(camera("43.7,7.4,16,-38,95")).toEqual({ lat: 43.7, lon: 7.4, zoom: 16 });
  expect(camera("43.7,7.4,16,1")).toBeUndefined();
  const written = liveQuery({ room: "live", camera: { lat: 43.7, lon: 7.4, zoom: 16, bearing: -38, pitch: 52 } }).get("at");
  expect(written).toBe("43.7000000,7.4000000,16.00,-38.0,52.0");
});
