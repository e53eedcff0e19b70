import { FetchSource, type RangeResponse } from "pmtiles";

const AGAIN_MS = 1_000;

/** A part that did not come over the network is asked for once more: MapLibre itself would leave a hole for good. */
export class ArchiveSource extends FetchSource {
  override async getBytes(offset: number, length: number, signal?: AbortSignal, etag?: string): Promise<RangeResponse> {
    try {
      return await super.getBytes(offset, length, signal, etag);
    } catch (error) {
      // What fetch says where there was no answer; a server's own refusal stays one.
      if (!(error instanceof TypeError) || signal?.aborted === true) throw error;
      await new Promise((done) => setTimeout(done, AGAIN_MS));
      return super.getBytes(offset, length, signal, etag);
    }
  }
}
