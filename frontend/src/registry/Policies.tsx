import type { ReactElement } from "react";
import { decimal, length } from "../shared/format";
import type { Version } from "../shared/signing/flow";
import type { RegistryPolicy } from "./calls";
import { registryTexts as t } from "./texts";
import { fieldName, valueWord } from "./words";

const ACTIONS = ["*", "land", "takeoff", "dock"] as const;

export function isAction(name: string | undefined): name is (typeof ACTIONS)[number] {
  return ACTIONS.some((each) => each === name);
}

/** What a form for it begins on: the values that hold, and the version of its own record (or that it has none). */
export function policyBefore({ policy, version }: RegistryPolicy): { record: Readonly<Record<string, unknown>>; version: Version | "nothing" } {
  return { record: { policy }, version: version ?? "nothing" };
}

function origin({ set_for, own }: RegistryPolicy): string {
  if (own) return t("setHere");
  if (set_for === "") return t("defaults");
  const [pad = "", action = ""] = set_for.split("/");
  return t("setFor", { pad: pad === "*" ? t("anyPad") : pad, action: t("policyFor", { action: action === "*" ? "any" : action }) });
}

/** What holds for each action. */
export function Policies({ policies, pad_id, hrefOf }: { policies: readonly RegistryPolicy[]; pad_id: string; hrefOf: (action: string) => string }): ReactElement {
  const held = ["buffer_mm", "min_assurance", "verify_ppm", "max_rounds"] as const;
  return (
    <div className="scroll">
      <table className="table num">
        <thead>
          <tr>
            <th scope="col">{fieldName("action")}</th>
            {held.map((name) => (
              <th key={name} scope="col">
                {fieldName(name)}
              </th>
            ))}
            <th scope="col">{fieldName("status")}</th>
            <td />
          </tr>
        </thead>
        <tbody>
          {policies.map((each) => (
            <tr key={each.action}>
              <th scope="row">{t("policyFor", { action: each.action === "*" ? "any" : each.action })}</th>
              {held.map((name) => (
                <td key={name}>{name === "buffer_mm" ? length(each.policy.buffer_mm) : name === "verify_ppm" ? `${decimal(each.policy.verify_ppm / 10_000, 2)} %` : valueWord(name, each.policy[name])}</td>
              ))}
              <td className="quiet">{origin(each)}</td>
              <td className="right">
                <a className="button" href={hrefOf(each.action)} aria-label={`${t("change")}: ${pad_id} ${t("policyFor", { action: each.action === "*" ? "any" : each.action })}`}>
                  {t("change")}
                </a>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
