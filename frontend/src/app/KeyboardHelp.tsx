import { useEffect, useRef, type ReactElement } from "react";
import { sharedTexts } from "../shared/texts";
import { ROOMS } from "./rooms";
import { roomTexts } from "../shared/roomTexts";
import { keyTexts, replayKeyTexts } from "./keyTexts";
import { appTexts } from "./texts";

type Key = readonly [keys: readonly string[], what: string];

const keys = (): readonly Key[] => [
  [["↑", "↓"], keyTexts("list")],
  [["j", "k"], keyTexts("next")],
  [["f"], keyTexts("show")],
  [["0"], keyTexts("all")],
  [["+", "−"], keyTexts("zoom")],
  [["3"], keyTexts("deep")],
  [["b"], keyTexts("imagery")],
  [["[", "]"], keyTexts("turn")],
  [["c"], keyTexts("follow")],
  [["m"], keyTexts("measure")],
  [["n"], keyTexts("networked")],
  [["x"], keyTexts("table")],
  [["w"], keyTexts("wall")],
  [["Esc"], keyTexts("close")],
  ...ROOMS.map(({ key, name }) => [[key], roomTexts(name)] as const),
  [["/"], keyTexts("search")],
  [["t"], keyTexts("theme")],
  [["?"], keyTexts("help")],
];

/** In the replay room some keys mean something else. */
const replayKeys = (): readonly Key[] => [
  [[replayKeyTexts("space"), "k"], replayKeyTexts("play")],
  [["j", "l"], replayKeyTexts("speed")],
  [["←", "→"], replayKeyTexts("tens")],
  [[",", "."], replayKeyTexts("ones")],
  [["p", "n"], replayKeyTexts("refusals")],
  [["f"], keyTexts("show")],
  [["0"], keyTexts("all")],
  [["+", "−"], keyTexts("zoom")],
  [["c"], keyTexts("follow")],
  [["m"], keyTexts("measure")],
  [["x"], keyTexts("table")],
  [["Esc"], replayKeyTexts("close")],
];

function Keys({ keys: shown }: { keys: readonly Key[] }): ReactElement {
  return (
    <dl>
      {shown.map(([pressed, what]) => (
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
  );
}

export function KeyboardHelp({ open, onClose }: { open: boolean; onClose: () => void }): ReactElement {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (open) dialog.current?.showModal();
    else dialog.current?.close();
  }, [open]);
  return (
    <dialog ref={dialog} className="float help" aria-labelledby="help-title" onClose={onClose}>
      <h2 id="help-title">{appTexts("keys")}</h2>
      <div className="help-columns">
        <Keys keys={keys()} />
        <section aria-labelledby="help-replay">
          <h3 id="help-replay">{replayKeyTexts("title")}</h3>
          <Keys keys={replayKeys()} />
        </section>
      </div>
      <form method="dialog">
        <button className="button primary">{sharedTexts("close")}</button>
      </form>
    </dialog>
  );
}
