/** The records' values as people read them. */
import { actionNoun, dayAndTime, decimal, dotted, length } from "../shared/format";
import { fieldTexts, registryTexts as t } from "./texts";

const ACTIONS = ["land", "takeoff", "dock"] as const;
type Field = keyof (typeof fieldTexts)["all"]["en"];

function isField(name: string): name is Field {
  return name in fieldTexts.all.en;
}

/** The name of a field, by the last part of its path; one without a name as the record calls it. */
export function fieldName(path: string): string {
  const last = path.split(".").at(-1) ?? path;
  return isField(last) ? fieldTexts(last) : last;
}

export function statusWord(status: string): string {
  return t("statusIs", { status });
}

export function actionList(actions: readonly string[]): string {
  return actions.map((each) => (ACTIONS as readonly string[]).includes(each) ? actionNoun(each as (typeof ACTIONS)[number]) : each).join(", ");
}

/** "4: FIN:A1, FIN:B2": how many spans, and of which zones. */
function closuresWord(value: readonly unknown[]): string {
  const zones = new Set(value.map((each) => (each as { zone_id?: unknown }).zone_id).filter((id) => typeof id === "string"));
  return value.length === 0 ? t("noClosures") : t("closuresAre", { count: value.length, zones: [...zones].join(", ") });
}

/** "quay-1: 0.30 m ± 0.02 m": what a drone is calibrated to, by pad. */
function calibrationsWord(value: readonly unknown[]): string {
  return (value as { pad_id: string; offset_mm: number; sigma_mm: number; withdrawn?: string }[])
    .map(({ pad_id, offset_mm, sigma_mm, withdrawn }) => {
      const word = `${pad_id}: ${t("offsetIs", { offset: length(offset_mm), sigma: length(sigma_mm) })}`;
      return withdrawn === undefined ? word : `${word} (${t("calibrationIs", { state: "withdrawn" })}: ${withdrawn})`;
    })
    .join(" · ");
}

/** One value of a record; by its name one knows its unit. */
export function valueWord(path: string, value: unknown): string {
  const name = path.split(".").at(-1) ?? path;
  if (value === undefined || value === null || value === "") return "–";
  if (typeof value === "boolean") return t(value ? "yes" : "no");
  if (typeof value === "number") {
    if (name.endsWith("_mm")) return length(value);
    if (name.endsWith("_ppm")) return `${decimal(value / 10_000, value % 10_000 === 0 ? 0 : 4)} %`;
    if (name.endsWith("_e7")) return `${decimal(value / 1e7, 7)}°`;
    // Times since the Unix epoch are large; everything else in milliseconds is a span.
    if (name.endsWith("_ms")) return value > 1e11 ? dayAndTime(value, 0) : `${decimal(value / 1000, value % 1000 === 0 ? 0 : 3)} s`;
    return String(value);
  }
  if (name === "closures" && Array.isArray(value)) return closuresWord(value);
  if (name === "calibrations" && Array.isArray(value)) return calibrationsWord(value);
  if (Array.isArray(value)) return name === "actions" ? actionList(value.map(String)) : `[${value.length}]`;
  if (typeof value === "string") {
    if (name === "status") return statusWord(value);
    if (name === "broadcast_required") return t("broadcastRequired", { when: value });
    return name === "pad_id" && value === "*" ? t("anyPad") : dotted(value);
  }
  // A whole commissioning is told by its method; anything else of many parts is for the ledger view.
  const { method } = value as { method?: unknown };
  return typeof method === "string" && method !== "" ? method : "{…}";
}

