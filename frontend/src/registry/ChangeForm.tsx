import { useQuery } from "@tanstack/react-query";
import { useEffect, useId, useRef, useState, type ReactElement } from "react";
import { useApi } from "../shared/api/api";
import { keepDraft, readDraft } from "../shared/drafts";
import { actionNoun } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import type { JsonObject } from "../shared/signing/canonical";
import type { Change } from "../shared/signing/flow";
import { SignPanel } from "../shared/signing/SignPanel";
import { roleName } from "../shared/signing/texts";
import { sharedTexts } from "../shared/texts";
import { forms as fetchForms, type Form } from "./calls";
import { Conflict } from "./Conflict";
import { FORMS, fixedPart, formKey, initial, type FieldSpec, type FormName } from "./forms";
import { faults, schemaAt, type Fault, type Schema } from "./schema";
import { registryTexts as t } from "./texts";
import { keepable, parsed, put, typedOf, type Draft, type Typed } from "./values";
import { Summary } from "./Summary";
import { fieldName, valueWord } from "./words";

const PADS: readonly Topic[] = ["pads"];
const ACTIONS = ["land", "takeoff", "dock"] as const;
/** Pairs of fields of which the second must come after the first. */
const AFTER = [
  ["valid_from_ms", "valid_until_ms"],
  ["performed_ms", "valid_until_ms"],
] as const;

export type FormFault = Omit<Fault, "rule"> & { rule: Fault["rule"] | "order" | "file" | "room" | "registration" };

type Properties = {
  name: FormName;
  /** What the change is of: parts of the argument that are not typed, and its name for drafts. */
  about: JsonObject;
  /** The record that is before the user's eyes, and its version. */
  before?: { record: Readonly<Record<string, unknown>>; version: Change["seen"] } | undefined;
  /** What to begin with, where the page that led here knows it. */
  suggested?: Draft | undefined;
  /** Fetches the record anew, after somebody else has changed it. */
  onReload?: (() => Promise<unknown>) | undefined;
  onDone: () => void;
  onCancel: () => void;
};

/** What the record has for a field, as the form begins with it. */
function present(spec: FieldSpec, record: Readonly<Record<string, unknown>> | undefined): Typed | undefined {
  const value = spec.path.split(".").reduce<unknown>((at, name) => (at as Record<string, unknown> | undefined)?.[name], record);
  return value === undefined ? undefined : typedOf(spec.kind, value);
}

/** The argument of what was typed, the operator's number, which is committed to in it, and all that is wrong. */
function argumentOf(name: FormName, about: JsonObject, draft: Draft, schema: Schema): { argument: JsonObject; registration: string | undefined; wrong: FormFault[] } {
  let argument = fixedPart(name, about);
  let registration: string | undefined;
  const wrong: FormFault[] = [];
  for (const { path, kind, optional } of FORMS[name].fields) {
    const found = parsed(kind, draft[path]);
    if (found === "wrong") wrong.push({ path, rule: kind === "registration" ? "registration" : "type" });
    else if (found !== "nothing" && kind === "registration") registration = found.value as string;
    else if (found !== "nothing") argument = put(argument, path, found.value);
    else if (optional !== true) wrong.push({ path, rule: kind === "actions" ? "few" : "required" });
  }
  const known = new Set(wrong.map(({ path }) => path));
  wrong.push(...faults(schema, argument).filter(({ path }) => !known.has(path)));
  for (const [first, second] of AFTER) {
    const [from, until] = [argument[first], argument[second]];
    if (typeof from === "number" && typeof until === "number" && until <= from) wrong.push({ path: second, rule: "order" });
  }
  const { policy } = argument;
  if (typeof policy === "object" && "refute_ppm" in policy && "verify_ppm" in policy && (policy["refute_ppm"] as number) >= (policy["verify_ppm"] as number)) {
    wrong.push({ path: "policy.refute_ppm", rule: "room" });
  }
  return { argument, registration, wrong };
}

type FieldProperties = { spec: FieldSpec; schema: Schema | undefined; typed: Typed | undefined; fault: FormFault | undefined; onChange: (typed: Typed) => void };

/** A bound in the unit that the field is typed in. */
function limitOf(spec: FieldSpec, limit: number | undefined): string {
  if (limit === undefined) return "";
  return ["metres", "share", "seconds", "degrees"].includes(spec.kind) ? String(typedOf(spec.kind, limit)) : String(limit);
}

function Input({ spec, schema, typed, id, describedBy, invalid, onChange }: FieldProperties & { id: string; describedBy: string | undefined; invalid: boolean }): ReactElement {
  const pads = useLive(PADS, (store) => [...store.pads.values()]);
  const text = typeof typed === "string" ? typed : "";
  const shared = { id, "aria-invalid": invalid, "aria-describedby": describedBy };
  if (spec.kind === "note") {
    return <textarea {...shared} rows={3} value={text} maxLength={schema?.maxLength} onChange={(event) => onChange(event.target.value)} />;
  }
  if (spec.kind === "pad") {
    return (
      <select {...shared} value={text} onChange={(event) => onChange(event.target.value)}>
        <option value="*">{t("anyPad")}</option>
        {pads.map((pad) => (
          <option key={pad.pad_id} value={pad.pad_id}>
            {pad.name}
          </option>
        ))}
      </select>
    );
  }
  if (spec.kind === "choice") {
    return (
      <select {...shared} value={text} onChange={(event) => onChange(event.target.value)}>
        {(schema?.enum ?? []).map((each) => (
          <option key={each} value={each}>
            {valueWord(spec.path, each)}
          </option>
        ))}
      </select>
    );
  }
  const type = spec.kind === "time" ? "datetime-local" : "text";
  const numeric = ["metres", "share", "seconds", "integer", "degrees"].includes(spec.kind);
  return (
    <input
      {...shared}
      type={type}
      value={text}
      maxLength={schema?.maxLength}
      inputMode={numeric ? "decimal" : undefined}
      autoComplete="off"
      spellCheck={numeric ? false : undefined}
      onChange={(event) => onChange(event.target.value)}
    />
  );
}

function Actions({ typed, onChange }: { typed: Typed | undefined; onChange: (typed: Typed) => void }): ReactElement {
  const chosen = Array.isArray(typed) ? (typed as readonly string[]) : [];
  return (
    <span className="checks">
      {ACTIONS.map((action) => (
        <label key={action}>
          <input
            type="checkbox"
            checked={chosen.includes(action)}
            onChange={(event) => onChange(ACTIONS.filter((each) => (each === action ? event.target.checked : chosen.includes(each))))}
          />{" "}
          {actionNoun(action)}
        </label>
      ))}
    </span>
  );
}

function FieldRow(properties: FieldProperties): ReactElement {
  const { spec, typed, fault, onChange } = properties;
  const id = useId();
  const words = fault === undefined ? undefined : t("fault", { rule: fault.rule, limit: limitOf(spec, fault.limit) });
  const error = words === undefined ? null : (
    <span id={`${id}-fault`} className="field-error">
      {words}
    </span>
  );
  const name = fieldName(spec.path);
  const shape = `field ${spec.wide === true ? "wide" : ""}`;
  if (spec.kind === "flag") {
    return (
      <label className={`${shape} flag`}>
        <span>
          <input type="checkbox" checked={typed === true} onChange={(event) => onChange(event.target.checked)} /> {name}
        </span>
        {error}
      </label>
    );
  }
  if (spec.kind === "actions") {
    return (
      <fieldset className={shape}>
        <legend>{name}</legend>
        <Actions typed={typed} onChange={onChange} />
        {error}
      </fieldset>
    );
  }
  return (
    <div className={shape}>
      <label htmlFor={id}>{name}</label>
      <Input {...properties} id={id} invalid={fault !== undefined} describedBy={fault === undefined ? undefined : `${id}-fault`} />
      {error}
    </div>
  );
}

function draftName(name: FormName, about: JsonObject): string {
  return [name, ...Object.values(about).map(String)].join("/");
}

function CommissionFile({ onRead, fault }: { onRead: (value: JsonObject | undefined) => void; fault: FormFault | undefined }): ReactElement {
  return (
    <label className="field wide">
      {t("commissionFile")}
      <input
        type="file"
        accept=".json,application/json"
        // The same file, mended meanwhile, may be chosen again.
        onClick={(event) => {
          event.currentTarget.value = "";
        }}
        onChange={(event) => {
          const [file] = event.target.files ?? [];
          void file
            ?.slice(0, 65_536)
            .text()
            .then((text) => {
              const found: unknown = JSON.parse(text);
              const record = typeof found === "object" && found !== null ? (found as JsonObject) : {};
              onRead((record["commissioning"] as JsonObject | undefined) ?? record);
            })
            .catch(() => onRead(undefined));
        }}
      />
      {fault !== undefined && <span className="field-error">{fault.path === "commissioning" ? t("fault", { rule: fault.rule, limit: "" }) : `${fault.path}: ${t("fault", { rule: fault.rule, limit: String(fault.limit ?? "") })}`}</span>}
    </label>
  );
}

/** One change: typed, checked by the contract's bounds, looked at once more, signed. */
export function ChangeForm(properties: Properties): ReactElement {
  const api = useApi();
  const found = useQuery({ queryKey: ["registry-forms"], queryFn: () => fetchForms(api), staleTime: Infinity });
  const form = found.data?.find((each) => each.function === FORMS[properties.name].transaction);
  if (form === undefined) {
    return (
      <p className="empty" role={found.isError ? "alert" : "status"}>
        {found.isError ? found.error.message : sharedTexts("fetching")}
      </p>
    );
  }
  return <Typing key={draftName(properties.name, properties.about)} {...properties} form={form} />;
}

function Typing({ name, about, before, suggested, onReload, onDone, onCancel, form }: Properties & { form: Form }): ReactElement {
  const now_ms = useServerNow(60_000);
  const spec = FORMS[name];
  const place = draftName(name, about);
  const [start] = useState<Draft>(() => {
    const fields = spec.fields.map((field) => [field.path, present(field, before?.record) ?? initial(name, now_ms)[field.path]] as const);
    return { ...Object.fromEntries(fields.filter((entry): entry is readonly [string, Typed] => entry[1] !== undefined)), ...suggested };
  });
  const check = useRef<HTMLButtonElement>(null);
  useEffect(() => {
    if (suggested !== undefined) check.current?.focus();
  }, [suggested]);
  const [kept, setKept] = useState(() => readDraft(place) as Draft | undefined);
  const [draft, setDraft] = useState<Draft>(kept ?? start);
  const [file, setFile] = useState<JsonObject | "broken">();
  const [tried, setTried] = useState(false);
  const [signing, setSigning] = useState<Change>();
  // What the form was begun on; after a conflict the user moves it on himself.
  const [ground, setGround] = useState(before);

  const { argument: typedArgument, registration, wrong } = argumentOf(name, about, draft, form.argument);
  const argument = name === "commission" && typeof file === "object" ? { ...typedArgument, commissioning: file } : typedArgument;
  const all: readonly FormFault[] =
    name !== "commission" ? wrong : typeof file === "object" ? faults(form.argument, argument) : [{ path: "commissioning", rule: file === "broken" ? "file" : "required" }];
  const faultOf = (path: string): FormFault | undefined => (tried ? all.find((each) => each.path === path || each.path.startsWith(`${path}[`)) : undefined);
  const set = (path: string, typed: Typed): void => {
    const next = { ...draft, [path]: typed };
    setDraft(next);
    keepDraft(place, { ...next, [path]: keepable(spec.fields.find((field) => field.path === path)?.kind ?? "text", typed) });
  };

  if (signing !== undefined) {
    return (
      <SignPanel
        change={signing}
        roles={form.roles}
        summary={<Summary argument={signing.registration === undefined ? signing.argument : { ...signing.argument, registration: signing.registration }} about={about} before={ground?.record} />}
        onDone={() => {
          keepDraft(place, undefined);
          onDone();
        }}
        onBack={() => setSigning(undefined)}
        conflict={
          ground !== undefined && onReload !== undefined ? (
            <Conflict
              seen={ground.record}
              current={before?.record}
              reload={onReload}
              onGoOn={() => {
                setGround(before);
                setSigning(undefined);
              }}
            />
          ) : undefined
        }
      />
    );
  }
  return (
    <form
      className="form-grid"
      noValidate
      onSubmit={(event) => {
        event.preventDefault();
        setTried(true);
        if (all.length > 0) {
          const target = event.currentTarget;
          requestAnimationFrame(() => target.querySelector<HTMLElement>('[aria-invalid="true"]')?.focus());
          return;
        }
        setSigning({ name: spec.transaction, argument, ...(registration !== undefined && { registration }), ...(ground?.version !== undefined && { seen: ground.version }) });
      }}
    >
      <p className="quiet wide">{t("formHint", { form: formKey(name) })}</p>
      {kept !== undefined && (
        <p className="sign-warning wide">
          {t("draft")}{" "}
          <button
            type="button"
            className="button"
            onClick={() => {
              keepDraft(place, undefined);
              setKept(undefined);
              setDraft(start);
            }}
          >
            {t("discard")}
          </button>
        </p>
      )}
      {name === "commission" && <CommissionFile onRead={(value) => setFile(value ?? "broken")} fault={tried ? all[0] : undefined} />}
      {spec.fields.map((field) => (
        <FieldRow key={field.path} spec={field} schema={schemaAt(form.argument, field.path)} typed={draft[field.path]} fault={faultOf(field.path)} onChange={(typed) => set(field.path, typed)} />
      ))}
      <div className="form-actions">
        <button ref={check} className="button primary">
          {t("check")}
        </button>
        <button
          type="button"
          className="button"
          onClick={() => {
            keepDraft(place, undefined);
            onCancel();
          }}
        >
          {sharedTexts("close")}
        </button>
        <span className="quiet">{t("mayDo", { roles: form.roles.map(roleName).join(", ") })}</span>
      </div>
    </form>
  );
}
