// A client of Wonderland in TypeScript: its types are generated (see docs/api/clients.md), this is what is left to write.
import createClient from "openapi-fetch";

import type { components, paths } from "./wonderland.js";

type Problem = components["schemas"]["ProblemDetails"];

function setting(name: string): string {
  const value = process.env[name];
  if (value === undefined) throw new Error(`Set ${name}.`);
  return value;
}

const baseUrl = setting("WONDERLAND_URL");
const api = createClient<paths>({ baseUrl });

const { data: token } = await api.POST("/oauth/token", {
  headers: {
    Authorization: `Basic ${btoa(`${setting("CLIENT_ID")}:${setting("CLIENT_SECRET")}`)}`,
    "Content-Type": "application/x-www-form-urlencoded",
  },
  body: { grant_type: "client_credentials" },
  bodySerializer: (body) => new URLSearchParams(body as Record<string, string>),
});
if (token === undefined) throw new Error("No token.");
api.use({
  onRequest: ({ request }) => request.headers.set("Authorization", `Bearer ${token.access_token}`),
});

/** The answer that was hoped for; whatever came instead is a problem, of one form for all operations. */
function expected<T>(answer: { data?: T; error?: Problem }): T {
  if (answer.data === undefined) throw new Error(`${answer.error?.type}: ${answer.error?.detail}`);
  return answer.data;
}

const pads = expected(await api.GET("/api/v1/pads"));
if (!("items" in pads)) throw new Error("GeoJSON comes only where `Accept` asks for it.");
for (const pad of pads.items) console.log("pad", pad.pad_id, pad.name, pad.status);

for (const { session_id, uav_id, state } of expected(await api.GET("/api/v1/sessions")).items) {
  const { verdict } = expected(await api.GET("/api/v1/sessions/{session_id}", { params: { path: { session_id } } }));
  if (verdict !== undefined) console.log("session", uav_id, state, verdict.outcome, verdict.block);
}

const wish = { uav_id: "uav-1", pad_id: "pad-1" };
const request = expected(await api.POST("/api/v1/proof-requests", { body: wish }));
console.log("request", request.uav_id, request.state);

const nobody = await api.GET("/api/v1/pads/{pad_id}", { params: { path: { pad_id: "nowhere" } } });
if (nobody.error !== undefined) console.log("problem", nobody.error.type, nobody.error.status);
