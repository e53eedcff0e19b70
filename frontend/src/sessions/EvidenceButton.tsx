import { useMutation } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { useApi } from "../shared/api/api";
import { sessionTexts as t } from "./texts";

/** Hands a file to the browser's downloads. */
function save(name: string, content: ArrayBuffer): void {
  const url = URL.createObjectURL(new Blob([content], { type: "application/json" }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  URL.revokeObjectURL(url);
}

/** The evidence file, as the ledger gives it: for whoever has to judge without the console. */
export function EvidenceButton({ session_id }: { session_id: string }): ReactElement {
  const api = useApi();
  const fetched = useMutation({
    mutationFn: () => api.evidence(session_id),
    onSuccess: (file) => save(`evidence-${session_id.slice(0, 12)}.json`, file),
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
