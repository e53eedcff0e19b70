import { useId, useState, type ReactElement, type ReactNode } from "react";
import { setThemeChoice, useTheme, type Choice } from "../shared/design/theme";
import { startTour } from "../shared/tourStops";
import { useWishes, wishNotify, wishSound } from "../alerts/notice";
import { coordinates, dayAndTime, length } from "../shared/format";
import { COORDINATE_FORMS, LENGTH_UNITS, LOCALES, setReading, useReading } from "../shared/i18n/locale";
import { BLOCK_PARTS, useMapWishes, wishMap } from "../map/mapWishes";
import { useServerNow } from "../shared/live/useLive";
import "./settings.css";
import { settingsTexts as t } from "./texts";

const THEMES: readonly Choice[] = ["system", "light", "dark"];
/** Somewhere that everybody can look up: the equator at Greenwich would hide what the letters mean. */
const EXAMPLE = { lat_e7: 604_518_312, lon_e7: 222_666_874 };

type ChoicesProperties<T extends string> = { legend: string; values: readonly T[]; value: T; word: (value: T) => string; choose: (value: T) => void };

function Choices<T extends string>({ legend, values, value, word, choose }: ChoicesProperties<T>): ReactElement {
  const name = useId();
  return (
    <fieldset>
      <legend>{legend}</legend>
      {values.map((each) => (
        <label key={each}>
          <input type="radio" name={name} checked={each === value} onChange={() => choose(each)} />
          {word(each)}
        </label>
      ))}
    </fieldset>
  );
}

function Card({ title, children }: { title: string; children: ReactNode }): ReactElement {
  return (
    <section className="float card settings-card">
      <h2>{title}</h2>
      {children}
    </section>
  );
}

/** What this browser's user reads and hears; nothing of it reaches the server. */
export function SettingsRoom(): ReactElement {
  const { locale, lengths, coordinates: form } = useReading();
  const { choice } = useTheme();
  const wishes = useMapWishes();
  const { sound, notify } = useWishes();
  const [refused, setRefused] = useState(false);
  const now_ms = useServerNow();
  return (
    <div className="page settings">
      <div className="page-head">
        <h1>{t("title")}</h1>
      </div>
      <p className="quiet">{t("note")}</p>
      <div className="settings-cards">
        <Card title={t("reading")}>
          <Choices legend={t("language")} values={LOCALES} value={locale} word={(value) => t("languageIs", { value })} choose={(next) => setReading({ locale: next })} />
          <Choices legend={t("lengths")} values={LENGTH_UNITS} value={lengths} word={(value) => t("lengthsAre", { value })} choose={(next) => setReading({ lengths: next })} />
          <Choices legend={t("coordinates")} values={COORDINATE_FORMS} value={form} word={(value) => t("coordinatesAre", { value })} choose={(next) => setReading({ coordinates: next })} />
          <p className="num quiet" role="status">
            {t("example", { place: coordinates(EXAMPLE.lat_e7, EXAMPLE.lon_e7), distance: length(12_340), moment: dayAndTime(now_ms, now_ms) })}
          </p>
        </Card>
        <Card title={t("appearance")}>
          <Choices legend={t("theme")} values={THEMES} value={choice} word={(value) => t("themeIs", { value })} choose={setThemeChoice} />
        </Card>
        <Card title={t("map")}>
          <label>
            <input type="checkbox" checked={wishes.flat} onChange={(event) => wishMap({ flat: event.target.checked })} />
            {t("flat")}
          </label>
          <fieldset>
            <legend>{t("block")}</legend>
            {BLOCK_PARTS.map((part) => (
              <label key={part}>
                <input type="checkbox" checked={wishes[part]} onChange={(event) => wishMap({ [part]: event.target.checked })} />
                {t("blockPart", { part })}
              </label>
            ))}
          </fieldset>
        </Card>
        <Card title={t("news")}>
          <label>
            <input type="checkbox" checked={sound} onChange={(event) => wishSound(event.target.checked)} />
            {t("sound")}
          </label>
          <label>
            <input
              type="checkbox"
              checked={notify}
              onChange={(event) => {
                void wishNotify(event.target.checked).then((done) => setRefused(!done));
              }}
            />
            {t("notify")}
          </label>
          {refused && <p role="alert">{t("refused")}</p>}
        </Card>
        <Card title={t("help")}>
          <button type="button" className="button" onClick={startTour}>
            {t("tour")}
          </button>
        </Card>
      </div>
    </div>
  );
}
