/** The three ways to a key: a one-time secret, a certificate that is brought along, and the demo's click. */
import type { Api } from "../api/api";
import { base64url, hex } from "./bytes";
import { canonical } from "./canonical";
import { bringKey, demoKey, enrolKey, type SigningKey, type SigningPlace } from "./flow";
import { imported, keep, KeyError, newKey, requestFor, sign, type StoredKey } from "./keys";
import { choose } from "./useSigner";

const PURPOSE = "wonderland-signing-key";

type Where = { api: Api; place: SigningPlace; person_id: string };

async function kept({ place, person_id }: Where, key: CryptoKey, bound: SigningKey): Promise<StoredKey> {
  const { certificate_sha256, certificate, msp_id, name, role } = bound;
  const { channel, chaincode } = place;
  const stored = { certificate_sha256, person_id, certificate, msp_id, name, role, channel, chaincode, key };
  await keep(stored);
  choose(certificate_sha256);
  return stored;
}

/** Throws `ApiError`, `KeyError`. */
export async function enrol(where: Where, msp_id: string, name: string, secret: string): Promise<StoredKey> {
  const pair = await newKey();
  const request = await requestFor(name, pair);
  return kept(where, pair.privateKey, await enrolKey(where.api, { msp_id, request, secret }));
}

/** Throws `ApiError`, `KeyError`. */
export async function enrolInDemo(where: Where, role: string): Promise<StoredKey> {
  const pair = await newKey();
  const name = `demo-${role.replace("_", "-")}-${hex(crypto.getRandomValues(new Uint8Array(4)))}`;
  return kept(where, pair.privateKey, await demoKey(where.api, { role, request: await requestFor(name, pair) }));
}

/** Throws `ApiError`, `KeyError`. */
export async function bring(where: Where, msp_id: string, certificatePem: string, keyPem: string): Promise<StoredKey> {
  const { certificate, sha256, key } = await imported(certificatePem, keyPem);
  const text = canonical({ purpose: PURPOSE, challenge: where.place.challenge, certificate_sha256: sha256 });
  const signature = base64url(await sign(key, text));
  const bound = await bringKey(where.api, { msp_id, certificate, signature });
  if (bound.certificate_sha256 !== sha256) throw new KeyError("pair");
  return kept(where, key, bound);
}
