import { useEffect, useRef, type ReactElement } from "react";

const KEYS: readonly (readonly [keys: readonly string[], what: string])[] = [
  [["↑", "↓"], "go through the list (with the focus on it)"],
  [["j", "k"], "next and previous drone, from anywhere"],
  [["f"], "show the selected proof on the map"],
  [["0"], "show all pads"],
  [["+", "−"], "closer, further away"],
  [["Esc"], "close the proof"],
  [["l"], "Live"],
  [["s"], "Sessions"],
  [["v"], "Verdicts"],
  [["t"], "theme: light, dark, as the system"],
  [["?"], "this help"],
];

export function KeyboardHelp({ open, onClose }: { open: boolean; onClose: () => void }): ReactElement {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (open) dialog.current?.showModal();
    else dialog.current?.close();
  }, [open]);
  return (
    <dialog ref={dialog} className="float help" aria-labelledby="help-title" onClose={onClose}>
      <h2 id="help-title">Keys</h2>
      <dl>
        {KEYS.map(([keys, what]) => (
          <div key={what}>
            <dt>
              {keys.map((key) => (
                <kbd key={key}>{key}</kbd>
              ))}
            </dt>
            <dd>{what}</dd>
          </div>
        ))}
      </dl>
      <form method="dialog">
        <button className="button primary">Close</button>
      </form>
    </dialog>
  );
}
