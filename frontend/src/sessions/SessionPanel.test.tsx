// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import type { Track } from "../shared/api/records";
import { Says } from "./SessionPanel";

const TRACK: Track = { uav_id: "X", lat_e7: 1, lon_e7: 2, t_ms: 3, pad_id: "p", transport: "ble5", verified: false };

afterEach(cleanup);

it("shows what an operator says as text, whatever it is", () => {
  render(<Says track={{ ...TRACK, description: "<img src=x onerror=1>", description_type: "emergency" }} />);
  expect(screen.getByText("Emergency, it says")).toBeTruthy();
  expect(screen.getByText("“<img src=x onerror=1>”").tagName).toBe("STRONG");
  expect(document.querySelector("img")).toBeNull();
});

it("says of how many, and nothing where nothing was said", () => {
  const { container, rerender } = render(<Says track={{ ...TRACK, area_count: 3, area_radius_mm: 120_000 }} />);
  expect(container.textContent.replaceAll("\u00a0", " ")).toMatch(/3 drones under this number, within 120/);
  rerender(<Says track={TRACK} />);
  expect(container.textContent).toBe("");
});
