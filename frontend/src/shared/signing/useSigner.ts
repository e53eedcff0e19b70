import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, useSyncExternalStore } from "react";
import { useApi } from "../api/api";
import type { SignedIn } from "../api/records";
import { signingPlace, type SigningKey, type SigningPlace } from "./flow";
import { keysOf, type StoredKey } from "./keys";

const CHOICE = "wonderland.signing";
const listeners = new Set<() => void>();

function chosen(): string | null {
  try {
    return localStorage.getItem(CHOICE);
  } catch {
    return null;
  }
}

/** Sign with this key from now on, in this browser. */
export function choose(certificate_sha256: string): void {
  try {
    localStorage.setItem(CHOICE, certificate_sha256);
  } catch {
    // The first key that can be used is taken then.
  }
  for (const listener of listeners) listener();
}

export type Signer = {
  place: SigningPlace | undefined;
  person_id: string;
  /** Keys that are in this browser and on the account, and the ledger takes. */
  usable: readonly StoredKey[];
  /** Those of the account, with what the server says of them. */
  known: readonly SigningKey[];
  current: StoredKey | undefined;
  /** Why nothing can be signed here, as it is to be shown. */
  error: Error | null;
  pending: boolean;
  refresh: () => Promise<void>;
};

/** Who signs in this browser. */
export function useSigner(): Signer {
  const api = useApi();
  const client = useQueryClient();
  const who = useQuery({ queryKey: ["who"], queryFn: (): Promise<SignedIn> => api.whoAmI(), staleTime: Infinity });
  const person_id = who.data?.person_id ?? "";
  const place = useQuery({ queryKey: ["signing-place"], queryFn: () => signingPlace(api), retry: false });
  const stored = useQuery({ queryKey: ["signing-stored", person_id], queryFn: () => keysOf(person_id), retry: false });
  const choice = useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    chosen,
  );
  const known = place.data?.keys ?? [];
  const good = new Set(known.filter(({ usable }) => usable).map(({ certificate_sha256 }) => certificate_sha256));
  const usable = (stored.data ?? []).filter(({ certificate_sha256 }) => good.has(certificate_sha256));
  const refresh = useCallback(async () => {
    await client.invalidateQueries({ queryKey: ["signing-place"] });
    await client.invalidateQueries({ queryKey: ["signing-stored"] });
  }, [client]);
  return {
    place: place.data,
    person_id,
    usable,
    known,
    current: usable.find(({ certificate_sha256 }) => certificate_sha256 === choice) ?? usable[0],
    error: place.error ?? stored.error,
    pending: place.isPending || stored.isPending,
    refresh,
  };
}
