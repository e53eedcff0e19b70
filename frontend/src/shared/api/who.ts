import { useQueryClient } from "@tanstack/react-query";
import type { SignedIn } from "./records";

/** Who is signed in, as the frame around the rooms knows it. */
export function usePerson(): SignedIn | undefined {
  return useQueryClient().getQueryData<SignedIn>(["who"]);
}

/** Whether that is somebody of the authority, who may read personal data. */
export function useOfficer(): boolean {
  const roles = usePerson()?.roles ?? [];
  return roles.includes("admin") || roles.includes("inspector");
}
