// @vitest-environment happy-dom
import { cleanup, fireEvent, render, screen, within } from "@testing-library/react";
import { useState, type ReactElement } from "react";
import { afterEach, describe, expect, it } from "vitest";
import { drones } from "../shared/drones";
import { PADS } from "../shared/fake/cast";
import { seeded } from "../shared/fake/random";
import { FakeWorld } from "../shared/fake/world";
import { LiveStore } from "../shared/live/store";
import { DroneList, type Tab } from "./DroneList";

const START_MS = 1_700_000_000_000;

function List({ seconds }: { seconds: number }): ReactElement {
  const [store] = useState(() => {
    const made = new LiveStore();
    const world = new FakeWorld(START_MS, seeded(2));
    made.merge({ pads: [...PADS] });
    for (let t_s = 0; t_s < seconds; t_s += 0.2) made.merge(world.tick(t_s));
    return made;
  });
  const [tab, setTab] = useState<Tab>("all");
  const [selected, select] = useState<string | undefined>();
  const now_ms = START_MS + seconds * 1000;
  return (
    <DroneList
      drones={drones(store, now_ms)}
      pads={store.pads}
      now_ms={now_ms}
      tab={tab}
      selected={selected}
      ready
      onTab={setTab}
      onSelect={select}
    />
  );
}

afterEach(cleanup);
const options = (): string[] => screen.queryAllByRole("option").map((option) => within(option).getByText(/^[A-Z]{2}-/).textContent);
const selected = (): string | undefined =>
  screen.getAllByRole("option").find((option) => option.getAttribute("aria-selected") === "true")?.id;

describe("the list of drones", () => {
  it("names each state for those who cannot see its symbol", () => {
    render(<List seconds={58} />);
    const [first] = screen.getAllByRole("option");
    if (first === undefined) expect.fail("the list is empty");
    expect(within(first).getByRole("img").getAttribute("aria-label")).toBe("Refuted");
  });

  it("filters by need and says how many there are", () => {
    render(<List seconds={58} />);
    expect(options()).toHaveLength(12);
    fireEvent.click(screen.getByRole("button", { name: /Needs you 5/ }));
    expect(options()).toEqual(["OH-DRN-0417", "OH-DRN-0640", "OH-DRN-0871", "OH-DRN-0512", "OH-DRN-0733"]);
    expect(screen.getByRole("button", { name: /Needs you/ }).getAttribute("aria-pressed")).toBe("true");
  });

  it("is gone through with the arrow keys", () => {
    render(<List seconds={58} />);
    const list = screen.getByRole("listbox");
    fireEvent.keyDown(list, { key: "ArrowDown" });
    expect(selected()).toBe("drone-OH-DRN-0417");
    fireEvent.keyDown(list, { key: "ArrowDown" });
    fireEvent.keyDown(list, { key: "ArrowDown" });
    expect(selected()).toBe("drone-OH-DRN-0871");
    expect(list.getAttribute("aria-activedescendant")).toBe("drone-OH-DRN-0871");
    fireEvent.keyDown(list, { key: "ArrowUp" });
    expect(selected()).toBe("drone-OH-DRN-0640");
    fireEvent.keyDown(list, { key: "End" });
    fireEvent.keyDown(list, { key: "ArrowDown" });
    expect(selected()).toBe(screen.getAllByRole("option").at(-1)?.id);
  });

  it("is calm where there is nothing", () => {
    render(<List seconds={0} />);
    expect(screen.getByText("No pad hears a drone.")).toBeTruthy();
  });
});
