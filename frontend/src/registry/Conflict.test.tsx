// @vitest-environment happy-dom
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";
import { Conflict } from "./Conflict";

afterEach(cleanup);

it("lets one go on where somebody else changed nothing that is shown", async () => {
  const onGoOn = vi.fn();
  const record = { status: "active", updated_ms: 1 };
  render(
    <QueryClientProvider client={new QueryClient()}>
      <Conflict seen={record} current={{ ...record, updated_ms: 2 }} reload={() => Promise.resolve()} onGoOn={onGoOn} />
    </QueryClientProvider>,
  );
  const button = screen.getByRole<HTMLButtonElement>("button");
  await waitFor(() => expect(button.disabled).toBe(false));
  expect(screen.getByText(/touches none of these fields/)).toBeTruthy();
  fireEvent.click(button);
  expect(onGoOn).toHaveBeenCalledOnce();
});
