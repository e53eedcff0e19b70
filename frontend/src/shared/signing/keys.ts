/**
 * Keys of people, in this browser. The private key is made (or imported) so that no script can read it again: it can
 * sign, and nothing else. It lives in IndexedDB and never leaves the browser.
 */
import { certificateRequest, derSignature, fromPem, pem, pkcs8OfSec1 } from "./der";
import { hex, sha256, type Bytes } from "./bytes";

const DATABASE = "wonderland-signing";
const STORE = "keys";
const ALGORITHM = { name: "ECDSA", namedCurve: "P-256" } as const;
const SIGNATURE = { name: "ECDSA", hash: "SHA-256" } as const;

/** A key with its certificate. `person_id`: several people may use one browser. */
export type StoredKey = {
  certificate_sha256: string;
  person_id: string;
  certificate: string;
  msp_id: string;
  name: string;
  role: string;
  channel: string;
  chaincode: string;
  key: CryptoKey;
};

/** Why this browser cannot keep or use a key; shown as it is. */
export class KeyError extends Error {
  override readonly name = "KeyError";

  constructor(readonly reason: "insecure" | "storage" | "certificate" | "key" | "encrypted" | "pair") {
    super(reason);
  }
}

function subtle(): SubtleCrypto {
  // Browsers give cryptography to pages by https or of this machine only.
  if (!isSecureContext || (crypto.subtle as SubtleCrypto | undefined) === undefined) throw new KeyError("insecure");
  return crypto.subtle;
}

function opened(): Promise<IDBDatabase> {
  return new Promise((resolve, reject) => {
    const request = indexedDB.open(DATABASE, 1);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE, { keyPath: "certificate_sha256" });
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(new KeyError("storage"));
    request.onblocked = () => reject(new KeyError("storage"));
  });
}

async function stored<T>(mode: IDBTransactionMode, work: (store: IDBObjectStore) => IDBRequest<T>): Promise<T> {
  const database = await opened();
  try {
    return await new Promise((resolve, reject) => {
      const transaction = database.transaction(STORE, mode);
      const request = work(transaction.objectStore(STORE));
      transaction.oncomplete = () => resolve(request.result);
      transaction.onabort = () => reject(new KeyError("storage"));
      transaction.onerror = () => reject(new KeyError("storage"));
    });
  } finally {
    database.close();
  }
}

export async function keysOf(person_id: string): Promise<StoredKey[]> {
  const all = (await stored("readonly", (store) => store.getAll())) as StoredKey[];
  return all.filter((each) => each.person_id === person_id);
}

export async function keep(key: StoredKey): Promise<void> {
  await stored("readwrite", (store) => store.put(key));
}

export async function forget(certificate_sha256: string): Promise<void> {
  await stored("readwrite", (store) => store.delete(certificate_sha256));
}

/** A new key: its private half for signing only, never to be read. */
export function newKey(): Promise<CryptoKeyPair> {
  return subtle().generateKey(ALGORITHM, false, ["sign", "verify"]);
}

/** A signature as the ledger takes it: DER, low s, over SHA-256. */
export async function sign(key: CryptoKey, message: Bytes): Promise<Bytes> {
  return derSignature(new Uint8Array(await subtle().sign(SIGNATURE, key, message)));
}

/** A certificate request for a name, PEM. */
export async function requestFor(name: string, pair: CryptoKeyPair): Promise<string> {
  const publicKey = new Uint8Array(await subtle().exportKey("spki", pair.publicKey));
  return certificateRequest(name, publicKey, (message) => sign(pair.privateKey, message));
}

/** A certificate and its key from PEM texts; the key cannot be read again. Throws `KeyError`. */
export async function imported(certificatePem: string, keyPem: string): Promise<{ certificate: string; sha256: string; key: CryptoKey }> {
  const der = fromPem("CERTIFICATE", certificatePem);
  if (der === undefined) throw new KeyError("certificate");
  if (keyPem.includes("ENCRYPTED")) throw new KeyError("encrypted");
  const sec1 = fromPem("EC PRIVATE KEY", keyPem);
  const pkcs8 = sec1 === undefined ? fromPem("PRIVATE KEY", keyPem) : pkcs8OfSec1(sec1);
  if (pkcs8 === undefined) throw new KeyError("key");
  let key: CryptoKey;
  try {
    key = await subtle().importKey("pkcs8", pkcs8, ALGORITHM, false, ["sign"]);
  } catch (problem) {
    if (problem instanceof KeyError) throw problem;
    throw new KeyError("key");
  }
  return { certificate: pem("CERTIFICATE", der), sha256: hex(await sha256(der)), key };
}
