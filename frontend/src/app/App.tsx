import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { Suspense, useCallback, useEffect, useState, type ReactElement } from "react";
import { ApiError, useApi } from "../shared/api/api";
import type { SignedIn } from "../shared/api/records";
import { useLiveStore } from "../shared/live/useLive";
import type { LiveSource } from "../shared/live/source";
import { fillHistory } from "../shared/live/history";
import { useReading } from "../shared/i18n/locale";
import { sharedTexts } from "../shared/texts";
import { useKeys } from "../shared/ui/useKeys";
import { Herald } from "../alerts/Herald";
import { Banner } from "./Banner";
import { Header, nextTheme } from "./Header";
import { KeyboardHelp } from "./KeyboardHelp";
import { go, usePlace } from "./location";
import { NavRail } from "./NavRail";
import { ROOMS, RoomPage } from "./rooms";
import { SignInPage } from "./SignIn";
import { appTexts as t, roomTexts } from "./texts";
import { setThemeChoice, useTheme } from "./theme";

const STATUS_MS = 10_000;

/** Takes the one-time token out of the address (and of the browser's history) and gives it back. */
function takeToken(): string | undefined {
  const match = /^#token=([^&]+)/.exec(location.hash);
  if (match?.[1] === undefined) return undefined;
  history.replaceState(null, "", `${location.pathname}${location.search}#/live`);
  return decodeURIComponent(match[1]);
}

/** Signs in, then shows the rooms. */
export function App({ source }: { source: LiveSource }): ReactElement | null {
  const api = useApi();
  const client = useQueryClient();
  const [token] = useState(takeToken);
  const who = useQuery({
    queryKey: ["who"],
    queryFn: () => (token === undefined ? api.whoAmI() : api.signIn(token).catch((problem: unknown) => afterToken(problem, () => api.whoAmI()))),
    retry: (failures, error) => failures < 3 && error instanceof ApiError && error.status === 0,
    staleTime: Infinity,
  });
  const signOut = useMutation({
    mutationFn: () => api.signOut(),
    onSettled: () => {
      source.stop();
      client.clear();
      location.reload();
    },
  });
  // Another language, or other units: everything is said anew.
  const { locale, lengths, coordinates } = useReading();
  const signedOut = useCallback(() => void client.resetQueries({ queryKey: ["who"] }), [client]);
  if (who.data !== undefined) {
    return <Rooms key={`${locale} ${lengths} ${coordinates}`} person={who.data} source={source} onSignOut={() => signOut.mutate()} onSignedOut={signedOut} />;
  }
  if (who.isPending) return null;
  const problem = who.error instanceof ApiError && who.error.status === 401 ? undefined : who.error.message;
  return <SignInPage key={locale} problem={problem ?? (token === undefined ? undefined : t("usedLink"))} onRetry={() => void who.refetch()} />;
}

/** A link opened twice in a browser that is signed in already is no problem. */
async function afterToken(problem: unknown, whoAmI: () => Promise<SignedIn>): Promise<SignedIn> {
  if (problem instanceof ApiError && problem.status === 0) throw problem;
  return whoAmI();
}

type RoomsProperties = { person: SignedIn; source: LiveSource; onSignOut: () => void; onSignedOut: () => void };

function Rooms({ person, source, onSignOut, onSignedOut }: RoomsProperties): ReactElement {
  const api = useApi();
  const store = useLiveStore();
  const place = usePlace();
  const { choice } = useTheme();
  const [help, setHelp] = useState(false);

  useEffect(() => {
    source.start((event) => {
      store.receive(event);
      if (event.kind === "state" && event.state.phase === "signed-out") onSignedOut();
      if (store.gap && store.connection.phase === "open") {
        store.gapFilled();
        fillHistory(api, store).catch((problem: unknown) => {
          // The live connection goes on; the next one that opens fills the gap again.
          if (!(problem instanceof ApiError)) throw problem;
        });
      }
    });
    return () => source.stop();
  }, [api, store, source, onSignedOut]);

  const status = useQuery({ queryKey: ["status"], queryFn: () => api.status(), refetchInterval: STATUS_MS, retry: false });
  useEffect(() => {
    if (status.data !== undefined) store.merge({ status: status.data });
  }, [store, status.data]);
  useEffect(() => {
    if (status.error instanceof ApiError && status.error.status === 401) onSignedOut();
  }, [status.error, onSignedOut]);

  useKeys({
    "?": () => setHelp(true),
    ...Object.fromEntries(ROOMS.map((room) => [room.key, () => go(room.place)])),
    t: () => setThemeChoice(nextTheme(choice)),
  });

  return (
    <div className="shell">
      <Header person={person} onHelp={() => setHelp(true)} onSignOut={onSignOut} />
      <NavRail room={place.room} />
      <main className="room" aria-label={roomTexts(place.room)}>
        <Banner source={source} />
        {/* By room: a room that is left must go at once, with its timers, even while the next one is still loading. */}
        <Suspense key={place.room} fallback={<p className="empty">{sharedTexts("fetching")}</p>}>
          <RoomPage place={place} />
        </Suspense>
      </main>
      <Herald />
      <KeyboardHelp open={help} onClose={() => setHelp(false)} />
    </div>
  );
}
