import { useMutation } from "@tanstack/react-query";
import { useEffect, type ReactElement } from "react";
import { registryTexts as t } from "./texts";
import { differences } from "./values";
import { fieldName, valueWord } from "./words";

type Fields = Readonly<Record<string, unknown>>;

/** Somebody else was quicker: both versions side by side. Nothing is overwritten until the user says so. */
export function Conflict({ seen, current, reload, onGoOn }: { seen: Fields; current: Fields | undefined; reload: () => Promise<unknown>; onGoOn: () => void }): ReactElement {
  const { mutate, isPending, isSuccess } = useMutation({ mutationFn: reload });
  useEffect(() => mutate(), [mutate]);
  const rows = differences(seen, current).filter(({ path }) => !path.endsWith("updated_ms"));
  return (
    <div className="conflict" aria-busy={isPending}>
      <p className="quiet">{t(isSuccess && rows.length === 0 ? "conflictHidden" : "conflictHint")}</p>
      <table className="table change-table num">
        <thead>
          <tr>
            <th scope="col">{t("field")}</th>
            <th scope="col">{t("youSaw")}</th>
            <th scope="col">{t("nowIs")}</th>
          </tr>
        </thead>
        <tbody>
          {rows.map(({ path, before, after }) => (
            <tr key={path}>
              <th scope="row">{fieldName(path)}</th>
              <td>{valueWord(path, before)}</td>
              <td>{valueWord(path, after)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <button type="button" className="button primary" disabled={!isSuccess} onClick={onGoOn}>
        {t("goOn")}
      </button>
    </div>
  );
}
