// @vitest-environment happy-dom
import { cleanup, fireEvent, render, screen, within } from "@testing-library/react";
import { useState, type ReactElement } from "react";
import { afterEach, describe, expect, it } from "vitest";
import type { ListTab } from "../shared/address/location";
import { Fleet, type Filter } from "../shared/fleet";
import { PADS } from "../shared/fake/cast";
import { seeded } from "../shared/fake/random";
import { FakeWorld } from "../shared/fake/world";
import { LiveStore } from "../shared/live/store";
import { LiveContext } from "../shared/live/useLive";
import { ListPanel } from "./ListPanel";

const START_MS = 1_700_000_000_000;
const CROWD = 5_000;

function played(seconds: number, crowd: number): LiveStore {
  const store = new LiveStore();
  const world = new FakeWorld(START_MS, seeded(2));
  store.merge({ pads: [...PADS] });
  for (let t_s = 0; t_s < seconds; t_s += 0.2) store.merge(world.tick(t_s));
  const t_ms = START_MS + seconds * 1000;
  const many = Array.from({ length: crowd }, (_, i) => ({
    uav_id: `SE-${String(i).padStart(4, "0")}`,
    lat_e7: 600_000_000 + i,
    lon_e7: 220_000_000,
    t_ms,
    pad_id: "kupittaa",
    transport: "wifi",
    verified: false as const,
    operator_id: i % 2 === 0 ? "FIN87even" : "FIN87odd",
  }));
  store.merge({ tracks: many });
  store.ready = true;
  return store;
}

function List({ seconds, crowd = 0 }: { seconds: number; crowd?: number }): ReactElement {
  const [store] = useState(() => played(seconds, crowd));
  const [tab, setTab] = useState<ListTab>("all");
  const [filter, setFilter] = useState<Filter>({});
  const [selected, select] = useState<string | undefined>();
  const now_ms = START_MS + seconds * 1000;
  return (
    <LiveContext value={store}>
      <ListPanel
        fleet={new Fleet(store, now_ms, filter)}
        tab={tab}
        filter={filter}
        now_ms={now_ms}
        selected={selected}
        onTab={setTab}
        onFilter={setFilter}
        onSelect={select}
        onPad={() => undefined}
      />
    </LiveContext>
  );
}

afterEach(cleanup);
const options = (): string[] => within(screen.getByRole("listbox", { name: /what needs you first/ })).queryAllByRole("option").map((option) => within(option).getByText(/^[A-Z]{2}-/).textContent);
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

  it("makes rows only of those in view, and tells how many there are and which", () => {
    render(<List seconds={58} crowd={CROWD} />);
    const rows = screen.getAllByRole("option");
    expect(rows.length).toBeLessThan(60);
    expect(rows[0]?.getAttribute("aria-setsize")).toBe(String(CROWD + 12));
    expect(rows.map((row) => Number(row.getAttribute("aria-posinset")))).toEqual(rows.map((_, i) => i + 1));
    const list = screen.getByRole("listbox");
    fireEvent.keyDown(list, { key: "End" });
    list.scrollTop = CROWD * 57;
    fireEvent.scroll(list);
    expect(screen.getAllByRole("option").length).toBeLessThan(80);
    expect(selected()).toBe(screen.getAllByRole("option").at(-1)?.id);
    expect(screen.getAllByRole("option").at(-1)?.getAttribute("aria-posinset")).toBe(String(CROWD + 12));
  });

  it("filters by what the officer asks for, and says that it does", () => {
    render(<List seconds={58} crowd={10} />);
    fireEvent.click(screen.getByRole("button", { name: "Filter" }));
    fireEvent.change(screen.getByLabelText("Operator, as broadcast"), { target: { value: "FIN87odd" } });
    expect(options()).toEqual(["SE-0001", "SE-0003", "SE-0005", "SE-0007", "SE-0009"]);
    expect(screen.getByText(/5 of 22 shown/)).toBeTruthy();
    fireEvent.change(screen.getByLabelText("State"), { target: { value: "refuted" } });
    expect(screen.getByText("Nothing that is about fits this filter.")).toBeTruthy();
    fireEvent.click(screen.getByRole("button", { name: "Show all" }));
    expect(options()).toHaveLength(22);
  });

  it("is calm where there is nothing", () => {
    render(<List seconds={0} />);
    expect(screen.getByText("No pad hears a drone.")).toBeTruthy();
  });
});
