import type { Alert, Estimate, Pad, SessionSummary, Status, VerdictSummary } from "../api/records";
import type { TrackColumns } from "./columns";
import type { ConnectionEvent, ConnectionState } from "./connection";
import type { Changes, LiveFrame } from "./protocol";
import { TrackTable } from "./tracks";

/** What can change; a subscriber names what it wants to hear of. */
export type Topic = "tracks" | "estimates" | "sessions" | "verdicts" | "pads" | "alerts" | "status" | "connection";

/** A drone unheard for this long is no longer kept; the server's snapshot goes as far back. */
export const TRACK_AGE_MS = 10 * 60_000;
/** A hiccup shorter than this is not worth a word. */
const PATIENCE_MS = 1_500;
const FORGET_EVERY_MS = 30_000;
export const MAX_VERDICTS = 5_000;
export const MAX_SESSIONS = 2_000;

type Listener = (topics: ReadonlySet<Topic>) => void;

/**
 * All that is known live, free of any UI framework: the map reads it at each tick, React through `useLive`.
 *
 * Tracks and estimates are the latest of each drone; sessions and verdicts are all of them, newest first, bounded.
 * What feeds it (the socket's worker, a recording, a script) calls `receive`.
 */
export class LiveStore {
  readonly tracks = new TrackTable();
  readonly estimates = new Map<string, Estimate>();
  readonly sessions = new Map<string, SessionSummary>();
  /** By session. */
  readonly verdicts = new Map<string, VerdictSummary>();
  readonly pads = new Map<string, Pad>();
  /** Those that are open or returned, by id; what is acknowledged or over is in REST. */
  readonly alerts = new Map<string, Alert>();
  /** More are open than the server sends. */
  moreAlerts = false;
  status: Status | undefined;
  connection: ConnectionState = { phase: "connecting", attempt: 1 };
  /** When the last frame came, by this machine's clock; undefined before the first. */
  lastFrame_ms: number | undefined;
  /** How much later than the least delayed frame the last one came: more than a moment where the way here is congested. */
  delay_ms = 0;
  /** The first snapshot has come in whole: what is empty now is empty in truth. */
  ready = false;
  /** The last hello brought a snapshot or fell behind: verdicts older than the snapshot may be missing. */
  gap = false;

  private readonly listeners = new Map<Listener, ReadonlySet<Topic>>();
  private verdictList: VerdictSummary[] | undefined;
  private sessionList: SessionSummary[] | undefined;
  private clockOffset_ms: number | undefined;
  private snapshotParts = 0;
  private seen = new Set<string>();
  private forgotten_ms = 0;

  /** `now_ms`: the time of the picture where it is not now (a recording's); else the server's clock is learned. */
  constructor(private readonly pictureNow_ms?: () => number) {}

  /** Calls back after each change of one of these topics; returns the end of it. */
  subscribe(topics: readonly Topic[], listener: Listener): () => void {
    // The same function may subscribe twice (React's strict mode does): each subscription is its own.
    const own: Listener = (changed) => listener(changed);
    this.listeners.set(own, new Set(topics));
    return () => this.listeners.delete(own);
  }

  /** The server's clock, as well as the frames allow to know it. */
  serverNow_ms(local_ms: number = Date.now()): number {
    return this.pictureNow_ms?.() ?? local_ms + (this.clockOffset_ms ?? 0);
  }

  /** Whether the picture is old because there is no connection: neither a first try nor a hiccup. */
  isCutOff(local_ms: number = Date.now()): boolean {
    const { connection, lastFrame_ms } = this;
    if (connection.phase !== "waiting" && connection.phase !== "connecting") return false;
    if (lastFrame_ms === undefined) return connection.phase === "waiting" || connection.attempt > 1;
    return local_ms - lastFrame_ms > PATIENCE_MS;
  }

  /** Newest first. */
  verdictsByTime(): readonly VerdictSummary[] {
    this.verdictList ??= [...this.verdicts.values()].sort(
      (a, b) => b.decided_ms - a.decided_ms || b.block - a.block || b.tx_index - a.tx_index,
    );
    return this.verdictList;
  }

  /** Newest first. */
  sessionsByTime(): readonly SessionSummary[] {
    this.sessionList ??= [...this.sessions.values()].sort((a, b) => b.requested_ms - a.requested_ms);
    return this.sessionList;
  }

  receive(event: ConnectionEvent): void {
    const changed = new Set<Topic>();
    switch (event.kind) {
      case "state":
        this.connection = event.state;
        changed.add("connection");
        break;
      case "fell-behind":
        this.gap = true;
        changed.add("connection");
        break;
      case "frame":
        this.lastFrame_ms = event.received_ms;
        this.apply(event.frame, event.columns, event.received_ms, changed);
        break;
    }
    this.notify(changed);
  }

  /** Adds records that REST brought (the last hour's verdicts, a gap filled). */
  merge(changes: Changes): void {
    const changed = new Set<Topic>();
    this.take(changes, changed);
    this.notify(changed);
  }

  gapFilled(): void {
    this.gap = false;
  }

  /** Forgets everything, before a recording goes on from another time. Subscribers stay. */
  clear(): void {
    this.tracks.clear();
    for (const map of [this.estimates, this.sessions, this.verdicts, this.pads, this.alerts]) map.clear();
    this.verdictList = this.sessionList = this.status = this.clockOffset_ms = undefined;
    this.ready = false;
    this.notify(new Set(["tracks", "estimates", "sessions", "verdicts", "pads", "alerts", "status", "connection"]));
  }

  private apply(frame: LiveFrame, columns: TrackColumns | undefined, received_ms: number, changed: Set<Topic>): void {
    if (frame.type === "hello") {
      this.learnClock(frame.t_ms, received_ms);
      if (!frame.resumed) {
        this.snapshotParts = 0;
        this.seen = new Set();
        this.gap = true;
        // Sessions and verdicts are on the ledger and stay; positions are only as good as the connection was.
        this.estimates.clear();
        // The snapshot has every open alert; one that was dealt with meanwhile must not stand here for ever.
        this.alerts.clear();
        this.moreAlerts = false;
        changed.add("estimates").add("alerts");
      }
      changed.add("connection");
      return;
    }
    if (frame.type === "delta") {
      this.learnClock(frame.t_ms, received_ms);
      this.forgetTracks(frame.t_ms, changed);
    }
    if (columns !== undefined) {
      this.tracks.take(columns);
      changed.add("tracks");
    }
    this.take(frame, changed);
    if (frame.type === "snapshot") {
      this.snapshotParts += 1;
      if (frame.alerts_more === true) this.moreAlerts = true;
      for (const track of frame.tracks ?? []) this.seen.add(track.uav_id);
      // The numbering begins anew with the snapshot: until it is complete, every name in it is new.
      for (const name of columns?.names ?? []) this.seen.add(name);
      if (this.snapshotParts >= frame.of) {
        this.ready = true;
        for (const id of this.tracks.keys()) if (!this.seen.has(id)) this.tracks.delete(id);
        changed.add("tracks").add("connection");
      }
    }
  }

  /** The smallest seen difference between receipt and the server's stamp is the one least delayed on its way. */
  private learnClock(server_ms: number, received_ms: number): void {
    const offset = server_ms - received_ms;
    const known = this.clockOffset_ms;
    // A large step means that one of the clocks was set; then the newest is right.
    if (known === undefined || offset > known || Math.abs(offset - known) > 30_000) this.clockOffset_ms = offset;
    this.delay_ms = (this.clockOffset_ms ?? offset) - offset;
  }

  private take(changes: Changes, changed: Set<Topic>): void {
    for (const pad of changes.pads ?? []) {
      this.pads.set(pad.pad_id, pad);
      changed.add("pads");
    }
    for (const track of changes.tracks ?? []) {
      this.tracks.set(track);
      changed.add("tracks");
    }
    for (const estimate of changes.estimates ?? []) {
      this.estimates.set(estimate.uav_id, estimate);
      changed.add("estimates");
    }
    for (const session of changes.sessions ?? []) {
      this.sessions.set(session.session_id, session);
      if (session.state !== "requested" && this.estimates.get(session.uav_id)?.session_id === session.session_id) {
        this.estimates.delete(session.uav_id);
        changed.add("estimates");
      }
      changed.add("sessions");
    }
    for (const verdict of changes.verdicts ?? []) {
      this.verdicts.set(verdict.session_id, verdict);
      changed.add("verdicts");
    }
    for (const alert of changes.alerts ?? []) {
      if (alert.state === "open" || alert.state === "returned") this.alerts.set(alert.alert_id, alert);
      else this.alerts.delete(alert.alert_id);
      changed.add("alerts");
    }
    if (changes.status !== undefined) {
      this.status = changes.status;
      changed.add("status");
    }
    if (changed.has("verdicts")) {
      this.verdictList = undefined;
      this.forget(this.verdicts, MAX_VERDICTS, () => this.verdictsByTime().slice(MAX_VERDICTS), () => {
        this.verdictList = undefined;
      });
    }
    if (changed.has("sessions")) {
      this.sessionList = undefined;
      this.forget(this.sessions, MAX_SESSIONS, () => this.sessionsByTime().slice(MAX_SESSIONS), () => {
        this.sessionList = undefined;
      });
    }
  }

  /** Drops the oldest where there are too many; a tenth of slack keeps this from sorting at each change. */
  private forget(
    map: Map<string, unknown>,
    limit: number,
    oldest: () => readonly { session_id: string }[],
    done: () => void,
  ): void {
    if (map.size <= limit * 1.1) return;
    for (const { session_id } of oldest()) map.delete(session_id);
    done();
  }

  private forgetTracks(t_ms: number, changed: Set<Topic>): void {
    if (t_ms - this.forgotten_ms < FORGET_EVERY_MS) return;
    this.forgotten_ms = t_ms;
    if (this.tracks.forgetBefore(t_ms - TRACK_AGE_MS)) changed.add("tracks");
  }

  private notify(changed: ReadonlySet<Topic>): void {
    if (changed.size === 0) return;
    for (const [listener, topics] of this.listeners) {
      for (const topic of changed) {
        if (topics.has(topic)) {
          listener(changed);
          break;
        }
      }
    }
  }
}
