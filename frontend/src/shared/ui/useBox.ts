import { useCallback, useEffect, useState } from "react";

export const PHONE = "(max-width: 760px)";

type Box = { width: number; height: number };

/** The size of an element as it changes; zero while it is not there. */
export function useBox(): [(element: HTMLElement | null) => (() => void) | undefined, Box] {
  const [box, setBox] = useState<Box>({ width: 0, height: 0 });
  const observe = useCallback((element: HTMLElement | null) => {
    if (element === null) return undefined;
    const observer = new ResizeObserver(() => {
      setBox({ width: element.offsetWidth, height: element.offsetHeight });
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      setBox({ width: 0, height: 0 });
    };
  }, []);
  return [observe, box];
}

export function usePhone(): boolean {
  const [phone, setPhone] = useState(() => matchMedia(PHONE).matches);
  useEffect(() => {
    const query = matchMedia(PHONE);
    const listen = (): void => setPhone(query.matches);
    query.addEventListener("change", listen);
    return () => query.removeEventListener("change", listen);
  }, []);
  return phone;
}
