import type { ReactElement } from "react";
import type { Json, JsonObject } from "../shared/signing/canonical";
import { registryTexts as t } from "./texts";
import { fieldName, valueWord } from "./words";

/** What will be different, field by field; for a new record all of it. */
export function Summary({ argument, about, before }: { argument: JsonObject; about: JsonObject; before: Readonly<Record<string, unknown>> | undefined }): ReactElement {
  const flat = (value: JsonObject, prefix = ""): [string, Json][] =>
    Object.entries(value).flatMap(([name, each]): [string, Json][] =>
      typeof each === "object" && !Array.isArray(each) && name === "policy" ? flat(each as JsonObject, `${name}.`) : [[prefix + name, each]],
    );
  const was = (path: string): unknown => path.split(".").reduce<unknown>((at, name) => (at as Record<string, unknown> | undefined)?.[name], before);
  const rows = flat(argument).filter(([path, value]) => path in about || before === undefined || JSON.stringify(was(path)) !== JSON.stringify(value));
  return (
    <table className="table change-table num">
      <thead>
        <tr>
          <th scope="col">{t("field")}</th>
          {before !== undefined && <th scope="col">{t("was")}</th>}
          <th scope="col">{t("willBe")}</th>
        </tr>
      </thead>
      <tbody>
        {rows.map(([path, value]) => (
          <tr key={path}>
            <th scope="row">{fieldName(path)}</th>
            {before !== undefined && <td className="quiet">{valueWord(path, was(path))}</td>}
            <td>{typeof value === "object" && !Array.isArray(value) ? "JSON" : valueWord(path, value)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
