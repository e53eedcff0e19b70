import type { ReactElement } from "react";
import type { Look } from "../shared/drones";
import { Symbol } from "../shared/ui/Symbol";
import { statusWord } from "./words";

const LOOKS: Readonly<Record<string, Look>> = {
  active: "verified",
  commissioned: "verified",
  registered: "inconclusive",
  suspended: "refuted",
  retired: "silent",
};

/** A record's status by shape and word. */
export function Status({ status }: { status: string }): ReactElement {
  const look = LOOKS[status] ?? "unproved";
  return (
    <span className={`status look-${look}`}>
      <Symbol look={look} size={15} />
      {statusWord(status)}
    </span>
  );
}
