import { LiveConnection, type ConnectionEvent, type Socket } from "./connection";

/** What the page asks of the worker. */
export type Command = { kind: "start"; url: string } | { kind: "retry" } | { kind: "stop" };

type WorkerScope = {
  postMessage: (event: ConnectionEvent) => void;
  onmessage: ((event: MessageEvent<Command>) => void) | null;
};

const scope = self as unknown as WorkerScope;
let connection: LiveConnection | undefined;

function openSocket(url: string, since: string | undefined): Socket {
  const address = new URL(url);
  if (since !== undefined) address.searchParams.set("since", since);
  const web = new WebSocket(address);
  const socket: Socket = {
    onopen: null,
    onmessage: null,
    onclose: null,
    close: () => {
      web.onmessage = web.onclose = null;
      web.close();
    },
  };
  web.onopen = () => socket.onopen?.();
  web.onmessage = (message: MessageEvent<unknown>) => {
    socket.onmessage?.(typeof message.data === "string" ? message.data : "");
  };
  web.onclose = (event) => socket.onclose?.(event.code, event.reason);
  return socket;
}

scope.onmessage = ({ data: command }) => {
  switch (command.kind) {
    case "start":
      connection?.stop();
      connection = new LiveConnection({
        open: (since) => openSocket(command.url, since),
        now: () => Date.now(),
        random: () => Math.random(),
        after: (delay, callback) => {
          const timer = setTimeout(callback, delay);
          return () => clearTimeout(timer);
        },
        emit: (event) => scope.postMessage(event),
      });
      connection.start();
      break;
    case "retry":
      connection?.retryNow();
      break;
    case "stop":
      connection?.stop();
      break;
  }
};
