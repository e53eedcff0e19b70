import type { ReactElement } from "react";
import { sharedTexts as t } from "../texts";

type Query = {
  isPending: boolean;
  isError: boolean;
  error: Error | null;
  hasNextPage: boolean;
  isFetchingNextPage: boolean;
  fetchNextPage: () => unknown;
  refetch: () => unknown;
};

/** The foot of a table that comes in pages: what went wrong, that there is nothing, or the next page. */
export function More({ query, empty, count }: { query: Query; empty: string; count: number }): ReactElement | null {
  if (query.isError) {
    return (
      <p className="empty" role="alert">
        {query.error?.message}{" "}
        <button type="button" className="button" onClick={() => void query.refetch()}>
          {t("tryAgain")}
        </button>
      </p>
    );
  }
  if (query.isPending) return <p className="empty">{t("fetching")}</p>;
  if (count === 0) return <p className="empty">{empty}</p>;
  if (!query.hasNextPage) return null;
  return (
    <p className="more">
      <button type="button" className="button" disabled={query.isFetchingNextPage} onClick={() => void query.fetchNextPage()}>
        {query.isFetchingNextPage ? t("fetching") : t("older")}
      </button>
    </p>
  );
}
