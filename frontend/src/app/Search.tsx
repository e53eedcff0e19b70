import { useQuery } from "@tanstack/react-query";
import { useDeferredValue, useId, useRef, useState, type KeyboardEvent, type ReactElement } from "react";
import { blockHref, transactionHref } from "../shared/address/ledgerLinks";
import { useApi } from "../shared/api/api";
import type { Hit } from "../shared/api/records";
import { replayHash } from "../shared/address/replayPlace";
import { typedTime } from "../replay/typedTime";
import { day, shortHash, timeOfDay } from "../shared/format";
import type { LiveStore } from "../shared/live/store";
import { useLiveStore } from "../shared/live/useLive";
import { useKeys } from "../shared/ui/useKeys";
import { placeHash } from "../shared/address/location";
import { appTexts as t } from "./texts";

/** What the server found, or a moment that was typed: "yesterday 14:00". */
type Found = Hit | { kind: "moment"; id: string; name: string; detail: string };

/** The moment that a text names; the replay of it is to be had at once. */
function momentOf(text: string, now_ms: number): Found | undefined {
  const t_ms = typedTime(text, now_ms);
  if (t_ms === undefined || t_ms < 0 || t_ms > now_ms) return undefined;
  return { kind: "moment", id: String(t_ms), name: `${day(t_ms)}, ${timeOfDay(t_ms)}`, detail: t("replayIt") };
}

/** No serial number and no id has a colon or a blank in it. */
const PLAINLY_A_MOMENT = /[:\s]/;

/** Close enough to see a pad's marks and its grid. */
const PAD_ZOOM = 19;
/** What was heard in a moment is known a little later. */
const KNOWN_MS = 2_000;

function hrefOf(hit: Found, store: LiveStore): string {
  switch (hit.kind) {
    case "moment":
      return replayHash(Number(hit.id));
    case "pad":
      return padHref(hit.id, store);
    case "drone":
      return placeHash({ room: "live", drone: hit.id });
    case "broadcast":
      // Gone from the live map: where and when it was heard last.
      return store.tracks.has(hit.id) ? placeHash({ room: "live", drone: hit.id }) : replayHash((hit.heard_ms ?? 0) + KNOWN_MS, { drone: hit.id });
    case "session":
      return placeHash({ room: "sessions", session: hit.id });
    case "transaction":
      return transactionHref(hit.id);
    case "block":
      return blockHref(Number(hit.id));
  }
}

function padHref(pad_id: string, store: LiveStore): string {
  const pad = store.pads.get(pad_id);
  if (pad === undefined) return placeHash({ room: "registry", path: ["pads", pad_id], query: {} });
  return placeHash({ room: "live", list: "pads", camera: { lat: pad.lat_e7 / 1e7, lon: pad.lon_e7 / 1e7, zoom: PAD_ZOOM } });
}

/** One box for everything that has a name; `/` leads here. A combobox (ARIA APG): arrows choose, Enter opens. */
export function Search(): ReactElement {
  const api = useApi();
  const store = useLiveStore();
  const id = useId();
  const input = useRef<HTMLInputElement>(null);
  const [text, setText] = useState("");
  const [open, setOpen] = useState(false);
  const [active, setActive] = useState(0);
  const wanted = useDeferredValue(text.trim());
  const query = useQuery({
    queryKey: ["search", wanted],
    queryFn: () => api.search(wanted),
    enabled: wanted !== "",
    staleTime: 10_000,
    placeholderData: (before) => before,
  });
  useKeys({ "/": () => input.current?.focus() });

  const found: readonly Found[] = wanted === "" ? [] : (query.data?.items ?? []);
  const moment = wanted === "" ? undefined : momentOf(wanted, Math.round(store.serverNow_ms()));
  const hits = moment === undefined ? found : PLAINLY_A_MOMENT.test(wanted) ? [moment, ...found] : [...found, moment];
  const chosen = Math.min(active, Math.max(0, hits.length - 1));
  const close = (): void => {
    setOpen(false);
    setActive(0);
  };
  const follow = (hit: Found): void => {
    location.hash = hrefOf(hit, store);
    setText("");
    close();
    input.current?.blur();
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    const hit = hits[chosen];
    if (event.key === "ArrowDown") setActive(Math.min(chosen + 1, hits.length - 1));
    else if (event.key === "ArrowUp") setActive(Math.max(chosen - 1, 0));
    else if (event.key === "Enter" && hit !== undefined) follow(hit);
    else if (event.key === "Escape") {
      setText("");
      close();
      input.current?.blur();
    } else return;
    event.preventDefault();
  };
  const shown = open && wanted !== "";
  return (
    <div className="search" role="search">
      <input
        ref={input}
        type="text"
        role="combobox"
        aria-expanded={shown}
        aria-controls={`${id}-hits`}
        aria-activedescendant={shown && hits.length > 0 ? `${id}-${chosen}` : undefined}
        aria-label={t("search")}
        aria-autocomplete="list"
        placeholder={t("searchHint")}
        autoComplete="off"
        spellCheck={false}
        maxLength={128}
        value={text}
        onChange={(event) => {
          setText(event.target.value);
          setActive(0);
          setOpen(true);
        }}
        onFocus={() => setOpen(true)}
        onBlur={close}
        onKeyDown={onKeyDown}
      />
      <kbd aria-hidden="true">/</kbd>
      <div id={`${id}-hits`} role="listbox" aria-label={t("search")} className="float hits" hidden={!shown}>
        {hits.map((hit, i) => (
          // The input has the focus, and the keys; a press must come before its blur closes the list.
          // eslint-disable-next-line jsx-a11y/click-events-have-key-events, jsx-a11y/interactive-supports-focus
          <div
            className="hit"
            key={hit.kind + hit.id}
            id={`${id}-${i}`}
            role="option"
            aria-selected={i === chosen}
            onPointerDown={(event) => event.preventDefault()}
            onClick={() => follow(hit)}
          >
            <span className="quiet">{t("hit", { kind: hit.kind })}</span>
            <b>{hit.name}</b>
            <small className="quiet">
              {hit.kind === "session" || hit.kind === "transaction" ? `${shortHash(hit.id)} · ` : ""}
              {hit.detail}
            </small>
          </div>
        ))}
        {hits.length === 0 && (
          <p className="hits-none quiet" role="status">
            {query.isError ? query.error.message : query.isFetching ? t("searching") : t("nothingFits", { text: wanted })}
          </p>
        )}
      </div>
    </div>
  );
}
