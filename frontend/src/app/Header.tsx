import { useQuery } from "@tanstack/react-query";
import type { ReactElement } from "react";
import "../alerts/alerts.css";
import { inboxTexts } from "../alerts/texts";
import { isWaiting } from "../alerts/words";
import { useApi } from "../shared/api/api";
import type { SignedIn, Status } from "../shared/api/records";
import { count, duration } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { Symbol } from "../shared/ui/Symbol";
import { placeHash } from "../shared/address/location";
import { Search } from "./Search";
import { LOCALES, setReading, useReading } from "../shared/i18n/locale";
import { appTexts as t } from "./texts";
import { setThemeChoice, useTheme, type Choice, type Theme } from "../shared/design/theme";
import { TourOffer } from "./Tour";

const COUNT_MS = 10_000;
const TOPICS: readonly Topic[] = ["status", "pads", "alerts", "connection"];
/** Up to here the mirror keeps up. */
export const LAG_MS = 5_000;

function Mark(): ReactElement {
  return (
    <svg width="24" height="24" viewBox="0 0 24 24" aria-hidden="true">
      <circle cx="12" cy="12" r="9.5" fill="none" stroke="var(--accent)" strokeWidth="1.4" strokeDasharray="3 2.6" />
      <path d="M12 6.5l5 5.5-5 5.5-5-5.5z" fill="var(--accent)" />
    </svg>
  );
}

function LedgerChip({ status }: { status: Status }): ReactElement {
  const { ledger } = status;
  const cutOff = useLiveStore().isCutOff();
  useServerNow();
  const embedded = ledger.kind === "embedded";
  const organisations = t("organisations", { count: ledger.organisations.length });
  const stopped = typeof ledger.halted === "string";
  const stale = typeof status.server.stale_since_ms === "number";
  const health = stopped || cutOff || stale ? "bad" : ledger.lag_ms > LAG_MS ? "maybe" : "ok";
  return (
    <>
      {(embedded || ledger.notice !== "") && (
        <span className="chip chip-maybe" data-testid="ledger-notice" title={ledger.notice}>
          <span className="wide-only">{embedded ? t("embedded") : ledger.notice}</span>
          <span className="phone-only">{embedded ? t("embeddedShort") : ledger.notice}</span>
        </span>
      )}
      <span className="chip num" title={t("channel", { channel: ledger.channel, organisations: ledger.organisations.join(", ") })}>
        <i className={`dot dot-${health}`} />
        {/* Its health is said in any case; how large it is gives way where there is no room. */}
        <span className="chip-size">
          {t("ledger", { kind: ledger.kind })}
          {organisations} · {t("blocks", { blocks: count(ledger.height) })} ·{" "}
        </span>
        <span className="chip-state">
          {stopped ? t("mirrorHalted") : cutOff || stale ? t("cutOff") : ledger.lag_ms < 1000 ? t("upToDate") : t("behind", { duration: duration(ledger.lag_ms) })}
        </span>
      </span>
    </>
  );
}


export function ThemeButton(): ReactElement {
  const { theme, choice } = useTheme();
  const next = nextTheme(choice, theme);
  return (
    <button
      type="button"
      className="icon-button"
      title={`${t("themeIs", { choice })} (t)`}
      aria-label={`${t("themeIs", { choice })}. ${t("themeChange", { choice: next })}`}
      onClick={() => setThemeChoice(next)}
    >
      <svg viewBox="0 0 20 20" aria-hidden="true">
        {choice === "light" ? (
          <>
            <circle cx="10" cy="10" r="3.4" />
            <path d="M10 1.8v2M10 16.2v2M1.8 10h2M16.2 10h2M4.2 4.2l1.4 1.4M14.4 14.4l1.4 1.4M15.8 4.2l-1.4 1.4M5.6 14.4l-1.4 1.4" />
          </>
        ) : choice === "dark" ? (
          <path d="M16.5 12.2A7 7 0 0 1 7.8 3.5a7 7 0 1 0 8.7 8.7z" />
        ) : (
          <>
            <circle cx="10" cy="10" r="7" />
            <path d="M10 3a7 7 0 0 1 0 14z" fill="currentColor" />
          </>
        )}
      </svg>
    </button>
  );
}

/** The next language; its name stands in itself, for those who cannot read the present one. */
export function LanguageButton(): ReactElement {
  const { locale } = useReading();
  return (
    <button
      type="button"
      className="icon-button language"
      title={t("language")}
      aria-label={`${t("otherLanguage")}: ${t("language")}`}
      onClick={() => setReading({ locale: LOCALES[(LOCALES.indexOf(locale) + 1) % LOCALES.length] ?? "en" })}
    >
      {t("otherLanguage")}
    </button>
  );
}

/** From the system's theme to the other one: each press is to be seen. */
export function nextTheme(choice: Choice, theme: Theme): Choice {
  if (choice === "system") return theme === "dark" ? "light" : "dark";
  return choice === "dark" ? "light" : "system";
}

type Properties = { person: SignedIn; onHelp: () => void; onSignOut: () => void };

/** The ledger is always in sight: which one, how many organisations, height, lag. */
export function Header({ person, onHelp, onSignOut }: Properties): ReactElement {
  const { status, pads, silent, here, more } = useLive(TOPICS, (store) => {
    const now_ms = store.serverNow_ms();
    const all = [...store.pads.values()].filter((pad) => pad.status !== "retired");
    return {
      status: store.status,
      pads: all.length,
      here: [...store.alerts.values()].filter((alert) => isWaiting(alert, now_ms)).length,
      more: store.moreAlerts,
      silent: all.filter((pad) => pad.health?.connected === false).length,
    };
  });
  // Where the live connection does not have all of them, the server counts.
  const api = useApi();
  const counted = useQuery({ queryKey: ["alerts", "count"], queryFn: () => api.alertCount(), enabled: more, refetchInterval: COUNT_MS });
  const waiting = more ? (counted.data ?? here) : here;
  const atLeast = more && counted.data === undefined;
  return (
    <header className="header">
      <span className="mark">
        <Mark />
      </span>
      <span className="brand">Wonderland</span>
      {status !== undefined && <LedgerChip status={status} />}
      {status !== undefined && (
        <span className="header-pads quiet num">
          {t("pads", { count: pads })}
          {silent > 0 ? t("padsSilent", { count: silent }) : ""}
        </span>
      )}
      <Search />
      <span className="header-end">
        {waiting > 0 && (
          <a className="chip chip-alerts num" href={placeHash({ room: "alerts", path: [], query: {} })} data-testid="alerts-chip">
            <Symbol look="refuted" size={14} />
            {inboxTexts("count", { count: waiting, more: atLeast ? "yes" : "no" })}
          </a>
        )}
        {status?.server.demo === true && <TourOffer />}
        <LanguageButton />
        <ThemeButton />
        <button type="button" className="icon-button keys" title={t("keysTitle")} aria-label={t("keys")} onClick={onHelp}>
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <circle cx="10" cy="10" r="7.6" />
            <path d="M7.8 7.8a2.3 2.3 0 1 1 3.3 2c-.8.5-1.1.9-1.1 1.8M10 14.2v.1" />
          </svg>
        </button>
        <a className="person quiet" href={placeHash({ room: "people", path: ["me"], query: {} })} title={person.name}>
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <circle cx="10" cy="6.6" r="3.4" />
            <path d="M3.6 17.2c.5-3.6 3-5.4 6.4-5.4s5.9 1.8 6.4 5.4" />
          </svg>
          <span>{person.name}</span>
        </a>
        <button type="button" className="button" onClick={onSignOut}>
          {t("signOut")}
        </button>
      </span>
    </header>
  );
}
