import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { Suspense, lazy, useCallback, useEffect, useState, type ReactElement } from "react";
import { ApiError, useApi } from "../shared/api/api";
import type { SignedIn } from "../shared/api/records";
import { keepDraftsOf } from "../shared/drafts";
import { useLiveStore } from "../shared/live/useLive";
import type { LiveSource } from "../shared/live/source";
import { fillHistory } from "../shared/live/history";
import { useReading } from "../shared/i18n/locale";
import { roomTexts } from "../shared/roomTexts";
import { sharedTexts } from "../shared/texts";
import { useActivity } from "../shared/ui/useActivity";
import { useKeys } from "../shared/ui/useKeys";
import { Herald } from "../alerts/Herald";
import { Banner } from "./Banner";
import { Header, nextTheme } from "./Header";
import { go, usePlace } from "../shared/address/location";
import { NavRail } from "./NavRail";
import { ROOMS, RoomPage } from "./rooms";
import { usePeopleApi } from "../people/api";
import { signInTexts } from "../people/texts";
import { setThemeChoice, useTheme } from "../shared/design/theme";
import { Tour } from "./Tour";

const SignInPage = lazy(() => import("./SignIn").then(({ SignInPage: Page }) => ({ default: Page })));
const KeyboardHelp = lazy(() => import("./KeyboardHelp").then(({ KeyboardHelp: Help }) => ({ default: Help })));

const STATUS_MS = 10_000;

type Arrival = { token?: string; refused?: string };

/** Takes what a link or the way back from a provider says out of the address (and of the browser's history). */
function takeArrival(): Arrival {
  const match = /^#(token|refused)=([^&]+)/.exec(location.hash);
  if (match?.[2] === undefined) return {};
  history.replaceState(null, "", `${location.pathname}${location.search}#/live`);
  const value = decodeURIComponent(match[2]);
  return match[1] === "token" ? { token: value } : { refused: value };
}

/** Signs in, then shows the rooms. */
export function App({ source }: { source: LiveSource }): ReactElement | null {
  const api = useApi();
  const client = useQueryClient();
  const people = usePeopleApi();
  const [{ token, refused }, setArrival] = useState(takeArrival);
  const retry = (failures: number, error: Error): boolean => failures < 3 && error instanceof ApiError && error.status === 0;
  const link = useQuery({ queryKey: ["link"], queryFn: () => people.link(token ?? ""), enabled: token !== undefined, retry, staleTime: Infinity });
  const atOnce = link.data?.kind === "sign_in" || link.data?.kind === "display";
  const who = useQuery({
    queryKey: ["who"],
    queryFn: () =>
      token === undefined || !atOnce ? api.whoAmI() : api.signIn(token).catch((problem: unknown) => afterToken(problem, () => api.whoAmI())),
    enabled: token === undefined || atOnce || link.isError,
    retry,
    staleTime: Infinity,
  });
  const signOut = useMutation({
    mutationFn: () => api.signOut(),
    onSettled: () => {
      keepDraftsOf(undefined);
      source.stop();
      client.clear();
      location.reload();
    },
  });
  // Another language, or other units: everything is drawn anew, and nothing that was typed is lost.
  const { locale } = useReading();
  const signedOut = useCallback(() => void client.resetQueries({ queryKey: ["who"] }), [client]);
  if (who.data !== undefined) {
    return <Rooms person={who.data} source={source} onSignOut={() => signOut.mutate()} onSignedOut={signedOut} />;
  }
  const accepting = token !== undefined && link.data !== undefined && !atOnce ? { token, link: link.data } : undefined;
  if (who.isPending && accepting === undefined) return null;
  return (
    <Suspense fallback={null}>
      <SignInPage
        key={locale}
        problem={problemOf(who.error, token !== undefined && accepting === undefined, refused)}
        accepting={accepting}
        onRetry={() => void who.refetch()}
        onDone={(person) => {
          setArrival({});
          client.setQueryData(["who"], person);
        }}
      />
    </Suspense>
  );
}

/** Why nobody is signed in, where that needs to be said. */
function problemOf(error: Error | null, byLink: boolean, refused: string | undefined): string | undefined {
  if (refused !== undefined) return signInTexts("refused", { why: refused });
  if (error !== null && !(error instanceof ApiError && (error.status === 401 || error.status === 403))) return error.message;
  return byLink ? signInTexts("usedLink") : undefined;
}

/** A link opened twice in a browser that is signed in already is no problem. */
async function afterToken(problem: unknown, whoAmI: () => Promise<SignedIn>): Promise<SignedIn> {
  if (problem instanceof ApiError && problem.status === 0) throw problem;
  return whoAmI();
}

/** What to do where word of activity does not arrive: another one follows, unless the sign-in has ended. */
function endedOr(onSignedOut: () => void): (problem: unknown) => void {
  return (problem) => {
    if (!(problem instanceof ApiError)) throw problem;
    if (problem.status === 401) onSignedOut();
  };
}

type RoomsProperties = { person: SignedIn; source: LiveSource; onSignOut: () => void; onSignedOut: () => void };

function Rooms({ person, source, onSignOut, onSignedOut }: RoomsProperties): ReactElement {
  const api = useApi();
  const store = useLiveStore();
  const place = usePlace();
  const { theme, choice } = useTheme();
  const [help, setHelp] = useState(false);
  // Before any form is drawn.
  useState(() => keepDraftsOf(person.person_id));

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

  useActivity(useCallback(() => void api.use().catch(endedOr(onSignedOut)), [api, onSignedOut]));

  useKeys({
    "?": () => setHelp(true),
    ...Object.fromEntries(ROOMS.map((room) => [room.key, () => go(room.place)])),
    t: () => setThemeChoice(nextTheme(choice, theme)),
  });

  // A wall has nobody at its keys: no bars, only the room.
  const wall = place.room === "live" && place.as === "wall";
  return (
    <div className={wall ? "shell shell-wall" : "shell"}>
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
      <Tour />
      {help && (
        <Suspense fallback={null}>
          <KeyboardHelp open={help} onClose={() => setHelp(false)} />
        </Suspense>
      )}
    </div>
  );
}
