import { useMutation } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { useApi } from "../shared/api/api";
import { useLiveStore } from "../shared/live/useLive";
import { evidenceFile, save } from "./evidence";
import { sessionTexts as t } from "./texts";

/** The session as one file, for whoever has to judge it without the console. */
export function EvidenceButton({ session_id }: { session_id: string }): ReactElement {
  const api = useApi();
  const store = useLiveStore();
  const fetched = useMutation({
    mutationFn: () => evidenceFile(api, session_id, store.serverNow_ms()),
    onSuccess: (file) => save(`wonderland-${file.session.session.uav_id}-${session_id.slice(0, 12)}.json`, file),
  });
  return (
    <>
      <button type="button" className="button" disabled={fetched.isPending} title={t("evidenceHint")} onClick={() => fetched.mutate()}>
        {t("evidence")}
      </button>
      {fetched.isError && <span role="alert">{fetched.error.message}</span>}
    </>
  );
}
