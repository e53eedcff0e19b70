// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import type { Pad } from "../shared/api/records";
import { PadPlot } from "./PadPlot";

afterEach(cleanup);

const PAD = { commissioning: { anchors: [{ anchor_id: "A1", east_mm: 0, north_mm: 0 }] } } as unknown as Pad;
const ESTIMATE = { at: { east_mm: 1_000, north_mm: 2_000 }, covariance: undefined, tone: "accent", verified: false } as const;

it("says how far the measurement is from where a reference has the drone", () => {
  const { rerender } = render(<PadPlot pad={PAD} claims={[]} estimate={ESTIMATE} truth={{ east_mm: 1_300, north_mm: 2_400 }} />);
  expect(screen.getByText(/0\.50 m from the pad’s reference/)).toBeTruthy();
  expect(screen.getByTestId("truth")).toBeTruthy();
  rerender(<PadPlot pad={PAD} claims={[]} estimate={ESTIMATE} truth={{ east_mm: 1_000, north_mm: 9_000_000 }} />);
  expect(screen.getByText(/km from the pad’s reference/)).toBeTruthy();
  expect(screen.queryByTestId("truth")).toBeNull();
  rerender(<PadPlot pad={PAD} claims={[]} estimate={ESTIMATE} />);
  expect(screen.queryByText(/reference/)).toBeNull();
  expect(screen.queryByTestId("truth")).toBeNull();
});
