// The page: reads its settings from the address, makes the clouds, draws when something changes.

import { Camera } from 'surfel/camera.js';
import { GpuCloud } from 'surfel/cloud.js';
import { commandFor } from 'surfel/command.js';
import { Controls } from 'surfel/controls.js';
import { bytesOfBase64 } from 'surfel/decode.js';
import { Panel } from 'surfel/panel.js';
import { Renderer } from 'surfel/renderer.js';
import { EmbeddedSource, ServedSource } from 'surfel/source.js';

const find = (id) => document.getElementById(id);
const page = JSON.parse(find('page').textContent);
const kSettle = 180; // Milliseconds without a change after which the whole picture is drawn.
/** Longest wait for a whole picture. */
const kPatience = 3000;
const kWorst = 8; // Steps of quality below the best.
const kSoonDrawn = 2e4; // Surfels that a processor alone draws in a moment.
const kSmallest = 4; // Steps after which pictures get no smaller.
const kSlowFrame = 80;
const kFastFrame = 35;
/** Surfels that the graphics memory holds at once of a served file. */
const kBudget = 6e6;

/** Texts that an address may have: some become words of a command. */
const kTexts = {
  mode: /^(color|normal|depth|attribute)$/,
  background: /^#[0-9a-f]{6}$/i,
  clipAxis: /^[xyz]?$/,
  compare: /^(file|lit|color|normal|depth|attribute)?$/,
};

function fail(error) {
  find('failure').textContent = error.message;
  find('failure').hidden = false;
  document.body.dataset.state = 'failed';
}

/** A colour as the browser's code, in linear light. */
function linearOf(code) {
  return [1, 3, 5].map((at) => {
    const c = parseInt(code.slice(at, at + 2), 16) / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  });
}

class Viewer {
  constructor() {
    this.canvas = find('canvas');
    this.renderer = new Renderer(this.canvas, page.files.some((info) => info.clips));
    this.address = new URLSearchParams(location.hash.slice(1));
    this.map = bytesOfBase64(page.map);
    this.settings = {
      mode: 'color', lit: !page.files[0].recorded, background: '#ffffff', fov: page.camera.fov,
      clipAxis: '', clipPlace: 0.5, clipFlip: false, compare: page.files.length > 1 ? 'file' : '',
      split: 0.5, lodError: 1.4, fly: false, ortho: page.camera.ortho > 0,
    };
    this.readSettings();
    this.home = this.firstCamera();
    this.camera = this.home.copy();
    this.quality = this.firstQuality();
    this.cost = 0; // Milliseconds of a surfel in a layer.
    this.missing = page.served ? 1 : 0; // Clusters that the last picture lacked.
    this.lastChange = -Infinity;
    this.lastFrame = 0;
    this.scheduled = false;
    this.clouds = page.files.map((info, number) => {
      const source = page.served ? new ServedSource(number, () => this.arrived()) : new EmbeddedSource(number);
      const cloud = new GpuCloud(this.renderer, info, source.slots(info, kBudget / page.files.length));
      return { info, source, cloud };
    });
  }

  /** Without a graphics processor the first picture has so few surfels that it is there at once. */
  firstQuality() {
    if (!this.renderer.software) return 0;
    const surfels = Math.max(...page.files.map((info) => info.surfels));
    return Math.max(0, Math.min(kWorst, Math.round(Math.log2(surfels / kSoonDrawn))));
  }

  async start() {
    for (const { source, cloud } of this.clouds) {
      const filled = source.fill(cloud);
      if (filled) await filled;
    }
    if (this.address.has('capture')) {
      await this.capture();
      return;
    }
    this.panel = new Panel(page.files, this.settings, (name) => this.settingChanged(name));
    this.controls = new Controls(
      this.canvas, this.camera, () => this.changed(), (x, y) => this.pick(x, y));
    this.controls.fly = this.settings.fly;
    this.panel.onClick('command', () => this.panel.copy(this.commands().join('\n')));
    this.panel.onClick('link', () => this.panel.copy(this.link()));
    this.panel.onClick('reset', () => {
      Object.assign(this.camera, this.home.copy(), { fov: this.settings.fov });
      this.camera.project(this.settings.ortho);
      this.changed();
    });
    window.addEventListener('resize', () => this.changed());
    this.canvas.addEventListener('webglcontextlost', () => {
      fail(new Error('The graphics driver has given up the picture; load the page again.'));
    });
    this.changed();
  }

  /** The settings that the address has, by their names. */
  readSettings() {
    for (const [name, value] of this.address) {
      if (!(name in this.settings)) continue;
      const type = typeof this.settings[name];
      if (type === 'boolean') this.settings[name] = value === '1';
      if (type === 'number' && Number.isFinite(Number(value))) this.settings[name] = Number(value);
      if (type === 'string' && kTexts[name].test(value)) this.settings[name] = value;
    }
    const shown = [this.settings.mode, this.settings.compare];
    if (shown.includes('attribute') && !page.files[0].attribute) this.settings.mode = 'color';
    if (this.settings.compare === 'file' && page.files.length < 2) this.settings.compare = '';
  }

  firstCamera() {
    const given = this.address.has('camera') && Camera.fromText(this.address.get('camera'));
    if (given) {
      this.settings.fov = given.fov;
      this.settings.ortho = given.ortho > 0;
      return given;
    }
    const camera = new Camera({ ...page.camera, fov: this.settings.fov });
    camera.project(this.settings.ortho);
    const aspect = this.wantedSize(1)[0] / this.wantedSize(1)[1];
    if (aspect < 1) camera.dolly(1 / aspect);
    return camera;
  }

  link() {
    const words = new URLSearchParams({ camera: this.camera.text() });
    for (const [name, value] of Object.entries(this.settings)) {
      if (name !== 'fov' && name !== 'ortho') words.set(name, typeof value === 'boolean' ? Number(value) : value);
    }
    return `${location.href.split('#')[0]}#${words}`;
  }

  settingChanged(name) {
    if (name === 'fov') this.camera.fov = this.settings.fov;
    if (name === 'ortho') this.camera.project(this.settings.ortho);
    if (name === 'fly') this.controls.fly = this.settings.fly;
    this.changed();
  }

  changed() {
    this.lastChange = performance.now();
    this.schedule();
  }

  arrived() {
    if (this.panel) this.schedule();
  }

  schedule() {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  wantedSize(share) {
    const asked = /^(\d+)x(\d+)$/.exec(this.address.get('size') ?? '');
    const ratio = window.devicePixelRatio || 1;
    const size = asked ? [Number(asked[1]), Number(asked[2])]
                       : [this.canvas.clientWidth * ratio, this.canvas.clientHeight * ratio];
    return size.map((side) => Math.max(1, Math.round(side * share)));
  }

  frame(now) {
    this.scheduled = false;
    const elapsed = now - this.lastFrame;
    this.lastFrame = now;
    const moving = this.controls.advance(Math.min(0.1, elapsed / 1000));
    if (moving) this.lastChange = now;
    // While clusters are still to come a whole picture would be drawn in vain.
    const rests = this.address.has('still') || performance.now() - this.lastChange >= kSettle;
    const still = rests && this.missing === 0;
    // By the processor alone a whole picture takes long: better and better ones come before it.
    if (!still) this.refined = this.renderer.software ? this.quality : 0;
    if (this.address.has('still')) this.refined = 0;
    const fast = !still || this.refined > 0;
    if (still && fast) this.refined = Math.max(0, this.refined - 2);
    if (!still && this.wasMoving) this.adapt(elapsed);
    this.wasMoving = !still;
    const quality = still ? this.refined : this.quality;
    const start = performance.now();
    this.layers = fast ? this.movingLayers() : this.affordableLayers();
    const missing = this.draw(fast, quality);
    this.missing = missing;
    if (!fast || this.renderer.software) this.renderer.wait();
    const taken = performance.now() - start;
    if (!fast || this.renderer.software) this.cost = taken / Math.max(1, this.drawnSurfels * this.layers);
    this.tell(missing, taken, fast);
    if (moving || (still && fast)) {
      this.schedule();
    } else if (fast) {
      setTimeout(() => this.schedule(), kSettle);
    }
  }

  movingLayers() {
    return this.renderer.software || this.quality > 0 ? 1 : 2;
  }

  /** Layers of a pixel for which nobody waits too long. */
  affordableLayers() {
    if (this.address.has('still')) return 4;
    const layer = this.cost * Math.max(...this.clouds.map(({ info }) => info.surfels));
    return Math.max(1, Math.min(4, Math.floor(kPatience / Math.max(layer, 1))));
  }

  /** Each step of quality below the best has half the surfels and half the pixels. */
  adapt(elapsed) {
    if (elapsed > 4 * kSettle) return;
    if (elapsed > kSlowFrame) this.quality = Math.min(kWorst, this.quality + 1);
    if (elapsed < kFastFrame) this.quality = Math.max(0, this.quality - 1);
  }

  /** What is seen on the left and on the right of the slider. */
  panes(width) {
    const { settings } = this;
    const first = { ...this.clouds[0], mode: settings.mode, lit: settings.lit };
    if (settings.compare === '') return [{ ...first, region: [0, width] }];
    const middle = Math.round(width * settings.split);
    const second = { ...first };
    if (settings.compare === 'file') {
      Object.assign(second, this.clouds[1]);
    } else if (settings.compare === 'lit') {
      second.lit = !settings.lit;
    } else {
      second.mode = settings.compare;
    }
    return [{ ...first, region: [0, middle] }, { ...second, region: [middle, width] }];
  }

  clip(info) {
    const { clipAxis, clipPlace, clipFlip } = this.settings;
    if (clipAxis === '') return null;
    const axis = 'xyz'.indexOf(clipAxis);
    const clip = { min: [-Infinity, -Infinity, -Infinity], max: [Infinity, Infinity, Infinity] };
    const place = info.min[axis] + clipPlace * (info.max[axis] - info.min[axis]);
    clip[clipFlip ? 'min' : 'max'][axis] = place;
    return clip;
  }

  /** Draws the picture; returns how many clusters were missing. */
  draw(fast, quality = this.quality) {
    const { settings, renderer, camera } = this;
    const scale = fast ? Math.sqrt(0.5) ** Math.min(quality, kSmallest) : 1;
    const size = this.wantedSize(scale);
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) {
      [this.canvas.width, this.canvas.height] = size;
    }
    renderer.resize(...size);
    renderer.gl.bindFramebuffer(renderer.gl.FRAMEBUFFER, null);
    const background = linearOf(settings.background);
    renderer.gl.clearColor(...background, 1);
    let missing = 0;
    this.drawnSurfels = 0;
    for (const pane of this.panes(size[0])) {
      const { cloud, info, source } = pane;
      const share = fast && !cloud.hasLevels ? 0.5 ** quality : 1;
      const lacking = cloud.choose(camera, size, { lodError: settings.lodError, share });
      missing += lacking.length;
      source.want(lacking);
      this.drawnSurfels += cloud.list.surfels;
      renderer.draw(cloud, cloud.list, {
        camera, mode: pane.mode, lit: pane.lit, region: pane.region, background, fast, layers: this.layers,
        map: this.map, growth: 1 / share, opaque: info.opaque,
        lodError: lacking.length > 0 ? Math.max(settings.lodError, cloud.list.error) : settings.lodError,
        skyUp: camera.up, clip: this.clip(page.bounds), depthRange: this.depthRange(),
      });
    }
    return missing;
  }

  /** Depths from the nearest to the farthest of the whole scene, by its bounding sphere. */
  depthRange() {
    const { min, max } = page.bounds;
    const middle = min.map((value, i) => (value + max[i]) / 2);
    const radius = Math.hypot(...max.map((value, i) => value - min[i])) / 2;
    const z = this.camera.inCamera(middle)[2];
    return [Math.max(0, z - radius), Math.max(z + radius, 1e-6 * radius)];
  }

  tell(missing, milliseconds, fast) {
    const surfels = this.drawnSurfels.toLocaleString('en');
    const failed = this.clouds.map(({ source }) => source.failed).find(Boolean);
    let text = `${surfels} surfels${fast ? '' : `, ${Math.round(milliseconds)} ms`}`;
    if (missing > 0) text += `; ${missing} clusters to come`;
    if (failed) text += `; the server does not answer (${failed.message})`;
    this.panel.say(text);
    document.body.dataset.missing = missing;
  }

  pick(x, y) {
    this.layers = 1;
    this.draw(false);
    const [width, height] = this.renderer.size;
    return this.renderer.depthAt(Math.floor(x * width), Math.floor(y * height));
  }

  /** The commands that make what is seen, one for each side of the slider. */
  commands() {
    const size = this.wantedSize(1);
    const { settings } = this;
    return this.panes(size[0]).map(({ info, mode, lit }) => commandFor(info, {
      camera: this.camera, size, mode, lit, backgroundCode: settings.background,
      clip: this.clip(page.bounds), lodError: settings.lodError,
    }));
  }

  /** Asks for clusters that a picture of this size lacks; returns whether there are some. */
  lacks(size) {
    let some = false;
    for (const { cloud, source } of this.clouds) {
      const lacking = cloud.choose(this.camera, size, { lodError: this.settings.lodError, share: 1 });
      source.want(lacking);
      some ||= lacking.length > 0;
    }
    return some;
  }

  /** Leaves the picture in the document, for programs that look at it. */
  async capture() {
    this.layers = 4;
    while (this.lacks(this.wantedSize(1))) await new Promise((resolve) => setTimeout(resolve, 20));
    this.draw(false);
    const picture = document.createElement('pre');
    picture.id = 'picture';
    picture.textContent = this.canvas.toDataURL('image/png');
    const command = document.createElement('pre');
    command.id = 'commands';
    command.textContent = this.commands().join('\n');
    document.body.append(picture, command);
    document.body.dataset.state = 'captured';
    const frames = Number(this.address.get('frames') ?? 0);
    if (frames > 0) document.body.dataset.milliseconds = this.measure(frames);
  }

  /** Milliseconds of a frame at best quality, and of one while moving. */
  measure(frames) {
    return [false, true].map((fast) => {
      this.layers = fast ? 1 : 4;
      this.draw(fast);
      this.renderer.wait();
      const start = performance.now();
      for (let i = 0; i < frames; ++i) {
        this.camera.orbit(0.02, 0);
        this.draw(fast);
        this.renderer.wait();
      }
      return ((performance.now() - start) / frames).toFixed(1);
    }).join(' ');
  }
}

try {
  await new Viewer().start();
} catch (error) {
  fail(error);
}
