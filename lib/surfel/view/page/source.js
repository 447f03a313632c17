// Where clusters come from: out of the page itself, or from surfel-view --serve.

import { bytesOfBase64, kRecordBytes, packedSize, readRecords } from 'surfel/decode.js';

const textOf = (id) => document.getElementById(id);

/** Hands all packed clusters of some bytes to a cloud. */
function takeAll(cloud, bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  for (let at = 0; at < bytes.byteLength; at += packedSize(view, at)) cloud.take(bytes, at);
}

/** Clusters that the page holds: there at once. */
export class EmbeddedSource {
  constructor(number) {
    this.number = number;
  }

  slots(info) {
    return info.clusters;
  }

  fill(cloud) {
    cloud.addRecords(readRecords(bytesOfBase64(textOf(`records-${this.number}`).textContent)));
    cloud.roots = cloud.hasLevels ? [0] : [...cloud.records.keys()];
    for (let part = 0; textOf(`clusters-${this.number}-${part}`); ++part) {
      const element = textOf(`clusters-${this.number}-${part}`);
      takeAll(cloud, bytesOfBase64(element.textContent));
      element.remove();
    }
  }

  want() {}
}

/** Clusters that a server has: asked for as pictures need them. */
export class ServedSource {
  static kAtOnce = 64;
  static kRequests = 4;

  constructor(number, arrived) {
    this.number = number;
    this.arrived = arrived;
    this.asked = new Set();
    this.running = 0;
    this.failed = null;
    this.bytes = 0;
  }

  slots(info, budget) {
    return Math.max(64, Math.min(info.clusters, Math.ceil(budget / 256)));
  }

  async fill(cloud) {
    this.cloud = cloud;
    const end = cloud.hasLevels ? 1 : cloud.info.clusters;
    const bytes = await this.get(`records?first=0&end=${end}`);
    cloud.addRecords(readRecords(bytes));
    cloud.roots = [...cloud.records.keys()];
    this.arrived();
  }

  async get(what) {
    const answer = await fetch(`${this.number}/${what}`);
    if (!answer.ok) throw new Error(`${answer.status} ${await answer.text()}`);
    const bytes = new Uint8Array(await answer.arrayBuffer());
    this.bytes += bytes.byteLength;
    return bytes;
  }

  /** Asks for the first ones of the clusters that are missing. */
  want(missing) {
    const free = ServedSource.kRequests - this.running;
    const fresh = missing.filter(({ index }) => !this.asked.has(index));
    for (let i = 0; i < free; ++i) {
      const part = fresh.slice(i * ServedSource.kAtOnce, (i + 1) * ServedSource.kAtOnce);
      if (part.length === 0) return;
      this.ask(part.map(({ index }) => index));
    }
  }

  async ask(indices) {
    ++this.running;
    for (const index of indices) this.asked.add(index);
    try {
      const bytes = await this.get(`clusters?list=${indices.join(',')}`);
      this.take(bytes);
      this.failed = null;
    } catch (error) {
      this.failed = error;
    } finally {
      for (const index of indices) this.asked.delete(index);
      --this.running;
      this.arrived();
    }
  }

  /** Each packed cluster is followed by the records of its children. */
  take(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    for (let at = 0; at < bytes.byteLength; ) {
      const index = view.getUint32(at + 4, true);
      const record = this.cloud.records.get(index);
      this.cloud.take(bytes, at);
      at += packedSize(view, at);
      const children = record.childCount * kRecordBytes;
      this.cloud.addRecords(readRecords(bytes.subarray(at, at + children), record.firstChild));
      at += children;
    }
  }

  busy() {
    return this.running > 0;
  }
}
