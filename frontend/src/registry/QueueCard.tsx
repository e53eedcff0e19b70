import { useQuery } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { registryHref } from "../shared/address/registryLinks";
import { useApi } from "../shared/api/api";
import { actionNoun, age, dayAndTime, timeOfDay } from "../shared/format";
import { sharedTexts } from "../shared/texts";
import { queue as fetchQueue, type PadQueue } from "./calls";
import { formKey, type FormName } from "./forms";
import { registryTexts as t } from "./texts";

const EVERY_MS = 2_000;

type Waiting = PadQueue["waiting"][number];

function turn({ being_measured, blocked_by, kept, at_most_ms, place }: Waiting): string {
  const most = age(at_most_ms);
  if (being_measured) return t("queuedTurn", { state: "measured", blocker: "", most });
  if (blocked_by !== undefined) return t("queuedTurn", { state: kept === true ? "kept" : "blocked", blocker: blocked_by, most });
  return t("queuedTurn", { state: place === 1 ? "next" : "later", blocker: "", most });
}

function Act({ pad_id, of, form, chosen }: { pad_id: string; of: string; form: FormName; chosen: string | undefined }): ReactElement {
  return (
    <a className="button" href={registryHref(["pads", pad_id, form, of])} aria-current={chosen === `${form} ${of}` ? "true" : undefined}>
      {t("form", { form: formKey(form) })}
    </a>
  );
}

function Row({ pad_id, now_ms, each, chosen }: { pad_id: string; now_ms: number; each: Waiting; chosen: string | undefined }): ReactElement {
  const { session_id, uav_id, action, rank, since_ms, battery_percent, precedence, claim_ignored, being_measured } = each;
  const told = [
    t("queuedRank", { rank, battery: String(battery_percent ?? "–") }),
    ...(precedence === undefined ? [] : [t("queuedBy", { name: precedence.name, reason: precedence.reason })]),
    ...(claim_ignored ? [t("queuedIgnored")] : []),
    t("queuedSince", { since: age(Math.max(0, now_ms - since_ms)) }),
  ];
  return (
    <li>
      <p className="num">
        <a href={placeHash({ room: "sessions", session: session_id })}>
          <b>{t("queued", { uav: uav_id, action: actionNoun(action) })}</b>
        </a>{" "}
        · {turn(each)}
      </p>
      <p className="quiet num">{told.join(" · ")}</p>
      {!being_measured && (
        <p className="form-actions">
          {precedence === undefined && <Act pad_id={pad_id} of={session_id} form="put-first" chosen={chosen} />}
          <Act pad_id={pad_id} of={session_id} form="turn-away" chosen={chosen} />
        </p>
      )}
    </li>
  );
}

function Reservations({ pad_id, found, chosen }: { pad_id: string; found: PadQueue; chosen: string | undefined }): ReactElement {
  return (
    <>
      {found.reservations.length > 0 && (
        <>
          <h3>{t("reservations")}</h3>
          <ul className="history" aria-label={t("reservations")}>
            {found.reservations.map(({ reservation_id, uav_id, from_ms, until_ms, reserved_by }) => (
              <li key={reservation_id}>
                <p className="num">
                  <b>{t("reserved", { uav: uav_id, from: dayAndTime(from_ms, found.t_ms), until: timeOfDay(until_ms) })}</b>{" "}
                  <span className="quiet">{t("reservedBy", { name: reserved_by })}</span>
                </p>
                <p className="form-actions">
                  <Act pad_id={pad_id} of={reservation_id} form="cancel-reservation" chosen={chosen} />
                </p>
              </li>
            ))}
          </ul>
        </>
      )}
      <p className="form-actions">
        <Act pad_id={pad_id} of="new" form="reserve" chosen={chosen} />
      </p>
    </>
  );
}

/** Who has the pad, who waits for it in which order, and for whom it is kept. */
export function QueueCard({ pad_id, chosen }: { pad_id: string; chosen: string | undefined }): ReactElement {
  const api = useApi();
  const query = useQuery({ queryKey: ["registry", "queue", pad_id], queryFn: () => fetchQueue(api, pad_id), refetchInterval: EVERY_MS });
  const found = query.data;
  return (
    <section className="float card" aria-labelledby="pad-queue">
      <h2 id="pad-queue">{t("queue")}</h2>
      {found === undefined ? (
        <p className="quiet" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : sharedTexts("fetching")}
        </p>
      ) : (
        <>
          {found.occupant !== undefined && (
            <>
              <p className="num">
                {t("occupant", {
                  landed: String(found.occupant.landed),
                  uav: found.occupant.uav_id,
                  since: age(Math.max(0, found.t_ms - found.occupant.since_ms)),
                  left: age(Math.max(0, found.occupant.until_ms - found.t_ms)),
                })}
              </p>
              {found.occupant.landed && (
                <p className="form-actions">
                  <Act pad_id={pad_id} of={found.occupant.session_id} form="departed" chosen={chosen} />
                </p>
              )}
            </>
          )}
          {found.occupant === undefined && found.waiting.length === 0 && <p className="quiet">{t("queueFree")}</p>}
          {found.waiting.length > 0 && (
            <>
              <ol className="history">
                {found.waiting.map((each) => (
                  <Row key={each.session_id} pad_id={pad_id} now_ms={found.t_ms} each={each} chosen={chosen} />
                ))}
              </ol>
              <p className="quiet">{t("queueHint")}</p>
            </>
          )}
          <Reservations pad_id={pad_id} found={found} chosen={chosen} />
        </>
      )}
    </section>
  );
}
