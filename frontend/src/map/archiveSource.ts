import { FetchSource, SharedPromiseCache, type Header, type RangeResponse, type Source } from "pmtiles";

const AGAIN_MS = 1_000;

/** No answer, or the server's refusal: not the archive's fault. MapLibre passes on the message alone. */
export const AWAY = "The archive cannot be reached.";

/** A part that did not come over the network is asked for once more: MapLibre itself would leave a hole for good. */
export class ArchiveSource extends FetchSource {
  override async getBytes(offset: number, length: number, signal?: AbortSignal, etag?: string): Promise<RangeResponse> {
    try {
      return await super.getBytes(offset, length, signal, etag).catch(async (error: unknown) => {
        // What fetch says where there was no answer; a server's own refusal stays one.
        if (!(error instanceof TypeError) || signal?.aborted === true) throw error;
        await new Promise((done) => setTimeout(done, AGAIN_MS));
        return super.getBytes(offset, length, signal, etag);
      });
    } catch (error) {
      // Nobody wants it any longer, whatever a browser calls that.
      if (signal?.aborted === true) throw new DOMException("", "AbortError");
      if (error instanceof TypeError || (error instanceof Error && error.message.startsWith("Bad response code"))) throw new Error(AWAY, { cause: error });
      throw error;
    }
  }
}

/** Where an archive's tiles are. What could not be read is read anew by who asks next, not remembered as a failure. */
export class Directories extends SharedPromiseCache {
  override async getHeader(source: Source): Promise<Header> {
    return super.getHeader(source).catch((error: unknown) => this.forget(source, error));
  }

  override async getDirectory(source: Source, offset: number, length: number, header: Header, signal?: AbortSignal): ReturnType<SharedPromiseCache["getDirectory"]> {
    return super.getDirectory(source, offset, length, header, signal).catch((error: unknown) => this.forget(source, error));
  }

  private forget(source: Source, error: unknown): never {
    for (const key of this.cache.keys()) if (key.startsWith(source.getKey())) this.cache.delete(key);
    throw error;
  }
}
