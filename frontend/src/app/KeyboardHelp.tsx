import { useEffect, useRef, type ReactElement } from "react";
import { sharedTexts } from "../shared/texts";
import { ROOMS } from "./rooms";
import { appTexts, keyTexts, roomTexts } from "./texts";

const keys = (): readonly (readonly [keys: readonly string[], what: string])[] => [
  [["↑", "↓"], keyTexts("list")],
  [["j", "k"], keyTexts("next")],
  [["f"], keyTexts("show")],
  [["0"], keyTexts("all")],
  [["+", "−"], keyTexts("zoom")],
  [["Esc"], keyTexts("close")],
  ...ROOMS.map(({ key, name }) => [[key], roomTexts(name)] as const),
  [["/"], keyTexts("search")],
  [["t"], keyTexts("theme")],
  [["?"], keyTexts("help")],
];

export function KeyboardHelp({ open, onClose }: { open: boolean; onClose: () => void }): ReactElement {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (open) dialog.current?.showModal();
    else dialog.current?.close();
  }, [open]);
  return (
    <dialog ref={dialog} className="float help" aria-labelledby="help-title" onClose={onClose}>
      <h2 id="help-title">{appTexts("keys")}</h2>
      <dl>
        {keys().map(([pressed, what]) => (
          <div key={what}>
            <dt>
              {pressed.map((key) => (
                <kbd key={key}>{key}</kbd>
              ))}
            </dt>
            <dd>{what}</dd>
          </div>
        ))}
      </dl>
      <form method="dialog">
        <button className="button primary">{sharedTexts("close")}</button>
      </form>
    </dialog>
  );
}
