// Draws clouds in WebGL2 by passes: the nearest fragments' depths, sums over the fragments of their
// surfaces, the same for what is behind where that is seen, and pictures of the sums.

import { normalized, scale, times } from 'surfel/vector.js';
import * as shaders from 'surfel/shaders.js';

/** What follows from the cutoff of the kernels and the pixel filter, as in surfel-render. */
class Weights {
  constructor(cutoff, lowpass) {
    const lost = Math.exp(-cutoff);
    this.mean = 1 - lost;
    this.full = coverageThreshold(cutoff);
    this.edge = this.mean - (this.mean - this.full) / 4;
    this.reach = Math.min(8, Math.ceil(3 * lowpass));
    const deviation = Math.min(1, lowpass);
    const taps = [0, 1, 2].map((i) => Math.exp(-((i / deviation) ** 2) / 2));
    const sum = taps[0] + 2 * (taps[1] + taps[2]);
    this.taps = taps.map((tap) => tap / sum);
    const variance = 2 * (this.taps[1] + 4 * this.taps[2]);
    const ofKernel = 1 - (cutoff * lost) / (1 - lost);
    const k2 = ofKernel + variance / (lowpass * lowpass);
    this.backward = ((k2 - 1) / 2) * lowpass * lowpass;
    this.sharpen = sharpeningTable(Math.sqrt(k2));
  }
}

/** The least sum of kernels inside of a surface. */
function coverageThreshold(cutoff) {
  const measured = [[0, 0], [0.5, 0.1], [1, 0.31], [1.5, 0.51], [2, 0.61], [3, 0.74], [4, 0.775], [16, 0.795]];
  for (let i = 1; i < measured.length; ++i) {
    const [c0, t0] = measured[i - 1];
    const [c1, t1] = measured[i];
    if (cutoff <= c1) return t0 + ((t1 - t0) * (cutoff - c0)) / (c1 - c0);
  }
  return measured[measured.length - 1][1];
}

/** The normal distribution: Abramowitz, Stegun, 7.1.26 would be too coarse, so this is a series. */
function normalDistribution(z) {
  if (z < -6) return 0;
  if (z > 6) return 1;
  let term = z;
  let sum = z;
  for (let i = 1; Math.abs(term) > 1e-12; ++i) {
    term *= (z * z) / (2 * i + 1);
    sum += term;
  }
  return 0.5 + (sum * Math.exp((-z * z) / 2)) / Math.sqrt(2 * Math.PI);
}

/** Phi(k Phi^-1(i / 512)). */
function sharpeningTable(k) {
  const table = new Float32Array(513);
  const steps = 4096;
  let before = 0;
  let sharpBefore = 0;
  let next = 0;
  for (let step = 0; step <= steps; ++step) {
    const z = 6 * ((2 * step) / steps - 1);
    const here = step === steps ? 1 : normalDistribution(z);
    const sharp = step === steps ? 1 : normalDistribution(k * z);
    for (; next <= 512 && next <= here * 512; ++next) {
      const share = here > before ? (next / 512 - before) / (here - before) : 0;
      table[next] = sharpBefore + share * (sharp - sharpBefore);
    }
    before = here;
    sharpBefore = sharp;
  }
  return table;
}

/** A linked program with its uniforms by name. */
class Program {
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text.trim());
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) {
      const logs = gl.getAttachedShaders(this.program).map((s) => gl.getShaderInfoLog(s));
      throw new Error(`The graphics driver refuses a program: ${logs.join('')}`);
    }
    this.uniforms = {};
    const count = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; ++i) {
      const { name, type } = gl.getActiveUniform(this.program, i);
      this.uniforms[name.replace('[0]', '')] = { type, at: gl.getUniformLocation(this.program, name) };
    }
  }

  /** Makes the program the current one, with these values of uniforms; textures by their names. */
  use(values) {
    const { gl } = this;
    gl.useProgram(this.program);
    let unit = 0;
    for (const [name, { type, at }] of Object.entries(this.uniforms)) {
      const value = values[name];
      if (type === gl.SAMPLER_2D || type === gl.UNSIGNED_INT_SAMPLER_2D) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, value);
        gl.uniform1i(at, unit++);
      } else if (type === gl.FLOAT) {
        gl.uniform1fv(at, [].concat(value));
      } else if (type === gl.FLOAT_VEC2) {
        gl.uniform2fv(at, value);
      } else if (type === gl.FLOAT_VEC3) {
        gl.uniform3fv(at, value);
      } else if (type === gl.FLOAT_MAT3) {
        gl.uniformMatrix3fv(at, false, value);
      } else if (type === gl.INT_VEC2) {
        gl.uniform2iv(at, value);
      } else {
        gl.uniform1i(at, value ? Number(value) : 0);
      }
    }
  }
}

const kListWidth = 2048;

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
  /** Throws where the browser lacks what is needed, with a message for the reader. */
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, depth: false });
    if (!gl) {
      throw new Error('This browser offers no WebGL2, which the page draws with. Browsers of 2022 and later have it; in older ones, and in virtual machines, it may be switched off.');
    }
    if (!gl.getExtension('EXT_color_buffer_float')) {
      throw new Error('The graphics driver cannot draw into textures of floating-point numbers (EXT_color_buffer_float), which sums of kernels need.');
    }
    this.gl = gl;
    this.canvas = canvas;
    this.sumFormat = gl.getExtension('EXT_float_blend') ? gl.RGBA32F : gl.RGBA16F;
    this.weights = new Weights(1, 1);
    this.software = isSoftware(gl);
    // Without a graphics processor vertices cost most, and points have a quarter of them.
    this.points = this.software && gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE)[1] >= 512;
    const splats = (attributes, fragment) => new Program(gl, shaders.splatVertex(attributes), fragment);
    const screen = (fragment) => new Program(gl, shaders.kScreenVertex, fragment);
    this.nearest = splats(false, shaders.kNearestFragment);
    this.sum = splats(true, shaders.kSumFragment);
    this.open = screen(shaders.kOpenFragment);
    this.composite = screen(shaders.kCompositeFragment);
    this.sums = screen(shaders.kSumsFragment);
    this.columns = screen(shaders.kColumnsFragment);
    this.least = screen(shaders.kLeastFragment);
    this.final = screen(shaders.kFinalFragment);
    this.makeQuads();
    this.sharpen = this.texture(gl.R32F, 513, 1, this.weights.sharpen);
    this.nothing = this.texture(gl.R32F, 1, 1, new Float32Array([1]));
    this.noShading = this.texture(gl.R32UI, 1, 1, new Uint32Array([0]));
    this.list = this.texture(gl.RG32UI, kListWidth, 1);
    this.listRows = 1;
    this.maps = new Map();
    this.size = [0, 0];
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
      const layer = { nearest: make(gl.RG32F), colors: make(this.sumFormat), normals: make(this.sumFormat) };
      layer.visibility = this.target([layer.nearest], this.depth);
      layer.attributes = this.target([layer.colors, layer.normals], this.depth);
      return layer;
    });
    this.color = make(gl.RGBA32F);
    this.sumsOfSides = make(gl.RGBA32F);
    this.composed = this.target([this.color, this.sumsOfSides]);
    this.planes = [1, 2, 3].map(() => {
      const texture = make(gl.R32F);
      return { texture, frame: this.target([texture]) };
    });
    this.frames = [
      ...this.layers.flatMap((l) => [l.visibility, l.attributes]), this.composed,
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
    if (this.points) {
      this.putList(drawn);
    } else {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.drawn);
      gl.bufferData(gl.ARRAY_BUFFER, drawn.data.subarray(0, 2 * drawn.count), gl.DYNAMIC_DRAW);
    }

    const uniforms = { ...this.cameraUniforms(cloud, view), ...this.cloudUniforms(cloud, view) };
    uniforms.u_depth_scale = drawn.nearest;
    uniforms.u_list = this.list;
    uniforms.u_most = Math.max(1, drawn.most);
    const layers = Math.min(view.layers, this.layers.length);
    for (let i = 0; i < 4; ++i) {
      const layer = this.layers[Math.min(i, this.layers.length - 1)];
      uniforms[`u_nearest${i + 1}`] = layer.nearest;
      uniforms[`u_colors${i + 1}`] = layer.colors;
      uniforms[`u_normals${i + 1}`] = layer.normals;
    }
    for (let i = 0; i < layers; ++i) this.drawLayer(i, layers, drawn, uniforms);
    uniforms.u_layers = layers;
    // Where nothing behind is known, what is in front covers the pixel.
    if (layers === 1) uniforms.u_full = 0.01;
    uniforms.u_sums = this.sumsOfSides;
    this.fill(this.composite, this.composed, uniforms);
    if (!view.fast && layers > 1) this.findEdges(uniforms);
    this.finish(uniforms, view, x0, x1);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** The clusters to be drawn, as a texture: instances of few points each would take longer. */
  putList(drawn) {
    const { gl } = this;
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
      u_mean: weights.mean,
      u_inv_mean: 1 / weights.mean,
      u_taps: weights.taps,
      u_reach: weights.reach,
      u_backward: weights.backward,
      u_background: view.background,
    };
  }

  /** Visibility and attributes of a layer: of the surfaces that those before do not hold. */
  drawLayer(number, layers, drawn, uniforms) {
    const { gl } = this;
    const layer = this.layers[number];
    const values = { ...uniforms, u_layer: number, u_nearest: layer.nearest, u_takes_rest: number > 0 && number + 1 === layers };
    // No texture may be read while it is drawn into.
    for (let i = number; i < 4; ++i) values[`u_nearest${i + 1}`] = this.nothing;
    const splats = () => {
      gl.bindVertexArray(this.vertices);
      if (this.points) {
        gl.bindVertexArray(this.noVertices);
        gl.drawArrays(gl.POINTS, 0, drawn.most * drawn.count);
      } else {
        gl.drawElementsInstanced(gl.TRIANGLES, 6 * drawn.most, gl.UNSIGNED_SHORT, 0, drawn.count);
      }
    };
    if (number > 0) this.markOpen(number, uniforms);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.visibility);
    gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.depthMask(true);
    gl.clearBufferfv(gl.DEPTH, 0, [0]);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.GREATER);
    this.nearest.use(values);
    splats();
    gl.disable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.attributes);
    gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clearBufferfv(gl.COLOR, 1, [0, 0, 0, 0]);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    this.sum.use(values);
    splats();
    gl.disable(gl.BLEND);
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
    this.open.use({ ...uniforms, u_colors: before.colors, u_normals: before.normals });
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
    const [, smooth, least] = this.planes;
    gl.scissor(x0, 0, x1 - x0, this.size[1]);
    this.fill(this.final, null, {
      ...uniforms,
      u_color: this.color,
      u_smooth: smooth.texture,
      u_least: least.texture,
      u_sharpen: this.sharpen,
      u_relief: this.nothing,
      u_has_relief: false,
      // One layer's sums end where something is in front of it, too.
      u_edges: !view.fast && view.opaque && uniforms.u_layers > 1,
      u_height: this.size[1],
      u_offset: [0, 0],
    });
  }

  /** The depths of the picture drawn last, nearest first: 1 / z of a pixel, 0 where there is none. */
  depthAt(x, y) {
    const { gl } = this;
    const value = new Float32Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.layers[0].visibility);
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.readPixels(x, y, 1, 1, gl.RGBA, gl.FLOAT, value);
    return value[0];
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
