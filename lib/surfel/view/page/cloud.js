// A cloud in textures of the graphics processor, cluster by cluster in slots, and the choice of the
// clusters that a picture shows.

import { ClusterTexels, kClusterSurfels } from 'surfel/decode.js';

const kWidth = 4096;
const kSlotsAcross = kWidth / kClusterSurfels;
const kTableAcross = kWidth / 4;

/** What is drawn: slots and numbers of surfels. */
class DrawList {
  constructor() {
    this.data = new Uint32Array(4096);
    this.clear();
  }
  clear() {
    this.count = 0;
    this.surfels = 0;
    this.most = 0;
    this.nearest = Infinity;
    this.farthest = 0;
    this.error = 0; // Pixels that the surface of one surfel measures, where finer ones are missing.
  }
  add(slot, surfels) {
    if (2 * this.count + 2 > this.data.length) {
      const larger = new Uint32Array(2 * this.data.length);
      larger.set(this.data);
      this.data = larger;
    }
    this.data[2 * this.count] = slot;
    this.data[2 * this.count + 1] = surfels;
    this.surfels += surfels;
    this.most = Math.max(this.most, surfels);
    ++this.count;
  }
}

export class GpuCloud {
  /**
   * @param info   what the page says of the file.
   * @param slots  clusters that there is room for.
   */
  constructor(renderer, info, slots) {
    const { gl } = renderer;
    this.gl = gl;
    this.info = info;
    this.origin = info.origin;
    this.hasLevels = info.levels > 1;
    this.slots = slots;
    const rows = Math.max(1, Math.ceil(slots / kSlotsAcross));
    this.first = renderer.texture(gl.RGBA32UI, kWidth, rows);
    this.second = renderer.texture(gl.RG32UI, kWidth, rows);
    this.shading = info.shading ? renderer.texture(gl.R32UI, kWidth, rows) : null;
    this.clips = info.clips ? renderer.texture(gl.RG32UI, kWidth, rows) : null;
    this.table = renderer.texture(gl.RGBA32F, kWidth, Math.max(1, Math.ceil(slots / kTableAcross)));
    this.texels = new ClusterTexels();
    this.records = new Map();
    this.roots = [];
    this.slotOf = new Map();
    this.holders = new Array(slots).fill(null);
    this.nextSlot = 0;
    this.frame = 0;
    this.list = new DrawList();
  }

  /** Bounds of clusters. */
  addRecords(records) {
    for (const record of records) this.records.set(record.index, record);
  }

  has(index) {
    return this.slotOf.has(index);
  }

  /** Takes a packed cluster into a free slot, or into that of one that was not drawn for long. */
  take(bytes, at) {
    const index = new DataView(bytes.buffer, bytes.byteOffset).getUint32(at + 4, true);
    if (this.slotOf.has(index)) return index;
    const slot = this.freeSlot();
    if (slot < 0) return -1;
    const record = this.records.get(index);
    this.texels.read(bytes, at, record.merged);
    this.upload(slot);
    this.holders[slot] = record;
    this.slotOf.set(index, slot);
    record.seen = this.frame;
    return index;
  }

  freeSlot() {
    // A clock: slots whose clusters were drawn lately are passed over.
    for (let tries = 0; tries < this.slots; ++tries) {
      const slot = this.nextSlot;
      this.nextSlot = (this.nextSlot + 1) % this.slots;
      const holder = this.holders[slot];
      if (!holder) return slot;
      if (holder.seen >= this.frame - 1 || this.roots.includes(holder.index)) continue;
      this.slotOf.delete(holder.index);
      return slot;
    }
    return -1;
  }

  upload(slot) {
    const { gl, texels } = this;
    const x = (slot % kSlotsAcross) * kClusterSurfels;
    const y = Math.floor(slot / kSlotsAcross);
    const put = (texture, layout, data) => {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, kClusterSurfels, 1, layout, gl.UNSIGNED_INT, data);
    };
    put(this.first, gl.RGBA_INTEGER, texels.first);
    put(this.second, gl.RG_INTEGER, texels.second);
    if (this.clips) put(this.clips, gl.RG_INTEGER, texels.clips);
    if (this.shading) put(this.shading, gl.RED_INTEGER, texels.shading);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.texSubImage2D(
      gl.TEXTURE_2D, 0, (slot % kTableAcross) * 4, Math.floor(slot / kTableAcross), 4, 1, gl.RGBA,
      gl.FLOAT, texels.table);
  }

  /**
   * Chooses the clusters to draw: as coarse as `lodError` pixels allow, and coarser where finer ones
   * are not there yet.
   * @param share  of each cluster's surfels to draw.
   * @return  the clusters that are missing, with how much they matter.
   */
  choose(camera, [width, height], { lodError, share }) {
    ++this.frame;
    this.list.clear();
    const missing = [];
    const rotation = camera.rotation();
    const offset = [0, 1, 2].map((i) => this.origin[i] - camera.eye[i]);
    const t = rotation.map((row) => row[0] * offset[0] + row[1] * offset[1] + row[2] * offset[2]);
    const focal = camera.focal(height);
    const filter = Math.SQRT2;
    const sides = [width / 2 + filter, height / 2 + filter];
    const flat = camera.ortho > 0;
    const norms = sides.map((side) => (flat ? focal : Math.hypot(focal, side)));
    const at = (record, row) =>
      rotation[row][0] * record.center[0] + rotation[row][1] * record.center[1] +
      rotation[row][2] * record.center[2] + t[row];
    const visible = (record, z) => {
      const radius = record.radius + Math.SQRT2 * record.deviation;
      if (z + radius <= 0) return false;
      for (let axis = 0; axis < 2; ++axis) {
        const p = Math.abs(at(record, axis));
        if (focal * p - sides[axis] * (flat ? 1 : z) > radius * norms[axis]) return false;
      }
      return true;
    };
    const draw = (record, z) => {
      const slot = this.slotOf.get(record.index);
      record.seen = this.frame;
      this.list.add(slot, Math.max(1, Math.ceil(record.count * share)));
      const reach = record.radius + Math.SQRT2 * record.deviation;
      this.list.nearest = Math.min(this.list.nearest, z - reach);
      this.list.farthest = Math.max(this.list.farthest, z + reach);
      const error = (record.spacing * focal) / (flat ? 1 : Math.max(z, 1e-12));
      if (record.childCount > 0 && error > lodError) this.list.error = Math.max(this.list.error, error);
    };
    const want = (record, z) => {
      const near = Math.max(z - record.radius, 1e-6 * record.radius + 1e-12);
      missing.push({ index: record.index, matters: this.hasLevels ? record.spacing / near : record.radius / near });
    };
    // False where nothing of the cluster can be drawn yet.
    const visit = (index) => {
      const record = this.records.get(index);
      if (!record) return false;
      const z = at(record, 2);
      if (!visible(record, z)) return true;
      record.seen = this.frame;
      const near = flat ? 1 : z - record.radius;
      const fine = near > 0 && record.spacing * focal <= lodError * near;
      if (fine || record.childCount === 0) {
        if (this.slotOf.has(index)) {
          draw(record, z);
          return true;
        }
        want(record, z);
        return false;
      }
      // Children are drawn once all of them are there, so that nothing is seen twice or not at all.
      let ready = true;
      const children = [];
      for (let i = 0; i < record.childCount; ++i) children.push(record.firstChild + i);
      for (const child of children) ready = this.isReady(child, visible, at, want) && ready;
      if (ready) {
        for (const child of children) visit(child);
        return true;
      }
      if (!this.slotOf.has(index)) {
        want(record, z);
        return false;
      }
      draw(record, z);
      return true;
    };
    for (const root of this.roots) visit(root);
    this.list.nearest = Math.max(this.list.nearest, 1e-5 * Math.abs(this.list.farthest), 1e-30);
    return missing.sort((a, b) => b.matters - a.matters);
  }

  /** Whether a cluster that is seen can be drawn; what is missing is asked for. */
  isReady(index, visible, at, want) {
    const record = this.records.get(index);
    if (!record) return false;
    const z = at(record, 2);
    if (!visible(record, z)) return true;
    if (this.slotOf.has(index)) {
      record.seen = this.frame;
      return true;
    }
    want(record, z);
    return false;
  }
}
