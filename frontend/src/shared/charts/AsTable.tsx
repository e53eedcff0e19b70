import type { ReactElement } from "react";
import { sharedTexts } from "../texts";

type Row = { key: string; cells: readonly string[] };

/** A chart's figures as a table, for whoever does not see it or wants the numbers. The first cell names its row. */
export function AsTable({ head, rows }: { head: readonly string[]; rows: readonly Row[] }): ReactElement {
  return (
    <details className="as-table">
      <summary>{sharedTexts("asTable")}</summary>
      <table className="table num">
        <thead>
          <tr>
            {head.map((name) => (
              <th key={name} scope="col">
                {name}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map(({ key, cells: [first, ...rest] }) => (
            <tr key={key}>
              <th scope="row">{first}</th>
              {rest.map((cell, i) => (
                <td key={i}>{cell}</td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </details>
  );
}
