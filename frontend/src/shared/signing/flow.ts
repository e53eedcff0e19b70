/** From a change to its outcome: proposed, checked, signed, endorsed, checked, signed again, ordered, judged valid or not. */
import { answered, type Api } from "../api/api";
import type { components } from "../api/schema";
import { base64url, fromBase64url } from "./bytes";
import { canonical, type JsonObject } from "./canonical";
import { checkProposal, checkTransaction, type Intent, type Outcome } from "./inspect";
import { sign, type StoredKey } from "./keys";
import { commitment, newSalt } from "./registration";

export type SignedTransaction = components["schemas"]["SignedTransaction"];
export type SigningPlace = components["schemas"]["SigningPlace"];
export type SigningKey = components["schemas"]["SigningKey"];
export type Version = components["schemas"]["Version"];

/** What somebody wants to change. `seen`: the version of the record that is before their eyes. */
export type Change = {
  name: string;
  argument: JsonObject;
  /** RegisterUav: the operator's number. The ledger gets a commitment to it, the server what opens that. */
  registration?: string;
  seen?: Version | "nothing";
};

const POLL_MS = 250;
const SLOW_POLL_MS = 2_000;
const FINAL: ReadonlySet<SignedTransaction["state"]> = new Set(["valid", "invalid", "refused", "expired"]);

export function isFinal(transaction: SignedTransaction): boolean {
  return FINAL.has(transaction.state);
}

export function signingPlace(api: Api): Promise<SigningPlace> {
  return answered((signal) => api.client.GET("/api/v1/signing-keys", { signal }));
}

export function bringKey(api: Api, body: components["schemas"]["BringKey"]): Promise<SigningKey> {
  return answered((signal) => api.client.POST("/api/v1/signing-keys", { body, signal }));
}

export function enrolKey(api: Api, body: components["schemas"]["EnrolKey"]): Promise<SigningKey> {
  return answered((signal) => api.client.POST("/api/v1/signing-keys/enrol", { body, signal }));
}

export function demoKey(api: Api, body: components["schemas"]["DemoKey"]): Promise<SigningKey> {
  return answered((signal) => api.client.POST("/api/v1/signing-keys/demo", { body, signal }));
}

export async function endKey(api: Api, certificate_sha256: string): Promise<void> {
  await answered<unknown>((signal) =>
    api.client.DELETE("/api/v1/signing-keys/{certificate_sha256}", { params: { path: { certificate_sha256 } }, signal }),
  );
}

function propose(api: Api, body: components["schemas"]["Propose"]): Promise<SignedTransaction> {
  return answered((signal) => api.client.POST("/api/v1/transactions/proposals", { body, signal }));
}

function look(api: Api, tx_id: string): Promise<SignedTransaction> {
  return answered((signal) => api.client.GET("/api/v1/transactions/proposals/{tx_id}", { params: { path: { tx_id } }, signal }));
}

function endorse(api: Api, tx_id: string, signature: string): Promise<SignedTransaction> {
  const params = { path: { tx_id } };
  return answered((signal) => api.client.POST("/api/v1/transactions/proposals/{tx_id}/endorse", { params, body: { signature }, signal }));
}

function submit(api: Api, tx_id: string, signature: string): Promise<SignedTransaction> {
  const params = { path: { tx_id } };
  return answered((signal) => api.client.POST("/api/v1/transactions/proposals/{tx_id}/submit", { params, body: { signature }, signal }));
}

/** A change under way: `go` takes it on from where it stands, so that what failed on the way can be tried again. */
export class Signing {
  transaction: SignedTransaction | undefined;
  outcome: Outcome | undefined;
  /** What is signed: the change's, and the commitment to its number. */
  argument: JsonObject;
  private proposal: Uint8Array | undefined;
  private stopped = false;

  constructor(
    private readonly api: Api,
    private readonly key: StoredKey,
    private readonly change: Change,
    private readonly onChange: () => void,
    private readonly wait: (ms: number) => Promise<void> = (ms) => new Promise((done) => setTimeout(done, ms)),
  ) {
    this.argument = change.argument;
  }

  /** Nobody looks any more; what was submitted goes on by itself. */
  stop(): void {
    this.stopped = true;
  }

  /** To the outcome. Throws `ApiError`, `ForeignBytesError`; then it can be called again, and nothing is done twice. */
  async go(): Promise<SignedTransaction> {
    let now = this.transaction ?? (await this.proposed());
    if (now.state === "proposed") now = await this.endorsed(now);
    if (now.state === "endorsed") now = await this.submitted(now);
    while (!isFinal(now) && !this.stopped) {
      await this.wait(now.state === "unknown" ? SLOW_POLL_MS : POLL_MS);
      now = this.note(await look(this.api, now.tx_id));
    }
    return now;
  }

  private note(transaction: SignedTransaction): SignedTransaction {
    this.transaction = transaction;
    this.onChange();
    return transaction;
  }

  private async proposed(): Promise<SignedTransaction> {
    const { seen, registration } = this.change;
    const { uav_id } = this.change.argument;
    let opening: { registration: string; salt: string } | undefined;
    if (registration !== undefined && typeof uav_id === "string") {
      // A fresh salt for each attempt: one whose answer was lost may be under way.
      opening = { registration, salt: newSalt() };
      this.argument = { ...this.change.argument, registration_commitment: await commitment(uav_id, opening) };
    }
    return this.note(
      await propose(this.api, {
        function: this.change.name,
        argument: this.argument,
        ...(opening !== undefined && { opening }),
        certificate_sha256: this.key.certificate_sha256,
        ...(seen !== undefined && { seen: seen === "nothing" ? { block: -1, tx_index: 0 } : { block: seen.block, tx_index: seen.tx_index } }),
      }),
    );
  }

  private intent(tx_id: string): Intent {
    const { channel, chaincode, msp_id, certificate } = this.key;
    return { tx_id, channel, chaincode, msp_id, certificate, name: this.change.name, argument: canonical(this.argument) };
  }

  private async endorsed(transaction: SignedTransaction): Promise<SignedTransaction> {
    const proposal = fromBase64url(transaction.to_sign ?? "");
    await checkProposal(proposal, this.intent(transaction.tx_id));
    this.proposal = proposal;
    const signature = base64url(await sign(this.key.key, proposal));
    return this.note(await endorse(this.api, transaction.tx_id, signature));
  }

  private async submitted(transaction: SignedTransaction): Promise<SignedTransaction> {
    const prepared = fromBase64url(transaction.to_sign ?? "");
    this.outcome = await checkTransaction(prepared, this.proposal ?? new Uint8Array(), this.intent(transaction.tx_id));
    const signature = base64url(await sign(this.key.key, prepared));
    return this.note(await submit(this.api, transaction.tx_id, signature));
  }
}
