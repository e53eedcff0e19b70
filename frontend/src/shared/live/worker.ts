import { TrackPacker, buffersOf } from "./columns";
import { LiveConnection, type ConnectionEvent, type Socket } from "./connection";
import { FramesInOrder } from "./unpacking";

/** What the page asks of the worker. */
export type Command = { kind: "start"; url: string } | { kind: "retry" } | { kind: "stop" };

type WorkerScope = {
  postMessage: (event: ConnectionEvent, transfer: Transferable[]) => void;
  onmessage: ((event: MessageEvent<Command>) => void) | null;
};

/** Close code of RFC 6455 for data that is not what it should be. */
const UNREADABLE = 1007;

const scope = self as unknown as WorkerScope;
const packer = new TrackPacker();
let connection: LiveConnection | undefined;

/** Positions leave as columns, without a copy: the page must not spend its frames on taking objects apart. */
function hand(event: ConnectionEvent): void {
  if (event.kind === "frame" && event.frame.type === "hello" && !event.frame.resumed) packer.reset();
  if (event.kind !== "frame" || event.frame.type === "hello" || event.frame.tracks === undefined) {
    scope.postMessage(event, []);
    return;
  }
  const { tracks, ...frame } = event.frame;
  const columns = packer.pack(tracks);
  scope.postMessage({ ...event, frame, columns }, buffersOf(columns));
}

function openSocket(url: string, since: string | undefined): Socket {
  const address = new URL(url);
  if (since !== undefined) address.searchParams.set("since", since);
  address.searchParams.set("packed", "zlib");
  const web = new WebSocket(address);
  web.binaryType = "arraybuffer";
  const frames = new FramesInOrder(
    (text) => socket.onmessage?.(text),
    () => {
      socket.onclose?.(UNREADABLE, "a frame could not be unpacked");
      web.close();
    },
  );
  const socket: Socket = {
    onopen: null,
    onmessage: null,
    onclose: null,
    close: () => {
      frames.end();
      web.onmessage = web.onclose = null;
      web.close();
    },
  };
  web.onopen = () => socket.onopen?.();
  web.onmessage = (message: MessageEvent<unknown>) => frames.take(message.data);
  web.onclose = (event) => frames.afterAll(() => socket.onclose?.(event.code, event.reason));
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
        emit: hand,
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
