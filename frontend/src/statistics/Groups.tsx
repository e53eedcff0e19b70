import type { ReactElement } from "react";
import type { Statistics } from "../shared/api/records";
import { count } from "../shared/format";
import { lookTexts } from "../shared/texts";

type Group = Statistics["pads"][number];

/** Counts of each outcome by a name, as a table with bars; a name narrows the page to itself. */
export function Groups({ groups, nameOf, onChoose }: { groups: readonly Group[]; nameOf: (id: string) => string; onChoose: (id: string) => void }): ReactElement {
  const all = (group: Group): number => group.verified + group.refuted + group.inconclusive;
  const most = Math.max(1, ...groups.map(all));
  return (
    <table className="table num groups">
      <thead className="visually-hidden">
        <tr>
          <td />
          <th scope="col">{lookTexts("verified")}</th>
          <th scope="col">{lookTexts("inconclusive")}</th>
          <th scope="col">{lookTexts("refuted")}</th>
        </tr>
      </thead>
      <tbody>
        {groups.map((group) => (
          <tr key={group.id}>
            <th scope="row">
              <button type="button" className="link" onClick={() => onChoose(group.id)}>
                {nameOf(group.id)}
              </button>
              <span className="group-bar" style={{ width: `${(100 * all(group)) / most}%` }} aria-hidden="true">
                {(["verified", "inconclusive", "refuted"] as const).map((outcome) => (
                  <i key={outcome} className={`bar-${outcome}`} style={{ flexGrow: group[outcome] }} />
                ))}
              </span>
            </th>
            <td className="right look-verified">{count(group.verified)}</td>
            <td className="right look-inconclusive">{count(group.inconclusive)}</td>
            <td className="right look-refuted">{count(group.refuted)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
