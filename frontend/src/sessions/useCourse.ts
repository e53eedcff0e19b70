import { useQuery, type UseQueryResult } from "@tanstack/react-query";
import { useApi } from "../shared/api/api";
import type { Course } from "../shared/api/records";

/** How a decided session's verdict came about: it never changes, and one answer serves every card that shows it. */
export function useCourse(session_id: string): UseQueryResult<Course> {
  const api = useApi();
  return useQuery({ queryKey: ["course", session_id], queryFn: () => api.course(session_id), staleTime: Infinity, retry: false });
}
