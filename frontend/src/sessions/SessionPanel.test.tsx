// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import type { BroadcastFinding, HeightFinding, Track } from "../shared/api/records";
import { Heard, HeightFound, Says } from "./SessionPanel";

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

it("shows what was broadcast as a finding of its own, in no verdict's colour where nobody knows whose it is", () => {
  const finding: BroadcastFinding = { outcome: "contradicted", messages: 3, attributed: 0, supported: true, error_mm: 36_060, likelihood_ppm: 0, tolerance_mm: 2_000 };
  const { container, rerender } = render(<Heard finding={finding} />);
  const said = (): string => container.textContent.replaceAll("\u00a0", " ");
  expect(said()).toContain("Impersonation or lie.");
  expect(said()).toContain("Another broadcast under this number is where the drone was measured.");
  expect(said()).toContain("3 messages heard, none signed for by the drone.");
  expect(container.innerHTML).not.toContain("--bad");
  rerender(<Heard finding={{ ...finding, supported: false }} />);
  expect(said()).toContain("No broadcast under this number is where the drone was measured.");
  rerender(<Heard finding={{ ...finding, outcome: "own_contradicted", attributed: 3, supported: false }} />);
  expect(said()).toContain("3 messages heard, 3 signed for by the drone.");
  expect(container.innerHTML).toContain("--bad");
  rerender(<Heard finding={{ outcome: "not_heard", messages: 0, attributed: 0, supported: false }} />);
  expect(said()).toContain("Nothing was heard during the session.");
});

it("says whether a height is measured or the drone's word, and colours a verdict only", () => {
  const finding: HeightFinding = {
    outcome: "claimed", claimed_mm: 5_000, measured_mm: 4_300, lowest_mm: 2_100, highest_mm: 6_500, tolerance_mm: 1_000,
    likelihood_ppm: 640_000, uu_mm2: 540_000, eu_mm2: 0, nu_mm2: 0, chi2_milli: 900,
  };
  const { container, rerender } = render(<HeightFound finding={finding} />);
  const said = (): string => container.textContent.replaceAll("\u00a0", " ");
  expect(said()).toBe("The drone’s word. Measured 4.30 m above the pad, claimed 5.00 m. The ranges leave 2.10 m to 6.50 m open.");
  expect(container.innerHTML).not.toMatch(/--(bad|good|ok)/);
  rerender(<HeightFound finding={{ ...finding, outcome: "proved" }} />);
  expect(said()).toContain("Proved.");
  rerender(<HeightFound finding={{ ...finding, outcome: "contradicted" }} />);
  expect(said()).toContain("Not the claimed one.");
  expect(said()).toContain("1 m would be tolerated.");
  expect(container.innerHTML).toContain("--bad");
});
