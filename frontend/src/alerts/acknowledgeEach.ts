import { ApiError } from "../shared/api/api";
import type { Alert } from "../shared/api/records";

/** What has become of several alerts that were to be acknowledged. */
export type Outcome = {
  done: number;
  /** Somebody else has acted on these since they were chosen: nothing was done about them. */
  conflicts: readonly Alert[];
  /** Not tried any more, for `problem` would have met them as well. */
  left: readonly Alert[];
  problem?: Error;
};

/** Acknowledges one after the other, each by an act of its own on the revision that was seen. */
export async function acknowledgeEach(
  alerts: readonly Alert[],
  acknowledge: (alert: Alert) => Promise<unknown>,
  onProgress: (done: number) => void,
): Promise<Outcome> {
  const conflicts: Alert[] = [];
  let done = 0;
  for (const [i, alert] of alerts.entries()) {
    try {
      await acknowledge(alert);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (error.status !== 409) return { done, conflicts, left: alerts.slice(i), problem: error };
      conflicts.push(alert);
      continue;
    }
    done += 1;
    onProgress(done);
  }
  return { done, conflicts, left: [] };
}
