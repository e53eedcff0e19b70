import { useQuery } from "@tanstack/react-query";
import { useDeferredValue, useEffect, useId, useRef, useState, type KeyboardEvent, type ReactElement } from "react";
import { blockHref, transactionHref } from "../ledger/links";
import { useApi } from "../shared/api/api";
import type { Hit } from "../shared/api/records";
import { shortHash } from "../shared/format";
import { placeHash } from "./location";
import { appTexts as t } from "./texts";

function hrefOf(hit: Hit): string {
  switch (hit.kind) {
    case "pad":
      return placeHash({ room: "verdicts", filters: { pad: hit.id } });
    case "drone":
      return placeHash({ room: "live", drone: hit.id });
    case "session":
      return placeHash({ room: "sessions", session: hit.id });
    case "transaction":
      return transactionHref(hit.id);
    case "block":
      return blockHref(Number(hit.id));
  }
}

/** One box for everything that has a name; `/` leads here. A combobox (ARIA APG): arrows choose, Enter opens. */
export function Search(): ReactElement {
  const api = useApi();
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
  useEffect(() => {
    const listen = (event: globalThis.KeyboardEvent): void => {
      const target = event.target;
      const typing = target instanceof HTMLElement && /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName);
      if (event.key !== "/" || typing || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      input.current?.focus();
    };
    addEventListener("keydown", listen);
    return () => removeEventListener("keydown", listen);
  }, []);

  const hits = wanted === "" ? [] : (query.data?.items ?? []);
  const chosen = Math.min(active, Math.max(0, hits.length - 1));
  const close = (): void => {
    setOpen(false);
    setActive(0);
  };
  const follow = (hit: Hit): void => {
    location.hash = hrefOf(hit);
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
