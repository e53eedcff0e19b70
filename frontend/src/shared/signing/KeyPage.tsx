import { useMutation } from "@tanstack/react-query";
import { useState, type ReactElement, type ReactNode } from "react";
import { useApi } from "../api/api";
import { day } from "../format";
import { sharedTexts } from "../texts";
import { Hash } from "../ui/Hash";
import { endKey, type SigningKey, type SigningPlace } from "./flow";
import { bring, enrol, enrolInDemo } from "./getKey";
import { forget, KeyError } from "./keys";
import "./signing.css";
import { roleName, signingTexts as t } from "./texts";
import { choose, useSigner, type Signer } from "./useSigner";

/** What went wrong, in the user's language where it is this browser's doing. */
export function problemText(problem: Error): string {
  return problem instanceof KeyError ? t("problem", { reason: problem.reason }) : problem.message;
}

function Problem({ problem }: { problem: Error | null }): ReactElement | null {
  return problem === null ? null : (
    <p role="alert" className="form-problem">
      {problemText(problem)}
    </p>
  );
}

function Card({ title, hint, children }: { title: string; hint?: string; children: ReactNode }): ReactElement {
  return (
    <section className="float card">
      <h2>{title}</h2>
      {hint !== undefined && <p className="quiet">{hint}</p>}
      {children}
    </section>
  );
}

function Key({ known, here, current, signer }: { known: SigningKey; here: boolean; current: boolean; signer: Signer }): ReactElement {
  const api = useApi();
  const [sure, setSure] = useState(false);
  const remove = useMutation({
    mutationFn: async () => {
      await endKey(api, known.certificate_sha256);
      await forget(known.certificate_sha256);
    },
    onSettled: signer.refresh,
  });
  return (
    <li className="key-row">
      <div>
        <b>{known.name}</b> <span className="quiet">· {roleName(known.role)} · {known.msp_id}</span>{" "}
        <Hash value={known.certificate_sha256} label="SHA-256" />
        <p className="quiet num">{known.problem ? t("unusable", { why: known.problem }) : t("until", { day: day(known.not_after_ms) })}</p>
      </div>
      <div className="form-actions">
        {here && known.usable && (current ? <span className="tag">{t("inUse")}</span> : (
          <button type="button" className="button" onClick={() => choose(known.certificate_sha256)}>
            {t("use")}
          </button>
        ))}
        {sure ? (
          <>
            <span>{t("removeSure")}</span>
            <button type="button" className="button danger" disabled={remove.isPending} onClick={() => remove.mutate()}>
              {t("remove")}
            </button>
            <button type="button" className="button" onClick={() => setSure(false)}>
              {t("cancel")}
            </button>
          </>
        ) : (
          <button type="button" className="button" onClick={() => setSure(true)}>
            {t("remove")}
          </button>
        )}
      </div>
      <Problem problem={remove.error} />
    </li>
  );
}

function Keys({ signer }: { signer: Signer }): ReactElement | null {
  const here = new Set(signer.usable.map(({ certificate_sha256 }) => certificate_sha256));
  const lists = [
    [t("yourKeys"), signer.known.filter(({ certificate_sha256 }) => here.has(certificate_sha256))],
    [t("elsewhere"), signer.known.filter(({ certificate_sha256 }) => !here.has(certificate_sha256))],
  ] as const;
  return (
    <>
      {lists.map(([title, keys]) =>
        keys.length === 0 ? null : (
          <Card key={title} title={title}>
            <ul className="keys">
              {keys.map((known) => (
                <Key
                  key={known.certificate_sha256}
                  known={known}
                  here={here.has(known.certificate_sha256)}
                  current={signer.current?.certificate_sha256 === known.certificate_sha256}
                  signer={signer}
                />
              ))}
            </ul>
          </Card>
        ),
      )}
    </>
  );
}

type Ways = { signer: Signer; place: SigningPlace; onDone?: (() => void) | undefined };

/** The demo's keys, one for each role. */
export function DemoKeys({ signer, place, onDone }: Ways): ReactElement | null {
  const api = useApi();
  const get = useMutation({
    mutationFn: (role: string) => enrolInDemo({ api, place, person_id: signer.person_id }, role),
    onSuccess: async () => {
      await signer.refresh();
      onDone?.();
    },
  });
  if (place.demo_roles.length === 0) return null;
  return (
    <Card title={t("demo")} hint={t("demoHint")}>
      <div className="form-actions">
        {place.demo_roles.map((role, i) => (
          <button key={role} type="button" className={`button ${i === 0 ? "primary" : ""}`} disabled={get.isPending} onClick={() => get.mutate(role)}>
            {t("demoAs", { role: roleName(role) })}
          </button>
        ))}
      </div>
      <Problem problem={get.error} />
    </Card>
  );
}

function Organisation({ value, options, onChange }: { value: string; options: readonly string[]; onChange: (value: string) => void }): ReactElement {
  return (
    <label className="field">
      {t("organisation")}
      <select value={value} onChange={(event) => onChange(event.target.value)}>
        {options.map((msp_id) => (
          <option key={msp_id}>{msp_id}</option>
        ))}
      </select>
    </label>
  );
}

function Enrol({ signer, place }: Ways): ReactElement | null {
  const api = useApi();
  const [msp_id, setMsp] = useState(place.organisations[0] ?? "");
  const [name, setName] = useState("");
  const [secret, setSecret] = useState("");
  const get = useMutation({
    mutationFn: () => enrol({ api, place, person_id: signer.person_id }, msp_id, name.trim(), secret.trim()),
    onSuccess: async () => {
      setSecret("");
      await signer.refresh();
    },
  });
  if (place.organisations.length === 0) return null;
  return (
    <Card title={t("enrol")} hint={t("enrolHint")}>
      <form
        className="form-grid"
        onSubmit={(event) => {
          event.preventDefault();
          get.mutate();
        }}
      >
        <Organisation value={msp_id} options={place.organisations} onChange={setMsp} />
        <label className="field">
          {t("name")}
          <input required value={name} maxLength={64} autoComplete="off" onChange={(event) => setName(event.target.value)} />
        </label>
        <label className="field">
          {t("secret")}
          <input required type="password" value={secret} maxLength={256} autoComplete="off" onChange={(event) => setSecret(event.target.value)} />
        </label>
        <div className="form-actions">
          <button className="button primary" disabled={get.isPending}>
            {t("doEnrol")}
          </button>
        </div>
      </form>
      <Problem problem={get.error} />
    </Card>
  );
}

const MAX_PEM_BYTES = 16_384;

function Bring({ signer, place }: Ways): ReactElement {
  const api = useApi();
  const [msp_id, setMsp] = useState("");
  const [files, setFiles] = useState<{ certificate?: File; key?: File }>({});
  const get = useMutation({
    mutationFn: async () => {
      const certificate = (await files.certificate?.slice(0, MAX_PEM_BYTES).text()) ?? "";
      const key = (await files.key?.slice(0, MAX_PEM_BYTES).text()) ?? "";
      return bring({ api, place, person_id: signer.person_id }, msp_id.trim(), certificate, key);
    },
    onSuccess: signer.refresh,
  });
  return (
    <Card title={t("import")} hint={t("importHint")}>
      <form
        className="form-grid"
        onSubmit={(event) => {
          event.preventDefault();
          get.mutate();
        }}
      >
        <label className="field">
          {t("organisation")}
          <input required value={msp_id} maxLength={64} list="signing-organisations" onChange={(event) => setMsp(event.target.value)} />
          <datalist id="signing-organisations">
            {place.organisations.map((each) => (
              <option key={each} value={each} />
            ))}
          </datalist>
        </label>
        {(["certificate", "key"] as const).map((part) => (
          <label key={part} className="field">
            {t(part === "certificate" ? "certificateFile" : "keyFile")}
            <input
              required
              type="file"
              onChange={(event) => {
                const [file] = event.target.files ?? [];
                setFiles((before) => ({ ...before, ...(file !== undefined && { [part]: file }) }));
              }}
            />
          </label>
        ))}
        <div className="form-actions">
          <button className="button primary" disabled={get.isPending}>
            {t("doImport")}
          </button>
        </div>
      </form>
      <Problem problem={get.error} />
    </Card>
  );
}

/** One's keys, and the ways to another one. */
export function KeyPage(): ReactElement {
  const signer = useSigner();
  const { place } = signer;
  return (
    <div className="key-page">
      <p className="quiet lead">{t("keyIntro")}</p>
      {place === undefined ? (
        <p className="empty" role={signer.error === null ? "status" : "alert"}>
          {signer.error === null ? sharedTexts("fetching") : problemText(signer.error)}
        </p>
      ) : (
        <>
          <Keys signer={signer} />
          <DemoKeys signer={signer} place={place} />
          <Enrol signer={signer} place={place} />
          <Bring signer={signer} place={place} />
        </>
      )}
    </div>
  );
}
