import { keepPreviousData, useInfiniteQuery } from "@tanstack/react-query";
import { useRef } from "react";
import type { Page } from "./api";
import { useFresh } from "./useFresh";

type Options = {
  /** Names the newest that the live connection brought: `mark` as it is shown, `newest` at the moment of asking. */
  fresh?: { mark: string; newest: () => string };
  /** Rows of the last question stay until the next one is answered: for filters that are typed. */
  keep?: boolean;
};

/** A list that comes in pages, and is fetched anew when the live connection knows of something newer. */
export function usePages<T>(key: readonly unknown[], fetch: (cursor: string | undefined) => Promise<Page<T>>, { fresh, keep = false }: Options = {}) {
  const fetched = useRef<string | undefined>(undefined);
  const query = useInfiniteQuery({
    queryKey: key,
    queryFn: ({ pageParam }) => {
      fetched.current = fresh?.newest();
      return fetch(pageParam);
    },
    initialPageParam: undefined as string | undefined,
    getNextPageParam: (last) => last.next ?? undefined,
    ...(keep && { placeholderData: keepPreviousData }),
  });
  useFresh(fresh?.mark ?? "", query, fetched);
  return { query, rows: query.data?.pages.flatMap(({ items }) => items) ?? [] };
}
