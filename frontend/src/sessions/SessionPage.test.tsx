// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import type { VerdictSummary } from "../shared/api/records";
import { Request } from "./SessionPage";

const CLAIM = { lat_e7: 604_503_100, lon_e7: 222_712_400, height_mm: 31_000, accuracy_mm: 50, height_accuracy_mm: 90, t_ms: 1_800_000_000_000 };

afterEach(cleanup);

it("says of a request from elsewhere that nothing judged its place", () => {
  const verdict = (code: string): VerdictSummary => ({ reasons: [{ code, text: "" }] }) as unknown as VerdictSummary;
  const { rerender } = render(<Request session={{ claim: CLAIM }} verdict={verdict("request_unjudged")} now_ms={CLAIM.t_ms} />);
  expect(screen.getByText("Asked from here, unjudged")).toBeTruthy();
  rerender(<Request session={{ claim: CLAIM }} verdict={verdict("within_buffer")} now_ms={CLAIM.t_ms} />);
  expect(screen.getByText("Asked from here")).toBeTruthy();
  expect(screen.queryByText(/rests on/)).toBeNull();
});
