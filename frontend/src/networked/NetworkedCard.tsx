import { skipToken, useMutation, useQuery } from "@tanstack/react-query";
import { useMemo, type ReactElement } from "react";
import { MapCard } from "../map/MapCard";
import type { Overlay } from "../map/overlays";
import { useApi, type ApiError } from "../shared/api/api";
import { useOfficer } from "../shared/api/who";
import { ago, coordinates, dotted, length, speed } from "../shared/format";
import { Fact } from "../shared/ui/Fact";
import { flightDetails, networkedFlights, viewOf, type Bounds, type Flight, type FlightDetails, type Flights } from "./calls";
import "./networked.css";
import { diagonal_m, foreign, MOST_VIEW_M, networkedOverlay } from "./overlay";
import { networkedTexts as t } from "./texts";

const REFRESH_MS = 2_000;
/** Single flights are told in views up to this (F3411-22a, NetDetailsMaxDisplayAreaDiagonal). */
const MOST_SINGLE_M = 2_000;
const NO_OVERLAYS: readonly Overlay[] = [];

export type Networked = { shown: Flights | undefined; overlays: readonly Overlay[]; problem: ApiError | null; wide_m: number | undefined };

/** What is told of the view, again and again while it is looked at; nothing while it is hidden. */
export function useNetworked(wanted: boolean, bounds: Bounds | undefined, selected: string | undefined): Networked {
  const api = useApi();
  const across_m = bounds === undefined ? Infinity : diagonal_m(bounds);
  const fits = across_m <= MOST_VIEW_M;
  const query = useQuery<Flights, ApiError>({
    queryKey: ["networked", bounds === undefined ? "" : viewOf(bounds)],
    queryFn: wanted && fits && bounds !== undefined ? () => networkedFlights(api, bounds) : skipToken,
    refetchInterval: REFRESH_MS,
    // While the map moves, what was told of the view before stays.
    placeholderData: (before) => before,
    retry: false,
  });
  const shown = wanted && fits ? query.data : undefined;
  const overlays = useMemo(() => (shown === undefined ? NO_OVERLAYS : [networkedOverlay(shown, selected)]), [shown, selected]);
  return { shown, overlays, problem: wanted && fits ? query.error : null, wide_m: bounds === undefined || fits ? undefined : across_m };
}

function nameOf({ aircraft_type }: Flight): string {
  return aircraft_type === "" || aircraft_type === "NotDeclared" ? t("unnamed") : aircraft_type.replace(/([a-z])([A-Z])/g, "$1 $2");
}

function Who({ details }: { details: FlightDetails }): ReactElement {
  const ids = Object.values(details.uas_id).filter((each) => each !== "");
  const { operator_registration: operator, operator_lat_e7: lat, operator_lon_e7: lon, description } = details;
  if (ids.length === 0 && operator === undefined && description === undefined) return <p className="quiet">{t("nothing")}</p>;
  return (
    <dl className="networked-facts" data-testid="networked-who">
      {ids.length > 0 && (
        <Fact name={t("id")}>
          {ids.map((each) => (
            <span key={each} className="mono">
              {each}
            </span>
          ))}
        </Fact>
      )}
      {operator !== undefined && (
        <Fact name={t("operator")}>
          <span className="mono">{dotted(operator)}</span>
        </Fact>
      )}
      {lat !== undefined && lon !== undefined && <Fact name={t("operatorPlace")}>{coordinates(lat, lon)}</Fact>}
      {description !== undefined && <Fact name={t("description")}>{description}</Fact>}
    </dl>
  );
}

/** One flight: its provider's word, and on request who flies. */
function FlightFacts({ flight, now_ms }: { flight: Flight; now_ms: number }): ReactElement {
  const api = useApi();
  const who = useMutation<FlightDetails, ApiError>({ mutationFn: () => flightDetails(api, flight.flight_id) });
  const officer = useOfficer();
  const { height_mm, above_mm, speed_mm_s, track_cdeg } = flight;
  return (
    <>
      <h3>{nameOf(flight)}</h3>
      {flight.simulated && <p className="quiet">{t("simulated")}</p>}
      <dl className="networked-facts">
        <Fact name={t("provider")}>{flight.provider}</Fact>
        <Fact name={t("status")}>{flight.status}</Fact>
        <Fact name={t("heard")}>
          {coordinates(flight.lat_e7, flight.lon_e7)} <span className="quiet">{ago(now_ms - flight.t_ms)}</span>
        </Fact>
        {(above_mm !== undefined || height_mm !== undefined) && (
          <Fact name={t("height")}>
            {above_mm !== undefined ? t("above", { height: length(above_mm, true) }) : t("ellipsoid", { height: length(height_mm ?? 0, true) })}
          </Fact>
        )}
        {speed_mm_s !== undefined && <Fact name={t("speed")}>{t("perSecond", { speed: speed(speed_mm_s), track: Math.round((track_cdeg ?? 0) / 100) })}</Fact>}
      </dl>
      {who.data !== undefined && <Who details={who.data} />}
      {who.data === undefined && officer && (
        <button type="button" className="button" title={t("whoHint")} disabled={who.isPending} onClick={() => who.mutate()}>
          {who.isPending ? t("asking", { provider: flight.provider ?? "" }) : t("who")}
        </button>
      )}
      {who.error !== null && <p role="alert">{who.error.message}</p>}
    </>
  );
}

function Summary({ shown, onSelect }: { shown: Flights; onSelect: (flight_id: string) => void }): ReactElement {
  const flights = foreign(shown.flights);
  const within = shown.clusters.reduce((sum, each) => sum + each.flights, 0);
  return (
    <>
      <p aria-live="polite">
        {within > 0 ? t("areas", { count: within, areas: shown.clusters.length, most: length(MOST_SINGLE_M * 1000, true) }) : t("flights", { count: flights.length })}
      </p>
      {flights.length > 0 && (
        <ul className="networked-list">
          {flights.map((flight) => (
            <li key={flight.flight_id}>
              <button type="button" className="link" onClick={() => onSelect(flight.flight_id)}>
                {t("from", { type: nameOf(flight), provider: flight.provider ?? "" })}
              </button>
            </li>
          ))}
        </ul>
      )}
      {shown.providers.length === 0 ? (
        <p className="quiet">{t("alone")}</p>
      ) : (
        <dl className="networked-facts" aria-label={t("providers")}>
          {shown.providers.map(({ provider, problem }) => (
            <Fact key={provider} name={provider}>
              {problem ?? <span className="quiet">{t("answers")}</span>}
            </Fact>
          ))}
        </dl>
      )}
    </>
  );
}

type Properties = { networked: Networked; selected: string | undefined; now_ms: number; onSelect: (flight_id: string | undefined) => void; onClose: () => void };

/** What Network Remote ID tells of the view, apart from all that we know ourselves. */
export function NetworkedCard({ networked, selected, now_ms, onSelect, onClose }: Properties): ReactElement {
  const { shown, problem, wide_m } = networked;
  const flight = shown?.flights.find(({ flight_id }) => flight_id === selected);
  return (
    <MapCard title={t("title")} onClose={onClose}>
      <p className="networked-word">
        <svg width="14" height="14" viewBox="0 0 20 20" aria-hidden="true">
          <circle cx="10" cy="10" r="6.5" fill="var(--panel)" stroke="var(--ink2)" strokeWidth="2" />
        </svg>
        {t("unverified")}
      </p>
      {wide_m !== undefined && <p>{t("closer", { most: length(MOST_VIEW_M * 1000, true), now: Number.isFinite(wide_m) ? length(wide_m * 1000, true) : "∞" })}</p>}
      {problem !== null && <p role="alert">{t("failed", { why: problem.message })}</p>}
      {selected !== undefined && (
        <>
          {flight === undefined ? <p>{t("gone")}</p> : <FlightFacts key={flight.flight_id} flight={flight} now_ms={now_ms} />}
          <p>
            <button type="button" className="link" onClick={() => onSelect(undefined)}>
              {t("back")}
            </button>
          </p>
        </>
      )}
      {selected === undefined && shown !== undefined && <Summary shown={shown} onSelect={onSelect} />}
    </MapCard>
  );
}
