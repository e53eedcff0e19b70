// @vitest-environment happy-dom
import { afterEach, expect, it } from "vitest";
import { setReading } from "../i18n/locale";
import { Api } from "./api";

afterEach(() => setReading({ locale: "en" }));

it("asks in the language that the user reads, whatever the browser's is", async () => {
  const asked: (string | null)[] = [];
  const api = new Api("http://console.test", (request) => {
    asked.push(request.headers.get("Accept-Language"));
    return Promise.resolve(Response.json({}));
  });
  await api.client.GET("/api/v1/status");
  setReading({ locale: "fi" });
  await api.client.GET("/api/v1/status");
  expect(asked).toEqual(["en", "fi"]);
});
