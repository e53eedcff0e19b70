import { expect, it } from "vitest";
import { PADS } from "../shared/fake/cast";
import { seeded } from "../shared/fake/random";
import { FakeWorld } from "../shared/fake/world";
import { droneOf } from "../shared/fleet";
import { LiveStore } from "../shared/live/store";
import { rowText } from "./words";

const START_MS = 1_700_000_000_000;

it("gives each row of the list its two texts", () => {
  const store = new LiveStore();
  const world = new FakeWorld(START_MS, seeded(1));
  store.merge({ pads: [...PADS] });
  for (let t_s = 0; t_s <= 58; t_s += 0.2) store.merge(world.tick(t_s));
  const text = (id: string): { right: string; second: string } => {
    const drone = droneOf(store, id, START_MS + 58_000) ?? expect.fail(`${id} is not there`);
    const { right, second } = rowText(drone, (pad) => PADS.find(({ pad_id }) => pad_id === pad)?.name ?? pad);
    return { right: right.replaceAll("\u00a0", " "), second: second.replaceAll("\u00a0", " ") };
  };
  expect(text("OH-DRN-0417")).toEqual({ right: "4.3 m off", second: "Refuted at Aurajoki 2 · landing refused" });
  expect(text("OH-DRN-0640")).toEqual({ right: "31 m off", second: "Impersonation or lie at Kupittaa · landing refused" });
  expect(text("OH-DRN-0512")).toEqual({ right: "refused", second: "Verified at Satama 1 · not authorised" });
  expect(text("OH-DRN-0733")).toEqual({ right: "no verdict", second: "Session at Kupittaa ended · codes did not match" });
  expect(text("OH-DRN-0925").second).toMatch(/^Ranging at Kupittaa, \d+ rounds$/);
  expect(text("OH-DRN-0233")).toEqual({ right: "0.03 m", second: "Verified at Aurajoki 2 · landed" });
});
