/** The registry's own calls. Each throws `ApiError`. */
import { answered, type Api, type Page } from "../shared/api/api";
import type { components, paths } from "../shared/api/schema";
import type { Schema } from "./schema";

/** So often an open record is fetched anew: others change it, too, above all who approves what was proposed here. */
export const RECORD_MS = 5_000;

type Schemas = components["schemas"];
export type RegistryDrone = Schemas["RegistryDrone"];
export type RegistryDroneDetail = Schemas["RegistryDroneDetail"];
export type RegistryAuthorisation = Schemas["RegistryAuthorisation"];
export type RegistryPad = Schemas["RegistryPad"];
export type RegistryPadDetail = Schemas["RegistryPadDetail"];
export type RegistryPolicy = Schemas["RegistryPolicy"];
export type RegistryChange = Schemas["RegistryChange"];
export type RegistryProposal = Schemas["RegistryProposal"];
export type RegistryOrganisation = Schemas["RegistryOrganisation"];
export type RegistryCertificate = Schemas["RegistryCertificate"];
export type Form = { function: string; roles: string[]; argument: Schema };
export type PadQueue = Schemas["PadQueue"];
type Query<Path extends keyof paths> = paths[Path] extends { get: { parameters: { query?: infer Found } } } ? NonNullable<Found> : never;
export type DroneFilters = Query<"/api/v1/registry/drones">;
export type PadFilters = Query<"/api/v1/registry/pads">;
export type CertificateFilters = Query<"/api/v1/registry/certificates">;

export function drones(api: Api, query: DroneFilters): Promise<Page<RegistryDrone>> {
  return answered((signal) => api.client.GET("/api/v1/registry/drones", { params: { query }, signal }));
}

export function drone(api: Api, uav_id: string): Promise<RegistryDroneDetail> {
  return answered((signal) => api.client.GET("/api/v1/registry/drones/{uav_id}", { params: { path: { uav_id } }, signal }));
}

export function queue(api: Api, pad_id: string): Promise<PadQueue> {
  return answered((signal) => api.client.GET("/api/v1/pads/{pad_id}/queue", { params: { path: { pad_id } }, signal }));
}

export function pads(api: Api, query: PadFilters): Promise<Page<RegistryPad>> {
  return answered((signal) => api.client.GET("/api/v1/registry/pads", { params: { query }, signal }));
}

export function pad(api: Api, pad_id: string): Promise<RegistryPadDetail> {
  return answered((signal) => api.client.GET("/api/v1/registry/pads/{pad_id}", { params: { path: { pad_id } }, signal }));
}

export async function commonPolicies(api: Api): Promise<RegistryPolicy[]> {
  const found = await answered((signal) => api.client.GET("/api/v1/registry/policies", { signal }));
  return found.policies;
}

export function history(api: Api, query: { kind: "drone" | "pad"; id: string; limit: number; cursor?: string }): Promise<Page<RegistryChange>> {
  return answered((signal) => api.client.GET("/api/v1/registry/history", { params: { query }, signal }));
}

export function proposals(api: Api, query: Query<"/api/v1/registry/proposals">): Promise<Page<RegistryProposal>> {
  return answered((signal) => api.client.GET("/api/v1/registry/proposals", { params: { query }, signal }));
}

export async function organisations(api: Api): Promise<RegistryOrganisation[]> {
  const found = await answered((signal) => api.client.GET("/api/v1/registry/organisations", { signal }));
  return found.items;
}

export function certificates(api: Api, query: CertificateFilters): Promise<Page<RegistryCertificate>> {
  return answered((signal) => api.client.GET("/api/v1/registry/certificates", { params: { query }, signal }));
}

export async function forms(api: Api): Promise<readonly Form[]> {
  const found = await answered((signal) => api.client.GET("/api/v1/registry/forms", { signal }));
  return found.items;
}
