// Draws clouds in WebGL2 by passes: the nearest fragments' depths, the mean depths of their surfaces,
// the same for what is behind where that is seen, sums over the fragments of each surface, and
// pictures of the sums.

import * as pictures from 'surfel/pictures.js';
import { Program } from 'surfel/program.js';
import * as shaders from 'surfel/shaders.js';
import { normalized, scale, times } from 'surfel/vector.js';
import { Weights } from 'surfel/weights.js';

const kListWidth = 2048;

/** Pixels along a side of a tile; kTilesFragment has it, too. */
const kTile = 8;

/** Layers whose mean depths are found: the fourth one takes what is left, whatever its depth is. */
const kMeans = 3;

/** Argument of Phi from which on something of a kernel is left beside a line. */
const kLeastClip = -3.09023;

/** Pixels of which four layers take half a gigabyte. */
const kManyPixels = 3e6;

export const kModes = ['color', 'normal', 'depth', 'attribute'];

/** Whether the pictures are made by the processor. */
function isSoftware(gl) {
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

export class Renderer {
  /**
   * Throws where the browser lacks what is needed, with a message for the reader.
   * @param clips  whether half-planes cut surfels of some cloud.
   */
  constructor(canvas, clips) {
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, depth: false });
    if (!gl) {
      throw new Error('This browser offers no WebGL2, which the page draws with. Browsers of 2022 and later have it; in older ones, and in virtual machines, it may be switched off.');
    }
    if (!gl.getExtension('EXT_color_buffer_float')) {
      throw new Error('The graphics driver cannot draw into textures of floating-point numbers (EXT_color_buffer_float), which sums of kernels need.');
    }
    this.gl = gl;
    this.canvas = canvas;
    this.clips = clips;
    this.sumFormat = gl.getExtension('EXT_float_blend') ? gl.RGBA32F : gl.RGBA16F;
    this.weights = new Weights(1, 1);
    this.software = isSoftware(gl);
    // Without a graphics processor vertices cost most, and points have a quarter of them.
    this.points = this.software && gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE)[1] >= 512;
    // Textures that a pass writes into.
    this.mostTextures = Math.min(8, gl.getParameter(gl.MAX_DRAW_BUFFERS), gl.getParameter(gl.MAX_COLOR_ATTACHMENTS));
    this.splatPrograms = new Map();
    const screen = (fragment) => new Program(gl, pictures.kScreenVertex, fragment);
    this.open = screen(pictures.kOpenFragment);
    this.findTiles = screen(pictures.kTilesFragment);
    this.surfaces = screen(pictures.kSurfacesFragment);
    this.composite = screen(pictures.compositeFragment(false));
    this.compositeSeveral = screen(pictures.compositeFragment(true));
    if (clips) this.compositeCuts = screen(pictures.compositeFragment(true, true));
    this.compositeTiles = new Program(gl, pictures.kTileVertex, pictures.compositeFragment(true));
    this.sums = screen(pictures.kSumsFragment);
    this.columns = screen(pictures.kColumnsFragment);
    this.least = screen(pictures.kLeastFragment);
    this.final = screen(pictures.kFinalFragment);
    this.makeQuads();
    this.nothing = this.texture(gl.R32F, 1, 1, new Float32Array([1]));
    this.noClips = this.texture(gl.RG32UI, 1, 1);
    this.noShading = this.texture(gl.R32UI, 1, 1, new Uint32Array([0]));
    this.list = this.texture(gl.RG32UI, kListWidth, 1);
    this.listRows = 1;
    this.maps = new Map();
    this.size = [0, 0];
  }

  /** The programs that draw splats, with or without half-planes that cut them. */
  splats(clips) {
    if (!this.splatPrograms.has(clips)) {
      const program = (attributes, fragment) => new Program(this.gl, shaders.splatVertex(attributes, clips), fragment);
      const sum = [];
      for (let count = 1; count <= this.atOnce(clips); ++count) sum.push(program(true, shaders.sumFragment(count, clips)));
      this.splatPrograms.set(clips, {
        nearest: program(false, shaders.nearestFragment(clips)),
        mean: program(false, shaders.meanFragment(clips)),
        sum,
      });
    }
    return this.splatPrograms.get(clips);
  }

  /** Layers whose attributes a pass sums up. All browsers can write into 4 textures at once. */
  atOnce(clips) {
    return Math.min(4, Math.floor(this.mostTextures / shaders.texturesOf(clips)));
  }

  texture(format, width, height, data = null) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, name, value);
    }
    if (data) {
      const [layout, type] = {
        [gl.R32F]: [gl.RED, gl.FLOAT],
        [gl.RGBA32F]: [gl.RGBA, gl.FLOAT],
        [gl.R32UI]: [gl.RED_INTEGER, gl.UNSIGNED_INT],
      }[format];
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, layout, type, data);
    }
    return texture;
  }

  /** The corners of a cluster's quads, as triangles. */
  makeQuads() {
    const { gl } = this;
    const indices = new Uint16Array(6 * 256);
    for (let i = 0; i < 256; ++i) indices.set([0, 1, 2, 2, 1, 3].map((c) => 4 * i + c), 6 * i);
    this.vertices = gl.createVertexArray();
    gl.bindVertexArray(this.vertices);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    this.drawn = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.drawn);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 2, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);
    this.noVertices = gl.createVertexArray();
    gl.vertexAttribI4ui(0, 0, 0, 0, 0); // The type that the programs have, where there is no array.
  }

  /** Layers that a pixel can tell apart: a large picture has no memory for four. */
  mostLayers(pixels) {
    return pixels > kManyPixels ? 2 : 4;
  }

  target(textures, depth = null) {
    const { gl } = this;
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    textures.forEach((texture, i) => {
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, texture, 0);
    });
    if (depth) {
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_STENCIL_ATTACHMENT, gl.RENDERBUFFER, depth);
    }
    gl.drawBuffers(textures.map((_, i) => gl.COLOR_ATTACHMENT0 + i));
    return frame;
  }

  resize(width, height) {
    if (this.size[0] === width && this.size[1] === height) return;
    const { gl } = this;
    for (const texture of this.textures ?? []) gl.deleteTexture(texture);
    for (const frame of this.frames ?? []) gl.deleteFramebuffer(frame);
    if (this.depth) gl.deleteRenderbuffer(this.depth);
    this.size = [width, height];
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH32F_STENCIL8, width, height);
    this.textures = [];
    const make = (format) => {
      const texture = this.texture(format, width, height);
      this.textures.push(texture);
      return texture;
    };
    this.layers = Array.from({ length: this.mostLayers(width * height) }, () => {
      const layer = { nearest: make(gl.RGBA32F) };
      for (const name of ['means', 'colors', 'normals']) layer[name] = make(this.sumFormat);
      for (const name of this.clips ? ['cuts', 'away'] : []) layer[name] = make(this.sumFormat);
      layer.visibility = this.target([layer.nearest], this.depth);
      // By whether half-planes cut surfels.
      layer.mean = [[layer.means], [layer.means, layer.away]].slice(0, this.clips ? 2 : 1).map((to) => this.target(to, this.depth));
      return layer;
    });
    // By whether half-planes cut surfels, the first layer and their number.
    this.attributes = [false, true].slice(0, this.clips ? 2 : 1).map((clips) =>
      this.layers.map((_, first) =>
        this.splats(clips).sum.map((_, last) => {
          const layers = this.layers.slice(first, first + last + 1);
          return this.target(layers.flatMap((l) => [l.colors, l.normals, ...(clips ? [l.cuts] : [])]), this.depth);
        })));
    this.tiles = [width, height].map((side) => Math.ceil(side / kTile));
    this.openTiles = this.texture(gl.R8, ...this.tiles);
    this.textures.push(this.openTiles);
    this.tiled = this.target([this.openTiles]);
    this.color = make(gl.RGBA32F);
    this.sumsOfSides = make(gl.RGBA32F);
    this.pairs = [make(gl.RGBA32F), make(gl.RGBA32F)];
    this.paired = this.target(this.pairs);
    this.composed = this.target([this.color, this.sumsOfSides], this.depth);
    this.planes = [1, 2, 3].map(() => {
      const texture = make(gl.R32F);
      return { texture, frame: this.target([texture]) };
    });
    this.frames = [
      ...this.layers.flatMap((l) => [l.visibility, ...l.mean]), ...this.attributes.flat(2), this.tiled, this.paired, this.composed,
      ...this.planes.map((p) => p.frame),
    ];
  }

  /** A texture of 256 linear colours. */
  colorMap(colors) {
    if (!this.maps.has(colors)) {
      const linear = new Float32Array(4 * 256);
      for (let i = 0; i < 256; ++i) {
        for (let c = 0; c < 3; ++c) {
          const code = colors[3 * i + c] / 255;
          linear[4 * i + c] = code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4;
        }
        linear[4 * i + 3] = 1;
      }
      this.maps.set(colors, this.texture(this.gl.RGBA32F, 256, 1, linear));
    }
    return this.maps.get(colors);
  }

  /**
   * Draws a cloud into a part of the canvas, from x0 to x1.
   * @param cloud  a GpuCloud.
   * @param drawn  its clusters to be drawn: slots and numbers of surfels, in pairs.
   * @param view   camera, mode, lit, background (linear), map, growth, depthRange, clip, skyUp, layers
   *               of a pixel, fast: without antialiased edges, opaque, lodError, region.
   */
  draw(cloud, drawn, view) {
    const { gl, size } = this;
    const [width, height] = size;
    const [x0, x1] = view.region ?? [0, width];
    if (x1 <= x0) return;
    const around = Math.ceil(this.weights.reach) + 4;
    this.scissor = [Math.max(0, x0 - around), Math.min(width, x1 + around)];
    gl.viewport(0, 0, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(this.scissor[0], 0, this.scissor[1] - this.scissor[0], height);
    const uniforms = { ...this.cameraUniforms(cloud, view), ...this.cloudUniforms(cloud, view) };
    // In front of the eye, so that depths are positive.
    this.far = view.camera.ortho > 0 ? drawn.farthest + 0.01 * Math.abs(drawn.farthest) : 0;
    uniforms.u_ortho = view.camera.ortho > 0;
    uniforms.u_far = this.far;
    uniforms.u_depth_scale = uniforms.u_ortho ? 1 / (this.far - Math.min(0, drawn.nearest)) : drawn.nearest;
    const layers = Math.min(view.layers, this.layers.length);
    const clips = cloud.clips !== null;
    for (let i = 0; i < 4; ++i) {
      const layer = this.layers[Math.min(i, this.layers.length - 1)];
      uniforms[`u_nearest${i + 1}`] = layer.nearest;
      uniforms[`u_means${i + 1}`] = layers > 1 && i < kMeans ? layer.means : this.nothing;
      uniforms[`u_colors${i + 1}`] = layer.colors;
      uniforms[`u_normals${i + 1}`] = layer.normals;
      uniforms[`u_cuts${i + 1}`] = layer.cuts;
      uniforms[`u_away${i + 1}`] = clips && layers > 1 && i < kMeans ? layer.away : this.nothing;
    }
    uniforms.u_layers = layers;
    uniforms.u_cut = clips;
    // Without other surfaces behind discs end at their lines.
    uniforms.u_least_clip = layers > 1 ? kLeastClip : 0;
    this.putList(drawn);
    for (let i = 0; i < layers; ++i) this.findLayer(i, layers, drawn, uniforms, this.splats(clips));
    this.sumLayers(layers, drawn, uniforms, clips);
    this.fill(this.surfaces, this.paired, uniforms);
    [uniforms.u_surfaces1, uniforms.u_surfaces2] = this.pairs;
    uniforms.u_sums = this.sumsOfSides;
    this.compose(layers, uniforms, clips);
    if (!view.fast && layers > 1) this.findEdges(uniforms);
    this.finish(uniforms, view, x0, x1);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Hands the clusters to be drawn on. */
  putList(drawn) {
    const { gl } = this;
    if (!this.points) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.drawn);
      gl.bufferData(gl.ARRAY_BUFFER, drawn.data.subarray(0, 2 * drawn.count), gl.DYNAMIC_DRAW);
      return;
    }
    // As a texture: instances of few points each would take longer.
    const rows = Math.ceil(drawn.data.length / 2 / kListWidth);
    if (rows > this.listRows) {
      gl.deleteTexture(this.list);
      this.list = this.texture(gl.RG32UI, kListWidth, rows);
      this.listRows = rows;
    }
    const used = Math.max(1, Math.ceil(drawn.count / kListWidth));
    gl.bindTexture(gl.TEXTURE_2D, this.list);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, kListWidth, used, gl.RG_INTEGER, gl.UNSIGNED_INT, drawn.data);
  }

  cameraUniforms(cloud, view) {
    const [width, height] = this.size;
    const rotation = view.camera.rotation();
    const offset = [0, 1, 2].map((i) => cloud.origin[i] - view.camera.eye[i]);
    const focal = view.camera.focal(height);
    const columns = [0, 1, 2].flatMap((c) => rotation.map((row) => row[c]));
    return {
      u_rotation: columns,
      u_world_from_camera: rotation.flat(),
      u_translation: times(rotation, offset),
      u_focal: [focal, focal],
      u_center: [width / 2, height / 2],
      u_size: this.size,
      u_last: [width - 1, height - 1],
      u_light: this.light(rotation),
      u_up: normalized(view.skyUp),
    };
  }

  /** The headlight of surfel-render, from over the left shoulder, in world axes. */
  light([right, down, forward]) {
    const along = [0, 1, 2].map((i) => 0.4 * right[i] + 0.6 * down[i] + forward[i]);
    return scale(normalized(along), -1);
  }

  cloudUniforms(cloud, view) {
    const { weights } = this;
    const clip = view.clip ?? { min: [-Infinity, -Infinity, -Infinity], max: [Infinity, Infinity, Infinity] };
    const bound = (values, infinite) =>
      values.map((value, i) => (Number.isFinite(value) ? value - cloud.origin[i] : infinite));
    return {
      u_first: cloud.first,
      u_second: cloud.second,
      u_shading: cloud.shading ?? this.noShading,
      u_clips: cloud.clips ?? this.noClips,
      u_beyond_growth: 0.1, // beyond_growth() at cutoff 1.
      u_table: cloud.table,
      u_cutoff: 1,
      u_two_c: 2,
      u_lowpass2: 1,
      u_epsilon: 1,
      u_tolerance: 0.1,
      u_covering: cloud.hasLevels ? coveringVariance(view.lodError) : 0,
      u_growth: view.growth,
      u_points: this.points,
      u_mode: kModes.indexOf(view.mode),
      u_mapped: cloud.shading !== null,
      u_clip_min: bound(clip.min, -3e38),
      u_clip_max: bound(clip.max, 3e38),
      u_map: this.colorMap(view.map),
      u_lit: view.lit && view.mode !== 'depth',
      u_light_color: [0.57, 0.56, 0.54],
      u_sky: [0.4, 0.415, 0.44],
      u_ground: [0.1, 0.09, 0.08],
      u_depth_range: view.depthRange,
      u_full: weights.full,
      u_edge_weight: weights.edge,
      // Half floats have the smaller range.
      u_outweigh: this.sumFormat === this.gl.RGBA32F ? [60, 80] : [5, 5],
      u_opaque: cloud.info.opaque,
      u_mean: weights.mean,
      u_inv_mean: 1 / weights.mean,
      u_taps: weights.taps,
      u_reach: weights.reach,
      u_completing: weights.completing,
      u_background: view.background,
    };
  }

  /**
   * Visibility and mean depth of a layer: of the surfaces that those before do not hold. Layers after kMeans are only
   * told by their nearest fragments.
   */
  findLayer(number, layers, drawn, uniforms, programs) {
    const { gl } = this;
    const layer = this.layers[number];
    const values = { ...uniforms, u_layer: number, u_nearest: layer.nearest, u_takes_rest: number > 0 && number + 1 === layers, };
    // No texture may be read while it is drawn into.
    for (let i = number; i < 4; ++i) values[`u_nearest${i + 1}`] = values[`u_means${i + 1}`] = values[`u_away${i + 1}`] = this.nothing;
    if (number > 0) this.markOpen(number, uniforms);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.visibility);
    gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.depthMask(true);
    gl.clearBufferfv(gl.DEPTH, 0, [0]);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.GREATER);
    this.drawSplats(programs.nearest, values, drawn);
    gl.disable(gl.DEPTH_TEST);
    if (layers > 1 && number < kMeans) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, layer.mean[Number(uniforms.u_cut)]);
      for (let i = 0; i < (uniforms.u_cut ? 2 : 1); ++i) gl.clearBufferfv(gl.COLOR, i, [0, 0, 0, 0]);
      this.addSplats(programs.mean, values, drawn);
    }
    gl.disable(gl.STENCIL_TEST);
  }

  /** Attributes of all layers. The stencil holds the number of the last one that a pixel may have. */
  sumLayers(layers, drawn, uniforms, clips) {
    const { gl } = this;
    const { sum } = this.splats(clips);
    const atOnce = this.atOnce(clips);
    for (let first = 0; first < layers; first += atOnce) {
      const count = Math.min(atOnce, layers - first);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.attributes[Number(clips)][first][count - 1]);
      for (let i = 0; i < shaders.texturesOf(clips) * count; ++i) gl.clearBufferfv(gl.COLOR, i, [0, 0, 0, 0]);
      if (first > 0) gl.enable(gl.STENCIL_TEST);
      gl.stencilFunc(gl.LEQUAL, first, 255);
      this.addSplats(sum[count - 1], { ...uniforms, u_from: first }, drawn);
      gl.disable(gl.STENCIL_TEST);
    }
  }

  addSplats(program, uniforms, drawn) {
    const { gl } = this;
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    this.drawSplats(program, uniforms, drawn);
    gl.disable(gl.BLEND);
  }

  drawSplats(program, uniforms, drawn) {
    const { gl } = this;
    program.use({ ...uniforms, u_list: this.list, u_most: Math.max(1, drawn.most) });
    if (this.points) {
      gl.bindVertexArray(this.noVertices);
      gl.drawArrays(gl.POINTS, 0, drawn.most * drawn.count);
    } else {
      gl.bindVertexArray(this.vertices);
      gl.drawElementsInstanced(gl.TRIANGLES, 6 * drawn.most, gl.UNSIGNED_SHORT, 0, drawn.count);
    }
  }

  /** Pixels of several layers, and edges of transparent surfaces, take a longer program. */
  compose(layers, uniforms, clips) {
    const { gl } = this;
    if (layers > 1 && clips) {
      this.fill(this.compositeCuts, this.composed, uniforms);
      return;
    }
    if (layers > 1 && !uniforms.u_opaque) {
      this.fill(this.compositeSeveral, this.composed, uniforms);
      return;
    }
    // Where nothing behind is known, what is in front covers the pixel.
    this.fill(this.composite, this.composed, layers === 1 ? { ...uniforms, u_full: 0.01 } : uniforms);
    if (layers === 1) return;
    gl.disable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, ...this.tiles);
    this.fill(this.findTiles, this.tiled, { ...uniforms, u_means: this.layers[0].means, u_away: this.layers[0].away });
    gl.viewport(0, 0, ...this.size);
    gl.enable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.composed);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.NOTEQUAL, 0, 255);
    this.compositeTiles.use({ ...uniforms, u_tiles: this.openTiles, u_across: this.tiles[0] });
    gl.drawArrays(gl.POINTS, 0, this.tiles[0] * this.tiles[1]);
    gl.disable(gl.STENCIL_TEST);
  }

  /** Leaves in the stencil the pixels of which something behind the layers before is seen. */
  markOpen(number, uniforms) {
    const { gl } = this;
    const before = this.layers[number - 1];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.layers[number].visibility);
    gl.colorMask(false, false, false, false);
    gl.enable(gl.STENCIL_TEST);
    if (number === 1) gl.clearBufferiv(gl.STENCIL, 0, [0]);
    // Only pixels that were open before stay so.
    gl.stencilFunc(gl.EQUAL, number - 1, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    const summed = number <= kMeans;
    this.open.use({ ...uniforms, u_nearest: before.nearest, u_means: summed ? before.means : this.nothing, u_away: before.away, u_summed: summed });
    gl.bindVertexArray(this.noVertices);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.colorMask(true, true, true, true);
    gl.stencilFunc(gl.EQUAL, number, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
  }

  fill(program, frame, uniforms) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    program.use(uniforms);
    gl.bindVertexArray(this.noVertices);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  findEdges(uniforms) {
    const [rows, smooth, least] = this.planes;
    this.fill(this.sums, rows.frame, uniforms);
    this.fill(this.columns, smooth.frame, { ...uniforms, u_rows: rows.texture });
    this.fill(this.least, least.frame, { ...uniforms, u_smooth: smooth.texture });
  }

  finish(uniforms, view, x0, x1) {
    const { gl } = this;
    const [, , least] = this.planes;
    gl.scissor(x0, 0, x1 - x0, this.size[1]);
    this.fill(this.final, null, {
      ...uniforms,
      u_color: this.color,
      u_least: least.texture,
      u_relief: this.nothing,
      u_has_relief: false,
      // One layer's sums end where something is in front of it, too.
      u_edges: !view.fast && view.opaque && uniforms.u_layers > 1,
      u_height: this.size[1],
      u_offset: [0, 0],
    });
  }

  /** The depth of a pixel of the picture drawn last; 0 where there is none. */
  depthAt(x, y) {
    const { gl } = this;
    const value = new Float32Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.layers[0].visibility);
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.readPixels(x, y, 1, 1, gl.RGBA, gl.FLOAT, value);
    if (value[0] === 0) return 0;
    return this.far > 0 ? this.far - value[0] : 1 / value[0];
  }

  /** Waits until all has been drawn. */
  wait() {
    const pixel = new Uint8Array(4);
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, null);
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, pixel);
  }
}

/** Variance of merged surfels, by their area, that covers where pieces are so many pixels long. */
function coveringVariance(error) {
  const spacing = error / 1.35;
  return spacing > 1 ? 1 - 1 / (spacing * spacing) : 0;
}
