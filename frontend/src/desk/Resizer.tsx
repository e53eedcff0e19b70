import { useEffect, useState, type KeyboardEvent, type PointerEvent, type ReactElement } from "react";
import { deskTexts as t } from "./texts";

type Properties = {
  side: "left" | "right";
  name: "list" | "proof";
  /** The CSS custom property that holds the panel's width. */
  property: "--list-width" | "--panel-width";
  initial: number;
  least: number;
  most: number;
};

const STEP = 16;

function stored(key: string, initial: number): number {
  try {
    return Number(localStorage.getItem(key)) || initial;
  } catch {
    return initial;
  }
}

/** The edge of a panel, to be dragged or moved with the arrow keys; its width is remembered. */
export function Resizer({ side, name, property, initial, least, most }: Properties): ReactElement {
  const key = `wonderland.${property.slice(2)}`;
  const [width, setWidth] = useState(() => stored(key, initial));
  useEffect(() => {
    document.documentElement.style.setProperty(property, `${width}px`);
    try {
      localStorage.setItem(key, String(width));
    } catch {
      // It holds until the page is closed.
    }
  }, [key, property, width]);
  const bounded = (next: number): number => Math.round(Math.min(most, Math.max(least, next)));
  const onPointerDown = (down: PointerEvent<HTMLElement>): void => {
    const grip = down.currentTarget;
    const from = down.clientX;
    grip.setPointerCapture(down.pointerId);
    const move = (event: globalThis.PointerEvent): void => {
      const by = (event.clientX - from) * (side === "right" ? 1 : -1);
      setWidth(bounded(width + by));
    };
    const up = (): void => {
      grip.removeEventListener("pointermove", move);
      grip.removeEventListener("pointerup", up);
    };
    grip.addEventListener("pointermove", move);
    grip.addEventListener("pointerup", up);
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    const towards = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (towards === undefined) return;
    event.preventDefault();
    setWidth(bounded(width + towards * STEP * (side === "right" ? 1 : -1)));
  };
  return (
    // A separator that has a value and takes the focus is a control (ARIA 1.2), which this rule does not know.
    // eslint-disable-next-line jsx-a11y/no-noninteractive-element-interactions
    <div
      className={`resizer resizer-${side}`}
      role="separator"
      aria-orientation="vertical"
      aria-label={t("width", { what: name })}
      aria-valuenow={width}
      aria-valuemin={least}
      aria-valuemax={most}
      // eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex -- see above
      tabIndex={0}
      onPointerDown={onPointerDown}
      onKeyDown={onKeyDown}
      onDoubleClick={() => setWidth(initial)}
    />
  );
}
