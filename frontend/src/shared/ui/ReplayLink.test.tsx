// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import { ReplayLink } from "./ReplayLink";

afterEach(cleanup);

const timeOf = (): string | undefined => /[?&]t=([^&]+)/.exec(decodeURIComponent(screen.getByRole("link").getAttribute("href") ?? ""))?.[1];

it("leads to the verdict, not to the request, once there is a verdict", () => {
  render(<ReplayLink t_ms={100_000} decided_ms={108_000} session="s1" />);
  expect(timeOf()).toBe("1970-01-01T00:01:50.000Z");
});

it("leads to a little before what happened where nothing was decided", () => {
  render(<ReplayLink t_ms={100_000} drone="OH-1" />);
  expect(timeOf()).toBe("1970-01-01T00:01:35.000Z");
});
