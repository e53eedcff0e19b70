/** The browser's side of passkeys: what the server asks goes to the authenticator, its answer comes back as JSON. */
import { ApiError } from "../shared/api/api";
import { peopleTexts as t } from "./texts";

type Json = Record<string, unknown>;

/** Whether this browser, at this address, can have passkeys at all. */
export function canPasskeys(): boolean {
  return (
    typeof PublicKeyCredential !== "undefined" &&
    typeof PublicKeyCredential.parseCreationOptionsFromJSON === "function" &&
    typeof PublicKeyCredential.prototype.toJSON === "function"
  );
}

/** Whether the page is open under the name that passkeys are bound to. */
export function isSite(site: string, hostname: string = location.hostname): boolean {
  return hostname === site || hostname.endsWith(`.${site}`);
}

export async function createPasskey(options: Json): Promise<Json> {
  return asked(() =>
    navigator.credentials.create({
      publicKey: PublicKeyCredential.parseCreationOptionsFromJSON(options as unknown as PublicKeyCredentialCreationOptionsJSON),
    }),
  );
}

export async function getPasskey(options: Json): Promise<Json> {
  return asked(() =>
    navigator.credentials.get({
      publicKey: PublicKeyCredential.parseRequestOptionsFromJSON(options as unknown as PublicKeyCredentialRequestOptionsJSON),
    }),
  );
}

async function asked(ask: () => Promise<Credential | null>): Promise<Json> {
  if (!canPasskeys()) throw new ApiError(t("noPasskeys"), 400);
  let credential: Credential | null;
  try {
    credential = await ask();
  } catch (cause) {
    const name = cause instanceof DOMException ? cause.name : "";
    throw new ApiError(t("passkeyProblem", { name }), 400);
  }
  if (!(credential instanceof PublicKeyCredential)) throw new ApiError(t("passkeyProblem", { name: "" }), 400);
  return { ...(credential.toJSON() as object) };
}
