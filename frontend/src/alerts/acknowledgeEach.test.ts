import { describe, expect, it } from "vitest";
import { ApiError } from "../shared/api/api";
import type { Alert } from "../shared/api/records";
import { acknowledgeEach } from "./acknowledgeEach";

const ALERTS = ["a", "b", "c", "d"].map((alert_id) => ({ alert_id, revision: 3 }) as Alert);

function refusing(refused: Readonly<Record<string, number>>, tried: string[]) {
  return ({ alert_id }: Alert): Promise<void> => {
    tried.push(alert_id);
    const status = refused[alert_id];
    return status === undefined ? Promise.resolve() : Promise.reject(new ApiError("refused", status));
  };
}

describe("several alerts", () => {
  it("are each acknowledged, and a conflict is told of its own alert only", async () => {
    const tried: string[] = [];
    const told: number[] = [];
    const outcome = await acknowledgeEach(ALERTS, refusing({ b: 409 }, tried), (done) => told.push(done));
    expect(tried).toEqual(["a", "b", "c", "d"]);
    expect(told).toEqual([1, 2, 3]);
    expect(outcome).toEqual({ done: 3, conflicts: [ALERTS[1]], left: [] });
  });

  it("are left where the server refuses them all, and stay to be tried again", async () => {
    const tried: string[] = [];
    const outcome = await acknowledgeEach(ALERTS, refusing({ a: 409, c: 403 }, tried), () => undefined);
    expect(tried).toEqual(["a", "b", "c"]);
    expect(outcome).toMatchObject({ done: 1, conflicts: [ALERTS[0]], left: [ALERTS[2], ALERTS[3]] });
    expect(outcome.problem?.message).toBe("refused");
  });
});
