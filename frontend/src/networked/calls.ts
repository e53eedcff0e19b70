/** Networked flights' own calls. Each throws `ApiError`. */
import { answered, type Api } from "../shared/api/api";
import type { components } from "../shared/api/schema";

type Schemas = components["schemas"];
export type Flight = Schemas["NetworkedFlight"];
export type FlightDetails = Schemas["NetworkedFlightDetails"];
export type Flights = Schemas["NetworkedFlights"];
/** West, south, east, north in degrees. */
export type Bounds = readonly [west: number, south: number, east: number, north: number];

/** `view` as F3411 writes it: lat1,lng1,lat2,lng2. */
export function viewOf([west, south, east, north]: Bounds): string {
  return [south, west, north, east].map((each) => each.toFixed(5)).join(",");
}

export function networkedFlights(api: Api, bounds: Bounds): Promise<Flights> {
  return answered((signal) => api.client.GET("/api/v1/networked-flights", { params: { query: { view: viewOf(bounds) } }, signal }));
}

/** Who flies; that it was asked is recorded. */
export function flightDetails(api: Api, flight_id: string): Promise<FlightDetails> {
  return answered((signal) => api.client.GET("/api/v1/networked-flights/{flight_id}", { params: { path: { flight_id } }, signal }));
}
