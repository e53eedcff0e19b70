/** The little ASN.1 that signing needs: signatures, certificate requests, private keys in their older form. */
import { base64, concat, fromBase64, utf8, type Bytes } from "./bytes";

/** The order of P-256. */
const ORDER = 0xffffffff00000000ffffffffffffffffbce6faada7179e84f3b9cac2fc632551n;
const COORDINATE_BYTES = 32;
const OID_EC_KEY = [0x2a, 0x86, 0x48, 0xce, 0x3d, 0x02, 0x01];
const OID_P256 = [0x2a, 0x86, 0x48, 0xce, 0x3d, 0x03, 0x01, 0x07];
const OID_ECDSA_SHA256 = [0x2a, 0x86, 0x48, 0xce, 0x3d, 0x04, 0x03, 0x02];
const OID_COMMON_NAME = [0x55, 0x04, 0x03];

/** One element: tag, length, content. */
function element(tag: number, ...content: readonly Uint8Array[]): Bytes {
  const body = concat(...content);
  const length: number[] = [];
  if (body.length < 0x80) length.push(body.length);
  else {
    const digits: number[] = [];
    for (let rest = body.length; rest > 0; rest = Math.floor(rest / 256)) digits.unshift(rest % 256);
    length.push(0x80 | digits.length, ...digits);
  }
  return concat(Uint8Array.of(tag, ...length), body);
}

function oid(content: readonly number[]): Bytes {
  return element(0x06, Uint8Array.from(content));
}

function integer(value: bigint): Bytes {
  let digits = value.toString(16);
  if (digits.length % 2 === 1) digits = `0${digits}`;
  const bytes = Uint8Array.from(digits.match(/../g) ?? [], (pair) => parseInt(pair, 16));
  // A number whose first bit is set would read as a negative one.
  return element(0x02, (bytes[0] ?? 0) >= 0x80 ? concat(Uint8Array.of(0), bytes) : bytes);
}

function number(bytes: Uint8Array): bigint {
  return bytes.reduce((sum, byte) => (sum << 8n) | BigInt(byte), 0n);
}

/** r ‖ s as WebCrypto makes it → DER with the low s: Fabric refuses the other twin. */
export function derSignature(raw: Uint8Array): Bytes {
  if (raw.length !== 2 * COORDINATE_BYTES) throw new RangeError(`a P-256 signature has 64 bytes, not ${raw.length}`);
  const r = number(raw.subarray(0, COORDINATE_BYTES));
  const s = number(raw.subarray(COORDINATE_BYTES));
  if (r === 0n || s === 0n || r >= ORDER || s >= ORDER) throw new RangeError("numbers of a P-256 signature are in 1 … n−1");
  return element(0x30, integer(r), integer(s > ORDER / 2n ? ORDER - s : s));
}

type Sign = (message: Bytes) => Promise<Bytes>;

/** A certificate request (PKCS#10, PEM) for a name and a public key (SubjectPublicKeyInfo), signed by that key. */
export async function certificateRequest(name: string, publicKey: Uint8Array, sign: Sign): Promise<string> {
  const subject = element(0x30, element(0x31, element(0x30, oid(OID_COMMON_NAME), element(0x0c, utf8(name)))));
  const info = element(0x30, integer0(), subject, publicKey, element(0xa0));
  const signature = await sign(info);
  const algorithm = element(0x30, oid(OID_ECDSA_SHA256));
  return pem("CERTIFICATE REQUEST", element(0x30, info, algorithm, element(0x03, Uint8Array.of(0), signature)));
}

function integer0(): Bytes {
  return element(0x02, Uint8Array.of(0));
}

/** An EC private key in its older form (SEC 1) as PKCS#8, which browsers read. */
export function pkcs8OfSec1(key: Uint8Array): Bytes {
  return element(0x30, integer0(), element(0x30, oid(OID_EC_KEY), oid(OID_P256)), element(0x04, key));
}

export function pem(label: string, der: Uint8Array): string {
  const lines = base64(der).match(/.{1,64}/g) ?? [];
  return [`-----BEGIN ${label}-----`, ...lines, `-----END ${label}-----`, ""].join("\n");
}

/** The first block of that label in a PEM text; undefined where there is none that can be read. */
export function fromPem(label: string, text: string): Bytes | undefined {
  const found = new RegExp(`-----BEGIN ${label}-----([A-Za-z0-9+/=\\s]+)-----END ${label}-----`).exec(text);
  if (found?.[1] === undefined) return undefined;
  try {
    return fromBase64(found[1].replace(/\s+/g, ""));
  } catch {
    return undefined;
  }
}
