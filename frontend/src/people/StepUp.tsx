import { useEffect, useRef, useState, type ReactElement } from "react";
import { createRoot } from "react-dom/client";
import stepUpEn from "@messages/en/console/step-up.json";
import stepUpFi from "@messages/fi/console/step-up.json";
import { answered, type Act, type Api } from "../shared/api/api";
import { texts } from "../shared/i18n/texts";
import "./people.css";
import { getPasskey } from "./webauthn";

const t = texts({ en: stepUpEn, fi: stepUpFi });

/** The token that lets one request pass. Throws `ApiError`. */
async function confirmed(api: Api, act: Act): Promise<string> {
  const { ceremony, options } = await answered((signal) => api.client.POST("/api/v1/step-up/challenge", { body: act, signal }));
  const credential = await getPasskey(options);
  const { token } = await answered((signal) => api.client.POST("/api/v1/step-up", { body: { ceremony, credential }, signal }));
  return token;
}

type Properties = { ask: () => Promise<string>; onDone: (token: string | undefined) => void };

/** Asks for the passkey, over whatever the page shows. */
export function StepUpDialog({ ask, onDone }: Properties): ReactElement {
  const dialog = useRef<HTMLDialogElement>(null);
  const [waiting, setWaiting] = useState(false);
  const [problem, setProblem] = useState<string>();
  useEffect(() => dialog.current?.showModal(), []);
  const confirm = (): void => {
    setWaiting(true);
    setProblem(undefined);
    ask().then(onDone, (error: unknown) => {
      setWaiting(false);
      setProblem(error instanceof Error ? error.message : String(error));
    });
  };
  return (
    <dialog ref={dialog} className="float step-up" aria-labelledby="step-up-title" aria-describedby="step-up-hint" onClose={() => onDone(undefined)}>
      <h2 id="step-up-title">{t("title")}</h2>
      <p id="step-up-hint">{t("hint")}</p>
      <p aria-live="polite">{waiting ? t("waiting") : ""}</p>
      {problem !== undefined && (
        <p className="people-problem" role="alert">
          {problem}
        </p>
      )}
      <div className="people-actions">
        <button type="button" className="button primary" disabled={waiting} onClick={confirm}>
          {t("confirm")}
        </button>
        <button type="button" className="button" onClick={() => dialog.current?.close()}>
          {t("cancel")}
        </button>
      </div>
    </dialog>
  );
}

/** The token for one request; undefined where the person would rather not. */
export function stepUp(api: Api, act: Act): Promise<string | undefined> {
  const place = document.body.appendChild(document.createElement("div"));
  const root = createRoot(place);
  const before = document.activeElement;
  return new Promise((resolve) => {
    const done = (token: string | undefined): void => {
      resolve(token);
      root.unmount();
      place.remove();
      // The browser gives the focus back itself, but not once the dialog is gone.
      if (before instanceof HTMLElement) before.focus();
    };
    root.render(<StepUpDialog ask={() => confirmed(api, act)} onDone={done} />);
  });
}
