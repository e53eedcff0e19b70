import type { ConnectionEvent } from "./connection";
import type { Command } from "./worker";

/** Where live events come from: the worker with the WebSocket, or the fake of development and tests. */
export type LiveSource = {
  start: (receive: (event: ConnectionEvent) => void) => void;
  retry: () => void;
  stop: () => void;
};

/** The live WebSocket, in a worker of its own so that a busy page neither delays nor drops it. */
export function workerSource(address: string): LiveSource {
  let worker: Worker | undefined;
  const send = (command: Command): void => worker?.postMessage(command);
  return {
    start(receive) {
      worker = new Worker(new URL("./worker.ts", import.meta.url), { type: "module", name: "live" });
      worker.onmessage = (event: MessageEvent<ConnectionEvent>) => receive(event.data);
      const url = new URL(address);
      url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
      send({ kind: "start", url: url.href });
    },
    retry: () => send({ kind: "retry" }),
    stop: () => {
      send({ kind: "stop" });
      worker?.terminate();
      worker = undefined;
    },
  };
}
