import { useEffect } from "react";

/**
 * Fetches again when the live connection brought something newer than what was there when it was last fetched.
 *
 * Invalidating would not do: what changes while the very first answer is on its way would be missed. `mark` names the
 * newest; each fetch notes it in `fetched` as it begins.
 */
export function useFresh(
  mark: string,
  query: { isFetching: boolean; isError: boolean; refetch: () => unknown },
  fetched: { readonly current: string | undefined },
): void {
  const { isFetching, isError, refetch } = query;
  useEffect(() => {
    if (!isFetching && !isError && fetched.current !== undefined && fetched.current !== mark) void refetch();
  }, [mark, isFetching, isError, refetch, fetched]);
}
