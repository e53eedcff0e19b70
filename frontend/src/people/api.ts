/** Calls about people, sign-ins and the audit log. Each throws `ApiError`. */
import { useMemo } from "react";
import { answered, useApi, type Api, type Page } from "../shared/api/api";
import type { SignedIn } from "../shared/api/records";
import type { components, paths } from "../shared/api/schema";
import { createPasskey, getPasskey } from "./webauthn";

type Schemas = components["schemas"];
export type PersonDetail = Schemas["PersonDetail"];
export type PersonShown = Schemas["PersonShown"];
export type PasskeyShown = Schemas["PasskeyShown"];
export type SignInShown = Schemas["SignInShown"];
export type Invitation = Schemas["Invitation"];
export type PersonChange = Schemas["PersonChange"];
export type LinkMade = Schemas["LinkMade"];
export type LinkShown = Schemas["LinkShown"];
export type SignInMethods = Schemas["SignInMethods"];
export type AuditEntry = Schemas["AuditEntry"];
export type AuditCheck = Schemas["AuditCheck"];
export type ClientShown = Schemas["RegisteredClient"];
export type ClientRegistration = Schemas["ClientRegistration"];
export type ClientCreated = Schemas["ClientCreated"];
export type Role = PersonShown["roles"][number];
export type AuditFilters = NonNullable<paths["/api/v1/audit"]["get"]["parameters"]["query"]>;
export type MaskedField = Schemas["Unmask"]["field"];

export const ROLES = ["admin", "inspector", "pad_operator", "fleet_operator", "viewer"] as const satisfies readonly Role[];

export class PeopleApi {
  private readonly client: Api["client"];

  constructor(api: Api) {
    this.client = api.client;
  }

  signInMethods(): Promise<SignInMethods> {
    return answered((signal) => this.client.GET("/api/v1/sign-in", { signal }));
  }

  link(token: string): Promise<LinkShown> {
    return answered((signal) => this.client.POST("/api/v1/sign-in/link", { body: { token }, signal }));
  }

  async signInByPasskey(): Promise<SignedIn> {
    const { ceremony, options } = await answered((signal) => this.client.POST("/api/v1/sign-in/passkey/challenge", { signal }));
    const credential = await getPasskey(options);
    return answered((signal) => this.client.POST("/api/v1/sign-in/passkey", { body: { ceremony, credential }, signal }));
  }

  async acceptByPasskey(token: string, name: string | undefined, passkey_name: string): Promise<SignedIn> {
    const body = { token, ...(name !== undefined && { name }) };
    const { ceremony, options } = await answered((signal) => this.client.POST("/api/v1/sign-in/link/passkey/options", { body, signal }));
    const credential = await createPasskey(options);
    return answered((signal) => this.client.POST("/api/v1/sign-in/link/passkey", { body: { ceremony, credential, passkey_name }, signal }));
  }

  /** Where the browser has to go to sign in, or to accept a link, by the OpenID provider. */
  async startOidc(token?: string, name?: string): Promise<string> {
    const body = { ...(token !== undefined && { token }), ...(name !== undefined && { name }) };
    return (await answered((signal) => this.client.POST("/api/v1/sign-in/oidc", { body, signal }))).url;
  }

  me(): Promise<PersonDetail> {
    return answered((signal) => this.client.GET("/api/v1/me", { signal }));
  }

  async addPasskey(name: string): Promise<PersonDetail> {
    const { ceremony, options } = await answered((signal) => this.client.POST("/api/v1/me/passkeys/options", { signal }));
    const credential = await createPasskey(options);
    return answered((signal) => this.client.POST("/api/v1/me/passkeys", { body: { ceremony, credential, name }, signal }));
  }

  renamePasskey(credential_id: string, name: string): Promise<PersonDetail> {
    const params = { path: { credential_id } };
    return answered((signal) => this.client.PATCH("/api/v1/me/passkeys/{credential_id}", { params, body: { name }, signal }));
  }

  removePasskey(credential_id: string): Promise<PersonDetail> {
    return answered((signal) => this.client.DELETE("/api/v1/me/passkeys/{credential_id}", { params: { path: { credential_id } }, signal }));
  }

  endOwnSignIn(sign_in_id: string): Promise<PersonDetail> {
    return answered((signal) => this.client.DELETE("/api/v1/me/sign-ins/{sign_in_id}", { params: { path: { sign_in_id } }, signal }));
  }

  people(): Promise<{ items: PersonShown[] }> {
    return answered((signal) => this.client.GET("/api/v1/people", { signal }));
  }

  person(person_id: string): Promise<PersonDetail> {
    return answered((signal) => this.client.GET("/api/v1/people/{person_id}", { params: { path: { person_id } }, signal }));
  }

  invite(body: Invitation): Promise<LinkMade> {
    return answered((signal) => this.client.POST("/api/v1/people", { body, signal }));
  }

  /** Refused with status 409 where somebody else has changed the account since. */
  change(person_id: string, body: PersonChange): Promise<PersonDetail> {
    return answered((signal) => this.client.PATCH("/api/v1/people/{person_id}", { params: { path: { person_id } }, body, signal }));
  }

  async withdraw(person_id: string): Promise<void> {
    await answered<unknown>((signal) => this.client.DELETE("/api/v1/people/{person_id}", { params: { path: { person_id } }, signal }));
  }

  newLink(person_id: string): Promise<LinkMade> {
    return answered((signal) => this.client.POST("/api/v1/people/{person_id}/link", { params: { path: { person_id } }, signal }));
  }

  endSignIn(person_id: string, sign_in_id: string): Promise<PersonDetail> {
    const params = { path: { person_id, sign_in_id } };
    return answered((signal) => this.client.DELETE("/api/v1/people/{person_id}/sign-ins/{sign_in_id}", { params, signal }));
  }

  clients(query: { limit: number; cursor?: string }): Promise<Page<ClientShown>> {
    return answered((signal) => this.client.GET("/api/v1/clients", { params: { query }, signal }));
  }

  addClient(body: ClientRegistration): Promise<ClientCreated> {
    return answered((signal) => this.client.POST("/api/v1/clients", { body, signal }));
  }

  disableClient(client_id: string): Promise<ClientShown> {
    return answered((signal) => this.client.DELETE("/api/v1/clients/{client_id}", { params: { path: { client_id } }, signal }));
  }

  /** Every scope that a machine may be given. */
  async clientScopes(): Promise<string[]> {
    const about: unknown = await answered((signal) => this.client.GET("/.well-known/oauth-authorization-server", { signal }));
    const found = (about as { scopes_supported?: unknown }).scopes_supported;
    return Array.isArray(found) ? found.map(String) : [];
  }

  audit(query: AuditFilters): Promise<Page<AuditEntry>> {
    return answered((signal) => this.client.GET("/api/v1/audit", { params: { query }, signal }));
  }

  verifyAudit(): Promise<AuditCheck> {
    return answered((signal) => this.client.GET("/api/v1/audit/verify", { signal }));
  }

  /** A number that is masked everywhere else, and how long it may stand on the screen. */
  unmask(uav_id: string, field: MaskedField, reason: string): Promise<{ value: string; show_ms: number }> {
    return answered((signal) => this.client.POST("/api/v1/unmask", { body: { uav_id, field, reason }, signal }));
  }
}

export function usePeopleApi(): PeopleApi {
  const api = useApi();
  return useMemo(() => new PeopleApi(api), [api]);
}
