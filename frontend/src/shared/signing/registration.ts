/** The commitment to an operator's registration number, as libraries/core/wonderland/proofs/registration.py has it. */
import { hex, sha256 } from "./bytes";
import { canonical } from "./canonical";

const SALT_BYTES = 32;

/** From the browser's generator of secrets: it is all that keeps a number secret from whoever tries them all. */
export function newSalt(): string {
  return hex(crypto.getRandomValues(new Uint8Array(SALT_BYTES)));
}

/** SHA-256 of the opening's canonical JSON. */
export async function commitment(uav_id: string, { registration, salt }: { registration: string; salt: string }): Promise<string> {
  return hex(await sha256(canonical({ type: "wonderland-registration-1", uav_id, registration, salt })));
}
