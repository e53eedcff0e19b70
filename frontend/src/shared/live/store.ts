import type { Alert, Estimate, Pad, SessionState, Status, Track, VerdictSummary } from "../api/records";
import type { ConnectionEvent, ConnectionState } from "./connection";
import type { Changes, LiveFrame } from "./protocol";

/** What can change; a subscriber names what it wants to hear of. */
export type Topic = "tracks" | "estimates" | "sessions" | "verdicts" | "pads" | "alerts" | "status" | "connection";

export type TrailPoint = { lat_e7: number; lon_e7: number; t_ms: number };

/** A trail shows the last minute of positions. */
export const TRAIL_MS = 60_000;
const MAX_TRAIL = 400;
export const MAX_VERDICTS = 5_000;
export const MAX_SESSIONS = 2_000;

type Listener = (topics: ReadonlySet<Topic>) => void;

/**
 * All that is known live, free of any UI framework: the map reads it at each tick, React through `useLive`.
 *
 * Tracks and estimates are the latest of each drone; sessions and verdicts are all of them, newest first, bounded.
 */
export class LiveStore {
  readonly tracks = new Map<string, Track>();
  readonly trails = new Map<string, TrailPoint[]>();
  readonly estimates = new Map<string, Estimate>();
  readonly sessions = new Map<string, SessionState>();
  /** By session. */
  readonly verdicts = new Map<string, VerdictSummary>();
  readonly pads = new Map<string, Pad>();
  /** Those that are open, by id; what is acknowledged or over is in REST. */
  readonly alerts = new Map<string, Alert>();
  status: Status | undefined;
  connection: ConnectionState = { phase: "connecting", attempt: 1 };
  /** When the last frame came, by this machine's clock; undefined before the first. */
  lastFrame_ms: number | undefined;
  /** The first snapshot has come in whole: what is empty now is empty in truth. */
  ready = false;
  /** The last hello brought a snapshot or fell behind: verdicts older than the snapshot may be missing. */
  gap = false;

  private readonly listeners = new Map<Listener, ReadonlySet<Topic>>();
  private verdictList: VerdictSummary[] | undefined;
  private sessionList: SessionState[] | undefined;
  private clockOffset_ms: number | undefined;
  private snapshotParts = 0;
  private seen = new Set<string>();

  /** Calls back after each change of one of these topics; returns the end of it. */
  subscribe(topics: readonly Topic[], listener: Listener): () => void {
    // The same function may subscribe twice (React's strict mode does): each subscription is its own.
    const own: Listener = (changed) => listener(changed);
    this.listeners.set(own, new Set(topics));
    return () => this.listeners.delete(own);
  }

  /** The server's clock, as well as the frames allow to know it. */
  serverNow_ms(local_ms: number = Date.now()): number {
    return local_ms + (this.clockOffset_ms ?? 0);
  }

  /** Newest first. */
  verdictsByTime(): readonly VerdictSummary[] {
    this.verdictList ??= [...this.verdicts.values()].sort(
      (a, b) => b.decided_ms - a.decided_ms || b.block - a.block || b.tx_index - a.tx_index,
    );
    return this.verdictList;
  }

  /** Newest first. */
  sessionsByTime(): readonly SessionState[] {
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
        this.apply(event.frame, event.received_ms, changed);
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

  private apply(frame: LiveFrame, received_ms: number, changed: Set<Topic>): void {
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
        changed.add("estimates").add("alerts");
      }
      changed.add("connection");
      return;
    }
    if (frame.type === "delta") this.learnClock(frame.t_ms, received_ms);
    this.take(frame, changed);
    if (frame.type === "snapshot") {
      this.snapshotParts += 1;
      for (const track of frame.tracks ?? []) this.seen.add(track.uav_id);
      if (this.snapshotParts >= frame.of) {
        this.ready = true;
        for (const id of this.tracks.keys()) {
          if (!this.seen.has(id)) {
            this.tracks.delete(id);
            this.trails.delete(id);
          }
        }
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
  }

  private take(changes: Changes, changed: Set<Topic>): void {
    for (const pad of changes.pads ?? []) {
      this.pads.set(pad.pad_id, pad);
      changed.add("pads");
    }
    for (const track of changes.tracks ?? []) {
      this.tracks.set(track.uav_id, track);
      this.extendTrail(track);
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
      if (alert.state === "open") this.alerts.set(alert.alert_id, alert);
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

  private extendTrail(track: Track): void {
    const trail = this.trails.get(track.uav_id) ?? [];
    const last = trail.at(-1);
    if (last !== undefined && track.t_ms <= last.t_ms) return;
    trail.push({ lat_e7: track.lat_e7, lon_e7: track.lon_e7, t_ms: track.t_ms });
    while (trail.length > MAX_TRAIL || (trail[0] !== undefined && trail[0].t_ms < track.t_ms - TRAIL_MS)) trail.shift();
    this.trails.set(track.uav_id, trail);
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
