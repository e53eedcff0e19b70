import type { ReactElement } from "react";
import { useBox } from "../ui/useBox";

/** Before anything is measured, and where there is no layout (a test). */
const USUAL = 720;

/** A chart as wide as the place that it stands in: drawn in that place's pixels, so that its words stay readable. */
export function Fitted({ children }: { children: (width: number) => ReactElement }): ReactElement {
  const [measured, { width }] = useBox();
  return <div ref={measured}>{children(width > 0 ? width : USUAL)}</div>;
}
