import { keepPreviousData, useQuery } from "@tanstack/react-query";
import type { ReactElement, ReactNode } from "react";
import { go, type Place, type PlainRoom } from "../shared/address/location";
import { useApi } from "../shared/api/api";
import type { Pad, Statistics } from "../shared/api/records";
import { AsTable } from "../shared/charts/AsTable";
import { StackedBars } from "../shared/charts/StackedBars";
import { dateInput, dayOf } from "../shared/days";
import { count, day, dayAndTime, decimal, length } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { formatTexts, lookTexts, sharedTexts } from "../shared/texts";
import { Choice } from "../shared/ui/Filters";
import { Symbol } from "../shared/ui/Symbol";
import { Groups } from "./Groups";
import { binLabel, DAY_BIN_MS, recent, SPANS } from "./spans";
import "./statistics.css";
import { StepTimes } from "./StepTimes";
import { statisticsTexts as t } from "./texts";

const PADS: readonly Topic[] = ["pads"];
const ACTIONS = ["land", "takeoff", "dock"] as const;
const REFRESH_MS = 30_000;

function Card({ title, note, children, wide = false }: { title: string; note?: string; children: ReactNode; wide?: boolean | "half" }): ReactElement {
  return (
    <section className={`float card ${wide === "half" ? "card-half" : wide ? "card-wide" : ""}`}>
      <h2>{title}</h2>
      {note !== undefined && <p className="quiet num">{note}</p>}
      {children}
    </section>
  );
}

function Totals({ found }: { found: Statistics }): ReactElement {
  const { total } = found;
  const all = total.verified + total.refuted + total.inconclusive;
  const share = (value: number): string => (all === 0 ? "" : t("share", { share: `${decimal((100 * value) / all, 1)} %` }));
  return (
    <dl className="figures num float totals">
      <div>
        <dt>{t("total")}</dt>
        <dd>{count(all)}</dd>
      </div>
      {(["verified", "inconclusive", "refuted"] as const).map((outcome) => (
        <div key={outcome}>
          <dt className="outcome">
            <Symbol look={outcome} size={14} /> {lookTexts(outcome)}
          </dt>
          <dd className={`look-${outcome}`}>{count(total[outcome])}</dd>
          <dd className="figure-note quiet">{share(total[outcome])}</dd>
        </div>
      ))}
      <div>
        <dt>{t("granted")}</dt>
        <dd>{count(total.granted)}</dd>
        <dd className="figure-note quiet">{share(total.granted)}</dd>
      </div>
      <div>
        <dt>{t("perHour")}</dt>
        <dd>{decimal(found.proofs_per_hour, found.proofs_per_hour < 10 ? 1 : 0)}</dd>
        <dd className="figure-note quiet">
          {t("busiest")}: {count(found.busiest_hour)}
        </dd>
      </div>
    </dl>
  );
}

function OverTime({ found, bin_ms }: { found: Statistics; bin_ms: number }): ReactElement {
  const { bins, total } = found;
  const from = bins[0]?.start_ms ?? 0;
  const to = (bins.at(-1)?.start_ms ?? 0) + bin_ms;
  const words = (each: { verified: number; inconclusive: number; refuted: number }, start_ms: number, end_ms: number): string =>
    t("overTimeIs", {
      verified: count(each.verified),
      inconclusive: count(each.inconclusive),
      refuted: count(each.refuted),
      from: dayAndTime(start_ms, end_ms),
      to: dayAndTime(end_ms, start_ms),
    });
  return (
    <Card title={t("overTime")} wide>
      <StackedBars
        summary={words(total, from, to)}
        height={200}
        every={Math.ceil(bins.length / 8)}
        bars={bins.map((bin) => ({
          key: String(bin.start_ms),
          label: binLabel(bin.start_ms, bin_ms),
          title: words(bin, bin.start_ms, bin.start_ms + bin_ms),
          parts: [
            { tone: "ok", value: bin.verified },
            { tone: "maybe", value: bin.inconclusive },
            { tone: "bad", value: bin.refuted },
          ],
        }))}
      />
      <AsTable
        head={[t("time"), lookTexts("verified"), lookTexts("inconclusive"), lookTexts("refuted")]}
        rows={bins
          .filter((bin) => bin.verified + bin.inconclusive + bin.refuted > 0)
          .map((bin) => ({
            key: String(bin.start_ms),
            cells: [dayAndTime(bin.start_ms, to), count(bin.verified), count(bin.inconclusive), count(bin.refuted)],
          }))}
      />
    </Card>
  );
}

function Distributions({ found }: { found: Statistics }): ReactElement {
  const judged = found.likelihood.reduce((sum, each) => sum + each, 0);
  const likelihoodNote = t("likelihoodIs", { count: count(judged) });
  const errorNote = t("errorIs", { count: count(judged) });
  const last = found.error.at(-2)?.up_to_mm ?? 0;
  const likelihoods = found.likelihood.map((value, i) => ({ value, label: `${decimal(i / 20, 2)}–${decimal((i + 1) / 20, 2)}` }));
  const errors = found.error.map(({ up_to_mm, count: value }) => ({
    value,
    label: up_to_mm === undefined ? t("beyond", { distance: length(last, true) }) : t("upTo", { distance: length(up_to_mm, true) }),
  }));
  const rowsOf = (bins: readonly { label: string; value: number }[]): { key: string; cells: string[] }[] =>
    bins.filter(({ value }) => value > 0).map(({ label, value }) => ({ key: label, cells: [label, count(value)] }));
  return (
    <>
      <Card title={t("likelihood")} note={likelihoodNote} wide="half">
        <StackedBars
          summary={likelihoodNote}
          every={4}
          bars={likelihoods.map(({ value, label }, i) => ({
            key: label,
            label: decimal(i / likelihoods.length, 1),
            title: `${label}: ${count(value)}`,
            parts: [{ tone: "accent", value }],
          }))}
        />
        <AsTable head={[t("likelihood"), t("total")]} rows={rowsOf(likelihoods)} />
      </Card>
      <Card title={t("error")} note={errorNote} wide="half">
        <StackedBars
          summary={errorNote}
          every={2}
          bars={errors.map(({ value, label }) => ({ key: label, label, title: `${label}: ${count(value)}`, parts: [{ tone: "accent", value }] }))}
        />
        <AsTable head={[t("error"), t("total")]} rows={rowsOf(errors)} />
      </Card>
    </>
  );
}

/** How the pads are; of a day that is reported, how they were when it ended (or are by now, where it has not). */
function PadHealth({ live, until_ms }: { live: readonly Pad[]; until_ms: number | undefined }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(REFRESH_MS);
  const past = until_ms !== undefined && until_ms <= now_ms ? until_ms - 1 : undefined;
  const query = useQuery({ queryKey: ["pads-then", past], queryFn: () => api.padsAt(past ?? 0), enabled: past !== undefined, staleTime: Infinity });
  const title = t(past === undefined ? "padHealth" : "padHealthThen");
  if (past !== undefined && query.data === undefined) {
    return (
      <Card title={title}>
        <p className="quiet" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : sharedTexts("fetching")}
        </p>
      </Card>
    );
  }
  const pads = past === undefined ? live : (query.data ?? []);
  return (
    <Card title={title} {...(past !== undefined && { note: t("asOf", { when: dayAndTime(past, now_ms) }) })}>
      <table className="table num">
        <tbody>
          {pads.map((pad) => {
            const { health } = pad;
            const anchors = health?.anchors ?? [];
            const up = anchors.filter(({ state }) => state === "up").length;
            return (
              <tr key={pad.pad_id}>
                <th scope="row">{pad.name}</th>
                <td className={health?.connected === true ? undefined : "look-inconclusive"}>
                  {health === undefined ? t("never") : health.connected ? t("connected") : t("silent")}
                </td>
                <td className="right">{anchors.length > 0 && t("anchorsUp", { up, all: anchors.length })}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </Card>
  );
}

/** What the verdicts of a span come to. `#/statistics?span=week&pad=aurajoki-2`, `#/statistics?day=2026-11-21`. */
export function StatisticsRoom({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(REFRESH_MS);
  const pads = useLive(PADS, (store) => [...store.pads.values()]);
  const { query: chosen } = place;
  const oneDay = dayOf(chosen["day"] ?? "");
  const name = SPANS.find((each) => each === chosen["span"]) ?? "day";
  const span = oneDay === undefined ? recent(name, now_ms) : { ...oneDay, bin_ms: DAY_BIN_MS };
  const action = ACTIONS.find((each) => each === chosen["action"]);
  const filters = {
    ...span,
    ...(chosen["pad"] !== undefined && { pad: chosen["pad"] }),
    ...(chosen["operator"] !== undefined && { operator: chosen["operator"] }),
    ...(action !== undefined && { action }),
  };
  const query = useQuery({
    queryKey: ["statistics", filters],
    queryFn: () => api.statistics(filters),
    placeholderData: keepPreviousData,
    refetchInterval: oneDay === undefined ? REFRESH_MS : false,
  });
  const set = (change: Record<string, string>): void => {
    const next = Object.fromEntries(Object.entries({ ...chosen, ...change }).filter(([, value]) => value !== ""));
    go({ room: "statistics", path: [], query: next }, true);
  };
  const found = query.data;
  const all = found === undefined ? 0 : found.total.verified + found.total.refuted + found.total.inconclusive;
  return (
    <div className="page statistics">
      <div className="page-head">
        <h1>{oneDay === undefined ? t("statistics") : t("report", { day: day(oneDay.since_ms) })}</h1>
        <div className="filters">
          <label>
            {t("whichSpan")}
            <select value={oneDay === undefined ? name : "other"} onChange={(event) => set(event.target.value === "other" ? { day: dateInput(now_ms), span: "" } : { span: event.target.value, day: "" })}>
              {SPANS.map((each) => (
                <option key={each} value={each}>
                  {t("span", { span: each })}
                </option>
              ))}
              <option value="other">{t("span", { span: "other" })}</option>
            </select>
          </label>
          {oneDay !== undefined && (
            <label>
              {t("date")}
              <input type="date" value={chosen["day"]} max={dateInput(now_ms)} onChange={(event) => event.target.value !== "" && set({ day: event.target.value })} />
            </label>
          )}
          <Choice label={t("pad")} value={chosen["pad"] ?? ""} options={pads.map((pad) => ({ value: pad.pad_id, name: pad.name }))} onChange={(pad) => set({ pad })} />
          <Choice label={t("action")} value={action ?? ""} options={ACTIONS.map((value) => ({ value, name: formatTexts("noun", { action: value }) }))} onChange={(value) => set({ action: value })} />
          {chosen["operator"] !== undefined && (
            <button type="button" className="button" onClick={() => set({ operator: "" })}>
              {t("operator")}: {chosen["operator"]} ×
            </button>
          )}
          <button type="button" className="button" onClick={() => print()}>
            {t("print")}
          </button>
        </div>
      </div>
      {query.isError && (
        <p className="empty" role="alert">
          {query.error.message}
        </p>
      )}
      {found === undefined && query.isPending && <p className="empty">{sharedTexts("fetching")}</p>}
      {found !== undefined && (
        <div className="statistics-grid" aria-busy={query.isPlaceholderData}>
          <Totals found={found} />
          {all === 0 ? (
            <p className="empty card-wide">{t("none")}</p>
          ) : (
            <>
              <OverTime found={found} bin_ms={span.bin_ms} />
              <Distributions found={found} />
              <Card title={t("byPad")}>
                <Groups groups={found.pads} nameOf={(id) => pads.find(({ pad_id }) => pad_id === id)?.name ?? id} onChoose={(pad) => set({ pad })} />
              </Card>
              <Card title={t("byOperator")}>
                <Groups groups={found.operators} nameOf={(id) => id} onChoose={(operator) => set({ operator })} />
              </Card>
              <Card title={t("byAction")}>
                <Groups groups={found.actions} nameOf={(id) => formatTexts("noun", { action: id })} onChoose={(each) => set({ action: each })} />
              </Card>
              <PadHealth live={pads} until_ms={oneDay?.until_ms} />
              <Card title={t("steps")} note={t("stepsAre")} wide>
                <StepTimes totals={found.step_totals} times={found.steps} bin_ms={span.bin_ms} />
              </Card>
            </>
          )}
        </div>
      )}
    </div>
  );
}
