/// <reference types="vite/client" />

/** Whether the fake source of live data is part of this build (see vite.config.ts). */
declare const __FAKE__: boolean;

/** Addresses of the base map's GeoJSON files, made at build time (scripts/base-map.ts). */
declare module "virtual:base-map" {
  export const land50: string;
  export const land10: string;
  export const borders50: string;
  export const borders10: string;
  export const names: string;
}
