// Packed clusters (packed_cluster.h) to texels.

const kNormal = 2;
const kDeviation = 4;
const kAcross = 8;
const kArea = 16;
const kColor = 32;
const kAlpha = 64;
const kShading = 128;
const kAttribute = 256;
const kClip1 = 512;
const kClip2 = 1024;
/** Code of a half-plane that cuts nothing. */
const kNoClip = 0xffff0000;

export const kHeaderBytes = 64;
export const kRecordBytes = 40;
export const kClusterSurfels = 256;

/** Bytes of a text in base64. */
export function bytesOfBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** Bounds of clusters, from the bytes of their records. */
export function readRecords(bytes, first = 0) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const records = [];
  for (let at = 0; at + kRecordBytes <= bytes.byteLength; at += kRecordBytes) {
    const float = (i) => view.getFloat32(at + 4 * i, true);
    records.push({
      index: first + at / kRecordBytes,
      center: [float(0), float(1), float(2)],
      radius: float(3),
      deviation: float(4),
      spacing: float(5),
      firstChild: view.getUint32(at + 24, true),
      childCount: view.getUint16(at + 28, true),
      count: view.getUint16(at + 30, true),
      merged: view.getUint32(at + 32, true) !== 0,
    });
  }
  return records;
}

/** Bytes of the packed cluster that begins at a place. */
export function packedSize(view, at) {
  const count = view.getUint16(at, true);
  const columns = view.getUint16(at + 2, true);
  const has = (bit) => ((columns & bit) !== 0 ? 1 : 0);
  const surfel =
    6 + 4 * has(kNormal) + 2 * has(kDeviation) + 4 * has(kAcross) + 2 * has(kArea) +
    3 * has(kColor) + has(kAlpha) + 4 * has(kShading) + has(kAttribute) + 4 * has(kClip1) + 4 * has(kClip2);
  return kHeaderBytes + count * surfel;
}

/** Room for the texels of one cluster. */
export class ClusterTexels {
  constructor() {
    /** Position 3 x 16, deviation 16, normal 2 x 16, colour 3 x 8, alpha 8. */
    this.first = new Uint32Array(4 * kClusterSurfels);
    /** Area 16, deviation across 16, angle 16, attribute 8. */
    this.second = new Uint32Array(2 * kClusterSurfels);
    /** Normal to shade with, 2 x 16. */
    this.shading = new Uint32Array(kClusterSurfels);
    /** Half-planes: angle 16, distance 16 of each. */
    this.clips = new Uint32Array(2 * kClusterSurfels);
    /** What the numbers mean, see place() in shaders.js. */
    this.table = new Float32Array(16);
  }

  /** Reads the packed cluster that begins at a place; returns its index. */
  read(bytes, begin, merged) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const count = view.getUint16(begin, true);
    const columns = view.getUint16(begin + 2, true);
    const index = view.getUint32(begin + 4, true);
    const float = (i) => view.getFloat32(begin + 8 + 4 * i, true);
    let at = begin + kHeaderBytes;
    const shorts = () => {
      const from = at;
      at += 2 * count;
      return (i) => bytes[from + 2 * i] | (bytes[from + 2 * i + 1] << 8);
    };
    const zero = () => 0;
    const pairs = (bit, missing) => {
      if ((columns & bit) === 0) return missing;
      const from = at;
      at += 4 * count;
      return (i) =>
        (bytes[from + 4 * i] | (bytes[from + 4 * i + 1] << 8) | (bytes[from + 4 * i + 2] << 16) |
          (bytes[from + 4 * i + 3] << 24)) >>> 0;
    };
    const x = shorts();
    const y = shorts();
    const z = shorts();
    const normal = pairs(kNormal, () => 0xffffffff);
    const deviation = (columns & kDeviation) !== 0 ? shorts() : zero;
    const across = (columns & kAcross) !== 0 ? shorts() : deviation;
    const angle = (columns & kAcross) !== 0 ? shorts() : zero;
    const area = (columns & kArea) !== 0 ? shorts() : zero;
    let color = (i, c) => bytes[begin + 56 + c];
    if ((columns & kColor) !== 0) {
      const from = at;
      at += 3 * count;
      color = (i, c) => bytes[from + 3 * i + c];
    }
    const octets = (bit, missing) => {
      if ((columns & bit) === 0) return () => missing;
      const from = at;
      at += count;
      return (i) => bytes[from + i];
    };
    const alpha = octets(kAlpha, 255);
    const shading = pairs(kShading, normal);
    const attribute = octets(kAttribute, bytes[begin + 59]);
    const clip1 = pairs(kClip1, () => kNoClip);
    const clip2 = pairs(kClip2, () => kNoClip);
    for (let i = 0; i < count; ++i) {
      this.first[4 * i] = x(i) | (y(i) << 16);
      this.first[4 * i + 1] = z(i) | (deviation(i) << 16);
      this.first[4 * i + 2] = normal(i);
      this.first[4 * i + 3] = color(i, 0) | (color(i, 1) << 8) | (color(i, 2) << 16) | (alpha(i) << 24);
      this.second[2 * i] = area(i) | (across(i) << 16);
      this.second[2 * i + 1] = angle(i) | (attribute(i) << 16);
      this.shading[i] = shading(i);
      this.clips[2 * i] = clip1(i);
      this.clips[2 * i + 1] = clip2(i);
    }
    // min, deviation_log; step, deviation_step; area, colour; flags.
    this.table.set([
      float(0), float(1), float(2), float(6), float(3), float(4), float(5), float(7),
      float(8), float(9), float(10), float(11), merged ? 1 : 0, 0, 0, 0,
    ]);
    return index;
  }
}
