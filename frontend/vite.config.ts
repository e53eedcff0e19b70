import { fileURLToPath } from "node:url";
import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";
import { baseMap } from "./scripts/base-map.ts";
import { compress } from "./scripts/compress.ts";

/** The fake source of live data is for designing and testing: it exists in `--mode fake` and in the dev server only. */
export default defineConfig(({ mode, command }) => ({
  resolve: { alias: { "@messages": fileURLToPath(new URL("../libraries/core/wonderland/messages", import.meta.url)) } },
  plugins: [react(), baseMap(), mode === "fake" ? undefined : compress()],
  define: {
    __FAKE__: JSON.stringify(mode === "fake" || mode === "test" || command === "serve"),
  },
  // The server gives the page at every address that is no file (main.tsx): its assets are named from the root.
  base: "/",
  build: {
    target: "es2022",
    outDir: mode === "fake" ? "dist-fake" : "dist",
    chunkSizeWarningLimit: 1500,
    // Fonts and images stay files of their own, so that a strict content security policy needs no data: sources.
    assetsInlineLimit: 0,
  },
  worker: { format: "es" },
  server: {
    host: "127.0.0.1",
    proxy: {
      "/api": { target: process.env.WONDERLAND_BACKEND ?? "http://127.0.0.1:8000", ws: true },
    },
  },
  test: {
    environment: "node",
    include: ["src/**/*.test.{ts,tsx}"],
    restoreMocks: true,
    css: true,
  },
}));
