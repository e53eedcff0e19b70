import "@fontsource-variable/inter/wght.css";
import "@fontsource-variable/jetbrains-mono/wght.css";
import "./shared/design/tokens.css";
import "./shared/design/base.css";
import "./app/app.css";
import "./desk/desk.css";
import "./sessions/sessions.css";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { App } from "./app/App";
import { Api, ApiContext, ApiError } from "./shared/api/api";
import { workerSource, type LiveSource } from "./shared/live/source";
import { LiveStore } from "./shared/live/store";
import { LiveContext } from "./shared/live/useLive";

/** `/sessions/…` is `/#/sessions/…`: a link typed or shortened by hand finds its room, too. */
function straighten(): void {
  const { pathname, search, hash } = location;
  if (pathname !== "/" && !pathname.endsWith(".html")) history.replaceState(null, "", `/${search}${hash || `#${pathname}`}`);
}

async function start(): Promise<void> {
  straighten();
  const origin = location.origin;
  let store = new LiveStore();
  let api = new Api(origin);
  let source: LiveSource = workerSource(`${origin}/api/v1/live`);
  if (__FAKE__) {
    const { fakeOptions, fakeSource } = await import("./shared/fake/source");
    const options = fakeOptions(location.search);
    if (options !== undefined) {
      const { fakeFetch } = await import("./shared/fake/api");
      source = fakeSource(options).source;
      api = new Api(origin, fakeFetch(store, options.flags));
    }
    const { fetchedRecording, recordingOptions } = await import("./shared/fake/recording");
    const recorded = recordingOptions(location.search);
    if (recorded !== undefined) {
      const { fakeFetch } = await import("./shared/fake/api");
      const recording = fetchedRecording(recorded);
      source = recording;
      store = new LiveStore(recording.now_ms);
      api = new Api(origin, fakeFetch(store, new Set()));
    }
  }
  const known = api;
  known.stepUp = async (act) => (await import("./people/StepUp")).stepUp(known, act);
  const client = new QueryClient({
    defaultOptions: {
      queries: { retry: (failures, error) => failures < 2 && error instanceof ApiError && error.status === 0 },
    },
  });
  const root = document.getElementById("root");
  if (root === null) throw new Error("index.html has no #root");
  createRoot(root).render(
    <StrictMode>
      <QueryClientProvider client={client}>
        <ApiContext value={api}>
          <LiveContext value={store}>
            <App source={source} />
          </LiveContext>
        </ApiContext>
      </QueryClientProvider>
    </StrictMode>,
  );
}

void start();
